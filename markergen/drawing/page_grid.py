"""Several markers on each page, in equal cells with a caption below each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor

from markergen.drawing.annotations import nameless_note, paragraph
from markergen.drawing.figure import Figure, compensated_note, dot_sizes, size_words
from markergen.drawing.marker_artwork import TICK, draw_artwork
from markergen.drawing.paper import Frame, SheetOptions
from markergen.drawing.print_measurements import far_pair, ruler_words
from markergen.drawing.scene import BLACK, Box, Point, Shape, Sheet, moved_layers, renamed, scene_of, union
from markergen.drawing.sheet_footer import draw_footer
from markergen.model.marker import Marker, marker_name

CAPTION, CAPTION_LINES = 1.7, 3
"""Cap height of captions in mm on A4, and their number of lines."""

GAP = 4.0
"""Gap between neighbors, mm on A4."""

BESIDE = 6.0
"""Width reserved for the ruler along y, mm on A4."""


def grid_pages(figures: Sequence[Figure], options: SheetOptions, frames: Sequence[Frame]) -> tuple[Sheet, ...]:
    """Sheets of several markers, all with the same grid; none if no page holds two.

    Of the frames, the one that holds more markers is taken.
    """
    best = max((_grid(figures, frame) for frame in frames), key=lambda grid: grid.count)
    if best.count < 2:
        return ()
    batches = [figures[start : start + best.count] for start in range(0, len(figures), best.count)]
    pages = [_grid_page(batch, best, options, (number, len(batches))) for number, batch in enumerate(batches, 1)]
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
    merged = {name: tuple(shape for each in layers for shape in each[name]) for name in layers[0]}
    markers = [figure.marker for figure in figures]
    alike = all(marker.control_points == markers[0].control_points for marker in markers)
    where = " of each" if alike else " of the first"
    below, lengths = draw_footer(frame, markers, figures[0].factor, merged, page, where)
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([merged, below]),
        tuple(grid.origin(index) for index in range(len(figures))),
        lengths,
        marker_name(markers[0]),
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
