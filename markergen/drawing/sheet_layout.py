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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, inf

from markergen.drawing.annotations import axis_arrows, facts, nameless_note, paragraph, remedy_lines, title_block
from markergen.drawing.colors import Colors
from markergen.drawing.figure import Figure, compensated_note, drawn_box, is_disk, size_words
from markergen.drawing.marker_artwork import GROUND, TICK, draw_artwork
from markergen.drawing.paper import ISO, PAPERS, Frame, SheetOptions, both_ways
from markergen.drawing.print_measurements import (
    BAND,
    LENGTHS,
    far_pair,
    measured_columns,
    place_ruler,
    remedy_words,
    ruler,
    ruler_words,
)
from markergen.drawing.scene import (
    BLACK,
    FINE,
    Box,
    Disk,
    Point,
    Shape,
    Sheet,
    around_origin,
    moved_layers,
    renamed,
    scene_of,
    union,
)
from markergen.drawing.tile_layout import best_tiling
from markergen.drawing.tile_sheets import tile_sheets
from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker, marker_name

_AWAY = "The marker's origin is not on the sheet; see the coordinates in marker.json."

CAPTION, CAPTION_LINES = 1.7, 3
"""Cap height of captions in mm on A4, and their number of lines."""

GAP = 4.0
"""Gap between neighbors, mm on A4."""

BESIDE = 6.0
"""Width reserved for the ruler along y, mm on A4."""


def sheet_for(marker: Marker, paper: str | None = None) -> Sheet:
    """Lay out a marker on one page, at true size; see `pages_for`."""
    return pages_for([marker], SheetOptions(paper, tile=False))[0]


def pages_for(markers: Sequence[Marker], options: SheetOptions) -> tuple[Sheet, ...]:
    """Lay out markers on pages at true size, never smaller.

    One marker gets one page or, if it is larger than the paper, an assembly plan and a page for each tile. Several
    markers share pages, as many on each as fit; if no paper is named, it is the smallest from A4 on that holds one of
    them.

    Parameters
    ----------
    markers : sequence of Marker
        At least one.
    options : SheetOptions

    Raises
    ------
    InputError
        If a control point has no dot or lies off the plane, the paper is unknown or its margins leave no room, or a
        marker does not fit on it and may not be tiled.
    """
    figures = [_figure(marker, options) for marker in markers]
    if len(figures) > 1:
        pages = _grid_pages(figures, options, options.candidates(ISO[1:]))
        if pages:
            return pages
    return tuple(page for figure in figures for page in _pages(figure, options))


def one_page(markers: Sequence[Marker], options: SheetOptions, suffix: str) -> Sheet:
    """Lay out markers on one page, for a format without multiple pages.

    Raises
    ------
    InputError
        If they need several pages, and as for `pages_for`.
    """
    pages = pages_for(markers, options)
    if len(pages) != 1:
        raise InputError(
            f"one page for {suffix}", f"{len(pages)} pages on {pages[0].paper}", "use .pdf, or a larger --paper"
        )
    return pages[0]


def check_paper(boundary: Boundary, options: SheetOptions) -> None:
    """Reject a boundary that is too large for the paper, whatever its dots; see `pages_for`."""
    box = drawn_box(boundary)
    reach = _reach_of(box, (inf, inf, -inf, -inf), options.colors)
    if not _whole(reach, options.candidates()) and not options.tile:
        raise _too_small(reach, size_words(boundary), options)


@dataclass(frozen=True)
class _Reach:
    """Extent of the outline and of the quiet zones from the origin: left, down, right, up; mm."""

    outline: Box
    quiet: Box
    grounded: bool = False
    """True if the ground is printed, and must therefore stay between the margins."""


def _figure(marker: Marker, options: SheetOptions) -> Figure:
    """Figure to draw: the marker as designed, regardless of measurements on a print; larger if the printer shrinks."""
    sx, sy = marker.print_scale
    if not options.compensate:
        return Figure(marker.as_designed, ink=options.colors.ink)
    if sx == sy == 1:
        raise InputError(
            "a marker that was measured on a print, to compensate for its printer",
            "a print scale of 1",
            "run markergen rescale with --measured-x and --measured-y first",
        )
    return Figure(marker.as_designed, (1 / sx, 1 / sy), options.colors.ink)


def _pages(figure: Figure, options: SheetOptions) -> tuple[Sheet, ...]:
    reach = _reach_of(figure.outline, figure.quiet, options.colors)
    found = _whole(reach, options.candidates())
    if found:
        return (_single_page(figure, options, *found),)
    if not options.tile:
        raise _too_small(reach, size_words(figure.marker.boundary), options)
    return tile_sheets(figure, options, best_tiling(figure, options, options.candidates(ISO[-1:])))


