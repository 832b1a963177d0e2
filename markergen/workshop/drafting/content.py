"""Content of the fabrication drawing: the views, sections, tables, callouts and notes that describe a marker.

`workpiece` describes the parts made by a process as plain data of `markergen.workshop.drafting.drawing`, which lays
them out. What it says is meant to be enough: whoever has only the drawing can make the marker.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, ceil, degrees, tan

from markergen.drawing.figure import size_words
from markergen.drawing.scene import Disk
from markergen.geometry.contour import Contour, box, flattened, radius_of
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker, marker_name
from markergen.solid.plate import plate_of
from markergen.solid.primitives import OFF, SAME, Part, Primitive, Revolved, cylinder, mm, size_of, span_of
from markergen.workshop import engraving
from markergen.workshop.dot_geometry import SolidDot, dots_of
from markergen.workshop.drafting.callouts import callouts_of, datums_of, flat, located_holes, tolerance_tables
from markergen.workshop.drafting.drawing import (
    Callout,
    Control,
    Dimension,
    DrawingTable,
    EngravedText,
    SectionView,
    TitleBlock,
    ViewFace,
    Workpiece,
    fixed,
    millimeters,
)
from markergen.workshop.drafting.features import (
    DIAMETER,
    MOST_KINDS,
    PLUS_MINUS,
    PlateHole,
    alike,
    centered,
    diameter,
    is_through,
    listed_outlines,
    ranges,
    recesses_of,
    use_words,
)
from markergen.workshop.iso286 import DiscFit
from markergen.workshop.processes import Accuracy, Made
from markergen.workshop.projection import BACK, cut_along, elevation, seen

BOXED = (
    "Coordinates in tables and sizes in boxes are theoretically exact: the zones of the positions are centered there. "
    "Sizes in parentheses, and those that sections and tables repeat, are given elsewhere."
)
FRAME = (
    "Marker frame: origin and axes as drawn, z out of the face toward the viewer, z = 0 in the plane of the dots that "
    "are not raised."
)
MEASURE = (
    "Take sizes from dimensions and tables, never from the drawing. The exact geometry is in the STEP file of the same "
    "name."
)
AFTERWARDS = (
    "What counts is where the centers of the dots are in the datums. If they are measured on the finished marker, "
    "supply x, y and z of each with the uncertainty of the measurement."
)
PATTERN = (
    "CZ: all zones to the same datums together are one pattern (SIM, ISO 5458), which the datums leave free to turn or "
    "to move."
)
REAMED = "Ream or bore {} after all else, in one setting with the dots where these are milled: they locate the plate."
APART = "The plates are separate: each is made by itself, and mounted so that all dots are at their coordinates."


def workpiece(marker: Marker, fabrication: Fabrication, made: Made) -> Workpiece:
    """Describe a marker as designed, and its parts from `parts_of`, for its fabrication drawing."""
    dots, parts, holes = dots_of(marker), made.parts, located_holes(marker, fabrication, made)
    datums = datums_of(marker, made, holes, fabrication.datums)
    sections = (*_dot_sections(dots, made), *_hole_sections(holes, made), *_edge_section(marker, made))
    back = _back(made)
    callouts = callouts_of(marker, fabrication, made, datums, holes)
    return Workpiece(
        block=title_block(
            marker_name(marker),
            f"Fiducial marker, {len(dots)} dot{'s' * (len(dots) > 1)}, {size_words(marker.boundary)}",
            fabrication,
            made.accuracy,
        ),
        front=(*seen(parts), *_printed(marker, dots, parts)),
        side=elevation(parts),
        back=back,
        engraved=_back_texts(made) if back else (),
        size=size_of([body for part in parts for body in part.add]),
        round=[plate.is_disk for plate in made.plates] == [True],
        listed=any(outline.plate for outline in listed_outlines(marker, made)),
        face=made.face,
        flatness=flat(made),
        parallelism=Control("parallelism", flat(made).zone, ("A",)),
        datums=datums,
        labels=tuple(Disk(dot.x, dot.y, dot.radius, dot.inner, str(dot.id)) for dot in dots),
        holes=tuple(Disk(*hole.place, max(hole.radius, hole.sink), name=hole.label) for hole in holes),
        callouts=callouts,
        heights=_heights(made),
        sections=sections,
        tables=(
            *tables_of(marker, made, holes),
            *tolerance_tables(made, datums, fabrication.general_tolerance, holes, dots, bool(back)),
        ),
        key=_key(made, bool(back), bool(sections)),
        notes=tuple(_notes(marker, made, callouts, back, holes)),
    )


def title_block(name: str, title: str, fabrication: Fabrication, accuracy: Accuracy) -> TitleBlock:
    """Title block of a drawing of a marker, or of a rig."""
    process, general = PROCESSES[fabrication.process].label, fabrication.general_tolerance
    return TitleBlock(name, title, process, fabrication.material, general, accuracy.finish, accuracy.edges)


def _heights(made: Made) -> tuple[Dimension, ...]:
    """Heights in the side view: the plate's thickness with its tolerance, and what stands on it."""
    low, high = span_of(made.plates)
    face, highest, accuracy = made.face, span_of(made.parts)[1], made.accuracy
    labels = {(low, face): f"{millimeters(face - low)} {PLUS_MINUS}{millimeters(accuracy.thickness)}"}
    if high > face + SAME:
        labels[face, high] = f"{millimeters(high - face)} {PLUS_MINUS}{millimeters(accuracy.height)}"
    if highest > high + SAME:
        labels[face, highest] = f"({millimeters(highest - face)})"
    if face < -SAME:
        labels[face, 0.0] = f"{millimeters(-face)} {PLUS_MINUS}{millimeters(accuracy.height)}"
    return height_dimensions(labels)


