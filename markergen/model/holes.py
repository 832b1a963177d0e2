"""Holes as users write them: screws and pins on a pitch circle, or one by one.

``4xM3@0.12``      four clearance holes for M3 screws on a pitch circle of 0.12 m, astride the x axis
``4xM3c@120mm/0``  the same, countersunk, the first one on the x axis
``M3:40mm,-20mm;-40mm,-20mm``   two, where it says
``4x3.4mm@0.12``   holes of a diameter
"""

import re
from math import cos, isfinite, radians, sin
from typing import Literal

from markergen.errors import InputError, brief
from markergen.model.substrate import MOST_HOLES, Hole
from markergen.units import format_length, parse_length

SCREWS = {
    "M1.6": 1.8, "M2": 2.4, "M2.5": 2.9, "M3": 3.4, "M3.5": 3.9, "M4": 4.5, "M5": 5.5, "M6": 6.6, "M8": 9.0,
    "M10": 11.0, "M12": 13.5, "M14": 15.5, "M16": 17.5,
}  # fmt: skip
"""Diameter in mm of the clearance hole of each metric screw: ISO 273, medium series."""

HEADS = {
    "M2": 4.4, "M2.5": 5.5, "M3": 6.72, "M4": 8.96, "M5": 11.2, "M6": 13.44, "M8": 17.92, "M10": 22.4, "M12": 26.88,
    "M14": 30.8, "M16": 33.6,
}  # fmt: skip
"""Largest theoretical diameter in mm of the head of each countersunk screw, so that none stands out: ISO 10642, and
for M2 and M2.5 ISO 14581."""

MOUNT = "write 4xM3@120mm, countersunk 4xM3c@120mm, or M3:40mm,-20mm;-40mm,-20mm"
DOWEL = "write 2x4mm@130mm, or 4mm:65mm,0mm;-65mm,0mm"

_COUNTERSUNK = re.compile(r"(.*?)\s*(?:-?\s*countersunk|(?<=\d)\s*c)\s*", re.IGNORECASE)

Use = Literal["mount", "dowel"]


def parse_mount(text: str) -> tuple[Hole, ...]:
    """Read mounting holes: ``COUNTxSCREW@DIAMETER``, ``COUNTxSCREW@DIAMETER/ANGLE`` or ``SCREW:X,Y;X,Y``.

    The diameter is that of the pitch circle, around the origin of the marker frame. Its holes lie astride the x axis,
    the first one at 180 degrees over their number, unless the first one's angle is given, in degrees counterclockwise
    from the x axis. A screw is one of `SCREWS`, with ``c`` or ``countersunk`` after it if it is one of `HEADS`, or the
    diameter of the hole as a length.

    Raises
    ------
    InputError
        If it is none of these, or a measure is unfit.

    Examples
    --------
    >>> [(hole.x, hole.y, hole.diameter) for hole in parse_mount("M3:40mm,-20mm")]
    [(0.04, -0.02, 0.0034)]
    """
    return _parse(text, "mount", MOUNT)


def parse_dowel(text: str) -> tuple[Hole, ...]:
    """Read dowel holes, written as mounting holes are, but with a pin's diameter, and the first one on the x axis.

    Two of them, ``2x4mm@130mm``, say where the origin is and how the x axis runs. Raises as `parse_mount` does.
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
    found = []
    for place in places.split(";"):
        parts = place.split(",")
        if len(parts) != 2:
            raise InputError(f"a place x,y of each of the {what}", brief(place), "write 40mm,-20mm; -40mm,-20mm")
        found.append((parse_length(parts[0], "x"), parse_length(parts[1], "y")))
    return found


def _sizes(kind: str, use: Use, forms: str) -> tuple[float, float, str]:
    """Diameter and countersink in m, and the name of what goes through."""
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
