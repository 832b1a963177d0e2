"""Pixels around the outlines of many ellipses, as one flat list, and tests for an edge all around."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices

Bools = NDArray[np.bool_]

_ENOUGH, _ROWS = 20_000, 64
"""Maximum number of pixels per ellipse. Larger ones are subsampled by rows, to no fewer than the second."""


@dataclass(frozen=True, eq=False)
class OutlinePixels:
    """N pixels of B ellipses, sorted by ellipse.

    Attributes
    ----------
    x, y : arrays (N,), px
    grey : array (N,)
    owner : array (N,) of int
        Ellipse that a pixel belongs to; near neighbors may share pixels.
    start : array (B + 1,) of int
        Pixels start[b] to start[b + 1] belong to ellipse b.
    """

    x: Array
    y: Array
    grey: Array
    owner: Indices
    start: Indices


def outline_pixels(
    image: NDArray[np.uint8] | NDArray[np.uint16], center: Array, semi: Array, angle: Array, band: Array, filled: Bools
) -> OutlinePixels:
    """Collect the pixels within a distance of B outlines, row by row.

    Parameters
    ----------
    image : array (h, w)
    center, semi : arrays (B, 2), px, semi-axes longest first
    angle : array (B,), rad, of the longest axis from x
    band : array (B,), px
        The bands are bounded by the ellipses whose semi-axes are longer and shorter by this.
    filled : array (B,) of bool
        True to take the inside as well.
    """
    height, width = image.shape
    outer, inner = semi + band[:, None], np.maximum(semi - band[:, None], 1e-3)
    hollow = (semi[:, 1] > band + 1) & ~filled
    reach = _row_form(outer, angle)[0]
    top = np.clip(np.ceil(center[:, 1] - reach), 0, height).astype(int)
    bottom = np.clip(np.floor(center[:, 1] + reach), -1, height - 1).astype(int)
    area = np.pi * (outer[:, 0] * outer[:, 1] - hollow * inner[:, 0] * inner[:, 1])
    stride = np.clip(np.minimum(area / _ENOUGH, (bottom - top) / _ROWS).astype(int), 1, None)
    rows = np.maximum((bottom - top) // stride + 1, 0)
    owner = np.repeat(np.arange(len(center)), rows)
    y = top[owner] + stride[owner] * _count_up(rows)

    middle, half = _crossing(outer, angle, center, owner, y)
    hole_middle, hole_half = _crossing(inner, angle, center, owner, y)
    # Rows without a hole are split at the middle, so that each has two spans.
    no_hole = ~(hollow[owner] & (hole_half > 0))
    leave = np.where(no_hole, np.floor(middle), np.floor(hole_middle - hole_half))
    enter = np.where(no_hole, np.floor(middle) + 1, np.maximum(np.ceil(hole_middle + hole_half), leave + 1))
    first = np.stack([np.ceil(middle - half), enter], axis=-1).ravel()
    last = np.stack([leave, np.floor(middle + half)], axis=-1).ravel()
    first, last = np.maximum(first, 0).astype(int), np.minimum(last, width - 1).astype(int)
    length = np.maximum(last - first + 1, 0)

    columns = np.repeat(first, length) + _count_up(length)
    row = np.repeat(np.repeat(y, 2), length)
    owners = np.repeat(np.repeat(owner, 2), length)
    start = np.concatenate([[0], np.cumsum(np.bincount(owners, minlength=len(center)))])
    return OutlinePixels(columns.astype(float), row.astype(float), image[row, columns].astype(float), owners, start)


def _count_up(lengths: Indices) -> Indices:
    """Return 0, 1, ... length - 1 for each of the lengths, concatenated."""
    starts = np.cumsum(lengths) - lengths
    return np.arange(int(lengths.sum())) - np.repeat(starts, lengths)


def _row_form(semi: Array, angle: Array) -> tuple[Array, Array, Array]:
    """Return half the height of ellipses, dx/dy of the rows' middles, and half the length of the middle row."""
    cosine, sine = np.cos(angle), np.sin(angle)
    a, b = semi[:, 0], semi[:, 1]
    reach = np.sqrt((a * sine) ** 2 + (b * cosine) ** 2)
    return reach, (a * a - b * b) * cosine * sine / (reach * reach), a * b / reach


def _crossing(semi: Array, angle: Array, center: Array, owner: Indices, y: Indices) -> tuple[Array, Array]:
    """Return middle and half length, px, of the part of row y inside each row's ellipse; length 0 if there is none."""
    reach, shear, half = (each[owner] for each in _row_form(semi, angle))
    up = y - center[owner, 1]
    share = up / reach
    return center[owner, 0] + shear * up, half * np.sqrt(np.maximum(1 - share * share, 0))


SECTORS = 16

_SHIFT_PX, _SHIFT_SHARE, _HEIGHT, _SIGMAS = 0.05, 0.004, 0.3, 4.0
"""Maximum deviations of the edge in a sector: its shift in px, or in blurs if these exceed a px, plus a share of the
longer semi-axis, for print and lens; its height as a share of the contrast; both plus a multiple of their error."""

_EVEN = 4.0
"""Additional multiple if the opposite sector is off as well."""

_MISFIT = 0.025
"""Maximum share of the contrast by which the edge may be off all around: with more, covered dots fit, too."""

