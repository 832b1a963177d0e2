"""Parse boundaries and keep-outs as users write them: a radius, a shape with dimensions, or a drawing.

A drawing becomes closed outlines in m: unit, size, flattening, joining ends, nesting. What is plainly no part of an
outline is left out with a warning: shapes without area, center lines, and loops that no tool can cut.
"""
# tests: tests/read/outlines/test_boundaries.py tests/read/outlines/test_files.py

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from math import hypot, inf
from pathlib import Path
from typing import Any

import numpy as np

from markergen.errors import InputError, brief, with_place
from markergen.geometry.contour import Contour, area, backward, mirrored, placed, without_loops
from markergen.geometry.outlines import TOLERANCE, canonical_contours
from markergen.guard import read
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.read.formats import recognized, refuse_unreadable, split, unknown_format
from markergen.read.outlines.curves import MOST_POINTS, Track, closed_contours, remark_left_out
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    PIXELS_PER_INCH,
    UNITS,
    Drawing,
    OutlineFile,
)
from markergen.read.remarks import remark, remark_unused
from markergen.units import format_length, parse_length

SMALLEST, LARGEST = 1e-3, 100.0
"""Plausible sizes across in m; anything outside was most likely given in another unit."""

TINY = "a loop below 0.01 mm^2,"
SMALLEST_LOOP, SHORTEST_LOOP = 1e-8, 2e-3
"""Area in m^2 below which a loop is left out, and the length in m of those that are sought in outlines that cross
themselves: box generators leave loops of 0.0006 mm^2 at inner corners, half a kerf wide."""


def read_contours(
    path: Path | str, unit: str | None = None, layer: str | None = None, ignore_open: bool = False
) -> tuple[Contour, ...]:
    """Read all closed outlines of an SVG, DXF, GeoJSON or KiCad file, in m, y up, about the file's own origin.

    Lines and circular arcs are kept exactly. Other curves become polygons within 5 um, less for outlines smaller than
    50 mm. Outer outlines run counterclockwise, holes clockwise: an outline inside an odd number of others is a hole.
    Pieces whose ends lie within 1 um (3 millionths of the drawing above 0.3 m) are joined.

    Raises InputError if the file cannot be read or is damaged, refers to other files, states no unit, or has an
    implausible size; if there is no outline, or one is open, has no area, or intersects itself or another. Messages
    give places in the file's own coordinates, in m or mm.

    Parameters
    ----------
    unit : str, optional
        One of `UNITS`: the length of one coordinate unit, overriding the file's own. For px, the pixels are those of
        the width and height of an SVG.
    layer : str, optional
        Read this layer only, visible or not; by default all visible layers, and Edge.Cuts of KiCad.
    ignore_open : bool
        Leave out lines that bound nothing, and list them in a warning.
    """
    return outline_reading(path, unit, layer, ignore_open)[0]


def outline_reading(
    path: Path | str, unit: str | None = None, layer: str | None = None, ignore_open: bool = False
) -> tuple[tuple[Contour, ...], str, float]:
    """Read outlines as `read_contours` does, with the name of their format and the length in m of its unit."""
    if unit is not None and unit not in UNITS:
        raise InputError("a known --boundary-unit", brief(unit), f"known: {', '.join(UNITS)}")
    file = OutlineFile(*read(Path(path), "outline"))
    refuse_unreadable(file.name, file.data, "outline")
    if (form := recognized(OUTLINE_FORMATS, file)) is None:
        raise unknown_format(OUTLINE_FORMATS, file.name, "an outline")
    # Overflows become infinite, and are reported with the piece's name.
    with np.errstate(over="ignore", invalid="ignore"):
        drawing = OUTLINE_FORMATS[form].read(file, layer)
        if len(drawing.pieces) > MOST_PIECES:
            raise file.too_much(f"at most {MOST_PIECES} pieces of outline")
        size = _size(drawing, file)
    scale = _scale(drawing, size, file, unit)
    size *= scale
    tracks = _tracks(drawing, scale, min(TOLERANCE, 1e-4 * size), file)
    rings = closed_contours(tracks, max(1e-6, 3e-6 * size), file.name, ignore_open)
    if not rings:
        raise _none(drawing, file)
    counts = Counter(drawing.others)
    remark_unused(file.name, (f"{count} {name}" if count > 1 else name for name, count in counts.items()))
    if unit == "px" and drawing.pixels_per_inch != PIXELS_PER_INCH and drawing.scale is None:
        remark(f"{file.name}: px of {drawing.pixels_per_inch:g} to the inch, as its program writes, would be pt")
    contours = _canonical(rings, file.name)
    # Mirroring reverses the direction of an outline.
    upright = tuple(backward(mirrored(contour)) if drawing.y_down else contour for contour in contours)
    return upright, form, scale


