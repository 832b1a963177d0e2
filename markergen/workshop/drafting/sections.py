"""Sections of the fabrication drawing: one through each kind of dot and of hole, and one of the edge.

Sizes that are given elsewhere, with their tolerances, are in parentheses (auxiliary dimensions, ISO 129).
"""

from collections.abc import Iterable, Sequence

from markergen.drawing.scene import union
from markergen.geometry.contour import flattened
from markergen.model.marker import Marker
from markergen.solid.primitives import OFF, SAME, Part, Primitive, Prism, Revolved, span_of
from markergen.workshop.dot_geometry import SolidDot
from markergen.workshop.drafting.drawing import Dimension, SectionView, millimeters
from markergen.workshop.drafting.tolerances import DIAMETER, PLUS_MINUS, PlateHole, holes_of
from markergen.workshop.iso286 import DiscFit
from markergen.workshop.processes import Made
from markergen.workshop.projection import cut_along, seen

MOST_KINDS = 6
"""Maximum number of kinds of dots or holes with their own callouts and sections; more are listed in tables only."""

NEAR = 30.0
"""Maximum distance in mm of a recess from an edge to be in its section."""


def sections_of(marker: Marker, made: Made, dots: Sequence[SolidDot]) -> tuple[SectionView, ...]:
    """All sections."""
    return (*_dot_sections(dots, made), *_hole_sections(marker, made.parts), *_edge_section(marker, made))


def alike(dots: Iterable[SolidDot]) -> list[tuple[tuple[float, float], list[SolidDot]]]:
    """Group dots by radius and inner radius."""
    groups: dict[tuple[float, float], list[SolidDot]] = {}
    for dot in dots:
        groups.setdefault((dot.radius, dot.inner), []).append(dot)
    return list(groups.items())


def _dot_sections(dots: Sequence[SolidDot], made: Made) -> list[SectionView]:
    """One section per kind of dot, and one through the highest raised dot."""
    bodies = [body for part in made.parts for body in (*part.add, *part.cut, *part.marked)]
    found = []
    for (_, inner), some in alike(dots)[:MOST_KINDS]:
        flat = [dot for dot in some if not dot.raised]
        raised = sorted((dot for dot in some if dot.raised), key=lambda dot: -dot.z)
        for dot in (*flat[:1], *raised[:1]):
            if centered(bodies, dot.x, dot.y):
                what = "ring" if inner else "dot"
                found.append(_dot_section(dot, f"Section along x through {what} {dot.id}", made))
    return found


def _dot_section(dot: SolidDot, title: str, made: Made) -> SectionView:
    x, y, z, face, parts = dot.x, dot.y, dot.z, made.face, made.parts
    plates = [part for part in parts if part.is_plate]
    low, _ = span_of(plates)
    pockets = centered([body for part in plates for body in (*part.cut, *part.marked)], x, y)
    pillars = centered([body for part in plates for body in part.add], x, y)
    wide = max([dot.radius, *(b.radii[1] for b in (*pockets, *pillars) if b.span[1] > face - SAME)])
    high = max([z, *(b.span[1] for b in centered([body for part in parts for body in part.add], x, y))])
    tall = {(round(bottom, 6), round(top, 6)): _depth(bottom, top, low, made) for bottom, top in
            (body.span for body in pockets)}  # fmt: skip
    tall[low, face] = f"({millimeters(face - low)})"
    if z > face + SAME:
        tall[face, z] = f"{millimeters(z - face)} {PLUS_MINUS}{millimeters(made.accuracy.height)}"
    if high > max(z, face) + SAME:
        tall[face, high] = f"({millimeters(high - face)})"
    aside = wide + max(3.0, 0.2 * wide)
    box = (x - aside, low, x + aside, high)
    across = tuple(
        Dimension(x - r, x + r, words) for r, words in sorted(_diameters(dot, made, pockets, pillars).items())
    )
    return SectionView(title, cut_along(parts, y, box), box, across, upright(tall), (x,))


def _diameters(dot: SolidDot, made: Made, pockets: Sequence[Revolved], pillars: Sequence[Revolved]) -> dict[float, str]:
    """Words of the diameters at a dot, with its fit, by their radii as drawn."""

    def fitted(kind: str, radius: float) -> DiscFit | None:
        return next(
            (fit for name, fit in made.fits if name == kind and abs(fit.disc.diameter - 2 * radius) < SAME), None
        )

    fit, core = fitted("dot", dot.radius), fitted("core", dot.inner)
    most = f" {PLUS_MINUS}{millimeters(made.accuracy.diameter)}" if made.accuracy.position else ""
    sizes: dict[float, str] = {}
    if fit and not fit.gap:
        sizes[round(dot.radius, 6)] = f"{DIAMETER}{millimeters(2 * dot.radius)} {fit.pocket.name}/{fit.disc.name}"
    elif fit:
        sizes[round(dot.radius, 6)] = f"{DIAMETER}{millimeters(2 * dot.radius)} {fit.disc.words}"
    else:
        sizes[round(dot.radius, 6)] = f"{DIAMETER}{millimeters(2 * dot.radius)}{most}"
    if dot.inner:
        bore = f" {core.pocket.words}" if core else most
        sizes[round(dot.inner, 6)] = f"{DIAMETER}{millimeters(2 * dot.inner)}{bore}"
    for body in pockets:
        r = round(body.radii[1], 6)
        words = f"{DIAMETER}{millimeters(2 * r)}"
        if fit and abs(r - dot.radius - fit.gap) < SAME:
            words = f"{DIAMETER}{millimeters(fit.pocket.diameter)} {fit.pocket.words}"
        sizes.setdefault(r, f"{words} pocket")
    for body in pillars:
        sizes.setdefault(round(body.radii[1], 6), f"({DIAMETER}{millimeters(2 * body.radii[1])}) foot")
    return sizes


