"""Tiles put together again by their registration marks: the pages of a marker that is larger than the paper.

A registration mark is a cross on a seam that both neighbors print whole. Seams are the sides where a page is trimmed.
Tiles come row by row from the top left; the first of a row has no seam on its left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.verification.reading import Page

Array = NDArray[np.float64]

ON_SEAM = 2.0
"""How far in mm a cross may be off the seam it belongs to: what a scale of 1 % takes it away on large paper."""

WHOLE = 0.93
"""Share of a circle's turn that the pieces on all pages must make up."""

SAME = 2.0
"""Up to how many mm apart the pieces of one circle may seem to be before they are fitted together."""

PIECES, LEAST = 64, 6
"""Stretches of a turn that are counted, and points of a piece."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A page with what is needed to put it together with others.

    Attributes
    ----------
    page : Page
    crosses : array (k, 2)
        Where two lines of one length cross in their middles, mm.
    trim : (left, bottom, right, top) or None for each
        Seams, mm; None where the page is not cut.
    arcs : tuple of arrays (m, 2)
        Points of outlines that are in part those of circles, mm.
    """

    page: Page
    crosses: Array
    trim: tuple[float | None, float | None, float | None, float | None]
    arcs: tuple[Array, ...] = ()

    def marks(self, side: int) -> Array:
        """Crosses on one seam, in order along it; none where there is no seam."""
        place = self.trim[side]
        if place is None:
            return np.zeros((0, 2))
        axis = side % 2
        chosen = self.crosses[np.abs(self.crosses[:, axis] - place) < ON_SEAM]
        return chosen[np.argsort(chosen[:, 1 - axis])]


@dataclass
class Assembly:
    """Tiles on one large page, and what the marks say against it."""

    page: Page
    gaps: list[str] = field(default_factory=list)


Grid = dict[tuple[int, int], tuple[int, Sheet]]
"""Number of a page, from 0, and the page, by row and column."""


def is_tiled(sheets: Sequence[Sheet]) -> bool:
    """Tell whether pages are to be put together: they have seams."""
    return any(place is not None for sheet in sheets for place in sheet.trim)


def assemble(sheets: Sequence[Sheet], radii: Array, tolerance: float) -> Assembly:
    """All tiles on one page: each is shifted so that its marks lie on those of its neighbors.

    Parameters
    ----------
    radii : array
        Of the circles whose pieces are looked for on several pages, mm.
    tolerance : float
        mm; neighbors whose marks do not fit each other so well are told.
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
        # The tile that most marks tie to those that lie already.
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
    """Places on the left, below, on the right, above."""
    row, column = key
    return (row, column - 1), (row + 1, column), (row, column + 1), (row - 1, column)


def _ties(grid: Grid, key: tuple[int, int], shifts: Mapping[tuple[int, int], Array]) -> Array:
    """Shifts (k, 2) of a tile that its marks and those of the neighbors that lie already ask for."""
    found = [np.zeros((0, 2))]
    for side, there in enumerate(_neighbors(key)):
        if there in shifts:
            mine, other = grid[key][1].marks(side), grid[there][1].marks((side + 2) % 4)
            if len(mine) == len(other):
                found.append(other + shifts[there] - mine)
    return np.concatenate(found)


def _joined(outlines: Sequence[Array], radii: Array) -> Array:
    """Circles (m, 3) that pieces of outlines make up together."""
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
            # Where pieces do not fit each other the circle is none: as far off as its worst point.
            off = np.abs(np.linalg.norm(points - [x, y], axis=1) - r)
            circles.append((x, y, r))
            if off.max() > 1e-3:
                circles.append((x + float(off.max()), y, r))
    return np.array(circles, dtype=float).reshape(-1, 3)


def _piece(outline: Array, radius: float) -> list[tuple[Array, float, Array]]:
    """Center, radius and points of the largest part of an outline that lies on a circle of about a radius."""
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
        # Three points of a short piece put the circle roughly.
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
    """Center and radius of the circle through points (m, 2), least squares of x^2 + y^2 + d x + e y + f = 0."""
    middle = points.mean(axis=0)
    offset = points - middle
    rows = np.column_stack([offset, np.ones(len(points))])
    (d, e, f), *_ = np.linalg.lstsq(rows, -np.sum(offset**2, axis=1), rcond=None)
    square = (d * d + e * e) / 4 - f
    return float(middle[0] - d / 2), float(middle[1] - e / 2), float(np.sqrt(max(square, 0.0)))
