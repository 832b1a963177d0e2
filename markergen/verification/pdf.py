"""PDF: circles among the filled paths of every page, by PDFium, with all transforms of the page's content."""

import ctypes
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.marker import Marker
from markergen.verification.reading import READERS, Page, Reading, circles_of, round_shape
from markergen.verification.tiles import Sheet, assemble, is_tiled

Array = NDArray[np.float64]

MM_PER_POINT = 25.4 / 72

MOST_PAGES, MOST_SEGMENTS, MOST_LINES, DEEPEST = 500, 3_000_000, 20_000, 20

TILE_TOLERANCE = 1e-3
"""How well in mm the registration marks of neighboring tiles are to fit each other."""

LEAST_ARC, LONGEST_ARM = 12, 20.0
"""Points of an outline that may be part of a circle, and length in mm of a registration mark."""

_USER_UNIT = re.compile(rb"/UserUnit\s+([-+.\d]+)")


@READERS.register(".pdf")
def read(data: bytes, name: str, marker: Marker) -> Reading:
    """Circles and corners on all pages of a PDF; tiles are put together by their registration marks."""
    import pypdfium2

    if any(unit != b"1" for unit in _USER_UNIT.findall(data)):
        raise InputError(f"points as the unit in {name}", "a UserUnit", "save the PDF without it")
    try:
        document = pypdfium2.PdfDocument(data)
    except pypdfium2.PdfiumError as error:
        raise InputError(f"a complete PDF in {name}", brief(str(error)), "export it again") from None
    try:
        if not 1 <= len(document) <= MOST_PAGES:
            raise InputError(f"1 to {MOST_PAGES} pages in {name}", str(len(document)), "check the file")
        budget = [MOST_SEGMENTS]
        sheets = [_sheet(document, index, name, budget) for index in range(len(document))]
    except pypdfium2.PdfiumError as error:
        raise InputError(f"readable pages in {name}", brief(str(error)), "export it again") from None
    finally:
        document.close()
    pages = tuple(sheet.page for sheet in sheets)
    if is_tiled(sheets):
        features = [point.feature for point in marker.control_points]
        sizes = {500 * size for feature in features for size in (feature.diameter, feature.inner_diameter) if size}
        whole = assemble(sheets, np.array(sorted(sizes)), TILE_TOLERANCE)
        return Reading(
            "PDF", (whole.page,), tagged=True, papers=tuple(page.size for page in pages), gaps=tuple(whole.gaps)
        )
    return Reading("PDF", pages, tagged=True)


def _sheet(document: Any, index: int, name: str, budget: list[int]) -> Sheet:
    page = document[index]
    left, bottom, right, top = page.get_mediabox()
    circles: list[tuple[float, float, float]] = []
    corners: list[Array] = []
    lines: list[Array] = []
    for points, filled in _outlines(page.raw, name, budget):
        found = round_shape(points) if filled else None
        if found is not None:
            circles.append(found)
        elif filled and len(points) >= 3:
            corners.append(points[np.isfinite(points).all(axis=-1)])
        elif not filled and len(points) == 2:
            lines.append(points)
    size = (right - left) * MM_PER_POINT, (top - bottom) * MM_PER_POINT
    whole = np.concatenate(corners) if corners else np.zeros((0, 2))
    trims = [
        MM_PER_POINT * cut if abs(cut - edge) > 1 else None
        for cut, edge in zip(page.get_trimbox(), (left, bottom, right, top), strict=True)
    ]
    arcs = tuple(outline for outline in corners if len(outline) >= LEAST_ARC)
    return Sheet(
        Page(circles_of(circles, name), size, whole),
        _crosses(lines),
        (trims[0], trims[1], trims[2], trims[3]),
        arcs if any(trim is not None for trim in trims) else (),
    )


