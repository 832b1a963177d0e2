"""First page of a rig's drawing: six views of the whole around the main one, and a picture of it from a corner.

+-----------------------------------------------+
|            +-----+              ___           |
|            | -v  |             /__/|  picture |
|            +-----+             |  ||          |
|   +-----+  +-----+  +-----+  +-----+          |
|   | +u  |  | main|  | -u  |  |rear |          |
|   +-----+  +-----+  +-----+  +-----+          |
|            +-----+                            |
|            | +v  |  first-angle projection    |
|            +-----+                            |
+-----------------------------------------------+

In third-angle projection, on American paper, opposite views change places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from markergen.drawing.paper import LEAST_ROOM, Frame, SheetOptions
from markergen.drawing.scene import GRAY, Box, Line, Point, Shape
from markergen.drawing.text import text_width
from markergen.errors import InputError
from markergen.workshop.drafting.details import SCALES
from markergen.workshop.drafting.drawing import Control, DrawingTable, TitleBlock, ViewFace, around
from markergen.workshop.drafting.pen import (
    CLOSE,
    THIN,
    DrawingView,
    Style,
    across,
    arrow,
    center_line,
    drawn,
    lettering,
    on_white,
    upright,
)
from markergen.workshop.drafting.symbols import datum_letter, datum_reach, frame_width, tolerance_frame
from markergen.workshop.drafting.title_block import first_angle
from markergen.workshop.drafting.views import GOOD, FrontPage, drawing_area, papers_of

PLACES = {"main": (0, 0), "+u": (-1, 0), "-u": (1, 0), "+v": (0, -1), "-v": (0, 1), "rear": (2, 0)}
"""Column and row of each view in first-angle projection, by the direction that it is seen from in the main view."""

SMALLEST = 12.0
"""Minimum size in mm on paper of the largest view."""


@dataclass(frozen=True)
class FaceName:
    """Name of a face at a point of a view, its width there, and its tolerances and datum if it is seen straight on."""

    words: str
    at: Point
    width: float
    controls: tuple[Control, ...] = ()
    datum: str = ""


@dataclass(frozen=True)
class RigView:
    """A view of a rig, mm.

    Attributes
    ----------
    place : str
        Key of `PLACES`.
    words : str
        ``seen from -y``.
    faces : tuple of ViewFace
        The farthest first.
    axes : (str, str)
        Axes of the rig frame to the right and up.
    """

    place: str
    words: str
    faces: tuple[ViewFace, ...]
    names: tuple[FaceName, ...]
    axes: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class RigWork:
    """Content of the sheets of a whole rig: views, the picture from a corner, sizes in words, tables and notes.

    Attributes
    ----------
    sizes : (str, str, str)
        Overall size of the main view to the right and up, and its depth.
    """

    block: TitleBlock
    views: tuple[RigView, ...]
    picture: RigView
    sizes: tuple[str, str, str]
    tables: tuple[DrawingTable, ...]
    notes: tuple[str, ...]


def rig_page(work: RigWork, options: SheetOptions) -> FrontPage:
    """Draw the views on the first usual paper that shows them at 1 : 2 or more, or else at the largest scale.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    best: FrontPage | None = None
    papers = papers_of(options)
    for paper in papers:
        frame = options.frame(paper)
        if min(frame.width, frame.top - frame.margin) <= LEAST_ROOM:
            continue
        page = _page(work, frame)
        if page and (best is None or page.scale > best.scale):
            best = page
        if best and best.scale >= GOOD:
            break
    if best is None:
        raise InputError(
            "paper that the drawing of a rig fits on", ", ".join(map(str, papers)), "use --paper A3 or larger"
        )
    return best


def _page(work: RigWork, frame: Frame) -> FrontPage | None:
    """Draw at the largest scale that fits on a page; None if there is none."""
    room, style = drawing_area(frame), Style(frame.scale)
    left, bottom, right, top = room
    for scale in SCALES:
        columns, rows = _grid(work, scale, style, first_angle(frame.paper))
        wide, high = sum(columns.values()), sum(rows.values())
        if wide <= right - left and high <= top - bottom:
            return FrontPage(frame, scale, (0.0, 0.0), tuple(_draw(work, scale, style, room, columns, rows, frame)))
        boxes = [around(view.faces) for view in work.views]
        if max(scale * max(box[2] - box[0], box[3] - box[1]) for box in boxes) < SMALLEST:
            return None
    return None


