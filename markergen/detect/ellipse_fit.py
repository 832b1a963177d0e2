"""Fit of dots' ellipses to the grey levels around their outlines, batched."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect import kernel
from markergen.detect.blobs import Blobs
from markergen.detect.components import grey_noise
from markergen.detect.ellipse_descent import (
    BLUR,
    CENTER,
    CONSTANTS,
    COUNT,
    DARK,
    HOLE,
    LIGHT,
    MAX_BLUR,
    MIN_SEMI_PX,
    SCALE,
    SLOPES,
    EllipseDescent,
    eigenvalues,
    shine_rows,
)
from markergen.detect.outline_pixels import QUANTIZATION, outline_pixels
from markergen.maths.batched import Batched

Bools = NDArray[np.bool_]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_NOISE_SLACK, _MOST_NOISE = 1.5, 2.0
"""Ratio to the noise of the plainest image areas, accepted and maximum: noise grows with the light."""

_BAND_BLURS, _MIN_BAND_PX, _MAX_BAND_PX = 3.0, 2.5, 9.0
"""Half-width of the band of fitted pixels around the outline: beyond it the levels are flat and carry no information,
and the next dot may begin."""

_MAX_MISFIT, _MAX_NOISE = 0.12, 0.2
"""Maximum RMS residual beyond the noise, and maximum noise, at the end, as shares of the contrast. Cameras that sharpen
edges leave 0.08."""
_MIN_MAJOR_PX, _MAX_ELONGATION, _MAX_SIGMA_PX = 1.0, 10.0, 0.5
_HOLE_SCALES = 0.15, 0.85
_OWN_SLOPE = 10.0
"""Ratio of a slope squared to its variance above which the slope is the dot's own: one in 20,000 by chance."""

_MUCH_UNEVEN = 2.0
"""Ratio of the sectors' shifts, squared, to what noise explains, above which the covariance grows by it. One dot in a
hundred is above."""

_MAX_MOVE_PX, _UNEVEN_MOVE_PX, _MAX_MOVE = 0.7, 0.15, 0.003
"""Maximum distances from the rough center, of all dots and of those twice as uneven as that, px plus a share of the
longer semi-axis: what covers a dot, or a shadow's edge across it, can pull the fit off by more."""

_DISK_BELOW, _RING_ABOVE, _RING_GAIN = 0.3, 0.7, 20.0
"""Levels in the middle of certain disks, glossy ones included, and certain rings; minimum gain of a doubtful ring in
twice the log-likelihood."""

_ROUGH_PX = 0.2
"""Standard deviation along each axis of the center of a dot whose fit is refused."""

_PER_UNIT = 64
"""Places of the compiled fit's table of the normal distribution per standard deviation."""

_SATURATION = tuple(2**bits - 1 for bits in range(8, 17))


@dataclass(frozen=True, eq=False)
class Fits(Batched):
    """Result of B fits: unknowns (B, 15), the inverses of their normal matrices, variance and noise of the grey levels.

    `complete` (B,) tells whether the fit has converged, and every edge that was not left out belongs to the dot;
    `misfit` (B,) is twice the negative log-likelihood, up to a constant that all fits to the same pixels share;
    `uneven` (B,) is chi2 of the sectors' shifts over its degrees of freedom, 1 for a good fit; `odd` (B,) is chi2 of
    the differences between opposite sectors' shifts, and `pairs` (B,) their number.
    """

    unknowns: Array
    inverse: Array
    variance: Array
    noise: Array
    complete: Bools
    misfit: Array
    uneven: Array
    odd: Array
    pairs: Array


def fit_blobs(image: Image, blobs: Blobs, inverted: bool = False) -> Blobs:
    """Fit blurred dark ellipses or elliptic rings to grey levels by least squares, from rough ellipses.

    Model: light - (light - dark) (D - D_hole), with D the share of ink (`blurred_ellipse`) and levels of light and
    dark that each have a slope over the dot; saturated where the image is. Ellipse, levels, slopes and blur are
    unknown, and for a ring the hole's center and scale too: under perspective hole and outline are not concentric.
    Every pixel counts by its information, so the center's error is near the lower bound set by the image's noise.

    Parts of the outline without an edge, or with one elsewhere (an occluder, a touching neighbor), are found sector by
    sector and left out. A fifth of the outline may be missing; with more the fit is refused, since half an ellipse also
    fits other ellipses, with other centers. What is neither dark nor light in the middle is fitted as a disk and as a
    ring, and is a ring only if that is clearly better.

    Parameters
    ----------
    image : array (h, w)
    blobs : Blobs
        Rough ellipses, a fraction of a px off.
    inverted : bool
        True for light dots in an inverted image, whose highest grey level is where there is no light.

    Returns
    -------
    Blobs
        The same blobs in the same order, with the covariance of each center from the fit's normal matrix and residual
        noise, which is at least that of rounding to whole grey levels. Where the fit is refused, the rough ellipse
        stays, with a wide covariance, and `fitted` is False.
    """
    if not len(blobs):
        return blobs
    count = len(blobs)
    doubtful = (blobs.middle > _DISK_BELOW) & (blobs.middle < _RING_ABOVE)
    if not doubtful.any():
        fits = fit_unknowns(image, blobs, blobs.ring, inverted)
        return _fitted(blobs, fits, _accepted(fits, blobs), _unlit(image, inverted))
    index = np.concatenate([np.arange(count), np.flatnonzero(doubtful)])
    kinds = blobs.take(index)
    kinds.ring[count:] ^= True
    # Both kinds are fitted to the same pixels.
    fits = fit_unknowns(image, kinds, kinds.ring | doubtful[index], inverted)
    good = _accepted(fits, kinds)
    chosen = np.arange(count)
    for other in range(count, len(index)):
        own = int(index[other])
        ring, disk = (own, other) if kinds.ring[own] else (other, own)
        if good[own] and good[other]:
            chosen[own] = ring if fits.misfit[disk] - fits.misfit[ring] > _RING_GAIN else disk
        elif good[other]:
            chosen[own] = other
    return _fitted(kinds.take(chosen), fits.take(chosen), good[chosen], _unlit(image, inverted))


