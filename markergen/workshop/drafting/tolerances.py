"""Datums and tolerances of the fabrication drawing: what a part is measured from, and how true it has to be.

Datum A is the plate's face, from which depths and heights are measured. B and C fix the origin and the x axis in it, by
the first that a marker has of: two dowel holes, a lower and a left edge, a round rim and a hole, two holes. Coordinates
in the marker frame are theoretically exact; positions have round zones about them (ISO 1101, ISO 5459).
"""
# tests: tests/workshop/drafting/test_content.py tests/workshop/drafting/test_rig_drawing.py

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import dist, floor

from markergen.geometry.contour import Contour, area, box, placed
from markergen.model.marker import Marker
from markergen.model.openings import drawn_holes
from markergen.model.substrate import SCREWS
from markergen.solid.plate import plate_of
from markergen.solid.primitives import SAME, mm
from markergen.workshop.drafting.drawing import Control, Datum, DrawingTable, millimeters
from markergen.workshop.iso286 import Limits, drilled, reamed
from markergen.workshop.processes import Made

DIAMETER, PLUS_MINUS = "\xd8", "\xb1"

STRAIGHT = 0.25
"""Minimum length of a datum edge, as a share of the plate's size along it."""

APART = 0.25
"""Minimum distance of a hole from a rim's center, as a share of its radius, to fix the direction of the x axis."""

LOOSE = 0.2
"""Diameter in mm of the position's zone of holes whose screws are unknown."""

LOCATING = 0.04
"""Maximum diameter in mm of the zones of dowel holes."""

PROFILE = 0.2
"""Width in mm of the zone of outlines that dimensions alone do not describe."""

LARGEST_FIT = 500.0
"""Maximum diameter in mm of a hole with a tolerance class."""


@dataclass(frozen=True)
class PlateHole:
    """Round hole through the plate; mm.

    Attributes
    ----------
    label : str
        Its name on the drawing: ``H1``.
    sink : float
        Radius of its countersink; 0 for none.
    use : {"dowel", "mount", "drawn"}
    name : str
        Screw or pin.
    """

    label: str
    x: float
    y: float
    radius: float
    sink: float
    use: str
    name: str

    @property
    def place(self) -> tuple[float, float]:
        """Position of the axis."""
        return self.x, self.y

    @property
    def limits(self) -> Limits | None:
        """H7 for a dowel, H13 for a screw by its name; else the general tolerance applies."""
        diameter = 2 * self.radius
        if diameter > LARGEST_FIT:
            return None
        return reamed(diameter) if self.use == "dowel" else drilled(diameter) if self.name in SCREWS else None

    @property
    def zone(self) -> float:
        """Diameter of the position's zone: for a screw half its clearance, in steps of 0.05 mm."""
        if self.use == "mount" and self.name in SCREWS:
            clearance = 2 * self.radius - float(self.name[1:])
            return max(floor(clearance / 2 / 0.05 + 1e-6) * 0.05, 0.05)
        return LOOSE


def holes_of(marker: Marker) -> tuple[PlateHole, ...]:
    """Round holes in the order of `markergen.model.openings.openings`, from ``H1`` on."""
    rows: list[tuple[float, float, float, float, str, str]] = [
        (mm(hole.x), mm(hole.y), mm(hole.diameter) / 2, mm(hole.sink) / 2, hole.use, hole.name)
        for hole in marker.substrate.holes
    ]
    round_ = (contour.as_circle for contour in _drawn(marker))
    rows += [(x + 0.0, y + 0.0, r, 0.0, "drawn", "") for x, y, r in filter(None, round_)]
    return tuple(PlateHole(f"H{number}", *row) for number, row in enumerate(rows, 1))


def cutouts_of(marker: Marker) -> tuple[Contour, ...]:
    """Holes of a drawing that are not round, mm."""
    return tuple(contour for contour in _drawn(marker) if contour.as_circle is None)


def _drawn(marker: Marker) -> list[Contour]:
    contours = drawn_holes(marker.boundary, marker.substrate.outline)
    return [placed(contour, 1e3, digits=9) for contour in contours]


