"""Features of a made plate that its drawing describes: holes, cut-outs, recesses, outlines, and kinds of dots."""
# tests: tests/workshop/drafting/test_content.py tests/workshop/drafting/test_rig_drawing.py

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor
from types import MappingProxyType

from markergen.drawing.scene import union
from markergen.geometry.contour import Contour, area, box, placed
from markergen.model.marker import Marker
from markergen.model.openings import drawn_holes
from markergen.model.substrate import SCREWS
from markergen.solid.plate import plate_of
from markergen.solid.primitives import SAME, Primitive, Prism, Revolved, mm
from markergen.workshop.dot_geometry import SolidDot
from markergen.workshop.drafting.drawing import millimeters
from markergen.workshop.iso286 import SizeLimits, hole_class
from markergen.workshop.processes import Made

DIAMETER = "\xd8"
PLUS_MINUS = "\xb1"
LOOSE = 0.2
"""Diameter in mm of the position's zone of holes whose screws are unknown."""
LOCATING = ("H6", "H7", "H8")
"""Tolerance classes of holes that pins or shafts locate."""

LARGEST_FIT = 500.0
"""Maximum diameter in mm of a hole with a tolerance class."""

MOST_KINDS = 6
"""Maximum number of kinds of dots or holes with their own callouts and sections; more are listed in tables only."""


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
    fit : str
        Tolerance class that was asked for, or that it has because it locates the plate; empty for that of its use.
    """

    label: str
    x: float
    y: float
    radius: float
    sink: float
    use: str
    name: str
    fit: str = ""

    @property
    def locates(self) -> bool:
        """True for a hole that fixes where the plate is."""
        return self.use == "dowel" or self.fit in LOCATING

    @property
    def place(self) -> tuple[float, float]:
        """Position of the axis."""
        return self.x, self.y

    @property
    def limits(self) -> SizeLimits | None:
        """H7 for a dowel, H13 of the medium series of ISO 273 for a screw; else the general tolerance applies."""
        fit = self.fit or ("H7" if self.use == "dowel" else "H13" if self.name in SCREWS else "")
        return hole_class(fit, 2 * self.radius) if fit and 2 * self.radius <= LARGEST_FIT else None

    @property
    def zone(self) -> float:
        """Diameter of the position's zone: for a screw half its clearance, in steps of 0.05 mm."""
        if self.use == "mount" and self.name in SCREWS:
            clearance = 2 * self.radius - float(self.name[1:])
            return max(floor(clearance / 2 / 0.05 + 1e-6) * 0.05, 0.05)
        return LOOSE


def diameter(size: float) -> str:
    """Diameter in mm with its sign."""
    return f"{DIAMETER}{millimeters(size)}"


def use_words(hole: PlateHole) -> str:
    """Use of a hole: ``for screw M3``, ``for a 4 mm pin``."""
    name = hole.name[:24]
    if hole.use == "drawn":
        return "locates the plate" if hole.locates else "plain"
    if hole.use == "dowel":
        return f"for a {name or 'dowel pin'}"
    return f"for screw {name}" if name else "for a screw"


def holes_of(marker: Marker, fits: Mapping[str, str] = MappingProxyType({})) -> tuple[PlateHole, ...]:
    """Round holes in the order of `markergen.model.openings.openings`, from ``H1`` on; their fits by these labels."""
    rows: list[tuple[float, float, float, float, str, str]] = [
        (mm(hole.x), mm(hole.y), mm(hole.diameter) / 2, mm(hole.sink) / 2, hole.use, hole.name)
        for hole in marker.substrate.holes
    ]
    round_ = (contour.as_circle for contour in _drawn(marker))
    # The circle of two arcs is known up to rounding, which would make holes of one drill several kinds.
    circles = ([round(value, 6) + 0.0 for value in circle] for circle in round_ if circle)
    rows += [(x, y, r, 0.0, "drawn", "") for x, y, r in circles]
    return tuple(PlateHole(f"H{number}", *row, fits.get(f"H{number}", "")) for number, row in enumerate(rows, 1))


def _drawn(marker: Marker) -> list[Contour]:
    contours = drawn_holes(marker.boundary, marker.substrate.outline)
    return [placed(contour, 1e3, digits=9) for contour in contours]


def recesses_of(made: Made) -> list[Prism]:
    """Recesses for printed sheets: open to the face of the plate, without inlays."""
    inlays = [body.box for part in made.parts if not part.is_plate for body in part.add]
    return [
        body
        for part in made.plates
        for body in part.cut
        if isinstance(body, Prism)
        and body.top > made.face - SAME
        and not any(union(body.box, inlay) == body.box for inlay in inlays)
    ]


@dataclass(frozen=True)
class ListedOutline:
    """Outline that a table describes: title of the table, words of the callout, and whose it is."""

    title: str
    text: str
    contour: Contour
    plate: bool = False
    recess: Prism | None = None


def is_plain(recess: Prism) -> bool:
    """True for a recess that a diameter, or width and height, and a place describe."""
    return recess.outer.as_circle is not None or is_rectangle(recess.outer)


def listed_outlines(marker: Marker, made: Made) -> list[ListedOutline]:
    """Outlines that a size and a radius do not describe: of plates, of holes that are not round, and of recesses."""
    plates = [outer for outer, *_ in plate_of(marker).outlines]
    outlines = []
    if len(plates) > 1:
        for number, outer in enumerate(plates, 1):
            outlines.append(ListedOutline(f"Outline of plate {number}", f"plate {number}, all around", outer, True))
    elif plates[0].as_circle is None and not is_rectangle(plates[0]):
        outlines.append(ListedOutline("Outline of the plate", "outline, all around", plates[0], True))
    cutouts = (contour for contour in _drawn(marker) if contour.as_circle is None)
    for number, contour in enumerate(cutouts, 1):
        outlines.append(ListedOutline(f"Cut-out S{number}", f"cut-out S{number}, through", contour))
    for number, recess in enumerate(recesses_of(made), 1):
        if not is_plain(recess):
            outlines.append(ListedOutline(f"Recess {number}", f"recess {number}", recess.outer, recess=recess))
    return outlines


def alike(dots: Iterable[SolidDot]) -> list[tuple[tuple[float, float], list[SolidDot]]]:
    """Group dots by radius and inner radius."""
    groups: dict[tuple[float, float], list[SolidDot]] = {}
    for dot in dots:
        groups.setdefault((dot.radius, dot.inner), []).append(dot)
    return list(groups.items())


def centered(bodies: Iterable[Primitive], x: float, y: float) -> list[Revolved]:
    """Bodies of revolution about the vertical axis through (x, y), within a micron."""
    return [b for b in bodies if isinstance(b, Revolved) and abs(b.x - x) < 1e-3 and abs(b.y - y) < 1e-3]


def is_through(dot: SolidDot, made: Made) -> bool:
    """True if a dot is a hole through the plate."""
    return any(body.span[0] < made.bottom + SAME for body in centered(made.cut, dot.x, dot.y))


def ranges(numbers: Iterable[int]) -> str:
    """Abbreviate a list of integers: ``1 to 4, 7``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    terms: list[str] = []
    for run in runs:
        terms += [str(run[0])] if len(run) == 1 else [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
    return ", ".join(terms)


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
