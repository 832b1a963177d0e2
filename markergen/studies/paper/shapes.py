"""What final layouts look like: near to a square, turned to lie on each other, and typical ones."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SQUARE_LIKE = 0.15
"""A layout whose corners are off from the nearest square by this share of its size, RMS, still looks like one."""

TYPICAL = 500
"""Layouts of a group among which the most typical one is looked for."""

_INNER = 0.6
"""Points within this share of the farthest one's distance from the center are inner ones."""


def square_misfit(layouts: Array) -> Array:
    """Distance (...) of four points (..., 4, 2) from the nearest square of any place, size, and turn, in parts of size.

    RMS distance of the points over that from their centroid: 0 for a square, 1 for what has nothing of one.
    """
    centered = layouts - layouts.mean(axis=-2, keepdims=True)
    z = centered[..., 0] + 1j * centered[..., 1]
    # Around the centroid the corners of a square come one after the other.
    z = np.take_along_axis(z, np.argsort(np.angle(z), axis=-1), axis=-1)
    square = np.array([1, 1j, -1, -1j])
    size = np.sum(np.abs(z) ** 2, axis=-1)
    along = np.abs(np.sum(z * square.conj(), axis=-1)) ** 2 / 4
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(np.clip(1 - along / size, 0.0, 1.0))


def best_square_misfit(layouts: Array) -> Array:
    """Least `square_misfit` (...) of any four of five points (..., 5, 2)."""
    return np.min([square_misfit(np.delete(layouts, i, axis=-2)) for i in range(layouts.shape[-2])], axis=0)


def aligned(layouts: Array) -> Array:
    """Layouts (k, n, 2) turned so that their corners, as far as they repeat n-fold, lie where those of an n-gon do."""
    z = layouts[..., 0] + 1j * layouts[..., 1]
    n = layouts.shape[-2]
    size = np.abs(z).max(axis=-1, keepdims=True)
    phase = np.angle(np.sum((z / size) ** n, axis=-1)) / n
    turned = z * np.exp(1j * (np.pi / 2 - phase))[..., None]
    if n == 4:
        turned *= np.exp(1j * np.pi / 4)
    return np.stack([turned.real, turned.imag], axis=-1)


def typical(layouts: Array, groups: int) -> list[tuple[Array, float]]:
    """Most typical layouts (n, 2) of the largest groups by how many points are inner ones, and the groups' shares.

    Of a group that one is typical whose sorted distances are nearest to the medians over the group.
    """
    radius = np.linalg.norm(layouts, axis=-1)
    inner = np.sum(radius < _INNER * radius.max(axis=-1, keepdims=True), axis=-1)
    kinds, counts = np.unique(inner, return_counts=True)
    found = []
    for kind in kinds[np.argsort(-counts, kind="stable")][:groups]:
        group = layouts[inner == kind]
        group = group[:: max(1, len(group) // TYPICAL)]
        distances = np.sort(_pairs(group), axis=-1)
        nearest = np.argmin(np.sum((distances - np.median(distances, axis=0)) ** 2, axis=-1))
        found.append((group[nearest], float(np.mean(inner == kind))))
    return found


def least_gap(layouts: Array) -> Array:
    """Smallest distance (...) between two points of layouts (..., n, 2)."""
    return _pairs(layouts).min(axis=-1)


def _pairs(layouts: Array) -> Array:
    first, second = np.triu_indices(layouts.shape[-2], 1)
    return np.linalg.norm(layouts[..., first, :] - layouts[..., second, :], axis=-1)
