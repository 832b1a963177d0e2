"""Pixels around the outlines of many ellipses, as one flat list, and tests for an edge all around."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_ENOUGH = 20_000
"""Maximum number of pixels per ellipse. Larger ones are subsampled by rows, to no fewer than 64 rows."""


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

    def of(self, chosen: NDArray[np.bool_]) -> "OutlinePixels":
        """Return the pixels of the chosen (B,) ellipses only, which are renumbered."""
        kept = chosen[self.owner]
        count = np.diff(self.start)[chosen]
        return OutlinePixels(
            self.x[kept],
            self.y[kept],
            self.grey[kept],
            np.repeat(np.arange(len(count)), count),
            np.concatenate([[0], np.cumsum(count)]),
        )


def outline_pixels(
    image: NDArray[np.uint8] | NDArray[np.uint16], center: Array, spread: Array, band: Array, filled: NDArray[np.bool_]
) -> OutlinePixels:
    """Collect the pixels within a distance of B outlines, row by row.

    Parameters
    ----------
    image : array (h, w)
    center : array (B, 2), px
    spread : array (B, 2, 2), px^2
        Q of the ellipse x'Q^-1 x = 1.
    band : array (B,), px
        The bands are bounded by the ellipses whose semi-axes are longer and shorter by this.
    filled : array (B,) of bool
        True to take the inside as well.
    """
    height, width = image.shape
    values, vectors = np.linalg.eigh(spread)
    semi = np.sqrt(values)
    outer = np.einsum("bik,bk,bjk->bij", vectors, (semi + band[:, None]) ** 2, vectors)
    hollow = (semi[:, 0] > band + 1) & ~filled
    inner = np.einsum("bik,bk,bjk->bij", vectors, np.maximum(semi - band[:, None], 1e-3) ** 2, vectors)

    reach = np.sqrt(outer[:, 1, 1])
    top = np.clip(np.ceil(center[:, 1] - reach), 0, height).astype(int)
    bottom = np.clip(np.floor(center[:, 1] + reach), -1, height - 1).astype(int)
    area = np.pi * (semi + band[:, None]).prod(axis=-1)
    area -= np.where(hollow, np.pi * (semi - band[:, None]).prod(axis=-1), 0)
    stride = np.clip(np.minimum(area / _ENOUGH, (bottom - top) / 64).astype(int), 1, None)
    rows = np.maximum((bottom - top) // stride + 1, 0)
    owner = np.repeat(np.arange(len(center)), rows)
    y = top[owner] + stride[owner] * _count_up(rows)

    middle, half = _crossing(outer, center, owner, y)
    hole_middle, hole_half = _crossing(inner, center, owner, y)
    # Rows without a hole are split at the middle, so that each has two spans.
    no_hole = ~(hollow[owner] & (hole_half > 0))
    leave = np.where(no_hole, np.floor(middle), np.floor(hole_middle - hole_half))
    enter = np.where(no_hole, np.floor(middle) + 1, np.maximum(np.ceil(hole_middle + hole_half), leave + 1))
    first = np.stack([np.ceil(middle - half), enter], axis=-1).ravel()
    last = np.stack([leave, np.floor(middle + half)], axis=-1).ravel()
    first, last = np.maximum(first, 0).astype(int), np.minimum(last, width - 1).astype(int)
    length = np.maximum(last - first + 1, 0)

    columns = np.repeat(first, length) + _count_up(length)
    of_span = np.repeat(np.repeat(y, 2), length)
    owners = np.repeat(np.repeat(owner, 2), length)
    count = np.bincount(owners, minlength=len(center))
    return OutlinePixels(
        columns.astype(float),
        of_span.astype(float),
        image[of_span, columns].astype(float),
        owners,
        np.concatenate([[0], np.cumsum(count)]),
    )


def _count_up(lengths: Indices) -> Indices:
    """Return 0, 1, ... length - 1 for each of the lengths, concatenated."""
    starts = np.cumsum(lengths) - lengths
    return np.arange(int(lengths.sum())) - np.repeat(starts, lengths)


def _crossing(spread: Array, center: Array, owner: Indices, y: Indices) -> tuple[Array, Array]:
    """Return middle and half length, px, of the part of row y inside each row's ellipse; length 0 if there is none."""
    q = spread[owner]
    up = y - center[owner, 1]
    determinant = np.maximum(q[:, 0, 0] * q[:, 1, 1] - q[:, 0, 1] ** 2, 0)
    half = np.sqrt(np.maximum(determinant / q[:, 1, 1] * (1 - up**2 / q[:, 1, 1]), 0))
    return center[owner, 0] + q[:, 0, 1] / q[:, 1, 1] * up, half


