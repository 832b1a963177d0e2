"""Point spread functions as kernels: unit sum, symmetric about the middle, so that they move nothing."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.geometry.coverage import polygon_coverage

Array = NDArray[np.float64]

_DISK_VERTICES = 720


@lru_cache(maxsize=16)
def disk_kernel(radius: float) -> Array:
    """Exact coverage (2k + 1, 2k + 1) of a disk of that radius, in px of the kernel, around the middle."""
    angle = 2 * np.pi * np.arange(_DISK_VERTICES) / _DISK_VERTICES
    return _kernel(radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


@lru_cache(maxsize=16)
def line_kernel(length: float, direction_deg: float) -> Array:
    """Exact coverage (2k + 1, 2k + 1) of a line of that length, in px of the kernel, around the middle.

    The line has a width of one hundredth px, which adds nothing to the kernel's spread.
    """
    angle = np.deg2rad(direction_deg)
    along = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    across = np.array([-np.sin(angle), np.cos(angle)]) * 0.005
    return _kernel(np.array([along + across, -along + across, -along - across, along - across]))


def _kernel(outline: Array) -> Array:
    half = int(np.ceil(np.abs(outline).max() + 0.5))
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    tile, top, left = polygon_coverage([outline + half], 2 * half + 1, 2 * half + 1)
    kernel[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    # Rounding apart it is symmetric and positive already.
    kernel = np.abs(kernel + kernel[::-1, ::-1])
    return np.asarray(kernel / kernel.sum())
