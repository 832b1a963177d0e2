"""Manufacturability: what a tool can make of a marker, and how much the marker would have to change; mm.

Checks depths and gaps against the plate, minimum features of dots, tags and holes, and walls between everything that is
cut or stands on a plate. What cannot be made is refused with the nearest feasible value.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markergen.errors import InputError
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.solid.plate import Footprint, SolidPlate, gaps
from markergen.solid.primitives import mm
from markergen.workshop.dot_geometry import NECK, SolidDot, cell_of

FLOOR = 0.2
"""Minimum thickness in mm left under a pocket: one layer of a printer."""

ROUNDING, FLATTENING = 1e-6, 5e-3
"""Allowed violation of a limit in mm: in general, and where polygons approximate the plate's arcs."""


@dataclass(frozen=True)
class Tool:
    """The tool that limits the fineness of features.

    Attributes
    ----------
    word : str
        ``nozzle``, ``mill``, ``beam``, ``knife``.
    size : float
        Diameter in mm, which is the minimum width of a feature.
    wall : float
        Minimum width in mm of the material between two cuts.
    own_wall : bool
        True if a finer tool allows narrower walls.
    """

    word: str
    size: float
    wall: float
    own_wall: bool = True

    def __str__(self) -> str:
        return f"{self.word} of {self.size:.6g} mm"


def tool_of(fabrication: Fabrication, word: str, size: float, wall: float | None = None) -> Tool:
    """Make a tool of the requested or else the usual size; a wall of None is as wide as the tool."""
    diameter = size if fabrication.tool is None else fabrication.tool * 1e3
    return Tool(word, diameter, diameter if wall is None else wall, wall is None)


def depth_of(marker: Marker, fabrication: Fabrication, usual: float, what: str) -> float:
    """Requested depth in mm; by default the usual one, or half the thickness of the plate if that is less.

    Raises
    ------
    InputError
        If less than `FLOOR` of the plate would remain.
    """
    thickness = mm(marker.substrate.thickness)
    depth = min(usual, thickness / 2) if fabrication.depth is None else mm(fabrication.depth)
    if thickness - depth < FLOOR - ROUNDING:
        most, least = down(thickness - FLOOR), up(depth + FLOOR)
        # In a thicker plate the default is deeper, up to half the thickness.
        enough = up(FLOOR + min(usual, FLOOR)) if fabrication.depth is None else least
        remedy = f"use --thickness {enough}" + (f", or --depth {most} or less" if thickness > FLOOR + 0.01 else "")
        raise InputError(
            f"a plate of at least {least} for {what} {depth:.6g} mm deep", f"one of {thickness:.6g} mm", remedy
        )
    return depth


def gap_of(fabrication: Fabrication, usual: float, dots: Sequence[SolidDot]) -> float:
    """Requested or else usual gap in mm around inlays.

    Raises
    ------
    InputError
        If it is negative, or above a fifth of a ring's inner radius: the core would no longer mark the center.
    """
    gap = usual if fabrication.gap is None else mm(fabrication.gap)
    least = min((dot.inner or dot.radius for dot in dots), default=np.inf)
    if gap < 0:
        raise InputError("a gap of 0 or more around inlays", f"{gap:.6g} mm", "use --gap 0.1mm, for example")
    if gap > least / 5:
        dot = min(dots, key=lambda dot: dot.inner or dot.radius)
        raise InputError(
            f"a gap of at most {down(least / 5)} around the inlays of {dot.name}",
            f"{gap:.6g} mm",
            f"use --gap {down(least / 5)} or less",
        )
    return gap


def check_dots(dots: Sequence[SolidDot], tool: Tool, gap: float = 0.0) -> None:
    """Refuse dots, rings and cores that are too narrow for the tool."""
    for dot in dots:
        sizes = [(dot.name, "diameter", 2 * dot.radius, tool.size, True)]
        if dot.inner:
            sizes = [
                (dot.name, "ring's width", dot.radius - dot.inner, tool.wall, tool.own_wall),
                (f"{dot.name}-core", "diameter", 2 * (dot.inner - gap), tool.size, True),
            ]
        for name, what, size, least, by_tool in sizes:
            if size < least - ROUNDING:
                design = f"design it with --dot {up(2 * dot.radius * least / size)} or more"
                raise InputError(
                    f"a {what} of at least {least:.6g} mm for {name}, made with a {tool}",
                    f"{size:.4g} mm",
                    f"use --tool {down(size)} or less, or {design}" if by_tool else design,
                )


