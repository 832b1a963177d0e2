"""Cleaning of closed outlines: no repeated corners, consistent nesting and orientation, no crossings.

Lengths are in m.
"""
# tests: tests/read/outlines/test_curves.py

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, box, inner_polygon, reversed_contour
from markergen.geometry.region import shapely, signed_area
from markergen.units import format_length

Ring = tuple[tuple[float, float], ...]

MOST_CORNERS = 10_000
"""Maximum number of corners of all outlines together; a few hundred keep any tabletop marker within 5 um."""

TOLERANCE = 4.5e-6
"""Maximum distance in m between an arc and its polygon; the rest of 5 um is for joining the ends of drawings."""

SHALLOWEST = 1e-6
"""Minimum bulge of an arc; anything less is a straight line."""

FARTHEST = 1e9
"""Maximum coordinate in m of an arc's ends, whose squares still have sufficient digits."""

NARROWEST = 1e-9
"""Minimum distance in m of a corner from the sides that do not end in it: tools stop at 1e-6, and at 1e-12 doubles of a
plate no longer tell on which side of a spike a point is."""

MOST_PAIRS = 50_000
"""Maximum number of pairs of touching or nested outlines; a plate with as many holes as allowed has 3,333."""


def canonical_polygons(outlines: Sequence[Sequence[Sequence[float]] | Array]) -> tuple[Ring, ...]:
    """Outlines in m without repeated corners, outer ones counterclockwise and holes clockwise.

    An outline inside an even number of others is an outer one, inside an odd number a hole, regardless of its original
    orientation. Their order and first corners are kept.

    Raises
    ------
    InputError
        If there is none, a coordinate is not finite, there are too many corners, an outline has no area or crosses or
        touches itself, or two of them cross or share part of a line; the message says where.
    """
    if not len(outlines):
        raise InputError("at least one outline", "none", "give a closed outline of three corners or more")
    rings = [_corners(outline, f"outline {i + 1}") for i, outline in enumerate(outlines)]
    _check_corners(sum(map(len, rings)))
    inside = _nesting(rings)
    directed = [
        ring if (signed_area(ring) > 0) == (depth % 2 == 0) else np.concatenate([ring[:1], ring[:0:-1]])
        for ring, depth in zip(rings, inside, strict=True)
    ]
    return tuple(tuple((float(x), float(y)) for x, y in ring) for ring in directed)


def canonical_contours(
    outlines: Sequence[Sequence[Sequence[float]] | Array], bulges: Sequence[Sequence[float]] = ()
) -> tuple[Contour, ...]:
    """Contours from corners in m and the bulges of their sides, oriented as in `canonical_polygons`.

    Parameters
    ----------
    bulges : sequence of sequence of float
        For each outline the bulges of its sides, or none if all are straight; empty if there are no arcs.

    Raises
    ------
    InputError
        As for `canonical_polygons`, with polygons for arcs (see `polygons_of`); or if the bulges are not one for each
        corner, not finite, above 1, or below `SHALLOWEST` and not 0.
    """
    if not any(map(any, bulges)):
        return tuple(map(Contour, canonical_polygons(outlines)))
    if len(bulges) != len(outlines):
        raise InputError("bulges for each outline", f"{len(bulges)} for {len(outlines)}", "give 0 for straight sides")
    every = enumerate(zip(outlines, bulges, strict=True), 1)
    clean = [_contour(outline, row, f"outline {i}") for i, (outline, row) in every]
    clean = [contour if area(contour) > 0 else reversed_contour(contour) for contour in clean]
    outer = [signed_area(np.array(ring)) > 0 for ring in canonical_polygons(polygons_of(clean))]
    contours = tuple(c if is_outer else reversed_contour(c) for c, is_outer in zip(clean, outer, strict=True))
    # Reversed to holes they have other polygons.
    canonical_polygons(polygons_of(contours))
    return contours


def polygon(ring: Array) -> Contour:
    """Contour of straight lines through corners (m, 2)."""
    return Contour(tuple((x, y) for x, y in ring.tolist()))


def polygons_of(contours: Sequence[Contour]) -> tuple[Array, ...]:
    """Polygons (m, 2) in m of contours with the region to their left, within `TOLERANCE`, or 1e-4 of their size.

    They lie on the inner side of arcs, in whole picometers, so the depth of a point in a polygon is never more than in
    the contour. Without arcs they are the corners.
    """
    if not any(contour.has_arcs for contour in contours):
        return tuple(np.array(contour.points) for contour in contours)
    boxes = np.array([box(contour) for contour in contours])
    size = float(np.hypot(*(boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0))))
    off, total = min(TOLERANCE, 1e-4 * size), 0
    polygons = []
    for contour in contours:
        polygons.append(np.round(inner_polygon(contour, off), 12) + 0.0)
        total += len(polygons[-1])
        _check_corners(total)
    return tuple(polygons)


def walked(ring: Array, step: float) -> tuple[Array, NDArray[np.bool_]]:
    """Points (m, 2) at most `step` apart along a closed polygon, including all corners, and a mask (m,) of the corners.

    Starts at the first corner; the first point is not repeated at the end.
    """
    onward = np.roll(ring, -1, axis=0) - ring
    counts = np.maximum(np.ceil(np.hypot(*onward.T) / step), 1).astype(int)
    edge = np.repeat(np.arange(len(ring)), counts)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    return ring[edge] + (number / counts[edge])[:, None] * onward[edge], number == 0


def place(point: Array) -> str:
    """Format coordinates (2,) in m for messages."""
    return f"({format_length(float(point[0]))}, {format_length(float(point[1]))})"


