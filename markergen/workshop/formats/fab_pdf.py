"""Fabrication sheet: a dimensioned drawing of the solid, then tables, sections and notes in columns.

The drawing is our own vector graphics; reportlab's flowables set tables and paragraphs, and `_packed` puts them into
columns. Words are text in embedded fonts, so that they can be searched and copied.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import product
from math import ceil
from typing import Any

from markergen.drawing.paper import Frame, Paper, SheetOptions
from markergen.drawing.scene import BLACK, GRAY, LIGHT, Box, Shape, bounds, union
from markergen.drawing.text import FACES, font_size, text_width, written
from markergen.errors import InputError
from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.pdf_canvas import POINTS_PER_MM, bare_canvas, draw_shape, page_size, pdf_color
from markergen.model.body_json import rig_name
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.workshop.assembly import MadeBody, made_of
from markergen.workshop.drafting.content import workpiece
from markergen.workshop.drafting.details import DetailView, back_crowded, back_view, key_view, section_view
from markergen.workshop.drafting.drawing import DrawingTable, TitleBlock, Workpiece
from markergen.workshop.drafting.pen import THIN, Lettering, Style, scale_words
from markergen.workshop.drafting.rig_drawing import RigWork, face_works, in_common, rig_page, rig_work
from markergen.workshop.drafting.title_block import drawing_title_block
from markergen.workshop.drafting.views import FrontPage, drawing_area, front_page, usual_papers
from markergen.workshop.formats.solids import solid_notes

HALF = 0.6
"""Part of its columns that a last page has to fill: at 0.5, a page of three columns still looks half empty."""

COLUMN = 125.0
"""Minimum column width in mm on A4: that of a table with six columns of numbers."""

GAP = 7.0
"""Gap between columns, mm on A4."""

SPACE = 5.0
"""Space between blocks in a column, mm on A4."""

DENSITIES = (1.4, 1.2, 1.1, 1.0, 0.93, 0.86, 0.8)
"""Sizes of text and sections to try, relative to the usual one, so that no page is nearly empty."""


def export_fab_pdf(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """Drawing to scale with dimensions, coordinates, parts, tolerances and notes; needs no CAD kernel.

    Of a rig, the drawing of the whole with the tolerances between its faces comes first, then that of each face.
    """
    body = only(bodies, ".fab.pdf").as_designed
    made = made_of(body, options.fabrication)
    if isinstance(body, Marker):
        data, notes = write_fabrication_sheet(workpiece(body, options.fabrication, made.made[0]), options.sheet)
    elif options.fabrication.datum or options.fabrication.hole:
        raise InputError("the drawing of a marker for --datum and --hole", "a rig", "draw its markers one by one")
    else:
        data, notes = _of_rig(body, made, options)
    return Output(data, (*notes, *solid_notes(body, made, options)))


def _of_rig(rig: Rig, made: MadeBody, options: ExportOptions) -> tuple[bytes, tuple[str, ...]]:
    works = face_works(rig, options.fabrication, made)
    # Faces of one body have most in common; plates are made one by one.
    whole = rig_work(rig, options.fabrication, made, *options.sheet.records[:1])
    faces = in_common(works, whole.notes) if made.block else None
    parts = [sheets_of_rig(whole, faces, options.sheet)]
    parts += [sheets_of(work, options.sheet, not faces) for work in works]
    name = rig_name(rig)
    data = write_sheets(parts, name, f"Fabrication sheets of a rig: {parts[0].block.title}.")
    pages = sum(len(sheets.pages) for sheets in parts)
    first = parts[0].front
    drawn = f"the first on {first.frame.paper}, drawn {scale_words(first.scale)}"
    return data, (f"The fabrication sheets have {pages} pages, {drawn}.",)


def write_fabrication_sheet(work: Workpiece, options: SheetOptions) -> tuple[bytes, tuple[str, ...]]:
    """Write the drawing on one page, and sections, tables and notes on as many as needed; also return a note on them.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    sheets = sheets_of(work, options)
    scale, paper = scale_words(sheets.front.scale), sheets.front.frame.paper
    about = f"Fabrication sheet: {work.block.title}, {scale} on {paper}."
    return (
        write_sheets([sheets], work.block.name, about),
        (f"The fabrication sheet has {len(sheets.pages)} pages on {paper}, drawn {scale}.",),
    )


@dataclass(frozen=True)
class Sheets:
    """Drawing with the blocks of its pages: on the first one beside the views, which then stand on its left.

    Attributes
    ----------
    moved : float
        How far the views are moved to the right, mm.
    """

    block: TitleBlock
    front: FrontPage
    pages: "list[_Page]"
    moved: float = 0.0


