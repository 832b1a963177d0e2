"""Read circles among the filled paths of every page of a PDF, by PDFium, with all transforms of the content.

The pages of a marker larger than the paper are assembled by their registration marks: crosses on the seams, printed
whole on both neighbors. Seams are the sides where a page is trimmed. Tiles come row by row from the top left; the first
of a row has no seam on its left.
"""

import ctypes
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.marker import Marker
from markergen.verification.reading import READERS, Page, Reading, circles_of, round_shape

Array = NDArray[np.float64]

MM_PER_POINT = 25.4 / 72

_T = np.array([0.25, 0.5, 0.75, 1.0])[:, None]
_WEIGHTS = (1 - _T) ** 3, 3 * _T * (1 - _T) ** 2, 3 * _T**2 * (1 - _T), _T**3
"""Weights of the four control points at four places on a cubic curve; a sheet has thousands of curves."""

MOST_PAGES, MOST_SEGMENTS, MOST_LINES, DEEPEST = 500, 3_000_000, 20_000, 20

TILE_TOLERANCE = 1e-3
"""Maximum distance in mm between the registration marks of neighboring tiles."""

LEAST_ARC, LONGEST_ARM = 12, 20.0
"""Minimum number of points of an outline with a piece of a circle; maximum length in mm of a registration mark."""

ON_SEAM = 2.0
"""Maximum distance in mm of a cross from its seam: the shift due to a scale error of 1 % on large paper."""

WHOLE = 0.93
"""Minimum share of a circle's circumference that the pieces on all pages must cover."""

SAME = 2.0
"""Maximum distance in mm between the centers of pieces of one circle, before they are fitted together."""

PIECES, LEAST = 64, 6
"""Number of sectors by which that share is counted, and minimum number of points of a piece."""

_USER_UNIT = re.compile(rb"/UserUnit\s+([-+.\d]+)")


@dataclass(frozen=True, eq=False)
class TilePage:
    """A page with the data needed to assemble it with others.

    Attributes
    ----------
    page : Page
    crosses : array (k, 2)
        Points in mm where two lines of equal length bisect each other.
    trim : (left, bottom, right, top) or None for each
        Seams, mm; None for a side that is not trimmed.
    arcs : tuple of arrays (m, 2)
        Points in mm of outlines that contain arcs of circles.
    """

    page: Page
    crosses: Array
    trim: tuple[float | None, float | None, float | None, float | None]
    arcs: tuple[Array, ...] = ()

    def marks(self, side: int) -> Array:
        """Crosses on one seam, sorted along it; empty if there is no seam."""
        place = self.trim[side]
        if place is None:
            return np.zeros((0, 2))
        axis = side % 2
        chosen = self.crosses[np.abs(self.crosses[:, axis] - place) < ON_SEAM]
        return chosen[np.argsort(chosen[:, 1 - axis])]


@dataclass
class Assembly:
    """Tiles assembled into one large page, and the errors that their marks reveal."""

    page: Page
    gaps: list[str] = field(default_factory=list)


Grid = dict[tuple[int, int], tuple[int, TilePage]]
"""Page index, from 0, and page, by row and column."""


@READERS.register(".fab.pdf")
def read_fabrication_sheet(data: bytes, name: str, marker: Marker) -> Reading:
    """Refuse a drawing to scale, in which no dot can be measured."""
    del data, marker
    raise InputError(
        "a file with the marker at true size",
        f"the fabrication sheet {brief(name)}, a drawing to scale",
        "verify the solid that goes with it: .step, .3mf, .stl or .glb",
    )


@READERS.register(".pdf")
def read(data: bytes, name: str, marker: Marker) -> Reading:
    """Read circles and corners on all pages of a PDF; tiles are assembled by their registration marks."""
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


def _sheet(document: Any, index: int, name: str, budget: list[int]) -> TilePage:
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
    return TilePage(
        Page(circles_of(circles, name), size, whole),
        _crosses(lines),
        (trims[0], trims[1], trims[2], trims[3]),
        arcs if any(trim is not None for trim in trims) else (),
    )


def _crosses(lines: list[Array]) -> Array:
    """Middles (k, 2) of pairs of lines of equal length that bisect each other at right angles."""
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
    """Outlines (m, 2) in mm of all paths, also in form objects, and whether they are filled."""
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
    """Points along a cubic curve (4, 2), including its end."""
    first, second, third, last = _WEIGHTS
    a, b, c, d = points
    return list(map(tuple, (first * a + second * b + third * c + last * d).tolist()))


def _mapped(run: list[tuple[float, float]], matrix: Array) -> Array:
    points = np.array(run)
    return np.asarray(MM_PER_POINT * (points @ matrix[:2, :2].T + matrix[:2, 2]))


def is_tiled(sheets: Sequence[TilePage]) -> bool:
    """Tell whether pages are tiles to be assembled: they have seams."""
    return any(place is not None for sheet in sheets for place in sheet.trim)


