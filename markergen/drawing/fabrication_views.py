"""Views of a fabrication drawing on paper: front and side with dimensions and callouts, back, and sections.

+------------------------------------------+
|      y                                   |
|   +-----+-----+                          |
|   |  1  |  0  |--  dimensions,           |
|  -|- - -+- - -|- x callouts on the right |
|   |  2  |  3  |                          |
|   +-----+-----+                          |
|   =============  side view               |
|   |<- size  ->|                          |
+------------------------------------------+
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.drafting import (
    CLOSE,
    DARK,
    DrawingView,
    Style,
    across,
    arrow,
    center_circle,
    center_line,
    cut_edges,
    drawn,
    inside,
    lettering,
    on_white,
    place_callouts,
    scale_words,
    upright,
)
from markergen.drawing.fabrication_drawing import (
    Dimension,
    DotLabel,
    SectionView,
    ViewFace,
    Workpiece,
    around,
    millimeters,
)
from markergen.drawing.label_placement import place_numbers
from markergen.drawing.paper import LEAST_ROOM, PAPERS, Frame, Paper, SheetOptions, find_paper, oriented
from markergen.drawing.scene import GRAY, WHITE, Box, Disk, Point, Shape, bounds, union
from markergen.drawing.text import text_width
from markergen.errors import InputError
from markergen.geometry.contour import flattened

Array = NDArray[np.float64]

SCALES = (10, 5, 2, 1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200)
"""Available scales (ISO 5455)."""

LEAST_VIEW = 20.0
"""Minimum size in mm on paper of the front view, below which no detail is visible."""

NEAR = 0.05
"""Maximum distance in mm from an arc, sufficient to find the face under a number."""

LEAST_NUMBER = 1.2
"""Minimum height in mm of a dot's number; smaller ones are omitted, and the table lists the dots instead."""

USUAL = ("a4-landscape", "a4", "a3-landscape", "a3")
"""Papers tried by default, in this order."""

GOOD = 0.5
"""Scale from which no larger paper is tried."""

BLOCK = 12.0
"""Height of the title block, mm on A4."""


@dataclass(frozen=True)
class ViewPlacement:
    """Positions of the two views on a page, and their scale."""

    scale: float
    front: DrawingView
    side: DrawingView
    callouts: Box


@dataclass(frozen=True)
class FrontPage:
    """First page: the marker seen from the front and from the side.

    Attributes
    ----------
    frame : Frame
    scale : float
        Lengths on paper over lengths of the marker.
    origin : (x, y)
        Position of the marker's origin in the front view, mm from the page's lower left corner.
    shapes : tuple of Shape
        Shapes, mm from the page's lower left corner; text is `Lettering`.
    """

    frame: Frame
    scale: float
    origin: Point
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class DetailView:
    """Separate view to place among tables and notes.

    Attributes
    ----------
    title : str
        Subject and scale of the view.
    width, height : float
        Size, mm on paper.
    shapes : tuple of Shape
        Shapes, mm from the lower left corner; text is `Lettering`.
    """

    title: str
    width: float
    height: float
    shapes: tuple[Shape, ...]


