"""Read a PDF as others see it, through PDFium in a child process: exact paths, and a picture of each page.

The pages of a marker larger than the paper are assembled by their registration marks: crosses on the seams, printed
whole on both neighbors. Seams are the sides where a page is trimmed. Tiles come row by row from the top left; the first
of a row has no seam on its left.
"""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.guard import KINDS, Content, in_child
from markergen.model.body import Body
from markergen.verification.matching import dots_on_page, expected_dots
from markergen.verification.pdf_parser import FINEST
from markergen.verification.picture import PagePicture
from markergen.verification.png import pixel_page, tolerance_of
from markergen.verification.reading import READERS, Page, Reading, Settings, circle_diameters
from markergen.verification.words import MOST_LISTED

PARSER = Path(__file__).with_name("pdf_parser.py")

CUT = "cut"
"""Name of the layer of lines to be cut."""

ROUNDED = 0.6
"""Tolerance in pixels of a page of pixels: half of one, by which dots move if programs round its size, and some."""

TILE_TOLERANCE = 1e-3
"""Maximum distance in mm between the registration marks of neighboring tiles."""

ON_SEAM = 2.0
"""Maximum distance in mm of a cross from its seam: the shift due to a scale error of 1 % on large paper."""

WHOLE = 0.93
"""Minimum share of a circle's circumference that the pieces on all pages must cover."""

SAME = 2.0
"""Maximum distance in mm between the centers of pieces of one circle, before they are fitted together."""

PIECES, LEAST = 64, 6
"""Number of sectors by which that share is counted, and minimum number of points of a piece."""


@dataclass(frozen=True, eq=False)
class TilePage:
    """A page with the data needed to assemble it with others.

    Attributes
    ----------
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
def read_fabrication_sheet(data: bytes, name: str, body: Body, settings: Settings) -> Reading:
    """Refuse a drawing to scale, in which no dot can be measured."""
    del data, body, settings
    raise InputError(
        "a file with the marker at true size",
        f"the fabrication sheet {brief(name)}, a drawing to scale",
        "verify the solid that goes with it: .step, .3mf, .stl or .glb",
    )


@READERS.register(".pdf")
def read_pdf(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read circles, corners, lines and a picture of all pages of a PDF; tiles are assembled by their marks."""
    reply = in_child(
        PARSER,
        "parse_pdf",
        Content(name, data),
        "PDF",
        f"a complete PDF, read within {KINDS['PDF'].seconds:g} s, in {name}",
    )
    layers = reply.values["layers"]
    sheets = [_sheet(values, reply.arrays, index, layers) for index, values in enumerate(reply.values["pages"])]
    pages = tuple(sheet.page for sheet in sheets)
    if is_tiled(sheets):
        radii = np.unique([diameter / 2 for diameter in circle_diameters(body)])
        assemblies = [assemble(sheets, radii, TILE_TOLERANCE, indices) for indices in markers_of(sheets)]
        gaps = tuple(gap for assembly in assemblies for gap in assembly.gaps)
        papers = tuple(page.size for page in pages)
        return Reading("PDF", tuple(assembly.page for assembly in assemblies), tagged=True, papers=papers, gaps=gaps)
    finest = max((values["image"] for values in reply.values["pages"]), default=0.0)
    if finest and not any(
        len(dots_on_page(page, expected_dots(plate.marker))) for page in pages for plate in body.plates
    ):
        drawn = [
            _of_image(values, reply.arrays, index, body, name) for index, values in enumerate(reply.values["pages"])
        ]
        tolerance = tolerance_of(min(finest, FINEST), ROUNDED)
        note = f"pictures of {25.4 * finest:.0f} dpi without paths: places are allowed {1e6 * tolerance:.0f} um"
        return Reading("PDF", tuple(drawn), tolerance, ordered=False, pixels=True, tagged=True, notes=(note,))
    return Reading("PDF", pages, tagged=True, twice=tuple(_twice(pages)))


def _of_image(values: Mapping[str, Any], arrays: Mapping[str, Any], index: int, body: Body, name: str) -> Page:
    """Page of pixels alone."""
    grey = arrays.get(f"picture{index}", np.zeros((0, 0), np.uint8))
    if not grey.size:
        return Page(np.zeros((0, 3)))
    return pixel_page(np.ascontiguousarray(np.rot90(grey, values["turn"])), values["shown"], body, name)


def _twice(pages: Sequence[Page]) -> Iterator[str]:
    """What is painted again in the same place."""
    for page in pages:
        circles, count = np.unique(np.round(page.circles, 3), axis=0, return_counts=True)
        for x, y, _ in circles[count > 1][:MOST_LISTED].tolist():
            yield f"the circle around x {x:.4g}, y {y:.4g} mm of the page is there twice"


def _sheet(values: Mapping[str, Any], arrays: Mapping[str, Any], index: int, layers: Sequence[str]) -> TilePage:
    width, height = values["size"]
    grey = arrays.get(f"picture{index}")
    picture = PagePicture.of_page(grey, values["shown"], values["turn"]) if grey is not None and grey.size else None
    lines, layer = arrays[f"lines{index}"], arrays[f"layer{index}"]
    page = Page(
        arrays[f"circles{index}"],
        (width, height),
        arrays[f"corners{index}"],
        picture=picture,
        lines=lines,
        cut=layer == layers.index(CUT) if CUT in layers else None,
    )
    left, bottom, right, top = values["trim"]
    arcs = np.split(arrays[f"arcs{index}"], arrays[f"arc_ends{index}"][:-1]) if len(arrays[f"arcs{index}"]) else []
    return TilePage(page, arrays[f"crosses{index}"], (left, bottom, right, top), tuple(arcs))