def _back(made: Made) -> tuple[ViewFace, ...]:
    """View of the back without its letters, if anything is engraved there."""
    # Pillars are behind the plate, and would count as material below its holes.
    plates = [replace(part, add=part.add[:1]) for part in made.plates]
    blank = seen([replace(part, cut=(), marked=()) for part in plates], BACK)
    boxes = [text.box for text in _back_texts(made)]
    faces = []
    for face in seen(plates, BACK):
        left, bottom, right, top = face.box
        x, y = (left + right) / 2, (bottom + top) / 2
        floor = bool(face.material) and face not in blank
        if not floor:
            faces.append(face)
        elif not any(box[0] <= x <= box[2] and box[1] <= y <= box[3] for box in boxes):
            faces.append(replace(face, material="engraved"))
    return tuple(faces) if boxes or any(face.material == "engraved" for face in faces) else ()


def _back_texts(made: Made) -> tuple[EngravedText, ...]:
    """What is engraved, with x to the left as in the view of the back."""
    boxes = [(text, text.box) for text in made.engraved]
    return tuple(replace(text, box=(-right, low, -left, high)) for text, (left, low, right, high) in boxes)


def _key(made: Made, back: bool, sections: bool) -> tuple[tuple[str, str], ...]:
    """What fills and hatches mean, of those that there are."""
    dark = any(part.material == "dark" for part in made.parts)
    seen_dark = "dark surface" + ("" if dark else " (engraved)" if made.marked else " (printed)")
    return (
        ("dark", seen_dark),
        *((("cut-light", "light material, cut"),) if sections else ()),
        *((("cut-dark", "dark material, cut"),) if sections and dark else ()),
        *((("engraved", "engraved on the back"),) if back else ()),
    )


