"""Sheets of markers at true size: one marker to a page, several in a grid, or one on tiles.

+--------------------------+
|       |  ticks on axes   |   only the dots themselves may be in their quiet zones: a ring half a dot
|     o   o                |   diameter wide around each, which detectors need blank
| _                        |
| |  -o + o-   boundary    |
| |                        |
| L_|_|_|_| rulers   axes  |
| lengths to measure       |
|  ----------------------  |
|  marker  dots  size ...  |
+--------------------------+
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import ceil, floor, inf

from markergen.drawing.annotations import nameless_note, paragraph
from markergen.drawing.colors import Colors
from markergen.drawing.figure import Figure, compensated_note, dot_sizes, drawn_box, has_room, is_disk, size_words
from markergen.drawing.marker_artwork import GROUND, TICK, draw_artwork
from markergen.drawing.paper import ISO, MARKER_FILE, PAPERS, Frame, Paper, SheetOptions, both_ways, find_paper
from markergen.drawing.print_measurements import AIR, BAND, draw_footer, far_pair, ruler_words, short_rulers
from markergen.drawing.scene import (
    BLACK,
    Box,
    Point,
    Shape,
    Sheet,
    around_origin,
    moved_layers,
    renamed,
    scene_of,
    union,
)
from markergen.drawing.tile_sheets import Tiling, best_tiling, tile_sheets
from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker, marker_name

_TILES, _AS_PDF = "leave out --no-tile", "write a .pdf, which can have tiles"

USUAL = find_paper("A4")
"""Paper that most printers hold: several markers go on pages of it, and a marker that needs more is told so."""


def sheet_for(marker: Marker, paper: str | None = None) -> Sheet:
    """Lay out a marker on one page, at true size; see `pages_for`."""
    return pages_for([marker], SheetOptions(paper, tile=False))[0]


def pages_for(
    markers: Sequence[Marker], options: SheetOptions, beside: Sequence[tuple[Shape, ...]] = ()
) -> tuple[Sheet, ...]:
    """Lay out markers on pages at true size, never smaller.

    One marker gets one page or, if it is larger than the paper, an assembly plan and a page for each tile. Several
    markers fill pages, as many on each as fit; if no paper is named, of the smallest size from `USUAL` on that holds
    each of them.

    Parameters
    ----------
    markers : sequence of Marker
        At least one.
    beside : sequence of tuple of Shape
        Labels around the outline of each marker, mm, marker frame; not on tiles.

    Raises
    ------
    InputError
        If a control point has no dot or lies off the plane, the paper is unknown or its margins leave no room, or a
        marker does not fit on it and may not be tiled.
    """
    labels = beside or [()] * len(markers)
    rows = zip(markers, labels, options.records_of(len(markers)), strict=True)
    figures = [_figure(marker, options, shapes, record) for marker, shapes, record in rows]
    if len(figures) == 1:
        return _pages(figures, [_place(figures[0], options, options.candidates())], options)
    candidates = options.candidates(ISO[ISO.index(USUAL) :])
    for _, same in groupby(candidates, lambda frame: {frame.paper.width, frame.paper.height}):
        frames = list(same)
        places = [_whole(_reach_of(figure, options), frames) for figure in figures]
        pages = grid_pages(figures, options, frames)
        if pages or None not in places:
            return pages or _pages(figures, [place for place in places if place], options)
    return _pages(figures, [_place(figure, options, candidates) for figure in figures], options)


def one_page(
    markers: Sequence[Marker], options: SheetOptions, suffix: str, beside: Sequence[tuple[Shape, ...]] = ()
) -> Sheet:
    """Lay out markers on one page, for a format without multiple pages.

    If no paper is named, several markers go on the smallest ISO size that holds them all.

    Raises
    ------
    InputError
        If they need several pages, and as for `pages_for`.
    """
    named = options.paper is not None or len(markers) == 1
    for variant in [options] if named else [replace(options, paper=paper.name, tile=False) for paper in ISO]:
        try:
            pages = pages_for(markers, variant, beside)
        except InputError as error:
            if not named and variant.paper != ISO[-1].name:
                continue
            # Several markers have no tiles in this format.
            expected, problem, remedy = error.args
            raise InputError(expected, problem, remedy if named else remedy.replace(_TILES, _AS_PDF)) from None
        if len(pages) == 1:
            note = f"A {suffix} file has one page; a .pdf fills pages of A4, or of another --paper."
            return pages[0] if named else replace(pages[0], notes=(*pages[0].notes, note))
    fit = f"; {_fitting(_figure(markers[0], options), options)}" if len(markers) == 1 else ""
    raise InputError(
        f"one page for {suffix}", f"{len(pages)} pages on {pages[0].paper}", f"use .pdf, or a larger --paper{fit}"
    )


def check_paper(
    boundary: Boundary, options: SheetOptions, many_pages: bool = True, count: int = 1, sized: bool = False
) -> None:
    """Reject paper too small for markers in a boundary, whatever their dots, `sized` to it or not; see `pages_for`."""
    box = drawn_box(boundary)
    if count > 1 and not many_pages:
        most = max((_grid(box, frame) for frame in options.candidates()), key=lambda grid: grid.count)
        if most.count < count:
            expected = f"a page for {count} markers {size_words(boundary)}"
            raise InputError(expected, f"{most.frame.paper} for {most.count}", "use .pdf, or a larger --paper")
        return
    reach = _Reach(_sides(box), (-inf, -inf, -inf, -inf), options.colors.grounded)
    if not (options.tile and many_pages) and not _whole(reach, options.candidates()):
        raise _too_small(reach, boundary, options, sized)


def fits(marker: Marker, options: SheetOptions) -> bool:
    """True if one page holds a marker; raises as `pages_for` does."""
    figure = _figure(marker, options)
    return _whole(_reach_of(figure, options), options.candidates()) is not None


def largest_disk(options: SheetOptions, beyond: float = 0.0) -> int:
    """Radius in whole mm of the largest disk that one page holds, 0 if there is none.

    Quiet zones extend `beyond` mm outside the disk, all around.
    """
    return max(_disk_on(frame, beyond, options.colors) for frame in options.candidates())


def page_room(options: SheetOptions, beyond: float = 0.0) -> tuple[int, int]:
    """Width and height in whole mm of the largest rectangle that one page holds; for `beyond` see `largest_disk`."""
    rooms = (_room(frame, beyond, options.colors) for frame in options.candidates())
    width, height = max(rooms, key=lambda room: room[0] * room[1])
    return floor(width), floor(height)


def _disk_on(frame: Frame, beyond: float, colors: Colors) -> int:
    radius = floor(min(_room(frame, beyond, colors)) / 2) + 1
    while radius > 0 and _origin_on(frame, _around((radius,) * 4, beyond, colors)) is None:
        radius -= 1
    return max(radius, 0)


def _room(frame: Frame, beyond: float, colors: Colors) -> tuple[float, float]:
    """Width and height in mm of the largest outline that a page holds."""
    left, down, right, up = _needs(frame, _around((0.0, 0.0, 0.0, 0.0), beyond, colors))
    return frame.paper.width - left - right, frame.paper.height - down - up


def _around(outline: Box, beyond: float, colors: Colors) -> "_Reach":
    left, down, right, up = outline
    return _Reach(outline, (left + beyond, down + beyond, right + beyond, up + beyond), colors.grounded)


def _smaller(boundary: Boundary, beyond: float, options: SheetOptions, dots: Figure | bool) -> str:
    """Words on the largest outline that a page of the paper, or of `USUAL`, holds, and how to design it if dots fit."""
    options = options if options.paper else replace(options, paper=USUAL.name)
    frames = options.candidates()
    name = frames[0].paper.name
    if is_disk(boundary):
        radius = largest_disk(options, beyond)
        sized = has_room(dots, radius) if isinstance(dots, Figure) else dots
        return f"a page of {name} holds a disk of radius {radius} mm" + f": design it with --radius {radius}mm" * sized
    width, height = max((_room(frame, beyond, options.colors) for frame in frames), key=min)
    return f"a page of {name} has room for an outline of {floor(width)} x {floor(height)} mm"


def _fitting(figure: Figure, options: SheetOptions) -> str:
    return _smaller(figure.marker.boundary, _reach_of(figure, options).beyond, options, figure)


def _larger(reach: "_Reach", options: SheetOptions) -> str:
    """Words on the smallest known paper that holds a marker on a page; empty if there is none."""
    fit = _whole(reach, options.frames([*both_ways(ISO), *PAPERS.values()]))
    return f"use --paper {fit[0].paper.name}" if fit else ""


@dataclass(frozen=True)
class _Reach:
    """Extent of the outline and of the quiet zones from the origin: left, down, right, up; mm."""

    outline: Box
    quiet: Box
    grounded: bool = False
    """True if the ground is printed, and must therefore stay between the margins."""

    @property
    def beyond(self) -> float:
        """Maximum distance of a quiet zone from the outline's box."""
        return max(0.0, *(quiet - outline for quiet, outline in zip(self.quiet, self.outline, strict=True)))


