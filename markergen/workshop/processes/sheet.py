"""``print``: a plate with a shallow recess for the printed sheet, which is cut out along the boundary."""
# tests: tests/contracts/test_processes.py

from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.errors import InputError
from markergen.geometry.contour import Contour, circle
from markergen.geometry.outlines import polygon
from markergen.geometry.region import Region
from markergen.model.boundary import Circle
from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.solid.plate import Footprint, SolidPlate, gaps, plate_of
from markergen.solid.primitives import OFF, Primitive, Prism, cylinder
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.manufacturability import FLATTENING, ROUNDING, Tool, depth_of, found_room, gap_of, tool_of, up
from markergen.workshop.processes import Accuracy, Cutting, Made, prepare

DEPTH = 0.2
"""Depth of the recess in mm: paper or film of 0.1 mm, and glue."""

GAP = 0.2
"""Clearance around the sheet in mm: the accuracy of cutting by knife."""

KNIFE, WALL = 0.1, 0.5
"""Width of a cut, and minimum width of the plate's rim around the recess, mm."""

LAND = 1.0
"""Width in mm of the land that remains around a hole in the recess."""


def sheet(marker: Marker, fabrication: Fabrication) -> Made:
    """Make one recess for the sheet or, with relief, one for each dot, which is then cut out separately."""
    tool = tool_of(fabrication, "knife", KNIFE, WALL)
    depth = depth_of(marker, fabrication, DEPTH, "a recess")
    dots = dots_of(marker)
    raised = any(dot.raised for dot in dots)
    # The size of the dots does not matter for a single sheet.
    gap = gap_of(fabrication, GAP / 4, dots) if raised else gap_of(fabrication, GAP, ())
    cutting = Cutting(tool, depth, gap=lambda _: gap)
    tolerances = (("recess", "+0.1 / 0 mm all around"), ("dot centers in the sheet", "as it was printed"))
    if raised:
        around = _mm(marker.tag.quiet_zone.outlines()[0]).tolist() if marker.tag else []
        printed = [Footprint("the recess for the tag", tuple(map(tuple, around)), gap)] if around else []
        ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius + gap, printed)
        recesses: tuple[Primitive, ...] = tuple(
            cylinder(dot.x, dot.y, dot.radius + gap, round(dot.z - depth, 9), dot.z) for dot in dots
        )
        if around:
            (left, bottom), (right, top) = np.min(around, axis=0) - gap, np.max(around, axis=0) + gap
            square = Contour(((left, bottom), (right, bottom), (right, top), (left, top)))
            recesses += (Prism(square, (), -depth, 0.0),)
        how = "Cut every printed dot out along its edge" + (", the tag along its quiet zone" if marker.tag else "")
        return Made(
            cut=recesses,
            add=ground.pillars,
            notes=(*ground.notes, f"{how}, and glue each into its own recess: dots stand at different heights."),
            lines=(f"{how}, glue each into its recess, {depth:.6g} mm deep, and press it down flush.",),
            accuracy=Accuracy(position=0.1, play=gap, depth=0.05),
            tolerances=tolerances,
            depth=depth,
        )
    recess = _recesses(marker, tool, depth, gap)
    around = " Punch its holes 1 mm larger all around." if any(prism.holes for prism in recess) else ""
    note = f"Print the marker as .pdf at true size, cut it out along the boundary, and glue it into the recess.{around}"
    return Made(
        cut=recess,
        notes=(note,),
        lines=(
            f"The recess is {depth:.6g} mm deep and {gap:.6g} mm larger than the sheet all around; its floor is flat.",
            *([f"Leave a land {LAND:g} mm wide around each hole in the recess."] if around else []),
            f"A printed sheet, cut out along the boundary of the dots, is glued into the recess.{around}",
        ),
        accuracy=Accuracy(depth=0.05),
        tolerances=tolerances,
        depth=depth,
    )


PROCESSES.register("print")(
    Process(sheet, "plate with a recess for a printed sheet", "a recess that the printed marker is glued into")
)


