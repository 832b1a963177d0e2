"""Division of a figure larger than the paper into tiles, along seams that cut no dot if possible."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, inf

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.figure import Figure, quiet_radius, size_words
from markergen.drawing.marker_artwork import TICK, ground_box
from markergen.drawing.paper import Frame, SheetOptions
from markergen.drawing.scene import Box, Line, Point, Shape, bounds, ink_points, union
from markergen.errors import InputError

Array = NDArray[np.float64]

KERF = 0.5
"""Minimum distance in mm of a seam from a dot's edge: the accuracy of cutting with scissors."""

STEP, MOST_PLACES = 0.5, 1000
"""Step in mm of the trial positions of a seam, and their maximum number."""

SHORTEST = 25.0
"""Minimum width and height of a tile, mm."""

CUT, EVEN = 1e3, 1e-3
"""Costs of a cut dot and of uneven tiles, relative to 1 for a seam that grazes a dot."""

STRIP = 20.5
"""Height of the strip that identifies a tile at the foot of its page, mm on A4."""

ARM, LEAST_ARM = 3.0, 1.5
"""Arm length of a registration cross, and its useful minimum, mm."""

END = 9.0
"""Distance from a corner of tiles to the nearest registration cross, mm."""

CENTER = 15.0
"""Preferred minimum distance of a seam from the marker's center, mm."""

MARK_WIDTH = 0.2
"""Line width of registration crosses, mm."""

MOST_TILES = 100
"""Maximum number of tiles of one marker that anyone would glue together."""


@dataclass(frozen=True)
class Item:
    """Item to keep uncut, along one axis: its center, and its half width without and with a quiet zone; mm.

    A half width of -`KERF` is for items that may be cut, but should not be near a seam.
    """

    middle: float
    half: float
    quiet: float


@dataclass(frozen=True)
class Cuts:
    """Seams along one axis in ascending order, mm, and the number of items that they cut."""

    places: tuple[float, ...]
    cut: int

    @property
    def tiles(self) -> int:
        """Number of tiles along the axis."""
        return len(self.places) + 1


@dataclass(frozen=True)
class Tile:
    """Tile: row from the top, column from the left, both from 0, and its part of the figure after trimming."""

    row: int
    column: int
    box: Box

    def holds(self, x: float, y: float) -> bool:
        """True if a point of the figure is on this tile; a point on a seam belongs to exactly one tile."""
        return self.box[0] <= x < self.box[2] and self.box[1] <= y < self.box[3]


@dataclass(frozen=True)
class Tiling:
    """Figure divided into tiles.

    Attributes
    ----------
    frame : Frame
        Frame of every page.
    overlap : float
        Overlap of neighboring tiles, mm.
    across, upward : Cuts
        Vertical and horizontal seams, mm, marker frame.
    extent : box
        Bounds of all ink of the figure.
    """

    frame: Frame
    overlap: float
    across: Cuts
    upward: Cuts
    extent: Box

    @property
    def columns(self) -> int:
        """Number of columns."""
        return self.across.tiles

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.upward.tiles

    @property
    def layout_words(self) -> str:
        """Layout in words: the number of rows, and of tiles in each."""
        return f"{self.rows} row{'s' if self.rows > 1 else ''} of {self.columns}"

    @property
    def window(self) -> Box:
        """Part of the page on which a tile is printed, mm."""
        frame = self.frame
        return frame.margin, frame.margin + STRIP * frame.scale, frame.right, frame.top

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        """Tiles row by row from the top left."""
        left, bottom, right, top = self.extent
        xs = (left, *self.across.places, right)
        ys = (top, *reversed(self.upward.places), bottom)
        return tuple(
            Tile(row, column, (xs[column], ys[row + 1], xs[column + 1], ys[row]))
            for row, column in product(range(self.rows), range(self.columns))
        )

    def seams_of(self, tile: Tile) -> tuple[bool, bool, bool, bool]:
        """True for each side of a tile, left, lower, right and upper, that has a neighbor."""
        return tile.column > 0, tile.row < self.rows - 1, tile.column < self.columns - 1, tile.row > 0

    def printed(self, tile: Tile) -> Box:
        """Part of the figure printed on a tile: the tile, extended by half the overlap at each seam."""
        half, (left, below, right, above) = self.overlap / 2, self.seams_of(tile)
        box = tile.box
        return box[0] - half * left, box[1] - half * below, box[2] + half * right, box[3] + half * above

    def shift(self, tile: Tile) -> Point:
        """Shift from the marker frame to the tile's page, which centers the tile in the window or moves it to one side.

        With a seam on only one side, that seam is as far inside the window as possible, so that the margin beyond it
        stays free for the marker.
        """
        box, window, seams = self.printed(tile), self.window, self.seams_of(tile)
        shifts = []
        for axis in (0, 1):
            low, high = window[axis] - box[axis], window[axis + 2] - box[axis + 2]
            before, after = seams[axis], seams[axis + 2]
            shifts.append(low if before and not after else high if after and not before else (low + high) / 2)
        return shifts[0], shifts[1]


