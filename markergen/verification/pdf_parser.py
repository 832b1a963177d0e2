"""What PDFium sees in a PDF; `markergen.guard` runs this script in a child process for `pdf`.

Each page is read twice: the exact paths of its objects, and a picture of what a viewer shows, with all that hides or
covers objects.
"""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

import ctypes
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, reason_of
from markergen.read.outlines.curves import Bezier
from markergen.verification.reading import FARTHEST, FLATTEST, Painted, circles_of, painted_again, round_shape

MM_PER_POINT = 25.4 / 72
"""The unit of a PDF is 1/72 inch."""

MOST_PAGES, MOST_SEGMENTS, MOST_LINES, DEEPEST = 500, 1_000_000, 20_000, 20
"""Maximum numbers of pages and of segments of all paths in a file, of lines on a page among which registration marks
are sought, and of forms within forms: limits of work on untrusted files."""

MOST_ROUND = 50_000
"""Maximum number of outlines that are tried as circles."""

FILLED_OFF, STROKED_OFF = 2e-3, 5e-4
"""Maximum distance in mm of points of a filled outline from each other's chords, and of a line."""

FINEST, MOST_PIXELS, ALL_PIXELS = 300 / 25.4, 24_000_000, 60_000_000
"""Pixels per mm of a picture at most, pixels of one picture, and of all pictures of a file."""

FINE, COARSE = 50, 1000
"""Ratios of the size of a curve to the distance of its points from each other's chords, at least and at most."""

LEAST_ARC, LONGEST_ARM = 12, 20.0
"""Minimum number of points of an outline with a piece of a circle; maximum length in mm of a registration mark."""

CUT = "cut"
"""Name of the layer of lines to be cut."""

TEXT = "text"
"""Layer whose filled paths are not read: most of a sheet's curves are in its letters, which the picture shows."""

LARGEST_STREAM = 3_000_000
"""Maximum size in bytes of an unpacked stream of objects that is searched."""

_USER_UNIT = re.compile(rb"/UserUnit\s+([-+.\d]+)")
_OBJECTS = re.compile(rb"/ObjStm\b.{0,300}?stream\r?\n", re.DOTALL)


def prepare() -> None:
    """Import what takes time."""
    import pypdfium2.raw  # noqa: F401