def front_page(work: Workpiece, options: SheetOptions) -> FrontPage:
    """Draw the front and side views, with dimensions, numbers and callouts, on paper that shows them large enough.

    The default paper is A4, or A3 if A4 allows only a scale below 1 : 2 and A3 a larger one.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    frame, layout = _place(work, options)
    return FrontPage(frame, layout.scale, (layout.front.x, layout.front.y), tuple(_draw_front(work, layout, frame)))


def drawing_area(frame: Frame) -> Box:
    """Area inside the border and above the title block, mm."""
    air = 3 * frame.scale
    return frame.margin + air, frame.margin + BLOCK * frame.scale + air, frame.right - air, frame.top - air


def section_view(section: SectionView, width: float, height: float, style: Style) -> DetailView:
    """Draw a section of the solid at the largest scale that suits a column of the given width and height, mm."""
    left, bottom, right, top = section.box
    tier = CLOSE * style.scale
    beside, below = (0.8 + len(section.upright)) * tier, 0.8 * tier
    low = max(min(min((face.box[1] for face in section.faces), default=bottom), top), bottom)

    def lift(scale: float) -> float:
        # Text beside short dimensions must not collide with that of the heights.
        narrow = any(text_width(span.words, style.words) > scale * (span.end - span.start) for span in section.across)
        return 1.5 * tier if narrow else 0.6 * tier

    def fits(scale: float, room: float) -> bool:
        tall = scale * (top - low) + lift(scale) + len(section.across) * tier + below
        return scale * (right - left) + beside + 0.5 * tier <= width and tall <= room

    # Small if that shows enough; more room if the section would be smaller than the solid.
    rooms = min(0.45 * height, 52 * style.scale), 0.7 * height
    scales = [next((each for each in SCALES[1:] if fits(each, room)), SCALES[-1]) for room in rooms]
    scale = scales[0] if scales[0] >= 1 else min(scales[1], 1.0)
    above = max(lift(scale) + len(section.across) * tier, 1.5 * tier)
    deep = scale * (top - low) + above + below
    view = DrawingView(0.3 * tier - scale * left, below - scale * low, scale)
    shapes: list[Shape] = []
    for face in section.faces:
        shapes += drawn(face, view, True, style)
    for face in section.faces:
        shapes += cut_edges(face, view, section.box)
    for axis in section.axes:
        (x, foot), (_, head) = view.at((axis, low)), view.at((axis, top))
        over = 2 * style.scale
        shapes += center_line((x, foot - over), (x, head + over), style)
    # Outer dimensions first, so that the text of the inner ones covers their extension lines.
    for number, span in reversed(list(enumerate(section.across))):
        line = view.at((0.0, top))[1] + lift(scale) + number * tier
        starts = [view.at((0.0, _highest(section.faces, at, top)))[1] for at in (span.start, span.end)]
        x0, x1 = (view.at((at, 0.0))[0] for at in (span.start, span.end))
        shapes += across(x0, x1, line, (starts[0], starts[1]), span.words, style)
    edge = view.at((right, 0.0))[0]
    shapes += _stacked(section.upright, view, edge, edge + 0.9 * tier, tier, style)
    return DetailView(f"{section.title}, {scale_words(scale)}", width, deep, tuple(shapes))


def back_view(work: Workpiece, width: float, height: float) -> DetailView:
    """Draw the back at the largest scale that suits a column of the given width and height, mm."""
    left, bottom, right, top = around(work.back)
    room = min(0.6 * height, width)
    # Half a millimeter on each side for line widths.
    scale = next((s for s in SCALES if s * (right - left) + 1 <= width and s * (top - bottom) <= room), SCALES[-1])
    view = DrawingView(0.5 - scale * left, 0.5 - scale * bottom, scale)
    shapes = tuple(shape for face in work.back for shape in drawn(face, view))
    return DetailView(f"Seen from the back, {scale_words(scale)}", width, scale * (top - bottom) + 1, shapes)


def _place(work: Workpiece, options: SheetOptions) -> tuple[Frame, ViewPlacement]:
    """Paper of the drawing, and its layout."""
    best: tuple[Frame, ViewPlacement] | None = None
    papers = _papers(options)
    for paper in papers:
        frame = options.frame(paper)
        roomy = min(frame.width, frame.top - frame.margin) > LEAST_ROOM
        layout = _placement(work, frame, drawing_area(frame)) if roomy else None
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


def _placement(work: Workpiece, frame: Frame, room: Box) -> ViewPlacement | None:
    """Placement at the largest scale at which both views and their annotations fit in `room`; None if there is none."""
    style = Style(frame.scale)
    left, bottom, right, top = _reach(work)
    _, foot, _, head = around(work.side)
    wide = max([text_width(line, style.words) for callout in work.callouts for line in callout.lines], default=0.0)
    column = wide + 12 * frame.scale
    tiers = CLOSE * frame.scale
    beside = 2.2 * tiers + (0.6 + len(work.heights)) * tiers
    above, gap, below = 9 * frame.scale, 12 * frame.scale, 2.0 * tiers
    for scale in SCALES:
        width, height = scale * (right - left), scale * (top - bottom)
        if max(width, height) < LEAST_VIEW:
            return None
        thick = scale * (head - foot)
        if width + beside + column > room[2] - room[0] or height + thick + above + gap + below > room[3] - room[1]:
            continue
        # Spare room is distributed; the callouts stand beside the view, not at the far end of the page.
        group = room[0] + (room[2] - room[0] - width - beside - column) / 2
        down = room[3] - room[1] - height - thick - above - gap - below
        x = group + 2.2 * tiers - scale * left
        y = room[3] - above - down * 0.4 - scale * top
        z = y + scale * bottom - gap - down * 0.2 - scale * head
        start = group + width + beside + 10 * frame.scale
        callouts = (start, room[1] + tiers, start + wide, room[3] - 2 * frame.scale)
        return ViewPlacement(scale, DrawingView(x, y, scale), DrawingView(x, z, scale), callouts)
    return None


def _draw_front(work: Workpiece, layout: ViewPlacement, frame: Frame) -> list[Shape]:
    """Draw both views with dimensions, numbers and callouts."""
    style, view = Style(frame.scale), layout.front
    shapes: list[Shape] = []
    for face in work.front:
        shapes += drawn(face, view)
    shapes += _axes(work, view, style)
    shapes += _dot_numbers(work, view, style)
    shapes += _sizes(work, layout, style)
    marks = [bounds(shape) for shape in shapes if shape.name]
    return shapes + place_callouts(work.callouts, view, layout.callouts, style, marks)


def _reach(work: Workpiece) -> Box:
    """Box around the front view and the origin."""
    left, bottom, right, top = around(work.front)
    return min(left, 0.0), min(bottom, 0.0), max(right, 0.0), max(top, 0.0)


def _axes(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """Marker frame: chain lines through the origin, with arrows at their positive ends."""
    left, bottom, right, top = view.box(_reach(work))
    x, y = view.at((0.0, 0.0))
    over = 4.5 * style.scale
    ends = left - over, bottom - over, right + over, top + over
    shapes: list[Shape] = [
        *center_line((left - over / 2, y), (right + over, y), style),
        *center_line((x, bottom - over / 2), (x, top + over), style),
        arrow((right + over, y), (1, 0), style),
        arrow((x, top + over), (0, 1), style),
        lettering("x", right + over + 0.8 * style.scale, y + 0.6 * style.scale, style.words, name="axis-x"),
        lettering("y", x + 1.2 * style.scale, top + over - style.words * 0.6, style.words, name="axis-y"),
    ]
    for callout in work.callouts:
        if callout.pitch:
            # The pitch circle of holes in the corners of a plate is larger than the plate.
            dashes = center_circle(x, y, view.scale * callout.pitch, style)
            shapes += [dash for dash in dashes if union(bounds(dash), ends) == ends]
    return shapes


def _dot_numbers(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """Numbers inside their dots where they fit, otherwise beside them."""
    shapes: list[Shape] = []
    rest: list[tuple[str, Disk]] = []
    for label in work.labels:
        x, y = view.at((label.x, label.y))
        room = view.scale * (label.inner_radius or label.radius)
        width = text_width(label.words, 1.0)
        # Half the diagonal of the number, with a margin, must not exceed the circle's radius.
        height = min(style.words, 0.85 * room / (hypot(width, 1.0) / 2))
        if height >= LEAST_NUMBER * style.scale:
            words = lettering(label.words, x, y - height / 2, height, "center", name=f"number-{label.words}")
            shapes += on_white(words, _label_ground(work, label))
        else:
            # No quiet zone here: only the dot itself must stay clear.
            rest.append((label.words, Disk(x, y, 0.55 * view.scale * label.radius + 0.1)))
    if rest:
        names, dots = [each[0] for each in rest], [each[1] for each in rest]
        height = 1.5 * style.scale
        outline = view.box(around(work.front))
        places = place_numbers(
            dots, names, height, [outline] * len(dots), view.at((0.0, 0.0)), _edge_points(work, view)
        )
        for name, place in zip(names, places, strict=True):
            if place:
                at = place[0], place[1] - height / 2
                shapes.append(lettering(name, *at, height, "center", name=f"number-{name}"))
    return shapes


def _label_ground(work: Workpiece, label: DotLabel) -> str:
    """Color under a number: that of the uppermost face there."""
    at = label.x, label.y
    # An odd count: inside the outer contour and outside its holes.
    over = [face for face in work.front if sum(inside(at, flattened(ring, NEAR)) for ring in face.contours) % 2]
    return DARK if over and over[-1].material == "dark" else WHITE


def _edge_points(work: Workpiece, view: DrawingView) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Points along all edges of the front view, at most half a millimeter apart."""
    points: list[Point] = []
    for face in work.front:
        for ring in map(view.trace, (*face.contours, *face.edges)):
            for a, b in pairwise((*ring, ring[0])):
                count = max(int(hypot(b[0] - a[0], b[1] - a[1]) / 0.5), 1)
                points += [(a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count) for k in range(count)]
    return np.array(points).reshape(-1, 2)