def sheets_of(work: Workpiece, options: SheetOptions, described: bool = True) -> Sheets:
    """Lay a drawing out on pages, with or without what describes it; raises as `write_fabrication_sheet` does."""
    _embed_fonts()
    front = front_page(work, options)
    return _sheets(work.block, front, lambda grid: _blocks(work, grid) if described else [], options)


def sheets_of_rig(work: RigWork, faces: Workpiece | None, options: SheetOptions) -> Sheets:
    """Lay out the drawing of a whole rig, with what its faces have in common; raises as `write_fabrication_sheet`."""
    _embed_fonts()
    front = rig_page(work, options)

    def blocks(grid: _Grid) -> list[_Item]:
        # The first table, of the faces, may be as wide as the page.
        tables = []
        for k, table in enumerate(work.tables):
            width = grid.span(1 if k else grid.count)
            for piece in _split(table, width, grid.height, grid.style):
                block = _measured(_table(piece, width, grid.style), width)
                span = ceil(grid.holds(block.width) - 1e-9)
                # Again, so that a title that is wider than these columns is broken.
                within = grid.span(span)
                tables.append(replace(_measured(_table(piece, within, grid.style), within), span=span))
        if faces is not None:
            return [*tables, *_blocks(faces, grid)]
        return [*tables, *_notes(work.notes, grid.width, grid.height, grid.style)]

    return _sheets(work.block, front, blocks, options)


def _sheets(block: TitleBlock, front: FrontPage, blocks: "Blocks", options: SheetOptions) -> Sheets:
    """Lay blocks out beside the views of the first page and on further ones."""
    area, ink, paper = drawing_area(front.frame), union(*map(bounds, front.shapes)), front.frame.paper
    moved = area[0] - ink[0]
    smaller = [size for size in usual_papers(options) if size.width * size.height < paper.width * paper.height]
    pages = _best_pages(blocks, front.frame, (ink[2] + moved, *area[1:]), smaller)
    return Sheets(block, front, pages, moved if pages[0].blocks else 0.0)


def write_sheets(parts: Sequence[Sheets], name: str, about: str) -> bytes:
    """Write drawings one after another into one PDF, with its title and subject."""
    buffer = BytesIO()
    canvas = bare_canvas(buffer, name, about)
    number, count = 0, sum(len(sheets.pages) for sheets in parts)
    for sheets in parts:
        scale = scale_words(sheets.front.scale)
        for k, page in enumerate(sheets.pages):
            number += 1
            size = page_size(page.frame.paper)
            canvas.setPageSize(size)
            canvas.setTrimBox([0.0, 0.0, *size])
            if k == 0:
                canvas.saveState()
                canvas.translate(*_points(sheets.moved, 0.0))
                _draw(canvas, sheets.front.shapes)
                canvas.restoreState()
            _draw(canvas, drawing_title_block(sheets.block, page.frame, scale, number, count, k == 0))
            for block, left, top in page.blocks:
                y = top
                for part, height, space in block.parts:
                    part.drawOn(canvas, *_points(left, y - height))
                    y -= height + space
            canvas.showPage()
    canvas.save()
    return buffer.getvalue()


@dataclass(frozen=True)
class _Item:
    """Flowables that stay together, with their heights and the spaces after them, their width, and columns to take."""

    parts: tuple[tuple[Any, float, float], ...]
    width: float
    span: int = 1

    @property
    def height(self) -> float:
        """Height of all, without the space after the last."""
        return sum(height + space for _, height, space in self.parts) - self.parts[-1][2]


@dataclass
class _Column:
    """Column of a page, with its ends, and how much of it is filled, mm."""

    left: float
    bottom: float
    top: float
    filled: float = 0.0


@dataclass(frozen=True)
class _Grid:
    """Columns of full pages: their number, width, height and gap, mm, and how many of them the back takes."""

    style: Style
    count: int
    width: float
    height: float
    gap: float
    back: int

    def span(self, count: int) -> float:
        """Width of columns side by side."""
        return count * (self.width + self.gap) - self.gap

    def holds(self, width: float) -> float:
        """How many columns side by side are that wide."""
        return (width + self.gap) / (self.width + self.gap)


