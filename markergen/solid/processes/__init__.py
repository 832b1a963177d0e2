"""Processes: ways to make a marker's dots, tag and pillars, and what they share; the plate is the same for all.

Each module of this package puts one `markergen.model.fabrication.Process` into `PROCESSES`, the table that the command
line, exporters and the fabrication sheet ask; a plug-in adds one by an entry point. A process turns a marker into a
`Made`, for which `prepare`, `inlaid` and `marks` do what most processes have in common. `parts_of` is for those who
want the whole marker: it runs the process that was asked for, and adds the plate and the engraving on its back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate_checks import check_holes
from markergen.solid.bodies import Body, Part, Prism, cylinder
from markergen.solid.dot_geometry import SolidDot, dots_of, tag_ink
from markergen.solid.engraving import engraving
from markergen.solid.manufacturability import Tool, check_apart, check_bores, check_dots, check_tag
from markergen.solid.plate import Footprint, plate_of
from markergen.solid.relief import PILLAR, designed_poses, pillars_of


@dataclass(frozen=True)
class Made:
    """What a process makes of a marker; mm, marker frame, plain data.

    Attributes
    ----------
    parts : tuple of Part
        Parts beside the plate: ``dot-<id>``, ``dot-<id>-core``, ``tag-<k>``. `parts_of` puts the finished plates before
        them.
    cut : tuple of Body
        Cut from the plate and from what is added to it. They lie apart from each other, and inside of it or end at its
        surface.
    marked : tuple of Body
        Cut as well, leaving dark floors: engraved.
    add : tuple of Body
        Joined to the plate, on whose face they stand apart from each other: pillars.
    notes : tuple of str
        Sentences for the user, shown on the screen.
    lines : tuple of str
        Sentences for the workshop, on the fabrication sheet.
    tolerances : tuple of (what, how much)
        Rows for the fabrication sheet, such as ``("disc 36 mm", "h7: +0 / -0.025 mm")``.
    depth : float
        Depth of pockets, engraving or recess below the plane of their dots.
    face : float
        Height of the plate's face: 0, or less where balls stand with their centers in the plane.
    """

    parts: tuple[Part, ...] = ()
    cut: tuple[Body, ...] = ()
    marked: tuple[Body, ...] = ()
    add: tuple[Body, ...] = ()
    notes: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    tolerances: tuple[tuple[str, str], ...] = ()
    depth: float = 0.0
    face: float = 0.0


@dataclass(frozen=True)
class Cutting:
    """How a process cuts; mm.

    Attributes
    ----------
    tool : Tool
    depth : float
        Depth of pockets and engraving.
    corner : float
        Radius of the tag's corners.
    gap : callable
        Gap all around an inlay, by the inlay's diameter.
    """

    tool: Tool
    depth: float
    corner: float = 0.0
    gap: Callable[[float], float] = lambda _: 0.0

    @property
    def tag_gap(self) -> float:
        """Gap around the inlays of a tag."""
        return self.gap(0.0)


@dataclass(frozen=True)
class Ground:
    """Where a process cuts: the dots, the pillars under them, and sentences about the pillars."""

    dots: tuple[SolidDot, ...]
    pillars: tuple[Body, ...]
    notes: tuple[str, ...]


def parts_of(marker: Marker, fabrication: Fabrication) -> Made:
    """All parts of a marker as it was designed, the plates first; no CAD kernel is needed.

    Raises
    ------
    InputError
        If something is too small for the process, or does not fit onto the plate; one line.
    """
    marker = marker.as_designed
    plate = plate_of(marker)
    check_holes(marker, plate.face.mapped(lambda mm: mm / 1e3))
    made: Made = PROCESSES[fabrication.process](marker, fabrication)
    cut, notes = made.cut, made.notes
    if fabrication.engrave:
        under = [*plate.bores(made.face), *cut, *made.marked]
        engraved = engraving(marker, plate.outline, plate.bottom(made.face), under)
        cut, notes = (*cut, *engraved.cut), (*notes, *engraved.notes)
    plates = plate.parts(made.face, cut, made.marked, made.add)
    return replace(made, parts=(*plates, *made.parts), notes=notes)


def prepare(
    marker: Marker,
    fabrication: Fabrication,
    cutting: Cutting,
    reach: Callable[[SolidDot], float],
    around: Sequence[Footprint] | None = None,
) -> Ground:
    """Check that everything fits beside each other, and put pillars under raised dots.

    Parameters
    ----------
    reach : callable
        Radius in mm of what is cut for a dot.
    around : sequence of Footprint, optional
        What else is cut; the tag's ink unless it is given.

    Raises
    ------
    InputError
        See `markergen.solid.manufacturability` and `pillars_of`.
    """
    dots, tool = dots_of(marker), cutting.tool
    # A mill makes the bore rather than the core.
    check_dots(dots, tool, max(cutting.gap(2 * dot.inner) for dot in dots) if tool.own_wall else 0.0)
    check_bores(marker.substrate.holes, tool)
    prints = [Footprint(dot.name, ((dot.x, dot.y),), reach(dot)) for dot in dots]
    if around is None:
        check_tag(marker, tool, cutting.corner, cutting.tag_gap)
        # The border of a tag contains all of it.
        around = [Footprint("the tag", tuple(ink.corners()), cutting.tag_gap) for ink in tag_ink(marker.tag)[:1]]
    rim = max((reach(dot) - dot.radius for dot in dots if dot.raised), default=0.0) + tool.wall
    poses = designed_poses(marker) if any(dot.raised for dot in dots) else None
    flat = [each for each, dot in zip(prints, dots, strict=True) if not dot.raised]
    plate = plate_of(marker)
    pillars, notes = pillars_of(marker, dots, fabrication, tool, plate, [*flat, *around], rim, poses)
    feet = [Footprint(PILLAR + p.dot.name, ((p.dot.x, p.dot.y),), p.base) for p in pillars]
    check_apart(marker, plate, [*flat, *around, *feet], tool)
    return Ground(dots, tuple(pillar.body for pillar in pillars), notes)


def inlay(dot: SolidDot, cutting: Cutting) -> tuple[tuple[Part, ...], Body]:
    """A dot's inlays, flush with its height, and the pocket that they fill; a ring has a light core."""
    top, bottom = dot.z, round(dot.z - cutting.depth, 9)
    pocket = cylinder(dot.x, dot.y, dot.radius + cutting.gap(2 * dot.radius), bottom, top)
    whole = Part(dot.name, "dark", (cylinder(dot.x, dot.y, dot.radius, bottom, top, dot.inner),))
    if not dot.inner:
        return (whole,), pocket
    radius = dot.inner - cutting.gap(2 * dot.inner)
    core = Part(f"{dot.name}-core", "light", (cylinder(dot.x, dot.y, radius, bottom, top),))
    return (whole, core), pocket


