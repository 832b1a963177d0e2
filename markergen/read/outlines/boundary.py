"""Boundaries as users write them: a radius, a shape with its measures, or a file."""

import re
from math import hypot
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.read.outlines.reader import LARGEST, SMALLEST, read_contours
from markergen.units import format_length, parse_length

Array = NDArray[np.float64]

_NUMBER = re.compile(r"\s*[-+]?\.?\d[^/\\]*")
_SUFFIXES = (".svg", ".dxf", ".json", ".geojson")
_SHAPE = re.compile(r"(circle|rect):([^@]*)(?:@([^@]*))?")
_FORMS = "write a radius such as 0.15, circle:150mm, rect:0.2x0.1 or rect:200mmx100mm, or an SVG, DXF or GeoJSON file"


def parse_boundary(
    text: str | Path,
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
) -> Boundary:
    """Make the boundary of text: a radius ``0.15``, ``circle:R``, ``rect:WxH``, or the path of an outline's file.

    Parameters
    ----------
    text : str or path
        Lengths carry a unit or are in m. For ``origin="file"`` a shape may have a place, ``circle:3mm@40mm,-20mm``:
        that is how a keep-out is put where it belongs.
    unit, layer : str, optional
        For files, as in `read_outline`.
    origin : {"center", "file"}
        Move the origin to the center of the smallest enclosing circle, or leave it where the file has it.

    Raises
    ------
    InputError
        If it is none of these, a measure is not above 0, or the file has no usable outline.
    """
    if origin not in ("center", "file"):
        raise InputError("an origin of center or file", brief(origin), "use --origin center or --origin file")
    shape = _SHAPE.fullmatch(str(text).strip())
    is_file = is_drawing(text)
    if not is_file and (unit is not None or layer is not None):
        raise InputError(
            "a --boundary-unit or --layer with an outline's file alone", brief(text), "write the unit with the number"
        )
    if is_file:
        return polygon_from(read_contours(text, unit, layer), origin)
    kind, measures, place = shape.groups() if shape is not None else ("circle", str(text), None)
    center = _place(place, origin)
    if kind == "circle":
        radius = parse_length(measures, "radius")
        _check_size(2 * radius, text, origin)
        return Circle(radius, center)
    half = _half_sides(measures)
    _check_size(2 * hypot(*half), text, origin)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    return polygon_from([corners + center], "file")


def is_drawing(text: str | Path) -> bool:
    """Tell whether a boundary is given as a file rather than as a radius or a shape; raises InputError if as none."""
    words = str(text)
    if not words.strip():
        raise InputError("a boundary", "none", _FORMS)
    is_number = _NUMBER.fullmatch(words) and not words.lower().endswith(_SUFFIXES)
    return isinstance(text, Path) or not (is_number or _SHAPE.fullmatch(words.strip()))


def _check_size(size: float, text: str | Path, origin: str) -> None:
    """Refuse what is most likely given without its unit; holes to keep out of may be as small as they like."""
    if size > LARGEST or (0 < size < SMALLEST and origin == "center"):
        raise InputError(
            f"a boundary of {format_length(SMALLEST)} to {format_length(LARGEST)}",
            f"{format_length(size)} across for {brief(str(text))}",
            "write the unit with each number, such as 150mm or rect:200mmx100mm",
        )


def _half_sides(measures: str) -> Array:
    sides = measures.split("x")
    if len(sides) != 2:
        raise InputError("a width and a height", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    half = np.array([parse_length(side, name) / 2 for side, name in zip(sides, ("width", "height"), strict=True)])
    if not (half > 0).all():
        raise InputError("sides above 0", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    return half


def _place(text: str | None, origin: str) -> tuple[float, float]:
    if text is None:
        return 0.0, 0.0
    if origin == "center":
        raise InputError("no place of a boundary in its own frame", brief(f"@{text}"), "leave it out")
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("a place x,y", brief(f"@{text}"), "write for example circle:3mm@40mm,-20mm")
    return parse_length(parts[0], "x"), parse_length(parts[1], "y")
