"""PNG at true size: pixel coverage as grey levels, drawn and compressed strip by strip.

The writer of the file's chunks is our own: Pillow needs the entire image in memory, up to 2 GB, where strips take 4 MB,
and writes different bytes for the same pixels from version to version.
"""

import struct
import zlib
from collections.abc import Iterator
from math import acos, ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.arrays import Array
from markergen.drawing.colors import channels, is_grey
from markergen.drawing.paper import Paper, find_paper
from markergen.drawing.scene import Disk, FilledPath, Line, Shape, Sheet
from markergen.errors import InputError
from markergen.exporters import ExportOptions, check_dpi
from markergen.geometry.coverage import Runs, covered_runs, unit_disk

Pixels = NDArray[np.uint8]

STRIP = 1 << 22
"""Number of pixels drawn at a time: 4 MB per channel."""
LONG = 48
"""Minimum length in pixels of a run that is filled separately rather than pixel by pixel."""
SAGITTA = 2e-3
"""Maximum distance in pixels of a chord from its curve; a grey level is 4e-3 of a pixel."""
FEWEST_ARCS = 32
"""Minimum number of chords of a circle; `SAGITTA` asks for more from a radius of 0.42 px on."""
MITER = 4.0
"""Maximum miter length in line widths, as in SVG; beyond it a corner is beveled."""
MOST_BYTES = 2e9
"""Maximum size of an image before compression, bytes."""
MILLIMETERS_PER_INCH = 25.4
"""Printers' resolutions are in dots per inch."""


def check_image(options: ExportOptions) -> None:
    """Reject a resolution that makes the image too large for the requested paper.

    Raises
    ------
    InputError
        As for `image_size`, or if the paper is unknown.
    """
    if options.sheet.paper is not None:
        image_size(find_paper(options.sheet.paper, options.sheet.orientation), options.dpi)


def write_png(sheet: Sheet, dpi: float) -> bytes:
    """Write a sheet as PNG: 8-bit grey if all of its colors are grey, otherwise RGB.

    PNG stores an integer number of pixels per meter, so the scale is the one nearest to `dpi` (600 dpi: 23622 per m),
    both in the file and in the drawing. The top left corner of the image is that of the page; its right and lower edge
    are the pixel borders nearest to the page's. The center of a pixel (column, row) lies at ((column + 0.5) / s, (row +
    0.5) / s) from there, with s pixels per m.

    Raises
    ------
    InputError
        If the image would need more than 2 GB before compression, or dpi is out of range.
    """
    per_meter = pixels_per_meter(dpi)
    colors = [shape.color for shape in sheet.scene]
    depth = 1 if all(map(is_grey, colors)) else 3
    width, height = image_size(sheet.paper, dpi, depth)
    painted = [
        (shape_runs(shape, per_meter / 1e3, sheet.paper.height, width, height), channels(shape.color)[:depth])
        for shape in sheet.scene
    ]
    texts = {
        "Title": sheet.title,
        "Author": "markergen",
        "Description": sheet.description,
        "Software": f"markergen {markergen.__version__}",
    }
    chunks = [
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0 if depth == 1 else 2, 0, 0, 0)),
        _chunk(b"pHYs", struct.pack(">IIB", per_meter, per_meter, 1)),
        *(_chunk(b"tEXt", f"{key}\0{text}".encode("latin-1", "replace")) for key, text in texts.items()),
        *(_chunk(b"IDAT", data) for data in _compressed(painted, width, height, depth)),
        _chunk(b"IEND", b""),
    ]
    return b"".join([b"\x89PNG\r\n\x1a\n", *chunks])


def pixels_per_meter(dpi: float) -> int:
    """Integer number of pixels per meter nearest to dpi.

    Raises
    ------
    InputError
        If dpi is not between 10 and 10000.
    """
    check_dpi(dpi)
    return round(dpi / MILLIMETERS_PER_INCH * 1e3)


