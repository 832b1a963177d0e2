"""Datums, tolerances and callouts of the fabrication drawing: what is measured from where, and how true it has to be.

Datum A is the plate's face, from which depths and heights are measured. B and C fix the origin and the x axis in it, by
the first that a marker has of: two dowel holes, a bore and another hole of its own size, a lower and a left edge, a
round rim and a hole, two holes. Coordinates in the marker frame are theoretically exact; positions have round zones
about them (ISO 1101, ISO 5459).
"""
# tests: tests/workshop/drafting/test_content.py tests/workshop/drafting/test_rig_drawing.py

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, groupby
from math import atan2, degrees, dist, hypot
from types import MappingProxyType

from markergen.drawing.scene import Box, union
from markergen.errors import InputError
from markergen.geometry.contour import Contour, box, center_of, flattened, radius_of
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.solid.plate import plate_of
from markergen.solid.primitives import OFF, SAME, Prism, mm
from markergen.workshop.dot_geometry import SolidDot, dots_of
from markergen.workshop.drafting.drawing import (
    Callout,
    Control,
    Datum,
    DrawingTable,
    exact,
    millimeters,
)
from markergen.workshop.drafting.features import (
    DIAMETER,
    MOST_KINDS,
    PLUS_MINUS,
    PlateHole,
    alike,
    diameter,
    holes_of,
    is_plain,
    is_through,
    listed_outlines,
    ranges,
    recesses_of,
    use_words,
)
from markergen.workshop.iso286 import SizeLimits
from markergen.workshop.processes import Made

RECESS = 0.2
"""Excess in mm of a recess's size, and diameter of its position's zone."""
MOST_PLACES = 2
"""Maximum number of holes of a kind whose places are told in their callout; the table has them all."""

STRAIGHT = 0.25
"""Minimum length of a datum edge, as a share of the plate's size along it."""

APART = 0.25
"""Minimum distance of a hole from a rim's center, as a share of its radius, to fix the direction of the x axis."""


LOCATING, MILLED = 0.04, 0.1
"""Maximum diameter in mm of the zones of holes that locate, and of dots' where such holes have a fit by default."""

PROFILE, OUTLINE = 0.2, 1.0
"""Widths in mm of the zones of outlines that dimensions alone do not describe, and of others about datums within them:
general tolerances do not say where they are, and allow 0.5 mm of most sizes."""


def located_holes(marker: Marker, fabrication: Fabrication, made: Made) -> tuple[PlateHole, ...]:
    """Holes with the fits that were asked for, and H7 for those of a milled plate's drawing that are datums.

    Raises
    ------
    InputError
        If a fit is for a hole that the plate does not have.
    """
    fits = fabrication.fits
    holes = holes_of(marker, fits)
    if strange := sorted(set(fits) - {hole.label for hole in holes}):
        raise no_hole(strange[0], holes, "--hole")
    if 0 < made.accuracy.position <= MILLED:
        at = {datum.at for datum in datums_of(marker, made, holes, fabrication.datums) if datum.kind == "hole"}
        fits = {hole.label: "H7" for hole in holes if hole.use == "drawn" and hole.place in at} | fits
    return holes_of(marker, fits)


def no_hole(name: str, holes: Sequence[PlateHole], option: str) -> InputError:
    """Error about a hole that the plate does not have."""
    expected = f"one of the holes {_labels([hole.label for hole in holes])}" if holes else "a plate with round holes"
    return InputError(expected, name, f"correct {option}: the drawing has the names")


def datums_of(
    marker: Marker, made: Made, holes: Sequence[PlateHole], asked: Mapping[str, str] = MappingProxyType({})
) -> tuple[Datum, ...]:
    """Datum A, and B and C as asked for, or as far as the plate has features for them; A alone for several plates.

    Raises
    ------
    InputError
        If the plate does not have what is asked for.
    """
    face = Datum("A", "face", "face with the dots", f"z = {millimeters(made.face)}")
    plate = plate_of(marker)
    if len(plate.outlines) > 1:
        return (face,)
    outer = plate.outlines[0][0]
    if asked:
        return (face, *(_asked(letter, name, outer, holes) for letter, name in asked.items() if letter != "A"))
    locating = [hole for hole in holes if hole.locates]
    if len(locating) > 1:
        first, second = _farthest(locating)
        return (face, *map(_bored, "BC", sorted((first, second), key=lambda hole: -hole.radius)))
    if bore := _bore(holes):
        return (face, *map(_bored, "BC", bore))
    if edges := _edges(outer):
        return (face, *edges)
    if rim := outer.as_circle:
        x, y, radius = rim
        aside = sorted(holes, key=lambda hole: (hole.use == "drawn", hole.use == "mount"))
        aside = [hole for hole in aside if dist(hole.place, (x, y)) > APART * radius]
        axis = Datum("B", "rim", f"rim {diameter(2 * radius)}", _axis(x, y), (x, y))
        return (face, axis, *(_bored("C", hole) for hole in aside[:1]))
    return (face, *map(_bored, "BC", _farthest(holes))) if len(holes) > 1 else (face,)


