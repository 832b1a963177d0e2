"""Choice of the parameters of an unknown camera by left-out photographs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, UndeterminedError
from markergen.calibration.judging import LeftOut, NotJudged, Paired, Photographs, parameters_of, squared_length
from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.model.camera import Camera, Distortion

CHANCE = 0.01
"""Probability by chance alone at which a camera parameter joins, or is held."""

WEAKLY = 0.1
"""Standard deviation, within wide limits, of f as a share, of the principal point as a share of a third of the image's
width, and of the share by which each coefficient moves the image's corners."""

_POWER = {"p1": 1, "p2": 1, "k2": 4, "k3": 6, "k5": 4, "k6": 6}
"""Powers of the radius that coefficients go with, if not 2."""

MOST_DOTS = 120
"""Number of dots above which every second, third... is taken: they are enough for a choice, and many take long."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A set of camera parameters that was tried.

    Attributes
    ----------
    names : tuple of str
        Parameters that were estimated.
    left_out : LeftOut or None
        None if the photographs do not determine them.
    gain : Paired or None
        How many times smaller the left-out residuals are than with the set that stood then; None for the first.
    taken : bool
        Whether it took the place of that set.
    """

    names: tuple[str, ...]
    left_out: LeftOut | None
    gain: Paired | None
    taken: bool


@dataclass(frozen=True, eq=False)
class CameraChoice:
    """Camera parameters that left-out photographs justify.

    Attributes
    ----------
    names : tuple of str
        Parameters to estimate.
    camera : Camera
        Start for the adjustment, with a lens that has all of them.
    tried : tuple of Trial
        In the order tried.
    notes : tuple of str
        Parameters that are held although they usually are estimated, as sentences.
    """

    names: tuple[str, ...]
    camera: Camera
    freedom: CameraFreedom
    tried: tuple[Trial, ...]
    notes: tuple[str, ...]


