"""Fabrication sheet: a dimensioned drawing of the solid, then tables, sections and notes in flowing columns.

The drawing is our own vector graphics; reportlab's platypus lays out everything else across pages. Words are text in
embedded fonts, so that they can be searched and copied.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import markergen
from markergen.drawing.drafting import THICK, THIN, Lettering, Style, frame_lines, lettering, scale_words
from markergen.drawing.fabrication_drawing import DrawingTable, Workpiece
from markergen.drawing.fabrication_views import (
    BLOCK,
    DetailView,
    FrontPage,
    back_view,
    drawing_area,
    front_page,
    section_view,
)
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import BLACK, GRAY, LIGHT, Line, Shape
from markergen.drawing.text import FACES, font_size, text_width, written
from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.pdf_canvas import POINTS_PER_MM, bare_canvas, draw_shape, metadata, page_size, pdf_color
from markergen.exporters.solids import solid_notes
from markergen.model.marker import Marker
from markergen.solid.fabrication_content import workpiece
from markergen.solid.processes import parts_of

COLUMN = 105.0
"""Minimum column width in mm on A4: that of a table with six columns of numbers."""

GAP = 7.0
"""Gap between columns, mm on A4."""

SHORT = 12
"""Maximum rows of a table that is kept in one piece; a longer one is split with at least two rows on either side."""


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Drawing to scale with dimensions, coordinates, parts, tolerances and notes; needs no CAD kernel."""
    marker = only(markers, ".fab.pdf").as_designed
    made = parts_of(marker, options.fabrication)
    data, notes = write_fabrication_sheet(workpiece(marker, options.fabrication, made), options.sheet)
    return Output(data, (*notes, *solid_notes(marker, made, options)))


