"""What is behind a blurred outline: the size of disk or ring, the lens's blur, and which of both it is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect import kernel

Bools = NDArray[np.bool_]

_BILINEAR, _PIXEL = 1 / 6, 1 / 12
"""Variances along any direction, px^2: of the mean kernel of bilinear interpolation, and of a pixel's area."""
_LEAST_BLUR = 0.28

_LEAST_SHARE, _MAX_SHARE, _LEAST_DEPTH = 0.05, 0.954, 0.5
"""Limits for the share of the step within 1 px of the edge, which is less even for the sharpest, and for the share of
the ink's darkness that is left of a small dot."""
_MAX_INWARD = 1.0
_STEPS = 3

_WIDE, _LEAST_WIDE = 0.97, 3
_USUAL, _BLUR_RATIO = 0.5, 1.06
"""The usual blur is that at this quantile of the outlines that are certain and of at least that depth, if there are
three; that of small ones may differ from it by this factor."""
_OPEN_ABOVE, _TELLING = 0.05, 0.6
"""Level in the middle above which an outline may be a ring's, and below which the level expected of a ring is less and
less evidence; relative to the visible step."""

_RING_SIZE = np.array([1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 6, 7, 8, 10, 14])
_RING_SEEN = np.array(
    [1.391, 1.748, 2.334, 2.873, 3.343, 3.795, 4.244, 4.696, 5.15, 6.078, 7.026, 7.995, 9.968, 13.968]
)
_RING_DEPTH = np.array([0.276, 0.43, 0.474, 0.515, 0.577, 0.64, 0.699, 0.751, 0.798, 0.872, 0.923, 0.956, 0.988, 1])
_RING_MIDDLE = np.array([0, 0, 0.005, 0.196, 0.456, 0.665, 0.807, 0.894, 0.945, 0.987, 0.998, 1, 1, 1])
"""Of blurred rings with a hole of half their size: outer radius and radius where half of the visible step is seen, both
in blurs; visible step, as a share of that between paper and ink; and level in the middle relative to the visible step.
Of a disk of radius R, the ink seen at radius x has the noncentral chi-squared distribution with 2 degrees of freedom,
of R^2 at x^2, both in blurs."""

_RINGS = np.stack([_RING_SIZE, _RING_SEEN, _RING_DEPTH, _RING_MIDDLE])
_LIMITS = _LEAST_SHARE, _MAX_SHARE, _LEAST_DEPTH, _MAX_INWARD
"""In the order of kernel_blur.c."""

_QUARTER = np.cos((np.arange(12) + 0.5) / 24 * np.pi) ** 2
"""Squared cosines of an ellipse's parameter over a quarter of it."""


class Unblurred(NamedTuple):
    """What is behind k blurred outlines.

    Attributes
    ----------
    semi : array (2, k), longest first, px
    blur : array (k,), px of the image
        Standard deviation, with the pixel's own area.
    depth : array (k,)
        The visible step as a share of that between paper and ink.
    hole : array (k,)
        Evidence of a ring: the level in the middle relative to what a disk, 0, and a ring with a hole of half its size,
        1, would show; 0.5 where both would show the same.
    """

    semi: Array
    blur: Array
    depth: Array
    hole: Array


def unblurred(longer: Array, shorter: Array, slope: Array, middle: Array, scale: Array, certain: Bools) -> Unblurred:
    """Return what is behind blurred outlines at half of the visible step.

    With the normal distribution F, a straight edge blurred by s has the level F(e/s) at the distance e outside of it,
    so F(1/s) - F(-1/s) is the share of the step within 1 px of it. Curvature k moves the half-level inward by
    k s^2 / 2. The darkest place of a small dot is not as dark as the ink: in the middle of a disk, by the mean of
    1 - exp(-r^2 / 2 s^2) over the directions to its outline at r. So the half of what is visible lies outside of the
    edge. Small dots do not tell blur and darkness of their ink apart: they are given about the blur of the others,
    which comes from the lens.

    Parameters
    ----------
    longer, shorter : arrays (k,), px
        Semi-axes.
    slope : array (k,)
        Difference of the mean levels 1 px outside and 1 px inside of the outline, relative to the visible step.
    middle : array (k,)
        Level in the middle, from 0 where it is as dark as the darkest along the outline to 1 where it is light.
    scale : array (k,)
        Side of the pixels, in which all this is given, in those of the image.
    certain : array (k,)
        Whether the edge is like a dot's.
    """
    least, most = np.zeros(len(longer)), np.full(len(longer), np.inf)
    semi, blur, depth, _ = _solved(longer, shorter, slope, least > 0, least, most, 1)
    wide = depth > _WIDE
    common = np.sort(((blur**2 - _BILINEAR - _PIXEL) * scale**2)[wide & certain])
    if len(common) >= _LEAST_WIDE:
        usual = np.sqrt(max(common[int(_USUAL * len(common))], 0) / scale**2 + _BILINEAR + _PIXEL)
        least, most = usual / _BLUR_RATIO, usual * _BLUR_RATIO
        wide &= _darkness(_squares(longer, shorter), usual) > _WIDE
    small, open_ = np.flatnonzero(~wide), np.flatnonzero(~wide | (middle > _OPEN_ABOVE))
    again, ring = np.concatenate([small, open_]), np.arange(len(small) + len(open_)) >= len(small)
    *others, level = _solved(longer[again], shorter[again], slope[again], ring, least[again], most[again], _STEPS)
    # A blurred hole is less light, relative to the ink around it, than a wide one; of the smallest nothing is seen.
    expected, hole = np.maximum(level[ring], 1e-3), middle.copy()
    share = np.clip(middle[open_] / expected, -0.2, 1.2)
    hole[open_] = 0.5 + (share - 0.5) * np.minimum(expected / _TELLING, 1) ** 2
    of_ring = np.flatnonzero(hole[open_] > 0.5)
    for whole, other in zip((semi, blur, depth), others, strict=True):
        whole[..., small] = other[..., : len(small)]
        whole[..., open_[of_ring]] = other[..., len(small) + of_ring]
    # Finer pixels are a part of this level's, and so is their share of the blur.
    blur = (blur**2 - _BILINEAR - _PIXEL) * scale**2 + _PIXEL
    return Unblurred(semi, np.sqrt(np.maximum(blur, _LEAST_BLUR**2)), depth, hole)


