"""The substrate, the plate that carries the dots of a solid marker, and the text form of its holes.

``4xM3@0.12``      four clearance holes for M3 screws on a pitch circle of 0.12 m, astride the x axis
``4xM3c@120mm/0``  the same, countersunk, with the first hole on the x axis
``M3:40mm,-20mm;-40mm,-20mm``   two, at these places
``4x3.4mm@0.12``   holes of a given diameter
"""

import re
from dataclasses import asdict, dataclass, fields
from math import cos, isfinite, radians, sin
from typing import Any, Literal

from markergen.errors import InputError, brief
from markergen.geometry.contour import area
from markergen.model.boundary import Boundary, Circle, filled_outline
from markergen.units import format_length, parse_length

THINNEST, LARGEST = 1e-5, 1.0
"""Limits in m of a plate's thickness and its other dimensions; values beyond these probably lack a unit."""

EDGE = 0.002
"""Default width in m of the plate around a disk or a rectangle."""

MOST_HOLES = 200
"""Maximum number of holes of a plate: they are compared with each other, and listed in the drawing one by one."""

SCREWS = {
    "M1.6": 1.8, "M2": 2.4, "M2.5": 2.9, "M3": 3.4, "M3.5": 3.9, "M4": 4.5, "M5": 5.5, "M6": 6.6, "M8": 9.0,
    "M10": 11.0, "M12": 13.5, "M14": 15.5, "M16": 17.5,
}  # fmt: skip
"""Diameter in mm of the clearance hole of each metric screw: ISO 273, medium series."""

HEADS = {
    "M2": 4.4, "M2.5": 5.5, "M3": 6.72, "M4": 8.96, "M5": 11.2, "M6": 13.44, "M8": 17.92, "M10": 22.4, "M12": 26.88,
    "M14": 30.8, "M16": 33.6,
}  # fmt: skip
"""Largest theoretical diameter in mm of the head of each countersunk screw, so that none protrudes: ISO 10642, and for
M2 and M2.5 ISO 14581."""

MOUNT = "write 4xM3@120mm, countersunk 4xM3c@120mm, M3:40mm,-20mm;-40mm,-20mm, or 40mm:0mm,0mm for a bore in the middle"
DOWEL = "write 2x4mm@130mm, or 4mm:65mm,0mm;-65mm,0mm"

_COUNTERSUNK = re.compile(r"(.*?)\s*(?:-?\s*countersunk|(?<=\d)\s*c)\s*", re.IGNORECASE)

Use = Literal["mount", "dowel"]


@dataclass(frozen=True)
class Hole:
    """A round hole through the plate.

    Attributes
    ----------
    x, y : float
        Position of the axis in the marker frame, m.
    diameter : float
        Diameter of the hole through the plate, m.
    sink : float
        Diameter in m of a countersink of 90 degrees at the printed face; 0 for none.
    use : {"mount", "dowel"}
        Mounting hole for a screw, or dowel hole for a pin that locates the frame.
    name : str
        Screw or pin, such as ``M3``.

    Raises
    ------
    InputError
        If the position is not finite, the diameter is not above 0, or the countersink is not wider than the hole.
    """

    x: float
    y: float
    diameter: float
    sink: float = 0.0
    use: Literal["mount", "dowel"] = "mount"
    name: str = ""

    def __post_init__(self) -> None:
        if not (isfinite(self.x) and isfinite(self.y)):
            raise InputError("a hole at a finite place", f"({self.x}, {self.y}) m", "give two lengths")
        if not 0 < self.diameter <= LARGEST:
            raise InputError(
                f"a hole's diameter above 0, and of at most {format_length(LARGEST)}",
                f"{self.diameter} m",
                "write a screw such as M3, or a length with its unit such as 3.4mm",
            )
        if self.sink and not self.diameter < self.sink <= LARGEST:
            raise InputError(
                f"a countersink wider than its hole of {format_length(self.diameter)}",
                f"sink={self.sink} m",
                "give a larger one, or 0 for none",
            )

    @property
    def radius(self) -> float:
        """Radius in m of the opening in the printed face."""
        return max(self.diameter, self.sink) / 2

    @property
    def bore(self) -> Circle:
        """Outline of the hole through the plate."""
        return Circle(self.diameter / 2, (self.x, self.y))

    @property
    def rim(self) -> Circle:
        """Outline of the hole in the printed face."""
        return Circle(self.radius, (self.x, self.y))

    def __str__(self) -> str:
        kind = self.name or format_length(self.diameter)
        place = f"{format_length(round(self.x, 9))}, {format_length(round(self.y, 9))}"
        return f"the {'dowel hole' if self.use == 'dowel' else 'hole'} {kind} at {place}"


