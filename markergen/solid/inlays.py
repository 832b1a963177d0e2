"""What processes have in common: inlays with their pockets, the tag's, and pillars among whatever is cut."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.solid.bodies import Body, Part, Prism, cylinder
from markergen.solid.inks import Dot, dots_of, inlays_of
from markergen.solid.limits import Face, Footprint, Tool, check_apart, check_bores, check_dots, check_tag
from markergen.solid.relief import PILLAR, pillars_of, poses_of


@dataclass(frozen=True)
class Cutting:
    """How a process cuts; mm.

    Attributes
    ----------
    tool : Tool
    depth : float
        Of what is cut.
    corner : float
        Radius of the tag's corners.
    gap : callable
        Gap all around an inlay of that diameter.
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
    """Where a process cuts: the dots, the pillars under them, and sentences about these."""

    dots: tuple[Dot, ...]
    pillars: tuple[Body, ...]
    notes: tuple[str, ...]


def prepare(
    marker: Marker,
    fabrication: Fabrication,
    cutting: Cutting,
    reach: Callable[[Dot], float],
    around: Sequence[Footprint] | None = None,
) -> Ground:
    """Check that everything fits beside each other, and put pillars under raised dots.

    Parameters
    ----------
    reach : callable
        Radius in mm of what is cut for a dot.
    around : sequence of Footprint, optional
        What is cut besides; the tag's ink unless it is given.

    Raises
    ------
    InputError
        See `markergen.solid.limits` and `pillars_of`.
    """
    dots, tool = dots_of(marker), cutting.tool
    # A mill makes the bore rather than the core.
    check_dots(dots, tool, max(cutting.gap(2 * dot.inner) for dot in dots) if tool.own_wall else 0.0)
    check_bores(marker.substrate.holes, tool)
    prints = [Footprint(dot.name, ((dot.x, dot.y),), reach(dot)) for dot in dots]
    if around is None:
        check_tag(marker, tool, cutting.corner, cutting.tag_gap)
        # The border of a tag holds all of it.
        around = [Footprint("the tag", tuple(ink.hull()), cutting.tag_gap) for ink in inlays_of(marker.tag)[:1]]
    rim = max((reach(dot) - dot.radius for dot in dots if dot.raised), default=0.0) + tool.wall
    poses = poses_of(marker) if any(dot.raised for dot in dots) else None
    flat = [each for each, dot in zip(prints, dots, strict=True) if not dot.raised]
    face = Face(marker)
    pillars, notes = pillars_of(marker, dots, fabrication, tool, face, [*flat, *around], rim, poses)
    feet = [Footprint(PILLAR + p.dot.name, ((p.dot.x, p.dot.y),), p.base) for p in pillars]
    check_apart(marker, face, [*flat, *around, *feet], tool)
    return Ground(dots, tuple(pillar.body for pillar in pillars), notes)


def inlay(dot: Dot, cutting: Cutting) -> tuple[tuple[Part, ...], Body]:
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
    """A tag's inlays, named ``tag-<k>`` from 1 on, and their pockets."""
    parts, pockets = [], []
    for number, ink in enumerate(inlays_of(marker.tag), start=1):
        inner, outer = (ink.paths(cutting.corner, neck, grow) for neck, grow in _edges(cutting))
        parts.append(Part(f"tag-{number}", "dark", (Prism(*inner, -cutting.depth, 0.0),)))
        pockets.append(Prism(*outer, -cutting.depth, 0.0))
    return tuple(parts), tuple(pockets)


def tag_marks(marker: Marker, cutting: Cutting) -> tuple[Body, ...]:
    """A tag's ink as bodies to engrave."""
    return tag_inlays(marker, cutting)[1]


def inlaid(marker: Marker, ground: Ground, cutting: Cutting) -> tuple[tuple[Part, ...], tuple[Body, ...]]:
    """All inlays, those of the dots first, and their pockets."""
    each = [inlay(dot, cutting) for dot in ground.dots]
    parts, pockets = tag_inlays(marker, cutting)
    return (*(part for some, _ in each for part in some), *parts), (*(pocket for _, pocket in each), *pockets)


def sizes(dots: Sequence[Dot]) -> tuple[float, ...]:
    """Diameters in mm that there are, the largest first."""
    return tuple(sorted({round(2 * dot.radius, 6) for dot in dots}, reverse=True))


def _edges(cutting: Cutting) -> tuple[tuple[float, float], tuple[float, float]]:
    """Wall and growth of an inlay's outline and its pocket's: the same centers of the corners, so the gap is even."""
    gap, wall = cutting.tag_gap, cutting.tool.wall
    return (wall + 2 * gap, 0.0), (wall, gap)
