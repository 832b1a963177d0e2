"""Fabrication sheets: the pages of a dimensioned drawing, each with a border and a title block."""

from collections.abc import Sequence

import markergen
from markergen.drawing.drafting import THICK, THIN, Style, frame_lines, scale_words
from markergen.drawing.fabrication_drawing import Workpiece
from markergen.drawing.fabrication_views import ViewPlacement, draw_front, lay_out
from markergen.drawing.paper import LEAST_ROOM, PAPERS, Frame, Paper, SheetOptions, find_paper, oriented
from markergen.drawing.scene import GRAY, Box, Layer, Line, Scene, Shape, Sheet
from markergen.drawing.text import text, text_width
from markergen.drawing.workshop_tables import (
    Block,
    column_count,
    flow,
    paragraphs,
    section_block,
    table_block,
    view_block,
)
from markergen.errors import InputError

USUAL = ("a4-landscape", "a4", "a3-landscape", "a3")
"""Papers that are tried where none is named, in this order."""

GOOD = 0.5
"""Scale from which on no larger paper is tried."""

BLOCK = 12.0
"""Height of the title block, mm on A4."""


def fabrication_sheets(work: Workpiece, options: SheetOptions) -> tuple[Sheet, ...]:
    """Lay out the drawing on one page, and sections, tables and notes on as many more as they need.

    Without a paper named it is A4, or A3 where that allows a larger scale than 1 : 2 or less.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    frame, layout = _page(work, options)
    style = Style(frame.scale)
    room = _room(frame)
    front = draw_front(work, layout, frame)
    left, bottom, right, top = room
    count = column_count(right - left, style)
    gap = 7 * frame.scale
    width = (right - left - (count - 1) * gap) / count
    columns = [(left + index * (width + gap), top, bottom) for index in range(count)]
    pages = [front, *flow(_blocks(work, width, top - bottom, style), columns)]
    return tuple(_sheet(work, frame, layout, shapes, number, len(pages)) for number, shapes in enumerate(pages, 1))


def _page(work: Workpiece, options: SheetOptions) -> tuple[Frame, ViewPlacement]:
    """Paper and the layout of the drawing on it."""
    best: tuple[Frame, ViewPlacement] | None = None
    papers = _papers(options)
    for paper in papers:
        frame = options.frame(paper)
        layout = lay_out(work, frame, _room(frame)) if min(frame.width, frame.top - frame.margin) > LEAST_ROOM else None
        if layout and (best is None or layout.scale > best[1].scale):
            best = frame, layout
        if best and best[1].scale >= GOOD:
            break
    if best is None:
        raise InputError(
            "paper that a fabrication sheet fits on", ", ".join(map(str, papers)), "use --paper A4 or larger"
        )
    return best


def _papers(options: SheetOptions) -> list[Paper]:
    if options.paper is not None:
        paper = find_paper(options.paper, options.orientation)
        fixed = options.orientation or oriented(options.paper)
        return [paper] if fixed else [paper.turned, paper]
    papers = [PAPERS[name] for name in USUAL]
    if options.orientation:
        papers = [each for each in papers if (each.width > each.height) == (options.orientation == "landscape")]
    return papers


def _room(frame: Frame) -> Box:
    """Inside of the border, above the title block."""
    air = 3 * frame.scale
    return frame.margin + air, frame.margin + BLOCK * frame.scale + air, frame.right - air, frame.top - air


def _blocks(work: Workpiece, width: float, height: float, style: Style) -> list[Block]:
    blocks = [section_block(section, width, height, style) for section in work.sections]
    tables = [table_block(table, width, style) for table in work.tables]
    notes = [paragraphs("Notes", work.notes, width, style)] if work.notes else []
    back = [view_block("Seen from the back", work.back, width, height, style)] if work.back else []
    return [*tables[:2], *blocks, *tables[2:], *notes, *back]


def _sheet(
    work: Workpiece, frame: Frame, layout: ViewPlacement, shapes: Sequence[Shape], number: int, of: int
) -> Sheet:
    border, words = _block(work, frame, layout, number, of)
    marks = tuple(shape for shape in shapes if not shape.name)
    texts = tuple(shape for shape in shapes if shape.name)
    paper = frame.paper
    origins = ((layout.front.x, layout.front.y),) if number == 1 else ()
    return Sheet(
        paper,
        Scene((Layer("drawing", (*marks, *border)), Layer("text", (*texts, *words)))),
        origins,
        (0, 0),
        work.name,
        f"Fabrication sheet: {work.title}, {scale_words(layout.scale)} on {paper}.",
        (f"The fabrication sheet has {of} pages on {paper}, drawn {scale_words(layout.scale)}.",),
        (0.0, 0.0, paper.width, paper.height),
    )


def _block(
    work: Workpiece, frame: Frame, layout: ViewPlacement, number: int, of: int
) -> tuple[list[Shape], list[Shape]]:
    """Border, and the title block along its lower side."""
    scale = frame.scale
    high = frame.margin + BLOCK * scale
    marks: list[Shape] = [
        frame_lines((frame.margin, frame.margin, frame.right, frame.top), THICK),
        Line(((frame.margin, high), (frame.right, high)), THICK),
    ]
    cells = [
        ("name", work.name, "bold"),
        ("what", work.title, "regular"),
        ("process", work.process, "regular"),
        ("materials", work.materials, "regular"),
        ("scale", scale_words(layout.scale) if number == 1 else "as given", "regular"),
        ("lengths in", "mm", "regular"),
        ("paper", frame.paper.name.removesuffix("-landscape"), "regular"),
        ("page", f"{number} of {of}", "regular"),
        ("made with", f"markergen {markergen.__version__}", "regular"),
    ]
    size, small, pad = 2.0 * scale, 1.3 * scale, 1.8 * scale
    widths = [max(text_width(head, small), text_width(value, size, face)) + 2 * pad for head, value, face in cells]
    shrink = min(1.0, frame.width / sum(widths))
    spare = (frame.width - shrink * sum(widths)) / len(cells)
    texts: list[Shape] = []
    left = frame.margin
    for (head, value, face), width in zip(cells, widths, strict=True):
        at = left + shrink * pad
        texts.append(text(head, at, high - 3.2 * scale, small * shrink, color=GRAY, name=f"title-{head}-heading"))
        texts.append(text(value, at, frame.margin + 3.2 * scale, size * shrink, face=face, name=f"title-{head}"))
        left += shrink * width + spare
        if left < frame.right - 0.1:
            marks.append(Line(((left, frame.margin), (left, high)), THIN))
    return marks, texts