def _recesses(marker: Marker, tool: Tool, depth: float, gap: float) -> tuple[Prism, ...]:
    """Recess for each piece of the boundary, leaving lands around the holes in it."""
    plate = plate_of(marker)
    face = plate.face.filled()
    lands = _lands(plate)
    recesses = []
    for outer, shape in _pieces(marker, gap):
        (room,) = face.clearance([shape])
        if room < tool.wall - FLATTENING:
            edge = marker.substrate.edge_around(marker.boundary) * 1e3 + tool.wall - room
            raise InputError(
                f"at least {tool.wall:.6g} mm of the plate around the recess for the sheet",
                found_room(room) if room > ROUNDING else "a recess that reaches over its edge",
                "use a larger --outline"
                if marker.substrate.outline is not None or not marker.boundary.has_measures
                else f"use --edge {up(edge)} or more"
                if room > ROUNDING
                else "use a larger --edge, or a smaller --corner-radius and --chamfer",
            )
        inside = [(land, around) for land, around in lands if _lies_in(land, shape, tool.wall)]
        _check_lands([land for land, _ in inside], tool)
        recesses.append(Prism(outer, tuple(around for _, around in inside), -depth, 0.0))
    return tuple(recesses)


def _lands(plate: SolidPlate) -> list[tuple[Footprint, Contour]]:
    """Lands around all holes of the plate, and their edges."""
    lands = []
    for footprint in plate.hole_footprints:
        land = Footprint(footprint.name, footprint.points, footprint.radius + LAND)
        lands.append((land, circle(land.radius, *land.points[0], hole=True)))
    for contour in (hole for _, *holes in plate.outlines for hole in holes):
        if (whole := contour.as_circle) is not None:
            x, y, radius = whole
            land, edge = Footprint("a drawn hole", ((x, y),), radius + LAND), circle(radius + LAND, x, y, hole=True)
        else:
            shape = Region.of_contour(contour, (), OFF)
            (ring,) = shape.offset(LAND, "miter").filled().oriented().rings
            corners = tuple(map(tuple, shape.rings[0].tolist()))
            land, edge = Footprint("a drawn hole", corners, LAND), polygon(np.round(ring[::-1], 9))
        lands.append((land, edge))
    return lands


def _lies_in(land: Footprint, shape: Region, wall: float) -> bool:
    """Tell whether the land around a hole is within the recess; refuse one that overlaps its edge."""
    depth = float(shape.clearance([land.points])[0])
    least = land.radius + wall
    if abs(depth) < least - 1e-6:
        raise InputError(
            f"{land.name} inside or outside of the recess for the sheet, {least:.4g} mm from its edge",
            f"{abs(depth):.4g} mm",
            f"move the hole by {np.ceil((least - abs(depth)) * 100) / 100:g}mm",
        )
    return depth > 0


def _check_lands(lands: Sequence[Footprint], tool: Tool) -> None:
    """Refuse holes in the recess whose lands are too close to cut between them."""
    between = gaps(lands, lands)
    if between.size and between.min() < tool.wall - ROUNDING:
        i, j = divmod(int(np.argmin(between)), len(lands))
        least, gap = 2 * LAND + tool.wall, 2 * LAND + float(between[i, j])
        raise InputError(
            f"at least {least:.6g} mm between holes in the recess for the sheet, {lands[i].name} and {lands[j].name}",
            found_room(gap),
            f"move one by {up(least - gap)}, or use --process fdm",
        )


def _pieces(marker: Marker, gap: float) -> list[tuple[Contour, Region]]:
    """Outer contour of each piece of the boundary, offset by a gap, and the region in it, with the holes."""
    if isinstance(marker.boundary, Circle):
        radius, (x, y) = marker.boundary.size * 1e3 + gap, _mm(marker.boundary.center).tolist()
        disk = circle(radius, x, y)
        return [(disk, Region.of_contour(disk, (), OFF))]
    sheet = Region.enclosed([_mm(ring) for ring in marker.boundary.outlines()]).offset(gap, "miter").oriented()
    whole = [piece.filled().oriented() for piece in sheet.pieces]
    return [(polygon(np.round(piece.rings[0], 9)), piece) for piece in whole]


def _mm(meters: Any) -> Any:
    return np.round(np.asarray(meters) * 1e3, 9)
