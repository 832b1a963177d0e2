"""Title block of a fabrication drawing (ISO 7200): three rows on the first sheet, one on the others.

Fields for which nothing is known, such as the date of issue, are empty, to be filled in by hand: nothing here reads a
clock, and the same input gives the same bytes.
"""
# tests: tests/workshop/drafting/test_rig_drawing.py tests/workshop/drafting/test_views.py

from collections.abc import Sequence

import markergen
from markergen.drawing.paper import AMERICAN, Frame, Paper
from markergen.drawing.scene import GRAY, Line, Shape, frame_lines
from markergen.drawing.text import text_width
from markergen.workshop.drafting.drawing import TitleBlock
from markergen.workshop.drafting.pen import LETTERS, THICK, THIN, lettering
from markergen.workshop.drafting.symbols import finish_symbol, projection_symbol

BLANK = 21.0
"""Minimum width of an empty field, mm on A4."""

OPTIONAL = (
    "language", "lengths in", "paper", "revision", "process", "document type", "approved by", "date of issue",
    "created by",
)  # fmt: skip
"""Fields that are left out of a row, one after the other, where paper is too narrow for all of it: those first that
ISO 7200 does not demand."""

ROWS = 3
"""Rows on the first sheet."""


def block_height(frame: Frame, first: bool) -> float:
    """Height of the title block of the first or a further sheet, mm."""
    return (ROWS if first else 1) * _row_height(frame)


def _row_height(frame: Frame) -> float:
    """Height of a row: two lines of letters with room around them."""
    return 2 * LETTERS + 4.9 * frame.scale


def first_angle(paper: Paper) -> bool:
    """True for first-angle projection, used with ISO paper; third-angle goes with American paper."""
    return paper.name.removesuffix("-landscape") not in {size.name for size in AMERICAN}


def drawing_title_block(
    block: TitleBlock, frame: Frame, scale: str, number: int, pages: int, first: bool
) -> list[Shape]:
    """Border, and the title block along its lower side: the whole one on a first sheet."""
    made_with = f"markergen {markergen.__version__}"
    paper = frame.paper.name.removesuffix("-landscape")
    sheet = f"{number} of {pages}"
    if not first:
        rows = [
            [("identification number", block.name), ("title", block.title), ("revision", ""), ("date of issue", ""),
             ("scale", "as given"), ("lengths in", "mm"), ("created by", made_with), ("sheet", sheet)],
        ]  # fmt: skip
    else:
        projection = "first angle" if first_angle(frame.paper) else "third angle"
        rows = [
            [("legal owner", ""), ("title", block.title), ("document type", "manufacturing drawing"),
             ("identification number", block.name), ("revision", ""), ("sheet", sheet)],
            [("created by", made_with), ("checked by", ""), ("approved by", ""), ("date of issue", ""),
             ("process", block.process), ("language", "en"), ("paper", paper), ("scale", scale), ("lengths in", "mm")],
            [("material", block.material), ("general tolerances", block.general), ("surface finish", block.finish),
             ("edges", block.edges), ("projection", projection)],
        ]  # fmt: skip
    shapes: list[Shape] = [frame_lines((frame.margin, frame.margin, frame.right, frame.top), THICK)]
    high = _row_height(frame)
    for index, cells in enumerate(reversed(rows)):
        low = frame.margin + index * high
        last = index == len(rows) - 1
        shapes.append(Line(((frame.margin, low + high), (frame.right, low + high)), THICK if last else THIN))
        shapes += _row(cells, frame, low)
    return shapes


def _row(cells: Sequence[tuple[str, str]], frame: Frame, low: float) -> list[Shape]:
    """Cells of a row that starts at a height, as wide as their words and with the spare room shared out."""
    scale, high = frame.scale, _row_height(frame)
    size, small, pad = max(2.0 * scale, LETTERS), LETTERS, 1.6 * scale

    def widths_of(cells: Sequence[tuple[str, str]], blank: float) -> list[float]:
        sizes = [
            max(text_width(head, small), text_width(value, size, _face(head)) + _symbol(head, value, size))
            for head, value in cells
        ]
        return [
            max(wide, 0.0 if value else blank * scale) + 2 * pad for wide, (_, value) in zip(sizes, cells, strict=True)
        ]

    blank = BLANK if sum(widths_of(cells, BLANK)) <= frame.width else BLANK / 2
    for name in OPTIONAL:
        if sum(widths_of(cells, blank)) > frame.width:
            cells = [cell for cell in cells if cell[0] != name]
    widths = widths_of(cells, blank)
    shrink = min(1.0, frame.width / sum(widths))
    spare = (frame.width - shrink * sum(widths)) / len(cells)
    left = frame.margin
    shapes: list[Shape] = []
    for (head, value), width in zip(cells, widths, strict=True):
        at, base = left + shrink * pad, low + 1.7 * scale
        shapes.append(lettering(head, at, low + high - small - 1.2 * scale, small * shrink, color=GRAY))
        if head == "projection":
            shapes += projection_symbol(at + 0.4 * scale, base - 0.4 * size, 1.3 * size * shrink, value.startswith("f"))
        elif head == "surface finish" and value.startswith("Ra"):
            shapes += finish_symbol(at + 0.7 * size * shrink, base, 0.7 * size * shrink)
        if value:
            start = at + shrink * _symbol(head, value, size)
            shapes.append(lettering(value, start, base, size * shrink, face=_face(head)))
        left += shrink * width + spare
        if left < frame.right - 0.1:
            shapes.append(Line(((left, low), (left, low + high)), THIN))
    return shapes


def _face(head: str) -> str:
    return "bold" if head == "identification number" else "regular"


def _symbol(head: str, value: str, size: float) -> float:
    """Width of the symbol before the words of a field."""
    return 6.0 * size if head == "projection" else 2.6 * size if value.startswith("Ra ") else 0.0