def choose_camera(
    network: Network, views: Views, photo: Indices, weights: Array | None = None
) -> CameraChoice | NotJudged:
    """Choose the parameters of an unknown camera that left-out photographs justify.

    The search starts with f (fx alone stands for fx and fy in proportion), c, k1 and k2. Then p1 and p2, k3, and fy on
    its own join, the best one first, where left-out photographs are predicted better by more than chance. At last k2,
    k1 and c are held where they are known so poorly that left-out photographs are predicted better with them held, and
    their start is within the claimed errors.

    Parameters
    ----------
    network : Network
        Its camera is the start; the freedom of the camera is ignored.
    photo : array (v,) of int
        Photograph of each view.
    weights : array (v, n), optional
        As of `adjust`.
    """
    weights = np.ones(views.seen.shape) if weights is None else weights
    # Dots that take no part, as if they were never seen: a network of fewer.
    weights = weights * (np.arange(weights.shape[1]) % -(-weights.shape[1] // MOST_DOTS) == 0)
    network = replace(network, camera=_with_lens(network.camera))
    trials = _CameraTrials(Photographs(network, views, weights, photo))
    tried: list[Trial] = []
    names: tuple[str, ...] = ()
    current, left = None, None
    for start in _STARTS:
        names = trials.possible(start)
        current, left = trials.tried(names)
        tried.append(Trial(names, left, None, left is not None))
        if left is not None:
            break
    if current is None or left is None:
        return NotJudged(f"{len(np.unique(photo))} photographs are too few for an unknown camera")
    missing = [name for name in trials.possible(_STARTS[0]) if name not in names]
    notes = [f"{' '.join(missing)} held: the photographs do not determine more"] if missing else []
    groups = [group for group in _EXTRA if trials.possible(group) == group]
    best: tuple[Adjustment, LeftOut, int] | None = (current, left, -1)
    while best is not None:
        best, first = None, len(tried)
        for group in groups:
            if set(group) <= set(names):
                continue
            more = (*names, *group)
            whole, left_out_trial = trials.tried(more)
            gain = None if left_out_trial is None else Paired.of(left, left_out_trial)
            tried.append(Trial(more, left_out_trial, gain, False))
            better = gain is not None and gain.chance < CHANCE
            if (
                better
                and whole is not None
                and left_out_trial is not None
                and (best is None or left_out_trial.rms < best[1].rms)
            ):
                best = (whole, left_out_trial, len(tried) - 1)
        if best is not None and best[2] >= first:
            current, left, number = best
            tried[number] = replace(tried[number], taken=True)
            names = tried[number].names
    if current.variance_factor > POORLY and trials.camera.distortion.model == "radtan":
        photographs = replace(trials.photographs, network=replace(network, camera=_rational(trials.camera)))
        wider, more = _CameraTrials(photographs), (*names, *_LAST)
        whole, left_out_trial = wider.tried(more)
        gain = None if left_out_trial is None else Paired.of(left, left_out_trial)
        taken = gain is not None and gain.chance < CHANCE and whole is not None and whole.is_determined
        tried.append(Trial(more, left_out_trial, gain, taken))
        if taken and left_out_trial is not None and whole is not None:
            trials, names, current, left = wider, more, whole, left_out_trial
    for held in _HELD:
        fewer = tuple(name for name in names if name not in held)
        if not set(held) <= set(names) or not _within_sigma(current, trials.camera, held):
            continue
        whole, left_out_trial = trials.tried(fewer)
        gain = None if left_out_trial is None else Paired.of(left, left_out_trial)
        taken = gain is not None and gain.chance < CHANCE
        tried.append(Trial(fewer, left_out_trial, gain, taken))
        if taken and gain is not None and left_out_trial is not None and whole is not None:
            notes.append(f"{' '.join(held)} held: left-out photographs are predicted {gain.ratio:.3g} times better so")
            names, current, left = fewer, whole, left_out_trial
    return CameraChoice(names, trials.camera, trials.freedom(names), tuple(tried), tuple(notes))


_STARTS = (
    ("fx", "cx", "cy", "k1", "k2"),
    ("fx", "cx", "cy", "k1"),
    ("fx", "cx", "cy"),
    ("fx",),
)
"""Sets that the search for camera parameters may start with: the first one that the photographs determine."""

_EXTRA = (("p1", "p2"), ("k3",), ("fy",))
_LAST = ("k4", "k5", "k6")
POORLY = 2.0
"""chi2 per degree of freedom above which these are tried, the denominator of a quotient of polynomials."""
_HELD = (("k2",), ("k1",), ("cx", "cy"))


@dataclass(eq=False)
class _CameraTrials:
    """Left-out residuals with different camera parameters freed."""

    photographs: Photographs

    @property
    def camera(self) -> Camera:
        """Start for the camera."""
        return self.photographs.network.camera

    def possible(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return those of the names that the camera's lens has."""
        return tuple(name for name in names if name in self.camera.parameter_names)

    def freedom(self, names: Sequence[str]) -> CameraFreedom:
        """Return what may move; fx alone moves fy in proportion."""
        return CameraFreedom.of_names(self.camera, names, square="fy" not in names)

    def tried(self, names: Sequence[str]) -> tuple[Adjustment | None, LeftOut | None]:
        """Return the adjustment of all photographs, and the left-out residuals; None where they are too few."""
        freed = replace(self.photographs, network=replace(self.photographs.network, freedom=self.freedom(names)))
        adjusted = freed.adjusted(freed.network.design)
        if adjusted is None:
            return None, None
        whole, kept = adjusted
        freed = freed.continued(whole.camera)
        if len(whole.views) == len(freed.views):
            moved = replace(freed.views, rotation=whole.views.rotation, translation=whole.views.translation)
            freed = replace(freed, views=moved)
        places = freed.network.design.copy()
        places[kept] = whole.places
        left_out = freed.left_out(places, compared=False)[0]
        return whole, left_out if left_out.suffices else None


def wider_lenses(network: Network) -> list[tuple[str, Network]]:
    """Return networks whose camera is free within wide limits, of larger and larger lenses, with their coefficients."""
    cameras = [_with_lens(network.camera)]
    if cameras[0].distortion.model == "radtan":
        cameras.append(_rational(cameras[0]))
    networks = []
    for camera in cameras:
        corner = min(1.0, float(np.hypot(camera.width, camera.height)) / (camera.fx + camera.fy))
        unit = {"fx": camera.fx, "fy": camera.fy, "cx": camera.width / 3, "cy": camera.width / 3}
        unit |= {name: corner ** -_POWER.get(name, 2) for name in camera.distortion.names}
        sigma = WEAKLY * np.array([unit[name] for name in camera.parameter_names])
        freedom = CameraFreedom.of_covariance(np.diag(sigma**2))
        networks.append((" ".join(camera.distortion.names), replace(network, camera=camera, freedom=freedom)))
    return networks


def _within_sigma(adjustment: Adjustment, start: Camera, names: Sequence[str]) -> bool:
    """Return whether parameters differ from their start by no more than their claimed errors (95 %)."""
    from scipy.stats import chi2 as chi2_distribution

    chosen = [adjustment.camera.parameter_names.index(name) for name in names]
    try:
        spread = adjustment.camera_covariance[np.ix_(chosen, chosen)]
    except UndeterminedError:
        return True
    moved = (parameters_of(adjustment.camera) - parameters_of(start))[chosen]
    return squared_length(moved, spread)[0] < float(chi2_distribution.ppf(0.95, len(names)))


def _rational(camera: Camera) -> Camera:
    """Return the camera with the quotient of polynomials instead of the polynomial of all five coefficients."""
    return replace(camera, distortion=Distortion("rational", (*camera.distortion.coefficients, 0.0, 0.0, 0.0)))


def _with_lens(camera: Camera) -> Camera:
    """Return the camera with all five coefficients of radtan, if it has none or four of them."""
    coefficients = camera.distortion.coefficients
    if camera.distortion.model not in ("none", "radtan") or len(coefficients) == 5:
        return camera
    return replace(camera, distortion=Distortion("radtan", (*coefficients, *[0.0] * (5 - len(coefficients)))))