def write_fabrication_sheet(work: Workpiece, options: SheetOptions) -> tuple[bytes, tuple[str, ...]]:
    """Write the drawing on one page, and sections, tables and notes on as many as needed; also return a note on them.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    front = front_page(work, options)
    # Laid out twice: each page states the total number of pages.
    _, count = _build(work, front, 0)
    data, count = _build(work, front, count)
    paper, scale = front.frame.paper, scale_words(front.scale)
    return data, (f"The fabrication sheet has {count} pages on {paper}, drawn {scale}.",)


def _build(work: Workpiece, front: FrontPage, pages: int) -> tuple[bytes, int]:
    """Document as bytes, and its number of pages; `pages` is that number for the title blocks, or 0 to draw nothing."""
    from reportlab.platypus import BaseDocTemplate, Frame, NextPageTemplate, PageBreak, PageTemplate

    _embed_fonts()
    frame, style = front.frame, Style(front.frame.scale)
    buffer = BytesIO()
    about = f"Fabrication sheet: {work.title}, {scale_words(front.scale)} on {frame.paper}."
    document = BaseDocTemplate(
        buffer, pagesize=page_size(frame.paper), pageCompression=1, invariant=1, **metadata(work.name, about)
    )

    def begin(canvas: Any, document: Any) -> None:
        canvas.setTrimBox([0.0, 0.0, *page_size(frame.paper)])
        if pages:
            _draw(canvas, front.shapes if document.page == 1 else ())
            _draw(canvas, _title_block(work, front, document.page, pages))

    left, bottom, right, top = drawing_area(frame)
    count = max(int((right - left) / (COLUMN * frame.scale)), 1)
    gap = GAP * frame.scale
    width = (right - left - (count - 1) * gap) / count
    columns = [
        Frame(*_points(left + index * (width + gap), bottom, width, top - bottom), 0, 0, 0, 0, id=f"column-{index}")
        for index in range(count)
    ]
    document.addPageTemplates(
        [PageTemplate("front", columns[:1], onPage=begin), PageTemplate("further", columns, onPage=begin)]
    )
    story = _story(work, width, top - bottom, style)
    document.build([NextPageTemplate("further"), PageBreak(), *story], canvasmaker=bare_canvas)
    return buffer.getvalue(), document.page


def _story(work: Workpiece, width: float, height: float, style: Style) -> list[Any]:
    """Flowables for columns of the given width and height in mm."""
    tables = [_table(table, width, style) for table in work.tables]
    sections = [_detail(section_view(section, width, height, style), style) for section in work.sections]
    notes = _notes(work.notes, style)
    back = [_detail(back_view(work, width, height), style)] if work.back else []
    return [*tables[:2], *sections, *tables[2:], *notes, *back]


def _table(table: DrawingTable, width: float, style: Style) -> Any:
    """Table with its title and headings, which are repeated wherever it continues."""
    from reportlab.platypus import KeepTogether, Paragraph, Table

    size, pad = style.small, 1.6 * style.scale
    columns = list(zip(table.headings, *table.rows, strict=True))
    widths = [max(text_width(written(cell), size) for cell in column) + 2 * pad for column in columns]
    rows: list[list[Any]] = [[written(cell) for cell in row] for row in table.rows]
    if sum(widths) > width:
        # The widest column shrinks, among those of words if there are any.
        widest = max(table.left or range(len(widths)), key=lambda i: widths[i])
        widths[widest] = max(width - sum(widths) + widths[widest], 20 * style.scale)
        if widest in table.left:
            for row in rows:
                row[widest] = Paragraph(_escaped(row[widest]), _paragraph_style("cell", style))
    title = _heading_size(style)
    (indent,) = _points(pad)
    flowing = Table(
        [[written(table.title, "bold"), *[""] * (len(widths) - 1)], list(map(written, table.headings)), *rows],
        colWidths=_points(*widths),
        repeatRows=2,
        hAlign="LEFT",
        spaceAfter=_points(2.2 * size + 3)[0],
        style=[
            ("SPAN", (0, 0), (-1, 0)),
            ("FONT", (0, 0), (-1, 0), _font("bold"), *_points(font_size(title, "bold"), 1.2 * title)),
            ("LEFTPADDING", (0, 0), (-1, 0), 0),
            ("FONT", (0, 1), (-1, -1), _font("regular"), *_points(font_size(size), 1.6 * size)),
            ("TEXTCOLOR", (0, 1), (-1, 1), pdf_color(GRAY)),
            ("LEFTPADDING", (0, 1), (-1, -1), indent),
            ("RIGHTPADDING", (0, 0), (-1, -1), indent),
            ("TOPPADDING", (0, 0), (-1, -1), *_points(0.3 * size)),
            ("BOTTOMPADDING", (0, 0), (-1, -1), *_points(0.4 * size)),
            ("BOTTOMPADDING", (0, 0), (-1, 0), *_points(0.5 * title)),
            ("ALIGN", (0, 1), (-1, -1), "RIGHT"),
            *(("ALIGN", (column, 1), (column, -1), "LEFT") for column in table.left),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
            ("LINEBELOW", (0, 1), (-1, 1), *_points(1.4 * THIN), pdf_color(LIGHT)),
            ("LINEBELOW", (0, 2), (-1, -1), *_points(0.6 * THIN), pdf_color(LIGHT)),
            ("NOSPLIT", (0, 0), (0, 3)),
            ("NOSPLIT", (0, -2), (0, -1)),
        ],
    )
    return KeepTogether([flowing]) if len(rows) <= SHORT else flowing


def _detail(view: DetailView, style: Style) -> Any:
    """View with its title, in one piece."""
    from reportlab.platypus import Flowable, KeepTogether, Paragraph

    class Detail(Flowable):  # type: ignore[misc]  # reportlab has no types
        spaceAfter = _points(4 * style.scale)[0]

        def wrap(self, *_: float) -> tuple[float, ...]:
            return _points(view.width, view.height)

        def draw(self) -> None:
            _draw(self.canv, view.shapes)

    title = Paragraph(_escaped(view.title), _paragraph_style("heading", style))
    return KeepTogether([title, Detail()])


def _notes(sentences: Sequence[str], style: Style) -> list[Any]:
    """Numbered notes under their title, which stays with the first."""
    from reportlab.platypus import Paragraph

    if not sentences:
        return []
    kind = _paragraph_style("note", style)
    notes = [Paragraph(_escaped(words), kind, bulletText=f"{number}.") for number, words in enumerate(sentences, 1)]
    return [Paragraph("Notes", _paragraph_style("heading", style)), *notes]


def _title_block(work: Workpiece, front: FrontPage, number: int, pages: int) -> list[Shape]:
    """Border, and the title block along its lower side."""
    frame, scale = front.frame, front.frame.scale
    high = frame.margin + BLOCK * scale
    shapes: list[Shape] = [
        frame_lines((frame.margin, frame.margin, frame.right, frame.top), THICK),
        Line(((frame.margin, high), (frame.right, high)), THICK),
    ]
    cells = [
        ("name", work.name, "bold"),
        ("what", work.title, "regular"),
        ("process", work.process, "regular"),
        ("materials", work.materials, "regular"),
        ("scale", scale_words(front.scale) if number == 1 else "as given", "regular"),
        ("lengths in", "mm", "regular"),
        ("paper", frame.paper.name.removesuffix("-landscape"), "regular"),
        ("page", f"{number} of {pages}", "regular"),
        ("made with", f"markergen {markergen.__version__}", "regular"),
    ]
    size, small, pad = 2.0 * scale, 1.3 * scale, 1.8 * scale
    widths = [max(text_width(head, small), text_width(value, size, face)) + 2 * pad for head, value, face in cells]
    shrink = min(1.0, frame.width / sum(widths))
    spare = (frame.width - shrink * sum(widths)) / len(cells)
    left = frame.margin
    for (head, value, face), width in zip(cells, widths, strict=True):
        at = left + shrink * pad
        shapes.append(lettering(head, at, high - 3.2 * scale, small * shrink, color=GRAY))
        shapes.append(lettering(value, at, frame.margin + 3.2 * scale, size * shrink, face=face))
        left += shrink * width + spare
        if left < frame.right - 0.1:
            shapes.append(Line(((left, frame.margin), (left, high)), THIN))
    return shapes


def _draw(canvas: Any, shapes: Sequence[Shape]) -> None:
    """Paint shapes, and write words as text."""
    for shape in shapes:
        if not isinstance(shape, Lettering):
            draw_shape(canvas, shape)
            continue
        words = canvas.beginText()
        words.setFont(_font(shape.face), *_points(font_size(shape.height, shape.face)))
        words.setFillColor(pdf_color(shape.color))
        words.setTextTransform(*((0, 1, -1, 0) if shape.upright else (1, 0, 0, 1)), *_points(*shape.start))
        words.textOut(written(shape.words, shape.face))
        canvas.drawText(words)


def _paragraph_style(kind: str, style: Style) -> Any:
    """Style of a ``heading``, of a numbered ``note``, or of a table's ``cell`` whose words wrap."""
    from reportlab.lib.styles import ParagraphStyle

    if kind == "heading":
        size = _heading_size(style)
        type_size, leading, space = _points(font_size(size, "bold"), 1.5 * size, 0.9 * size)
        return ParagraphStyle(
            kind,
            fontName=_font("bold"),
            fontSize=type_size,
            leading=leading,
            spaceBefore=2 * space,
            spaceAfter=space,
            keepWithNext=1,
        )
    size = style.small
    type_size, leading, indent, after = _points(font_size(size), 1.85 * size, 5 * style.scale, 0.5 * size)
    return ParagraphStyle(
        kind,
        fontName=_font("regular"),
        fontSize=type_size,
        leading=leading,
        textColor=pdf_color(BLACK),
        leftIndent=indent if kind == "note" else 0,
        spaceAfter=after,
        allowWidows=0,
        allowOrphans=0,
        bulletFontName=_font("regular"),
        bulletFontSize=type_size,
    )


def _heading_size(style: Style) -> float:
    return 2.3 * style.scale


def _font(face: str) -> str:
    return FACES[face].removesuffix(".ttf")


def _embed_fonts() -> None:
    """Register the faces of sheet lettering with reportlab, which embeds the used glyphs."""
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont

    for face, file in FACES.items():
        if _font(face) not in pdfmetrics.getRegisteredFontNames():
            pdfmetrics.registerFont(TTFont(_font(face), file))


def _escaped(words: str) -> str:
    from xml.sax.saxutils import escape

    return escape(written(words))


def _points(*lengths: float) -> tuple[float, ...]:
    """Convert lengths in mm to points."""
    return tuple(POINTS_PER_MM * length for length in lengths)