def _asked(letter: str, name: str, outer: Contour, holes: Sequence[PlateHole]) -> Datum:
    """Datum of a feature by its name."""
    hole = next((hole for hole in holes if hole.label == name), None)
    if hole is not None:
        return _bored(letter, hole)
    if name == "rim" and (rim := outer.as_circle):
        x, y, radius = rim
        return Datum(letter, "rim", f"rim {diameter(2 * radius)}", _axis(x, y), (x, y))
    edge = next((datum for datum in _edges(outer) if datum.letter == letter), None) if name == "edge" else None
    if edge is not None:
        return edge
    if name.startswith("H"):
        raise no_hole(name, holes, "--datum")
    raise InputError(f"a plate with a straight or round {name} for datum {letter}", "none", "name a hole in --datum")


def _bore(holes: Sequence[PlateHole]) -> tuple[PlateHole, PlateHole] | None:
    """A bore, the only one of its size and larger than all other holes, and a hole aside that is the only one of its.

    So are those of flanges that a shaft or spigot and a pin locate; screws come in sets.
    """
    sizes = [round(hole.radius, 4) for hole in holes]
    alone = [hole for hole, size in zip(holes, sizes, strict=True) if sizes.count(size) == 1]
    bore = max(holes, key=lambda hole: hole.radius, default=None)
    aside = [hole for hole in alone if hole is not bore and hole.use != "mount"]
    if bore is None or bore not in alone or bore.use == "mount" or not aside:
        return None
    return bore, max(aside, key=lambda hole: (hole.locates, dist(hole.place, bore.place)))


def _farthest(holes: Sequence[PlateHole]) -> tuple[PlateHole, PlateHole]:
    return max(combinations(holes, 2), key=lambda pair: round(dist(pair[0].place, pair[1].place), 6))


def _bored(letter: str, hole: PlateHole) -> Datum:
    return Datum(letter, "hole", f"hole {hole.label}", _axis(*hole.place), hole.place)


def _axis(x: float, y: float) -> str:
    return f"x = {exact(x)}, y = {exact(y)}"


def _edges(outer: Contour) -> tuple[Datum, ...]:
    """A straight edge along x, the lower one if it is long enough, and one along y, the left one."""
    left, bottom, right, top = box(outer)
    datums = []
    for letter, along, size, name in (("B", 0, right - left, "y"), ("C", 1, top - bottom, "x")):
        best: tuple[float, Datum] | None = None
        for a, b, bulge in outer.sides:
            step = b[along] - a[along]
            if bulge or abs(b[1 - along] - a[1 - along]) > SAME or abs(step) < STRAIGHT * size:
                continue
            # A counterclockwise outline has its outside on the right.
            outward = -1.0 if (step > 0) == (along == 0) else 1.0
            out = (0.0, outward) if along == 0 else (outward, 0.0)
            low, high = sorted((a, b), key=lambda point: point[along])
            # Clear of the dimensions, which end at the lower left and at the origin.
            at = (low[0] + 3 * high[0]) / 4, (low[1] + 3 * high[1]) / 4
            which = (("lower", "upper"), ("left", "right"))[along][outward > 0]
            place = f"{name} = {exact(a[1 - along])}"
            rank = round(abs(step), 6) * (1.0 if outward > 0 else 1.5)
            if best is None or rank > best[0]:
                best = rank, Datum(letter, "edge", f"{which} edge", place, at, out)
        if best:
            datums.append(best[1])
    return tuple(datums) if len(datums) == 2 else ()


def letters(datums: Sequence[Datum]) -> tuple[str, ...]:
    """Letters of datums, in their order."""
    return tuple(datum.letter for datum in datums)