def best_tiling(figure: Figure, options: SheetOptions, frames: Sequence[Frame]) -> Tiling:
    """Divide a figure on the pages that give the fewest tiles and then cut the fewest dots.

    Raises
    ------
    InputError
        If the overlap is too narrow for registration marks or too wide for the paper, or there are over `MOST_TILES`
        tiles.
    """
    overlap = round(options.overlap * 1e3, 9)
    least, most = 2 * LEAST_ARM + 1, min(frames[0].width, frames[0].top - frames[0].margin) / 4
    if not least <= overlap <= most:
        raise InputError(f"an overlap of {least:g} to {most:.0f} mm", f"{overlap:g} mm", "10 mm suits most paper")
    tilings = [_tiling(figure, frame, overlap, options.colors.grounded) for frame in frames]
    best = min(tilings, key=lambda each: (each.columns * each.rows, each.across.cut + each.upward.cut))
    if best.columns * best.rows > MOST_TILES:
        raise InputError(
            f"a marker that at most {MOST_TILES} tiles hold",
            f"{size_words(figure.marker.boundary)} on {best.frame.paper}: {best.columns} x {best.rows} tiles",
            "use larger paper",
        )
    return best


def _tiling(figure: Figure, frame: Frame, overlap: float, grounded: bool) -> Tiling:
    """Divide a figure into as few tiles as possible, with seams that avoid dots and tag if there are any such."""
    scale, tick = frame.scale, TICK * frame.scale
    solid = [(dot.x - dot.radius, dot.y - dot.radius, dot.x + dot.radius, dot.y + dot.radius) for dot in figure.dots]
    left, bottom, right, top = figure.outline
    ink = union((left - tick, bottom - tick, right + tick, top + tick), *solid)
    if grounded:
        left, bottom, right, top = ground_box(figure, scale)
        ink = union(ink, (left - tick, bottom - tick, right + tick, top + tick))
    # Quiet zones are blank and may extend into the margins beyond the ink.
    quiet, margin = figure.quiet, frame.margin
    extent = union(ink, (quiet[0] + margin, quiet[1] + margin, quiet[2] - margin, quiet[3] - margin))
    whole = Tiling(frame, overlap, Cuts((), 0), Cuts((), 0), extent)
    window = whole.window
    cuts = [
        find_seams(extent[axis], extent[axis + 2], window[axis + 2] - window[axis], overlap, _items(figure, axis))
        for axis in (0, 1)
    ]
    return Tiling(frame, overlap, cuts[0], cuts[1], extent)


def _items(figure: Figure, axis: int) -> list[Item]:
    items = [Item((dot.x, dot.y)[axis], dot.radius, quiet_radius(dot)) for dot in figure.dots]
    # A seam near the center would put crosses there that could be mistaken for it.
    items.append(Item(0.0, -KERF, CENTER))
    if figure.tag_zone and figure.tag:
        ink = bounds(figure.tag[0])
        middle = (ink[axis] + ink[axis + 2]) / 2
        items.append(Item(middle, ink[axis + 2] - middle, figure.tag_zone[axis + 2] - middle))
    return items


def find_seams(low: float, high: float, room: float, overlap: float, items: Sequence[Item]) -> Cuts:
    """Find the seams of a drawing from `low` to `high` on pages with `room` for it; mm.

    A tile needs half the overlap on each side that has a neighbor. The number of tiles is the minimum, or one more if
    that saves an item from being cut. The seams cut the fewest items; among those, they stay farthest out of quiet
    zones, then make the tiles most uniform. The optimum on a grid of positions is found exactly, by dynamic
    programming.
    """
    extent = high - low
    if extent <= room:
        return Cuts((), 0)
    # Two outer tiles of room - overlap / 2, and inner tiles of room - overlap.
    least = 2 + max(ceil((extent - (2 * room - overlap)) / (room - overlap) - 1e-9), 0)
    found = [_places(low, high, room, overlap, items, count) for count in (least, least + 1)]
    return min(found, key=lambda cuts: cuts.cut)