def _fitted(blobs: Blobs, fits: Fits, good: Bools, unlit: float) -> Blobs:
    """Return blobs with the results of the good fits."""
    step, covariance = _shrink_slope(fits, good)
    unknowns = fits.unknowns + step
    good = good & (covariance[:, 0, 0] + covariance[:, 1, 1] < _MAX_SIGMA_PX**2)
    trace, root = eigenvalues(unknowns)
    # M's smaller eigenvalue belongs to the longer axis.
    semi = 2 / (trace[:, None] + root[:, None] * [-1, 1])
    angle = 0.5 * np.arctan2(-2 * unknowns[:, 3], unknowns[:, 4] - unknowns[:, 2])
    rough = np.maximum((blobs.covariance[:, 0, 0] + blobs.covariance[:, 1, 1]) / 2, _ROUGH_PX**2)
    return replace(
        blobs,
        center=np.where(good[:, None], unknowns[:, CENTER], blobs.center),
        semi=np.where(good[:, None], semi, blobs.semi),
        angle=np.where(good, angle, blobs.angle),
        covariance=np.where(good[:, None, None], covariance, rough[:, None, None] * np.eye(2)),
        light=np.where(good, unknowns[:, LIGHT] + unlit, blobs.light),
        dark=np.where(good, unknowns[:, DARK] + unlit, blobs.dark),
        blur=np.where(good, unknowns[:, BLUR], blobs.blur),
        fitted=good,
    )


