"""The plate: the boundary, with an edge around a disk or a rectangle, or an outline of its own; corners and holes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.figure import size_words
from markergen.errors import InputError
from markergen.geometry import region as geometry
from markergen.geometry.contour import box, placed, turns_of
from markergen.geometry.fillet import filleted, largest_fillet
from markergen.model.boundary import Circle
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.model.substrate_checks import disk_radius
from markergen.solid.bodies import (
    Body,
    Part,
    Path,
    Prism,
    Revolved,
    area,
    circle,
    cylinder,
    inset,
    mm,
    polygon_of,
)
from markergen.units import format_length

Array = NDArray[np.float64]
Region = tuple[Path, ...]
"""Outer path and the paths of its holes."""

TANGENT = 5e-7
"""mm by which cones and planes of a chamfer may miss each other where an arc does not go on quite smoothly."""

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
    dot diameter wide). Around a rectangle the edge has mitered corners. Any other boundary is the plate, and so is an
    outline of the plate's own; arcs stay arcs.
    """
    substrate = marker.substrate
    if substrate.outline is None and isinstance(marker.boundary, Circle):
        x, y = marker.boundary.center
        regions: list[Region] = [(circle(plate_radius(marker), mm(x), mm(y)),)]
    else:
        contours = [placed(contour, 1e3, digits=9) for contour in (substrate.outline or marker.boundary).contours()]
        if edge := mm(substrate.edge_around(marker.boundary)):
            contours = [placed(inset(contour, -edge), 1.0, digits=9) for contour in contours]
        corner = mm(substrate.corner_radius)
        regions = [tuple(_rounded(path, corner) for path in region) for region in _regions(contours)]
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
    regions = plate_regions(marker)
    if len(regions) == 1 and (whole := regions[0][0].as_circle):
        return f"{2 * whole[2]:.6g} mm across"
    boxes = np.array([box(outer) for outer, *_ in regions])
    width, height = boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0)
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


def _regions(contours: Sequence[Path]) -> list[Region]:
    """Separate regions that contours enclose: each an outer one and then its holes."""
    import shapely

    if not any(contour.has_arcs for contour in contours):
        found = geometry.Region.enclosed([np.array(contour.points) for contour in contours]).oriented().pieces
        return [tuple(Path(tuple((x, y) for x, y in np.round(r, 9).tolist())) for r in each.rings) for each in found]
    shapes = [polygon_of(contour) for contour in contours]
    regions: dict[int, list[Path]] = {k: [contour] for k, contour in enumerate(contours) if area(contour) > 0}
    for contour, shape in zip(contours, shapes, strict=True):
        if area(contour) < 0:
            # The smallest one around it: an island in a hole may have holes of its own.
            inside = shapely.Point(shape.representative_point())
            around = [k for k in regions if shapely.contains(shapes[k], inside) and shapes[k].area > shape.area]
            regions[min(around, key=lambda k: shapes[k].area)].append(contour)
    return [tuple(region) for region in regions.values()]


def _rounded(path: Path, radius: float) -> Path:
    """Path with its corners rounded, those that point inward as well: a mill leaves them round."""
    if not radius:
        return path
    found = filleted(path, radius, SMOOTH)
    if found is None:
        room = largest_fillet(path, SMOOTH, radius)
        raise InputError(
            f"a corner radius of at most {room:.4g} mm for this outline",
            f"corner_radius={format_length(radius / 1e3)}",
            f"use --corner-radius {np.floor(room * 100 + 1e-6) / 100:g}mm, or another outline",
        )
    return found


def _check_chamfer(outer: Path, chamfer: float) -> None:
    """Refuse a chamfer at which a side of the outline is used up."""
    if not chamfer:
        return
    sides = outer.sides
    sharp = [abs(turn) for k, turn in enumerate(turns_of(outer)) if sides[k - 1][2] or sides[k][2]]
    if max(sharp, default=0.0) * chamfer > TANGENT:
        raise InputError(
            "arcs that go on smoothly at both ends, for a chamfer",
            f"an outline that turns by {np.degrees(max(sharp)):.3g} degrees where an arc ends",
            "use a --corner-radius, or leave out --chamfer",
        )
    steps, moved = (_steps(path) for path in (outer, inset(outer, chamfer)))
    before = np.hypot(*steps.T)
    # How much shorter each side becomes; one that turns around has a negative length.
    lost = before - np.sum(steps * moved, axis=-1) / before
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