def _figure(marker: Marker, options: SheetOptions, beside: tuple[Shape, ...] = (), record: str = "") -> Figure:
    """Figure to draw: the marker as designed, regardless of measurements on a print; larger if the printer shrinks."""
    sx, sy = marker.print_scale
    design = marker.as_designed
    # What was measured is not measured again: the file that was designed is.
    figure = Figure(design, (1.0, 1.0), options.colors.ink, beside, (design is marker and record) or MARKER_FILE)
    if not options.compensate:
        return figure
    if sx == sy == 1:
        raise InputError(
            "a marker that was measured on a print, to compensate for its printer",
            "a print scale of 1",
            "run markergen rescale with --measured-x and --measured-y first",
        )
    return replace(figure, factor=(1 / sx, 1 / sy))


_Place = tuple[Frame, Point] | Tiling
"""Page of a marker and the position of its origin on it, or its division into tiles."""


def _place(figure: Figure, options: SheetOptions, frames: Sequence[Frame]) -> _Place:
    reach = _reach_of(figure, options)
    place = _whole(reach, frames)
    if place is None and not options.tile:
        raise _too_small(reach, figure.marker.boundary, options, figure)
    return place or best_tiling(figure, options, options.candidates(ISO[-1:]))


def _pages(figures: Sequence[Figure], places: Sequence[_Place], options: SheetOptions) -> tuple[Sheet, ...]:
    """Pages of each marker, one after the other."""
    counts = [len(place.tiles) + 1 if isinstance(place, Tiling) else 1 for place in places]
    pages: list[Sheet] = []
    for figure, place in zip(figures, places, strict=True):
        start, total = len(pages), sum(counts)
        if isinstance(place, Tiling):
            ways = filter(None, (_larger(_reach_of(figure, options), options), _fitting(figure, options)))
            one_page = "; ".join(ways) if options.paper else ""
            pages += tile_sheets(replace(figure, beside=()), options, place, (start + 1, total), one_page)
        else:
            pages.append(_single_page(figure, options, *place, (start + 1, total)))
    if len(figures) > 1:
        where = f"The {len(figures)} markers have {len(pages)} pages, one marker after the other."
        pages[0] = replace(pages[0], notes=(where, *pages[0].notes))
    return tuple(pages)