def datums_of(marker: Marker, made: Made) -> tuple[Datum, ...]:
    """Datum A, and B and C as far as the plate has features for them; A alone for several plates."""
    face = Datum("A", "face", "face with the dots", f"z = {millimeters(made.face)}")
    plate = plate_of(marker)
    if len(plate.outlines) > 1:
        return (face,)
    outer, holes = plate.outlines[0][0], holes_of(marker)
    dowels = [hole for hole in holes if hole.use == "dowel"]
    if len(dowels) > 1:
        return (face, *map(_bored, "BC", _farthest(dowels)))
    if edges := _edges(outer):
        return (face, *edges)
    if rim := outer.as_circle:
        x, y, radius = rim
        aside = sorted(holes, key=lambda hole: (hole.use == "drawn", hole.use == "mount"))
        aside = [hole for hole in aside if dist(hole.place, (x, y)) > APART * radius]
        axis = Datum("B", "rim", f"rim {DIAMETER}{millimeters(2 * radius)}", _axis(x, y), (x, y))
        return (face, axis, *(_bored("C", hole) for hole in aside[:1]))
    return (face, *map(_bored, "BC", _farthest(holes))) if len(holes) > 1 else (face,)


def _farthest(holes: Sequence[PlateHole]) -> tuple[PlateHole, PlateHole]:
    return max(combinations(holes, 2), key=lambda pair: round(dist(pair[0].place, pair[1].place), 6))


def _bored(letter: str, hole: PlateHole) -> Datum:
    return Datum(letter, "hole", f"hole {hole.label}", _axis(*hole.place), hole.place)


def _axis(x: float, y: float) -> str:
    return f"x = {millimeters(x)}, y = {millimeters(y)}"


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
            place = f"{name} = {millimeters(a[1 - along])}"
            rank = round(abs(step), 6) * (1.0 if outward > 0 else 1.5)
            if best is None or rank > best[0]:
                best = rank, Datum(letter, "edge", f"{which} edge", place, at, out)
        if best:
            datums.append(best[1])
    return tuple(datums) if len(datums) == 2 else ()


def letters(datums: Sequence[Datum]) -> tuple[str, ...]:
    """Letters of datums, in their order."""
    return tuple(datum.letter for datum in datums)


def located(zone: float, datums: Sequence[Datum], of: str = "") -> Control:
    """Position within a zone of a diameter in mm.

    Where the datums leave a freedom, the features form one pattern: CZ, combined zone (ISO 5458).
    """
    combined = "" if len(datums) == 3 else " CZ"
    return Control("position", f"{DIAMETER}{millimeters(zone)}{combined}", letters(datums), of)


def flat(made: Made) -> Control:
    """Flatness of the plate's face."""
    return Control("flatness", millimeters(made.accuracy.flatness))


def dot_controls(made: Made, datums: Sequence[Datum]) -> tuple[Control, ...]:
    """Positions of what is made for the dots and, where discs have play in it, of the finished dots."""
    accuracy = made.accuracy
    if not accuracy.position:
        return ()
    if not accuracy.play:
        return (located(accuracy.position, datums),)
    return (located(accuracy.position, datums, "pockets"), located(zone_of_dots(made), datums, "dots"))


def zone_of_dots(made: Made) -> float:
    """Diameter of the zone of finished dots' centers, mm: the pocket's, and the play to both sides; whole microns."""
    return round(2 * made.accuracy.center + 1e-9, 3)


def hole_control(hole: PlateHole, made: Made, datums: Sequence[Datum]) -> tuple[Control, str]:
    """Tolerance of a hole with the letter of the datum that it is, if any."""
    zone = min(made.accuracy.position or LOCATING, LOCATING) if hole.use == "dowel" else hole.zone
    hole_datum = next((datum for datum in datums if datum.kind == "hole" and datum.at == hole.place), None)
    if hole_datum is None:
        return located(zone, datums), ""
    before = datums[: datums.index(hole_datum)]
    if len(before) == 1:
        return Control("perpendicularity", f"{DIAMETER}{millimeters(zone)}", letters(before)), hole_datum.letter
    return Control("position", f"{DIAMETER}{millimeters(zone)}", letters(before)), hole_datum.letter