def _whole(reach: _Reach, frames: Sequence[Frame]) -> tuple[Frame, Point] | None:
    """First page that holds a marker, and the position of the origin on it."""
    for frame in frames:
        origin = _origin_on(frame, reach)
        if origin:
            return frame, origin
    return None


def _too_small(reach: _Reach, size: str, options: SheetOptions) -> InputError:
    frame = options.candidates()[0] if options.paper else options.frame(ISO[-1])
    left, down, right, up = _needs(frame, reach)
    room = f"{ceil(left + right)} x {ceil(down + up)} mm"
    fit = _whole(reach, options.frames([*both_ways(ISO), *PAPERS.values()]))
    tile = ", or leave out --no-tile" if fit else "leave out --no-tile, design a smaller one, or export it as .step"
    if options.paper is None:
        found = f"a marker {size} that needs {room}"
        return InputError(
            "a marker that A0 paper holds", found, f"use --paper {fit[0].paper.name}{tile}" if fit else tile
        )
    return InputError(
        f"paper of at least {room} for a marker {size}",
        str(frame.paper),
        f"use --paper {fit[0].paper.name}{tile}" if fit else f"no known paper holds it: {tile}",
    )


def _reach_of(outline: Box, quiet: Box, colors: Colors) -> _Reach:
    """Extent of a marker whose outline and quiet zones fill these boxes (mm, marker frame)."""
    sides = [(-box[0], -box[1], box[2], box[3]) for box in (outline, quiet)]
    return _Reach(sides[0], sides[1], colors.grounded)


