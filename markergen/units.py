"""The only parsers of lengths and of named numbers, for user input; internally, all lengths are in meters."""

import math
import re
from collections.abc import Iterable
from decimal import Decimal
from difflib import get_close_matches

from markergen.errors import InputError

METERS = {"": "1", "m": "1", "cm": "0.01", "mm": "0.001", "um": "0.000001", "in": "0.0254", "ft": "0.3048"}
"""Size of each unit in m, as text: products are computed in decimals, so that 6in is 0.1524 to the last bit."""

SMALLEST_LENGTH, LARGEST_LENGTH = 1e-6, 1e3
"""Range in m of sizes above 0, and of the amounts of coordinates: anything beyond was meant in another unit."""

NEGLIGIBLE = 1e-9
"""Coordinate in m that is 0: searches leave dots at 2e-10 and 9e-10 beside an axis, and markers may err by 1e-9."""

SECONDS = {"": 1.0, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf))\s*([a-zA-Z]*)\s*", re.IGNORECASE)


def with_point(text: object) -> str:
    """Return a length with a decimal comma as it is written with a point; empty for any other text.

    >>> with_point("8,5cm"), with_point("8.5cm")
    ('8.5cm', '')
    """
    pointed = str(text).replace(",", ".")
    return pointed if pointed != str(text) and _LENGTH.fullmatch(pointed) else ""


def picometers(meters: float) -> float:
    """Return a length in m as it is written: rounded to 1e-12, and 0 if it is negligible; never -0.

    >>> picometers(0.020000000000000004), picometers(-1e-10)
    (0.02, 0.0)
    """
    return round(float(meters), 12) if abs(meters) >= NEGLIGIBLE else 0.0


def parse_length(text: str | float, name: str = "length", largest: float = LARGEST_LENGTH) -> float:
    """Parse a length such as ``0.15``, ``150mm`` or ``6in`` and return meters; a bare number is in meters.

    Raises
    ------
    InputError
        If the text is not a finite number with a known unit, or its amount is above the `largest`.

    Examples
    --------
    >>> parse_length("150mm"), parse_length("6in"), parse_length("0.15")
    (0.15, 0.1524, 0.15)
    """
    match = _LENGTH.fullmatch(str(text))
    units = ", ".join(unit for unit in METERS if unit)
    if match is None or match[2] not in METERS:
        pointed = with_point(text)
        raise InputError(
            "a length" if name == "length" else f"a length for {name}",
            repr(str(text)),
            f"write a point: {pointed}" if pointed else f"write a number and one of {units} (a bare number is meters)",
        )
    try:
        value = float(Decimal(match[1]) * Decimal(METERS[match[2]]))
    except ArithmeticError:
        value = math.inf
    if not math.isfinite(value):
        raise InputError(f"a finite {name}", f"{name}={text}", "write a number such as 0.15 or 150mm")
    if abs(value) > largest:
        expected = f"a {name} of at most {largest / 1e3:g} km"
        raise InputError(expected, f"{name}={text}", "write the unit with the number, such as 150mm")
    return value


def parse_duration(text: str | float) -> float:
    """Parse a duration such as ``30``, ``30s``, ``2min`` or ``1h`` and return seconds.

    Raises
    ------
    InputError
        If the text is not a positive number with one of these units.

    Examples
    --------
    >>> parse_duration("2min"), parse_duration(30)
    (120.0, 30.0)
    """
    match = _LENGTH.fullmatch(str(text))
    seconds = float(match[1]) * SECONDS[match[2]] if match and match[2] in SECONDS else 0.0
    if not 0 < seconds < math.inf:
        raise InputError("a duration", repr(str(text)), "write a number and one of ms, s, min, h: 30s")
    return seconds


def format_length(meters: float) -> str:
    """Format a length for people: millimeters below one meter, meters above.

    >>> format_length(0.036), format_length(1.5), format_length(-0.0)
    ('36 mm', '1.5 m', '0 mm')
    """
    return f"{meters * 1e3 + 0.0:.6g} mm" if abs(meters) < 1 else f"{meters:.6g} m"


def two_digits(value: float) -> str:
    """Write a number with two digits, without an exponent.

    >>> two_digits(0.571), two_digits(163.4), two_digits(2981.0)
    ('0.57', '160', '3000')
    """
    return f"{float(f'{value:.2g}'):g}"


def parse_settings(text: str, keys: Iterable[str], what: str) -> dict[str, float]:
    """Parse named numbers such as ``blur_px=1.5,noise_grey=4``; empty text names none.

    Raises
    ------
    InputError
        If a name is not a known one, or given twice, or its value is not a number.

    Examples
    --------
    >>> parse_settings("blur_px=1.5, bits=12", ("blur_px", "bits"), "optics")
    {'blur_px': 1.5, 'bits': 12}
    """
    names, values = list(keys), dict[str, float]()
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in names or name in values:
            matches = get_close_matches(name, names, n=1)
            hint = (
                f"did you mean {matches[0]!r}? Known: " if matches and name not in values else "name each once; known: "
            )
            raise InputError(f"{what} as name=value,...", repr(part), hint + ", ".join(names))
        try:
            values[name] = int(value) if value.isdecimal() else float(value)
        except ValueError:
            raise InputError(f"a number for {name}", repr(part), f"write {name}= and a number") from None
    return values


def duration(seconds: float) -> str:
    """Format a duration for people: seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
