"""Sheets of a marker larger than the paper: an assembly plan, and one page per tile.

Tiles are divided along seams that cut no dot if possible.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, cos, inf, pi, sin

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.annotations import (
    Column,
    facts,
    nameless_note,
    paragraph,
    scale_column,
    tag_column,
    title_block,
)
from markergen.drawing.colors import BLACK_ON_WHITE
from markergen.drawing.figure import Figure, compensated_note, is_disk, quiet_radius, size_words
from markergen.drawing.marker_artwork import TICK, cut_lines, draw_artwork, ground_box
from markergen.drawing.paper import Frame, SheetOptions
from markergen.drawing.print_measurements import (
    AIR,
    BAND,
    draw_remedy,
    far_pair,
    place_ruler,
    rescale_command,
    ruler_words,
)
from markergen.drawing.scene import (
    BLACK,
    FINE,
    GRAY,
    HAIRLINE,
    LIGHT,
    Box,
    Disk,
    Line,
    Point,
    Shape,
    Sheet,
    bounds,
    clipped,
    filled,
    frame_lines,
    ink_points,
    moved_layers,
    rectangle,
    scene_of,
    union,
)
from markergen.drawing.text import text, text_width, wrap
from markergen.errors import InputError
from markergen.model.marker import marker_name

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


@dataclass(frozen=True)
class Tile:
    """Tile of a figure.

    Attributes
    ----------
    row, column, number : int
        Row from the top and column from the left, both from 0, and the number of the tile from 1.
    box : Box
        Part of the figure after trimming.
    seams : tuple of bool
        True for each side, left, lower, right and upper, that has a neighbor.
    """

    row: int
    column: int
    number: int
    box: Box
    seams: tuple[bool, bool, bool, bool]

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
        return len(self.across.places) + 1

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.upward.places) + 1

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
            Tile(
                row,
                column,
                row * self.columns + column + 1,
                (xs[column], ys[row + 1], xs[column + 1], ys[row]),
                (column > 0, row < self.rows - 1, column < self.columns - 1, row > 0),
            )
            for row, column in product(range(self.rows), range(self.columns))
        )

    def printed(self, tile: Tile) -> Box:
        """Part of the figure printed on a tile: the tile, extended by half the overlap at each seam."""
        half, (left, below, right, above) = self.overlap / 2, tile.seams
        box = tile.box
        return box[0] - half * left, box[1] - half * below, box[2] + half * right, box[3] + half * above

    def offset(self, tile: Tile) -> Point:
        """Shift from the marker frame to the tile's page, which centers the tile in the window or moves it to one side.

        With a seam on only one side, that seam is as far inside the window as possible, so that the margin beyond it
        stays free for the marker.
        """
        box, window, seams = self.printed(tile), self.window, tile.seams
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
    tilings: list[Tiling] = []
    problems: list[InputError] = []
    for frame in frames:
        try:
            tilings.append(_tiling(figure, frame, overlap, options.colors.grounded))
        except InputError as problem:
            problems.append(problem)
    if not tilings:
        raise problems[0]
    return min(tilings, key=lambda tiling: (tiling.columns * tiling.rows, tiling.across.cut + tiling.upward.cut))


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
    rooms = [window[axis + 2] - window[axis] for axis in (0, 1)]
    least = [least_tiles(extent[axis + 2] - extent[axis], rooms[axis], overlap) for axis in (0, 1)]
    if least[0] * least[1] > MOST_TILES:
        raise InputError(
            f"a marker that at most {MOST_TILES} tiles hold",
            f"{size_words(figure.marker.boundary)} on {frame.paper}: {least[0]} x {least[1]} tiles",
            "use larger paper",
        )
    cuts = [find_seams(extent[axis], extent[axis + 2], rooms[axis], overlap, _items(figure, axis)) for axis in (0, 1)]
    return Tiling(frame, overlap, cuts[0], cuts[1], extent)


def _items(figure: Figure, axis: int) -> list[Item]:
    items = [Item((dot.x, dot.y)[axis], dot.radius, quiet_radius(dot)) for dot in figure.dots]
    # A seam near the center would put crosses there that could be mistaken for it.
    # A half width of -KERF is never hit, only grazed.
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
    least = least_tiles(high - low, room, overlap)
    if least == 1:
        return Cuts((), 0)
    candidates = [_places(low, high, room, overlap, items, count) for count in (least, least + 1)]
    return min(candidates, key=lambda cuts: cuts.cut)


def least_tiles(extent: float, room: float, overlap: float) -> int:
    """Return the least number of tiles: two outer ones of room - overlap / 2, and inner ones of room - overlap."""
    if extent <= room:
        return 1
    return 2 + max(ceil((extent - (2 * room - overlap)) / (room - overlap) - 1e-9), 0)


def _places(low: float, high: float, room: float, overlap: float, items: Sequence[Item], count: int) -> Cuts:
    outer, inner = room - overlap / 2, room - overlap
    step = max(STEP, (high - low) / MOST_PLACES)
    grid = np.arange(low, high + step / 2, step)
    middle, half, quiet = np.array([(item.middle, item.half, item.quiet) for item in items]).reshape(-1, 3).T
    away = np.abs(grid[:, None] - middle)
    hit = away < half + KERF
    # Squared, so that a seam in the middle between two dots costs less than one near either.
    graze = np.clip((quiet - away) / np.maximum(quiet - half, 1e-9), 0, 1) ** 2
    cost = CUT * hit.sum(axis=1) + np.where(hit, 0.0, graze).sum(axis=1)
    best = np.where((grid <= low + outer) & (grid >= low + SHORTEST), cost, inf)
    best += EVEN * ((grid - _even(low, high, 1, count)) / inner) ** 2
    # Dynamic programming over the seams from the left: the least cost of each place, and from which place it came.
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
    crossing = []
    for shape in shapes:
        left, bottom, right, top = bounds(shape)
        if any(left < x < right for x in tiles.across.places) or any(bottom < y < top for y in tiles.upward.places):
            crossing.append(shape)
    return crossing


def registration(tiles: Tiling, figure: Figure, lines: Sequence[Line], color: str) -> list[Line]:
    """Crosses on the seams, two on every side shared by two tiles if quiet zones leave room, as far apart as possible.

    One arm lies on the seam, so a tile cut there shows half a cross, which its neighbor's half completes.
    """
    arm = min(ARM, tiles.overlap / 2 - 0.5)
    ink = ink_points(lines)
    crosses: list[Line] = []
    for tile in tiles.tiles:
        _, below, right, _ = tile.seams
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
    close_ink = ink[np.all((ink > low) & (ink < high), axis=1)]
    free &= ~np.any(np.max(np.abs(close_ink - spots[:, None]), axis=-1) < arm + 1, axis=1)
    return free


CROP = 4.0
"""Length of crop marks, mm."""

BLEED = 1.0
"""Extension of a printed ground beyond a seam, mm."""

Layers = Mapping[str, Sequence[Shape]]

PALE = "#c8c8c8"
"""Color of the dots in the plan's picture: too pale to be mistaken for the marker."""

