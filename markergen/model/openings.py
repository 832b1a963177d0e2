"""Holes through whatever is made of a marker, sheet or plate, one list for all files (docs/conventions.md), and checks.

Holes have material around them, and clear the dots, the tag and each other.
"""
# tests: tests/model/test_openings.py tests/model/test_substrate_checks.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, floor, hypot

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, box, circle
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Circle, area_without, filled_outline
from markergen.model.json_text import in_one_line
from markergen.model.marker import Marker
from markergen.model.substrate import Hole, Substrate
from markergen.units import format_length

OFF = 1e-6
"""Maximum distance in m of a polygon from the arcs it approximates, to compare holes and measure gaps."""

SHOWN = 4
"""Maximum number of holes in a sentence: the holes of a pitch circle usually have the same fault."""


@dataclass(frozen=True)
class Opening:
    """A hole through whatever is made.

    Attributes
    ----------
    contour : Contour
        Outline of the bore, clockwise as around a hole, m, marker frame.
    hole : Hole or None
        Mounting or dowel hole that it is; None for a hole of a drawing.
    """

    contour: Contour
    hole: Hole | None = None

    @property
    def region(self) -> Region:
        """Opening in the printed face, with the countersink."""
        return self.hole.rim.region if self.hole else _region(self.contour)

    def __str__(self) -> str:
        if self.hole:
            return str(self.hole)
        left, bottom, right, top = self.region.box
        place = (format_length(float(f"{middle:.3g}")) for middle in ((left + right) / 2, (bottom + top) / 2))
        return f"the drawn hole around {', '.join(place)}"


def openings(marker: Marker) -> tuple[Opening, ...]:
    """Return all holes: mounting and dowel holes in the order of marker.json, then those of the drawings."""
    drawn = drawn_holes(marker.boundary, marker.substrate.outline)
    holes = (Opening(circle(hole.diameter / 2, hole.x, hole.y, hole=True), hole) for hole in marker.substrate.holes)
    return (*holes, *map(Opening, drawn))


# Cached, since every file of a marker needs them.
@lru_cache(maxsize=8)
def drawn_holes(boundary: Boundary, outline: Boundary | None = None) -> tuple[Contour, ...]:
    """Return the holes of a boundary and of a plate's own outline as exact contours in m, clockwise.

    Those of a boundary that lie in a hole of the outline are left out, and vice versa, so that none counts twice.

    Raises
    ------
    InputError
        If holes of both overlap otherwise.
    """
    outline_holes, boundary_holes = (
        [contour for contour in shape.contours() if area(contour) < 0] if shape else [] for shape in (outline, boundary)
    )
    if not (outline_holes and boundary_holes):
        return (*outline_holes, *boundary_holes)
    within: tuple[set[int], set[int]] = set(), set()
    for i, k in np.argwhere(_boxes_meet(outline_holes, boundary_holes)).tolist():
        ours, theirs = _region(outline_holes[i]), _region(boundary_holes[k])
        if not theirs - ours.offset(2 * OFF):
            within[1].add(k)
        elif not ours - theirs.offset(2 * OFF):
            within[0].add(i)
        elif ours.meets(theirs):
            x, y = map(format_length, filled_outline(boundary_holes[k]).center)
            raise InputError(
                "holes of the boundary inside or outside of those of --outline",
                f"one around {x}, {y} that overlaps one",
                "draw their union in one of the drawings",
            )
    return tuple(
        hole
        for holes, drop in zip((outline_holes, boundary_holes), within, strict=True)
        for k, hole in enumerate(holes)
        if k not in drop
    )


def _boxes_meet(ones: Sequence[Contour], others: Sequence[Contour]) -> NDArray[np.bool_]:
    """True (m, k) where the bounding boxes of two contours meet."""
    boxes, other_boxes = (np.array([box(contour) for contour in contours]) for contours in (ones, others))
    low, high = (
        boxes[:, None, :2] <= other_boxes[None, :, 2:] + OFF,
        other_boxes[None, :, :2] <= boxes[:, None, 2:] + OFF,
    )
    return np.asarray((low & high).all(axis=-1))


