"""Content of the fabrication drawing: the views, sections, tables, callouts and notes that describe a marker.

`workpiece` describes the parts made by a process as plain data of `markergen.drawing.fabrication_drawing`, which lays
them out. Tables are rows of text, ready to be set.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from math import dist, hypot

from markergen.drawing.fabrication_drawing import (
    Callout,
    Dimension,
    DotLabel,
    DrawingTable,
    SectionView,
    ViewFace,
    Workpiece,
    millimeters,
)
from markergen.drawing.figure import size_words
from markergen.geometry.contour import Contour, area, center_of, flattened, placed, radius_of
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker, marker_name
from markergen.model.substrate import Hole
from markergen.solid.bodies import OFF, OTHER, SAME, Body, Part, Prism, Revolved, cylinder, mm, size_of, span_of
from markergen.solid.dot_geometry import SolidDot, dots_of
from markergen.solid.processes import Made
from markergen.solid.projection import BACK, cut_along, elevation, seen

DIAMETER = "\xd8"

DRAWN = "in the outline"
"""Use of a hole that is part of an outline from a drawing."""

LONGEST_NAME = 24
"""Maximum number of characters of the name of a screw or a pin."""

MOST_KINDS = 6
"""Maximum number of kinds of dots or holes with their own callouts and sections; more are listed in tables only."""

FRAME = (
    "All coordinates are in the marker frame: origin and axes as drawn, z out of the face toward the viewer, z = 0 in "
    "the plane of the dots that are not raised."
)
MEASURE = (
    "Take sizes from the dimensions and tables, never from the drawing. The exact geometry is in the STEP file of the "
    "same name."
)
AFTERWARDS = (
    "What counts is where the centers of the dots are. Where they were measured on the finished marker, enter them "
    "with: markergen rescale marker.json --measured-points dots.csv -o measured.json"
)


def workpiece(marker: Marker, fabrication: Fabrication, made: Made) -> Workpiece:
    """Describe a marker as designed, and its parts from `parts_of`, for its fabrication drawing."""
    dots, parts = dots_of(marker), made.parts
    plates = [part for part in parts if part.is_plate]
    low, high = span_of(plates)
    face = made.face
    highest = span_of(parts)[1]
    heights = [(low, face)]
    if high > face + SAME:
        heights.append((face, high))
    if highest > high + SAME:
        heights.append((face, highest))
    if face < -SAME:
        heights.append((face, 0.0))
    return Workpiece(
        name=marker_name(marker),
        title=f"Fiducial marker, {len(dots)} dot{'s' * (len(dots) > 1)}, {size_words(marker.boundary)}",
        process=PROCESSES[fabrication.process].label,
        materials=_materials(parts),
        front=(*seen(parts), *_printed(marker, dots, parts)),
        side=elevation(parts),
        back=_back(parts),
        size=size_of([body for part in parts for body in part.add]),
        round=[plate.is_disk for plate in plates] == [True],
        labels=tuple(DotLabel(str(dot.id), dot.x, dot.y, dot.radius, dot.inner) for dot in dots),
        callouts=(
            *_dot_callouts(dots, fabrication),
            *_hole_callouts(marker.substrate.holes),
            *_drawn_callouts(marker),
            *_tag_callout(marker),
        ),
        heights=_upright(heights),
        sections=(*_dot_sections(dots, parts, face), *_hole_sections(marker, parts), *_edge_section(marker, made)),
        tables=tables_of(marker, made),
        notes=(FRAME, MEASURE, *_plate_notes(marker), *made.lines, AFTERWARDS),
    )


def _back(parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """View of the back, if it shows more than the outline and the holes visible from the front."""
    plates = [part for part in parts if part.is_plate]
    blank = seen([replace(part, cut=(), marked=()) for part in plates], BACK)
    # Letters are filled to be legible; through holes stay empty. A plate still hides what is behind it.
    faces = [
        replace(face, material="dark", fine=True) if face.material and face not in blank else face
        for face in seen(plates, BACK)
    ]
    return tuple(faces) if any(face.material and face.fine for face in faces) else ()


def _materials(parts: Sequence[Part]) -> str:
    kinds: dict[str, list[str]] = {}
    for part in parts:
        what = "core of the ring" if part.name.endswith("-core") else part.name.split("-")[0]
        kinds.setdefault(part.material, []).append("dots" if what == "dot" else what)
        if part.marked:
            kinds.setdefault(OTHER[part.material], []).append("engraving")
    return "; ".join(f"{material}: {', '.join(dict.fromkeys(names))}" for material, names in kinds.items())


def _printed(marker: Marker, dots: Sequence[SolidDot], parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """Dots and tag printed on a sheet, which are neither parts nor engraved nor holes."""
    low, _ = span_of(parts)
    if any(not part.is_plate or part.marked for part in parts):
        return ()
    cut = [body for part in parts for body in part.cut]
    printed = [
        cylinder(dot.x, dot.y, dot.radius, -1.0, 0.0, dot.inner)
        for dot in dots
        if not any(body.span[0] < low + SAME for body in _centered(cut, dot.x, dot.y))
    ]
    faces = list(seen([Part("dot", "dark", tuple(printed))])) if printed else []
    if marker.tag and printed:
        rings = tuple(Contour(tuple((mm(x), mm(y)) for x, y in ring.tolist())) for ring in marker.tag.outlines)
        faces.append(ViewFace(rings, "dark"))
    return tuple(replace(face, fine=True) for face in faces)


def _dot_callouts(dots: Sequence[SolidDot], fabrication: Fabrication) -> list[Callout]:
    found = []
    kinds = _alike(dots)
    if len(kinds) > MOST_KINDS:
        places = tuple((dot.x, dot.y, dot.radius) for dot in dots)
        return [Callout((f"{len(places)} dots of {len(kinds)} sizes", "see the table"), places)]
    for (radius, inner), some in kinds:
        count = f"{len(some)}x " if len(some) > 1 else ""
        # S stands for a sphere (ISO 129).
        sphere = "S" if PROCESSES[fabrication.process].balls else ""
        size = f"{sphere}{DIAMETER}{millimeters(2 * radius)}"
        ring = f" / {DIAMETER}{millimeters(2 * inner)}" if inner else ""
        which = "ring" if inner else "dot"
        names = f"{which}{'s' if len(some) > 1 else ''} {ranges([dot.id for dot in some])}"
        places = tuple((dot.x, dot.y, dot.radius) for dot in some)
        found.append(Callout((f"{count}{size}{ring}", names), places))
    return found


def _kinds(holes: Sequence[Hole]) -> list[list[Hole]]:
    """Group holes of the same kind that are equally far from the origin."""

    def kind(hole: Hole) -> tuple[str, str, float, float, float]:
        return hole.use, hole.name, hole.diameter, hole.sink, round(hypot(hole.x, hole.y), 9)

    return [list(group) for _, group in groupby(sorted(holes, key=kind), key=kind)]


def _hole_callouts(holes: Sequence[Hole]) -> list[Callout]:
    found = []
    kinds = _kinds(holes)
    if len(kinds) > MOST_KINDS:
        places = tuple((mm(hole.x), mm(hole.y), mm(hole.radius)) for hole in holes)
        return [Callout((f"{len(places)} holes through", "see the table"), places)]
    for group in kinds:
        first = group[0]
        count = f"{len(group)}x " if len(group) > 1 else ""
        pitch = mm(hypot(first.x, first.y)) if len(group) > 1 else 0.0
        lines = [f"{count}{DIAMETER}{millimeters(mm(first.diameter))} through", use_words(first)]
        if first.sink:
            lines.append(f"countersunk {DIAMETER}{millimeters(mm(first.sink))} x 90\xb0")
        if pitch:
            lines.append(f"on a pitch circle {DIAMETER}{millimeters(2 * pitch)}")
        places = tuple((mm(hole.x), mm(hole.y), mm(hole.radius)) for hole in group)
        found.append(Callout(tuple(filter(None, lines)), places, pitch))
    return found


def _drawn_callouts(marker: Marker) -> list[Callout]:
    """Callouts of an outline's own round holes (diameter, pitch circle) and of its other arcs (radius)."""
    holes: dict[tuple[float, float], list[tuple[float, float, float]]] = {}
    for x, y, r in drawn_holes(marker):
        holes.setdefault((round(r, 6), round(hypot(x, y), 6)), []).append((x, y, r))
    arcs: dict[float, list[tuple[float, float, float]]] = {}
    for contour in drawn_contours(marker):
        sides = contour.sides
        for k, side in enumerate(sides) if not contour.is_circle else ():
            # Consecutive arcs of one circle, as for more than half a turn, count once.
            if side[2] and not (sides[k - 1][2] and dist(center_of(side), center_of(sides[k - 1])) < SAME):
                (x, y), (u, v), bulge = side
                middle = (x + u) / 2 + bulge / 2 * (v - y), (y + v) / 2 - bulge / 2 * (u - x), 0.0
                arcs.setdefault(round(radius_of(side), 4), []).append(middle)
    found = []
    for (r, pitch), places in sorted(holes.items()):
        pitch = pitch if len(places) > 1 else 0.0
        circle = (f"on a pitch circle {DIAMETER}{millimeters(2 * pitch)}",) if pitch else ()
        words = f"{_times(places)}{DIAMETER}{millimeters(2 * r)} through"
        found.append(Callout((words, *circle), tuple(places), pitch))
    if len(holes) > MOST_KINDS:
        places = [place for some in holes.values() for place in some]
        found = [Callout((f"{len(places)} holes of the outline", "see the table"), tuple(places))]
    if len(arcs) > MOST_KINDS:
        places = [place for some in arcs.values() for place in some]
        return [*found, Callout((f"{len(places)} arcs of {len(arcs)} radii", "see the STEP file"), tuple(places))]
    return found + [Callout((f"{_times(some)}R{millimeters(r)}",), tuple(some)) for r, some in sorted(arcs.items())]