def _whole(reach: _Reach, frames: Sequence[Frame]) -> tuple[Frame, Point] | None:
    """First page that holds a marker, and the position of the origin on it."""
    for frame in frames:
        origin = _origin_on(frame, reach)
        if origin:
            return frame, origin
    return None


def _too_small(reach: _Reach, boundary: Boundary, options: SheetOptions, dots: Figure | bool) -> InputError:
    """Error for paper that a marker does not fit on, if there are to be no tiles, or the format has none."""
    frame = options.candidates()[0] if options.paper else options.frame(ISO[-1])
    left, down, right, up = _needs(frame, reach)
    size, room = size_words(boundary), f"{ceil(left + right)} x {ceil(down + up)} mm"
    larger = _larger(reach, options)
    on_tiles = _AS_PDF if options.tile else _TILES
    whole = f"{larger}, or {on_tiles}" if larger else f"no known paper holds it: {on_tiles}"
    remedy = f"{whole}; {_smaller(boundary, reach.beyond, options, dots)}"
    if options.paper is None:
        return InputError("a marker that A0 paper holds", f"a marker {size} that needs {room}", remedy)
    return InputError(f"paper of at least {room} for a marker {size}", str(frame.paper), remedy)


def _reach_of(figure: Figure, options: SheetOptions) -> _Reach:
    return _Reach(_sides(figure.outline), _sides(figure.quiet), options.colors.grounded)


def _sides(box: Box) -> Box:
    """Extent of a box from the origin."""
    return -box[0], -box[1], box[2], box[3]


def _needs(frame: Frame, reach: _Reach) -> Box:
    """Required distances in mm of the origin from the paper's left, lower, right and upper edge.

    Marks and a printed ground respect the margin; blank quiet zones may fill it, but not extend beyond the paper. The
    ruler along y stands among the marks, but beside a ground.
    """
    ink, quiet, beside = (tuple(side + TICK * frame.scale for side in reach.outline)), reach.quiet, 0.0
    if reach.grounded:
        ink = tuple(max(pair) + GROUND * frame.scale for pair in zip(reach.outline, quiet, strict=True))
        beside = (BAND + AIR) * frame.scale
    left, down, right, up = ink
    return (
        max(frame.margin + beside + left, quiet[0]),
        frame.footer + max(down, quiet[1]),
        max(frame.margin + right, quiet[2]),
        max(frame.margin + up, quiet[3]),
    )