def check_bores(holes: Sequence[Hole], tool: Tool) -> None:
    """Refuse mounting and dowel holes narrower than the tool, unless another tool drills them."""
    for hole in holes if tool.own_wall else ():
        size = mm(hole.diameter)
        if size < tool.size - ROUNDING:
            raise InputError(
                f"a diameter of at least {tool.size:.6g} mm for {hole}, made with a {tool}",
                f"{size:.4g} mm",
                f"use --tool {down(size)} or less, or a larger hole",
            )


def check_tag(marker: Marker, tool: Tool, corner: float, gap: float = 0.0) -> None:
    """Refuse a tag with cells narrower than the tool, or than the two rounded corners on one side of a cell.

    Parameters
    ----------
    corner : float
        Radius of the tag's corners, mm; adjoining corners are rounded more (see `TagInk.contours`).
    """
    if marker.tag is None:
        return
    cell = cell_of(marker.tag)
    walls = max(NECK * 2, 1.0) * (tool.wall + 2 * gap)
    least = max(tool.size, 2 * corner, walls)
    # A wall whose minimum does not depend on the tool does not become narrower with it.
    scales = least > walls or (tool.own_wall and not gap)
    if cell < least - ROUNDING:
        side = up(least * marker.tag.cells)
        design = f"design it with --tag-size {side} or more"
        raise InputError(
            f"cells of at least {least:.4g} mm in the tag, made with a {tool}",
            f"{cell:.4g} mm",
            f"use --tool {down(tool.size * cell / least)} or less, or {design}" if scales else design,
        )


def check_apart(marker: Marker, plate: SolidPlate, footprints: Sequence[Footprint], tool: Tool) -> None:
    """Refuse footprints less than a wall apart, or less than a wall from a hole or the plate's edge."""
    others = [*footprints, *plate.hole_footprints]
    between = gaps(footprints, others)
    if between.size and between.min() < tool.wall - ROUNDING:
        i, j = divmod(int(np.argmin(between)), len(others))
        gap, more = float(between[i, j]), tool.wall - float(between[i, j])
        raise InputError(
            f"a wall of at least {tool.wall:.6g} mm between {footprints[i].name} and {others[j].name}",
            found_room(gap),
            f"move the hole by {up(more)}"
            if j >= len(footprints)
            else f"design it with --clearance {up(marker.clearance * 1e3 + more)} or more",
        )
    room = plate.room(footprints)
    if room.size and room.min() < tool.wall - FLATTENING:
        i = int(np.argmin(room))
        more = tool.wall - float(room[i])
        raise InputError(
            f"a wall of at least {tool.wall:.6g} mm between {footprints[i].name} and the plate's edge",
            found_room(float(room[i])),
            "use a larger --outline"
            if marker.substrate.outline is not None
            else f"use --edge {up(marker.substrate.edge_around(marker.boundary) * 1e3 + more)} or more"
            if marker.boundary.has_measures
            else f"design it with --clearance {up(marker.clearance * 1e3 + more)} or more, or use a larger --outline",
        )


def found_room(gap: float) -> str:
    """Gap between two features, in words."""
    return f"{gap:.4g} mm" if gap > ROUNDING else "none: they touch" if gap > -ROUNDING else f"{-gap:.4g} mm in common"


def up(mm: float) -> str:
    """Length as an option value, rounded up to hundredths of a mm."""
    return f"{np.ceil(mm * 100 - 1e-6) / 100:.6g}mm"


def down(mm: float) -> str:
    """Length as an option value, rounded down to hundredths of a mm, or to thousandths if small."""
    digits = 100 if mm >= 0.1 else 1000
    return f"{max(np.floor(mm * digits + 1e-6), 1.0) / digits:.6g}mm"
