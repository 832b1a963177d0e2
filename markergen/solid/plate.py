"""The plate: the boundary with an edge around it, or an outline of its own; its corners, its chamfer and its holes."""

from collections.abc import Sequence
from dataclasses import replace
from math import tan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.figure import size_words
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.interior import regions_of, shape_of
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.model.substrate_checks import disk_radius
from markergen.solid.bodies import (
    Body,
    Part,
    Path,
    Point,
    Prism,
    Revolved,
    circle,
    cylinder,
    flattened,
    inset,
    mm,
    polygon_of,
)
from markergen.units import format_length

Array = NDArray[np.float64]
Region = tuple[Path, ...]
"""Outer path and the paths of its holes."""

SPIKE = 5.0
"""Longest corner of an outline with an edge around it, as a multiple of the edge; sharper ones are cut off."""

SMOOTH = 0.35
"""Angle in rad: an outline that turns by less in a corner stands for a curve, and has no corner to round."""


def plate_parts(marker: Marker, face: float = 0.0) -> list[Part]:
    """Plates with their mounting holes, one for each region of the outline.

    Parameters
    ----------
    face : float
        Height of their upper face in mm.

    Raises
    ------
    InputError
        If the corner radius or the chamfer does not fit the outline.
    """
    regions = plate_regions(marker)
    top, bottom = face, mm(face / 1e3 - marker.substrate.thickness)
    chamfer = mm(marker.substrate.chamfer)
    names = ["plate"] if len(regions) == 1 else [f"plate-{number}" for number in range(1, len(regions) + 1)]
    parts = [
        Part(name, "light", (Prism(outer, tuple(holes), bottom, top, chamfer),))
        for name, (outer, *holes) in zip(names, regions, strict=True)
    ]
    return with_cuts(parts, cut=[_hole(hole, bottom, top) for hole in marker.substrate.holes])


def plate_regions(marker: Marker) -> list[Region]:
    """Outlines of the plates in mm, with rounded corners: outer paths counterclockwise, holes clockwise.

    The plate of a disk is a disk that holds the boundary with its edge and every dot's quiet zone (a white ring half a
    dot diameter wide). Around any other boundary the edge has mitered corners.
    """
    substrate = marker.substrate
    if substrate.outline is None and isinstance(marker.boundary, Circle):
        x, y = marker.boundary.center
        regions: list[Region] = [(circle(plate_radius(marker), mm(x), mm(y)),)]
    else:
        rings, circles = (substrate.outline or marker.boundary).curves()
        edge = 0.0 if substrate.outline else mm(substrate.edge)
        regions = [
            tuple(_rounded(ring, mm(substrate.corner_radius)) for ring in region) for region in _widened(rings, edge)
        ]
        regions += [(circle(mm(radius) + edge, mm(x), mm(y)),) for x, y, radius, _ in circles.tolist()]
    for outer, *_ in regions:
        _check_chamfer(outer, mm(substrate.chamfer))
    return regions


def plate_radius(marker: Marker) -> float:
    """Radius of a disk's plate in mm: the boundary and an edge, or what the quiet zones need if that is more."""
    dots = [(p.x, p.y, p.feature.diameter / 2) for p in marker.control_points]
    return mm(disk_radius(marker.substrate, marker.boundary, dots))


def plate_size(marker: Marker) -> str:
    """Size of the plate: ``304 mm across`` for a disk, else width and height as in ``200 x 100 mm``."""
    if marker.substrate.outline is not None:
        return size_words(marker.substrate.outline)
    if isinstance(marker.boundary, Circle):
        return f"{2 * plate_radius(marker):.6g} mm across"
    corners = np.array([corner for outer, *_ in plate_regions(marker) for corner in flattened(outer)])
    width, height = np.ptp(corners, axis=0)
    return f"{width:.6g} x {height:.6g} mm"


def face_of(regions: Sequence[Region], chamfer: float = 0.0) -> Any:
    """Upper face of the plates without what is cut from it: a shapely geometry in mm."""
    import shapely

    return shapely.union_all([polygon_of(inset(outer, chamfer), holes) for outer, *holes in regions])


def with_cuts(
    parts: Sequence[Part], cut: Sequence[Body] = (), marked: Sequence[Body] = (), add: Sequence[Body] = ()
) -> list[Part]:
    """Plates from which bodies are cut, or to which they are joined, each one where the plate is that it lies in."""
    import shapely

    plans = []
    for part in parts:
        (plate,) = [body for body in part.add[:1] if isinstance(body, Prism)]
        plans.append(polygon_of(plate.outer, plate.holes))

    def lies_in(body: Body) -> int:
        x, y = (body.x, body.y) if isinstance(body, Revolved) else body.outer.points[0]
        # The nearest plate rather than the one around it: a recess may be as large as its plate.
        return min(range(len(plans)), key=lambda k: shapely.distance(plans[k], shapely.Point(x, y)))

    def with_own(k: int, own: Sequence[Body], bodies: Sequence[Body]) -> tuple[Body, ...]:
        return (*own, *(body for body in bodies if lies_in(body) == k))

    return [
        replace(
            part,
            add=with_own(k, part.add, add),
            cut=with_own(k, part.cut, cut),
            marked=with_own(k, part.marked, marked),
        )
        for k, part in enumerate(parts)
    ]