def _times(places: Sequence[object]) -> str:
    return f"{len(places)}x " if len(places) > 1 else ""


def _tag_callout(marker: Marker) -> list[Callout]:
    if marker.tag is None:
        return []
    side = mm(marker.tag.side)
    x, y = (mm(center) for center in marker.tag.center)
    words = (f"tag {marker.tag}", f"black square {millimeters(side)} x {millimeters(side)}")
    return [Callout(words, ((x + side / 2, y + side / 4, 0.0),))]


def _plate_notes(marker: Marker) -> list[str]:
    substrate = marker.substrate
    said = []
    if substrate.corner_radius:
        said.append(f"corners of the plate seen from above R{millimeters(mm(substrate.corner_radius))}")
    if substrate.chamfer:
        said.append(f"chamfer around the face {millimeters(mm(substrate.chamfer))} x 45\xb0")
    words = ", ".join(said)
    return [f"{words[0].upper()}{words[1:]}."] if words else []


def _alike(dots: Iterable[SolidDot]) -> list[tuple[tuple[float, float], list[SolidDot]]]:
    """Group dots by radius and inner radius."""
    groups: dict[tuple[float, float], list[SolidDot]] = {}
    for dot in dots:
        groups.setdefault((dot.radius, dot.inner), []).append(dot)
    return list(groups.items())