PLATE_LENGTHS = ("thickness", "edge", "corner_radius", "chamfer")
"""Names of the lengths of a plate, which a solid records beside the options of its export."""


@dataclass(frozen=True)
class Substrate:
    """A plate whose upper face is z = 0.

    Attributes
    ----------
    thickness : float
        Thickness of the plate, m.
    edge : float or None
        Minimum width in m of the plate outside a boundary that is a disk or a rectangle, None for `EDGE`; no effect on
        other boundaries, or if an outline is given (see `edge_around`).
    corner_radius : float
        Radius of the outline's corners seen from above, m.
    chamfer : float
        Width of the 45 degree chamfer around the upper face, m.
    outline : Boundary or None
        Outline of the plate; None is the boundary, with an edge around a disk or a rectangle.

    Raises
    ------
    InputError
        If a dimension is negative, not finite, or out of range, the chamfer leaves nothing of the plate's side, or
        there are more than `MOST_HOLES` holes.
    """

    thickness: float = 0.003
    edge: float | None = None
    corner_radius: float = 0.0
    chamfer: float = 0.0
    outline: Boundary | None = None
    holes: tuple[Hole, ...] = ()

    def __post_init__(self) -> None:
        if not THINNEST <= self.thickness <= LARGEST:
            raise InputError(
                f"a thickness of {THINNEST * 1e6:g} um to {format_length(LARGEST)}",
                f"thickness={self.thickness} m",
                "give --thickness a length such as 3mm",
            )
        for name, option in (("edge", "--edge 2mm"), ("corner_radius", "--corner-radius 5mm")):
            if getattr(self, name) is not None and not 0 <= getattr(self, name) <= LARGEST:
                raise InputError(
                    f"a plate's {name.replace('_', ' ')} of 0 to {format_length(LARGEST)}",
                    f"{name}={getattr(self, name)} m",
                    f"use {option}, for example",
                )
        if not 0 <= self.chamfer < self.thickness:
            raise InputError(
                f"a chamfer of 0 or more, and below the thickness of {format_length(self.thickness)}",
                f"chamfer={self.chamfer} m",
                "use --chamfer 0.5mm, for example",
            )
        if len(self.holes) > MOST_HOLES:
            raise InputError(f"at most {MOST_HOLES} holes", f"{len(self.holes)}", "leave some out")

    @property
    def rims(self) -> tuple[Boundary, ...]:
        """Outlines of the holes in the upper face, including those of the plate's own outline."""
        drawn = (
            [contour for contour in self.outline.contours() if area(contour) < 0] if self.outline is not None else []
        )
        return (*(hole.rim for hole in self.holes), *map(filled_outline, drawn))

    def edge_around(self, boundary: Boundary) -> float:
        """Return the width in m of the plate outside a boundary.

        A disk or a rectangle is the region of the dots, and the plate is larger. A drawn outline is the plate itself,
        with its holes: nothing is added. Nor is anything added if the plate has an outline of its own.
        """
        if self.outline is not None or not boundary.has_measures:
            return 0.0
        return EDGE if self.edge is None else self.edge

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, lengths in m: the thickness, and all other non-default values."""
        default = Substrate()
        values: dict[str, Any] = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name == "thickness" or getattr(self, field.name) != getattr(default, field.name)
        }
        if self.outline is not None:
            values["outline"] = self.outline.as_dict()
        if self.holes:
            values["holes"] = [asdict(hole) for hole in self.holes]
        return values


def parse_mount(text: str) -> tuple[Hole, ...]:
    """Parse mounting holes: ``COUNTxSCREW@DIAMETER``, ``COUNTxSCREW@DIAMETER/ANGLE`` or ``SCREW:X,Y;X,Y``.

    The diameter is that of the pitch circle, around the origin of the marker frame. Its holes lie astride the x axis,
    the first one at 180 degrees divided by their number, unless the angle of the first one is given, in degrees
    counterclockwise from the x axis. A screw is one of `SCREWS`, followed by ``c`` or ``countersunk`` if it is one of
    `HEADS`, or the diameter of the hole as a length.

    Raises
    ------
    InputError
        If it is none of these, or a dimension is invalid.

    Examples
    --------
    >>> [(hole.x, hole.y, hole.diameter) for hole in parse_mount("M3:40mm,-20mm")]
    [(0.04, -0.02, 0.0034)]
    """
    return _parse(text, "mount", MOUNT)


def parse_dowel(text: str) -> tuple[Hole, ...]:
    """Parse dowel holes, in the form of mounting holes, but with a pin's diameter, and the first one on the x axis.

    Two of them, ``2x4mm@130mm``, locate the origin and the x axis. Raises as `parse_mount` does.
    """
    return _parse(text, "dowel", DOWEL)


def _parse(text: str, use: Use, forms: str) -> tuple[Hole, ...]:
    what = "mounting holes" if use == "mount" else "dowel holes"
    count, times, rest = text.partition("x")
    kind, at, circle = rest.rpartition("@")
    screw, colon, places = text.partition(":")
    if times and at and re.fullmatch(r"\s*\d{1,9}\s*", count):
        places_xy = _on_circle(int(count), circle, use, what)
    elif colon and places.strip():
        kind, places_xy = screw, _listed(places, what)
    else:
        raise InputError(what, brief(text), forms)
    diameter, sink, name = _sizes(kind.strip(), use, forms)
    try:
        return tuple(Hole(x, y, diameter, sink, use, name) for x, y in places_xy)
    except InputError as error:
        raise InputError(error.args[0], f"{error.args[1]} in {brief(text)}", error.args[2]) from None


def _on_circle(count: int, circle: str, use: Use, what: str) -> list[tuple[float, float]]:
    if not 1 <= count <= MOST_HOLES:
        raise InputError(f"1 to {MOST_HOLES} {what}", str(count), "use another number")
    size, slash, angle = circle.partition("/")
    diameter = parse_length(size, "pitch circle")
    if diameter <= 0:
        raise InputError("a pitch circle with a diameter above 0", format_length(diameter), "write 120mm, for example")
    first = _degrees(angle) if slash else 0.0 if use == "dowel" else 180 / count
    angles = (radians(first + 360 * k / count) for k in range(count))
    # Whole picometers, so that 4xM3@0.12/0 has its holes on the axes.
    return [(_whole(diameter / 2 * cos(a)), _whole(diameter / 2 * sin(a))) for a in angles]


def _listed(places: str, what: str) -> list[tuple[float, float]]:
    centers = []
    for place in places.split(";"):
        parts = place.split(",")
        if len(parts) != 2:
            raise InputError(f"a place x,y of each of the {what}", brief(place), "write 40mm,-20mm; -40mm,-20mm")
        centers.append((parse_length(parts[0], "x"), parse_length(parts[1], "y")))
    return centers


def _sizes(kind: str, use: Use, forms: str) -> tuple[float, float, str]:
    """Return diameter and countersink in m, and the name of the screw or pin."""
    sunk = _COUNTERSUNK.fullmatch(kind)
    plain = sunk[1] if sunk else kind
    if use == "dowel":
        if sunk or plain[:1] in ("M", "m"):
            raise InputError("the diameter of a dowel pin", brief(kind), forms)
        diameter = parse_length(plain, "pin diameter")
        return diameter, 0.0, f"{format_length(diameter)} pin"
    screw = plain.upper()
    if screw in SCREWS:
        if sunk and screw not in HEADS:
            raise InputError("a countersunk screw", brief(kind), f"known: {', '.join(HEADS)}")
        return _mm(SCREWS[screw]), _mm(HEADS[screw]) if sunk else 0.0, screw
    if sunk:
        raise InputError("a screw that is countersunk", brief(kind), f"known: {', '.join(HEADS)}")
    if re.match(r"[mM]", plain) or not plain:
        raise InputError("a metric screw or a diameter", brief(kind), f"known: {', '.join(SCREWS)}, or 3.4mm")
    return parse_length(plain, "hole diameter"), 0.0, ""


def _mm(value: float) -> float:
    return round(value / 1e3, 9)


def _whole(value: float) -> float:
    return round(value, 12) + 0.0


def _degrees(text: str) -> float:
    try:
        value = float(text.strip().removesuffix("deg"))
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputError("an angle in degrees after /", brief(text), "write 4xM3@120mm/0, for example")
    return value % 360
