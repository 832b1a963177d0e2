"""Regular layouts in a feasible region: polygons, concentric rings, full rings, and lattices cut to the region.

They are what designs are compared with, and starts of the search.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.geometry import region as geometry
from markergen.maths.rotation import turn_z
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.packing import fitting
from markergen.optimize.problem import FeasibleRegion

PHASES = 24
"""Number of rotations of a regular polygon within its period."""

SIZES, HALVINGS = 100, 30
"""Number of polygon sizes tried, and of bisections between the largest that fits and the next."""

RATIOS = (0.0, 0.35, 0.6, 0.8)
"""Radii of an inner ring, in those of the outer one; 0 places its dots about the center."""

MISSING, STEPS = (0, 1, 2), (1.0, 0.95, 0.9)
"""Numbers of dots that full rings have less than they hold, and distances between them, in spacings."""

TURNS = np.deg2rad([0.0, 15.0, 30.0, 45.0])
"""Rotations of lattices, and of rings as a whole."""

PUSHED = 0.2
"""Largest overlap of dots, as a fraction of their spacing, that is pushed apart."""

PITCHES = 6
"""Number of pitches of a lattice, from dots that touch to the largest pitch with enough sites."""


def polygons(region: FeasibleRegion, n: int) -> Array:
    """Largest regular n-gons (B, n, 2) in m at every phase, the upright one first; some may be infeasible.

    They are centered on the marker or on the largest circle in the region.
    """
    unit = regular_polygon(n, 1.0) @ _turns(2 * np.pi / n * np.arange(PHASES) / PHASES)
    return np.concatenate([_largest(region, unit, center) for center in _centers(region)])


def regular_layouts(region: FeasibleRegion, n: int) -> tuple[Array, int]:
    """Feasible regular layouts (B, n, 2) in m, and how many of them are polygons.

    Polygons come first, then two concentric rings, rings filled from the edge inward where one does not hold all dots,
    lattices, and a packing where nothing else fits.
    """
    first = polygons(region, n)
    others = np.array([*_rings(region, n), *_full_rings(region, n), *_lattices(region, n)])
    others = region.boundary.project(others, region.inset)
    # What has to be pushed far is no longer regular.
    others = region.project(others[region.violation(others) <= PUSHED * region.spacing])
    first, others = first[region.holds(first)], others[region.holds(others)]
    packed = None if len(first) + len(others) else fitting(region, n)
    return np.concatenate([first, others] if packed is None else [first, packed[None]]), len(first)


def _rings(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """Rings of n - k and k dots, aligned and staggered, on circles of several ratios."""
    radius = region.boundary.radius - region.inset
    center = _centers(region)[-1]
    for inner in range(1, n // 2 + 1):
        for ratio in RATIOS[: 1 if inner == 1 else None]:
            outside, within = regular_polygon(n - inner, radius), regular_polygon(inner, max(ratio, 0.01) * radius)
            for offset in (0.0, np.pi / (n - inner)):
                for rotation in _turns(TURNS):
                    yield center + np.concatenate([outside, within @ _turns(np.array([offset]))[0]]) @ rotation


def _full_rings(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """Rings filled from the edge inward, the innermost with what is left, aligned and turned by half a step."""
    spacing, radius = region.spacing, region.boundary.radius - region.inset
    if not 0 < spacing <= radius or n <= _most_around(radius, spacing):
        return
    center = _centers(region)[-1]
    for missing, step in product(MISSING, STEPS):
        for fraction in (0.0, 0.5):
            rings, size, left = list[Array](), radius, n
            while left and size > 0:
                count = min(left, max(1, _most_around(size, spacing) - missing))
                turned = _turns(np.array([fraction * len(rings) * 2 * np.pi / count]))[0]
                rings.append(regular_polygon(count, size) @ turned)
                size, left = size - step * spacing, left - count
            if not left:
                yield center + np.concatenate(rings)


def _most_around(radius: float, spacing: float) -> int:
    """Number of dots that fit around a circle."""
    half = spacing / 2 / radius
    return int(np.pi / np.arcsin(half) + 1e-9) if half < 1 else 1


def _lattices(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """The n outermost sites of hexagonal and square lattices with different pitches, shifts and rotations."""
    boundary = region.boundary
    most = np.sqrt(2 * boundary.area / n)
    pitches = np.geomspace(most, max(region.spacing, most / 4), 4 * PITCHES)[:, None, None]
    reach = int(np.ceil(np.sqrt(8 * n))) + 2
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    for sites in (np.stack([i + j / 2, j * np.sqrt(0.75)], axis=-1), np.stack([i, j], axis=-1)):
        for origin in (np.zeros(2), np.array([0.5, 0.0]), (sites[i + j == 1][:1] + [[1.0, 0.0]])[0] / 3):
            for rotation in _turns(TURNS):
                placed = boundary.center + (sites + origin) @ rotation * pitches
                held = boundary.depth(placed.reshape(-1, 2)).reshape(placed.shape[:2]) >= region.inset
                for k in np.flatnonzero(held.sum(axis=1) >= n)[:PITCHES]:
                    inside = placed[k, held[k]]
                    yield inside[np.argsort(-np.linalg.norm(inside - inside.mean(axis=0), axis=-1))[:n]]


def _turns(angles: Array) -> Array:
    """Matrices (..., 2, 2) that turn rows of points."""
    return np.stack([turn_z(angle)[:2, :2].T for angle in angles])


def _largest(region: FeasibleRegion, unit: Array, center: Array) -> Array:
    """Largest feasible polygons (B, n, 2) with corners in directions (B, n, 2) from a center."""
    boundary = region.boundary
    if len(region.walls) == 1:
        return unit * (boundary.radius - region.inset)

    def fits(size: Array) -> NDArray[np.bool_]:
        corners = center + unit * size[..., None, None]
        return np.all(boundary.depth(corners) >= region.inset, axis=-1)

    # In an annulus a large polygon may fit where a smaller one does not.
    sizes = 2 * boundary.radius * np.arange(SIZES) / SIZES
    fitting = fits(np.broadcast_to(sizes[:, None], (SIZES, len(unit))))
    low = sizes[SIZES - 1 - np.argmax(fitting[::-1], axis=0)] * fitting.any(axis=0)
    high = low + sizes[1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = fits(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.asarray(center + unit * low[:, None, None])


def _centers(region: FeasibleRegion) -> Array:
    """Centers (1 or 2, 2) in m: that of the marker, and that of the largest circle in the region."""
    if len(region.walls) == 1:
        return np.zeros((1, 2))
    # A point is inside if an odd number of outlines enclose it.
    inside = geometry.Region.odd(region.boundary.outlines())
    return np.stack([np.zeros(2), inside.largest_circle(1e-4 * region.boundary.radius)])
