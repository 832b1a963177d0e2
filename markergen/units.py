"""The one parser of lengths, used where users type them; inside, everything is in metres."""

import math
import re

from markergen.errors import InputError

METRES = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf))\s*([a-zA-Z]*)\s*", re.IGNORECASE)


def parse_length(text: str | float, name: str = "length") -> float:
    """Read a length such as ``0.15``, ``150mm`` or ``6in`` and return metres; a bare number is metres.

    Raises
    ------
    InputError
        If the text is not a finite number with a known unit.

    Examples
    --------
    >>> parse_length("150mm"), parse_length("6in"), parse_length("0.15")
    (0.15, 0.1524, 0.15)
    """
    match = _LENGTH.fullmatch(str(text))
    known = ", ".join(unit for unit in METRES if unit)
    if match is None or match[2] not in METRES:
        raise InputError(
            f"a length for {name}", repr(str(text)), f"write a number and one of {known} (a bare number is metres)"
        )
    value = float(match[1])
    if not math.isfinite(value):
        raise InputError(f"a finite {name}", f"{name}={text}", "write a number such as 0.15 or 150mm")
    # Division keeps 150mm equal to 0.15 to the last bit, where 150 * 1e-3 is not.
    scale = METRES[match[2]]
    return value / round(1 / scale) if scale < 1e-2 or match[2] == "cm" else value * scale


def format_length(metres: float) -> str:
    """Write a length for people: millimetres below one metre, metres above.

    >>> format_length(0.036), format_length(1.5)
    ('36 mm', '1.5 m')
    """
    return f"{metres * 1e3:.6g} mm" if abs(metres) < 1 else f"{metres:.6g} m"