class _Page:
    """Page with columns from the left end of a box on, as many as fit, and blocks in them; lengths in mm.

    Attributes
    ----------
    blocks : list of (item, left, top)
    """

    def __init__(self, frame: Frame, box: Box, grid: _Grid) -> None:
        self.frame, self.grid = frame, grid
        left, bottom, right, top = box
        starts = (left + grid.span(k) + grid.gap for k in range(int(grid.holds(right - left) + 1e-9)))
        self.columns = [_Column(start, bottom, top) for start in starts]
        self.blocks: list[tuple[_Item, float, float]] = []

    def takes(self, block: _Item) -> bool:
        """Put a block into the first columns side by side that have room for it."""
        runs = (self.columns[k : k + block.span] for k in range(len(self.columns) + 1 - block.span))
        run = next((run for run in runs if all(c.filled + block.height <= c.top - c.bottom for c in run)), None)
        if run:
            self.put(block, run)
        return run is not None

    def put(self, block: _Item, columns: Sequence[_Column]) -> None:
        """Put a block below what columns side by side have."""
        filled = max(column.filled for column in columns)
        self.blocks.append((block, columns[0].left, columns[0].top - filled))
        for column in columns:
            column.filled = filled + block.height + SPACE * self.grid.style.scale

    @property
    def filled(self) -> float:
        """Part of the page's columns that is filled."""
        return sum(column.filled / (column.top - column.bottom) for column in self.columns) / len(self.columns)

    def on(self, frame: Frame) -> "_Page | None":
        """The same blocks on another page; None if it has no room for them."""
        page = _Page(frame, drawing_area(frame, first=False), self.grid)
        return page if all(page.takes(block) for block, *_ in self.blocks) else None


Blocks = Callable[[_Grid], list[_Item]]
"""Makes blocks for columns."""


def _best_pages(blocks: Blocks, frame: Frame, beside: Box, papers: Sequence[Paper]) -> list[_Page]:
    """As few pages as possible, at the largest size of text and sections for these.

    Lest the last one be half empty, it is on the first smaller paper that holds it, or the back takes two columns.
    """
    trials = [(density, _pages(blocks, frame, beside, density)) for density in DENSITIES]
    fewest = min(len(pages) for _, pages in trials)
    best = [(density, pages) for density, pages in trials if len(pages) == fewest]
    for _, pages in best:
        if fewest == 1 or pages[-1].filled > HALF:
            return pages
    for (_, pages), paper in product(best, papers):
        last = pages[-1].on(replace(frame, paper=paper))
        if last:
            return [*pages[:-1], last]
    wide = (_pages(blocks, frame, beside, density, 2) for density, _ in best)
    return next((pages for pages in wide if len(pages) == fewest), best[0][1])


def _pages(blocks: Blocks, frame: Frame, beside: Box, density: float, back: int = 1) -> list[_Page]:
    """Pages with everything; the first one has the columns that there is room for `beside`."""
    left, bottom, right, top = area = drawing_area(frame, first=False)
    style = Style(frame.scale * density)
    gap = GAP * style.scale
    count = max(int((right - left) / (COLUMN * frame.scale * min(density, 1.0))), 1)
    grid = _Grid(style, count, (right - left + gap) / count - gap, top - bottom, gap, min(back, count))
    first = int((beside[2] - beside[0]) / (grid.width + gap))
    pages = [_Page(frame, (beside[2] - grid.span(first), *beside[1:]), grid)]
    for block in blocks(grid):
        if not any(page.takes(block) for page in pages):
            pages.append(_Page(frame, area, grid))
            pages[-1].put(block, pages[-1].columns[: block.span])
    return pages


def _blocks(work: Workpiece, grid: _Grid) -> list[_Item]:
    """Tables, sections, notes, key and back for columns."""
    style, width, height = grid.style, grid.width, grid.height
    pieces = [_split(table, width, height, style) for table in work.tables]
    groups = [[_measured(_table(piece, width, style), width) for piece in group] for group in pieces]
    # Several faces have a table of dots each.
    count = sum(table.headings == work.tables[0].headings for table in work.tables)
    dots, tables = [table for group in groups[:count] for table in group], groups[count:]
    sections = [_detail(section_view(section, width, height, style), width, style) for section in work.sections]
    back = []
    if work.back:
        span = min(2, grid.count) if back_crowded(work, width, height) else grid.back
        wide = grid.span(span)
        back.append(replace(_detail(back_view(work, wide, height), wide, style), span=span))
    key = _detail(key_view(work, width, style), width, style)
    notes = _notes(work.notes, width, height, style)
    return [*dots, *sections, *(table for group in tables for table in group), *notes, key, *back]


def _measured(flowables: Sequence[Any], width: float) -> _Item:
    """Flowables as a block for a column of a width in mm."""
    sizes = [flowable.wrap(*_points(width, 1e4)) for flowable in flowables]
    heights = (high / POINTS_PER_MM for _, high in sizes)
    spaces = (flowable.getSpaceAfter() / POINTS_PER_MM for flowable in flowables)
    return _Item(tuple(zip(flowables, heights, spaces, strict=True)), max(wide for wide, _ in sizes) / POINTS_PER_MM)


