"""Bending of a marker between photographs, tested by the residuals of a calibration.

A calibration takes the dots to be at the same places in all photographs. A sheet that bends by different amounts leaves
residuals that quadratic heights z = a x^2 + b x y + c y^2 of each view explain, a, b, c its own. With M the information
about all coefficients together that is left when poses, dots and camera absorb what they can, and g the gradient of the
cost at the adjusted network, chi2 falls by g' M^+ g, to first order. Without bending

    F = (g' M^+ g / rank M) / ((chi2 - g' M^+ g) / (degrees of freedom - rank M))

has Fisher's F distribution, whatever the image's noise. A lens that is not as modeled, light that moves dots, or a
rolling shutter leave smooth residuals, too, but in all directions, where heights move dots along the image of the
normal. So where the same modes across it, beside those along it, explain clearly more than the noise does, they take
its place in the denominator.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment, UndeterminedError
from markergen.calibration.judging import NotJudged

FALSE_ALARM = 0.005
"""Probability that a rigid marker is said to bend."""

CLEARLY = 0.05
"""Probability of a ratio as large of the modes across to the noise by chance, below which they count instead."""

NEGLIGIBLE = 2e-5
"""Amplitude in m of bending that is not worth telling: a fifth of a dot's usual error in a print."""

_VISIBLE = 1e-6
"""Eigenvalue of M, as a share of the largest, below which the photographs do not show a way of bending."""


@dataclass(frozen=True, eq=False)
class Flex:
    """Test for bending between photographs: ratio of variances, 1 for a rigid marker, and chance of one as large then.

    The amplitude in m is the RMS over dots and views of the heights by which views differ, estimated by moments; 0 if
    the residuals have less than a rigid marker's.
    """

    statistic: float
    chance: float
    amplitude: float

    @property
    def bends(self) -> bool:
        """Whether the marker bends, by more than chance and by an amount that matters."""
        return self.chance < FALSE_ALARM and self.amplitude > NEGLIGIBLE

    @property
    def verdict(self) -> str:
        """The test as a sentence."""
        if self.bends:
            return (
                f"the marker bends between the photographs, by {1e3 * self.amplitude:.2g} mm RMS over its dots "
                "(or the camera is not quite as modeled): fix it to a flat, stiff plate"
            )
        if self.chance < FALSE_ALARM:
            return f"the marker bends between the photographs by a negligible {1e3 * self.amplitude:.2g} mm RMS"
        return "nothing shows that the marker bends between the photographs"


def flexing(adjustment: Adjustment) -> Flex | NotJudged:
    """Test whether the marker bends between photographs."""
    from scipy.special import fdtrc

    parts, views, network = adjustment.normal, adjustment.views, adjustment.network
    if not network.free:
        return NotJudged("bending is not distinguished from the errors of a print that is taken as designed")
    try:
        unscaled = adjustment.unscaled
    except UndeterminedError:
        return NotJudged("the photographs do not determine the dots, so that bending cannot be seen")
    modes = _modes(network.design, network.marker)
    bent = (parts.rows_pose[..., 3:] @ views.rotation[:, None, :, 2:]) * modes[:, None, :]
    values, along = _explained(adjustment, unscaled, bent)
    fall, rank = float(along.sum()), len(along)
    rest = adjustment.degrees_of_freedom - rank
    if rank < 1 or rest < 1:
        return NotJudged("too few dots and photographs to tell whether the marker bends between them")
    noise = max(adjustment.chi2 - fall, 1e-300) / rest
    both = _explained(adjustment, unscaled, np.concatenate([bent, bent[..., ::-1, :] * [[1.0], [-1.0]]], axis=-1))[1]
    more = len(both) - rank
    across = (float(both.sum()) - fall) / max(more, 1)
    if 0 < more < rest and fdtrc(more, rest - more, across / noise) < CLEARLY:
        noise, rest = across, more
    statistic = fall / rank / noise
    # Bending of variance t^2 by each mode: E g'g = s^2 tr M + t^2 tr M^2.
    variance = (float((along * values).sum()) - noise * float(values.sum())) / float((values**2).sum())
    visible = float(
        np.mean(
            [(modes[network.marker == k] ** 2).sum() / (network.marker == k).sum() for k in np.unique(network.marker)]
        )
    )
    return Flex(statistic, float(fdtrc(rank, rest, statistic)), float(np.sqrt(max(variance, 0.0) * visible)))


def _explained(adjustment: Adjustment, unscaled: Array, moves: Array) -> tuple[Array, Array]:
    """Eigenvalues of the information M about m ways to move the dots of each view, moves (v, n, 2, m) in px, and falls.

    The falls of chi2 are those along its eigenvectors; what the photographs do not show is left out.
    """
    parts, views = adjustment.normal, adjustment.views
    weight = np.linalg.inv(views.covariance) * adjustment.weights[..., None, None]
    weighted = (weight @ moves).swapaxes(-1, -2)
    v, m, size, q = len(views), moves.shape[-1], parts.dots, len(parts.rest)
    information = np.einsum("vnia,vnab->vib", weighted, moves)
    pose = np.einsum("vnia,vnab->vib", weighted, parts.rows_pose)
    through = pose @ np.linalg.inv(parts.pose)
    shared = np.zeros((v, m, q))
    if size:
        dots = parts.rows_pose[..., 3:] @ views.rotation[:, None]
        shared[..., :size] = (weighted @ dots).transpose(0, 2, 1, 3).reshape(v, m, size)
    shared[..., size:] = np.einsum("vnia,vnab->vib", weighted, parts.rows_camera)
    shared = (shared - through @ parts.cross).reshape(v * m, q)
    matrix = -shared @ unscaled @ shared.T
    index = np.arange(v)
    matrix.reshape(v, m, v, m)[index, :, index, :] += information - through @ pose.swapaxes(-1, -2)
    gradient = np.einsum("vnia,vna->vi", weighted, adjustment.residual).ravel()
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    kept = values > _VISIBLE * max(values[-1], 1e-300)
    return values[kept], (vectors[:, kept].T @ gradient) ** 2 / values[kept]


def _modes(design: Array, marker: NDArray[np.intp]) -> Array:
    """Quadratic heights (n, 3) of each marker's dots less translation and tilt: orthogonal, of RMS 1, or 0."""
    modes = np.zeros((len(design), 3))
    for number in np.unique(marker):
        is_on_marker = marker == number
        x, y = (
            (design[is_on_marker, :2] - design[is_on_marker, :2].mean(axis=0))
            / np.ptp(design[is_on_marker, :2], axis=0).max()
        ).T
        plane = np.linalg.qr(np.stack([np.ones_like(x), x, y], axis=-1))[0]
        bent = np.stack([x * x, x * y, y * y], axis=-1)
        left, strength, _ = np.linalg.svd(bent - plane @ (plane.T @ bent), full_matrices=False)
        count = min(3, left.shape[1])
        modes[np.ix_(is_on_marker, range(count))] = left[:, :count] * (strength[:count] > 1e-6) * np.sqrt(len(x))
    return modes