def _places(low: float, high: float, room: float, overlap: float, items: Sequence[Item], count: int) -> Cuts:
    outer, inner = room - overlap / 2, room - overlap
    step = max(STEP, (high - low) / MOST_PLACES)
    grid = np.arange(low, high + step / 2, step)
    middle, half, quiet = np.array([(item.middle, item.half, item.quiet) for item in items]).reshape(-1, 3).T
    away = np.abs(grid[:, None] - middle)
    hit = away < half + KERF
    graze = np.clip((quiet - away) / np.maximum(quiet - half, 1e-9), 0, 1) ** 2
    cost = CUT * hit.sum(axis=1) + np.where(hit, 0.0, graze).sum(axis=1)
    best = np.where((grid <= low + outer) & (grid >= low + SHORTEST), cost, inf)
    best += EVEN * ((grid - _even(low, high, 1, count)) / inner) ** 2
    came: list[np.ndarray] = []
    reach, gap = int(inner / step), ceil(SHORTEST / step)
    for number in range(2, count):
        back = np.zeros(len(grid), dtype=int)
        here = np.full(len(grid), inf)
        for place in range(gap, len(grid)):
            first = max(place - reach, 0)
            window = best[first : place - gap + 1]
            if len(window):
                back[place] = first + int(np.argmin(window))
                here[place] = best[back[place]]
        here += cost + EVEN * ((grid - _even(low, high, number, count)) / inner) ** 2
        best = here
        came.append(back)
    best = np.where((grid >= high - outer) & (grid <= high - SHORTEST), best, inf)
    place = int(np.argmin(best))
    if not np.isfinite(best[place]):
        # With one more tile than needed, the tiles may become too small.
        return Cuts((), len(items) + 1)
    chain = [place]
    for back in reversed(came):
        chain.append(int(back[chain[-1]]))
    return Cuts(tuple(float(grid[index]) for index in reversed(chain)), int(hit[chain].sum()))


def _even(low: float, high: float, number: int, count: int) -> float:
    return low + number * (high - low) / count


def crossed(tiles: Tiling, shapes: Iterable[Shape]) -> list[Shape]:
    """Shapes that a seam goes through."""
    found = []
    for shape in shapes:
        left, bottom, right, top = bounds(shape)
        if any(left < x < right for x in tiles.across.places) or any(bottom < y < top for y in tiles.upward.places):
            found.append(shape)
    return found


def registration(tiles: Tiling, figure: Figure, lines: Sequence[Line], color: str) -> list[Line]:
    """Crosses on the seams, two on every side shared by two tiles if quiet zones leave room, as far apart as possible.

    One arm lies on the seam, so a tile cut there shows half a cross, which its neighbor's half completes.
    """
    arm = min(ARM, tiles.overlap / 2 - 0.5)
    ink = ink_points(lines)
    crosses: list[Line] = []
    for tile in tiles.tiles:
        _, below, right, _ = tiles.seams_of(tile)
        for wanted, axis, place in ((right, 1, tile.box[2]), (below, 0, tile.box[1])):
            if not wanted:
                continue
            grid = np.arange(tile.box[axis] + END, tile.box[axis + 2] - END + 1e-9, 1.0)
            spots = np.stack([np.full(len(grid), place), grid] if axis == 1 else [grid, np.full(len(grid), place)], -1)
            free = spots[_free(spots, figure, ink, arm)]
            kind = "right" if axis == 1 else "below"
            for index, (x, y) in enumerate([] if not len(free) else [free[0], free[-1]][: 1 + (len(free) > 1)]):
                name = f"mark-{tile.row + 1}-{tile.column + 1}-{kind}-{index + 1}"
                crosses.append(Line(((x - arm, y), (x + arm, y)), MARK_WIDTH, f"{name}-x", color))
                crosses.append(Line(((x, y - arm), (x, y + arm)), MARK_WIDTH, f"{name}-y", color))
    return crosses


def _free(spots: Array, figure: Figure, ink: Array, arm: float) -> NDArray[np.bool_]:
    free = np.ones(len(spots), dtype=bool)
    for dot in figure.dots:
        free &= np.hypot(*(spots - (dot.x, dot.y)).T) > quiet_radius(dot) + arm
    if figure.tag_zone:
        low, high = np.array(figure.tag_zone[:2]) - arm, np.array(figure.tag_zone[2:]) + arm
        free &= ~np.all((spots > low) & (spots < high), axis=1)
    low, high = spots.min(axis=0, initial=np.inf) - arm - 1, spots.max(axis=0, initial=-np.inf) + arm + 1
    near = ink[np.all((ink > low) & (ink < high), axis=1)]
    free &= ~np.any(np.max(np.abs(near - spots[:, None]), axis=-1) < arm + 1, axis=1)
    return free