def _check_corners(total: int) -> None:
    if total > MOST_CORNERS:
        raise InputError(
            f"outlines of at most {MOST_CORNERS} corners", f"{total}", "simplify the outline, or flatten it less finely"
        )


def _corners(outline: Sequence[Sequence[float]] | Array, name: str) -> Array:
    ring = np.asarray(outline, dtype=float)
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise InputError(f"pairs x, y for {name}", f"an array of shape {ring.shape}", "give [[x, y], ...] in m")
    if not np.isfinite(ring).all():
        raise InputError(f"finite coordinates in {name}", "nan or infinity", "correct the outline")
    # Of equal corners, keep the first.
    fresh = np.append(True, np.any(ring[1:] != ring[:-1], axis=1))
    fresh[np.all(ring == ring[0], axis=1) & (np.cumsum(fresh) == fresh.sum())] = len(ring) == 1
    ring = ring[fresh]
    # Not the signed area, which also vanishes for a figure eight; that is reported as a crossing.
    spread = np.linalg.svd(ring - ring.mean(axis=0), compute_uv=False) if len(ring) > 2 else np.zeros(2)
    if spread[1] <= 1e-9 * spread[0]:
        raise InputError(f"an area in {name}", f"{len(ring)} corners on a line", "give a closed outline with an inside")
    return ring


def _contour(outline: Sequence[Sequence[float]] | Array, row: Sequence[float], name: str) -> Contour:
    """Contour of valid numbers, without sides of zero length."""
    points, bulges = np.asarray(outline, dtype=float), np.asarray(row or [0.0] * len(outline), dtype=float)
    if points.shape != (len(bulges), 2) or not len(bulges):
        raise InputError(
            f"pairs x, y for {name}, and a bulge for each",
            f"arrays of shape {points.shape} and {bulges.shape}",
            "give 0 for a straight side",
        )
    size = np.abs(bulges)
    if not (np.isfinite(points).all() and np.isfinite(bulges).all()):
        raise InputError(f"finite numbers in {name}", "nan or infinity", "correct the outline")
    if np.max(np.abs(points)) > FARTHEST:
        raise InputError(f"arcs within {FARTHEST:g} m in {name}", f"{np.max(np.abs(points)):.3g} m", "check the unit")
    odd = (size > 1) | ((size > 0) & (size < SHALLOWEST))
    if odd.any():
        raise InputError(
            f"bulges of {SHALLOWEST:g} to 1 to either side in {name}, or 0",
            f"{bulges[odd][0]:.6g}",
            "draw an arc of more than half a turn as two, and a shallower one as a line",
        )
    # Of equal corners, keep the first, with the side that leaves the last.
    kept = np.any(points != np.roll(points, -1, axis=0), axis=1)
    corners = np.count_nonzero(kept)
    if corners < 2 or (corners == 2 and not bulges[kept].any()):
        raise InputError(f"an area in {name}", f"{corners} corners on a line", "give a closed outline with an inside")
    return Contour(tuple((x, y) for x, y in points[kept].tolist()), tuple(bulges[kept].tolist()))


def _nesting(rings: list[Array]) -> list[int]:
    """Number of other outlines that contain each outline; rejects outlines that cross."""
    # An array of objects, even for a single outline.
    shapes = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    for i in np.flatnonzero(~shapely.is_valid(shapes)):
        # GEOS returns text such as Self-intersection[0.1 0.2].
        where = np.array(shapely.is_valid_reason(shapes[i]).split("[")[1].rstrip("]").split()[:2], dtype=float)
        raise InputError(
            "outlines that do not cross or touch themselves",
            f"outline {i + 1} crossing or touching itself at {place(where)}",
            "correct it there, or draw the parts as separate outlines",
        )
    for number, ring in enumerate(rings, start=1):
        if (corner := _in_doubt(ring)) is not None:
            raise InputError(
                "outlines that do not cross or touch themselves",
                f"outline {number} less than {1e9 * NARROWEST:g} nm from itself at {place(corner)}, as in a spike",
                "correct it there, or draw the parts as separate outlines",
            )
    first, second = _pairs(shapes)
    # Outlines may touch at a corner.
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


def _in_doubt(ring: Array) -> Array | None:
    """Return a corner (2,) that lies on another side but for rounding, so that there is no inside to agree on."""
    # Corners that are this near each other are one.
    apart = ring[np.hypot(*(ring - np.roll(ring, 1, axis=0)).T) > NARROWEST]
    if len(apart) < 3 or shapely.minimum_clearance(shapely.polygons(apart)) > NARROWEST:
        return None
    sides = shapely.linestrings(np.stack([apart, np.roll(apart, -1, axis=0)], axis=1))
    for k, corner in enumerate(shapely.points(apart)):
        others = np.delete(sides, [k - 1, k])
        if shapely.distance(others, corner).min(initial=np.inf) <= NARROWEST:
            return np.asarray(apart[k])
    return None


def _pairs(shapes: NDArray[np.object_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (k,) of shapes with points in common, the smaller index first."""
    tree = shapely.STRtree(shapes)
    pairs, count = [np.zeros((2, 0), dtype=np.intp)], 0
    # In parts, because a thousand nested outlines form half a million pairs.
    for start in range(0, len(shapes), 50):
        pair = tree.query(shapes[start : start + 50], predicate="intersects") + np.array([[start], [0]])
        pair = pair[:, pair[0] < pair[1]]
        count += pair.shape[1]
        if count > MOST_PAIRS:
            raise InputError(
                f"outlines of which at most {MOST_PAIRS} pairs touch or lie in each other", "more", "use fewer outlines"
            )
        pairs.append(pair)
    first, second = np.concatenate(pairs, axis=1)
    return first, second