def _place(view: RigView, first: bool) -> tuple[int, int]:
    column, row = PLACES[view.place]
    return (column, row) if first or column == 2 else (-column, -row)


def _head(view: RigView, style: Style) -> float:
    """Width of the words and the tolerance frames above a view."""
    own = max((_named(name, style) for name in view.names if name.controls), default=0.0)
    return max(own, text_width(view.words, 0.8 * style.words))


def _named(name: FaceName, style: Style) -> float:
    frames = sum(frame_width(each, style.words) + 1.5 * style.scale for each in name.controls)
    return text_width(f"{name.words}  ", style.words) + frames + datum_reach(style.words) * bool(name.datum)


def _grid(work: RigWork, scale: float, style: Style, first: bool) -> tuple[dict[int, float], dict[int, float]]:
    """Widths of the columns and heights of the rows that have views, with the annotations around these."""
    columns: dict[int, float] = {}
    rows: dict[int, float] = {}
    side, above = _air(style)
    for view in work.views:
        column, row = _place(view, first)
        left, bottom, right, top = around(view.faces)
        columns[column] = max(columns.get(column, 0.0), max(scale * (right - left), _head(view, style)) + side)
        rows[row] = max(rows.get(row, 0.0), scale * (top - bottom) + above)
    return columns, rows


def _air(style: Style) -> tuple[float, float]:
    """Room beside each view for sizes, and above and below it together."""
    return 14 * style.scale, 26 * style.scale


def _draw(
    work: RigWork,
    scale: float,
    style: Style,
    room: Box,
    columns: dict[int, float],
    rows: dict[int, float],
    frame: Frame,
) -> list[Shape]:
    shapes: list[Shape] = []
    left, bottom, right, top = room
    first = first_angle(frame.paper)
    spare = right - left - sum(columns.values()), top - bottom - sum(rows.values())
    gap = spare[0] / (len(columns) + 1), spare[1] / (len(rows) + 1)
    side, above = _air(style)
    starts, x = {}, left + gap[0]
    for column in sorted(columns):
        starts[column] = x
        x += columns[column] + gap[0]
    lows, y = {}, bottom + gap[1]
    for row in sorted(rows):
        lows[row] = y
        y += rows[row] + gap[1]
    for view in work.views:
        column, row = _place(view, first)
        box = around(view.faces)
        # Views of one row or column are aligned, by the frame of the rig.
        aside = max(columns[column] - side - scale * (box[2] - box[0]), 0) / 2 + side * 0.6
        own = DrawingView(starts[column] + aside - scale * box[0], lows[row] + above * 0.45 - scale * box[1], scale)
        shapes += _view(view, own, style)
        if view.place == "main":
            shapes += _sizes(work, own.box(box), style)
        elif view.place in ("+u", "-u") and not any(s.place == "+u" and view.place == "-u" for s in work.views):
            edges = own.box(box)
            below = edges[1] - 1.4 * CLOSE * style.scale
            shapes += across(edges[0], edges[2], below, edges[1], work.sizes[2], style)
    return [*shapes, *_picture(work, style, _corner(room, starts, columns, lows, rows, gap))]


def _corner(
    room: Box, starts: dict[int, float], columns: dict[int, float], lows: dict[int, float], rows: dict[int, float],
    gap: tuple[float, float],
) -> Box:  # fmt: skip
    """The room to the right of the main column, above the main row, or else below it."""
    left = starts[0] + columns[0] + gap[0]
    low = lows[0] + rows[0] + gap[1]
    if room[3] - low < 15:
        return (left, room[1], room[2], lows[0] - gap[1])
    return (left, low, room[2], room[3])


