"""What lies inside a boundary of any shape: the part with some depth, and points all over it."""

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.inset import Inset
from markergen.model.outlines import signed_area

if TYPE_CHECKING:
    from markergen.model.boundary import Boundary

Array = NDArray[np.float64]

SLACK = 1e-12
"""Rounding that is forgiven, as a share of the boundary's size."""

ROUNDS = 100
"""Of drawing all over the boundary and keeping what is deep enough."""


@lru_cache(maxsize=64)
def inset_of(boundary: "Boundary", inset: float) -> Inset:
    """Part of a boundary with a depth of at least `inset` m; what is deepest where nothing is so deep."""
    found = Inset(*boundary.curves(), boundary.depth, inset, SLACK * boundary.radius)
    return inset_of(boundary, _deepest(boundary)) if found.empty else found


def scatter(boundary: "Boundary", count: int, inset: float, rng: "np.random.Generator") -> Array:
    """Draw (count, 2) points uniformly from the part with a depth of at least `inset` m."""
    corners, share = _triangles(boundary)
    found = np.zeros((0, 2))
    for _ in range(ROUNDS):
        if len(found) >= count:
            return found[:count]
        a, b, c = np.moveaxis(corners[np.searchsorted(share[:-1], rng.random(count))], 1, 0)
        u, v = rng.random((2, count, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        points = a + u * (b - a) + v * (c - a)
        found = np.concatenate([found, points[boundary.depth(points) >= inset]])
    # That part is less than a hundredth of the whole, or nothing.
    return np.concatenate([found, boundary.project(points, inset)])[:count]


def shape_of(outlines: Sequence[Array]) -> Any:
    """Closed polygons (m, 2), outer ones counterclockwise and holes clockwise, as one shapely geometry."""
    import shapely

    areas = np.array([signed_area(ring) for ring in outlines])
    shape = shapely.Polygon()
    # From the outside in: what a hole takes away, an island in it gives back.
    for i in np.argsort(-np.abs(areas), kind="stable"):
        change = shapely.union if areas[i] > 0 else shapely.difference
        shape = change(shape, shapely.Polygon(outlines[i]))
    return shape


def _deepest(boundary: "Boundary") -> float:
    """Largest depth in m of any point, short of it by a billionth of the size."""
    # By halving: Inset is exact, which GEOS's buffers are not in corners made of many short edges.
    low, high = 0.0, boundary.radius
    while high - low > 1e-9 * boundary.radius:
        middle = (low + high) / 2
        empty = Inset(*boundary.curves(), boundary.depth, middle, SLACK * boundary.radius).empty
        low, high = (low, middle) if empty else (middle, high)
    return low


def regions_of(outlines: Sequence[Array]) -> list[tuple[Array, ...]]:
    """The separate regions that outlines enclose, each an outer closed polygon (m, 2) and then its holes."""
    import shapely

    parts = shapely.get_parts(shapely.orient_polygons(shape_of(outlines)))
    return [tuple(shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(part)) for part in parts]


def grown(outlines: Sequence[Array], margin: float) -> tuple[Array, ...]:
    """Outlines of the region with `margin` m around it, round at corners; what closes up is gone."""
    import shapely

    shape = shapely.buffer(shape_of(outlines), margin, quad_segs=64) if margin else shape_of(outlines)
    rings = shapely.get_rings(shapely.get_parts(shape))
    return tuple(shapely.get_coordinates(ring)[:-1] for ring in rings)


@lru_cache(maxsize=64)
def _triangles(boundary: "Boundary") -> tuple[Array, Array]:
    """Triangles (t, 3, 2) that make up a boundary, circles taken for polygons, and running shares (t,) of the area."""
    import shapely

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shape_of(boundary.outlines())))
    area = shapely.area(parts)
    return shapely.get_coordinates(shapely.get_exterior_ring(parts)).reshape(-1, 4, 2)[:, :3], np.cumsum(
        area / area.sum()
    )