def _depth(bottom: float, top: float, low: float, made: Made) -> str:
    """Depth of a pocket with its tolerance, which a hole through the plate does not need."""
    depth = millimeters(top - bottom)
    if bottom < low + SAME:
        return f"({depth})"
    return f"{depth} +{millimeters(made.accuracy.depth)} / 0" if made.accuracy.depth else f"{depth} max."


def _hole_sections(marker: Marker, parts: Sequence[Part]) -> list[SectionView]:
    """One section per kind of hole."""
    found: dict[tuple[float, float], SectionView] = {}
    low, _ = span_of([part for part in parts if part.is_plate])
    for hole in holes_of(marker):
        if hole.use == "drawn" or (hole.radius, hole.sink) in found or len(found) == MOST_KINDS:
            continue
        widest = max(hole.radius, hole.sink)
        aside = widest + max(2.0, 0.6 * widest)
        box = (hole.x - aside, low, hole.x + aside, 0.0)
        faces = cut_along(parts, hole.y, box)
        top = max((face.box[3] for face in faces), default=0.0)
        across = [_across(hole, hole.radius, f" {hole.limits.words}" if hole.limits else "")]
        if hole.sink:
            across.append(_across(hole, hole.sink, " x 90\xb0"))
        found[hole.radius, hole.sink] = SectionView(
            f"Section through hole {hole.label}, {use_words(hole)}",
            faces,
            (box[0], low, box[2], top),
            tuple(across),
            upright({(low, top): f"({millimeters(top - low)})"}),
            (hole.x,),
        )
    return list(found.values())


def _across(hole: PlateHole, radius: float, more: str) -> Dimension:
    return Dimension(hole.x - radius, hole.x + radius, f"{DIAMETER}{millimeters(2 * radius)}{more}")


def use_words(hole: PlateHole) -> str:
    """Use of a hole: ``for screw M3``, ``for a 4 mm pin``."""
    name = hole.name[:24]
    if hole.use == "drawn":
        return "in the outline"
    if hole.use == "dowel":
        return f"for a {name or 'dowel pin'}"
    return f"for screw {name}" if name else "for a screw"


def recesses_of(made: Made) -> list[Prism]:
    """Recesses for printed sheets: open to the face of the plate, without inlays."""
    plates = [part for part in made.parts if part.is_plate]
    inlays = [body.box for part in made.parts if not part.is_plate for body in part.add]
    return [
        body
        for part in plates
        for body in part.cut
        if isinstance(body, Prism)
        and body.top > made.face - SAME
        and not any(union(body.box, inlay) == body.box for inlay in inlays)
    ]


def _edge_section(marker: Marker, made: Made) -> list[SectionView]:
    """Section of an edge that has a chamfer, or a sheet's recess next to it."""
    chamfer = round(1e3 * marker.substrate.chamfer, 9)
    plates = [part for part in made.parts if part.is_plate]
    low, _ = span_of(plates)
    outermost = max((face for face in seen(plates)), key=lambda face: face.box[2])
    ring = flattened(outermost.contours[0], OFF)
    right = max(x for x, _ in ring)
    recesses = [body for body in recesses_of(made) if right - body.box[2] < NEAR]
    if not chamfer and not recesses:
        return []
    level = [y for x, y in ring if x > right - 1e-3]
    # At the middle of the outermost edge, or the outermost point of an arc.
    y = (min(level) + max(level)) / 2
    left = min([right - max(6 * chamfer, 4.0), *(body.box[2] - 4.0 for body in recesses)])
    box = (left, low, right, made.face)
    faces = cut_along(made.parts, y, box)
    across = (Dimension(right - chamfer, right, f"{millimeters(chamfer)} x 45\xb0"),) if chamfer else ()
    tall = {body.span: _depth(*body.span, low, made) for body in recesses}
    tall[low, made.face] = f"({millimeters(made.face - low)})"
    return [SectionView("Section of the edge", faces, box, across, upright(tall))] if faces else []


def centered(bodies: Iterable[Primitive], x: float, y: float) -> list[Revolved]:
    """Bodies of revolution about the vertical axis through (x, y), within a micron."""
    return [b for b in bodies if isinstance(b, Revolved) and abs(b.x - x) < 1e-3 and abs(b.y - y) < 1e-3]


def upright(heights: dict[tuple[float, float], str]) -> tuple[Dimension, ...]:
    """Dimensions along z, the shortest first."""
    ordered = sorted(heights, key=lambda pair: (pair[1] - pair[0], pair))
    return tuple(Dimension(low, high, heights[low, high]) for low, high in ordered)
