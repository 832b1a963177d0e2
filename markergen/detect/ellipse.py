"""Ellipses of dots, fitted to the grey levels around their outlines, many at once."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from markergen.detect.descent import BLUR, CENTER, MIN_SEMI_PX, NOISE_SLACK, SCALE, SHAPE, SLOPE, Descent
from markergen.detect.outline_pixels import outline_pixels

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_CHECKPOINTS = (1, 0.3), (2, 0.17), (5, 0.12)
"""Steps, and the largest RMS residual after them, as a share of the contrast and beyond the noise."""
_STEPS, _ROUNDS = 5, 4

_BAND_BLURS, _MIN_BAND_PX, _MAX_BAND_PX = 3.0, 2.5, 9.0
"""Half-width of the band of pixels around the outline that are fitted: beyond it the levels are flat and tell nothing,
and the next dot may begin."""

_MAX_MISFIT, _MAX_NOISE = 0.06, 0.2
"""Largest RMS residual beyond the noise, and largest noise, at the end, as shares of the contrast."""
_MIN_MAJOR_PX, _MAX_ELONGATION, _MAX_SIGMA_PX = 2.4, 10.0, 0.5
_HOLE_SCALES = 0.15, 0.85

_DISK_BELOW, _RING_ABOVE, _RING_GAIN = 0.15, 0.7, 20.0
"""Levels in the middle of what is surely a disk, or a ring; what a ring in doubt must gain in log-likelihood, twice."""


@dataclass(frozen=True, eq=False)
class Outlines:
    """Rough outlines of B dark regions, where the fit starts.

    Attributes
    ----------
    center : array (B, 2), px
    spread : array (B, 2, 2), px^2
        Q of the ellipse x'Q^-1 x = 1 about the center: four times the covariance of its area.
    light, dark : arrays (B,), grey levels outside and inside
    blur : array (B,), px
        Width of the edge as the standard deviation of a normal distribution.
    middle : array (B,)
        Level in the middle, from 0 where it is dark to 1 where it is light.
    """

    center: Array
    spread: Array
    light: Array
    dark: Array
    blur: Array
    middle: Array

    def __len__(self) -> int:
        return len(self.center)

    def take(self, index: Bools | Indices) -> "Outlines":
        """The outlines of an index."""
        return Outlines(*(getattr(self, field.name)[index] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Dots:
    """B fitted dots.

    Attributes
    ----------
    index : array (B,) of int
        The outline that each began as.
    center : array (B, 2), px
    covariance : array (B, 2, 2), px^2, of the center
    semi : array (B, 2), px, longest first
    angle : array (B,), rad, of the longest axis from x
    ring : array (B,) of bool
    blur : array (B,), px
    misfit : array (B,)
        Twice the log-likelihood that the dot lacks, but for a constant that all fits of one outline share.
    """

    index: Indices
    center: Array
    covariance: Array
    semi: Array
    angle: Array
    ring: Bools
    blur: Array
    misfit: Array

    def __len__(self) -> int:
        return len(self.center)

    def take(self, index: Bools | Indices) -> "Dots":
        """The dots of an index."""
        return Dots(*(getattr(self, field.name)[index] for field in fields(self)))


def fit_dots(image: Image, outlines: Outlines, noise: float) -> Dots:
    """Least-squares fit of blurred dark ellipses, or elliptic rings, to grey levels; what is no dot is dropped.

    Model: (1 + g'x) (light - (light - dark) (D - D_hole)), with D the share of ink (`blurred_ellipse`) and g the
    slope of the light over the dot; saturated where the image is. Ellipse, levels, slope and blur are unknown, and for
    a ring the hole's center and scale too: under perspective hole and outline are not concentric. Every pixel counts by
    what it tells, so the center's error is near the least that the image's noise allows.

    Parts of the outline that show no edge, or one elsewhere (an occluder, a touching neighbor), are found sector by
    sector and left out. A fifth of the outline may be missing; with more the dot is dropped, for half an ellipse is
    much of another ellipse, with another center, too.

    Parameters
    ----------
    image : array (h, w)
    outlines : Outlines
    noise : float, grey levels
        Of plain parts of the image, to tell noise from what is not explained.

    Returns
    -------
    Dots
        With the covariance of each center by the fit's normal matrix and the noise that it leaves, no less than that
        of rounding to whole grey levels.
    """
    # What is neither dark nor light in the middle is fitted both as a disk and as a ring.
    doubtful = (outlines.middle > _DISK_BELOW) & (outlines.middle < _RING_ABOVE)
    index = np.concatenate([np.arange(len(outlines)), np.flatnonzero(doubtful)])
    ring = np.concatenate([outlines.middle >= _RING_ABOVE, np.ones(int(doubtful.sum()), dtype=bool)])
    descent = _descent(image, outlines.take(index), ring, ring | doubtful[index], noise)
    for steps, misfit in _CHECKPOINTS:
        descent.run(steps)
        descent.drop_hopeless(misfit)
    for _ in range(_ROUNDS):
        descent.run(_STEPS, descent.leave_out())
    dots = _dots(descent, index)
    return dots.take(_better(dots))


def _descent(image: Image, outlines: Outlines, ring: Bools, filled: Bools, noise: float) -> Descent:
    values, vectors = np.linalg.eigh(outlines.spread)
    shape = np.einsum("bik,bk,bjk->bij", vectors, values**-0.5, vectors)
    band = np.clip(_BAND_BLURS * outlines.blur, _MIN_BAND_PX, _MAX_BAND_PX)
    pixels = outline_pixels(image, outlines.center, outlines.spread, band, filled)
    top = int(image.max(initial=0))
    return Descent(pixels, outlines.center, shape, outlines.light, outlines.dark, outlines.blur, ring, noise, top)


def _dots(descent: Descent, index: Indices) -> Dots:
    """What has the outline of a dot nearly all around, with the center's covariance."""
    if len(descent.index):
        noise, variance = descent.noise(), descent.variance()
        good = variance < (NOISE_SLACK * noise) ** 2 + (_MAX_MISFIT * descent.contrast) ** 2
        descent.keep(good & (noise < _MAX_NOISE * descent.contrast) & descent.complete())
    variance, unknowns = descent.variance(), descent.unknowns
    step, covariance = _shrink_slope(descent.normal, variance, unknowns[:, SLOPE])
    # M's smaller eigenvalue belongs to the longer semi-axis.
    values, vectors = np.linalg.eigh((unknowns + step)[:, SHAPE][:, [0, 1, 1, 2]].reshape(-1, 2, 2))
    scale = unknowns[:, SCALE]
    good = np.einsum("bii->b", covariance[:, CENTER, CENTER]) < _MAX_SIGMA_PX**2
    good &= (1 / values[:, 0] > _MIN_MAJOR_PX) & (1 / values[:, 1] > MIN_SEMI_PX)
    good &= values[:, 1] < _MAX_ELONGATION * values[:, 0]
    good &= ~descent.ring | ((scale > _HOLE_SCALES[0]) & (scale < _HOLE_SCALES[1]))
    return Dots(
        index[descent.index],
        unknowns[:, CENTER] + step[:, CENTER],
        covariance[:, CENTER, CENTER],
        1 / values,
        np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]),
        descent.ring,
        unknowns[:, BLUR],
        np.diff(descent.pixels.start) * np.log(np.maximum(descent.misfit(), 1e-12)),
    ).take(good)


