"""Several markers on a page: as many as fit, each with its quiet zones and a caption, then the next page."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor

from markergen.drawing import checks
from markergen.drawing.face import draw_face
from markergen.drawing.figure import Figure, size_words, union
from markergen.drawing.furniture import TICK, Frame, paragraph
from markergen.drawing.options import SheetOptions
from markergen.drawing.page import Sheet, compensated_note, footer, moved_layers, nameless_note, scene_of
from markergen.drawing.scene import BLACK, Box, Point, Shape
from markergen.drawing.transform import renamed
from markergen.model.marker import Marker, marker_name

CAPTION, CAPTION_LINES = 1.7, 3
"""Height of a capital in captions in mm on A4, and their lines."""

GAP = 4.0
"""Between neighbors, mm on A4."""

BESIDE = 6.0
"""Width left for the ruler along y, mm on A4."""


def grid_pages(figures: Sequence[Figure], options: SheetOptions, frames: Sequence[Frame]) -> tuple[Sheet, ...]:
    """Sheets of several markers, all with the same grid; none if the first page that holds a marker holds only one.

    That is the first of the frames, but of one paper turned this way or that the one that holds more.
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
    pages = [_page(batch, best, options, number, len(batches)) for number, batch in enumerate(batches, 1)]
    return (replace(pages[0], notes=(*_notes(figures, best, pages), *pages[0].notes)), *pages[1:])


@dataclass(frozen=True)
class _Grid:
    """Equal cells on a page: the box around a marker's origin that each needs, mm, and how many there are."""

    frame: Frame
    cell: Box
    columns: int
    rows: int

    @property
    def count(self) -> int:
        return self.columns * self.rows

    @property
    def below(self) -> float:
        """Height of a caption, at the foot of the cell."""
        return 2 * CAPTION_LINES * CAPTION * self.frame.scale

    @property
    def room(self) -> Box:
        """The part of a cell above the caption."""
        return self.cell[0], self.cell[1] + self.below, self.cell[2], self.cell[3]

    def origin(self, index: int) -> Point:
        """Where the origin of a marker goes, cell by cell from the top left; what is left over is shared."""
        row, column = divmod(index, self.columns)
        left, bottom, right, top = _region(self.frame)
        step_x, step_y = (right - left) / self.columns, (top - bottom) / self.rows
        x = left + (column + 0.5) * step_x - (self.cell[0] + self.cell[2]) / 2
        return x, top - (row + 0.5) * step_y - (self.cell[1] + self.cell[3]) / 2


def _region(frame: Frame) -> Box:
    """Where cells may be: the ruler along y stands beside them."""
    left, bottom, right, top = frame.region
    return left + BESIDE * frame.scale, bottom, right, top


def _grid(figures: Sequence[Figure], frame: Frame) -> _Grid:
    scale = frame.scale
    # A number and a tick find room outside of the outline and of every quiet zone.
    pad = (TICK + 2) * scale
    left, bottom, right, top = union(*(union(figure.outline, figure.quiet) for figure in figures))
    width, height = right - left + 2 * pad, top - bottom + 2 * pad + 2 * CAPTION_LINES * CAPTION * scale
    cell = (left - pad, top + pad - height, right + pad, top + pad)
    region, gap = _region(frame), GAP * scale
    columns = floor((region[2] - region[0] + gap) / (width + gap))
    rows = floor((region[3] - region[1] + gap) / (height + gap))
    return _Grid(frame, cell, max(columns, 0), max(rows, 0))


def _page(figures: Sequence[Figure], grid: _Grid, options: SheetOptions, number: int, pages: int) -> Sheet:
    frame = grid.frame
    layers: list[dict[str, tuple[Shape, ...]]] = []
    nameless: list[str] = []
    for index, figure in enumerate(figures):
        face = draw_face(figure, options.colors, frame.scale, grid.room)
        drawn = {**face.layers, "text": (*face.layers["text"], *_caption(figure.marker, grid.room, frame.scale))}
        named = {name: renamed(shapes, f"marker-{index + 1}-" if index else "") for name, shapes in drawn.items()}
        layers.append(moved_layers(named, *grid.origin(index)))
        nameless += [f"{dot} of marker {index + 1} on page {number}" for dot in face.nameless]
    merged = {name: tuple(shape for each in layers for shape in each[name]) for name in layers[0]}
    markers = [figure.marker for figure in figures]
    alike = all(marker.control_points == markers[0].control_points for marker in markers)
    below, lengths = footer(frame, markers, figures[0].factor, merged, " of each" if alike else " of the first")
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([merged, below]),
        tuple(grid.origin(index) for index in range(len(figures))),
        lengths,
        marker_name(markers[0]),
        f"{len(figures)} fiducial markers, page {number} of {pages}, at true size on {paper}. Print at 100 %.",
        nameless_note(nameless),
        (0.0, 0.0, paper.width, paper.height),
    )


def _notes(figures: Sequence[Figure], grid: _Grid, pages: Sequence[Sheet]) -> tuple[str, ...]:
    where = f"one page of {grid.frame.paper}" if len(pages) == 1 else f"{len(pages)} pages of {grid.frame.paper}"
    most = f", up to {grid.count} on each" if len(pages) > 1 else ""
    return (
        f"{len(figures)} markers stand on {where}{most}.",
        f"Print at 100 %, then check that the rulers on each page measure {checks.ruler_words(pages[0].rulers_mm)}.",
        *compensated_note(figures[0]),
    )


def _caption(marker: Marker, room: Box, scale: float) -> list[Shape]:
    """Name, facts and lengths to measure, in lines below the room."""
    pairs = [pair for pair in (checks.far_pair(marker.control_points, axis) for axis in (0, 1)) if pair]
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