def _crosses(lines: list[Array]) -> Array:
    """Middles (k, 2) of pairs of lines of one length that cross there at right angles."""
    if not 1 < len(lines) <= MOST_LINES:
        return np.zeros((0, 2))
    ends = np.array(lines)
    middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    found = []
    order = np.lexsort((np.round(middle[:, 1], 2), np.round(middle[:, 0], 2)))
    for a, b in pairwise(order.tolist()):
        alike = abs(length[a] - length[b]) < 0.05 * max(length[a], 1e-9) and length[a] < LONGEST_ARM
        square = abs(along[a] @ along[b]) < 0.01 * length[a] * length[b]
        if alike and square and np.linalg.norm(middle[a] - middle[b]) < 0.02:
            found.append((middle[a] + middle[b]) / 2)
    return np.array(found).reshape(-1, 2)


def _outlines(page: Any, name: str, budget: list[int]) -> Iterator[tuple[Array, bool]]:
    """Outlines (m, 2) in mm of all paths and whether they are filled, those inside of form objects too."""
    import pypdfium2.raw as pdfium

    def objects(holder: Any, count: int, get: Any, matrix: Array, depth: int) -> Iterator[tuple[Array, bool]]:
        for index in range(count):
            item = get(holder, index)
            kind = pdfium.FPDFPageObj_GetType(item)
            budget[0] -= 1
            if budget[0] < 0 or depth > DEEPEST:
                raise InputError(f"at most {MOST_SEGMENTS} lines and curves in {name}", "more", "verify a smaller file")
            own = pdfium.FS_MATRIX()
            if not pdfium.FPDFPageObj_GetMatrix(item, own):
                continue
            here = matrix @ np.array([[own.a, own.c, own.e], [own.b, own.d, own.f], [0, 0, 1]])
            if kind == pdfium.FPDF_PAGEOBJ_PATH:
                yield from _paths(item, here, name, budget)
            elif kind == pdfium.FPDF_PAGEOBJ_FORM:
                yield from objects(
                    item, pdfium.FPDFFormObj_CountObjects(item), pdfium.FPDFFormObj_GetObject, here, depth + 1
                )

    yield from objects(page, pdfium.FPDFPage_CountObjects(page), pdfium.FPDFPage_GetObject, np.eye(3), 0)


def _paths(item: Any, matrix: Array, name: str, budget: list[int]) -> Iterator[tuple[Array, bool]]:
    import pypdfium2.raw as pdfium

    mode, stroke = ctypes.c_int(), pdfium.FPDF_BOOL()
    if not pdfium.FPDFPath_GetDrawMode(item, mode, stroke):
        return
    filled = mode.value != pdfium.FPDF_FILLMODE_NONE
    count = pdfium.FPDFPath_CountSegments(item)
    budget[0] -= count
    if budget[0] < 0:
        raise InputError(f"at most {MOST_SEGMENTS} lines and curves in {name}", "more", "verify a smaller file")
    x, y = ctypes.c_float(), ctypes.c_float()
    run: list[tuple[float, float]] = []
    bezier: list[tuple[float, float]] = []
    for index in range(count):
        segment = pdfium.FPDFPath_GetPathSegment(item, index)
        kind = pdfium.FPDFPathSegment_GetType(segment)
        pdfium.FPDFPathSegment_GetPoint(segment, x, y)
        point = (x.value, y.value)
        if kind == pdfium.FPDF_SEGMENT_MOVETO:
            if len(run) > 1:
                yield _mapped(run, matrix), filled
            run, bezier = [point], []
        elif kind == pdfium.FPDF_SEGMENT_LINETO:
            run.append(point)
        elif kind == pdfium.FPDF_SEGMENT_BEZIERTO and run:
            bezier.append(point)
            if len(bezier) == 3:
                run += _curve(np.array([run[-1], *bezier]))
                bezier = []
    if len(run) > 1:
        yield _mapped(run, matrix), filled


def _curve(points: Array) -> list[tuple[float, float]]:
    """Points along a cubic curve (4, 2), its end among them."""
    t = np.array([0.25, 0.5, 0.75, 1.0])[:, None]
    a, b, c, d = points
    along = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
    return [(float(px), float(py)) for px, py in along]


def _mapped(run: list[tuple[float, float]], matrix: Array) -> Array:
    points = np.array(run)
    return np.asarray(MM_PER_POINT * (points @ matrix[:2, :2].T + matrix[:2, 2]))