def tag_inlays(marker: Marker, cutting: Cutting) -> tuple[tuple[Part, ...], tuple[Body, ...]]:
    """A tag's inlays, named ``tag-<k>`` from 1 on, and their pockets.

    Both are rounded about the same arc centers, so that the gap is even.
    """
    gap, wall = cutting.tag_gap, cutting.tool.wall
    parts, pockets = [], []
    for number, ink in enumerate(tag_ink(marker.tag), start=1):
        inner, outer = ink.contours(cutting.corner, wall + 2 * gap), ink.contours(cutting.corner, wall, gap)
        parts.append(Part(f"tag-{number}", "dark", (Prism(*inner, -cutting.depth, 0.0),)))
        pockets.append(Prism(*outer, -cutting.depth, 0.0))
    return tuple(parts), tuple(pockets)


def marks(marker: Marker, dots: Sequence[SolidDot], cutting: Cutting) -> tuple[Body, ...]:
    """Dots and tag as bodies to engrave."""
    engraved = [cylinder(dot.x, dot.y, dot.radius, round(dot.z - cutting.depth, 9), dot.z, dot.inner) for dot in dots]
    return (*engraved, *tag_inlays(marker, cutting)[1])


def inlaid(marker: Marker, ground: Ground, cutting: Cutting) -> tuple[tuple[Part, ...], tuple[Body, ...]]:
    """All inlays, those of the dots first, and their pockets."""
    each = [inlay(dot, cutting) for dot in ground.dots]
    parts, pockets = tag_inlays(marker, cutting)
    return (*(part for some, _ in each for part in some), *parts), (*(pocket for _, pocket in each), *pockets)