CORNERS = 48
"""Number of corners of a dot in the plan's picture: a polygon, so that no program mistakes it for the marker either."""

LARGEST = 0.6
"""Maximum scale of the plan's picture: near 1 its dots would be mistaken for the marker's, on paper or in the file."""

MOST_LENGTHS = 4
"""Maximum number of lengths across seams listed for each axis."""


def tile_sheets(
    figure: Figure, options: SheetOptions, tiles: Tiling, page: tuple[int, int], smaller: str = ""
) -> tuple[Sheet, ...]:
    """Lay out an assembly plan, then one sheet per tile.

    Parameters
    ----------
    page : (number, total)
        Number of the plan among the pages of the file.
    smaller : str
        Words on what would need no tiles.
    """
    layers, nameless, about = _layers(figure, options, tiles)
    first, total = page
    pages = [_page(figure, tiles, tile, layers, (number, total)) for number, tile in enumerate(tiles.tiles, first + 1)]
    return (_plan(figure, tiles, (*_notes(figure, options, tiles, nameless, smaller), *about), page), *pages)


def _layers(figure: Figure, options: SheetOptions, tiles: Tiling) -> tuple[Layers, Sequence[str], Sequence[str]]:
    """Artwork and registration crosses to divide, mm, marker frame; dots without room for their number; notes."""
    scale, color = tiles.frame.scale, options.colors.ink
    is_center_cut = any(abs(place) < CENTER / 2 for place in (*tiles.across.places, *tiles.upward.places))
    bare = draw_artwork(figure, options.colors, scale, tiles.extent)
    lines = [shape for name in ("cut", "marks") for shape in bare.layers[name] if isinstance(shape, Line)]
    crosses = registration(tiles, figure, lines, color)
    left, bottom, right, top = tiles.extent
    seams = [Line(((x, bottom), (x, top)), HAIRLINE) for x in tiles.across.places]
    seams += [Line(((left, y), (right, y)), HAIRLINE) for y in tiles.upward.places]
    # Numbers avoid seams and crosses, like all other ink, and stay on the tile of their dot.
    homes = [next(tile.box for tile in tiles.tiles if tile.holds(dot.x, dot.y)) for dot in figure.dots]
    artwork = draw_artwork(figure, options.colors, scale, tiles.extent, ink_points([*seams, *crosses]), homes)
    marks = [shape for shape in artwork.layers["marks"] if not (is_center_cut and shape.name.startswith("center-"))]
    return {**artwork.layers, "marks": (*marks, *crosses)}, artwork.nameless, artwork.notes