def image_size(paper: Paper, dpi: float, depth: int = 1) -> tuple[int, int]:
    """Columns and rows of a page; raises as `write_png` does."""
    per_meter = pixels_per_meter(dpi)
    width, height = (round(side * per_meter / 1e3) for side in (paper.width, paper.height))
    if (size := width * height * depth) > MOST_BYTES:
        most = int(dpi * (MOST_BYTES / size) ** 0.5 // 50 * 50)
        raise InputError(
            f"an image below {MOST_BYTES / 1e9:g} GB",
            f"{paper} at {dpi:g} dpi with {size / 1e9:.2g} GB",
            f"use --dpi {most}, a smaller paper, or .pdf or .svg",
        )
    return width, height


def shape_runs(shape: Shape, per_mm: float, page_height: float, width: int, height: int) -> Runs:
    """Runs of the pixels (height, width) covered by a shape; the raster and the page share their top left corner.

    Parameters
    ----------
    shape : Shape
        Shape in mm, y up.
    per_mm : float
        Pixels per mm.
    page_height : float
        Height of the page, mm.
    width, height : int
        Size of the raster in pixels.
    """
    edges = _edges(shape, per_mm) * [per_mm, -per_mm, per_mm, -per_mm] + [0.0, per_mm * page_height] * 2
    return covered_runs(edges, width, height)


def _edges(shape: Shape, per_mm: float) -> Array:
    """Straight edges (m, 4) of closed polygons in mm: x0, y0, x1, y1."""
    match shape:
        case Disk():
            center = np.array([shape.x, shape.y])
            rings = [_circle(shape.radius, per_mm) + center]
            if shape.inner_radius:
                rings.append(_circle(shape.inner_radius, per_mm)[::-1] + center)
            return np.concatenate([_closed(ring) for ring in rings])
        case Line():
            return np.concatenate([_closed(ring) for ring in _stroke(shape)])
        case FilledPath():
            return _flattened(shape, per_mm)


def _closed(ring: Array) -> Array:
    return np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=-1)


def _circle(radius: float, per_mm: float) -> Array:
    """Regular polygon (k, 2) with the area of the circle."""
    flat = min(SAGITTA / (radius * per_mm), 1.0)
    count = max(ceil(pi / acos(1 - flat)), FEWEST_ARCS)
    return radius * unit_disk(count)


def _stroke(line: Line) -> list[Array]:
    """Outlines (k, 2) of a stroke with mitered corners; one for an open line, two for a closed one."""
    points = np.array(line.points)
    # Repeated points have no normal.
    points = points[np.append(True, np.any(np.diff(points, axis=0) != 0, axis=1))]
    closed = line.closed
    steps = np.diff(points, axis=0)
    normals = np.stack([-steps[:, 1], steps[:, 0]], axis=-1) / np.hypot(*steps.T)[:, None]
    if closed:
        points = points[:-1]
        before, after = np.roll(normals, 1, axis=0), normals
    else:
        before, after = np.concatenate([normals[:1], normals]), np.concatenate([normals, normals[-1:]])
    miter = 1 + np.sum(before * after, axis=1)  # twice the squared cosine of half the turning angle
    sharp = miter < 2 / MITER**2
    offset = (before + after) / np.where(sharp, 1.0, miter)[:, None]
    # A beveled corner has two points per side; the others are repeated, which adds no area.
    # (before + after) / miter reaches the crossing of both offset lines, of length 1 / cos of half the turn.
    shifts = np.stack([np.where(sharp[:, None], before, offset), np.where(sharp[:, None], after, offset)], axis=1)
    left, right = ((points[:, None] + side * line.width / 2 * shifts).reshape(-1, 2) for side in (1, -1))
    return [left, right[::-1]] if closed else [np.concatenate([left, right[::-1]])]