def _canonical(rings: list[Contour], source: str) -> tuple[Contour, ...]:
    """Return contours that are nested and do not cross, without loops that no tool can cut."""
    large = [ring for ring in rings if abs(area(ring)) >= SMALLEST_LOOP] or rings
    remark_left_out(source, [(TINY, ring.points[0]) for ring in rings if ring not in large])

    def canonical(contours: list[Contour]) -> tuple[Contour, ...]:
        return canonical_contours([ring.points for ring in contours], [ring.bulges for ring in contours])

    try:
        return canonical(large)
    except InputError as error:
        # Sought only now, since it takes longer.
        mended, places = zip(*(without_loops(ring, SMALLEST_LOOP, SHORTEST_LOOP) for ring in large), strict=True)
        with with_place(f"in {source}"):
            if not any(places):
                raise error from None
            contours = canonical(list(mended))
    remark_left_out(source, [(TINY, point) for points in places for point in points])
    return contours


def _size(drawing: Drawing, file: OutlineFile) -> float:
    """Diagonal of the bounding box of all curves, in the file's unit."""
    sketches = [(piece.name, curve.sketch()) for piece in drawing.pieces for curve in piece.curves]
    if not sketches:
        raise _none(drawing, file)
    for name, points in sketches:
        if not np.isfinite(points).all():
            raise file.unreadable("finite coordinates", f"nan, infinity or endless numbers in {name}", "correct it")
    points = np.concatenate([points for _, points in sketches])
    size = float(np.hypot(*np.ptp(points, axis=0)))
    if size == 0:
        raise file.unreadable("outlines with an area", "single points", "draw a closed shape with an inside")
    if not float(np.abs(points).max()) < 1e9 * size < np.inf:
        raise file.unreadable(
            "an outline near the file's origin",
            f"one {size:.3g} units across, {np.abs(points).max():.3g} units off",
            "move it to the origin: so far out its digits are lost",
        )
    return size


def _scale(drawing: Drawing, size: float, file: OutlineFile, unit: str | None) -> float:
    """Return m per unit, as given by the user or else the file, if the resulting size is plausible."""
    scale = UNITS[unit] * (drawing.pixels if unit == "px" else 1.0) if unit else drawing.scale
    if scale is None:
        remedy = f"give --boundary-unit, one of {', '.join(UNITS)}{drawing.hint}"
        raise file.unreadable("a unit of length", f"none: the drawing is {size:.6g} units across", remedy)
    if not SMALLEST <= size * scale <= LARGEST:
        remedy = f"give {'another' if unit else 'the'} --boundary-unit, one of {', '.join(UNITS)}"
        if size * min(UNITS.values()) > LARGEST:
            farthest = max(
                drawing.pieces, key=lambda piece: max(np.abs(curve.sketch()).max() for curve in piece.curves)
            )
            remedy = f"remove or correct what is so far out, such as {farthest.name}"
        raise file.unreadable(
            f"a marker of {format_length(SMALLEST)} to {format_length(LARGEST)}",
            f"one that is {format_length(size * scale)} across{f' with {unit} for the unit' if unit else ''}",
            remedy,
        )
    return scale


def _tracks(drawing: Drawing, scale: float, tolerance: float, file: OutlineFile) -> list[Track]:
    tracks, total = [], 0
    for piece in drawing.pieces:
        try:
            parts = [curve.trace(tolerance / scale) for curve in piece.curves]
        except InputError as error:
            expected, problem, remedy = error.args
            raise file.unreadable(expected, f"{problem}, {piece.name}", remedy) from None
        # With a line from each curve to the next.
        points = np.concatenate([points for points, _ in parts])
        bulges = np.concatenate([np.append(bulges, 0.0) for _, bulges in parts])[:-1]
        total += len(points)
        if total > MOST_POINTS:
            raise file.too_much(f"outlines that {MOST_POINTS} points can approximate to {tolerance * 1e6:.2g} um")
        tracks.append(Track(piece.name, points * scale, piece.closed, bulges))
    return tracks


def _none(drawing: Drawing, file: OutlineFile) -> InputError:
    others = sorted(set(drawing.others))
    content = f"only {', '.join(others[:8])}" if others else "none"
    remedy = "draw a closed shape, turn text into paths, or choose another --layer"
    return file.unreadable("a closed outline", content, remedy)


_NUMBER = re.compile(r"\s*[-+]?\.?\d[^/\\]*")
_SUFFIXES = (".svg", ".dxf", ".json", ".geojson", ".kicad_pcb")
_SHAPE = re.compile(r"(circle|rect):([^@]*)(?:@([^@]*))?")
_RECTANGLE = "write rect:0.2x0.1 or rect:200mmx100mm"
_FORMS = (
    "write a radius such as 0.15, circle:150mm, rect:0.2x0.1 or rect:200mmx100mm, or an SVG, DXF, GeoJSON or KiCad file"
)


