"""Sections of a fabrication sheet: through one dot of each kind, one hole of each kind, and the edge of the plate."""

from collections.abc import Iterable, Sequence

from markergen.drawing.workshop import Section, Span
from markergen.drawing.workshop_front import millimeters
from markergen.model.marker import Marker
from markergen.solid.bodies import SAME, Part, Prism, mm
from markergen.solid.dot_geometry import SolidDot as Dot
from markergen.solid.processes import Made
from markergen.solid.sections import centered, cut_along, reach, seen, size_of, widest
from markergen.solid.workpiece_tables import DIAMETER, MOST_KINDS, use_words


def sections_of(marker: Marker, dots: Sequence[Dot], made: Made) -> tuple[Section, ...]:
    """All sections, with the sizes that the views do not show."""
    parts = made.parts
    return (*_dot_sections(dots, parts, made.face), *_hole_sections(marker, parts), *_edge(marker, made))


def alike(dots: Iterable[Dot]) -> list[tuple[tuple[float, float], list[Dot]]]:
    """Dots by their radius and inner radius."""
    groups: dict[tuple[float, float], list[Dot]] = {}
    for dot in dots:
        groups.setdefault((dot.radius, dot.inner), []).append(dot)
    return list(groups.items())


def _dot_sections(dots: Sequence[Dot], parts: Sequence[Part], face: float) -> list[Section]:
    """One section for each kind of dot, and of the raised ones of a kind through the highest."""
    bodies = [body for part in parts for body in (*part.add, *part.cut, *part.marked)]
    found = []
    for (_, inner), some in alike(dots)[:MOST_KINDS]:
        flat = [dot for dot in some if not dot.raised]
        raised = sorted((dot for dot in some if dot.raised), key=lambda dot: -dot.z)
        for dot in (*flat[:1], *raised[:1]):
            if any(centered(body, dot.x, dot.y) for body in bodies):
                what = "ring" if inner else "dot"
                found.append(_dot_section(dot, f"Section along x through {what} {dot.id}", parts, face))
    return found


def _dot_section(dot: Dot, title: str, parts: Sequence[Part], face: float) -> Section:
    x, y, z, radius, inner = dot.x, dot.y, dot.z, dot.radius, dot.inner
    plates = [part for part in parts if part.is_plate]
    pockets = [b for part in plates for b in (*part.cut, *part.marked) if centered(b, x, y)]
    pillars = [b for part in plates for b in part.add if centered(b, x, y)]
    wide = max([radius, *(widest(b) for b in (*pockets, *pillars) if b.span[1] > face - SAME)])
    low, _ = reach(plates)
    high = max([z, *(b.span[1] for part in parts for b in part.add if centered(b, x, y))])
    sizes = {round(radius, 6): "", round(inner, 6): ""}
    for body in pockets:
        sizes.setdefault(round(widest(body), 6), " pocket")
    for body in pillars:
        sizes.setdefault(round(widest(body), 6), " foot")
    spans = [
        Span(x - r, x + r, f"{DIAMETER}{millimeters(2 * r)}{words}") for r, words in sorted(sizes.items()) if r > SAME
    ]
    tall = {(low, face)}
    for body in pockets:
        bottom, top = body.span
        tall.add((round(bottom, 6), round(top, 6)))
    if z > face + SAME:
        tall.add((face, z))
    if high > max(z, face) + SAME:
        tall.add((face, high))
    upright = [Span(a, b, millimeters(b - a)) for a, b in sorted(tall, key=lambda pair: (pair[1] - pair[0], pair))]
    aside = wide + max(3.0, 0.2 * wide)
    box = (x - aside, low, x + aside, high)
    return Section(title, cut_along(parts, y, box), box, tuple(spans), tuple(upright), (x,))


def _hole_sections(marker: Marker, parts: Sequence[Part]) -> list[Section]:
    """One section for each kind of hole."""
    found: dict[tuple[float, float], Section] = {}
    low, _ = reach([part for part in parts if part.is_plate])
    for hole in marker.substrate.holes:
        if (hole.diameter, hole.sink) in found or len(found) == MOST_KINDS:
            continue
        x, y = mm(hole.x), mm(hole.y)
        radii = [mm(size) / 2 for size in (hole.diameter, hole.sink) if size]
        aside = max(radii) + max(2.0, 0.6 * max(radii))
        box = (x - aside, low, x + aside, 0.0)
        faces = cut_along(parts, y, box)
        top = max((face.box[3] for face in faces), default=0.0)
        spans = tuple(Span(x - r, x + r, f"{DIAMETER}{millimeters(2 * r)}") for r in radii)
        found[hole.diameter, hole.sink] = Section(
            f"Section through the hole {use_words(hole)}",
            faces,
            (box[0], low, box[2], top),
            spans,
            (Span(low, top, millimeters(top - low)),),
            (x,),
        )
    return list(found.values())


def _edge(marker: Marker, made: Made) -> list[Section]:
    """Section of an edge with a chamfer, or with a recess for a sheet next to it."""
    chamfer = mm(marker.substrate.chamfer)
    parts = made.parts
    plates = [part for part in parts if part.is_plate]
    width, _ = size_of([body for part in plates for body in part.add])
    recesses = [
        body
        for part in plates
        for body in part.cut
        if isinstance(body, Prism) and body.top > made.face - SAME and size_of([body])[0] > width / 2
    ]
    if not chamfer and not recesses:
        return []
    low = reach(plates)[0]
    ring = max((face for face in seen(plates)), key=lambda face: face.box[2]).rings[0]
    right = max(x for x, _ in ring)
    level = [y for x, y in ring if x > right - 1e-3]
    # In the middle of the outermost edge, or at the outermost point of an arc.
    y = (min(level) + max(level)) / 2
    left = right - max(6 * chamfer, 4.0)
    upright = {(low, made.face)}
    for body in recesses:
        left = min(left, max(x for x, _ in body.outer.points) - 4.0)
        upright.add((body.bottom, body.top))
    box = (left, low, right, made.face)
    faces = cut_along(parts, y, box)
    across = (Span(right - chamfer, right, f"{millimeters(chamfer)} x 45\xb0"),) if chamfer else ()
    heights = tuple(Span(a, b, millimeters(b - a)) for a, b in sorted(upright, key=lambda pair: pair[1] - pair[0]))
    return [Section("Section of the edge", faces, box, across, heights)] if faces else []