def _flattened(outline: FilledPath, per_mm: float) -> Array:
    """Edges (m, 4) of a path with its curves split into chords and every subpath closed."""
    straight: list[tuple[float, ...]] = []
    curves: dict[str, list[tuple[tuple[float, float], ...]]] = {"Q": [], "C": []}
    start = here = (0.0, 0.0)
    for command, points in outline.segments:
        if command in ("M", "Z"):
            if here != start:
                straight.append((*here, *start))
            start = here = points[0] if points else start
        elif command == "L":
            straight.append((*here, *points[0]))
            here = points[0]
        else:
            curves[command].append((here, *points))
            here = points[-1]
    if here != start:
        straight.append((*here, *start))
    parts = [np.array(straight).reshape(-1, 4)]
    for controls in filter(None, curves.values()):
        parts.append(_chords(np.array(controls), per_mm))
    return np.concatenate(parts)


def _chords(controls: Array, per_mm: float) -> Array:
    """Chords (m, 4) of Bezier curves (k, 3 or 4, 2), for each as many as the most curved one needs."""
    degree = controls.shape[1] - 1
    # The second derivative of a Bezier curve is degree (degree - 1) times a mean of its second differences.
    bend = np.diff(controls, n=2, axis=1)
    # A chord deviates by at most M / (8 count^2) from a curve whose second derivative is at most M.
    most = degree * (degree - 1) * float(np.hypot(bend[..., 0], bend[..., 1]).max())
    count = max(ceil(sqrt(most * per_mm / (8 * SAGITTA))), 1)
    t = np.linspace(0, 1, count + 1)[:, None]
    points = controls[:, :, None]
    while points.shape[1] > 1:
        points = (1 - t) * points[:, :-1] + t * points[:, 1:]
    walk = points[:, 0]
    return np.concatenate([walk[:, :-1], walk[:, 1:]], axis=-1).reshape(-1, 4)


def _compressed(painted: list[tuple[Runs, tuple[int, ...]]], width: int, height: int, depth: int) -> Iterator[bytes]:
    """Image data in pieces, each row stored as its difference from the one above: most rows are similar."""
    packer = zlib.compressobj(6)
    above = np.zeros((1, width * depth), dtype=np.uint8)
    rows = max(STRIP // width, 1)
    for top in range(0, height, rows):
        strip = np.full((min(rows, height - top), width, depth), 255, dtype=np.uint8)
        for runs, color in painted:
            _paint(strip, top, runs, color)
        lines = np.concatenate([above, strip.reshape(len(strip), -1)])
        filtered = np.empty((len(strip), width * depth + 1), dtype=np.uint8)
        filtered[:, 0] = 2  # PNG's filter type Up
        np.subtract(lines[1:], lines[:-1], out=filtered[:, 1:])
        above = lines[-1:]
        if data := packer.compress(filtered.data):
            yield data
    yield packer.flush()


def _paint(strip: Pixels, top: int, runs: Runs, color: tuple[int, ...]) -> None:
    """Blend a color into a strip (rows, columns, channels) that starts at row `top`, weighted by the covered shares."""
    height, width, depth = strip.shape
    first, last = np.searchsorted(runs.row, [top, top + height])
    if first == last:
        return
    begin = (runs.row[first:last] - top) * width + runs.column[first:last]
    length, share = runs.length[first:last], runs.share[first:last]
    pixels, ink = strip.reshape(-1, depth), np.array(color, dtype=np.uint8)
    # A run inside a shape has a share of 1 up to the rounding of its cumulative sum.
    whole = (length >= LONG) & (share > 1 - 1e-6)
    for start, count in zip(begin[whole].tolist(), length[whole].tolist(), strict=True):
        pixels[start : start + count] = ink
    begin, length, share = begin[~whole], length[~whole], share[~whole]
    offset = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length)
    index, share = np.repeat(begin, length) + offset, np.repeat(share, length)[:, None]
    pixels[index] = np.rint(pixels[index] * (1 - share) + ink * share).astype(np.uint8)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