def _shrink_slope(normal: Array, variance: Array, slope: Array) -> tuple[Array, Array]:
    """Last step (B, 13), and covariance (B, 13, 13), when the slope of the light is expected to be as in other dots.

    A slope that is free costs a third of the center's information, one that is left out displaces the center where the
    light is uneven. So it has a normal prior about zero whose variance is what all slopes of the image show beyond
    their own errors (DerSimonian and Laird's estimate): none in even light, as much as need be in other.
    """
    if not len(slope):
        return np.zeros((0, normal.shape[-1])), normal
    free = variance[:, None, None] * np.linalg.pinv(normal, hermitian=True)
    own = np.einsum("bii->b", free[:, SLOPE, SLOPE]) / 2
    weight = np.maximum(own, 1e-15) ** -2
    between = np.sum(weight * (np.sum(slope**2, axis=-1) / 2 - own)) / np.sum(weight)
    prior = variance / max(float(between), 1e-12)
    stiff = normal.copy()
    stiff[:, [8, 9], [8, 9]] += prior[:, None]
    inverse = np.linalg.pinv(stiff, hermitian=True)
    # On some processors the product that it is made of is symmetric but for rounding.
    inverse = (inverse + inverse.swapaxes(-1, -2)) / 2
    step = -np.einsum("bij,bj->bi", inverse[:, :, SLOPE], prior[:, None] * slope)
    return step, variance[:, None, None] * inverse


def _better(dots: Dots) -> Bools:
    """Of dots that were fitted as a disk and as a ring the one that fits: the ring only if it does so clearly."""
    chosen = np.ones(len(dots), dtype=bool)
    for ring in np.flatnonzero(dots.ring):
        for disk in np.flatnonzero((dots.index == dots.index[ring]) & ~dots.ring):
            chosen[disk if dots.misfit[disk] - dots.misfit[ring] > _RING_GAIN else ring] = False
    return chosen
