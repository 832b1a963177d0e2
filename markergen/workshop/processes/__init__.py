"""Processes: ways to make a marker's dots, tag and pillars, and their common steps; the plate is the same for all.

Each module of this package registers one `markergen.model.fabrication.Process` in `PROCESSES`, the table used by the
command line, the exporters and the fabrication sheet; plug-ins add entries through an entry point. A process turns a
marker into a `Made`, for which `prepare`, `inlaid` and `marks` do the common work. `parts_of` makes the entire marker:
it runs the requested process and adds the plate and the engraving on its back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.openings import check_holes
from markergen.solid.plate import Footprint, plate_of
from markergen.solid.primitives import Part, Primitive, Prism, cylinder, span_of
from markergen.workshop.dot_geometry import SolidDot, dots_of, tag_pieces
from markergen.workshop.drafting.drawing import EngravedText
from markergen.workshop.engraving import engraving
from markergen.workshop.iso286 import DiscFit
from markergen.workshop.manufacturability import Tool, check_apart, check_bores, check_dots, check_tag
from markergen.workshop.relief import PILLAR, designed_poses, pillars_of

FACE_DOWN = "Print face down on a smooth bed: all of the face is then one plane."
"""Advice of 3-D prints, which a rig printed as one body cannot follow."""


@dataclass(frozen=True)
class Accuracy:
    """What a process keeps to, for the tolerances on the fabrication drawing; mm.

    Attributes
    ----------
    position : float
        Diameter of the zone for the axes of what is cut or marked for the dots; 0 if the process makes no dots.
    play : float
        Maximum distance of a dot's center from the axis of its pocket; 0 if they are one.
    diameter : float
        Deviation of a dot's diameter to either side, where no fit says more.
    depth : float
        Maximum excess of the depth of pockets or a recess; 0 if the depth is a maximum.
    thickness, height : float
        Deviations of the plate's thickness and of the heights of pillars to either side.
    flatness : float
        Flatness of the plate's face.
    finish, edges : str
        Surface finish, and the state of edges.
    """

    position: float = 0.0
    play: float = 0.0
    diameter: float = 0.1
    depth: float = 0.1
    thickness: float = 0.2
    height: float = 0.1
    flatness: float = 0.2
    finish: str = "Ra 3.2"
    edges: str = "broken 0.1 to 0.3, rims of dots sharp"

    @property
    def center(self) -> float:
        """Maximum distance of a finished dot's center from its true position."""
        return self.position / 2 + self.play


@dataclass(frozen=True)
class Made:
    """The result of a process for a marker, as plain data; mm, marker frame.

    Attributes
    ----------
    parts : tuple of Part
        Parts besides the plate: ``dot-<id>``, ``dot-<id>-core``, ``tag-<k>``. `parts_of` inserts the finished plates
        before them.
    cut : tuple of Primitive
        Bodies cut from the plate and from what is added to it. They are disjoint, and lie inside the plate or end at
        its surface.
    marked : tuple of Primitive
        Bodies that are also cut, leaving dark floors: engraving.
    add : tuple of Primitive
        Bodies joined to the plate, standing on its face apart from each other: pillars.
    notes : tuple of str
        Sentences for the user, shown on the screen.
    lines : tuple of str
        Sentences for the workshop, on the fabrication sheet.
    accuracy : Accuracy
        Tolerances for the fabrication sheet.
    tolerances : tuple of (what, how much)
        Further rows for the fabrication sheet, such as ``("inlays, from the face", "0 / -0.05 mm")``.
    fits : tuple of (what, DiscFit)
        Fits of discs in pockets, the largest first, and of rings' cores in rings: ``"dot"`` or ``"core"``.
    engraved : tuple of EngravedText
        What `parts_of` engraves on the back.
    depth : float
        Depth of pockets, engraving or recess below the plane of their dots.
    face : float
        Height of the plate's face: 0, or less for balls with their centers in the plane.
    """

    parts: tuple[Part, ...] = ()
    cut: tuple[Primitive, ...] = ()
    marked: tuple[Primitive, ...] = ()
    add: tuple[Primitive, ...] = ()
    notes: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    accuracy: Accuracy = Accuracy()
    tolerances: tuple[tuple[str, str], ...] = ()
    fits: tuple[tuple[str, DiscFit], ...] = ()
    engraved: tuple[EngravedText, ...] = ()
    depth: float = 0.0
    face: float = 0.0

    @property
    def plates(self) -> tuple[Part, ...]:
        """Finished plates."""
        return tuple(part for part in self.parts if part.is_plate)

    @property
    def bottom(self) -> float:
        """Height of the plates' back."""
        return span_of(self.plates)[0]