def _origin_on(frame: Frame, reach: _Reach) -> Point | None:
    """Position of the origin: centered across the paper if possible, and in the middle of the room above the footer.

    None if the marker does not fit.
    """
    left, down, right, up = _needs(frame, reach)
    paper = frame.paper
    if left + right > paper.width or down + up > paper.height:
        return None
    aside = (reach.outline[2] - reach.outline[0]) / 2
    x = min(max(paper.width / 2 - aside, left), paper.width - right)
    return x, (down + paper.height - up) / 2


def _single_page(figure: Figure, options: SheetOptions, frame: Frame, origin: Point, page: tuple[int, int]) -> Sheet:
    """Sheet of one marker on one page."""
    x, y = origin
    left, bottom, right, top = frame.region
    room = left - x, bottom - y, right - x, top - y
    artwork = draw_artwork(figure, options.colors, frame.scale, room)
    placed = moved_layers(artwork.layers, x, y)
    below, lengths = draw_footer(frame, [figure], placed, page)
    size = size_words(figure.marker.boundary)
    paper = frame.paper
    notes = [*_single_notes(figure, options, paper, lengths, artwork.nameless), *artwork.notes]
    if not around_origin(room):
        notes.append("The marker's origin is not on the sheet; see the coordinates in marker.json.")
    return Sheet(
        paper,
        scene_of([placed, below]),
        (origin,),
        lengths,
        marker_name(figure.marker),
        f"Fiducial marker with {len(figure.marker)} dots, {size}, at true size on {paper}. Print at 100 %.",
        tuple(notes),
        (0.0, 0.0, paper.width, paper.height),
    )


def _single_notes(
    figure: Figure, options: SheetOptions, paper: Paper, lengths: tuple[int, int], nameless: Sequence[str]
) -> tuple[str, ...]:
    boundary = figure.marker.boundary
    shape = "disk" if is_disk(boundary) else "outline"
    large = not options.paper and min(paper.width, paper.height) > USUAL.width
    tiles = f" With --paper {USUAL.name}, a .pdf has it on tiles; {_fitting(figure, options)}." if large else ""
    pairs = [far_pair(figure.marker.control_points, "xy".index(name)) for name in short_rulers(figure.marker, lengths)]
    better = f", and better {' and '.join(map(str, pairs))}" if pairs else ""
    where = "stands on" if options.paper else "needs"
    return (
        f"The marker {where} {paper}: its {shape} is {size_words(boundary)}.{tiles}",
        f"Print at 100 %, then check that the rulers on the sheet measure {ruler_words(lengths)}{better}.",
        *compensated_note(figure),
        *nameless_note(nameless),
    )


CAPTION, CAPTION_LINES = 1.7, 3
"""Cap height of captions in mm on A4, and their number of lines."""

GAP, BESIDE = 4.0, 6.0
"""Gap between neighbors, and width reserved for the ruler along y, mm on A4."""


def grid_pages(figures: Sequence[Figure], options: SheetOptions, frames: Sequence[Frame]) -> tuple[Sheet, ...]:
    """Sheets of several markers, all with the same grid; none if no page holds two.

    Of the frames, the one that holds more markers is taken.
    """
    box = union(*(union(figure.outline, figure.quiet) for figure in figures))
    best = max((_grid(box, frame) for frame in frames), key=lambda grid: grid.count)
    if best.count < 2:
        return ()
    batches = [figures[start : start + best.count] for start in range(0, len(figures), best.count)]
    pages = [_grid_page(batch, best, options, (number, len(batches))) for number, batch in enumerate(batches, 1)]
    shared = pages[0].notes
    others = (replace(page, notes=tuple(note for note in page.notes if note not in shared)) for page in pages[1:])
    return (replace(pages[0], notes=(*_grid_notes(figures, best, pages), *shared)), *others)


@dataclass(frozen=True)
class PageGrid:
    """Equal cells on a page: the box around a marker's origin that each cell needs, mm, and the number of cells."""

    frame: Frame
    cell: Box
    columns: int
    rows: int

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.columns * self.rows

    @property
    def below(self) -> float:
        """Height of a caption, at the bottom of the cell."""
        return 2 * CAPTION_LINES * CAPTION * self.frame.scale

    @property
    def room(self) -> Box:
        """Part of a cell above the caption."""
        return self.cell[0], self.cell[1] + self.below, self.cell[2], self.cell[3]

    def origin(self, index: int) -> Point:
        """Position of a marker's origin, cell by cell from the top left; spare room is distributed evenly."""
        row, column = divmod(index, self.columns)
        left, bottom, right, top = _region(self.frame)
        step_x, step_y = (right - left) / self.columns, (top - bottom) / self.rows
        x = left + (column + 0.5) * step_x - (self.cell[0] + self.cell[2]) / 2
        return x, top - (row + 0.5) * step_y - (self.cell[1] + self.cell[3]) / 2


