"""Constellations: dots of one plate and about one size, enough and spread enough to find a pose by themselves."""
# tests: tests/model/test_sight.py

from collections.abc import Sequence

import numpy as np

from markergen.arrays import Array, Indices, Mask

FEWEST = 4
"""Number of dots of one diameter, not all on a line, from which a pose is found."""

SCALE_RATIO = 1.5
"""Ratio of diameters, between one dot and the next larger one, from which on they are of two scales."""

FLAT = 0.02
"""Ratio of the spreads across and along a line below which points count as on it."""


def scales_of(diameters: Array | Sequence[float]) -> tuple[Indices, ...]:
    """Indices of the dots of each scale, the largest first: diameters in m without a gap of `SCALE_RATIO`."""
    sizes = np.asarray(diameters, dtype=float)
    order = np.argsort(-sizes, kind="stable")
    ratio = sizes[order[:-1]] / np.maximum(sizes[order[1:]], np.finfo(float).tiny)
    return tuple(np.sort(scale) for scale in np.split(order, np.flatnonzero(ratio >= SCALE_RATIO) + 1))


def constellations_among(points: Array, diameters: Array) -> tuple[Indices, ...]:
    """Indices of the dots, points (n, 2 or 3) and diameters (n,) in m, that a pose can be estimated from by themselves.

    By scale, the largest first; all dots if only one scale can.
    """
    scales = [scale for scale in scales_of(diameters) if len(scale) >= FEWEST and spans(points[scale])]
    return tuple(scales) if len(scales) > 1 else (np.arange(len(points)),)


def enough(points: Array, seen: Mask) -> Mask:
    """Mask (P,) of the poses that see four points (n, 2 or 3) that are not on a line, of those seen (P, n)."""
    masks, which = np.unique(seen, axis=0, return_inverse=True)
    is_enough = [mask.sum() >= FEWEST and spans(points[mask]) for mask in masks]
    return np.array(is_enough, dtype=bool)[which.ravel()]


def spans(points: Array) -> bool:
    """Whether points (m, 2 or 3) are not on a line."""
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(size[1] > FLAT * size[0])