def located(zone: float, datums: Sequence[Datum], of: str = "", count: int = 1) -> Control:
    """Position of a number of features within zones of a diameter in mm.

    Where the datums leave a freedom, several features form one pattern: CZ, combined zone (ISO 5458).
    """
    combined = " CZ" if len(datums) < 3 and count > 1 else ""
    return Control("position", f"{diameter(zone)}{combined}", letters(datums), of)


def flat(made: Made) -> Control:
    """Flatness of the plate's face."""
    return Control("flatness", millimeters(made.accuracy.flatness))


def dot_controls(made: Made, datums: Sequence[Datum], dots: Sequence[SolidDot]) -> tuple[Control, ...]:
    """Positions of what is made for some dots and, where discs have play in it, of the finished dots."""
    accuracy = made.accuracy
    if not accuracy.position:
        return ()
    if not accuracy.play or all(is_through(dot, made) for dot in dots):
        return (located(accuracy.position, datums, count=len(dots)),)
    zones = ("pockets", accuracy.position), ("dots", zone_of_dots(made))
    return tuple(located(zone, datums, of, len(dots)) for of, zone in zones)


def zone_of_dots(made: Made) -> float:
    """Diameter of the zone of finished dots' centers, mm: the pocket's, and the play to both sides; whole microns."""
    return round(2 * made.accuracy.center + 1e-9, 3)


def hole_control(hole: PlateHole, made: Made, datums: Sequence[Datum], count: int = 1) -> tuple[Control, str]:
    """Tolerance of a hole, one of a number alike, with the letter of the datum that it is, if any."""
    zone = min(made.accuracy.position or LOCATING, LOCATING) if hole.locates else hole.zone
    hole_datum = next((datum for datum in datums if datum.kind == "hole" and datum.at == hole.place), None)
    if hole_datum is None:
        return located(zone, datums, count=count), ""
    before = datums[: datums.index(hole_datum)]
    if len(before) == 1:
        return Control("perpendicularity", f"{diameter(zone)}", letters(before)), hole_datum.letter
    return Control("position", f"{diameter(zone)}", letters(before)), hole_datum.letter


def tolerance_tables(
    made: Made,
    datums: Sequence[Datum],
    general: str,
    holes: Sequence[PlateHole],
    dots: Sequence[SolidDot],
    engraved: bool,
) -> tuple[DrawingTable, ...]:
    """Tables of the datums, of all tolerances, and of fits, if any."""
    rows = tuple((datum.letter, datum.text, datum.place) for datum in datums)
    headings = ("datum", "feature", "marker frame, exact")
    features = DrawingTable("Datums, and the marker frame in them", headings, rows, (0, 1, 2))
    return (features, _tolerance_table(made, datums, general, dots, engraved), *_fit_table(made, holes))


def _tolerance_table(
    made: Made, datums: Sequence[Datum], general: str, dots: Sequence[SolidDot], engraved: bool
) -> DrawingTable:
    """All tolerances in words."""
    accuracy = made.accuracy
    to = " to " + ", ".join(letters(datums))
    rows = [("where nothing is stated", general)]
    rows.append(("face A", f"flatness {millimeters(accuracy.flatness)}"))
    rows.append(("back of the plate", f"parallelism {millimeters(accuracy.flatness)} to A"))
    rows.append(("thickness of the plate", f"{PLUS_MINUS}{millimeters(accuracy.thickness)}"))
    if sides := [datum.letter for datum in datums if datum.kind in ("edge", "rim")]:
        rows.append((f"plate's side at {', '.join(sides)}", f"perpendicularity {millimeters(accuracy.flatness)} to A"))
    elif len(datums) > 1:
        rows.append(("outline" + to, f"profile {millimeters(OUTLINE)}"))
    if accuracy.position:
        through, inlaid = (any(is_through(dot, made) == is_open for dot in dots) for is_open in (True, False))
        zone = f"position {diameter(accuracy.position)}"
        if accuracy.play and inlaid:
            rows.append(("axes of pockets" + to, zone))
            rows.append((f"finished dots{' in pockets' * through}{to}", f"position {diameter(zone_of_dots(made))}"))
        if through or not accuracy.play:
            rows.append((f"centers of {'through ' * (through and inlaid)}dots{to}", zone))
        if not any(kind == "dot" for kind, _ in made.fits):
            rows.append(("diameters of dots", f"{PLUS_MINUS}{millimeters(accuracy.diameter)}"))
    if any(body.span[0] > made.bottom + SAME for body in made.cut):
        rows.append(("depth of pockets or recess", f"+{millimeters(accuracy.depth)} / 0"))
    elif made.marked:
        deep = _over(accuracy.depth) if accuracy.depth else f"at most {millimeters(made.depth)}"
        rows.append(("depth of the engraved dots", deep))
    if made.add:
        rows.append(("tops of pillars above A", f"{PLUS_MINUS}{millimeters(accuracy.height)}"))
    if engraved:
        rows.append(("depth of the engraving on the back", _over(0.1)))
    return DrawingTable("Tolerances, mm", ("what", "tolerance"), (*rows, *made.tolerances), (0, 1))