def _dot_sections(dots: Sequence[SolidDot], parts: Sequence[Part], face: float) -> list[SectionView]:
    """One section per kind of dot, and one through the highest raised dot."""
    bodies = [body for part in parts for body in (*part.add, *part.cut, *part.marked)]
    found = []
    for (_, inner), some in _alike(dots)[:MOST_KINDS]:
        flat = [dot for dot in some if not dot.raised]
        raised = sorted((dot for dot in some if dot.raised), key=lambda dot: -dot.z)
        for dot in (*flat[:1], *raised[:1]):
            if _centered(bodies, dot.x, dot.y):
                what = "ring" if inner else "dot"
                found.append(_dot_section(dot, f"Section along x through {what} {dot.id}", parts, face))
    return found


def _dot_section(dot: SolidDot, title: str, parts: Sequence[Part], face: float) -> SectionView:
    x, y, z, radius, inner = dot.x, dot.y, dot.z, dot.radius, dot.inner
    plates = [part for part in parts if part.is_plate]
    low, _ = span_of(plates)
    pockets = _centered([body for part in plates for body in (*part.cut, *part.marked)], x, y)
    pillars = _centered([body for part in plates for body in part.add], x, y)
    wide = max([radius, *(b.radii[1] for b in (*pockets, *pillars) if b.span[1] > face - SAME)])
    high = max([z, *(b.span[1] for b in _centered([body for part in parts for body in part.add], x, y))])
    sizes = {round(radius, 6): "", round(inner, 6): ""}
    for bodies, words in ((pockets, " pocket"), (pillars, " foot")):
        for body in bodies:
            sizes.setdefault(round(body.radii[1], 6), words)
    across = [
        Dimension(x - r, x + r, f"{DIAMETER}{millimeters(2 * r)}{words}")
        for r, words in sorted(sizes.items())
        if r > SAME
    ]
    tall = {(low, face), *((round(bottom, 6), round(top, 6)) for bottom, top in (body.span for body in pockets))}
    if z > face + SAME:
        tall.add((face, z))
    if high > max(z, face) + SAME:
        tall.add((face, high))
    aside = wide + max(3.0, 0.2 * wide)
    box = (x - aside, low, x + aside, high)
    return SectionView(title, cut_along(parts, y, box), box, tuple(across), _upright(tall), (x,))


