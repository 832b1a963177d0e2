"""Parse boundaries and keep-outs as users write them: a radius, a shape with dimensions, or a file."""

# tests: tests/read/outlines/test_boundaries.py

import re
from collections.abc import Mapping, Sequence
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.files import exists
from markergen.geometry.contour import placed
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.read.outlines.reader import LARGEST, SMALLEST, read_contours
from markergen.units import format_length, parse_length

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
    """Make a boundary from text: a radius ``0.15``, ``circle:R``, ``rect:WxH``, or the path of an outline file.

    Parameters
    ----------
    text : str or path
        Lengths have a unit or are in m. For ``origin="file"`` a shape may have a position, ``circle:3mm@40mm,-20mm``,
        which places a keep-out.
    unit, layer : str, optional
        For files, as in `read_outline`.
    origin : {"center", "file"}
        Move the origin to the center of the smallest enclosing circle, or keep that of the file.

    Raises
    ------
    InputError
        If it is none of these, a dimension is not above 0, or the file has no usable outline.
    """
    if origin not in ("center", "file"):
        raise InputError("an origin of center or file", brief(origin), "use --origin center or --origin file")
    shape = _SHAPE.fullmatch(str(text).strip())
    is_file = is_drawing(text)
    if not is_file and (unit is not None or layer is not None):
        raise InputError(
            "--boundary-unit and --layer with an outline file only", brief(text), "write the unit with the number"
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
    """Tell whether a boundary is given as a file rather than a radius or a shape; raises InputError if it is empty."""
    text_lines = str(text)
    if not text_lines.strip():
        raise InputError("a boundary", "none", _FORMS)
    is_number = _NUMBER.fullmatch(text_lines) and not text_lines.lower().endswith(_SUFFIXES)
    return isinstance(text, Path) or not (is_number or _SHAPE.fullmatch(text_lines.strip()))


def read_room(
    boundary: str | None,
    keep_outs: Sequence[str] = (),
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
) -> tuple[Boundary | None, tuple[Boundary, ...]]:
    """Read a boundary and its keep-outs, both in m in the marker frame.

    Keep-outs from a drawing share the frame of a boundary from a drawing and move with it. A shape such as
    ``circle:3mm@40mm,-20mm`` is already in the marker frame.

    Parameters
    ----------
    boundary : str or None
        See `parse_boundary`; None for no boundary.
    keep_outs : sequence of str
        Shapes or drawings; ``plate.dxf#HOLES`` selects a layer.
    unit, layer, origin : str
        See `parse_boundary`; the unit also applies to keep-outs.

    Raises
    ------
    InputError
        See `parse_boundary`.
    """
    drawings = [text for text in (boundary, *keep_outs) if text is not None and is_drawing(_split(text)[0])]
    if unit is not None and not drawings:
        raise InputError("a drawing for --boundary-unit", "none", "write the unit with the number: 150mm")
    if boundary is None:
        return None, tuple(_keep_out(text, unit, (0.0, 0.0)) for text in keep_outs)
    drawn = is_drawing(boundary)
    room = parse_boundary(boundary, unit if drawn else None, layer, "file" if drawn else origin)
    offset = room.center if drawn and origin == "center" else (0.0, 0.0)
    if drawn:
        room = polygon_from(room.contours(), origin)
    return room, tuple(_keep_out(text, unit, offset) for text in keep_outs)


def drawn_plate(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the substrate table for a boundary from a drawing: the drawing is the plate's outline, without an edge.

    It is stored explicitly, since a drawn rectangle equals one that was given by its dimensions.

    Raises
    ------
    InputError
        If there is an edge but no outline for the plate.
    """
    if values.get("outline") is not None:
        return dict(values)
    if values.get("edge"):
        raise InputError(
            "an edge around a disk or a rectangle only",
            "--edge with a drawing, whose outline is the plate's",
            "leave out --edge, or draw the plate and give it as --outline",
        )
    return {**values, "edge": 0.0}


def _check_size(size: float, text: str | Path, origin: str) -> None:
    """Refuse a size that most likely lacks its unit; keep-outs may be arbitrarily small."""
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
        raise InputError("no position of a boundary in its own frame", brief(f"@{text}"), "leave it out")
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("a position x,y", brief(f"@{text}"), "write for example circle:3mm@40mm,-20mm")
    return parse_length(parts[0], "x"), parse_length(parts[1], "y")


def _keep_out(text: str, unit: str | None, offset: tuple[float, float]) -> Boundary:
    path, layer = _split(text)
    if not is_drawing(path):
        return parse_boundary(text, origin="file")
    return moved_outline(parse_boundary(path, unit, layer, "file"), offset)


def moved_outline(region: Boundary, origin: Sequence[float]) -> Boundary:
    """Return a region as it is seen from another origin, in whole picometers."""
    if isinstance(region, Circle):
        x, y = (round(value - start, 12) + 0.0 for value, start in zip(region.center, origin, strict=True))
        return Circle(region.size, (x, y))
    return polygon_from([placed(contour, 1.0, origin, 12) for contour in region.contours()], "file")


def _split(text: str) -> tuple[str, str | None]:
    path, mark, layer = text.rpartition("#")
    if not mark or not path or exists(Path(text)):
        return text, None
    return path, layer