def _over(most: float) -> str:
    return f"+{millimeters(most)} / 0"


def _fit_table(made: Made, holes: Sequence[PlateHole]) -> list[DrawingTable]:
    """Limits of discs, pockets and holes with a tolerance class; none if there are none."""
    rows: list[tuple[str, SizeLimits]] = []
    for kind, fit in made.fits:
        disc, pocket = ("disc", "pocket of the disc") if kind == "dot" else ("core of the ring", "bore of the ring")
        rows += [(disc, fit.disc), (pocket, fit.pocket)]
    for hole in holes:
        limits = hole.limits
        label = f"hole {use_words(hole)}" if hole.use == "mount" else "hole for a dowel pin"
        label = f"hole {hole.label}" if hole.fit else label
        if limits and (label, limits) not in rows:
            rows.append((label, limits))
    cells = tuple(
        (
            what,
            f"{diameter(hole_fit.diameter)} {hole_fit.name}",
            hole_fit.deviations,
            f"{hole_fit.least:.3f}",
            f"{hole_fit.most:.3f}",
        )
        for what, hole_fit in rows
    )
    headings = ("feature", "diameter, class", "deviations", "smallest", "largest")
    return [DrawingTable("Fits and limits (ISO 286), mm", headings, cells, (0, 1))] if cells else []


def callouts_of(
    marker: Marker, fabrication: Fabrication, made: Made, datums: Sequence[Datum], holes: Sequence[PlateHole]
) -> tuple[Callout, ...]:
    """Callouts of the dots, the holes, outlines that need one, recesses and the tag."""
    return (
        *_dot_callouts(dots_of(marker), fabrication, made, datums),
        *_hole_callouts(holes, made, datums, union(*(box(outer) for outer, *_ in plate_of(marker).outlines))),
        *_outline_callouts(marker, made, datums),
        *_recess_callouts(made, datums),
        *_tag_callout(marker, made, datums),
    )


def _dot_callouts(
    dots: Sequence[SolidDot], fabrication: Fabrication, made: Made, datums: Sequence[Datum]
) -> list[Callout]:
    callouts = []
    kinds = alike(dots)
    if len(kinds) > MOST_KINDS:
        places = tuple((dot.x, dot.y, dot.radius) for dot in dots)
        summary = f"{len(places)} dots of {len(kinds)} sizes", "see the table"
        return [Callout(summary, places, controls=dot_controls(made, datums, dots))]
    # S stands for a sphere (ISO 129).
    sphere = "S" if PROCESSES[fabrication.process].balls else ""
    for (radius, inner), group in kinds:
        names = f"{'ring' if inner else 'dot'}{'s' if len(group) > 1 else ''} {ranges([dot.id for dot in group])}"
        places = tuple((dot.x, dot.y, dot.radius) for dot in group)
        lines = _dot_lines(_times(group), f"{sphere}{DIAMETER}", radius, inner, group[0], made)
        controls = [replace(control, zone=f"{sphere}{control.zone}") for control in dot_controls(made, datums, group)]
        callouts.append(Callout((*lines, names), places, controls=tuple(controls)))
    return callouts


def _dot_lines(times: str, sign: str, radius: float, inner: float, dot: SolidDot, made: Made) -> list[str]:
    """Diameters of a kind of dot, with their fits or tolerances."""
    outer, core = millimeters(2 * radius), millimeters(2 * inner)
    fits = {(kind, round(fit.disc.diameter, 6)): fit for kind, fit in made.fits}
    through = is_through(dot, made)
    if (fit := fits.get(("dot", round(2 * radius, 6)))) and not through:
        bore = fits.get(("core", round(2 * inner, 6)))
        lines = [f"{times}{sign}{outer} {fit.disc.name}" + (f" / {sign}{core} {bore.pocket.name}" if bore else "")]
        lines.append(f"in {sign}{outer} {fit.pocket.name}" + (f", core {sign}{core} {bore.disc.name}" if bore else ""))
        return lines
    limits = f" {PLUS_MINUS}{millimeters(made.accuracy.diameter)}" if made.accuracy.position else ""
    sizes = [f"{sign}{outer}{limits}", *([f"{DIAMETER}{core}{limits}"] if inner else [])]
    return [f"{times}{' / '.join(sizes)}{'' if limits else ' printed'}{' through' * through}"]