def _hole_sections(marker: Marker, parts: Sequence[Part]) -> list[SectionView]:
    """One section per kind of hole."""
    found: dict[tuple[float, float], SectionView] = {}
    low, _ = span_of([part for part in parts if part.is_plate])
    for hole in marker.substrate.holes:
        if (hole.diameter, hole.sink) in found or len(found) == MOST_KINDS:
            continue
        x, y = mm(hole.x), mm(hole.y)
        radii = [mm(size) / 2 for size in (hole.diameter, hole.sink) if size]
        aside = max(radii) + max(2.0, 0.6 * max(radii))
        box = (x - aside, low, x + aside, 0.0)
        faces = cut_along(parts, y, box)
        top = max((face.box[3] for face in faces), default=0.0)
        across = tuple(Dimension(x - r, x + r, f"{DIAMETER}{millimeters(2 * r)}") for r in radii)
        found[hole.diameter, hole.sink] = SectionView(
            f"Section through the hole {use_words(hole)}",
            faces,
            (box[0], low, box[2], top),
            across,
            _upright([(low, top)]),
            (x,),
        )
    return list(found.values())


def _edge_section(marker: Marker, made: Made) -> list[SectionView]:
    """Section of an edge that has a chamfer, or a sheet's recess next to it."""
    chamfer = mm(marker.substrate.chamfer)
    plates = [part for part in made.parts if part.is_plate]
    width, _ = size_of([body for part in plates for body in part.add])
    recesses = [
        body
        for part in plates
        for body in part.cut
        if isinstance(body, Prism) and body.top > made.face - SAME and size_of([body])[0] > width / 2
    ]
    if not chamfer and not recesses:
        return []
    low, _ = span_of(plates)
    outermost = max((face for face in seen(plates)), key=lambda face: face.box[2])
    ring = flattened(outermost.contours[0], OFF)
    right = max(x for x, _ in ring)
    level = [y for x, y in ring if x > right - 1e-3]
    # At the middle of the outermost edge, or the outermost point of an arc.
    y = (min(level) + max(level)) / 2
    left = min([right - max(6 * chamfer, 4.0), *(body.box[2] - 4.0 for body in recesses)])
    box = (left, low, right, made.face)
    faces = cut_along(made.parts, y, box)
    across = (Dimension(right - chamfer, right, f"{millimeters(chamfer)} x 45\xb0"),) if chamfer else ()
    heights = _upright({(low, made.face), *(body.span for body in recesses)})
    return [SectionView("Section of the edge", faces, box, across, heights)] if faces else []


def _centered(bodies: Iterable[Body], x: float, y: float) -> list[Revolved]:
    """Bodies of revolution about the vertical axis through (x, y), within a micron."""
    return [b for b in bodies if isinstance(b, Revolved) and abs(b.x - x) < 1e-3 and abs(b.y - y) < 1e-3]


def _upright(heights: Iterable[tuple[float, float]]) -> tuple[Dimension, ...]:
    """Dimensions along z, the shortest first."""
    ordered = sorted(heights, key=lambda pair: (pair[1] - pair[0], pair))
    return tuple(Dimension(low, high, millimeters(high - low)) for low, high in ordered)