def _solved(
    longer: Array, shorter: Array, slope: Array, ring: Bools, least: Array, most: Array, steps: int
) -> tuple[Array, Array, Array, Array]:
    """Return semi-axes (2, k), blur with that of sampling, depth, and level expected in the middle of a ring (k,).

    In NumPy, this is the twin of the function in kernel_blur.c.

    Parameters
    ----------
    least, most : arrays (k,), px
        Limits of the blur.
    """
    if kernel.library() is not None:
        outlines = longer, shorter, slope, ring, least, most
        return kernel.solve_blurred(outlines, steps, _QUARTER, _RINGS, _LIMITS)
    from scipy.special import ndtr, ndtri

    square = _squares(longer, shorter)
    mean = longer * shorter / np.sqrt((longer**2 + shorter**2) / 2)
    depth, lost, level = np.ones_like(longer), np.zeros_like(longer), np.zeros_like(longer)
    for _ in range(steps):
        blur = 1 / ndtri((1 + np.minimum(np.maximum(slope * depth + lost, _LEAST_SHARE), _MAX_SHARE)) / 2)
        blur = np.minimum(np.maximum(blur, least), most)
        depth = np.maximum(_darkness(square, blur), _LEAST_DEPTH)
        outside = -blur * ndtri(depth / 2)
        if not ring.any():
            continue
        seen = mean / blur
        size = np.where(seen < _RING_SEEN[-1], np.interp(seen, _RING_SEEN, _RING_SIZE), seen)
        level = np.where(ring, np.interp(size, _RING_SIZE, _RING_MIDDLE), 0)
        depth = np.where(ring, np.maximum(np.interp(size, _RING_SIZE, _RING_DEPTH), _LEAST_DEPTH), depth)
        outside = np.where(ring, mean - blur * (size - 0.5 / size), outside)
        # Between the two places is not the steepest part of a ring's edge, and the rise to the hole's level begins.
        inner, outer, width = (1 - outside) / blur, (-1 - outside) / blur, size / 2
        whole, *parts = ndtr(np.stack([1 / blur, inner, outer, inner - width, outer - width]))
        lost = np.where(ring, 2 * whole - 1 - parts[0] + parts[1] + parts[2] - parts[3], 0)
    return np.stack([longer, shorter]) - outside + _moved_inward(longer, shorter, blur), blur, depth, level


def _moved_inward(longer: Array, shorter: Array, blur: Array) -> Array:
    """Return by how much (2, k) the semi-axes of the ellipse through the half-level are too short.

    The half-level is moved inward by k s^2 / 2, k = a b / D^3 with D^2 = b^2 cos^2 + a^2 sin^2, which no ellipse
    follows: near sharp tips it has the least squares of distances along the normal. These change by b cos^2 / D with
    the longer semi-axis, and by a sin^2 / D with the shorter one.
    """
    a, b, s = longer[:, None], shorter[:, None], blur[:, None]
    along, across = b * _QUARTER, a * (1 - _QUARTER)
    square = b * along + a * across
    inward = s * np.minimum(s * a * b / (2 * square**1.5), _MAX_INWARD)
    aa, ab, bb = ((each / square).sum(axis=1) for each in (along * along, along * across, across * across))
    x, y = ((each * inward / np.sqrt(square)).sum(axis=1) for each in (along, across))
    return np.asarray(np.stack([bb * x - ab * y, aa * y - ab * x]) / (aa * bb - ab * ab))


def _squares(longer: Array, shorter: Array) -> Array:
    """Return the squared distances (k, 12) from the center to points of the outline, at even steps of its parameter."""
    return np.multiply.outer(longer**2, _QUARTER) + np.multiply.outer(shorter**2, 1 - _QUARTER)


def _darkness(square: Array, blur: Array) -> Array:
    """Return how dark the middle (k,) of blurred ellipses is, from 0 to 1.

    The integral of a normal distribution out to the distance r in every direction is the mean of 1 - exp(-r^2 / 2 s^2)
    over directions; at even steps of the ellipse's parameter, a direction counts by its angle, in proportion to 1/r^2.
    """
    share = 1 / square
    inside = -np.expm1(square * (-0.5 / blur**2)[:, None])
    return np.asarray((share * inside).sum(axis=1) / share.sum(axis=1))