def _hole_callouts(holes: Sequence[PlateHole], made: Made, datums: Sequence[Datum], plate: Box) -> list[Callout]:
    """Callouts of holes of a kind; a hole that is a datum has its own."""

    def kind(hole: PlateHole) -> tuple[str, str, float, float, str]:
        return hole.use, hole.name, hole.radius, hole.sink, hole.fit

    def as_datum(hole: PlateHole) -> str:
        return hole_control(hole, made, datums)[1]

    callouts = []
    kinds = [list(group) for _, group in groupby(sorted(holes, key=kind), key=kind)]
    if many := len(kinds) > MOST_KINDS:
        rest = [hole for hole in holes if not as_datum(hole)]
        places = tuple((*hole.place, max(hole.radius, hole.sink)) for hole in rest)
        zones: dict[Control, list[str]] = {}
        for hole in rest:
            zones.setdefault(hole_control(hole, made, datums, len(rest))[0], []).append(hole.label)
        controls = [replace(control, of=_labels(names) if len(zones) > 1 else "") for control, names in zones.items()]
        callouts.append(Callout((f"{len(places)} holes through", "see the table"), places, controls=tuple(controls)))
    for kind_holes in kinds:
        pitch, first = _pitch(kind_holes, plate)
        for letter, group in groupby(sorted(kind_holes, key=as_datum), key=as_datum):
            if not many or letter:
                callouts.append(_hole_callout(list(group), len(kind_holes), pitch, first, made, datums))
    return callouts


def _hole_callout(
    group: Sequence[PlateHole], count: int, pitch: float, angle: float, made: Made, datums: Sequence[Datum]
) -> Callout:
    """Callout of holes, which may be some of the `count` that are evenly spaced on their pitch circle."""
    first = group[0]
    control, letter = hole_control(first, made, datums, len(group))
    limits = f" {first.limits.words}" if first.limits else ""
    names = _labels([hole.label for hole in group])
    lines = [
        f"{_times(group)}{diameter(2 * first.radius)}{limits}",
        "through" if first.use == "drawn" else f"through, {use_words(first)}",
    ]
    if first.sink:
        lines.append(f"countersunk {diameter(2 * first.sink)} x 90\xb0")
    if pitch:
        on = f"on a circle [{diameter(2 * pitch)}]"
        if len(group) <= MOST_PLACES:
            at = ", ".join(f"[{round(_angle(hole), 3):g}\xb0]" for hole in group)
            lines += [f"{names}, {on}", f"at {at}"]
        elif len(group) == count:
            lines += [f"{names}, {on}", f"from [{angle:g}\xb0], evenly spaced"]
        else:
            lines += [f"{names} of {count} evenly spaced", f"from [{angle:g}\xb0], {on}"]
    elif len(group) <= MOST_PLACES:
        lines += [f"{hole.label} at x [{exact(hole.x)}], y [{exact(hole.y)}]" for hole in group]
    else:
        lines.append(f"{names}, places in the table")
    places = tuple((*hole.place, max(hole.radius, hole.sink)) for hole in group)
    return Callout(tuple(lines), places, pitch, (control,), letter)


def _pitch(holes: Sequence[PlateHole], plate: Box) -> tuple[float, float]:
    """Radius of the circle about the origin that holes are evenly spaced on, and the first one's angle in degrees.

    Both are 0 if there is none, or if it leaves the plate: then the places are told one by one.
    """
    radii = [hypot(*hole.place) for hole in holes]
    room = min(-plate[0], -plate[1], plate[2], plate[3])
    if len(holes) < 2 or min(radii) < SAME or max(radii) - min(radii) > 1e-5 or max(radii) > room:
        return 0.0, 0.0
    angles = sorted(map(_angle, holes))
    step = 360 / len(holes)
    even = all(abs(angle - angles[0] - k * step) < 1e-4 for k, angle in enumerate(angles))
    return (round(radii[0], 6), round(angles[0], 3)) if even else (0.0, 0.0)


def _angle(hole: PlateHole) -> float:
    """Direction of a hole from the origin, from 0 to below 360 degrees."""
    return round(degrees(atan2(hole.y, hole.x)) % 360, 6) % 360