def _split(table: DrawingTable, width: float, height: float, style: Style) -> list[DrawingTable]:
    """The table, or even pieces of one that is too long for a column, each with a title of its own."""
    whole = _measured(_table(table, width, style), width).height
    if whole <= height:
        return [table]
    first_row = _measured(_table(replace(table, rows=table.rows[:1]), width, style), width).height
    row = (whole - first_row) / (len(table.rows) - 1)
    most = max(int((height - first_row) / row), 1)
    count = ceil(len(table.rows) / most)
    size = ceil(len(table.rows) / count)
    return [
        replace(
            table,
            title=f"{table.title} ({number} of {count})",
            rows=table.rows[(number - 1) * size : number * size],
        )
        for number in range(1, count + 1)
    ]


def _table(table: DrawingTable, width: float, style: Style) -> list[Any]:
    """Table with its title and headings."""
    from reportlab.platypus import Paragraph, Table

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
    heading: Any = written(table.title, "bold")
    if text_width(heading, title, "bold") > width:
        heading = Paragraph(_escaped(table.title), _paragraph_style("heading", style))
    flowing = Table(
        [[heading, *[""] * (len(widths) - 1)], list(map(written, table.headings)), *rows],
        colWidths=_points(*widths),
        hAlign="LEFT",
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
        ],
    )
    return [flowing]


def _detail(view: DetailView, width: float, style: Style) -> _Item:
    """View with its title."""
    from reportlab.platypus import Flowable, Paragraph

    class Detail(Flowable):  # type: ignore[misc]  # reportlab has no types
        def wrap(self, *_: float) -> tuple[float, ...]:
            return _points(view.width, view.height)

        def draw(self) -> None:
            _draw(self.canv, view.shapes)

    return _measured([Paragraph(_escaped(view.title), _paragraph_style("heading", style)), Detail()], width)


def _notes(sentences: Sequence[str], width: float, height: float, style: Style) -> list[_Item]:
    """Numbered notes under their title; in two blocks if they are too long for one column."""
    from reportlab.platypus import Paragraph

    if not sentences:
        return []
    kind, heading = (_paragraph_style(name, style) for name in ("note", "heading"))
    notes = [Paragraph(_escaped(note), kind, bulletText=f"{number}.") for number, note in enumerate(sentences, 1)]
    whole = _measured([Paragraph("Notes", heading), *notes], width)
    if whole.height <= height:
        return [whole]
    half = len(notes) // 2
    return [
        _measured([Paragraph("Notes", heading), *notes[:half]], width),
        _measured([Paragraph("Notes, continued", heading), *notes[half:]], width),
    ]


def _draw(canvas: Any, shapes: Sequence[Shape]) -> None:
    """Paint shapes, and write words as text."""
    for shape in shapes:
        if not isinstance(shape, Lettering):
            draw_shape(canvas, shape)
            continue
        text_object = canvas.beginText()
        text_object.setFont(_font(shape.face), *_points(font_size(shape.height, shape.face)))
        text_object.setFillColor(pdf_color(shape.color))
        text_object.setTextTransform(*((0, 1, -1, 0) if shape.upright else (1, 0, 0, 1)), *_points(*shape.start))
        text_object.textOut(written(shape.text, shape.face))
        canvas.drawText(text_object)


def _paragraph_style(kind: str, style: Style) -> Any:
    """Style of a ``heading``, of a numbered ``note``, or of a table's ``cell`` whose words wrap."""
    from reportlab.lib.styles import ParagraphStyle

    size, face, line, after = (style.small, "regular", 1.85, 0.5)
    if kind == "heading":
        size, face, line, after = (_heading_size(style), "bold", 1.5, 0.9)
    type_size, leading, indent, space = _points(font_size(size, face), line * size, 5 * style.scale, after * size)
    return ParagraphStyle(
        kind,
        fontName=_font(face),
        fontSize=type_size,
        leading=leading,
        textColor=pdf_color(BLACK),
        leftIndent=indent if kind == "note" else 0,
        spaceAfter=space,
        allowWidows=0,
        allowOrphans=0,
        bulletFontName=_font(face),
        bulletFontSize=type_size,
    )


def _heading_size(style: Style) -> float:
    return max(2.3 * style.scale, 1.2 * style.small)


def _font(face: str) -> str:
    return FACES[face].removesuffix(".ttf")


def _embed_fonts() -> None:
    """Register the faces of sheet lettering with reportlab, which embeds the used glyphs."""
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont

    for face, file in FACES.items():
        if _font(face) not in pdfmetrics.getRegisteredFontNames():
            pdfmetrics.registerFont(TTFont(_font(face), file))


def _escaped(content: str) -> str:
    from xml.sax.saxutils import escape

    return escape(written(content))


def _points(*lengths: float) -> tuple[float, ...]:
    """Convert lengths in mm to points."""
    return tuple(POINTS_PER_MM * length for length in lengths)