@dataclass(frozen=True)
class Cutting:
    """Parameters of cutting; mm.

    Attributes
    ----------
    depth : float
        Depth of pockets and engraving.
    corner : float
        Radius of the tag's corners.
    gap : callable
        Gap on each side of an inlay, as a function of its diameter.
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
    """The dots to cut for, the pillars under them, and sentences about the pillars."""

    dots: tuple[SolidDot, ...]
    pillars: tuple[Primitive, ...]
    notes: tuple[str, ...]


# Cached, since each file of a solid and its notes need the parts.
@lru_cache(maxsize=2)
def parts_of(marker: Marker, fabrication: Fabrication) -> Made:
    """All parts of a marker as designed, the plates first; needs no CAD kernel.

    Raises
    ------
    InputError
        If something is too small for the process or does not fit on the plate; one line.
    """
    marker = marker.as_designed
    plate = plate_of(marker)
    check_holes(marker, plate.face.mapped(lambda mm: mm / 1e3))
    made: Made = PROCESSES[fabrication.process](marker, fabrication)
    cut, notes, texts = made.cut, made.notes, made.engraved
    if fabrication.engrave:
        under = [*plate.bores(made.face), *cut, *made.marked]
        engraved = engraving(marker, plate.outline, plate.bottom(made.face), under)
        cut, notes, texts = (*cut, *engraved.cut), (*notes, *engraved.notes), engraved.texts
    plates = plate.parts(made.face, cut, made.marked, made.add)
    return replace(made, parts=(*plates, *made.parts), notes=notes, engraved=texts)


def prepare(
    marker: Marker,
    fabrication: Fabrication,
    cutting: Cutting,
    reach: Callable[[SolidDot], float],
    around: Sequence[Footprint] | None = None,
) -> Ground:
    """Check that all features fit next to each other, and put pillars under raised dots.

    Parameters
    ----------
    reach : callable
        Radius in mm of the cut for a dot.
    around : sequence of Footprint, optional
        Other cuts; the tag's ink by default.

    Raises
    ------
    InputError
        See `markergen.workshop.manufacturability` and `pillars_of`.
    """
    dots, tool = dots_of(marker), cutting.tool
    # A mill cuts the bore of a ring, not the core.
    check_dots(dots, tool, max(cutting.gap(2 * dot.inner) for dot in dots) if tool.own_wall else 0.0)
    check_bores(marker.substrate.holes, tool)
    prints = [Footprint(dot.name, ((dot.x, dot.y),), reach(dot)) for dot in dots]
    if around is None:
        check_tag(marker, tool, cutting.corner, cutting.tag_gap)
        # The border of a tag encloses all of it.
        around = [Footprint("the tag", tuple(ink.corners()), cutting.tag_gap) for ink in tag_pieces(marker.tag)[:1]]
    rim = max((reach(dot) - dot.radius for dot in dots if dot.raised), default=0.0) + tool.wall
    poses = designed_poses(marker) if any(dot.raised for dot in dots) else None
    flat = [footprint for footprint, dot in zip(prints, dots, strict=True) if not dot.raised]
    plate = plate_of(marker)
    pillars, notes = pillars_of(marker, dots, fabrication, tool, plate, [*flat, *around], rim, poses)
    feet = [Footprint(PILLAR + p.dot.name, ((p.dot.x, p.dot.y),), p.base) for p in pillars]
    check_apart(marker, plate, [*flat, *around, *feet], tool)
    return Ground(dots, tuple(pillar.body for pillar in pillars), notes)


def inlay(dot: SolidDot, cutting: Cutting) -> tuple[tuple[Part, ...], Primitive]:
    """A dot's inlays, flush with its top, and the pocket that they fill; a ring has a light core."""
    top, bottom = dot.z, round(dot.z - cutting.depth, 9)
    pocket = cylinder(dot.x, dot.y, dot.radius + cutting.gap(2 * dot.radius), bottom, top)
    whole = Part(dot.name, "dark", (cylinder(dot.x, dot.y, dot.radius, bottom, top, dot.inner),))
    if not dot.inner:
        return (whole,), pocket
    radius = dot.inner - cutting.gap(2 * dot.inner)
    core = Part(f"{dot.name}-core", "light", (cylinder(dot.x, dot.y, radius, bottom, top),))
    return (whole, core), pocket


def tag_inlays(marker: Marker, cutting: Cutting) -> tuple[tuple[Part, ...], tuple[Primitive, ...]]:
    """A tag's inlays, named ``tag-<k>`` from 1, and their pockets.

    Both are rounded about the same arc centers, for an even gap.
    """
    gap, wall = cutting.tag_gap, cutting.tool.wall
    parts, pockets = [], []
    for number, ink in enumerate(tag_pieces(marker.tag), start=1):
        inner, outer = ink.contours(cutting.corner, wall + 2 * gap), ink.contours(cutting.corner, wall, gap)
        parts.append(Part(f"tag-{number}", "dark", (Prism(*inner, -cutting.depth, 0.0),)))
        pockets.append(Prism(*outer, -cutting.depth, 0.0))
    return tuple(parts), tuple(pockets)


def marks(marker: Marker, dots: Sequence[SolidDot], cutting: Cutting) -> tuple[Primitive, ...]:
    """Dots and tag as bodies to engrave."""
    engraved = [cylinder(dot.x, dot.y, dot.radius, round(dot.z - cutting.depth, 9), dot.z, dot.inner) for dot in dots]
    return (*engraved, *tag_inlays(marker, cutting)[1])


def inlaid(marker: Marker, ground: Ground, cutting: Cutting) -> tuple[tuple[Part, ...], tuple[Primitive, ...]]:
    """All inlays, those of the dots first, and their pockets."""
    inlays = [inlay(dot, cutting) for dot in ground.dots]
    parts, pockets = tag_inlays(marker, cutting)
    return (*(part for pieces, _ in inlays for part in pieces), *parts), (*(pocket for _, pocket in inlays), *pockets)