def datum_table(datums: Sequence[Datum]) -> DrawingTable:
    """Datum features, and where they are in the marker frame."""
    rows = tuple((datum.letter, datum.words, datum.place) for datum in datums)
    return DrawingTable("Datums, and the marker frame in them", ("datum", "feature", "marker frame, exact"), rows,
                        (0, 1, 2))  # fmt: skip


def tolerance_table(made: Made, datums: Sequence[Datum], general: str) -> DrawingTable:
    """All tolerances in words."""
    accuracy = made.accuracy
    to = " to " + ", ".join(letters(datums))
    rows = [("where nothing is stated", general)]
    rows.append(("face A", f"flatness {millimeters(accuracy.flatness)}"))
    rows.append(("thickness of the plate", f"{PLUS_MINUS}{millimeters(accuracy.thickness)}"))
    if accuracy.position:
        what = "axes of pockets" if accuracy.play else "centers of dots"
        rows.append((what + to, f"position {DIAMETER}{millimeters(accuracy.position)}"))
        if accuracy.play:
            rows.append(("finished dots" + to, f"position {DIAMETER}{millimeters(zone_of_dots(made))}"))
        if not any(kind == "dot" for kind, _ in made.fits):
            rows.append(("diameters of dots", f"{PLUS_MINUS}{millimeters(accuracy.diameter)}"))
    if any(body.span[0] > span_bottom(made) + SAME for body in made.cut):
        rows.append(("depth of pockets or recess", f"+{millimeters(accuracy.depth)} / 0"))
    elif made.marked:
        deep = _over(accuracy.depth) if accuracy.depth else f"at most {millimeters(made.depth)}"
        rows.append(("depth of the engraved dots", deep))
    if made.add:
        rows.append(("tops of pillars above A", f"{PLUS_MINUS}{millimeters(accuracy.height)}"))
    if made.engraved:
        rows.append(("depth of the engraving on the back", _over(0.1)))
    return DrawingTable("Tolerances, mm", ("what", "tolerance"), (*rows, *made.tolerances), (0, 1))


def span_bottom(made: Made) -> float:
    """Height of the plate's back."""
    return min(part.span[0] for part in made.parts if part.is_plate)


def _over(most: float) -> str:
    return f"+{millimeters(most)} / 0"


def fit_table(marker: Marker, made: Made) -> list[DrawingTable]:
    """Limits of discs, pockets and holes with a tolerance class; none if there are none."""
    rows: list[tuple[str, Limits]] = []
    for kind, fit in made.fits:
        disc, pocket = ("disc", "pocket of the disc") if kind == "dot" else ("core of the ring", "bore of the ring")
        rows += [(disc, fit.disc), (pocket, fit.pocket)]
    for hole in holes_of(marker):
        limits = hole.limits
        label = "hole for a dowel pin" if hole.use == "dowel" else f"hole for screw {hole.name}"
        if limits and (label, limits) not in rows:
            rows.append((label, limits))
    cells = tuple(
        (
            what,
            f"{DIAMETER}{millimeters(hole_fit.diameter)} {hole_fit.name}",
            hole_fit.deviations,
            f"{hole_fit.least:.3f}",
            f"{hole_fit.most:.3f}",
        )
        for what, hole_fit in rows
    )
    headings = ("feature", "diameter, class", "deviations", "smallest", "largest")
    return [DrawingTable("Fits and limits (ISO 286), mm", headings, cells, (0, 1))] if cells else []


def is_rectangle(outer: Contour) -> bool:
    """True for a rectangle along the axes, also with rounded corners: width, height and radius describe it."""
    left, bottom, right, top = box(outer)
    ends = [(a, b) for a, b, bulge in outer.sides if not bulge]
    square = all(abs(a[0] - b[0]) < SAME or abs(a[1] - b[1]) < SAME for a, b in ends)
    corners = [side for side in outer.sides if side[2]]
    cut_off = (right - left) * (top - bottom) - area(outer)
    if not square or len(ends) != 4 or len(corners) not in (0, 4):
        return False
    radius = max((abs(a[0] - b[0]) for a, b, _ in corners), default=0.0)
    # Four quarter circles take (4 - pi) r^2 from the corners.
    return abs(cut_off - 0.8584073464102069 * radius**2) < 1e-3 * max(1.0, radius)