def _labels(names: Sequence[str]) -> str:
    """``H1 to H4``."""
    return ", ".join(
        " to ".join(f"H{number}" for number in run.split(" to "))
        for run in ranges([int(name[1:]) for name in names]).split(", ")
    )


def _outline_callouts(marker: Marker, made: Made, datums: Sequence[Datum]) -> list[Callout]:
    """Callouts of the radii of outlines, and of an outline or a hole that needs a table."""
    plates = plate_of(marker).outlines
    arcs: dict[float, list[tuple[float, float, float]]] = {}
    for contour in (ring for plate in plates for ring in plate):
        sides = contour.sides
        for k, side in enumerate(sides) if contour.as_circle is None else ():
            # Consecutive arcs of one circle, as for more than half a turn, count once.
            if side[2] and not (sides[k - 1][2] and dist(center_of(side), center_of(sides[k - 1])) < SAME):
                (x, y), (u, v), bulge = side
                middle = (x + u) / 2 + bulge / 2 * (v - y), (y + v) / 2 - bulge / 2 * (u - x), 0.0
                arcs.setdefault(round(radius_of(side), 4), []).append(middle)
    callouts = [
        Callout((f"{_times(centers)}R{millimeters(r)}",), tuple(centers)) for r, centers in sorted(arcs.items())
    ]
    if len(arcs) > MOST_KINDS:
        places = tuple(place for centers in arcs.values() for place in centers)
        callouts = [Callout((f"{len(places)} arcs of {len(arcs)} radii", "see the tables"), places)]
    profile = Control("profile", millimeters(PROFILE), letters(datums))
    for outline in listed_outlines(marker, made):
        x, y = max(flattened(outline.contour, OFF))
        lines, control = [outline.text, "see the table"], profile
        if outline.recess:
            lines.append(_depth_words(outline.recess, made))
            # The zone is outside of the outline, by which the recess may only be larger.
            control = replace(profile, zone=f"{millimeters(RECESS / 2)} UZ-{millimeters(RECESS / 4)}")
        callouts.append(Callout(tuple(lines), ((x, y, 0.0),), controls=(control,)))
    return callouts


def _recess_callouts(made: Made, datums: Sequence[Datum]) -> list[Callout]:
    callouts = []
    for recess in filter(is_plain, recesses_of(made)):
        left, bottom, right, top = recess.box
        over = f" +{millimeters(RECESS)} / 0"
        size = (
            f"recess {diameter(right - left)}{over}"
            if recess.outer.as_circle
            else f"recess {millimeters(right - left)} x {millimeters(top - bottom)}{over}"
        )
        middle = (left + right) / 2, (bottom + top) / 2
        at = (f"center at x [{exact(middle[0])}], y [{exact(middle[1])}]",) if hypot(*middle) > SAME else ()
        lines = (size, *at, _depth_words(recess, made))
        control = located(RECESS, datums)
        if not recess.outer.as_circle:
            control = replace(control, zone=control.zone.removeprefix(DIAMETER))
        # On the rim, away from the axes.
        x, y = max((x, y) for x, y in flattened(recess.outer, OFF) if y <= (bottom + 3 * top) / 4)
        callouts.append(Callout(lines, ((x, y, 0.0),), controls=(control,)))
    return callouts


def _depth_words(recess: Prism, made: Made) -> str:
    return f"{millimeters(recess.top - recess.bottom)} +{millimeters(made.accuracy.depth)} / 0 deep, floor flat"


def _times(places: Sequence[object]) -> str:
    return f"{len(places)}x " if len(places) > 1 else ""


def _tag_callout(marker: Marker, made: Made, datums: Sequence[Datum]) -> list[Callout]:
    if marker.tag is None:
        return []
    side = mm(marker.tag.side)
    x, y = (mm(center) for center in marker.tag.center)
    lines = (
        f"tag {marker.tag}",
        f"black square {millimeters(side)} x {millimeters(side)}",
        f"{marker.tag.cells} x {marker.tag.cells} cells of {millimeters(side / marker.tag.cells)},",
        "which ones as in the STEP file",
    )
    # Printed sheets come with it.
    controls = (Control("profile", millimeters(PROFILE), letters(datums)),) if made.accuracy.position else ()
    return [Callout(lines, ((x + side / 2, y + side / 4, 0.0),), controls=controls, area=((x, y, side / 2),))]
