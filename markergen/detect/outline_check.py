"""Does a fitted dot show its edge all around? Sector by sector of the outline, from what the fit leaves."""

import numpy as np
from numpy.typing import NDArray

from markergen.detect.outline_pixels import OutlinePixels

Array = NDArray[np.float64]

SECTORS = 16

_SHIFT_PX, _SHIFT_SHARE, _HEIGHT, _SIGMAS = 0.05, 0.004, 0.3, 4.0
"""The edge in a sector may be off the ellipse by so many px, or blurs if these are more than a px, plus a share of the
longer semi-axis, for print and lens; its height by a share of the contrast; and both by so many times their error."""

_EVEN = 4.0
"""And by so many times more where the opposite one is off as well."""

QUANTIZATION = 1 / 12
"""Variance of rounding to whole grey levels: no image has less noise."""

_TINY = 1e-12


def white_noise(pixels: OutlinePixels, residual: Array) -> Array:
    """Standard deviation (B,) of the white part of the residual (N,), from the median of neighbors' differences.

    Neither a misfit, which is smooth, nor strange pixels, which are few, count for much. Dots of which no two
    neighboring pixels are known have that of rounding.
    """
    neighbors = (np.diff(pixels.x) == 1) & (np.diff(pixels.owner) == 0)
    size = np.abs(np.diff(residual))
    spans = zip(pixels.start[:-1], pixels.start[1:] - 1, strict=True)
    median = np.array([_middle(size[a:b][neighbors[a:b]]) for a, b in spans])
    # The median of |N(0, 1)| is 0.6745, and a difference has twice the variance.
    return np.maximum(median / (0.6745 * np.sqrt(2)), np.sqrt(QUANTIZATION))


def _middle(values: Array) -> float:
    """Upper median, 0 of none; np.median takes several times as long for so few values."""
    half = len(values) // 2
    return float(np.partition(values, half)[half]) if len(values) else 0.0


def sector_of(pixels: OutlinePixels, direction: Array) -> NDArray[np.intp]:
    """Number (N,) of the sector that a pixel belongs to, SECTORS b + k for the k-th of dot b.

    Parameters
    ----------
    direction : array (2, N)
        From the dot's center, in coordinates in which the outline is a circle.
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
    """How far (B, SECTORS) the edge in a sector is from where and how high the fit has it; 1 is the most allowed.

    Moved outward by d, the edge adds -d times its slope to the grey levels, so d follows from the residual by least
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
