"""What a process can make of a plate: depths, gaps, smallest features, and walls between what is cut or stands."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.solid.bodies import Point, mm
from markergen.solid.inks import NECK, Dot, cell_of
from markergen.solid.plate import face_of, plate_regions

Array = NDArray[np.float64]

FLOOR = 0.2
"""Least thickness in mm of what is left under a pocket: one layer of a printer."""

ROUNDING, FLATTENING = 1e-6, 5e-3
"""mm by which a limit may be missed; more where polygons stand for the plate's arcs."""


@dataclass(frozen=True)
class Tool:
    """What makes the smallest features.

    Attributes
    ----------
    word : str
        ``nozzle``, ``mill``, ``beam``, ``knife``.
    size : float
        Diameter in mm: the narrowest thing that it can make.
    wall : float
        Least width in mm of what stays between two things that are cut.
    own_wall : bool
        Whether a finer tool makes narrower walls.
    """

    word: str
    size: float
    wall: float
    own_wall: bool = True

    def __str__(self) -> str:
        return f"{self.word} of {self.size:.6g} mm"


def tool_of(fabrication: Fabrication, word: str, size: float, wall: float | None = None) -> Tool:
    """Tool that was asked for, or the one that is usual; a wall of None is as wide as the tool."""
    given = size if fabrication.tool is None else fabrication.tool * 1e3
    return Tool(word, given, given if wall is None else wall, wall is None)


def depth_of(marker: Marker, fabrication: Fabrication, usual: float, what: str) -> float:
    """Depth in mm that was asked for; else the usual one, or half the plate where that is less.

    Raises
    ------
    InputError
        If less than `FLOOR` of the plate would be left.
    """
    thickness = mm(marker.substrate.thickness)
    depth = min(usual, thickness / 2) if fabrication.depth is None else mm(fabrication.depth)
    if thickness - depth < FLOOR - ROUNDING:
        most, least = down(thickness - FLOOR), up(depth + FLOOR)
        # In a thicker plate what is usual is deeper, up to its half.
        enough = up(FLOOR + min(usual, FLOOR)) if fabrication.depth is None else least
        remedy = f"use --thickness {enough}" + (f", or --depth {most} or less" if thickness > FLOOR + 0.01 else "")
        raise InputError(
            f"a plate of at least {least} for {what} {depth:.6g} mm deep", f"one of {thickness:.6g} mm", remedy
        )
    return depth