def _view(view: RigView, at: DrawingView, style: Style) -> list[Shape]:
    """One view with its names, tolerances and datums."""
    shapes = [shape for face in view.faces for shape in drawn(face, at)]
    left, _, right, top = at.box(around(view.faces))
    # Above the arrow of the upright axis.
    height, line = style.words, top + (7.5 if view.place == "main" else 2.2) * style.scale
    for name in view.names:
        if not name.controls:
            continue
        # Above the view, with a leader that ends in the face.
        wide = _named(name, style)
        x = (left + right - wide) / 2
        shapes += [lettering(name.words, x, line + 0.5 * height, height, face="bold", name=f"face-{name.words}")]
        x += text_width(f"{name.words}  ", height)
        foot = x + 1.5 * style.scale
        for control in name.controls:
            shapes += tolerance_frame(control, x, line + 0.5 * height, height)
            x += frame_width(control, height) + 1.5 * style.scale
        if name.datum:
            # On the frame: the datum is the face that it is about.
            end = x - 1.5 * style.scale
            shapes += datum_letter(name.datum, (end, line + height), (1.0, 0.0), height)
        inside = max(min(foot, right - 1.5 * style.scale), left + 1.5 * style.scale), top - 1.5 * style.scale
        shapes += [Line(((foot, line), inside), THIN), *_spot(inside, style)]
        line += 2.4 * height
    shapes += [lettering(view.words, (left + right) / 2, line + 0.2 * height, 0.8 * height, "center", color=GRAY)]
    shapes += _on_faces([name for name in view.names if not name.controls], at, style)
    if view.place == "main":
        shapes += _axes(view, at, style)
    return shapes


def _on_faces(names: Sequence[FaceName], at: DrawingView, style: Style) -> list[Shape]:
    """Names in the middle of faces that are wide enough for them."""
    shapes: list[Shape] = []
    for name in names:
        height = 0.8 * style.words
        if text_width(name.words, height, "bold") < at.scale * name.width:
            x, y = at.at(name.at)
            shapes += on_white(lettering(name.words, x, y - height / 2, height, "center", face="bold"))
    return shapes


def _spot(at: Point, style: Style) -> list[Shape]:
    """End of a leader within a face."""
    half = 0.35 * style.scale
    corners = ((at[0] - half, at[1]), (at[0], at[1] - half), (at[0] + half, at[1]), (at[0], at[1] + half))
    return [Line((*corners, corners[0]), 2 * THIN)]


def _axes(view: RigView, at: DrawingView, style: Style) -> list[Shape]:
    """Axes of the rig frame, whose positive ends have arrows."""
    left, bottom, right, top = at.box(around(view.faces))
    x, y = at.at((0.0, 0.0))
    over = 4.0 * style.scale
    ends = {"+": (right + over, top + over), "-": (left - over, bottom - over)}
    shapes: list[Shape] = [
        *center_line((min(left, x) - over, y), (max(right, x) + over, y), style),
        *center_line((x, min(bottom, y) - over), (x, max(top, y) + over), style),
    ]
    for k, axis in enumerate(view.axes):
        sign, name = ("-", axis[1:]) if axis.startswith("-") else ("+", axis)
        end = ends[sign][k]
        tip, way = ((end, y), (1.0, 0.0)) if k == 0 else ((x, end), (0.0, 1.0))
        if sign == "-":
            way = (-way[0], -way[1])
        shapes.append(arrow(tip, way, style))
        off = (way[0] * 1.6 * style.scale + way[1] * 1.8 * style.scale, way[1] * -0.2 * style.scale + abs(way[0]) * 1.2)
        shapes.append(lettering(name, tip[0] + off[0], tip[1] + off[1], style.words, "center", name=f"axis-{name}"))
    return shapes


def _sizes(work: RigWork, box: Box, style: Style) -> list[Shape]:
    """Overall width and height of the main view."""
    left, bottom, right, top = box
    off = 1.4 * CLOSE * style.scale
    return [
        *across(left, right, bottom - off, bottom, work.sizes[0], style),
        *upright(bottom, top, left - off, left, work.sizes[1], style),
    ]


def _picture(work: RigWork, style: Style, room: Box) -> list[Shape]:
    """The whole from a corner, as large as there is room, not to scale."""
    left, bottom, right, top = room
    box = around(work.picture.faces)
    words = 3.5 * style.scale
    scale = min((right - left) / (box[2] - box[0]), (top - bottom - words) / (box[3] - box[1])) * 0.86
    if scale * max(box[2] - box[0], box[3] - box[1]) < SMALLEST:
        return []
    x = (left + right - scale * (box[0] + box[2])) / 2
    view = DrawingView(x, bottom + words + (top - bottom - words - scale * (box[1] + box[3])) / 2, scale)
    shapes = [shape for face in work.picture.faces for shape in drawn(face, view)]
    shapes += _on_faces(work.picture.names, view, style)
    low = view.at((0.0, box[1]))[1]
    below = lettering(work.picture.words, (left + right) / 2, low - words, 0.8 * style.words, "center", color=GRAY)
    return [*shapes, below]