def _sizes(work: Workpiece, layout: ViewPlacement, style: Style) -> list[Shape]:
    """Side view, overall sizes below it and beside the front view, and heights on the right."""
    front, side = layout.front, layout.side
    shapes: list[Shape] = []
    for face in work.side:
        shapes += drawn(face, side)
    left, bottom, right, top = front.box(around(work.front))
    low, high = (side.at((0.0, z))[1] for z in (around(work.side)[1], around(work.side)[3]))
    width, height = work.size
    tier = CLOSE * style.scale
    sign = "\xd8" if work.round else ""
    shapes += across(left, right, low - 1.4 * tier, low, sign + millimeters(width), style)
    if not work.round:
        x = left - 1.4 * tier
        shapes += upright(bottom, top, x, left, millimeters(height), style)
    shapes += _stacked(work.heights, side, right, right + tier, tier, style)
    above = high + 1.5 * style.scale, left
    words = "seen from -y"
    shapes.append(lettering(words, above[1], above[0], 0.8 * style.words, color=GRAY, name="side-words"))
    return shapes


def _stacked(
    spans: Sequence[Dimension], view: DrawingView, start: float, first: float, tier: float, style: Style
) -> list[Shape]:
    """Dimensions along z in the given order, each one tier farther to the right."""
    shapes: list[Shape] = []
    for number, span in enumerate(spans):
        y0, y1 = (view.at((0.0, z))[1] for z in (span.start, span.end))
        shapes += upright(y0, y1, first + number * tier, start, span.words, style)
    return shapes


def _highest(faces: Sequence[ViewFace], at: float, top: float) -> float:
    """Start of the extension line at a position along the cut: the highest corner of the edge there."""
    found = [z for face in faces for ring in face.contours for s, z in ring.points if abs(s - at) < 1e-3]
    return max(found, default=top)