SECTORS = 16

_SHIFT_PX, _SHIFT_SHARE, _HEIGHT, _SIGMAS = 0.05, 0.004, 0.3, 4.0
"""Maximum deviations of the edge in a sector: its shift in px, or in blurs if these exceed a px, plus a share of the
longer semi-axis, for print and lens; its height as a share of the contrast; both plus a multiple of their error."""

_EVEN = 4.0
"""Additional multiple if the opposite sector is off as well."""

QUANTIZATION = 1 / 12
"""Variance of rounding to whole grey levels: no image has less noise."""

_TINY = 1e-12


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


def sector_of(pixels: OutlinePixels, direction: Array) -> NDArray[np.intp]:
    """Return the number (N,) of the sector that a pixel belongs to, SECTORS b + k for the k-th of dot b.

    Parameters
    ----------
    direction : array (2, N)
        Direction from the dot's center, in coordinates in which the outline is a circle.
    """
    turn = np.arctan2(direction[1], direction[0]) / (2 * np.pi) + 0.5
    return np.asarray(pixels.owner * SECTORS + np.minimum((turn * SECTORS).astype(int), SECTORS - 1))


def strangeness(
    sector: NDArray[np.intp],
    slope: Array,
    model: Array,
    residual: Array,
    contrast: Array,
    blur: Array,
    size: Array,
    noise: Array,
) -> Array:
    """Return the deviation (B, SECTORS) of the edge's place and height from the fit; 1 is the maximum allowed.

    An edge moved outward by d adds -d times its slope to the grey levels, so d follows from the residual by least
    squares; likewise the edge's height, relative to the model's.

    Parameters
    ----------
    sector : array (N,)
        See `sector_of`.
    slope : array (N,), grey levels per px
        Steepness of the outer edge in the model.
    model, residual : arrays (N,), grey levels
    contrast, blur, size, noise : arrays (B,)
        Light minus dark, width of the edge in px, longer semi-axis in px, grey noise.
    """

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(sector, values, SECTORS * len(contrast)).reshape(-1, SECTORS), dtype=float)

    half = 0.5 * np.repeat(contrast, SECTORS)[sector]
    information = np.maximum(total(slope**2), _TINY)
    shift = total(slope * np.clip(residual, -half, half)) / information
    # Blur other than the model's moves opposite edges alike, and does not move the center.
    opposite = np.maximum(np.sign(shift) * np.roll(shift, SECTORS // 2, axis=-1), 0)
    uneven = np.maximum(np.abs(shift) - opposite, np.abs(shift) / _EVEN)
    allowed = (_SHIFT_PX * np.maximum(1, blur) + _SHIFT_SHARE * size)[:, None]
    allowed = allowed + _SIGMAS * noise[:, None] / np.sqrt(information)

    mean = total(model) / np.maximum(total(np.ones_like(model)), 1)
    centered = model - mean.ravel()[sector]
    power = np.maximum(total(centered**2), _TINY)
    height = total(centered * residual) / power
    return np.maximum(uneven / allowed, np.abs(height) / (_HEIGHT + _SIGMAS * noise[:, None] / np.sqrt(power)))