def parse_boundary(
    text: str | Path,
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
    ignore_open: bool = False,
) -> Boundary:
    """Make a boundary from text: a radius ``0.15``, ``circle:R``, ``rect:WxH``, or the path of an outline file.

    Raises InputError if it is none of these, a dimension is not above 0, or the file has no usable outline.

    Parameters
    ----------
    text : str or path
        Lengths have a unit or are in m. For ``origin="file"`` a shape may have a position, ``circle:3mm@40mm,-20mm``,
        which places a keep-out.
    unit, layer, ignore_open : optional
        For files, as in `read_contours`.
    origin : {"center", "file"}
        Move the origin to the center of the smallest enclosing circle, or keep that of the file.
    """
    if origin not in ("center", "file"):
        raise InputError("an origin of center or file", brief(origin), "use --origin center or --origin file")
    shape = _SHAPE.fullmatch(str(text).strip())
    is_file = is_drawing(text)
    if not is_file and (unit is not None or layer is not None or ignore_open):
        expected = "--boundary-unit, --layer and --ignore-open with an outline file only"
        raise InputError(expected, brief(text), "write the unit with the number")
    if is_file:
        return polygon_from(read_contours(text, unit, layer, ignore_open), origin)
    kind, measures, place = shape.groups() if shape is not None else ("circle", str(text), None)
    center = _place(place, origin)
    if kind == "circle":
        radius = parse_length(measures, "radius", inf)
        _check_size(2 * radius, text, origin)
        return Circle(radius, center)
    sides = measures.split("x")
    if len(sides) != 2:
        raise InputError("a width and a height", brief(f"rect:{measures}"), _RECTANGLE)
    half = np.array([parse_length(side, name, inf) / 2 for side, name in zip(sides, ("width", "height"), strict=True)])
    if not (half > 0).all():
        raise InputError("sides above 0", brief(f"rect:{measures}"), _RECTANGLE)
    _check_size(2 * hypot(*half), text, origin)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    return polygon_from([corners + center], "file")


PAGE = "page"
"""Boundary that is the largest rectangle which a page holds."""


def is_drawing(text: str | Path) -> bool:
    """Tell whether a boundary is given as a file rather than a radius or a shape; raises InputError if it is empty."""
    text_lines = str(text)
    if not text_lines.strip():
        raise InputError("a boundary", "none", _FORMS)
    is_number = _NUMBER.fullmatch(text_lines) and not text_lines.lower().endswith(_SUFFIXES)
    return isinstance(text, Path) or not (is_number or text == PAGE or _SHAPE.fullmatch(text_lines.strip()))


def read_room(
    boundary: str | None,
    keep_outs: Sequence[str] = (),
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
    ignore_open: bool = False,
) -> tuple[Boundary | None, tuple[Boundary, ...]]:
    """Read a boundary and its keep-outs, both in m in the marker frame.

    Keep-outs from a drawing share the frame of a boundary from a drawing and move with it. A shape such as
    ``circle:3mm@40mm,-20mm`` is already in the marker frame.

    See `parse_boundary` for the arguments and errors; the unit and `ignore_open` also apply to keep-outs, of which
    ``plate.dxf#HOLES`` selects a layer.
    """
    drawings = [text for text in (boundary, *keep_outs) if text is not None and is_drawing(split(text)[0])]
    if unit is not None and not drawings:
        raise InputError("a drawing for --boundary-unit", "none", "write the unit with the number: 150mm")
    if ignore_open and not drawings:
        raise InputError("a drawing for --ignore-open", "none", "leave it out")
    if boundary is None:
        return None, tuple(_keep_out(text, unit, (0.0, 0.0), ignore_open) for text in keep_outs)
    drawn = is_drawing(boundary)
    room = parse_boundary(boundary, unit if drawn else None, layer, "file" if drawn else origin, ignore_open and drawn)
    offset = room.center if drawn and origin == "center" else (0.0, 0.0)
    if drawn:
        room = polygon_from(room.contours(), origin)
    return room, tuple(_keep_out(text, unit, offset, ignore_open) for text in keep_outs)


def drawn_plate(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the substrate table for a boundary from a drawing: the drawing is the plate's outline, without an edge.

    It is stored explicitly, since a drawn rectangle equals one that was given by its dimensions.

    Raises InputError if there is an edge but no outline for the plate.
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


def _place(text: str | None, origin: str) -> tuple[float, float]:
    if text is None:
        return 0.0, 0.0
    if origin == "center":
        raise InputError("no position of a boundary in its own frame", brief(f"@{text}"), "leave it out")
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("a position x,y", brief(f"@{text}"), "write for example circle:3mm@40mm,-20mm")
    return parse_length(parts[0], "x"), parse_length(parts[1], "y")


def _keep_out(text: str, unit: str | None, offset: tuple[float, float], ignore_open: bool) -> Boundary:
    path, layer = split(text)
    if not is_drawing(path):
        return parse_boundary(text, origin="file")
    return moved_outline(parse_boundary(path, unit, layer, "file", ignore_open), offset)


def moved_outline(region: Boundary, origin: Sequence[float]) -> Boundary:
    """Return a region as it is seen from another origin, in whole picometers."""
    if isinstance(region, Circle):
        x, y = (round(value - start, 12) + 0.0 for value, start in zip(region.center, origin, strict=True))
        return Circle(region.size, (x, y))
    return polygon_from([placed(contour, 1.0, origin, 12) for contour in region.contours()], "file")