def holes_beyond(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes of the plate that reach beyond the boundary, where a sheet ends, if any do."""
    within = marker.boundary.region.filled()
    beyond = [str(opening) for opening in openings(marker) if not within.covers(opening.region)]
    return (f"Holes of the plate beyond the boundary are drawn, too: {in_one_line(beyond, SHOWN)}.",) if beyond else ()


def near_holes(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes that reach into dots' quiet zones, if there are any."""
    designed = marker.as_designed
    dots = [(p.id, p.x, p.y, p.feature.diameter) for p in designed.control_points if p.feature.diameter]
    if not dots:
        return ()
    _, *places, across = np.array(dots).T
    reaches, widest = [], 0.0
    for opening in openings(designed):
        is_near = opening.region.distance(np.stack(places, axis=-1)) < across - 1e-9
        ids = [str(dot[0]) for dot, close in zip(dots, is_near, strict=True) if close]
        if ids:
            listed = [*ids[:3], "others"] if len(ids) > 4 else ids
            reaches.append(f"{opening} into that of dot{'s' * (len(ids) > 1)} {' and '.join(listed)}")
            widest = max(widest, across[is_near].max())
    if not reaches:
        return ()
    return (
        "holes reach into the quiet zones of dots, where a camera sees them as dark spots: "
        f"{in_one_line(reaches, SHOWN)}; if detection suffers, move them, or design with "
        f"--clearance {format_length(float(f'{widest / 2:.3g}')).replace(' ', '')}",
    )


def _region(contour: Contour) -> Region:
    return Region.of_contour(contour, (), OFF)


WALL = 1e-3
"""Minimum material in m around a hole: two lines of a printer's nozzle, and enough for a drill not to break through."""

TOLERANCE, FLATTENING = 1e-9, 1e-5
"""Rounding in m, and error in m of circles and rounded corners approximated by polygons."""

SMALLEST = 5e-4
"""Minimum diameter in m of a smaller hole that a message suggests."""

Disk = tuple[float, float, float]
"""Center x, y and radius of a dot, m."""


@dataclass(frozen=True)
class Misfit:
    """One fault of a hole, and what would fit, in words; `hole` is its index in the list."""

    hole: int
    problem: str
    fits: str

    def __str__(self) -> str:
        return f"{self.problem} ({self.fits})"


def check_holes(marker: Marker, face: Region | None = None) -> None:
    """Refuse a plate whose holes are not wholly in it, or hit a dot, the tag, or each other, or that misses a dot.

    Parameters
    ----------
    face : Region, optional
        The plate's upper face in m, if not that of `plate_face`.

    Raises
    ------
    InputError
        Naming each such hole with the obstacle, the overlap and a remedy; or each such dot.
    """
    plate, designed = marker.substrate, marker.as_designed
    if face is None and not plate.holes and replace(plate, thickness=Substrate.thickness) == Substrate():
        return  # The plate is as large as the boundary or larger, with nothing else.
    dots = {f"dot {p.id}": (p.x, p.y, p.feature.diameter / 2) for p in designed.control_points}
    tag = marker.tag.quiet_zone if marker.tag else None
    face = plate_face(plate, marker.boundary, list(dots.values())) if face is None else face
    _refuse(
        plate.holes,
        [*hole_clashes(plate.holes, dots, marker.clearance, tag), *cut_open(plate.holes, face), *sunk(plate)],
    )
    over = {name: radius - float(face.depth([x, y])) for name, (x, y, radius) in dots.items()}
    lost = [f"{name} is {_mm(by)} over its edge" for name, by in over.items() if by > FLATTENING]
    if lost:
        larger = "--edge" if plate.outline is None and marker.boundary.has_measures else "--outline"
        raise InputError(
            "a plate whose upper face holds all dots",
            in_one_line(lost),
            f"use a larger {larger}, or smaller --corner-radius and --chamfer",
        )


def check_plate(
    substrate: Substrate, boundary: Boundary, blocked: Sequence[Boundary] = (), dot: float | None = None
) -> None:
    """Refuse a plate that does not cover the region of the dots, or whose holes are wrong wherever the dots are.

    Parameters
    ----------
    blocked : sequence of Boundary
        Regions without dots.
    dot : float or None
        Diameter in m, if known: around a disk, the plate includes the dots' quiet zones.

    Raises
    ------
    InputError
        As here, and as in `check_holes` and `check_edge`.
    """
    check_edge(substrate, boundary)
    if substrate.outline is not None:
        # The chamfer is cut from the face, but not from the region of the dots.
        room = area_without(boundary, blocked).region
        over = room - plate_face(substrate, boundary).offset(FLATTENING)
        if over.area > 1e-9 * boundary.area:
            raise InputError(
                "a plate's outline that holds the boundary, less its chamfer and what is kept out",
                f"{over.area * 1e6:.4g} mm^2 of a {boundary} outside of a {substrate.outline}",
                "use a larger --outline, or leave it out",
            )
    if substrate.holes:
        # A dot on the rim is as far out as possible.
        reach = boundary.radius / 4 if dot is None else dot / 2
        rim = (boundary.radius - reach, 0.0, reach)
        _refuse(
            substrate.holes,
            [
                *hole_clashes(substrate.holes, {}),
                *cut_open(substrate.holes, plate_face(substrate, boundary, [rim])),
                *sunk(substrate),
            ],
        )


def check_edge(substrate: Substrate, boundary: Boundary) -> None:
    """Refuse an edge around a drawn outline, which is the plate's: offsetting it would shrink its holes.

    Raises
    ------
    InputError
    """
    if substrate.edge and substrate.outline is None and not boundary.has_measures:
        raise InputError(
            "an edge around a disk or a rectangle only",
            f"edge={format_length(substrate.edge)} around a {boundary}, whose outline is the plate's",
            "leave out --edge, or draw the plate and give it as --outline",
        )


def _refuse(holes: Sequence[Hole], misfits: Sequence[Misfit]) -> None:
    """Raise one error about all misfits, if there are any."""
    if misfits:
        raise InputError(
            f"holes clear of dots and tag, in {format_length(WALL)} of material or more",
            in_one_line([f"{holes[misfit.hole]} {misfit}" for misfit in misfits], SHOWN),
            "move them, or use smaller ones",
        )


def hole_clashes(
    holes: Sequence[Hole], dots: Mapping[str, Disk], clearance: float = 0.0, tag: Boundary | None = None
) -> list[Misfit]:
    """Return misfits of holes with each other, the tag's quiet zone, and dots by name, which need their clearance."""
    misfits = []
    for k, hole in enumerate(holes):
        gaps = [(name, hypot(hole.x - x, hole.y - y) - radius, clearance) for name, (x, y, radius) in dots.items()]
        if tag is not None:
            gaps.append(("the quiet zone of the tag", -float(tag.depth(np.array([hole.x, hole.y]))), 0.0))
        gaps += [
            (str(neighbor), hypot(hole.x - neighbor.x, hole.y - neighbor.y) - neighbor.radius, WALL)
            for neighbor in holes[:k]
        ]
        for name, distance, needed in gaps:
            gap = distance - hole.radius
            if gap < -TOLERANCE:
                misfits.append(Misfit(k, f"is {_mm(-gap)} over {name}", _fits(hole, needed - gap)))
            elif gap < needed - TOLERANCE:
                problem = f"is {_mm(gap)} from {name} instead of {_mm(needed)}"
                misfits.append(Misfit(k, problem, _fits(hole, needed - gap)))
    return misfits


def cut_open(holes: Sequence[Hole], face: Region) -> list[Misfit]:
    """Return misfits of holes with the edge of the plate's upper face, in m."""
    misfits = []
    for k, hole in enumerate(holes):
        left = float(face.depth([hole.x, hole.y])) - hole.radius
        if left < WALL - FLATTENING:
            place = f"leaves {_mm(left)} to" if left > 0 else f"is {_mm(-left)} over"
            misfits.append(Misfit(k, f"{place} the edge of the plate", _fits(hole, WALL - left)))
    return misfits


def sunk(substrate: Substrate) -> list[Misfit]:
    """Return misfits of countersinks that are as deep as the plate is thick, or deeper."""
    misfits = []
    for k, hole in enumerate(substrate.holes):
        depth = hole.radius - hole.diameter / 2
        if depth >= substrate.thickness:
            problem = f"has a countersink {_mm(depth)} deep in a plate of {_mm(substrate.thickness)}"
            misfits.append(Misfit(k, problem, f"use --thickness {ceil(depth * 1e4 + 1) / 10:g}mm or more, or none"))
    return misfits


def plate_face(substrate: Substrate, boundary: Boundary, dots: Sequence[Disk] = ()) -> Region:
    """Return the upper face of the plate without its holes, in m.

    It is the given outline without the holes of a drawn boundary; or the boundary, with the edge around a disk or a
    rectangle, and around a disk also every dot's quiet zone, half a dot wide; with its corners rounded, and less the
    chamfer.

    Raises
    ------
    InputError
        If nothing is left.
    """
    if substrate.outline is not None:
        holes = Region.union(filled_outline(contour).region for contour in drawn_holes(boundary, substrate.outline))
        shape = substrate.outline.region - holes
    elif isinstance(boundary, Circle):
        shape = Circle(disk_radius(substrate, boundary, dots), boundary.center).region
    else:
        shape = boundary.region
        if edge := substrate.edge_around(boundary):
            shape = shape.offset(edge, "miter")
    if substrate.corner_radius:
        # The opening by a disk of that radius: what it reaches from inside.
        shape = shape.offset(-substrate.corner_radius).offset(substrate.corner_radius, segments=64)
    face = shape.offset(-substrate.chamfer, "miter") if substrate.chamfer else shape
    if not face:
        raise InputError(
            "a corner radius and a chamfer that leave something of the plate",
            f"{format_length(substrate.corner_radius)} and {format_length(substrate.chamfer)}",
            "use a smaller --corner-radius or --chamfer",
        )
    return face


def disk_radius(substrate: Substrate, boundary: Boundary, dots: Sequence[Disk]) -> float:
    """Return the radius in m of a disk's plate: the boundary and its edge, or what the dots' quiet zones need."""
    x, y = boundary.center
    reach = max((hypot(u - x, v - y) + 2 * radius for u, v, radius in dots), default=0.0)
    return max(boundary.radius + substrate.edge_around(boundary), reach)


def _fits(hole: Hole, lacking: float) -> str:
    across = floor((hole.radius - lacking) * 2e4 + 1e-6) / 1e4
    # Rounded up, so that it suffices.
    moved = f"move it by {ceil(lacking * 1e5 - 1e-6) / 100:g} mm"
    return f"{moved}, or use at most {_mm(across)} there" if across >= SMALLEST else moved


def _mm(meters: float) -> str:
    return format_length(float(f"{meters:.4g}"))