def _needs(frame: Frame, reach: _Reach) -> Box:
    """Required distances in mm of the origin from the paper's left, lower, right and upper edge.

    Marks and a printed ground respect the margin; blank quiet zones may fill it, but not extend beyond the paper.
    """
    ink, quiet = (tuple(side + TICK * frame.scale for side in reach.outline)), reach.quiet
    if reach.grounded:
        ink = tuple(max(pair) + GROUND * frame.scale for pair in zip(reach.outline, quiet, strict=True))
    left, down, right, up = ink
    return (
        max(frame.margin + left, quiet[0]),
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


def _footer(
    frame: Frame, markers: Sequence[Marker], factor: Point, taken: Mapping[str, Sequence[Shape]], where: str = ""
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """Draw everything below and beside the markers; also return the lengths of the rulers.

    These are rulers, axes, lengths to measure, remedies if they are off, and the title block.
    """
    scale, left, base = frame.scale, frame.margin, frame.ruler_y
    axes_marks, axes_text = axis_arrows(frame)
    room = frame.width - 24 * scale
    x_length = next((length for length in LENGTHS if length * factor[0] <= room), LENGTHS[-1])
    x_marks, x_text = ruler((left, base), x_length, 0, scale, factor[0])
    band = BAND * scale
    others = [shape for name, shapes in taken.items() if name != "dots" for shape in shapes]
    dots = [shape for shape in taken["dots"] if isinstance(shape, Disk)]
    y_length, (y_marks, y_text) = place_ruler(
        [
            ((left, base - FINE / 2, left + band, frame.top), 1),
            ((frame.right - band, frame.footer, frame.right, frame.top), -1),
        ],
        1,
        scale,
        factor[1],
        dots,
        others,
        "ruler-y",
    )
    lengths = (x_length, y_length)
    words = remedy_lines(frame, remedy_words(lengths), frame.block_top + 7.6 * scale, 1.6 * scale)
    lines = facts(frame, measured_columns(markers[0], lengths, where), frame.checks_y, "check")
    block_marks, block_text = title_block(frame, markers, factor)
    layers: dict[str, tuple[Shape, ...]] = {
        "marks": (*x_marks, *y_marks, *axes_marks, *block_marks),
        "text": (*x_text, *y_text, *axes_text, *lines, *words, *block_text),
    }
    return layers, lengths


def _single_page(figure: Figure, options: SheetOptions, frame: Frame, origin: Point) -> Sheet:
    """Sheet of one marker on one page."""
    x, y = origin
    left, bottom, right, top = frame.region
    room = left - x, bottom - y, right - x, top - y
    artwork = draw_artwork(figure, options.colors, frame.scale, room)
    placed = moved_layers(artwork.layers, x, y)
    below, lengths = _footer(frame, [figure.marker], figure.factor, placed)
    size = size_words(figure.marker.boundary)
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([placed, below]),
        (origin,),
        lengths,
        marker_name(figure.marker),
        f"Fiducial marker with {len(figure.marker)} dots, {size}, at true size on {paper}. Print at 100 %.",
        _single_notes(figure, f"{'stands on' if options.paper else 'needs'} {paper}", lengths, artwork.nameless)
        + artwork.notes
        + (() if around_origin(room) else (_AWAY,)),
        (0.0, 0.0, paper.width, paper.height),
    )


def _single_notes(figure: Figure, where: str, lengths: tuple[int, int], nameless: Sequence[str]) -> tuple[str, ...]:
    boundary = figure.marker.boundary
    shape = "disk" if is_disk(boundary) else "outline"
    return (
        f"The marker {where}: its {shape} is {size_words(boundary)}.",
        f"Print at 100 %, then check that the rulers on the sheet measure {ruler_words(lengths)}.",
        *compensated_note(figure),
        *nameless_note(nameless),
    )


def _grid_pages(figures: Sequence[Figure], options: SheetOptions, frames: Sequence[Frame]) -> tuple[Sheet, ...]:
    """Sheets of several markers, all with the same grid; none if the first page that holds a marker holds only one.

    The page is the first of the frames, in the orientation of its paper that holds more markers.
    """
    grids = [_grid(figures, frame) for frame in frames]
    first = next((grid for grid in grids if grid.count), None)
    if first is None:
        return ()
    size = {first.frame.paper.width, first.frame.paper.height}
    same = [grid for grid in grids if {grid.frame.paper.width, grid.frame.paper.height} == size]
    best = max(same, key=lambda grid: grid.count)
    if best.count < 2:
        return ()
    batches = [figures[start : start + best.count] for start in range(0, len(figures), best.count)]
    pages = [_grid_page(batch, best, options, number, len(batches)) for number, batch in enumerate(batches, 1)]
    told = pages[0].notes
    others = (replace(page, notes=tuple(note for note in page.notes if note not in told)) for page in pages[1:])
    return (replace(pages[0], notes=(*_grid_notes(figures, best, pages), *told)), *others)


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


def _grid(figures: Sequence[Figure], frame: Frame) -> PageGrid:
    scale = frame.scale
    # Room for a number and a tick outside the outline and all quiet zones.
    pad = (TICK + 2) * scale
    left, bottom, right, top = union(*(union(figure.outline, figure.quiet) for figure in figures))
    width, height = right - left + 2 * pad, top - bottom + 2 * pad + 2 * CAPTION_LINES * CAPTION * scale
    cell = (left - pad, top + pad - height, right + pad, top + pad)
    region, gap = _region(frame), GAP * scale
    columns = floor((region[2] - region[0] + gap) / (width + gap))
    rows = floor((region[3] - region[1] + gap) / (height + gap))
    return PageGrid(frame, cell, max(columns, 0), max(rows, 0))


def _grid_page(figures: Sequence[Figure], grid: PageGrid, options: SheetOptions, number: int, pages: int) -> Sheet:
    frame = grid.frame
    layers: list[dict[str, tuple[Shape, ...]]] = []
    nameless: list[str] = []
    notes: list[str] = []
    for index, figure in enumerate(figures):
        artwork = draw_artwork(figure, options.colors, frame.scale, grid.room)
        drawn = {**artwork.layers, "text": (*artwork.layers["text"], *_caption(figure.marker, grid.room, frame.scale))}
        named = {name: renamed(shapes, f"marker-{index + 1}-" if index else "") for name, shapes in drawn.items()}
        layers.append(moved_layers(named, *grid.origin(index)))
        nameless += [f"{dot} of marker {index + 1} on page {number}" for dot in artwork.nameless]
        notes += artwork.notes
    merged = {name: tuple(shape for each in layers for shape in each[name]) for name in layers[0]}
    markers = [figure.marker for figure in figures]
    alike = all(marker.control_points == markers[0].control_points for marker in markers)
    below, lengths = _footer(frame, markers, figures[0].factor, merged, " of each" if alike else " of the first")
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([merged, below]),
        tuple(grid.origin(index) for index in range(len(figures))),
        lengths,
        marker_name(markers[0]),
        f"{len(figures)} fiducial markers, page {number} of {pages}, at true size on {paper}. Print at 100 %.",
        (*nameless_note(nameless), *dict.fromkeys(notes)),
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
    lines = [f"{len(marker)} dots of {marker.dot_diameter * 1e3:.6g} mm, size {size_words(marker.boundary)}"]
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