_UNSEEN = 1e9
"""Deviation of a sector without pixels, beyond the image's edge."""

QUANTIZATION = 1 / 12
"""Variance of rounding to whole grey levels: no image has less noise."""

_TINY = 1e-12
CONSTANTS = [_SHIFT_PX, _SHIFT_SHARE, _HEIGHT, _SIGMAS, _EVEN, _MISFIT, _UNSEEN, QUANTIZATION, _ENOUGH, _ROWS]
"""What the compiled fit takes from here, in its order."""
_EIGHTH = float(np.tan(np.pi / 8))


def white_noise(pixels: OutlinePixels, residual: Array) -> Array:
    """Return the standard deviation (B,) of the residual's white part, from the median of neighbors' differences.

    Misfit, which is smooth, and foreign pixels, which are few, hardly count. Dots without known neighboring pixels get
    the standard deviation of rounding.
    """
    neighbors = (np.diff(pixels.x) == 1) & (np.diff(pixels.owner) == 0)
    size = np.abs(np.diff(residual))
    spans = zip(pixels.start[:-1], pixels.start[1:] - 1, strict=True)
    median = np.array([_middle(size[a:b][neighbors[a:b]]) for a, b in spans])
    # The median of |N(0, 1)| is 0.6745, and a difference has twice the variance.
    return np.maximum(median / (0.6745 * np.sqrt(2)), np.sqrt(QUANTIZATION))


def _middle(values: Array) -> float:
    """Return the upper median, 0 if empty; np.median takes several times as long for so few values."""
    half = len(values) // 2
    return float(np.partition(values, half)[half]) if len(values) else 0.0


def sector_of(direction: Array) -> NDArray[np.intp]:
    """Return the number (N,) of the sector that a pixel belongs to, counted from x toward y.

    Parameters
    ----------
    direction : array (2, N)
        Direction from the dot's center, in coordinates in which the outline is a circle.
    """
    u, v = direction
    across, down = np.abs(u), np.abs(v)
    turn = (down > _EIGHTH * across).astype(np.intp) + (down > across) + (_EIGHTH * down > across)
    turn = np.where(u < 0, SECTORS // 2 - 1 - turn, turn)
    return np.where(v < 0, SECTORS - 1 - turn, turn)


def sector_sums(sector: NDArray[np.intp], slope: Array, model: Array, residual: Array, half: Array) -> Array:
    """Return the sums that `strangeness` takes, over the pixels of each sector: (sectors, 8).

    They are of 1, slope^2, slope r, r, model, model^2, model r and r^2; in the third and the last, r is clipped at half
    the contrast.

    Parameters
    ----------
    sector : array (N,)
        As from `sector_of`, plus SECTORS times the number of the pixel's dot.
    slope : array (N,), grey levels per px
        Steepness of the outer edge in the model.
    model, residual : arrays (N,), grey levels
    half : array (B,)
        Half of each dot's contrast.
    """
    limit = np.repeat(half, SECTORS)[sector]
    clipped = np.clip(residual, -limit, limit)
    terms = None, slope * slope, slope * clipped, residual, model, model * model, model * residual, clipped * clipped
    return np.stack([np.bincount(sector, term, SECTORS * len(half)) for term in terms], axis=-1)


def strangeness(sums: Array, contrast: Array, blur: Array, size: Array, noise: Array) -> Array:
    """Return the deviation (B, SECTORS) of the edge's place and height from the fit; 1 is the maximum allowed.

    An edge moved outward by d adds -d times its slope to the grey levels, so d follows from the residual by least
    squares; likewise the edge's height, relative to the model's.

    Parameters
    ----------
    sums : array (SECTORS B, 8)
        See `sector_sums`.
    contrast, blur, size, noise : arrays (B,)
        Light minus dark, width of the edge in px, longer semi-axis in px, grey noise.
    """
    sums = sums.reshape(-1, SECTORS, 8).transpose(2, 0, 1)
    count, information, moved, residual, model, square, product, misfit = sums
    # Edges that the camera sharpened are off all around: a quarter of the sectors tells by how much.
    misfit = np.sqrt(np.sort(misfit / np.maximum(count, 1), axis=-1)[:, SECTORS // 4 - 1])
    noise = np.maximum(noise, np.minimum(misfit, _MISFIT * contrast))
    information = np.maximum(information, _TINY)
    shift = moved / information
    # Blur other than the model's moves opposite edges alike, and does not move the center.
    opposite = np.maximum(np.sign(shift) * np.roll(shift, SECTORS // 2, axis=-1), 0)
    uneven = np.maximum(np.abs(shift) - opposite, np.abs(shift) / _EVEN)
    allowed = (_SHIFT_PX * np.maximum(1, blur) + _SHIFT_SHARE * size)[:, None]
    allowed = allowed + _SIGMAS * noise[:, None] / np.sqrt(information)

    mean = model / np.maximum(count, 1)
    power = np.maximum(square - mean * model, _TINY)
    height = (product - mean * residual) / power
    strange = np.maximum(uneven / allowed, np.abs(height) / (_HEIGHT + _SIGMAS * noise[:, None] / np.sqrt(power)))
    return np.where(count > 0, strange, _UNSEEN)