def _hole(hole: Hole, bottom: float, top: float) -> Revolved:
    x, y, radius, sink = mm(hole.x), mm(hole.y), mm(hole.diameter) / 2, mm(hole.sink) / 2
    if sink <= radius:
        return cylinder(x, y, radius, bottom, top)
    # A head of 90 degrees: as deep as it is wider than the hole.
    low = top - (sink - radius)
    return Revolved(x, y, Path(((0.0, bottom), (radius, bottom), (radius, low), (sink, top), (0.0, top))))


def _widened(rings: Sequence[Array], edge: float) -> list[list[list[Point]]]:
    """Regions of closed polygons in m with an edge in mm around them, in mm: outer ones and then their holes."""
    import shapely

    if not rings:
        return []
    scaled = [np.round(ring * 1e3, 9) for ring in rings]
    if edge:
        scaled = _mitered(scaled, edge) or [
            shapely.get_coordinates(ring)[:-1]
            for ring in shapely.get_rings(
                shapely.get_parts(
                    shapely.orient_polygons(
                        shapely.buffer(shape_of(scaled), edge, join_style="mitre", mitre_limit=SPIKE)
                    )
                )
            )
        ]
    return [[[(x, y) for x, y in np.round(ring, 9).tolist()] for ring in region] for region in regions_of(scaled)]


def _mitered(rings: Sequence[Array], edge: float) -> list[Array] | None:
    """Polygons moved outward, or None where that is more than to move their sides: some vanish, meet, or are spikes."""
    import shapely

    moved = [np.array(inset(Path(tuple(map(tuple, ring.tolist()))), -edge).points) for ring in rings]
    for before, after in zip(rings, moved, strict=True):
        old, new = (np.roll(ring, -1, axis=0) - ring for ring in (before, after))
        if (np.sum(old * new, axis=-1) <= 0).any() or (np.hypot(*(after - before).T) > SPIKE * edge).any():
            return None
    lines = [shapely.LinearRing(ring) for ring in moved]
    crossing = any(one.intersects(other) for k, one in enumerate(lines) for other in lines[:k])
    return None if crossing or not all(line.is_simple for line in lines) else moved


def _rounded(corners: Sequence[Point], radius: float) -> Path:
    """Closed polygon with its corners rounded, those that point inward as well: a mill leaves them round."""
    if not radius:
        return Path(tuple(corners))
    count = len(corners)
    sides = [np.subtract(corners[(k + 1) % count], corners[k]) for k in range(count)]
    lengths = [float(np.hypot(*side)) for side in sides]
    turns = [_turn(sides[k - 1], sides[k]) for k in range(count)]
    cuts = [tan(abs(turn) / 2) if abs(turn) > SMOOTH else 0.0 for turn in turns]
    room = min(
        (lengths[k] / (cuts[k] + cuts[(k + 1) % count]) for k in range(count) if cuts[k] + cuts[(k + 1) % count]),
        default=radius,
    )
    if radius > room * (1 + 1e-12):
        raise InputError(
            f"a corner radius of at most {room:.4g} mm for this outline",
            f"corner_radius={format_length(radius / 1e3)}",
            f"use --corner-radius {np.floor(room * 100) / 100:g}mm, or another outline",
        )
    points: list[Point] = []
    bulges: list[float] = []
    for k, (corner, turn, cut) in enumerate(zip(corners, turns, cuts, strict=True)):
        if not cut:
            points.append(corner)
            bulges.append(0.0)
            continue
        for side, length, sign in ((sides[k - 1], lengths[k - 1], -1), (sides[k], lengths[k], 1)):
            x, y = np.add(corner, sign * radius * cut / length * side).tolist()
            points.append((x, y))
        bulges += [tan(turn / 4), 0.0]
    return _without_dust(points, bulges)


def _without_dust(points: Sequence[Point], bulges: Sequence[float]) -> Path:
    """Path without sides of no length, where two arcs meet."""
    count = len(points)
    kept = [k for k in range(count) if bulges[k] or np.hypot(*np.subtract(points[(k + 1) % count], points[k])) > 1e-9]
    return Path(tuple(points[k] for k in kept), tuple(bulges[k] for k in kept))


def _turn(before: Array, after: Array) -> float:
    return float(np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after))


def _check_chamfer(outer: Path, chamfer: float) -> None:
    """Refuse a chamfer at which a side of the outline is used up."""
    if not chamfer:
        return
    sides, moved = (_steps(path) for path in (outer, inset(outer, chamfer)))
    before = np.hypot(*sides.T)
    # How much shorter each side becomes; one that turns around has a negative length.
    lost = before - np.sum(sides * moved, axis=-1) / before
    room = float(np.min(chamfer * before[lost > 0] / lost[lost > 0], initial=np.inf))
    if chamfer >= room:
        raise InputError(
            f"a chamfer below {room:.4g} mm for this outline",
            f"chamfer={format_length(chamfer / 1e3)}",
            f"use --chamfer {np.floor(room * 99) / 100:g}mm, or a corner radius above the chamfer",
        )


def _steps(path: Path) -> Array:
    corners = np.array(path.points)
    return np.roll(corners, -1, axis=0) - corners
