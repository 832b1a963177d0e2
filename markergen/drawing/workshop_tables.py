"""What fills the further pages of a fabrication sheet: sections, tables and notes, in rows that flow in columns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from markergen.drawing.drafting import (
    CLOSE,
    THIN,
    WORDS,
    DrawingView,
    Style,
    across,
    center_line,
    cut_edges,
    drawn,
    scale_words,
)
from markergen.drawing.fabrication_drawing import DrawingTable, SectionView, ViewFace, around
from markergen.drawing.fabrication_views import SCALES, stacked
from markergen.drawing.scene import BLACK, GRAY, LIGHT, Line, Shape
from markergen.drawing.text import text, text_width, wrap


@dataclass(frozen=True)
class Row:
    """Something of a given height that is drawn from (left, top) on, in mm on paper."""

    height: float
    draw: Callable[[float, float], list[Shape]]


@dataclass(frozen=True)
class Block:
    """Rows that follow each other; where they go on in another column, the head is repeated.

    Attributes
    ----------
    head : tuple of Row
    rows : tuple of Row
    whole : bool
        Whether all of it has to stay in one column.
    """

    head: tuple[Row, ...]
    rows: tuple[Row, ...]
    whole: bool = False

    @property
    def height(self) -> float:
        """Height of the block in one piece, mm."""
        return sum(row.height for row in (*self.head, *self.rows))


def heading(words: str, style: Style) -> Row:
    """Title of a block."""
    size = 2.3 * style.scale
    return Row(2.4 * size, lambda x, y: [text(words, x, y - 1.4 * size, size, face="bold", name=f"heading-{words}")])


def paragraphs(title: str, sentences: Sequence[str], width: float, style: Style) -> Block:
    """Numbered notes."""
    size, indent = style.small, 5 * style.scale
    rows: list[Row] = []
    for number, sentence in enumerate(sentences, 1):
        for index, line in enumerate(wrap(sentence, width - indent, size)):
            mark = f"{number}." if not index else ""

            def draw(x: float, y: float, line: str = line, mark: str = mark) -> list[Shape]:
                shapes: list[Shape] = [text(line, x + indent, y - 1.5 * size, size, name=WORDS)]
                return [*shapes, text(mark, x, y - 1.5 * size, size, name=WORDS)] if mark else shapes

            rows.append(Row(1.85 * size, draw))
        rows.append(_gap(0.5 * size))
    return Block((heading(title, style),), tuple(rows))


def table_block(table: DrawingTable, width: float, style: Style) -> Block:
    """A table with lines between its rows; words that are too wide for their column are wrapped."""
    size, pad = style.small, 1.6 * style.scale
    columns = list(zip(table.headings, *table.rows, strict=True))
    widths = [max(text_width(cell, size) for cell in column) + 2 * pad for column in columns]
    if sum(widths) > width:
        # The widest column gives way, if it is of words.
        widest = max(table.left or range(len(widths)), key=lambda i: widths[i])
        widths[widest] = max(width - sum(widths) + widths[widest], 20 * style.scale)
    total = sum(widths)

    def row(cells: Sequence[str], head: bool) -> Row:
        lines = [
            wrap(cell, widths[i] - 2 * pad + 1e-6, size) if i in table.left else [cell] for i, cell in enumerate(cells)
        ]
        deep = max(map(len, lines))
        height = (1.85 * deep + 0.45) * size

        def draw(x: float, y: float) -> list[Shape]:
            shapes: list[Shape] = [
                Line(((x, y - height), (x + total, y - height)), THIN * (1.4 if head else 0.6), "", LIGHT)
            ]
            left = x
            for index, cell in enumerate(lines):
                for number, line in enumerate(cell):
                    at, align = (left + pad, "left") if index in table.left else (left + widths[index] - pad, "right")
                    base = y - (1.6 + 1.85 * number) * size
                    shapes.append(text(line, at, base, size, align, color=GRAY if head else BLACK, name=WORDS))
                left += widths[index]
            return shapes

        return Row(height, draw)

    rows = [row(cells, False) for cells in table.rows]
    return Block((heading(table.title, style), row(table.headings, True)), (*rows, _gap(2.2 * size)))


def section_block(section: SectionView, width: float, height: float, style: Style) -> Block:
    """A cut through the solid at the largest scale that the column holds."""
    left, bottom, right, top = section.box
    tier = CLOSE * style.scale
    beside, below = (0.8 + len(section.upright)) * tier, 0.8 * tier
    low = max(min(section_low(section), top), bottom)

    def lift(scale: float) -> float:
        # Words that stand beside short dimensions are not to meet those of the heights.
        narrow = any(text_width(span.words, style.words) > scale * (span.end - span.start) for span in section.across)
        return 1.5 * tier if narrow else 0.6 * tier

    def fits(scale: float, room: float) -> bool:
        tall = scale * (top - low) + lift(scale) + len(section.across) * tier + below
        return scale * (right - left) + beside + 0.5 * tier <= width and tall <= room

    # Small where that shows enough, with more room where it would be smaller than the solid.
    rooms = min(0.45 * height, 52 * style.scale), 0.7 * height
    scales = [next((each for each in SCALES[1:] if fits(each, room)), SCALES[-1]) for room in rooms]
    scale = scales[0] if scales[0] >= 1 else min(scales[1], 1.0)
    above = max(lift(scale) + len(section.across) * tier, 1.5 * tier)
    deep = scale * (top - low) + above + below

    def draw(x: float, y: float) -> list[Shape]:
        view = DrawingView(x + 0.3 * tier - scale * left, y - above - scale * top, scale)
        shapes: list[Shape] = []
        for face in section.faces:
            shapes += drawn(face, view, True, style)
        for face in section.faces:
            shapes += cut_edges(face, view, section.box)
        for axis in section.axes:
            ends = view.at((axis, low)), view.at((axis, top))
            over = 2 * style.scale
            shapes += center_line((ends[0][0], ends[0][1] - over), (ends[1][0], ends[1][1] + over), style)
        # The outer ones first, so that the words of the inner ones lie on their extension lines.
        for number, span in reversed(list(enumerate(section.across))):
            line = view.at((0.0, top))[1] + lift(scale) + number * tier
            start = [view.at((0.0, _highest(section.faces, at, top)))[1] for at in (span.start, span.end)]
            x0, x1 = (view.at((at, 0.0))[0] for at in (span.start, span.end))
            shapes += across(x0, x1, line, (start[0], start[1]), span.words, style)
        edge = view.at((right, 0.0))[0]
        return shapes + stacked(section.upright, view, edge, edge + 0.9 * tier, tier, style)

    titled = heading(f"{section.title}, {scale_words(scale)}", style)
    return Block((titled,), (Row(deep, draw),), whole=True)


def view_block(title: str, faces: tuple[ViewFace, ...], width: float, height: float, style: Style) -> Block:
    """A further view of the whole."""
    left, bottom, right, top = around(faces)
    room = min(0.6 * height, width)
    scale = next((s for s in SCALES if s * (right - left) <= width and s * (top - bottom) <= room), SCALES[-1])

    def draw(x: float, y: float) -> list[Shape]:
        view = DrawingView(x + 1 - scale * left, y - 1 - scale * top, scale)
        return [shape for face in faces for shape in drawn(face, view)]

    titled = heading(f"{title}, {scale_words(scale)}", style)
    return Block((titled,), (Row(scale * (top - bottom) + 6 * style.scale, draw),), whole=True)


def flow(blocks: Sequence[Block], columns: Sequence[tuple[float, float, float]]) -> list[list[Shape]]:
    """Pages of blocks in columns (left, top, bottom) that are the same on each page."""
    pages: list[list[Shape]] = [[]]
    column, (x, y, bottom) = 0, columns[0]
    fresh = True

    def further() -> None:
        nonlocal column, x, y, bottom, fresh
        column, fresh = column + 1, True
        if column == len(columns):
            column = 0
            pages.append([])
        x, y, bottom = columns[column]

    def put(rows: Sequence[Row]) -> None:
        nonlocal y, fresh
        for row in rows:
            pages[-1].extend(row.draw(x, y))
            y -= row.height
            fresh = False

    for block in blocks:
        first = block.height if block.whole else sum(row.height for row in (*block.head, *block.rows[:2]))
        if y - first < bottom and not fresh:
            further()
        put(block.head)
        for row in block.rows:
            if y - row.height < bottom - 1e-9 and not fresh:
                further()
                put(block.head)
            put([row])
        y -= 3.0
    return [page for page in pages if page]


def column_count(width: float, style: Style) -> int:
    """How many columns a page has: none is narrower than a table with six columns of numbers."""
    return max(int(width / (105 * style.scale)), 1)


def section_low(section: SectionView) -> float:
    """Lowest z of what is cut."""
    return min((face.box[1] for face in section.faces), default=section.box[1])


def _highest(faces: Sequence[ViewFace], at: float, top: float) -> float:
    """Where the extension line of a place along the cut begins: at the highest corner of the edge there."""
    found = [z for face in faces for ring in face.contours for s, z in ring.points if abs(s - at) < 1e-3]
    return max(found, default=top)


def _gap(height: float) -> Row:
    return Row(height, lambda _left, _top: [])
