"""What a workshop is told about a marker: its parts put into the views, sections, tables and words of a drawing."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from math import dist, hypot

from markergen.drawing.fabrication_drawing import Callout, Dimension, DotLabel, ViewFace, Workpiece, millimeters
from markergen.drawing.figure import size_words
from markergen.geometry.contour import Contour, center_of, radius_of
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker, marker_name
from markergen.model.substrate import Hole
from markergen.solid.bodies import OTHER, Part, cylinder, mm, span
from markergen.solid.inks import Dot, dots_of
from markergen.solid.processes import Made
from markergen.solid.sections import BACK, SAME, centered, elevation, reach, seen, size_of
from markergen.solid.workpiece_sections import alike, sections_of
from markergen.solid.workpiece_tables import (
    DIAMETER,
    MOST_KINDS,
    drawn_contours,
    drawn_holes,
    ranges,
    tables_of,
    use_words,
)

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
    """All that a fabrication sheet says about a marker as it was designed, and about what `parts_of` makes of it."""
    dots, parts = dots_of(marker), made.parts
    plates = [part for part in parts if part.is_plate]
    low, high = reach(plates)
    face = made.face
    heights = [Dimension(low, face, millimeters(face - low))]
    if high > face + SAME:
        heights.append(Dimension(face, high, millimeters(high - face)))
    highest = reach(parts)[1]
    if highest > high + SAME:
        heights.append(Dimension(face, highest, millimeters(highest - face)))
    if face < -SAME:
        heights.append(Dimension(face, 0.0, millimeters(-face)))
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
        heights=tuple(sorted(heights, key=lambda height: height.end - height.start)),
        sections=sections_of(marker, dots, made),
        tables=tables_of(marker, made),
        notes=(FRAME, MEASURE, *_plate_notes(marker), *made.lines, AFTERWARDS),
    )


def _back(parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """The back, if there is more to see on it than the outline and the holes that the front shows."""
    plates = [part for part in parts if part.is_plate]
    blank = seen([replace(part, cut=(), marked=()) for part in plates], BACK)
    # Letters are filled, so that they are read; what goes through stays empty.
    holes = [
        replace(face, material="dark", fine=True) if face.material else face
        for face in seen(plates, BACK)
        if face not in blank
    ]
    return (*blank, *holes) if any(face.material for face in holes) else ()


def _materials(parts: Sequence[Part]) -> str:
    kinds: dict[str, list[str]] = {}
    for part in parts:
        what = "core of the ring" if part.name.endswith("-core") else part.name.split("-")[0]
        kinds.setdefault(part.material, []).append("dots" if what == "dot" else what)
        if part.marked:
            kinds.setdefault(OTHER[part.material], []).append("engraving")
    return "; ".join(f"{material}: {', '.join(dict.fromkeys(names))}" for material, names in kinds.items())


def _printed(marker: Marker, dots: Sequence[Dot], parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """Dots and tag where they are no parts, not engraved and no holes, but on a sheet that is glued on."""
    low, _ = reach(parts)
    if any(not part.is_plate or part.marked for part in parts):
        return ()
    cut = [body for part in parts for body in part.cut]
    printed = [
        cylinder(dot.x, dot.y, dot.radius, -1.0, 0.0, dot.inner)
        for dot in dots
        if not any(centered(body, dot.x, dot.y) and span(body)[0] < low + SAME for body in cut)
    ]
    faces = list(seen([Part("dot", "dark", tuple(printed))])) if printed else []
    if marker.tag and printed:
        rings = tuple(Contour(tuple((mm(x), mm(y)) for x, y in ring.tolist())) for ring in marker.tag.outlines)
        faces.append(ViewFace(rings, "dark"))
    return tuple(replace(face, fine=True) for face in faces)


def _dot_callouts(dots: Sequence[Dot], fabrication: Fabrication) -> list[Callout]:
    found = []
    kinds = alike(dots)
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
    """Holes that are alike and equally far from the origin."""

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
    """Round holes of an outline from a drawing by diameter and pitch circle, and its other arcs by radius."""
    holes: dict[tuple[float, float], list[tuple[float, float, float]]] = {}
    for x, y, r in drawn_holes(marker):
        holes.setdefault((round(r, 6), round(hypot(x, y), 6)), []).append((x, y, r))
    arcs: dict[float, list[tuple[float, float, float]]] = {}
    for contour in drawn_contours(marker):
        sides = contour.sides
        for k, side in enumerate(sides) if not contour.is_circle else ():
            # Of one circle two arcs in a row, as of more than half a turn, count once.
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
    return [f"{', '.join(said).capitalize()}."] if said else []