def _page(figure: Figure, tiles: Tiling, tile: Tile, layers: Layers, page: tuple[int, int]) -> Sheet:
    paper = tiles.frame.paper
    dx, dy = tiles.offset(tile)
    placed = moved_layers(_part(tiles, tile, layers), dx, dy)
    box = tile.box[0] + dx, tile.box[1] + dy, tile.box[2] + dx, tile.box[3] + dy
    drawn = {**placed, "marks": (*placed["marks"], *_crop_marks(tiles, box, tile.seams))}
    strip, lengths = _strip(figure, tiles, tile, drawn, page)
    edges = (0.0, 0.0, paper.width, paper.height)
    left, bottom, right, top = (at if seam else edge for at, seam, edge in zip(box, tile.seams, edges, strict=True))
    return Sheet(
        paper,
        scene_of([drawn, strip]),
        ((dx, dy),),
        lengths,
        marker_name(figure.marker),
        f"Tile {tile.number} of {len(tiles.tiles)}, row {tile.row + 1}, column {tile.column + 1}, of a fiducial marker "
        f"with {len(figure.marker)} dots, {size_words(figure.marker.boundary)}, at true size on {paper}. "
        "Print at 100 %.",
        (),
        (left, bottom, right, top),
    )


def _part(tiles: Tiling, tile: Tile, layers: Layers) -> dict[str, list[Shape]]:
    """Part of the artwork on a tile.

    Dots, tag and numbers are printed only on the tile that contains their center, but what a seam goes through on every
    tile that it overlaps.
    """
    left, bottom, right, top = tile.box
    window = tiles.printed(tile)
    cut = {shape.name for shape in crossed(tiles, [*layers["dots"], *layers["tag"]])}
    part: dict[str, list[Shape]] = {}
    for name, shapes in layers.items():
        if name in ("dots", "tag", "text"):
            part[name] = []
            for shape in shapes:
                low_x, low_y, high_x, high_y = bounds(shape)
                x, y = (low_x + high_x) / 2, (low_y + high_y) / 2
                if shape.name in cut:
                    part[name] += clipped([shape], window)
                elif tile.holds(x, y):
                    part[name].append(shape)
        elif name == "ground":
            seams = [BLEED if seam else 0.0 for seam in tile.seams]
            part[name] = list(clipped(shapes, (left - seams[0], bottom - seams[1], right + seams[2], top + seams[3])))
        else:
            part[name] = list(clipped(shapes, window))
    return part


