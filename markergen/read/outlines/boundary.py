"""Boundaries as users write them: a radius, a shape with its measures, or a file."""

import re
from pathlib import Path

import numpy as np

from markergen.errors import InputError
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.model.findings import brief
from markergen.read.outlines.reader import read_outline
from markergen.units import parse_length

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
        if not str(text).strip():
            raise InputError("a boundary", "none", _FORMS)
        return polygon_from(read_outline(text, unit, layer), origin)
    if shape is None:
        return Circle(parse_length(str(text), "radius"))
    kind, measures, place = shape.groups()
    center = _place(place, origin)
    if kind == "circle":
        return Circle(parse_length(measures, "radius"), center)
    return _rectangle(measures, center)


def is_drawing(text: str | Path) -> bool:
    """Tell whether a boundary is given as a file rather than as a radius or a shape."""
    words = str(text)
    is_number = _NUMBER.fullmatch(words) and not words.lower().endswith(_SUFFIXES)
    return isinstance(text, Path) or not (is_number or _SHAPE.fullmatch(words.strip()))


def _rectangle(measures: str, center: tuple[float, float]) -> Boundary:
    sides = measures.split("x")
    if len(sides) != 2:
        raise InputError("a width and a height", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    half = np.array([parse_length(side, name) / 2 for side, name in zip(sides, ("width", "height"), strict=True)])
    if not (half > 0).all():
        raise InputError("sides above 0", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    return polygon_from([corners + center], "file")


def _place(text: str | None, origin: str) -> tuple[float, float]:
    if text is None:
        return 0.0, 0.0
    if origin == "center":
        raise InputError("no place of a boundary in its own frame", brief(f"@{text}"), "leave it out")
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("a place x,y", brief(f"@{text}"), "write for example circle:3mm@40mm,-20mm")
    return parse_length(parts[0], "x"), parse_length(parts[1], "y")