def _printed(marker: Marker, dots: Sequence[SolidDot], parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """Dots and tag printed on a sheet, which are neither parts nor engraved nor holes."""
    low, _ = span_of(parts)
    if any(not part.is_plate or part.marked for part in parts):
        return ()
    cut = [body for part in parts for body in part.cut]
    printed = [
        cylinder(dot.x, dot.y, dot.radius, -1.0, 0.0, dot.inner)
        for dot in dots
        if not any(body.span[0] < low + SAME for body in centered(cut, dot.x, dot.y))
    ]
    faces = list(seen([Part("dot", "dark", tuple(printed))])) if printed else []
    if marker.tag and printed:
        rings = tuple(Contour(tuple((mm(x), mm(y)) for x, y in ring.tolist())) for ring in marker.tag.outlines)
        faces.append(ViewFace(rings, "dark"))
    return tuple(replace(face, fine=True) for face in faces)


def _notes(
    marker: Marker, made: Made, callouts: Sequence[Callout], back: Sequence[ViewFace], holes: Sequence[PlateHole]
) -> list[str]:
    substrate, accuracy = marker.substrate, made.accuracy
    notes = [FRAME, BOXED, MEASURE]
    if accuracy.position:
        off, play = (ceil(length * 1e3 - 1e-6) / 1e3 for length in (accuracy.center, accuracy.play))
        where = f"{millimeters(accuracy.position / 2)} mm for the pocket, {millimeters(play)} mm for the play"
        notes.append(
            f"The center of a finished dot is off by at most {millimeters(off)} mm"
            f"{f', {where} in it' if accuracy.play else ''}."
        )
    if any("CZ" in control.zone for callout in callouts for control in callout.controls):
        notes.append(PATTERN)
    if len(plate_of(marker).outlines) > 1:
        notes.append(APART)
    if locating := [hole for hole in holes if hole.locates]:
        named = ", ".join(f"{hole.label} {hole.limits.name}" for hole in locating if hole.limits)
        notes.append(REAMED.format(named))
    if substrate.chamfer:
        notes.append(f"Chamfer around the face {millimeters(mm(substrate.chamfer))} x 45\xb0.")
    notes += made.lines
    if back:
        # What is engraved besides letters is the cross at the origin.
        cross = any(face.material == "engraved" for face in back)
        notes.append(_engraved(made, cross, len(marker.control_points)))
    return [*notes, AFTERWARDS]


def _engraved(made: Made, cross: bool, dots: int) -> str:
    title = next((text for text in made.engraved if text.lines[0].startswith("markergen")), None)
    names = [int(text.lines[0]) for text in made.engraved if text.lines[0].isdecimal()]
    ids = sorted({text.height for text in made.engraved if text.lines[0].isdecimal()})
    parts = []
    if title:
        lines = ", below it ".join(f'"{line}"' for line in title.lines)
        parts.append(f"{lines}, in letters whose capitals are {millimeters(title.height)} mm high")
    if ids:
        sizes = " or ".join(millimeters(height) for height in ids)
        behind = "the dots their ids" if len(names) == dots else f"dots {ranges(names)} their ids"
        parts.append(f"behind {behind}, {sizes} mm high")
    if cross:
        parts.append("at the origin a cross, with an arrow along x")
    return f"Engrave the back {millimeters(engraving.DEPTH)} mm deep, to be read from behind: {'; '.join(parts)}."


MOST_CORNERS = 40
"""Maximum number of corners of an outline that are listed; the solid has more."""


def tables_of(marker: Marker, made: Made, holes: Sequence[PlateHole]) -> tuple[DrawingTable, ...]:
    """Tables of control points, any holes, cut-outs, outline, pillars, the tag's corners, and parts."""
    is_raised = any(point.z for point in marker.control_points)
    points = DrawingTable(
        f"Centers of the dots, mm{'; x, y' if is_raised else ','} theoretically exact",
        ("id", "x", "y", "z", "diameter", "inner"),
        tuple(
            (
                str(p.id),
                *(fixed(mm(value)) for value in (p.x, p.y, p.z)),
                millimeters(mm(p.feature.diameter)),
                millimeters(mm(p.feature.inner_diameter)) if p.feature.inner_diameter else "-",
            )
            for p in marker.control_points
        ),
    )
    tables = [points]
    if holes:
        rows = tuple(
            (
                hole.label,
                fixed(hole.x),
                fixed(hole.y),
                f"{diameter(2 * hole.radius)}" + (f" {hole.limits.name}" if hole.limits else ""),
                millimeters(2 * hole.sink) if hole.sink else "-",
                use_words(hole),
            )
            for hole in holes
        )
        tables.append(
            DrawingTable(
                "Holes through the plate, mm; x, y theoretically exact",
                ("hole", "x", "y", "diameter", "countersink", "use"),
                rows,
                (0, 3, 5),
            )
        )
    tables += _outlines(marker, made)
    if pillars := _pillars(marker, made.add):
        headings = ("under dots", "height above A", "top", "base", "draft", "fillet")
        tables.append(DrawingTable("Pillars, mm: diameters without the fillet", headings, pillars, (0,)))
    if marker.tag:
        names = ("top left", "top right", "bottom right", "bottom left")
        places = marker.tag.corners.tolist()
        corners = tuple((name, fixed(mm(x)), fixed(mm(y))) for name, (x, y) in zip(names, places, strict=True))
        tables.append(
            DrawingTable(f"Corners of the black square of {marker.tag}, mm", ("corner", "x", "y"), corners, (0,))
        )
    return (*tables, _part_list(made.parts))


def _outlines(marker: Marker, made: Made) -> list[DrawingTable]:
    """Corners of outlines, or the center of a round one."""
    tables = []
    for outline in listed_outlines(marker, made):
        title, contour = outline.title, outline.contour
        if circle := contour.as_circle:
            x, y, radius = circle
            row = fixed(x), fixed(y), diameter(2 * radius)
            tables.append(DrawingTable(f"{title}, mm", ("center x", "center y", "diameter"), (row,)))
            continue
        left, bottom, right, top = box(contour)
        size = f"{millimeters(right - left)} x {millimeters(top - bottom)} mm"
        if len(contour.points) > MOST_CORNERS:
            corner_rows = ((f"{len(contour.points)} corners", "as in the STEP file"),)
            tables.append(DrawingTable(f"{title}, {size}", ("what", "where"), corner_rows, (0, 1)))
        else:
            tables.append(
                DrawingTable(f"{title}, {size}", ("corner x", "corner y", "to the next"), _corners(contour), (2,))
            )
    return tables


def _corners(contour: Contour) -> tuple[tuple[str, ...], ...]:
    def side(bulge: float, radius: float) -> str:
        return f"arc R{millimeters(radius)}, {'counterclockwise' if bulge > 0 else 'clockwise'}" if bulge else "line"

    return tuple((fixed(a[0]), fixed(a[1]), side(bulge, radius_of((a, b, bulge)))) for a, b, bulge in contour.sides)


def _pillars(marker: Marker, added: Sequence[Primitive]) -> tuple[tuple[str, ...], ...]:
    """Rows of pillars of the same shape."""
    groups: dict[tuple[str, ...], list[int]] = {}
    for dot in dots_of(marker):
        for body in centered(added, dot.x, dot.y):
            sides = body.profile.sides
            (r, z), (u, w), _ = next(side for side in sides if side[1] == body.profile.points[-2])
            draft = atan2(r - u, w - z)
            fillet = next((radius_of(side) for side in sides if side[2]), 0.0)
            sizes = millimeters(w), millimeters(2 * u), millimeters(2 * (u + w * tan(draft)))
            shape = (*(sizes[0], *(f"{DIAMETER}{size}" for size in sizes[1:])), f"{round(degrees(draft), 3) + 0:g}\xb0")
            groups.setdefault((*shape, f"R{millimeters(fillet)}" if fillet else "-"), []).append(dot.id)
    return tuple((ranges(ids), *shape) for shape, ids in groups.items())


def _part_list(parts: Sequence[Part]) -> DrawingTable:
    groups: dict[tuple[str, str, str], list[str]] = {}
    for part in parts:
        key = part.material, _size(part), f"{part.volume / 1e3:.3f}"
        groups.setdefault(key, []).append(part.name)
    rows = tuple(
        (str(len(names)), _names(names), material, size, volume) for (material, size, volume), names in groups.items()
    )
    return DrawingTable(
        "Parts", ("pieces", "name", "color", "size as drawn, mm", "volume each, cm\xb3"), rows, (1, 2, 3)
    )


def _size(part: Part) -> str:
    """Diameters and height of a round part; width, height and thickness of others."""
    low, high = part.span
    if len(part.add) == 1 and isinstance(part.add[0], Revolved):
        least, most = part.add[0].radii
        inner = f" / {diameter(2 * least)}" if least > SAME else ""
        return f"{diameter(2 * most)}{inner} x {millimeters(high - low)}"
    width, height = size_of(part.add)
    if part.is_disk:
        return f"{diameter(width)} x {millimeters(high - low)}"
    return f"{millimeters(width)} x {millimeters(height)} x {millimeters(high - low)}"


def _names(names: Sequence[str]) -> str:
    """Abbreviate long lists of part names: ``dot-1, dot-3 to dot-5``."""
    stems: dict[tuple[str, str], list[int]] = {}
    terms = []
    for name in names:
        stem, _, rest = name.partition("-")
        number, _, suffix = rest.partition("-")
        if number.isdecimal():
            stems.setdefault((stem, suffix), []).append(int(number))
        else:
            terms.append(name)
    for (stem, suffix), numbers in stems.items():
        terms.append(f"{stem}-{ranges(numbers)}" + (f" {suffix}" if suffix else ""))
    return ", ".join(terms)


NEAR = 30.0
"""Maximum distance in mm of a recess from an edge to be in its section."""


def _dot_sections(dots: Sequence[SolidDot], made: Made) -> list[SectionView]:
    """One section per kind of dot, and one through the highest raised dot."""
    bodies = [body for part in made.parts for body in (*part.add, *part.cut, *part.marked)]
    sections = []
    for (_, inner), group in alike(dots)[:MOST_KINDS]:
        flat = [dot for dot in group if not dot.raised]
        raised = sorted((dot for dot in group if dot.raised), key=lambda dot: -dot.z)
        for dot in (*flat[:1], *raised[:1]):
            if centered(bodies, dot.x, dot.y):
                what = "ring" if inner else "dot"
                sections.append(_dot_section(dot, f"Section along x through {what} {dot.id}", made))
    return sections


def _dot_section(dot: SolidDot, title: str, made: Made) -> SectionView:
    x, y, z, face, low, parts = dot.x, dot.y, dot.z, made.face, made.bottom, made.parts
    pockets = centered([body for part in made.plates for body in (*part.cut, *part.marked)], x, y)
    pillars = centered([body for part in made.plates for body in part.add], x, y)
    wide = max([dot.radius, *(b.radii[1] for b in (*pockets, *pillars) if b.span[1] > face - SAME)])
    high = max([z, *(b.span[1] for b in centered([body for part in parts for body in part.add], x, y))])
    tall = {
        (round(bottom, 6), round(top, 6)): _depth(bottom, top, made) for bottom, top in (body.span for body in pockets)
    }
    tall[low, face] = f"({millimeters(face - low)})"
    if z > face + SAME:
        tall[face, z] = f"{millimeters(z - face)} {PLUS_MINUS}{millimeters(made.accuracy.height)}"
    if high > max(z, face) + SAME:
        tall[face, high] = f"({millimeters(high - face)})"
    aside = wide + max(3.0, 0.2 * wide)
    box = (x - aside, low, x + aside, high)
    across = tuple(_across(x, r, label) for r, label in sorted(_diameters(dot, made, pockets, pillars).items()))
    return SectionView(title, cut_along(parts, y, box), box, across, height_dimensions(tall), (x,))


def _diameters(dot: SolidDot, made: Made, pockets: Sequence[Revolved], pillars: Sequence[Revolved]) -> dict[float, str]:
    """Words of the diameters at a dot, with its fit, by their radii as drawn."""

    def fitted(kind: str, radius: float) -> DiscFit | None:
        return next(
            (fit for name, fit in made.fits if name == kind and abs(fit.disc.diameter - 2 * radius) < SAME), None
        )

    fit = None if is_through(dot, made) else fitted("dot", dot.radius)
    core = fitted("core", dot.inner)
    most = f" {PLUS_MINUS}{millimeters(made.accuracy.diameter)}" if made.accuracy.position else ""
    sizes: dict[float, str] = {}
    if fit and not fit.gap:
        sizes[round(dot.radius, 6)] = f"{diameter(2 * dot.radius)} {fit.pocket.name}/{fit.disc.name}"
    elif fit:
        sizes[round(dot.radius, 6)] = f"{diameter(2 * dot.radius)} {fit.disc.words}"
    else:
        sizes[round(dot.radius, 6)] = f"{diameter(2 * dot.radius)}{most}"
    if dot.inner:
        bore = f" {core.pocket.words}" if core else most
        sizes[round(dot.inner, 6)] = f"{diameter(2 * dot.inner)}{bore}"
    for body in pockets:
        r = round(body.radii[1], 6)
        if fit and abs(r - dot.radius - fit.gap) < SAME:
            sizes.setdefault(r, f"{diameter(fit.pocket.diameter)} {fit.pocket.words} pocket")
        sizes.setdefault(r, f"{diameter(2 * r)}{most} pocket")
    for body in pillars:
        sizes.setdefault(round(body.radii[1], 6), f"({diameter(2 * body.radii[1])}) foot")
    return sizes


def _depth(bottom: float, top: float, made: Made) -> str:
    """Depth of a pocket with its tolerance, which a hole through the plate does not need."""
    depth = millimeters(top - bottom)
    if bottom < made.bottom + SAME:
        return f"({depth})"
    return f"{depth} +{millimeters(made.accuracy.depth)} / 0" if made.accuracy.depth else f"{depth} max."


def _hole_sections(holes: Sequence[PlateHole], made: Made) -> list[SectionView]:
    """One section per kind of hole."""
    sections: dict[tuple[float, float], SectionView] = {}
    low = made.bottom
    for hole in holes:
        if (
            (hole.use == "drawn" and not hole.locates)
            or (hole.radius, hole.sink) in sections
            or len(sections) == MOST_KINDS
        ):
            continue
        widest = max(hole.radius, hole.sink)
        aside = widest + max(2.0, 0.6 * widest)
        box = (hole.x - aside, low, hole.x + aside, 0.0)
        faces = cut_along(made.parts, hole.y, box)
        top = max((face.box[3] for face in faces), default=0.0)
        limits = f" {hole.limits.words}" if hole.limits else ""
        across = [_across(hole.x, hole.radius, f"{diameter(2 * hole.radius)}{limits}")]
        if hole.sink:
            across.append(_across(hole.x, hole.sink, f"{diameter(2 * hole.sink)} x 90\xb0"))
        sections[hole.radius, hole.sink] = SectionView(
            f"Section through hole {hole.label}, {use_words(hole)}",
            faces,
            (box[0], low, box[2], top),
            tuple(across),
            height_dimensions({(low, top): f"({millimeters(top - low)})"}),
            (hole.x,),
        )
    return list(sections.values())


def _across(x: float, radius: float, label: str) -> Dimension:
    return Dimension(x - radius, x + radius, label)


def _edge_section(marker: Marker, made: Made) -> list[SectionView]:
    """Section of an edge that has a chamfer, or a sheet's recess next to it."""
    chamfer = round(1e3 * marker.substrate.chamfer, 9)
    low = made.bottom
    outermost = max(seen(made.plates), key=lambda face: face.box[2])
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
    tall = {body.span: _depth(*body.span, made) for body in recesses}
    tall[low, made.face] = f"({millimeters(made.face - low)})"
    return [SectionView("Section of the edge", faces, box, across, height_dimensions(tall))] if faces else []


def height_dimensions(heights: dict[tuple[float, float], str]) -> tuple[Dimension, ...]:
    """Dimensions along z, the shortest first."""
    ordered = sorted(heights, key=lambda pair: (pair[1] - pair[0], pair))
    return tuple(Dimension(low, high, heights[low, high]) for low, high in ordered)