def assemble(sheets: Sequence[TilePage], radii: Array, tolerance: float) -> Assembly:
    """Assemble all tiles into one page, each shifted so that its marks lie on those of its neighbors.

    Parameters
    ----------
    radii : array
        Radii of the circles whose pieces are sought on several pages, mm.
    tolerance : float
        Distance in mm between marks of neighbors beyond which they are reported.
    """
    grid: Grid = {}
    row, column = -1, 0
    for index, sheet in enumerate(sheets):
        if any(place is not None for place in sheet.trim):
            row, column = (row + 1, 0) if sheet.trim[0] is None or row < 0 else (row, column + 1)
            grid[row, column] = (index, sheet)
    shifts: dict[tuple[int, int], Array] = {next(iter(grid)): np.zeros(2)}
    gaps: list[str] = []
    while len(shifts) < len(grid):
        # Next comes the tile with the most marks in common with those already placed.
        ties = {key: _ties(grid, key, shifts) for key in grid if key not in shifts}
        key = max(ties, key=lambda key: len(ties[key]))
        if not len(ties[key]):
            gaps.append(f"page {grid[key][0] + 1} has no registration marks that those of its neighbors fit")
        shifts[key] = ties[key].mean(axis=0) if len(ties[key]) else np.zeros(2)
    for key, (index, sheet) in grid.items():
        for side, there in enumerate(_neighbors(key)):
            if side >= 2 and there in grid and len(sheet.marks(side)) != len(grid[there][1].marks(side - 2)):
                pages = f"pages {index + 1} and {grid[there][0] + 1}"
                gaps.append(f"{pages} differ in the number of registration marks on their seam")
        off = float(np.linalg.norm(_ties(grid, key, shifts) - shifts[key], axis=1).max(initial=0.0))
        if off > tolerance:
            gaps.append(f"the registration marks of page {index + 1} and its neighbors are {1e3 * off:.3g} um apart")
    circles = [sheet.page.circles + [*shifts[key], 0.0] for key, (_, sheet) in grid.items()]
    corners = [sheet.page.corners + shifts[key] for key, (_, sheet) in grid.items()]
    arcs = [arc + shifts[key] for key, (_, sheet) in grid.items() for arc in sheet.arcs]
    whole = np.concatenate([*circles, _joined(arcs, radii)])
    return Assembly(Page(whole, None, np.concatenate(corners)), gaps)


def _neighbors(key: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Grid positions on the left, below, on the right, above."""
    row, column = key
    return (row, column - 1), (row + 1, column), (row, column + 1), (row - 1, column)


def _ties(grid: Grid, key: tuple[int, int], shifts: Mapping[tuple[int, int], Array]) -> Array:
    """Shifts (k, 2) of a tile implied by its marks and those of neighbors that are already placed."""
    found = [np.zeros((0, 2))]
    for side, there in enumerate(_neighbors(key)):
        if there in shifts:
            mine, other = grid[key][1].marks(side), grid[there][1].marks((side + 2) % 4)
            if len(mine) == len(other):
                found.append(other + shifts[there] - mine)
    return np.concatenate(found)


def _joined(outlines: Sequence[Array], radii: Array) -> Array:
    """Circles (m, 3) formed by pieces of outlines."""
    pieces = [found for outline in outlines for radius in radii for found in _piece(outline, radius)]
    circles, left = [], list(range(len(pieces)))
    while left:
        center, radius, _ = pieces[left[0]]
        mine = [k for k in left if pieces[k][1] == radius and np.linalg.norm(pieces[k][0] - center) < SAME]
        left = [k for k in left if k not in mine]
        points = np.concatenate([pieces[k][2] for k in mine])
        x, y, r = _circle(points)
        angle = np.arctan2(points[:, 1] - y, points[:, 0] - x)
        turns = np.unique(((angle / (2 * np.pi) + 1) * PIECES).astype(int) % PIECES)
        if len(turns) >= WHOLE * PIECES:
            # If the pieces do not fit, a second circle reports the distance of the worst point.
            off = np.abs(np.linalg.norm(points - [x, y], axis=1) - r)
            circles.append((x, y, r))
            if off.max() > 1e-3:
                circles.append((x + float(off.max()), y, r))
    return np.array(circles, dtype=float).reshape(-1, 3)


def _piece(outline: Array, radius: float) -> list[tuple[Array, float, Array]]:
    """Center, radius and points of the longest part of an outline that lies on a circle of about this radius."""
    size = float(np.ptp(outline, axis=0).max())
    if not 0.1 * radius < size < 2.2 * radius:
        return []
    m, best = len(outline), None
    start = np.arange(0, m, max(m // 48, 1))
    span = max(m // 16, 3)
    a, b, c = (outline[(start + k * span) % m] for k in range(3))
    area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    sides = np.prod([np.linalg.norm(end - first, axis=1) for first, end in ((a, b), (b, c), (c, a))], axis=0)
    for first in start[np.abs(sides / np.maximum(4 * area, 1e-12) / radius - 1) < 0.05]:
        x, y, r = _circle(outline[[first, (first + span) % m, (first + 2 * span) % m]])
        # Three points of a short piece give only a rough circle.
        for near in (2e-3, 2e-4):
            own = outline[np.abs(np.linalg.norm(outline - [x, y], axis=1) - r) < near * radius]
            if len(own) < LEAST:
                break
            x, y, r = _circle(own)
        else:
            if best is None or len(own) > len(best[2]):
                best = np.array([x, y]), radius, own
    return [best] if best is not None else []


def _circle(points: Array) -> tuple[float, float, float]:
    """Center and radius of a circle through points (m, 2): least squares of x^2 + y^2 + d x + e y + f = 0."""
    middle = points.mean(axis=0)
    offset = points - middle
    rows = np.column_stack([offset, np.ones(len(points))])
    (d, e, f), *_ = np.linalg.lstsq(rows, -np.sum(offset**2, axis=1), rcond=None)
    square = (d * d + e * e) / 4 - f
    return float(middle[0] - d / 2), float(middle[1] - e / 2), float(np.sqrt(max(square, 0.0)))