def fit_unknowns(image: Image, blobs: Blobs, filled: Bools, inverted: bool = False) -> Fits:
    """Run the fits of `fit_blobs`, compiled or in NumPy; `filled` (B,) is true where the inside counts as well."""
    unknowns = np.zeros((len(blobs), COUNT))
    unknowns[:, CENTER] = unknowns[:, HOLE] = blobs.center
    cosine, sine = np.cos(blobs.angle), np.sin(blobs.angle)
    a, b = 1 / blobs.semi.T
    unknowns[:, 2], unknowns[:, 4] = a * cosine**2 + b * sine**2, a * sine**2 + b * cosine**2
    unknowns[:, 3] = (a - b) * cosine * sine
    # The light scales what is reflected: an inverted image is reckoned from its highest level.
    unlit = _unlit(image, inverted)
    # Of small dots, whose middle is blurred, the rough levels are a guess.
    unknowns[:, LIGHT], unknowns[:, DARK] = blobs.light - unlit, np.maximum(blobs.dark, 0) - unlit
    unknowns[:, BLUR] = np.clip(blobs.blur, 0.5, np.minimum(0.5 + blobs.semi[:, 1] / 3, MAX_BLUR))
    unknowns[:, SCALE] = 0.5
    band = np.clip(_BAND_BLURS * blobs.blur, _MIN_BAND_PX, _MAX_BAND_PX)
    # Rows enough to see the noise, and no more in larger images.
    plain = grey_noise(image[:: max(1, len(image) // 240)])
    noise = max(_MOST_NOISE * plain + 0.5, np.sqrt(QUANTIZATION))
    top = 255 if image.dtype == np.uint8 else int(image.max(initial=0))
    saturation = top - unlit if top in _SATURATION else np.inf
    if kernel.library() is not None:
        rough, limits = (blobs.semi, blobs.angle, band, blobs.ring, filled), (noise, saturation, unlit)
        found, inverse, facts = kernel.fit_dots(image, *rough, *limits, *_constants(), unknowns)
        return Fits(found, inverse, facts[0], facts[1], facts[2] > 0, *facts[3:])
    pixels = outline_pixels(image, blobs.center, blobs.semi, blobs.angle, band, filled)
    pixels = replace(pixels, grey=pixels.grey - unlit)
    descent = EllipseDescent(pixels, unknowns, blobs.ring, noise, saturation)
    descent.run()
    white = descent.noise()
    complete = descent.complete(white)
    of_edges = descent.uneven()
    return Fits(descent.unknowns, descent.inverse(), descent.variance(), white, complete, descent.misfit(), *of_edges)


def _unlit(image: Image, inverted: bool) -> float:
    """Return the level of what no light reaches."""
    return float(np.iinfo(image.dtype).max) if inverted else 0.0


@cache
def _constants() -> tuple[Array, Array]:
    """Return what the compiled fit takes from here: the constants, in the order of kernel_fit.c, and F and f."""
    from scipy.special import ndtr

    place = np.arange(-8 * _PER_UNIT, 8 * _PER_UNIT + 1) / _PER_UNIT
    table = np.stack([ndtr(place), np.exp(-0.5 * place * place) / np.sqrt(2 * np.pi)], axis=-1)
    return np.array([*CONSTANTS, place[0], _PER_UNIT, len(place)], dtype=float), table


def _accepted(fits: Fits, blobs: Blobs) -> Bools:
    """Return which dots (B,) have the outline of a dot nearly all around, near the rough one."""
    contrast = fits.unknowns[:, LIGHT] - fits.unknowns[:, DARK]
    trace, root = eigenvalues(fits.unknowns)
    good = fits.complete & (fits.noise < _MAX_NOISE * contrast)
    good &= fits.variance < (_NOISE_SLACK * fits.noise) ** 2 + (_MAX_MISFIT * contrast) ** 2
    good &= (trace - root < 2 / _MIN_MAJOR_PX) & (trace + root < 2 / MIN_SEMI_PX)
    good &= trace + root < _MAX_ELONGATION * (trace - root)
    moved = np.linalg.norm(fits.unknowns[:, CENTER] - blobs.center, axis=-1)
    most = np.where(fits.uneven > 2 * _MUCH_UNEVEN, _UNEVEN_MOVE_PX, _MAX_MOVE_PX)
    good &= moved < most + _MAX_MOVE * blobs.semi[:, 0]
    scale = fits.unknowns[:, SCALE]
    return np.asarray(good & (~blobs.ring | ((scale > _HOLE_SCALES[0]) & (scale < _HOLE_SCALES[1]))))


def _shrink_slope(fits: Fits, good: Bools) -> tuple[Array, Array]:
    """Return the last step (B, 15) and the centers' covariance (B, 2, 2), with slopes of the light shrunk to zero.

    Free slopes cost a third of the center's information and more; without them, uneven light displaces the center. So
    the slope of the illumination and that of a reflection have normal priors about zero, each with the variance of all
    such slopes of the image beyond their own errors (DerSimonian and Laird's estimate, for the reflection less its
    standard error): none in even light, as much as needed in other light.
    """
    step, covariance = np.zeros(fits.unknowns.shape), np.full((len(good), 2, 2), np.nan)
    if not good.any():
        return step, covariance
    free, unknowns = fits.variance[good, None, None] * fits.inverse[good], fits.unknowns[good]
    measure = np.zeros((len(unknowns), 4, 4))
    levels = unknowns[:, [LIGHT, DARK]]
    share = levels / np.sum(levels**2, axis=-1, keepdims=True)
    measure[:, 0, 0] = measure[:, 1, 1] = share[:, 0]
    measure[:, 0, 2] = measure[:, 1, 3] = share[:, 1]
    measure[:, 2:] = shine_rows(unknowns)
    slope = (measure @ unknowns[:, SLOPES, None])[..., 0]
    errors = measure @ free[:, SLOPES, SLOPES] @ measure.swapaxes(-1, -2)
    between = np.zeros((len(unknowns), 4))
    for part, slack in ((slice(0, 2), 0.0), (slice(2, 4), 1 / np.sqrt(len(unknowns)))):
        own = np.einsum("bii->b", errors[:, part, part]) / 2
        weight = np.maximum(own, 1e-15) ** -2
        square = np.sum(slope[:, part] ** 2, axis=-1) / 2
        shared = np.sum(weight * (square - (1 + slack) * own)) / np.sum(weight)
        # A dot's own may be beyond doubt, as at the edge of a shadow.
        between[:, part] = np.maximum(np.maximum(shared, square - _OWN_SLOPE * own), 1e-12)[:, None]
    # The gain of a measurement of all of these as zero, with these variances.
    back = measure.swapaxes(-1, -2)
    gain = free[:, :, SLOPES] @ back @ np.linalg.inv(errors + between[:, :, None] * np.eye(4))
    step[good] = -(gain @ slope[..., None])[..., 0]
    centers = free[:, CENTER, CENTER] - gain[:, CENTER] @ measure @ free[:, SLOPES, CENTER]
    # Only what moves opposite edges the same way moves a center, and it takes two of the differences. Where another
    # blur than the model's makes the residuals, it is less than these say: by the upper limit of its estimate from all.
    freedom = np.sum(fits.pairs[good] - 2)
    even = min(1.0, np.sum(fits.odd[good]) / freedom * (1 + np.sqrt(2 / freedom)))
    centers *= np.where(fits.uneven[good] > _MUCH_UNEVEN, fits.uneven[good], even)[:, None, None]
    # On some processors its product is symmetric only up to rounding.
    covariance[good] = (centers + centers.swapaxes(-1, -2)) / 2
    return step, covariance