def _crop_marks(tiles: Tiling, box: Box, seams: tuple[bool, bool, bool, bool]) -> list[Shape]:
    """Short lines at both ends of every seam, at the edge of the printed area."""
    left, bottom, right, top = tiles.window
    half = tiles.overlap / 2
    length = min(CROP, half)
    # In the overlap beyond where seams meet; otherwise at the end of the window.
    low_y, high_y = (box[1] - half if seams[1] else bottom), (box[3] + half if seams[3] else top)
    low_x, high_x = (box[0] - half if seams[0] else left), (box[2] + half if seams[2] else right)
    names = ("left", "below", "right", "above")
    marks: list[Shape] = []
    for side in (side for side in (0, 2, 1, 3) if seams[side]):
        upright, at = side % 2 == 0, box[side]
        low, high = (low_y, high_y) if upright else (low_x, high_x)
        for end, a, b in ((1 - side % 2, low, low + length), (3 - side % 2, high - length, high)):
            points = ((at, a), (at, b)) if upright else ((a, at), (b, at))
            marks.append(Line(points, HAIRLINE, f"crop-{names[side]}-{names[end]}"))
    return marks


def _strip(
    figure: Figure, tiles: Tiling, tile: Tile, drawn: Layers, page: tuple[int, int]
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """Draw a tile's rulers beside it and at the foot of the page, and the strip that identifies it."""
    frame, scale = tiles.frame, tiles.frame.scale
    left, bottom, right, top = tiles.window
    band_scale = min(scale, 1.2)
    band = BAND * band_scale
    dots = [shape for shape in drawn["dots"] if isinstance(shape, Disk)]
    others = [shape for name, shapes in drawn.items() if name not in ("dots", "ground") for shape in shapes]
    # The overlap next to a printed ground is just wide enough for a ruler.
    air = AIR * band_scale
    boxes = [bounds(shape) for shape in drawn["ground"]]
    ground = [rectangle((b[0] + air, b[1] + air, b[2] - air, b[3] - air), "", "") for b in boxes]
    base = frame.margin + (STRIP - 5.2) * scale
    rule = Line(((left, frame.margin + 7.6 * scale), (right, frame.margin + 7.6 * scale)), HAIRLINE, "rule", LIGHT)
    x_length, (x_marks, x_text) = place_ruler(
        [((left, base, right, base + band), 1)], 0, band_scale, figure.factor[0], (), (), "ruler"
    )
    sides: list[tuple[Box, int]] = [((left, bottom, left + band, top), 1), ((right - band, bottom, right, top), -1)]
    # Next to a seam the ruler stands where it is cut off or covered.
    if not tile.seams[0]:
        sides.reverse()
    y_length, (y_marks, y_text) = place_ruler(
        sides, 1, band_scale, figure.factor[1], dots, [*others, *ground], "ruler-y"
    )
    lengths = (x_length, y_length)
    remedy = draw_remedy(frame, lengths, figure.record, base - 1.7 * scale, 1.4 * scale)
    columns = facts(frame, _facts(figure, tiles, tile, lengths, page), frame.margin, "tile")
    return {"marks": (rule, *x_marks, *y_marks), "text": (*x_text, *y_text, *remedy, *columns)}, lengths


def _facts(figure: Figure, tiles: Tiling, tile: Tile, lengths: tuple[int, int], page: tuple[int, int]) -> list[Column]:
    number = f"tile {tile.number} of {len(tiles.tiles)}"
    edges = " and ".join(name for name, seam in (("left", tile.seams[0]), ("top", tile.seams[3])) if seam)
    here = [
        point for point, dot in zip(figure.marker.control_points, figure.dots, strict=True) if tile.holds(dot.x, dot.y)
    ]
    columns: list[Column] = [
        ("number", f"row {tile.row + 1}, column {tile.column + 1}", (number,), "bold"),
        ("page", tiles.frame.paper.name, (f"page {page[0]} of {page[1]}",), "regular"),
        ("spec", "spec", (marker_name(figure.marker).removeprefix("markergen-"),), "regular"),
        *tag_column([figure.marker]),
        *([scale_column(figure.factor)] if figure.factor != (1.0, 1.0) else []),
        ("cut", "cut along marks", (edges or "nothing",), "regular"),
        ("rulers", "rulers to 0.1 mm", (ruler_words(lengths),), "regular"),
    ]
    for axis, name in enumerate("xy"):
        pair = far_pair(here, axis)
        if pair:
            heading = f"dots {pair.first} to {pair.second} along {name}"
            columns.append((name, heading, (f"{pair.between:.1f} mm, edges {pair.over:.1f}",), "regular"))
    return columns


def _notes(
    figure: Figure, options: SheetOptions, tiles: Tiling, nameless: Sequence[str], smaller: str
) -> tuple[str, ...]:
    boundary, paper = figure.marker.boundary, tiles.frame.paper
    count = len(tiles.tiles)
    shape = "disk" if is_disk(boundary) else "outline"
    why = "No paper up to A0 holds it" if options.paper is None else "With margins and rulers it needs more than a page"
    where = f"{count} tiles of {paper}: {tiles.layout_words}" if count > 1 else f"a page of {paper} with fewer words"
    how = "shows how to put them together" if count > 1 else "says the rest"
    notes = [
        f"The {shape} of the marker is {size_words(boundary)}. {why}, so it goes on {where}, after a page that {how}.",
        *([f"To print it on one: {smaller}."] if smaller else []),
        "Print at 100 %, then check the rulers on every page.",
    ]
    cut = [dot.name.removeprefix("dot-") for dot in crossed(tiles, figure.dots)]
    which = [f"dot {cut[0]}" if len(cut) == 1 else f"dots {', '.join(cut)}"] if cut else []
    which += ["the tag"] if crossed(tiles, figure.tag) else []
    if which:
        cuts = " and ".join(which)
        notes.append(f"A seam cuts {cuts}: no place for the seams avoids that, use larger paper or glue with care.")
    return (*notes, *compensated_note(figure), *nameless_note(nameless))


def _plan(figure: Figure, tiles: Tiling, notes: tuple[str, ...], page: tuple[int, int]) -> Sheet:
    """Assembly plan; it is neither cut nor measured."""
    frame, scale, paper = tiles.frame, tiles.frame.scale, tiles.frame.paper
    left, width, top = frame.margin, frame.width, frame.top
    count = len(tiles.tiles)
    size = size_words(figure.marker.boundary)
    texts: list[Shape] = [text("Assembly plan", left, top - 3.8 * scale, 3.8 * scale, face="bold", name="plan-title")]
    what = f"{count} tiles in {tiles.layout_words}, for" if count > 1 else "the other has"
    subtitle = f"Page {page[0]} of {page[1]}: {what} a marker of {size}"
    texts += paragraph(subtitle, left, top - 6.5 * scale, width, 1.9 * scale, 2, "plan-subtitle")
    block_marks, block_text = title_block(frame, [figure.marker], figure.factor, page)
    low = frame.block_top + 4 * scale
    steps, high = _steps(figure, tiles, low, page[0] + 1)
    marks, numbers = _picture(figure, tiles, (left, high + 5 * scale, frame.right, top - 13 * scale))
    return Sheet(
        paper,
        scene_of([{"marks": (*marks, *block_marks), "text": (*texts, *numbers, *steps, *block_text)}]),
        (),
        (0, 0),
        marker_name(figure.marker),
        f"Assembly plan for {count} tiles of a fiducial marker with {len(figure.marker)} dots, {size}, on {paper}.",
        notes,
        (0.0, 0.0, paper.width, paper.height),
    )


def _picture(figure: Figure, tiles: Tiling, room: Box) -> tuple[list[Shape], list[Shape]]:
    """Small picture of all tiles in a part of the page, with their numbers; edges to cut are dashed."""
    scale = tiles.frame.scale
    left, bottom, right, top = tiles.extent
    small = min((room[2] - room[0]) / (right - left), (room[3] - room[1]) / (top - bottom), LARGEST)
    dx, dy = (room[0] + room[2]) / 2, (room[1] + room[3]) / 2

    def at(x: float, y: float) -> Point:
        return dx + small * (x - (left + right) / 2), dy + small * (y - (bottom + top) / 2)

    marks: list[Shape] = []
    for dot in figure.dots:
        rings = [_circle(at(dot.x, dot.y), small * dot.radius)]
        if dot.inner_radius:
            rings.append(_circle(at(dot.x, dot.y), small * dot.inner_radius)[::-1])
        marks.append(filled(rings, f"plan-{dot.name}", PALE))
    squares = [bounds(shape) for shape in figure.tag]
    marks += [rectangle((*at(*box[:2]), *at(*box[2:])), "plan-tag", PALE) for box in squares]
    edges = [
        Line(tuple(at(*point) for point in line.points), HAIRLINE, f"plan-{line.name}", LIGHT)
        for line in cut_lines(figure, BLACK_ON_WHITE)
    ]
    marks += edges
    marks.append(frame_lines((*at(left, bottom), *at(right, top)), FINE, "plan-edge", GRAY))
    for index, x in enumerate(tiles.across.places):
        marks += _dashed(at(x, bottom), at(x, top), f"plan-across-{index}")
    for index, y in enumerate(tiles.upward.places):
        marks += _dashed(at(left, y), at(right, y), f"plan-upward-{index}")
    texts: list[Shape] = []
    # Labels avoid dots and outline.
    points = ink_points(edges)
    disks = np.array([(*at(dot.x, dot.y), small * dot.radius) for dot in figure.dots])
    tags = [((left + right) / 2, (low + high) / 2, right - left) for left, low, right, high in squares]
    around = [(*at(x, y), 0.6 * small * side) for x, y, side in tags]
    disks = np.concatenate([disks, np.array(around).reshape(-1, 3), np.column_stack([points, np.ones(len(points))])])
    for tile in tiles.tiles:
        (x0, y0), (x1, y1) = at(*tile.box[:2]), at(*tile.box[2:])
        label = f"row {tile.row + 1}, column {tile.column + 1}"
        height = min(5 * scale, (y1 - y0) / 4, (x1 - x0) / 4)
        fine = min(0.34 * height, 0.34 * height * 0.9 * (x1 - x0) / text_width(label, 0.34 * height))
        wide, high, pad = text_width(label, fine), height + 2.2 * fine, 0.4 * height
        # The upper left corner, or the place where it hides least.
        xs, ys = (x0 + pad, (x0 + x1 - wide) / 2, x1 - pad - wide), (y1 - pad - high, (y0 + y1 - high) / 2, y0 + pad)
        places = [(x, y) for y in ys for x in xs]
        x, y = max(places, key=lambda place: min(_gap(place, (wide, high), disks), 0.0))
        texts.append(text(str(tile.number), x, y + 2.2 * fine, height, face="bold", name=f"plan-tile-{tile.number}"))
        texts.append(text(label, x, y, fine, color=GRAY, name=f"plan-tile-{tile.number}-label"))
    return marks, texts


def _gap(place: Point, size: Point, disks: NDArray[np.float64]) -> float:
    """Gap between a box, given by its lower left corner, and the nearest disk (x, y, radius); negative for overlap."""
    low = np.array(place)
    # Of each axis, how far the disk's center is outside of the box; 0 inside.
    beyond = np.maximum(np.maximum(low - disks[:, :2], disks[:, :2] - low - size), 0)
    return float(np.min(np.hypot(*beyond.T) - disks[:, 2]))


def _circle(center: Point, radius: float) -> list[Point]:
    angles = (2 * pi * index / CORNERS for index in range(CORNERS))
    return [(center[0] + radius * cos(angle), center[1] + radius * sin(angle)) for angle in angles]


def _dashed(start: Point, end: Point, name: str) -> list[Line]:
    """Dashes of 3 mm with gaps of 2 mm along a horizontal or vertical line."""
    axis = 0 if end[0] > start[0] else 1
    dashes, place, number = [], start[axis], 0
    while place < end[axis]:
        stop = min(place + 3.0, end[axis])
        points = [(place, start[1]), (stop, start[1])] if axis == 0 else [(start[0], place), (start[0], stop)]
        dashes.append(Line(tuple(points), FINE, f"{name}-{number}", BLACK))
        place, number = place + 5.0, number + 1
    return dashes


def _steps(figure: Figure, tiles: Tiling, low: float, first: int) -> tuple[list[Shape], float]:
    """Numbered paragraphs ending at height `low`, and the height of their upper end."""
    frame, scale = tiles.frame, tiles.frame.scale
    height, indent = 1.75 * scale, 5 * scale
    rows: list[tuple[str, str]] = []
    for number, step in enumerate(_words(figure, tiles, first), 1):
        for index, line in enumerate(wrap(step, frame.width - indent, height)):
            rows.append((f"{number}" if index == 0 else "", line))
    step_up, y = 1.85 * height, low
    texts: list[Shape] = []
    for index, (number_text, line) in reversed(list(enumerate(rows))):
        texts.append(text(line, frame.margin + indent, y, height, name=f"step-{index}"))
        if number_text:
            texts.append(text(number_text, frame.margin, y, height, face="bold", name=f"step-number-{number_text}"))
            y += 0.6 * height
        y += step_up
    return texts, y


def _words(figure: Figure, tiles: Tiling, first: int) -> list[str]:
    """Instructions for tiles that are on the pages from `first` on."""
    count = len(tiles.tiles)
    half = f"{tiles.overlap / 2:g}"
    if count == 1:
        return [
            f"Print page {first} at 100 % (actual size, not fitted to the page). Its rulers must be true to 0.1 mm; it "
            "says what to do if they are not. Nothing is to be cut or glued."
        ]
    steps = [
        f"Print pages {first} to {first + count - 1} at 100 % (actual size, not fitted to the page), all on the same "
        "printer. The rulers on every page must be true to 0.1 mm; each page says what to do if they are not.",
        "Cut tiles along the crop marks on their left and upper edges where another tile joins (dashed lines); "
        f"each page says which. Leave right and lower edges: {half} mm and the margin beyond lie under the next tile.",
        "Begin with tile 1. Lay each next tile onto the edge of its neighbor so that every cross on the seam is whole: "
        "the cut edge along one arm, the two halves of the other in line. Glue row by row, then row to row, on a flat, "
        "stiff board.",
    ]
    lengths = _across(figure, tiles)
    if lengths:
        steps.append(
            f"Measure across the seams, before the glue is dry: {'; '.join(lengths)}. Move the tiles until this is so "
            "within 0.2 mm. Or measure the dots as they are and use them: "
            f"{rescale_command(figure.record)}"
        )
    return steps


def _across(figure: Figure, tiles: Tiling) -> Sequence[str]:
    """Lengths between dots on opposite sides of the seams."""
    pairs: list[str] = []
    for axis, cuts in enumerate((tiles.across, tiles.upward)):
        for place in cuts.places[:MOST_LENGTHS]:
            pair = far_pair(figure.marker.control_points, axis, place / figure.factor[axis] / 1e3)
            if pair and str(pair) not in pairs:
                pairs.append(str(pair))
    return pairs
