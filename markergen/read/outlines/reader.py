"""From a drawing to closed outlines in m: unit, size, flattening, joining, nesting."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.geometry.contour import Contour, backward, mirrored
from markergen.geometry.outlines import TOLERANCE, canonical_contours, polygons_of
from markergen.read.outlines.curves import MOST_POINTS
from markergen.read.outlines.drawing import MOST_PIECES, UNITS, Drawing, OutlineFile, load
from markergen.read.outlines.formats import OUTLINE_FORMATS
from markergen.read.outlines.rings import Track, close
from markergen.units import format_length

Array = NDArray[np.float64]

SMALLEST, LARGEST = 1e-3, 100.0
"""m across: what lies outside has most likely been given in another unit."""


def read_outline(path: Path | str, unit: str | None = None, layer: str | None = None) -> tuple[Array, ...]:
    """Read all closed outlines as polygons (m, 2), arcs within 5 um; else as `read_contours`."""
    return polygons_of(read_contours(path, unit, layer))


def read_contours(path: Path | str, unit: str | None = None, layer: str | None = None) -> tuple[Contour, ...]:
    """Read all closed outlines of an SVG, DXF or GeoJSON file, in m, y up, about the file's own origin.

    Lines and arcs of circles stay what they are. Other curves become polygons that are nowhere more than 5 um off, and
    less for what is smaller than 50 mm. Outer outlines run counterclockwise, holes clockwise: what lies within an odd
    number of outlines is a hole. Pieces whose ends lie within 1 um (3 millionths of the drawing above 0.3 m) are
    joined.

    Parameters
    ----------
    path : path
    unit : str, optional
        One of `UNITS`: the length of one unit of the coordinates, whatever the file says itself. Only px are those
        in which an SVG gives its width and height.
    layer : str, optional
        Read this layer alone, visible or not; otherwise all that are visible.

    Raises
    ------
    InputError
        If the file cannot be read or is damaged, refers to other files, does not tell its unit, or makes an absurd
        size of it; if there is no outline, or one is open, has no area, crosses itself or another. Places in messages
        are the file's own coordinates, in m or mm.
    """
    if unit is not None and unit not in UNITS:
        raise InputError("a known --boundary-unit", brief(unit), f"known: {', '.join(UNITS)}")
    file = load(Path(path))
    format_ = next((OUTLINE_FORMATS[name] for name in OUTLINE_FORMATS if OUTLINE_FORMATS[name].fits(file)), None)
    if format_ is None:
        known = "; ".join(f"{name}: {OUTLINE_FORMATS[name].signs}" for name in OUTLINE_FORMATS)
        raise InputError(f"an outline in {file.name}", "no format that is known", f"known formats: {known}")
    # What overflows is not finite, and told by its name.
    with np.errstate(over="ignore", invalid="ignore"):
        drawing = format_.read(file, layer)
        if len(drawing.pieces) > MOST_PIECES:
            raise file.too_much(f"at most {MOST_PIECES} pieces of outline")
        size = _size(drawing, file)
    scale = _scale(drawing, size, file, unit)
    size *= scale
    rings = close(_tracks(drawing, scale, min(TOLERANCE, 1e-4 * size), file), max(1e-6, 3e-6 * size), file.name)
    if not rings:
        raise _none(drawing, file)
    try:
        contours = canonical_contours([ring.points for ring in rings], [ring.bulges for ring in rings])
    except InputError as error:
        expected, found, remedy = error.args
        raise InputError(f"{expected} in {file.name}", found, remedy) from None
    # A mirrored outline runs the other way round.
    return tuple(backward(mirrored(contour)) if drawing.y_down else contour for contour in contours)


def _size(drawing: Drawing, file: OutlineFile) -> float:
    """Diagonal of the box around all curves, in the file's unit."""
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
            "an outline near the file's origin", f"one {size:.3g} units across, {np.abs(points).max():.3g} units off",
            "move it to the origin: so far out its digits are lost",
        )  # fmt: skip
    return size


def _scale(drawing: Drawing, size: float, file: OutlineFile, unit: str | None) -> float:
    """Return m per unit, from the user or else from the file, if the outcome may be a marker."""
    scale = UNITS[unit] * (drawing.pixels if unit == "px" else 1.0) if unit else drawing.scale
    if scale is None:
        raise file.unreadable(
            "a unit of length",
            f"none: the drawing is {size:.6g} units across",
            f"give --boundary-unit, one of {', '.join(UNITS)}{drawing.hint}",
        )
    if not SMALLEST <= size * scale <= LARGEST:
        raise file.unreadable(
            f"a marker of {format_length(SMALLEST)} to {format_length(LARGEST)}",
            f"one that is {format_length(size * scale)} across{f' with {unit} for the unit' if unit else ''}",
            f"give {'another' if unit else 'the'} --boundary-unit, one of {', '.join(UNITS)}",
        )
    return scale


def _tracks(drawing: Drawing, scale: float, tolerance: float, file: OutlineFile) -> list[Track]:
    tracks, total = [], 0
    for piece in drawing.pieces:
        try:
            points, bulges = _traced([curve.trace(tolerance / scale) for curve in piece.curves])
        except InputError as error:
            expected, found, remedy = error.args
            raise file.unreadable(expected, f"{found}, {piece.name}", remedy) from None
        total += len(points)
        if total > MOST_POINTS:
            raise file.too_much(f"outlines that {MOST_POINTS} points can follow to {tolerance * 1e6:.2g} um")
        tracks.append(Track(piece.name, points * scale, piece.closed, bulges))
    return tracks


def _traced(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Points and bulges of curves one after the other, with a line from each to the next."""
    bulges = [np.append(bulges, 0.0) for _, bulges in parts]
    return np.concatenate([points for points, _ in parts]), np.concatenate(bulges)[:-1]


def _none(drawing: Drawing, file: OutlineFile) -> InputError:
    others = sorted(set(drawing.others))
    found = f"only {', '.join(others[:8])}" if others else "none"
    remedy = "draw a closed shape, turn text into paths, or choose another --layer"
    return file.unreadable("a closed outline", found, remedy)
