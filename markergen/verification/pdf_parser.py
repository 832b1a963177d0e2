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
from markergen.errors import InputError, brief
from markergen.verification.reading import FLATTEST, circles_of, round_shape

Numbers = NDArray[np.int64]

MM_PER_POINT = 25.4 / 72
"""The unit of a PDF is 1/72 inch."""

MOST_PAGES, MOST_SEGMENTS, MOST_LINES, DEEPEST = 500, 1_000_000, 20_000, 20
"""Maximum numbers of pages and of segments of all paths in a file, of lines on a page among which registration marks
are sought, and of forms within forms: limits of work on untrusted files."""

MOST_ROUND = 50_000
"""Maximum number of outlines that are tried as circles."""

FILLED_OFF, STROKED_OFF = 2e-2, 5e-4
"""Maximum distance in mm of points of a filled outline from each other's chords, and of a line."""

FINEST, MOST_PIXELS, ALL_PIXELS = 300 / 25.4, 24_000_000, 60_000_000
"""Pixels per mm of a picture at most, pixels of one picture, and of all pictures of a file."""

LEAST_ARC, LONGEST_ARM = 12, 20.0
"""Minimum number of points of an outline with a piece of a circle; maximum length in mm of a registration mark."""

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
        raise InputError("a complete PDF", brief(str(error)), "export it again") from None
    try:
        if not 1 <= len(document) <= MOST_PAGES:
            raise InputError(f"1 to {MOST_PAGES} pages", str(len(document)), "check the file")
        parser = _Parser(ALL_PIXELS // len(document))
        for index in range(len(document)):
            parser.page(document[index], index)
    except pypdfium2.PdfiumError as error:
        raise InputError("readable pages", brief(str(error)), "export it again") from None
    finally:
        document.close()
    return {"pages": parser.pages, "layers": parser.layers}, parser.arrays


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
    layers: list[str] = field(default_factory=lambda: [""])
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    finest: float = 0.0
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
        paths = _Paths()
        self.finest = 0.0
        self._objects(page.raw, paths)
        points, ends, kind, layer = paths.flattened()
        circles, corners, arcs = self._filled(points, ends, kind, tiled)
        lines, line_layer = _lines(points, ends, kind, layer)
        drawn = points[np.isfinite(points).all(axis=1)]
        self.pages.append(
            {
                "size": [(media[2] - media[0]) * MM_PER_POINT, (media[3] - media[1]) * MM_PER_POINT],
                "shown": [MM_PER_POINT * side for side in box],
                "cropped": bool(np.abs(np.subtract(media, box)).max() > 1),
                "turn": int(page.get_rotation()) // 90,
                "trim": trims,
                "image": self.finest,
            }
        )
        self.arrays |= {
            f"circles{index}": circles_of(circles, "the PDF"),
            f"corners{index}": corners,
            f"lines{index}": lines,
            f"layer{index}": line_layer,
            f"crosses{index}": _crosses(points, ends, kind),
            f"arcs{index}": np.concatenate(arcs) if arcs else np.zeros((0, 2)),
            f"arc_ends{index}": np.cumsum([len(arc) for arc in arcs], dtype=np.int64),
        }
        if len(drawn) or self.finest:
            self.arrays[f"picture{index}"] = self._picture(page, box)

    def _picture(self, page: Any, box: list[float]) -> NDArray[np.uint8]:
        """Grey levels of the part of a page that viewers show."""
        width, height = (MM_PER_POINT * (box[k + 2] - box[k]) for k in (0, 1))
        if not (min(width, height) > 0.1 and max(width, height) < 1e5):
            return np.zeros((0, 0), dtype=np.uint8)
        most = min(self.pixels, MOST_PIXELS)
        fine = min(FINEST, (most / (width * height)) ** 0.5)
        if fine * min(width, height) < 2:
            return np.zeros((0, 0), dtype=np.uint8)
        # In print, layers and annotations show that may not on a screen, and the other way round.
        printed = page.render(scale=fine * MM_PER_POINT, grayscale=True, optimize_mode="print")
        return np.ascontiguousarray(printed.to_numpy()[..., :]).squeeze()

    def _objects(self, page: Any, paths: "_Paths") -> None:
        import pypdfium2.raw as pdfium

        def objects(holder: Any, count: int, get: Any, matrix: Array, depth: int, layer: int) -> None:
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
                    self._spend(paths.add(item, here, on, self.budget, strokes_only=self.layers[on] == TEXT))
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

        objects(page, pdfium.FPDFPage_CountObjects(page), pdfium.FPDFPage_GetObject, np.eye(3), 0, 0)

    def _spend(self, count: int) -> None:
        self.budget -= count
        if self.budget < 0:
            raise InputError(f"at most {MOST_SEGMENTS} lines and curves", "more", "verify a smaller file")

    def _layer(self, item: Any) -> int:
        """Index of the layer that an object is on; 0 for none."""
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
                name = text.raw[: length.value].decode("utf-16le", "replace").rstrip("\0")
                if name not in self.layers and len(self.layers) < 100:
                    self.layers.append(name)
                return self.layers.index(name) if name in self.layers else 0
        return 0

    def _filled(
        self, points: Array, ends: Numbers, kind: Numbers, tiled: bool
    ) -> tuple[list[tuple[float, float, float]], Array, list[Array]]:
        """Circles among the filled outlines, the corners of the others, and with tiles those that may hold arcs."""
        circles, others, arcs = [], np.zeros(len(points), dtype=bool), []
        starts = np.concatenate([[0], ends[:-1]])
        count = ends - starts
        if not len(ends):
            return [], np.zeros((0, 2)), []
        low, high = (ufunc.reduceat(points, starts, axis=0) for ufunc in (np.minimum, np.maximum))
        half = high - low
        even = half.min(axis=1) >= FLATTEST * half.max(axis=1)
        for index in np.flatnonzero((kind & FILLED > 0) & (count >= 3)):
            outline = slice(starts[index], ends[index])
            circle = None
            if even[index]:
                self.rounds -= 1
                if self.rounds < 0:
                    raise InputError(f"at most {MOST_ROUND} small shapes", "more", "verify a smaller file")
                circle = round_shape(points[outline])
            if circle is not None:
                circles.append(circle)
                continue
            others[outline] = True
            if tiled and count[index] >= LEAST_ARC:
                arcs.append(points[outline])
        return circles, points[others & np.isfinite(points).all(axis=1)], arcs


FILLED, STROKED, CLOSED = 1, 2, 4
"""Bits of the kind of a path."""


@dataclass
class _Paths:
    """Raw segments of all paths of a page: points, kinds of segments, and the path that each belongs to."""

    xs: list[float] = field(default_factory=list)
    ys: list[float] = field(default_factory=list)
    kinds: list[int] = field(default_factory=list)
    closes: list[int] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    matrices: list[Array] = field(default_factory=list)
    flags: list[int] = field(default_factory=list)
    layers: list[int] = field(default_factory=list)

    def add(self, item: Any, matrix: Array, layer: int, most: int, strokes_only: bool) -> int:
        """Add a path, and return the number of its segments, at most `most`; on request only if it is stroked."""
        import pypdfium2.raw as pdfium

        mode, stroke = ctypes.c_int(), pdfium.FPDF_BOOL()
        if not pdfium.FPDFPath_GetDrawMode(item, mode, stroke):
            return 0
        count = 0 if strokes_only and not stroke.value else pdfium.FPDFPath_CountSegments(item)
        if not 0 < count <= most:
            return max(count, 0)
        self.counts.append(count)
        self.matrices.append(matrix)
        self.flags.append((FILLED if mode.value else 0) | (STROKED if stroke.value else 0))
        self.layers.append(layer)
        get, get_type = pdfium.FPDFPath_GetPathSegment, pdfium.FPDFPathSegment_GetType
        get_point, get_close = pdfium.FPDFPathSegment_GetPoint, pdfium.FPDFPathSegment_GetClose
        x, y = ctypes.c_float(), ctypes.c_float()
        for index in range(count):
            segment = get(item, index)
            get_point(segment, x, y)
            self.xs.append(x.value)
            self.ys.append(y.value)
            self.kinds.append(get_type(segment))
            self.closes.append(get_close(segment))
        return int(count)

    def flattened(self) -> tuple[Any, Any, Any, Any]:
        """Points (m, 2) in mm of all runs, the end of each run, its flags and layer; curves become points on them."""
        import pypdfium2.raw as pdfium

        if not self.counts:
            nothing = np.zeros(0, dtype=np.int64)
            return np.zeros((0, 2)), nothing, nothing, nothing
        of = np.repeat(np.arange(len(self.counts)), self.counts)
        matrix = np.array(self.matrices)[of]
        raw = np.column_stack([self.xs, self.ys])
        places = MM_PER_POINT * (np.einsum("mij,mj->mi", matrix[:, :2, :2], raw) + matrix[:, :2, 2])
        kinds, flags = np.array(self.kinds), np.array(self.flags)[of]
        curve = kinds == pdfium.FPDF_SEGMENT_BEZIERTO
        # The last of three consecutive points of a curve stands for it.
        number = np.arange(len(kinds))
        rank = number - np.maximum.accumulate(np.where(curve & ~np.roll(curve, 1), number, 0))
        last = np.flatnonzero(curve & (rank % 3 == 2) & (number >= 3))
        steps = np.where(curve, 0, 1)
        off = np.where(flags[last] & FILLED > 0, FILLED_OFF, STROKED_OFF)
        bend = np.linalg.norm(places[last - 3] - 2 * places[last - 2] + places[last - 1], axis=1)
        bend = np.maximum(bend, np.linalg.norm(places[last - 2] - 2 * places[last - 1] + places[last], axis=1))
        # A chord over a step h deviates by at most h^2 / 8 times the second derivative.
        with np.errstate(invalid="ignore"):
            fine = np.nan_to_num(np.ceil(np.sqrt(6 * bend / (8 * off))), nan=4.0, posinf=4.0)
        steps[last] = np.clip(fine, 4, 64)
        index = np.repeat(np.arange(len(kinds)), steps)
        share = (np.arange(len(index)) - np.repeat(np.cumsum(steps) - steps, steps) + 1) / steps[index]
        points = places[index]
        bent = np.flatnonzero(curve[index])
        t, at = share[bent, None], index[bent]
        points[bent] = (
            (1 - t) ** 3 * places[at - 3]
            + 3 * t * (1 - t) ** 2 * places[at - 2]
            + 3 * t**2 * (1 - t) * places[at - 1]
            + t**3 * places[at]
        )
        begins = np.flatnonzero(kinds[index] == pdfium.FPDF_SEGMENT_MOVETO)
        begins = begins if len(begins) and begins[0] == 0 else np.concatenate([[0], begins])
        ends = np.concatenate([begins[1:], [len(points)]])
        run = index[begins]
        closed = np.maximum.reduceat(np.array(self.closes)[index], begins) > 0
        kind = flags[run] | np.where(closed, CLOSED, 0)
        kept = ends - begins > 1
        if not kept.all():
            points = points[np.repeat(kept, ends - begins)]
            ends = np.cumsum((ends - begins)[kept])
        return np.asarray(points, dtype=float), ends, kind[kept], np.array(self.layers)[of[run]][kept]


def _lines(points: Array, ends: Numbers, kind: Numbers, layer: Numbers) -> tuple[Array, Numbers]:
    """Straight pieces (k, 2, 2) of everything that is stroked, and their layers."""
    starts = np.concatenate([[0], ends[:-1]])[: len(ends)]
    run = np.repeat(np.arange(len(ends)), ends - starts)
    after = np.arange(len(points)) + 1
    stroked = kind[run] & STROKED > 0 if len(run) else np.zeros(0, dtype=bool)
    final = np.zeros(len(points), dtype=bool)
    final[ends - 1] = True
    after[ends - 1] = starts
    kept = np.flatnonzero(stroked & (~final | (kind[run] & CLOSED > 0 if len(run) else final)))
    pieces = np.stack([points[kept], points[after[kept]]], axis=1)
    good = np.isfinite(pieces).all(axis=(1, 2))
    return pieces[good], layer[run[kept]][good]


def _crosses(points: Array, ends: Numbers, kind: Numbers) -> Array:
    """Middles (k, 2) of pairs of lines of equal length that bisect each other at right angles."""
    starts = np.concatenate([[0], ends[:-1]])[: len(ends)]
    first = starts[(ends - starts == 2) & (kind & FILLED == 0)] if len(ends) else np.zeros(0, dtype=np.int64)
    if not 1 < len(first) <= MOST_LINES:
        return np.zeros((0, 2))
    middle, along = (points[first] + points[first + 1]) / 2, points[first + 1] - points[first]
    length = np.linalg.norm(along, axis=1)
    crosses = []
    order = np.lexsort((np.round(middle[:, 1], 2), np.round(middle[:, 0], 2)))
    for a, b in pairwise(order.tolist()):
        alike = abs(length[a] - length[b]) < 0.05 * max(length[a], 1e-9) and length[a] < LONGEST_ARM
        square = abs(along[a] @ along[b]) < 0.01 * length[a] * length[b]
        if alike and square and np.linalg.norm(middle[a] - middle[b]) < 0.02:
            crosses.append((middle[a] + middle[b]) / 2)
    return np.array(crosses).reshape(-1, 2)