def parse_pdf(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the pages of a PDF: sizes as values; circles, corners, lines, arcs and pictures as arrays by page."""
    import pypdfium2

    units = _USER_UNIT.findall(data) + [unit for part in _object_streams(data) for unit in _USER_UNIT.findall(part)]
    if any(float(unit or 1) != 1 for unit in units if unit.count(b".") < 2):
        raise InputError("points as the unit", "a UserUnit, which some viewers ignore", "save the PDF without it")
    try:
        document = pypdfium2.PdfDocument(data)
    except pypdfium2.PdfiumError as error:
        raise InputError("a complete PDF", reason_of(error), "export it again") from None
    try:
        if not 1 <= len(document) <= MOST_PAGES:
            raise InputError(f"1 to {MOST_PAGES} pages", str(len(document)), "check the file")
        document.init_forms()  # fields are on top of what pages draw
        parser = _Parser(ALL_PIXELS // len(document))
        for index in range(len(document)):
            parser.page(document[index], index)
    except pypdfium2.PdfiumError as error:
        raise InputError("readable pages", reason_of(error), "export it again") from None
    finally:
        document.close()
    return {"pages": parser.pages}, parser.arrays


def _object_streams(data: bytes) -> Iterator[bytes]:
    """Unpacked streams of objects, in which newer files hide their dictionaries."""
    for match in _OBJECTS.finditer(data):
        try:
            yield zlib.decompressobj().decompress(data[match.end() :], LARGEST_STREAM)
        except zlib.error:
            continue


@dataclass
class _Parser:
    pixels: int
    pages: list[dict[str, Any]] = field(default_factory=list)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    finest: float = 0.0
    paths: int = 0
    budget: int = MOST_SEGMENTS
    rounds: int = MOST_ROUND

    def page(self, page: Any, index: int) -> None:
        """Read one page."""
        media, crop = page.get_mediabox(), page.get_cropbox()
        box = [max(crop[0], media[0]), max(crop[1], media[1]), min(crop[2], media[2]), min(crop[3], media[3])]
        trims = [
            MM_PER_POINT * cut if abs(cut - edge) > 1 else None
            for cut, edge in zip(page.get_trimbox(), media, strict=True)
        ]
        tiled = any(trim is not None for trim in trims)
        outlines = list[_Outline]()
        self.finest = 0.0
        self._objects(page.raw, outlines)
        painted = self._painted(outlines)
        rest = [np.zeros((0, 2)), *(shape.points for shape in painted if shape.circle is None)]
        corners = np.concatenate(rest)
        arcs = [points for points in rest if tiled and len(points) >= LEAST_ARC and np.isfinite(points).all()]
        drawn = [outline for outline in outlines if outline.stroked or outline.layer == CUT]
        lines = [outline.lines for outline in drawn]
        self.pages.append(
            {
                "size": [(media[2] - media[0]) * MM_PER_POINT, (media[3] - media[1]) * MM_PER_POINT],
                "shown": [MM_PER_POINT * side for side in box],
                "trim": trims,
                "image": self.finest,
                "again": [] if tiled else painted_again(painted),
            }
        )
        self.arrays |= {
            f"circles{index}": circles_of([shape.circle for shape in painted if shape.circle], "the PDF"),
            f"corners{index}": corners[np.isfinite(corners).all(axis=1)],
            f"lines{index}": np.concatenate([np.zeros((0, 2, 2)), *lines]),
            f"cut{index}": np.repeat(
                np.array([outline.layer == CUT for outline in drawn], dtype=bool), [len(pieces) for pieces in lines]
            ),
            f"crosses{index}": _crosses([outline.points for outline in outlines if not outline.filled]),
            f"arcs{index}": np.concatenate(arcs) if arcs else np.zeros((0, 2)),
            f"arc_ends{index}": np.cumsum([len(arc) for arc in arcs], dtype=np.int64),
        }
        if outlines or self.finest:
            self.arrays[f"picture{index}"] = self._picture(page, box)

    def _picture(self, page: Any, box: list[float]) -> NDArray[np.uint8]:
        """Grey levels of the part of a page that viewers show, as it is without their turn."""
        width, height = (MM_PER_POINT * (box[k + 2] - box[k]) for k in (0, 1))
        if not (min(width, height) > 0.1 and max(width, height) < 1e5):
            return np.zeros((0, 0), dtype=np.uint8)
        most = min(self.pixels, MOST_PIXELS)
        fine = min(FINEST, (most / (width * height)) ** 0.5)
        if fine * min(width, height) < 2:
            return np.zeros((0, 0), dtype=np.uint8)
        # In print, layers and annotations show that may not on a screen, and the other way round.
        printed = page.render(scale=fine * MM_PER_POINT, grayscale=True, optimize_mode="print")
        # Viewers turn it clockwise.
        return np.ascontiguousarray(np.rot90(printed.to_numpy().squeeze(), int(page.get_rotation()) // 90))

    def _objects(self, page: Any, outlines: "list[_Outline]") -> None:
        import pypdfium2.raw as pdfium

        def objects(holder: Any, count: int, get: Any, matrix: Array, depth: int, layer: str) -> None:
            if depth > DEEPEST:
                raise InputError(f"at most {DEEPEST} levels of forms", "more", "save it again without layers")
            for index in range(count):
                item = get(holder, index)
                kind = pdfium.FPDFPageObj_GetType(item)
                self._spend(1)
                m = pdfium.FS_MATRIX()
                if not pdfium.FPDFPageObj_GetMatrix(item, m):
                    continue
                here = matrix @ np.array([[m.a, m.c, m.e], [m.b, m.d, m.f], [0, 0, 1]])
                if kind == pdfium.FPDF_PAGEOBJ_PATH:
                    on = self._layer(item) or layer
                    outlines.extend(self._outlines(item, MM_PER_POINT * here, on))
                elif kind == pdfium.FPDF_PAGEOBJ_IMAGE:
                    width, height = ctypes.c_uint(), ctypes.c_uint()
                    if pdfium.FPDFImageObj_GetImagePixelSize(item, width, height):
                        sides = MM_PER_POINT * np.linalg.norm(here[:2, :2], axis=0)
                        finest = min(np.array([width.value, height.value]) / np.maximum(sides, 1e-9))
                        self.finest = max(self.finest, float(finest))
                elif kind == pdfium.FPDF_PAGEOBJ_FORM:
                    inner = pdfium.FPDFFormObj_CountObjects(item)
                    get_inner = pdfium.FPDFFormObj_GetObject
                    objects(item, inner, get_inner, here, depth + 1, self._layer(item) or layer)

        objects(page, pdfium.FPDFPage_CountObjects(page), pdfium.FPDFPage_GetObject, np.eye(3), 0, "")

    def _spend(self, count: int) -> None:
        self.budget -= count
        if self.budget < 0:
            raise InputError(f"at most {MOST_SEGMENTS} lines and curves", "more", "verify a smaller file")

    def _layer(self, item: Any) -> str:
        """Name of the layer that an object is on; empty for none."""
        import pypdfium2.raw as pdfium

        text, length = ctypes.create_string_buffer(256), ctypes.c_ulong()
        place = ctypes.cast(text, ctypes.POINTER(ctypes.c_ushort))
        for number in range(min(pdfium.FPDFPageObj_CountMarks(item), DEEPEST)):
            mark = pdfium.FPDFPageObj_GetMark(item, number)
            if not pdfium.FPDFPageObjMark_GetName(mark, place, 256, length) or length.value > 256:
                continue
            if text.raw[: length.value].decode("utf-16le", "replace").rstrip("\0") != "OC":
                continue
            if pdfium.FPDFPageObjMark_GetParamStringValue(mark, b"Name", place, 256, length) and length.value <= 256:
                return text.raw[: length.value].decode("utf-16le", "replace").rstrip("\0")
        return ""

    def _outlines(self, item: Any, matrix: Array, layer: str) -> "Iterator[_Outline]":
        """The parts of a path, from one place to which the pen moves to the next, with curves as points on them."""
        import pypdfium2.raw as pdfium

        mode, stroke, x, y = ctypes.c_int(), pdfium.FPDF_BOOL(), ctypes.c_float(), ctypes.c_float()
        if not pdfium.FPDFPath_GetDrawMode(item, mode, stroke):
            return
        is_read = bool(stroke.value) or layer != TEXT
        count = max(pdfium.FPDFPath_CountSegments(item), 0) if is_read else 0
        self._spend(count)
        self.paths += 1
        levels = [ctypes.c_uint() for _ in range(4)]
        pdfium.FPDFPageObj_GetFillColor(item, *levels)
        of = layer, self.paths, int.from_bytes(bytes(level.value & 255 for level in levels), "big")
        off = FILLED_OFF if mode.value else STROKED_OFF
        (a, c, e), (b, d, f) = matrix[:2].tolist()
        points, bend, closed = list[tuple[float, float]](), list[tuple[float, float]](), False
        for index in range(count + 1):
            segment = pdfium.FPDFPath_GetPathSegment(item, index) if index < count else None
            kind = pdfium.FPDFPathSegment_GetType(segment) if segment else pdfium.FPDF_SEGMENT_MOVETO
            if kind == pdfium.FPDF_SEGMENT_MOVETO:
                if len(points) > 1:
                    yield _Outline(np.array(points), bool(mode.value), bool(stroke.value), closed, *of)
                points, bend, closed = [], [], False
            if segment is None:
                return
            pdfium.FPDFPathSegment_GetPoint(segment, x, y)
            place = (a * x.value + c * y.value + e, b * x.value + d * y.value + f)
            closed |= bool(pdfium.FPDFPathSegment_GetClose(segment))
            bend.append(place)
            if kind != pdfium.FPDF_SEGMENT_BEZIERTO or not points:
                points, bend = [*points, place], []
            elif len(bend) == 3:
                points += _on_curve(np.array([points[-1], *bend]), off)
                bend = []

    def _painted(self, outlines: "list[_Outline]") -> list[Painted]:
        """The filled outlines."""
        painted = list[Painted]()
        for outline in (outline for outline in outlines if outline.filled and len(outline.points) >= 3):
            points = outline.points
            sides = np.ptp(points, axis=0)
            circle = None
            if sides.min() >= FLATTEST * sides.max():
                self.rounds -= 1
                if self.rounds < 0:
                    raise InputError(f"at most {MOST_ROUND} small shapes", "more", "verify a smaller file")
                circle = round_shape(points)
            painted.append(Painted(points, outline.path, outline.paint, circle))
        return painted


@dataclass(frozen=True, eq=False)
class _Outline:
    """Part of a path: points (m, 2) in mm, how it is painted, its layer, number and color of the path."""

    points: Array
    filled: bool
    stroked: bool
    closed: bool
    layer: str
    path: int
    paint: int

    @property
    def lines(self) -> Array:
        """Straight pieces (k, 2, 2)."""
        ring = np.concatenate([self.points, self.points[: int(self.closed)]])
        pieces = np.stack([ring[:-1], ring[1:]], axis=1)
        return pieces[np.isfinite(pieces).all(axis=(1, 2))]


def _on_curve(points: Array, off: float) -> list[tuple[float, float]]:
    """Points of a Bezier curve (4, 2) after its first; the last one alone if it overflows."""
    size = float(np.ptp(points, axis=0).max())
    if not 0 < size < FARTHEST:
        return [(float(points[-1, 0]), float(points[-1, 1]))]
    curve = Bezier(points).flatten(max(min(off, size / FINE), size / COARSE))
    return [(x, y) for x, y in curve[1:].tolist()]


def _crosses(lines: list[Array]) -> Array:
    """Middles (k, 2) of pairs of lines of equal length that bisect each other at right angles."""
    ends = np.array([line for line in lines if len(line) == 2]).reshape(-1, 2, 2)
    if not 1 < len(ends) <= MOST_LINES:
        return np.zeros((0, 2))
    middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    crosses = []
    order = np.lexsort((np.round(middle[:, 1], 2), np.round(middle[:, 0], 2)))
    for a, b in pairwise(order.tolist()):
        alike = abs(length[a] - length[b]) < 0.05 * max(length[a], 1e-9) and length[a] < LONGEST_ARM
        square = abs(along[a] @ along[b]) < 0.01 * length[a] * length[b]
        if alike and square and np.linalg.norm(middle[a] - middle[b]) < 0.02:
            crosses.append((middle[a] + middle[b]) / 2)
    return np.array(crosses).reshape(-1, 2)
