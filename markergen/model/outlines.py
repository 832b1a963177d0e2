"""Closed outlines in the plane: which is inside which, whether they cross, and the circle that holds them all."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.units import format_length

Array = NDArray[np.float64]
Ring = tuple[tuple[float, float], ...]

MOST_CORNERS = 10_000
"""Of all outlines together; 5 um is kept with a few hundred for any marker on a table."""

MOST_PAIRS = 50_000
"""Of outlines that touch or lie in each other: a plate with all the holes that there may be has 3,333."""


def canonical(outlines: Sequence[Sequence[Sequence[float]] | Array]) -> tuple[Ring, ...]:
    """Outlines in m without repeated corners, outer ones counterclockwise and holes clockwise.

    An outline within an even number of others is an outer one, within an odd number a hole; how it was drawn does not
    matter. They keep their order and their first corners.

    Raises
    ------
    InputError
        If there is none, a coordinate is not finite, there are too many corners, an outline has no area or crosses or
        touches itself, or two of them cross or share a piece of line; the message tells where.
    """
    if not len(outlines):
        raise InputError("at least one outline", "none", "give a closed outline of three corners or more")
    rings = [_corners(outline, f"outline {i + 1}") for i, outline in enumerate(outlines)]
    total = sum(map(len, rings))
    if total > MOST_CORNERS:
        raise InputError(
            f"outlines of at most {MOST_CORNERS} corners", f"{total}", "simplify the outline, or flatten it less finely"
        )
    inside = _nesting(rings)
    turned = [
        ring if (signed_area(ring) > 0) == (depth % 2 == 0) else np.concatenate([ring[:1], ring[:0:-1]])
        for ring, depth in zip(rings, inside, strict=True)
    ]
    return tuple(tuple((float(x), float(y)) for x, y in ring) for ring in turned)


def signed_area(ring: Array) -> float:
    """Area of a closed polygon (m, 2), positive if counterclockwise."""
    # About its own corner, so that a small outline far out keeps its digits.
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def walked(ring: Array, step: float) -> tuple[Array, NDArray[np.bool_]]:
    """Points (m, 2) at most `step` apart along a closed polygon, all its corners among them, and which (m,) those are.

    From the first corner on; without the first point again at the end.
    """
    onward = np.roll(ring, -1, axis=0) - ring
    counts = np.maximum(np.ceil(np.hypot(*onward.T) / step), 1).astype(int)
    edge = np.repeat(np.arange(len(ring)), counts)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    return ring[edge] + (number / counts[edge])[:, None] * onward[edge], number == 0


def enclosing_circle(outlines: Sequence[Array]) -> tuple[Array, float]:
    """Center (2,) and radius in m of the smallest circle around outlines."""
    import shapely

    points = shapely.MultiPoint(np.concatenate(outlines))
    center = shapely.get_coordinates(shapely.minimum_bounding_circle(points).centroid)[0]
    return center, float(shapely.minimum_bounding_radius(points))


def place(point: Array) -> str:
    """Coordinates (2,) in m for messages."""
    return f"({format_length(float(point[0]))}, {format_length(float(point[1]))})"


def _corners(outline: Sequence[Sequence[float]] | Array, name: str) -> Array:
    ring = np.asarray(outline, dtype=float)
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise InputError(f"pairs x, y for {name}", f"an array of shape {ring.shape}", "give [[x, y], ...] in m")
    if not np.isfinite(ring).all():
        raise InputError(f"finite coordinates in {name}", "nan or infinity", "correct the outline")
    # The first of equal corners stays.
    fresh = np.append(True, np.any(ring[1:] != ring[:-1], axis=1))
    fresh[np.all(ring == ring[0], axis=1) & (np.cumsum(fresh) == fresh.sum())] = len(ring) == 1
    ring = ring[fresh]
    # Not the signed area, which a figure eight has none of either: that is told as what it is.
    spread = np.linalg.svd(ring - ring.mean(axis=0), compute_uv=False) if len(ring) > 2 else np.zeros(2)
    if spread[1] <= 1e-9 * spread[0]:
        raise InputError(f"an area in {name}", f"{len(ring)} corners on a line", "give a closed outline with an inside")
    return ring


def _nesting(rings: list[Array]) -> list[int]:
    """In how many others each outline lies; refuses those that cross."""
    import shapely

    # An array of objects, even of one outline alone.
    shapes = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    for i in np.flatnonzero(~shapely.is_valid(shapes)):
        # GEOS says, for example, Self-intersection[0.1 0.2].
        where = np.array(shapely.is_valid_reason(shapes[i]).split("[")[1].rstrip("]").split()[:2], dtype=float)
        raise InputError(
            "outlines that do not cross or touch themselves",
            f"outline {i + 1} doing so at {place(where)}",
            "correct it there, or draw the parts as outlines of their own",
        )
    first, second = _pairs(shapes)
    # Two that touch at a corner are fine.
    shared = shapely.intersection(shapely.boundary(shapes[first]), shapely.boundary(shapes[second]))
    bad = ~shapely.is_empty(shared) & (
        (shapely.get_dimensions(shared) > 0) | shapely.overlaps(shapes[first], shapes[second])
    )
    for k in np.flatnonzero(bad)[:1]:
        raise InputError(
            "outlines that do not cross each other",
            f"outlines {first[k] + 1} and {second[k] + 1} crossing or sharing a line at"
            f" {place(shapely.get_coordinates(shared[k])[0])}",
            "join them to one outline, or move them apart",
        )
    within = shapely.contains(shapes[first], shapes[second]), shapely.contains(shapes[second], shapes[first])
    inner = np.concatenate([second[within[0]], first[within[1]]])
    return np.bincount(inner, minlength=len(rings)).tolist()


def _pairs(shapes: NDArray[np.object_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (k,) of shapes that have points in common, the smaller number first."""
    import shapely

    tree = shapely.STRtree(shapes)
    pairs, count = [np.zeros((2, 0), dtype=np.intp)], 0
    # By parts, because a thousand outlines in each other are half a million pairs.
    for start in range(0, len(shapes), 50):
        found = tree.query(shapes[start : start + 50], predicate="intersects") + np.array([[start], [0]])
        found = found[:, found[0] < found[1]]
        count += found.shape[1]
        if count > MOST_PAIRS:
            raise InputError(
                f"outlines of which at most {MOST_PAIRS} pairs touch or lie in each other", "more", "use fewer outlines"
            )
        pairs.append(found)
    first, second = np.concatenate(pairs, axis=1)
    return first, second