def gap_of(fabrication: Fabrication, usual: float, dots: Sequence[Dot]) -> float:
    """Gap in mm around inlays that was asked for, or the usual one.

    Raises
    ------
    InputError
        If it is negative, or takes a fifth of a ring's hole or more: the core would not show its middle.
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


def check_dots(dots: Sequence[Dot], tool: Tool, gap: float = 0.0) -> None:
    """Refuse dots, rings and cores that are narrower than the tool makes them.

    Raises
    ------
    InputError
    """
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
    """Refuse mounting and dowel holes that are narrower than the tool, unless they are drilled.

    Raises
    ------
    InputError
    """
    for hole in holes if tool.own_wall else ():
        size = mm(hole.diameter)
        if size < tool.size - ROUNDING:
            raise InputError(
                f"a diameter of at least {tool.size:.6g} mm for {hole}, made with a {tool}",
                f"{size:.4g} mm",
                f"use --tool {down(size)} or less, or a larger hole",
            )


def check_tag(marker: Marker, tool: Tool, corner: float, gap: float = 0.0) -> None:
    """Refuse a tag whose cells are narrower than the tool, or than two rounded corners of one cell are.

    Parameters
    ----------
    corner : float
        Radius of the tag's corners, mm; those that meet others are rounded more (see `Inlay.paths`).

    Raises
    ------
    InputError
    """
    if marker.tag is None:
        return
    cell = cell_of(marker.tag)
    walls = max(NECK * 2, 1.0) * (tool.wall + 2 * gap)
    least = max(tool.size, 2 * corner, walls)
    # A wall that is not the tool's own does not become narrower with it.
    scales = least > walls or (tool.own_wall and not gap)
    if cell < least - ROUNDING:
        side = up(least * marker.tag.cells)
        design = f"design it with --tag-size {side} or more"
        raise InputError(
            f"cells of at least {least:.4g} mm in the tag, made with a {tool}",
            f"{cell:.4g} mm",
            f"use --tool {down(tool.size * cell / least)} or less, or {design}" if scales else design,
        )


@dataclass(frozen=True)
class Footprint:
    """Where something stands on the plate or is cut into it: a point or an outline, and a margin around it; mm.

    Attributes
    ----------
    name : str
    points : tuple of (x, y)
        One point, or the corners of an outline.
    radius : float
    """

    name: str
    points: tuple[Point, ...]
    radius: float = 0.0


class Face:
    """The plate's upper face, for asking what room there is; mm.

    Attributes
    ----------
    shape : shapely geometry
        Without what is cut from it; arcs are polygons.
    holes : tuple of Footprint
        Mounting and dowel holes with their countersinks.
    """

    def __init__(self, marker: Marker) -> None:
        self.shape = face_of(plate_regions(marker), marker.substrate.chamfer * 1e3)
        self.holes = tuple(
            Footprint(str(hole).removeprefix("the "), ((hole.x * 1e3, hole.y * 1e3),), hole.radius * 1e3)
            for hole in marker.substrate.holes
        )

    def to_edge(self, footprints: Sequence[Footprint]) -> Array:
        """Distances (m,) in mm from footprints to the plate's edge; negative: they hang over."""
        return self.inside(_shapes(footprints)) - [each.radius for each in footprints]

    def inside(self, shapes: Any) -> Array:
        """Distance (...) in mm from shapely geometries to the plate's edge; not above 0: they are not all in it."""
        import shapely

        far: Array = shapely.distance(self.shape.boundary, shapes)
        return np.where(shapely.covers(self.shape, shapes), far, -far)


def gaps(footprints: Sequence[Footprint], others: Sequence[Footprint]) -> Array:
    """Gaps (m, k) in mm between footprints, negative where they overlap by their margins; inf for one and itself."""
    import shapely

    if not (footprints and others):
        return np.full((len(footprints), len(others)), np.inf)
    found: Array = shapely.distance(_shapes(footprints)[:, None], _shapes(others)[None])
    found -= np.array([each.radius for each in footprints])[:, None] + [each.radius for each in others]
    found[np.array([[a is b for b in others] for a in footprints])] = np.inf
    return found


def check_apart(marker: Marker, face: Face, footprints: Sequence[Footprint], tool: Tool) -> None:
    """Refuse footprints with less than a wall between them, or between them and a hole or the plate's edge.

    Raises
    ------
    InputError
    """
    others = [*footprints, *face.holes]
    between = gaps(footprints, others)
    if between.size and between.min() < tool.wall - ROUNDING:
        i, j = divmod(int(np.argmin(between)), len(others))
        found, more = float(between[i, j]), tool.wall - float(between[i, j])
        raise InputError(
            f"a wall of at least {tool.wall:.6g} mm between {footprints[i].name} and {others[j].name}",
            found_room(found),
            f"move the hole by {up(more)}"
            if j >= len(footprints)
            else f"design it with --clearance {up(marker.clearance * 1e3 + more)} or more",
        )
    room = face.to_edge(footprints)
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
    """What is between two things, in words."""
    return f"{gap:.4g} mm" if gap > ROUNDING else "none: they touch" if gap > -ROUNDING else f"{-gap:.4g} mm in common"


def _shapes(footprints: Sequence[Footprint]) -> Any:
    import shapely

    shapes = [shapely.Point(f.points[0]) if len(f.points) == 1 else shapely.Polygon(f.points) for f in footprints]
    return np.array(shapes, dtype=object)


def up(mm: float) -> str:
    """Length that can be typed, rounded up to two digits after the point."""
    return f"{np.ceil(mm * 100 - 1e-6) / 100:.6g}mm"


def down(mm: float) -> str:
    """Length that can be typed, rounded down to two digits, or to three where it is small."""
    digits = 100 if mm >= 0.1 else 1000
    return f"{max(np.floor(mm * digits + 1e-6), 1.0) / digits:.6g}mm"