def is_tiled(sheets: Sequence[TilePage]) -> bool:
    """Tell whether pages are tiles to be assembled: they have seams."""
    return any(place is not None for sheet in sheets for place in sheet.trim)


def markers_of(sheets: Sequence[TilePage]) -> list[range]:
    """Ranges of pages with the tiles of one marker each: the first one has seams neither on its left nor above."""
    tiles = [index for index, sheet in enumerate(sheets) if any(place is not None for place in sheet.trim)]
    starts = [index for index in tiles if sheets[index].trim[0] is None and sheets[index].trim[3] is None]
    starts = sorted({tiles[0], *starts})
    return [range(start, end) for start, end in zip(starts, [*starts[1:], len(sheets)], strict=True)]


def assemble(sheets: Sequence[TilePage], radii: Array, tolerance: float, pages: range | None = None) -> Assembly:
    """Assemble all tiles into one page, each shifted so that its marks lie on those of its neighbors.

    Parameters
    ----------
    radii : array
        Radii of the circles whose pieces are sought on several pages, mm.
    tolerance : float
        Distance in mm between marks of neighbors beyond which they are reported.
    pages : range or None
        Indices of the pages of one marker; None for all.
    """
    grid: Grid = {}
    row, column = -1, 0
    for index in range(len(sheets)) if pages is None else pages:
        sheet = sheets[index]
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
                both = f"pages {index + 1} and {grid[there][0] + 1}"
                gaps.append(f"{both} differ in the number of registration marks on their seam")
        off = float(np.linalg.norm(_ties(grid, key, shifts) - shifts[key], axis=1).max(initial=0.0))
        if off > tolerance:
            gaps.append(f"the registration marks of page {index + 1} and its neighbors are {1e3 * off:.3g} um apart")
    circles = [sheet.page.circles + [*shifts[key], 0.0] for key, (_, sheet) in grid.items()]
    corners = [sheet.page.corners + shifts[key] for key, (_, sheet) in grid.items()]
    tiles = [(sheet.page.lines, sheet.page.cut, shifts[key]) for key, (_, sheet) in grid.items()]
    lines = [pieces + offset for pieces, _, offset in tiles if pieces is not None]
    cut = [
        np.zeros(len(pieces), dtype=np.bool_) if is_cut is None else is_cut
        for pieces, is_cut, _ in tiles
        if pieces is not None
    ]
    placed_tiles = [(shifts[key], sheet) for key, (_, sheet) in grid.items()]
    arcs = [arc + shifts[key] for key, (_, sheet) in grid.items() for arc in sheet.arcs]
    whole = np.concatenate([*circles, _joined(arcs, radii)])
    page = Page(
        whole, None, np.concatenate(corners), picture=PagePicture.of_tiles([_kept(*tile) for tile in placed_tiles]),
        lines=np.concatenate(lines), cut=np.concatenate(cut) if np.concatenate(cut).any() else None,
    )  # fmt: skip
    return Assembly(page, gaps)


def _kept(offset: Array, sheet: TilePage) -> tuple[PagePicture | None, Array, tuple[float, ...]]:
    """Picture of a tile, its shift, and the box that remains after trimming, on the tile."""
    sides = (-np.inf, -np.inf, np.inf, np.inf)
    box = tuple(far if cut is None else cut for cut, far in zip(sheet.trim, sides, strict=True))
    return sheet.page.picture, offset, box


def _neighbors(key: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Grid positions on the left, below, on the right, above."""
    row, column = key
    return (row, column - 1), (row + 1, column), (row, column + 1), (row - 1, column)


def _ties(grid: Grid, key: tuple[int, int], shifts: Mapping[tuple[int, int], Array]) -> Array:
    """Shifts (k, 2) of a tile implied by its marks and those of neighbors that are already placed."""
    offsets = [np.zeros((0, 2))]
    for side, there in enumerate(_neighbors(key)):
        if there in shifts:
            mine, theirs = grid[key][1].marks(side), grid[there][1].marks((side + 2) % 4)
            if len(mine) == len(theirs):
                offsets.append(theirs + shifts[there] - mine)
    return np.concatenate(offsets)


def _joined(outlines: Sequence[Array], radii: Array) -> Array:
    """Circles (m, 3) formed by pieces of outlines."""
    pieces = [piece for outline in outlines for radius in radii for piece in _piece(outline, radius)]
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
        for tolerance in (2e-3, 2e-4):
            on_circle = outline[np.abs(np.linalg.norm(outline - [x, y], axis=1) - r) < tolerance * radius]
            if len(on_circle) < LEAST:
                break
            x, y, r = _circle(on_circle)
        else:
            if best is None or len(on_circle) > len(best[2]):
                best = np.array([x, y]), radius, on_circle
    return [best] if best is not None else []


def _circle(points: Array) -> tuple[float, float, float]:
    """Center and radius of a circle through points (m, 2): least squares of x^2 + y^2 + d x + e y + f = 0."""
    middle = points.mean(axis=0)
    offset = points - middle
    rows = np.column_stack([offset, np.ones(len(points))])
    (d, e, f), *_ = np.linalg.lstsq(rows, -np.sum(offset**2, axis=1), rcond=None)
    square = (d * d + e * e) / 4 - f
    return float(middle[0] - d / 2), float(middle[1] - e / 2), float(np.sqrt(max(square, 0.0)))