def tables_of(marker: Marker, made: Made) -> tuple[DrawingTable, ...]:
    """Tables of control points, any holes, the tag's corners, parts, and tolerances."""
    points = DrawingTable(
        "Control points: centers of the dots, mm",
        ("id", "x", "y", "z", "diameter", "inner"),
        tuple(
            (
                str(p.id),
                *(_fixed(value) for value in (p.x, p.y, p.z)),
                millimeters(mm(p.feature.diameter)),
                millimeters(mm(p.feature.inner_diameter)) if p.feature.inner_diameter else "-",
            )
            for p in marker.control_points
        ),
    )
    tables = [points]
    drawn = drawn_holes(marker)
    if marker.substrate.holes or drawn:
        rows = tuple(
            (
                _fixed(hole.x),
                _fixed(hole.y),
                millimeters(mm(hole.diameter)),
                millimeters(mm(hole.sink)) if hole.sink else "-",
                use_words(hole),
            )
            for hole in marker.substrate.holes
        )
        rows += tuple((f"{x:.4f}", f"{y:.4f}", millimeters(2 * r), "-", DRAWN) for x, y, r in drawn)
        tables.append(DrawingTable("Holes through the plate, mm", ("x", "y", "diameter", "sink", "use"), rows, (4,)))
    if marker.tag:
        names = ("top left", "top right", "bottom right", "bottom left")
        corners = tuple(
            (name, _fixed(x), _fixed(y)) for name, (x, y) in zip(names, marker.tag.corners.tolist(), strict=True)
        )
        tables.append(
            DrawingTable(f"Corners of the black square of {marker.tag}, mm", ("corner", "x", "y"), corners, (0,))
        )
    tables.append(_part_list(made.parts))
    if made.tolerances:
        tables.append(DrawingTable("Tolerances", ("what", "tolerance"), made.tolerances, (0, 1)))
    return tuple(tables)


def drawn_contours(marker: Marker) -> list[Contour]:
    """Contours in mm of a plate outline from a drawing if it has arcs; else none."""
    outline = marker.substrate.outline or marker.boundary
    return [placed(contour, 1e3, digits=9) for contour in outline.contours()] if outline.has_arcs else []


def drawn_holes(marker: Marker) -> list[tuple[float, float, float]]:
    """Center x, y and radius in mm of the round holes that are part of the plate's outline."""
    holes = [contour.as_circle for contour in drawn_contours(marker) if area(contour) < 0]
    return [(x + 0.0, y + 0.0, r) for x, y, r in filter(None, holes)]


def _part_list(parts: Sequence[Part]) -> DrawingTable:
    groups: dict[tuple[str, str, str], list[str]] = {}
    for part in parts:
        key = part.material, _size(part), f"{part.volume / 1e3:.3f}"
        groups.setdefault(key, []).append(part.name)
    rows = tuple(
        (str(len(names)), _names(names), material, size, volume) for (material, size, volume), names in groups.items()
    )
    return DrawingTable("Parts", ("pieces", "name", "material", "size, mm", "volume each, cm\xb3"), rows, (1, 2, 3))


def _size(part: Part) -> str:
    """Diameters and height of a round part; width, height and thickness of others."""
    low, high = part.span
    if len(part.add) == 1 and isinstance(part.add[0], Revolved):
        least, most = part.add[0].radii
        inner = f" / {DIAMETER}{millimeters(2 * least)}" if least > SAME else ""
        return f"{DIAMETER}{millimeters(2 * most)}{inner} x {millimeters(high - low)}"
    width, height = size_of(part.add)
    if part.is_disk:
        return f"{DIAMETER}{millimeters(width)} x {millimeters(high - low)}"
    return f"{millimeters(width)} x {millimeters(height)} x {millimeters(high - low)}"


def _names(names: Sequence[str]) -> str:
    """Abbreviate long lists of part names: ``dot-1, dot-3 to dot-5``."""
    stems: dict[tuple[str, str], list[int]] = {}
    words = []
    for name in names:
        stem, _, rest = name.partition("-")
        number, _, suffix = rest.partition("-")
        if number.isdecimal():
            stems.setdefault((stem, suffix), []).append(int(number))
        else:
            words.append(name)
    for (stem, suffix), numbers in stems.items():
        words.append(f"{stem}-{ranges(numbers)}" + (f" {suffix}" if suffix else ""))
    return ", ".join(words)


def ranges(numbers: Iterable[int]) -> str:
    """Abbreviate a list of integers: ``1 to 4, 7``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words: list[str] = []
    for run in runs:
        words += [str(run[0])] if len(run) == 1 else [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
    return ", ".join(words)


def use_words(hole: Hole) -> str:
    """Use of a hole: ``for screw M3``, ``for a 4 mm pin``."""
    name = hole.name[:LONGEST_NAME]
    if hole.use == "dowel":
        return f"for a {name or 'dowel pin'}"
    return f"for screw {name}" if name else "for a screw"


def _fixed(meters: float) -> str:
    # Adding 0 turns -0 into 0.
    return f"{round(meters * 1e3, 4) + 0.0:.4f}"