def _region(frame: Frame) -> Box:
    """Part of the page for the cells, next to the ruler along y."""
    left, bottom, right, top = frame.region
    return left + BESIDE * frame.scale, bottom, right, top


def _grid(box: Box, frame: Frame) -> PageGrid:
    """Grid of as many markers as fit, each of which fills a box from its origin, mm."""
    scale = frame.scale
    # Room for a number and a tick outside the outline and all quiet zones.
    pad = (TICK + 2) * scale
    left, bottom, right, top = box
    width, height = right - left + 2 * pad, top - bottom + 2 * pad + 2 * CAPTION_LINES * CAPTION * scale
    cell = (left - pad, top + pad - height, right + pad, top + pad)
    region, gap = _region(frame), GAP * scale
    columns = floor((region[2] - region[0] + gap) / (width + gap))
    rows = floor((region[3] - region[1] + gap) / (height + gap))
    return PageGrid(frame, cell, max(columns, 0), max(rows, 0))


def _grid_page(figures: Sequence[Figure], grid: PageGrid, options: SheetOptions, page: tuple[int, int]) -> Sheet:
    frame = grid.frame
    layers: list[dict[str, tuple[Shape, ...]]] = []
    nameless: list[str] = []
    about: list[str] = []
    for index, figure in enumerate(figures):
        artwork = draw_artwork(figure, options.colors, frame.scale, grid.room)
        drawn = {**artwork.layers, "text": (*artwork.layers["text"], *_caption(figure.marker, grid.room, frame.scale))}
        named = {name: renamed(shapes, f"marker-{index + 1}-" if index else "") for name, shapes in drawn.items()}
        layers.append(moved_layers(named, *grid.origin(index)))
        nameless += [f"{dot} of marker {index + 1} on page {page[0]}" for dot in artwork.nameless]
        about += artwork.notes
    merged = {name: tuple(shape for figure_layers in layers for shape in figure_layers[name]) for name in layers[0]}
    points = [figure.marker.control_points for figure in figures]
    where = " of each" if all(dots == points[0] for dots in points) else " of the first"
    below, lengths = draw_footer(frame, figures, merged, page, where)
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([merged, below]),
        tuple(grid.origin(index) for index in range(len(figures))),
        lengths,
        marker_name(figures[0].marker),
        f"{len(figures)} fiducial markers, page {page[0]} of {page[1]}, at true size on {paper}. Print at 100 %.",
        (*nameless_note(nameless), *dict.fromkeys(about)),
        (0.0, 0.0, paper.width, paper.height),
    )


def _grid_notes(figures: Sequence[Figure], grid: PageGrid, pages: Sequence[Sheet]) -> tuple[str, ...]:
    where = f"one page of {grid.frame.paper}" if len(pages) == 1 else f"{len(pages)} pages of {grid.frame.paper}"
    most = f", up to {grid.count} on each" if len(pages) > 1 else ""
    return (
        f"{len(figures)} markers stand on {where}{most}.",
        f"Print at 100 %, then check that the rulers on each page measure {ruler_words(pages[0].rulers_mm)}.",
        *compensated_note(figures[0]),
    )


def _caption(marker: Marker, room: Box, scale: float) -> list[Shape]:
    """Name, facts and lengths to measure, in lines below the room."""
    pairs = [pair for pair in (far_pair(marker.control_points, axis) for axis in (0, 1)) if pair]
    lines = [f"{len(marker)} dots of {dot_sizes(marker)}, size {size_words(marker.boundary)}"]
    if pairs:
        lengths = (f"dots {pair.first} to {pair.second}: {pair.between:.1f} mm" for pair in pairs)
        lines.append(f"{', '.join(lengths)} between centers")
    left, width, height = room[0] + scale, room[2] - room[0] - 2 * scale, CAPTION * scale
    name = f"{marker.tag}, spec {marker.spec_hash}" if marker.tag else marker_name(marker)
    texts = paragraph(name, left, room[1], width, height, 1, "caption-name", BLACK)
    for index, line in enumerate(lines):
        texts += paragraph(
            line, left, room[1] - (1.94 + 1.6 * index) * height, width, 0.85 * height, 1, f"caption-{index}"
        )
    return texts
