"""PNG at true size: shares of pixels as grey levels, drawn and compressed strip by strip."""

import struct
import zlib
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.drawing.colors import channels, is_grey
from markergen.drawing.paper import Paper, find_paper
from markergen.drawing.scene import Sheet
from markergen.errors import InputError
from markergen.exporters import ExportOptions, Output, one_page
from markergen.exporters.coverage import Spans, spans
from markergen.model.marker import Marker

Pixels = NDArray[np.uint8]

STRIP = 1 << 22
"""Pixels that are drawn at a time: 4 MB a channel."""
LONG = 48
"""Pixels from which on a run is filled by itself rather than pixel by pixel."""
MOST_BYTES = 2e9
"""Of an image before compression."""
MILLIMETERS_PER_INCH = 25.4
LEAST_DPI, MOST_DPI = 10, 10_000


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Sheet of the markers as PNG, in grey levels or RGB."""
    check_image(options)
    sheet = one_page(markers, options, ".png")
    width, height = image_size(sheet.paper, options.dpi)
    note = f"The image has {width} x {height} pixels and says that they are {options.dpi} to the inch."
    return Output(write_png(sheet, options.dpi), (*sheet.notes, note))


def check_image(options: ExportOptions) -> None:
    """Refuse a resolution that there is not, or that makes the paper asked for too large an image.

    Raises
    ------
    InputError
        As `pixels_per_meter` and `image_size` do, or if there is no such paper.
    """
    pixels_per_meter(options.dpi)
    if options.sheet.paper is not None:
        image_size(find_paper(options.sheet.paper, options.sheet.orientation), options.dpi)


def write_png(sheet: Sheet, dpi: float) -> bytes:
    """Write a sheet as PNG: 8-bit grey if all of its colors are grey, RGB otherwise.

    PNG counts whole pixels per meter, so the scale is the nearest of these to `dpi` (600 dpi: 23622 per m), which the
    file states and the drawing keeps to. The top left corner of the image is that of the page; its right and lower
    edge are the nearest pixel borders to the page's. The middle of a pixel (column, row) lies at
    ((column + 0.5) / s, (row + 0.5) / s) from there, s pixels per m.

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
        (spans(shape, per_meter / 1e3, sheet.paper.height, width, height), channels(shape.color)[:depth])
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
    """Whole number of pixels per meter nearest to dpi.

    Raises
    ------
    InputError
        If dpi is not between 10 and 10000.
    """
    if not LEAST_DPI <= dpi <= MOST_DPI:
        raise InputError(f"a dpi of {LEAST_DPI} to {MOST_DPI}", f"dpi={dpi:g}", "use 300 or 600")
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


def _compressed(painted: list[tuple[Spans, tuple[int, ...]]], width: int, height: int, depth: int) -> Iterator[bytes]:
    """Image data in pieces, each line as its difference from the one above: most lines are alike."""
    packer = zlib.compressobj(6)
    above = np.zeros((1, width * depth), dtype=np.uint8)
    rows = max(STRIP // width, 1)
    for top in range(0, height, rows):
        strip = np.full((min(rows, height - top), width, depth), 255, dtype=np.uint8)
        for runs, color in painted:
            _paint(strip, top, runs, color)
        lines = np.concatenate([above, strip.reshape(len(strip), -1)])
        filtered = np.empty((len(strip), width * depth + 1), dtype=np.uint8)
        filtered[:, 0] = 2  # PNG's name for this filter, Up
        np.subtract(lines[1:], lines[:-1], out=filtered[:, 1:])
        above = lines[-1:]
        if data := packer.compress(filtered.data):
            yield data
    yield packer.flush()


def _paint(strip: Pixels, top: int, runs: Spans, color: tuple[int, ...]) -> None:
    """Blend a color into a strip (rows, columns, channels) that begins at row `top`, by the covered shares."""
    height, width, depth = strip.shape
    first, last = np.searchsorted(runs.row, [top, top + height])
    if first == last:
        return
    begin = (runs.row[first:last] - top) * width + runs.column[first:last]
    length, share = runs.length[first:last], runs.share[first:last]
    pixels, ink = strip.reshape(-1, depth), np.array(color, dtype=np.uint8)
    whole = (length >= LONG) & (share > 1 - 1e-6)
    for start, count in zip(begin[whole].tolist(), length[whole].tolist(), strict=True):
        pixels[start : start + count] = ink
    begin, length, share = begin[~whole], length[~whole], share[~whole]
    offset = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length)
    index, share = np.repeat(begin, length) + offset, np.repeat(share, length)[:, None]
    pixels[index] = np.rint(pixels[index] * (1 - share) + ink * share).astype(np.uint8)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
