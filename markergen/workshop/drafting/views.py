"""Views of a fabrication drawing on paper: front and side with dimensions and callouts.

+---------------------------------------------+
|  A   =============  side view, heights      |
|          y                                  |
|       +-----+-----+                         |
|       |  1  |  0  |                         |
| size  |- - -+- - -|- x  callouts on the     |
|       |  2  |  3  |     right               |
|       +-----+-----+                         |
|       |<- size  ->|                         |
+---------------------------------------------+

Seen from below, from -y, the side view is above the front view in first-angle projection, and below it in third-angle
projection, which is used on American paper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise, product
from math import hypot, radians, tan
from typing import TypeVar

import numpy as np

from markergen.arrays import Array
from markergen.drawing.marker_artwork import place_numbers
from markergen.drawing.paper import LEAST_ROOM, PAPERS, Frame, Paper, SheetOptions, find_paper, oriented
from markergen.drawing.scene import (
    GRAY,
    Box,
    Disk,
    Line,
    Point,
    Shape,
    bounds,
    frame_lines,
    ink_points,
    overlaps,
    union,
)
from markergen.drawing.text import text_width
from markergen.errors import InputError
from markergen.geometry.region import line_distances
from markergen.workshop.drafting.details import SCALES, stacked, stacked_at
from markergen.workshop.drafting.drawing import Callout, Control, Workpiece, around, exact, millimeters
from markergen.workshop.drafting.pen import (
    CLOSE,
    THIN,
    DrawingView,
    Style,
    across,
    arrow,
    center_circle,
    center_line,
    drawn,
    leader,
    lettering,
    vertical_dimension,
)
from markergen.workshop.drafting.symbols import (
    FRAMES_APART,
    datum_letter,
    datum_reach,
    face_datum,
    frame_width,
    interrupted,
    phrase,
    phrase_width,
    tolerance_frame,
)
from markergen.workshop.drafting.title_block import block_height, first_angle

LEAST_VIEW = 20.0
"""Minimum size in mm on paper of the front view, below which no detail is visible."""

NEAR = 0.05
"""Maximum distance in mm from an arc, sufficient to find the face under a number."""

USUAL = ("a4-landscape", "a4", "a3-landscape", "a3")
"""Papers tried by default, in this order."""

LOOSE = 0.85
"""Maximum part of the column that callouts take before larger paper is tried."""

GOOD = 1.0
"""Scale from which no larger paper is tried: at 0.5 a plate of 100 mm leaves half of an A4 page empty."""

SHORT = 0.01
"""Distance in mm of the origin from an edge below which it is not dimensioned."""

MARK = 1.5
"""Length in mm on A4 of the center lines of a hole outside of it."""


@dataclass(frozen=True)
class ViewPlacement:
    """Positions of the two views on a page, and their scale."""

    frame: Frame
    scale: float
    front: DrawingView
    side: DrawingView
    callouts: Box


@dataclass(frozen=True)
class FrontPage:
    """First page: the marker seen from the front and from the side.

    Attributes
    ----------
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


P = TypeVar("P", ViewPlacement, FrontPage)


def front_page(work: Workpiece, options: SheetOptions) -> FrontPage:
    """Draw the front and side views, with dimensions, numbers and callouts, on paper that shows them large enough.

    The default paper is A4, or A3 if A4 allows only a scale below 1 : 1 and A3 a larger one.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    layout = best_on_paper(
        options, lambda frame, forced: _placement(work, frame, forced), "a fabrication sheet", "A4 or larger"
    )
    return FrontPage(layout.frame, layout.scale, (layout.front.x, layout.front.y), tuple(_draw_front(work, layout)))


def drawing_area(frame: Frame, first: bool = True) -> Box:
    """Area inside the border and above the title block of the first or a further sheet, mm."""
    air = 3 * frame.scale
    low = frame.margin + block_height(frame, first) + air
    return frame.margin + air, low, frame.right - air, frame.top - air


def best_on_paper(options: SheetOptions, draw: Callable[[Frame, bool], P | None], what: str, paper: str) -> P:
    """Drawing on the first usual paper that shows it at the scale `GOOD` or more, or else at the largest scale.

    Parameters
    ----------
    draw : callable
        Draws on a page, forced on the last one if none holds it; None if it does not fit.
    what, paper : str
        For the error if no paper holds it: what is drawn, and what paper to use.
    """
    best: P | None = None
    papers = usual_papers(options)
    for size in papers:
        frame = options.frame(size)
        roomy = min(frame.width, frame.top - frame.margin) > LEAST_ROOM
        drawing = draw(frame, best is None and size == papers[-1]) if roomy else None
        if drawing and (best is None or drawing.scale > best.scale):
            best = drawing
        if best and best.scale >= GOOD:
            break
    if best is None:
        raise InputError(f"paper that {what} fits on", ", ".join(map(str, papers)), f"use --paper {paper}")
    return best


def usual_papers(options: SheetOptions) -> list[Paper]:
    """Papers to try, in this order: those that are usual, or the one that is asked for."""
    if options.paper is not None:
        paper = find_paper(options.paper, options.orientation)
        fixed = options.orientation or oriented(options.paper)
        return [paper] if fixed else [paper.turned, paper]
    papers = [PAPERS[name] for name in USUAL]
    if options.orientation:
        papers = [size for size in papers if (size.width > size.height) == (options.orientation == "landscape")]
    return papers


@dataclass(frozen=True)
class _Around:
    """Room in mm that annotations take around the views, and distances of the first dimension lines from them."""

    left: float
    below: float
    above: float
    first: float


def _around(work: Workpiece, style: Style) -> _Around:
    tier, height = CLOSE * style.scale, style.words
    edges = {datum.letter: datum for datum in work.datums if datum.kind == "edge"}
    # Datum letters are between an edge and its dimensions.
    first = datum_reach(height) + 1.2 * tier if edges else 1.4 * tier
    rows = [1, 0] if work.round else [2, 2]
    rim = datum_reach(height) + tier if work.round else 0.0
    face = frame_width(work.flatness, height) + 1.2 * tier
    left = max(first + rows[1] * tier, face, rim) if rows[1] or rim else face
    return _Around(left, first + rows[0] * tier, 9 * style.scale, first)


def _placement(work: Workpiece, frame: Frame, forced: bool) -> ViewPlacement | None:
    """Placement at the largest scale at which both views and their annotations fit on a page; None if there is none.

    If `forced`, the words of callouts may shrink.
    """
    room, style = drawing_area(frame), Style(frame.scale)
    left, bottom, right, top = _reach(work)
    start_, foot, end_, head = around(work.side)
    # What is under a face may be wider than it.
    left, right = (start_ if start_ < left - SHORT else left), (end_ if end_ > right + SHORT else right)
    wide = max([callout_width(callout, style) for callout in work.callouts], default=0.0)
    column = wide + 12 * frame.scale
    tiers = max(CLOSE * frame.scale, 2.4 * style.words)
    high = sum(callout_height(callout, style) + 1.2 * style.words for callout in work.callouts)
    # In a full column they can not stand where their leaders are best.
    if high > LOOSE * (room[3] - room[1]) and not forced:
        return None
    air, below_first = _around(work, style), first_angle(frame.paper)
    gap = 8 * frame.scale
    for scale in SCALES:
        width, height = scale * (right - left), scale * (top - bottom)
        if max(width, height) < LEAST_VIEW:
            return None
        thick = scale * (head - foot)
        heights = stacked_at(work.heights, scale, tiers, tiers, style)
        beside = air.left + max(heights[-1][1], tiers) + tiers
        # The tolerance of the face and its letter are above it.
        letter = max(4.5 * style.words - scale * (head - work.face), 2.5 * style.words)
        deep = height + thick + air.above + air.below + letter + gap
        if width + beside + column > room[2] - room[0] or deep > room[3] - room[1]:
            continue
        # Spare room is distributed; the callouts stand beside the view, not at the far end of the page.
        group = room[0] + (room[2] - room[0] - width - beside - column) / 2
        down = room[3] - room[1] - deep
        x = group + air.left - scale * left
        if below_first:
            z = room[3] - letter - down * 0.3 - scale * head
            y = z + scale * foot - gap - air.above - down * 0.3 - scale * top
        else:
            y = room[3] - air.above - down * 0.3 - scale * top
            z = y + scale * bottom - air.below - letter - gap - down * 0.3 - scale * head
        start = group + width + beside + 10 * frame.scale
        callouts = (start, room[1] + tiers / 2, start + wide, room[3] - 2 * frame.scale)
        return ViewPlacement(frame, scale, DrawingView(x, y, scale), DrawingView(x, z, scale), callouts)
    return None


def _draw_front(work: Workpiece, layout: ViewPlacement) -> list[Shape]:
    """Draw both views with dimensions, numbers and callouts."""
    style, view = Style(layout.frame.scale), layout.front
    shapes: list[Shape] = []
    for face in work.front:
        shapes += drawn(face, view)
    axes, numbers = _axes(work, view, style), _inner_numbers(work, view, style)
    lines = interrupted([*axes, *_hole_marks(work, view, style)], [bounds(text) for text in numbers[1]], style.scale)
    outside = _outer_numbers(work, view, lines, numbers[0], style)
    lines = interrupted(lines, [bounds(text) for text in outside], style.scale)
    sizes = [*_sizes(work, layout, style), *_datums(work, layout, style)]
    shapes += [*lines, *numbers[1], *outside, *sizes]
    marks = [bounds(shape) for shape in shapes if shape.name]
    edges = frame_lines(layout.side.box(around(work.side)), THIN)
    avoided = [edges, *(shape for shape in sizes if isinstance(shape, Line))]
    west, south, east, _ = view.box(around(work.front))
    inner = west - _around(work, style).left - 2 * style.scale
    free = (drawing_area(layout.frame)[0], south, inner, layout.callouts[3])
    at_left = [callout for callout in work.callouts if _is_left(callout, view, (west + east) / 2, free, style)]
    flipped = [replace(callout, places=tuple((-x, y, r) for x, y, r in callout.places)) for callout in at_left]
    placed = _placed(flipped, _room(work.callouts, view, free, style, marks, avoided).mirrored()) if at_left else []
    if not placed or max(best.cost for _, best in placed) >= HIT or _penalty(placed):
        room = _room(work.callouts, view, layout.callouts, style, marks, avoided)
        beside = _placed([callout for callout in work.callouts if callout not in at_left], room) if placed else None
        together = _placed(work.callouts, room) if beside else None
        if not (placed and beside and together and _penalty([*placed, *beside]) < _penalty(together)):
            at_left, placed = [], []
    for number, (callout, best) in enumerate(placed, 1):
        start = free[2] - callout_width(callout, style)
        tip, elbow, (_, level) = [(-x, y) for x, y in best.run]
        end = start + phrase_width(callout.lines[0], style.words) + 1.2 * style.scale, level
        shapes += [*leader(tip, elbow, end, style), *_written(callout, start, best.top, style, f"left-{number}")]
        avoided.append(Line((tip, elbow, end), THIN))
    others = [callout for callout in work.callouts if callout not in at_left]
    return shapes + place_callouts(others, _room(work.callouts, view, layout.callouts, style, marks, avoided))


def _is_left(callout: Callout, view: DrawingView, middle: float, free: Box, style: Style) -> bool:
    """Tell whether a callout is about features on the left alone, and there is room for its words on that side."""
    is_left = all(view.at((x + r, y))[0] < middle for x, y, r in callout.places)
    return is_left and callout_width(callout, style) <= free[2] - free[0]


def _reach(work: Workpiece) -> Box:
    """Box around the front view and the origin."""
    left, bottom, right, top = around(work.front)
    return min(left, 0.0), min(bottom, 0.0), max(right, 0.0), max(top, 0.0)


def _axes(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """Marker frame: chain lines through the origin, with arrows at their positive ends, and pitch circles."""
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
    for pitch in {callout.pitch: None for callout in work.callouts if callout.pitch}:
        # The pitch circle of holes in the corners of a plate is larger than the plate.
        dashes = center_circle(x, y, view.scale * pitch, style)
        shapes += [dash for dash in dashes if union(bounds(dash), ends) == ends]
    return shapes


def _hole_marks(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """Crosses through the centers of holes."""
    shapes: list[Shape] = []
    for hole in work.holes:
        (x, y), reach = view.at((hole.x, hole.y)), view.scale * hole.radius + MARK * style.scale
        shapes += [Line(((x - reach, y), (x + reach, y)), THIN), Line(((x, y - reach), (x, y + reach)), THIN)]
    return shapes


def _inner_numbers(work: Workpiece, view: DrawingView, style: Style) -> tuple[set[str], list[Shape]]:
    """Numbers that fit inside their dots, and their shapes."""
    shapes: list[Shape] = []
    names = set()
    for label in work.labels:
        x, y = view.at((label.x, label.y))
        room = view.scale * (label.inner_radius or label.radius)
        width = text_width(label.name, 1.0)
        # Half the diagonal of the number, with a margin, must not exceed the circle's radius.
        height = min(style.words, 0.85 * room / (hypot(width, 1.0) / 2))
        if height >= style.least:
            names.add(label.name)
            number = lettering(label.name, x, y - height / 2, height, "center", name=f"number-{label.name}")
            shapes.append(number)
    return names, shapes


def _outer_numbers(
    work: Workpiece, view: DrawingView, lines: Sequence[Shape], inner: set[str], style: Style
) -> list[Shape]:
    """Numbers beside the dots that are too small for them, and the labels of holes."""
    # No quiet zone here: only the dot or the hole itself must stay clear.
    rooms = [(label, 0.55 * view.scale * label.radius + 0.1) for label in work.labels]
    rest = [(label, radius) for label, radius in rooms if label.name not in inner]
    rest += [(hole, 0.55 * view.scale * hole.radius + 0.5 * MARK * style.scale) for hole in work.holes]
    if not rest:
        return []
    names = [label.name for label, _ in rest]
    others = [(label, radius) for label, radius in rooms if label.name in inner]
    dots = [Disk(*view.at((label.x, label.y)), radius) for label, radius in (*rest, *others)]
    height = style.least
    outline = view.box(around(work.front))
    ink = np.concatenate([_edge_points(work, view), ink_points(lines)])
    places = place_numbers(dots, names, height, [outline] * len(names), view.at((0.0, 0.0)), ink)
    shapes: list[Shape] = []
    spots = np.array([(*view.at((spot.x, spot.y)), view.scale * spot.radius) for spot in (*work.labels, *work.holes)])
    edges = _edge_points(work, view)
    spots = np.concatenate([spots.reshape(-1, 3), np.column_stack([edges, np.zeros(len(edges))])])
    for (label, _), place in zip(rest, places, strict=True):
        x, y = place or _clear(view.at((label.x, label.y)), label.name, height, spots, list(map(bounds, shapes)))
        shapes.append(lettering(label.name, x, y - height / 2, height, "center", name=f"number-{label.name}"))
    return shapes


def _clear(at: Point, label: str, height: float, spots: Array, taken: Sequence[Box]) -> Point:
    """Place for words near a point, clear of features (m, 3), x, y and radius, and of other words, if not of lines."""
    half = np.array([text_width(label, height) / 2, height / 2])
    for reach, angle in product(np.arange(1.0, 6.0, 0.5) * height, np.radians([90, 270, 180, 0, 135, 45, 225, 315])):
        x, y = at[0] + reach * np.cos(angle), at[1] + reach * np.sin(angle)
        gaps = np.linalg.norm(np.maximum(np.abs(spots[:, :2] - [x, y]) - half, 0), axis=1) - spots[:, 2]
        box = x - half[0], y - half[1], x + half[0], y + half[1]
        if gaps.min() > 0.3 and not any(overlaps(box, other) for other in taken):
            return float(x), float(y)
    return at


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
    """Side view with its heights, overall sizes of the front view, and the origin's distances from datum edges."""
    front, side = layout.front, layout.side
    shapes: list[Shape] = []
    for face in work.side:
        shapes += drawn(face, side)
    left, bottom, right, top = front.box(around(work.front))
    upper = side.at((0.0, around(work.side)[3]))[1]
    (x, y), (width, height), tier = front.at((0.0, 0.0)), work.size, CLOSE * style.scale
    first = _around(work, style).first
    edges = {datum.letter: datum for datum in work.datums if datum.kind == "edge"}
    below, aside = bottom - first, left - first

    def label(size: float) -> str:
        return f"({millimeters(size)})" if work.listed else millimeters(size)

    if not work.round:
        # The origin's distances from datum edges, exactly; or else from the lower and the left end.
        low, foot = around(work.front)[:2]
        for letter, axis, end in (("C", 0, low), ("B", 1, foot)):
            at = edges[letter].at[axis] if letter in edges else end
            size = f"[{exact(abs(at))}]" if letter in edges else label(abs(at))
            if abs(at) < SHORT:
                continue
            if letter == "C":
                shapes += across(*_ordered(front.at((at, 0.0))[0], x), below, bottom, size, style)
                below -= 1.3 * tier
            else:
                shapes += vertical_dimension(*_ordered(front.at((0.0, at))[1], y), aside, left, size, style)
                aside -= 1.3 * tier
    sign = "\xd8" if work.round else ""
    shapes += across(left, right, below, (top + bottom) / 2 if work.round else bottom, sign + label(width), style)
    if not work.round:
        shapes += vertical_dimension(bottom, top, aside, left, label(height), style)
    end = side.box(around(work.side))[2]
    end = end if end > right + SHORT else right
    shapes += stacked(work.heights, side, end, end + tier, tier, style)
    # A face of a body has a frame of its own.
    title = f"seen from -y{' of this face' * (work.parallelism is None)}"
    return [*shapes, lettering(title, left, upper + 1.5 * style.scale, style.words, color=GRAY, name="side-words")]


def _ordered(a: float, b: float) -> tuple[float, float]:
    return min(a, b), max(a, b)


def _datums(work: Workpiece, layout: ViewPlacement, style: Style) -> list[Shape]:
    """Datum letters of the face, of edges and of a rim, and tolerances of face and back; others are in callouts."""
    front, side, height = layout.front, layout.side, style.words
    left, bottom, _, _ = front.box(around(work.front))
    first = _around(work, style).first
    shapes: list[Shape] = []
    for datum in work.datums:
        if datum.kind == "face":
            level = side.at((0.0, work.face))[1]
            start = left - frame_width(work.flatness, height) - CLOSE * style.scale
            # An extension line of the face, with the arrow of its tolerance on it.
            shapes.append(Line(((start - style.scale, level), (left - 0.8 * style.scale, level)), THIN))
            shapes += face_datum(datum.letter, work.flatness, (start, level), level + 2.4 * height, style)
            if work.parallelism:
                right, foot = side.box(around(work.side))[2], side.at((0.0, around(work.side)[1]))[1]
                shapes += _back_control(work.parallelism, (right - 2 * style.scale, foot), style)
        elif datum.kind == "edge":
            shapes += datum_letter(datum.letter, front.at(datum.at), datum.out, height)
        elif datum.kind == "rim":
            # On the line of the diameter: the datum is the axis.
            shapes += datum_letter(datum.letter, (left, bottom - first), (-1.0, 0.0), height)
    return shapes


def _back_control(control: Control, tip: Point, style: Style) -> list[Shape]:
    """Tolerance of a back that is seen as a line, with an arrow from the right end of its frame up to `tip`."""
    height = style.words
    frame = tolerance_frame(control, tip[0] - frame_width(control, height), tip[1] - 2.6 * height, height)
    return [Line((tip, (tip[0], bounds(frame[0])[3])), THIN), arrow(tip, (0.0, 1.0), style), *frame]


SLANTS = tuple(tan(radians(angle)) for angle in (30, 45, 60, 75))
"""Slopes of leaders in front of their horizontal landing."""

MOST_PLACES = 12
"""Maximum number of identical features, nearest to the words first, to which a leader is tried."""

HIT, OVER, CROSSED, BEND = 100.0, 30.0, 300.0, 2.0
"""Costs of a leader, as mm of length: crossing a feature or running along the axis, crossing a line of a dimension or
an edge, crossing a leader, and a bend. With 100 for lines as well, leaders run over tags and dots."""

TRIES = 24
"""Number of orders in which callouts choose their places, until one has no leader over anything; in the best of them,
any two are then exchanged."""

LINES_APART = 1.75
"""Distance between lines of words, in cap heights."""


Run = tuple[Point, Point, Point]
"""Tip of a leader, its elbow, and its end at the words."""

Circle = tuple[float, float, float]
"""Center and radius, mm on paper."""


@dataclass(frozen=True)
class _Leader:
    cost: float
    length: float
    run: Run
    top: float
    """Upper end of the words."""


@dataclass(frozen=True)
class _Room:
    """Where callouts go: view, column for the words, mm on paper, gap between them, and what leaders should not touch.

    The latter are circles (m, 3) as center and radius, and segments (k, 2, 2); mm on paper.
    """

    view: DrawingView
    column: Box
    gap: float
    style: Style
    circles: Array
    segments: Array
    costs: dict[tuple[Run, Circle], float] = field(default_factory=dict, init=False, compare=False)
    """Costs of leaders by what they alone touch: each is tried many times, between other ones."""

    def cost_of(self, run: Run, circle: Circle) -> float:
        """Cost of what a leader touches beside other leaders; the circle is that of its feature."""
        key = run, circle
        if key not in self.costs:
            self.costs[key] = HIT * _along_axis(run, self.view) + _hits(run, self, circle)
        return self.costs[key]

    def mirrored(self) -> "_Room":
        """The same on the other side of the page's left edge, for words to the left of the view."""
        left, bottom, right, top = self.column
        flip = np.array([-1.0, 1.0, 1.0])
        return _Room(
            DrawingView(-self.view.x, self.view.y, self.view.scale), (-right, bottom, -left, top), self.gap, self.style,
            self.circles * flip, self.segments * flip[:2],
        )  # fmt: skip


def _room(
    callouts: Sequence[Callout], view: DrawingView, column: Box, style: Style, marks: Sequence[Box],
    lines: Sequence[Line],
) -> _Room:  # fmt: skip
    places = [place for callout in callouts for place in (*callout.places, *callout.area)]
    circles = np.array([(*view.at((x, y)), view.scale * r) for x, y, r in places])
    segments = np.array([pair for line in lines for pair in pairwise(line.points)]).reshape(-1, 2, 2)
    # Words by their circumscribed circles.
    texts = np.array([((a + c) / 2, (b + d) / 2, hypot(c - a, d - b) / 2) for a, b, c, d in marks]).reshape(-1, 3)
    return _Room(view, column, 1.4 * style.words, style, np.concatenate([circles.reshape(-1, 3), texts]), segments)


def place_callouts(callouts: Sequence[Callout], room: _Room) -> list[Shape]:
    """Place the words and leaders of callouts; those with the fewest features to point at choose first."""
    column, style = room.column, room.style
    placed = _placed(callouts, room)
    while placed is None:
        # One below the other, in the order of what they point at, and smaller if there are too many.
        total = sum(callout_height(callout, style) for callout in callouts) + room.gap * (len(callouts) - 1)
        if total > column[3] - column[1]:
            style = style.smaller()
        room = replace(room, gap=1.2 * style.words, style=style)
        placed = _stacked(callouts, room)
    shapes: list[Shape] = []
    for number, (callout, best) in enumerate(placed, 1):
        shapes += leader(*best.run, style)
        shapes += _written(callout, column[0], best.top, style, f"callout-{number}")
    return shapes


def _placed(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts where their leaders are best; None if there is no room for one of them."""
    order = sorted(callouts, key=lambda callout: len(callout.places))
    attempts: list[tuple[float, list[Callout], list[tuple[Callout, _Leader]]]] = []
    rng = np.random.default_rng(0)
    for number in range(TRIES):
        placed = _in_order(order, room)
        if placed is not None:
            attempts.append((_cost(placed), order, placed))
            if max((best.cost for _, best in placed), default=0.0) < HIT:
                return placed
            # What got the worst place chooses first the next time.
            order = [callout for callout, _ in sorted(placed, key=lambda pair: -pair[1].cost)]
        if placed is None or number > TRIES / 4:
            order = [callouts[k] for k in rng.permutation(len(callouts))]
    if not attempts:
        return None
    least, order, placed = min(attempts, key=lambda attempt: attempt[0])
    for k, j in list(combinations(range(len(order)), 2)):
        exchanged = [order[{k: j, j: k}.get(n, n)] for n in range(len(order))]
        other = _in_order(exchanged, room)
        if other is not None and _cost(other) < least:
            least, order, placed = _cost(other), exchanged, other
    column_order = _stacked(callouts, room)
    return min(placed, column_order or placed, key=_cost)


def _cost(placed: Sequence[tuple[Callout, "_Leader"]]) -> float:
    return sum(leader.cost for _, leader in placed)


def _penalty(placed: Sequence[tuple[Callout, "_Leader"]]) -> float:
    """What the cost of leaders is beside their length: for what they cross."""
    return sum(leader.cost - leader.length for _, leader in placed)


def _in_order(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts each at the best place that those before it leave; None if there is none."""
    column, style, gap = room.column, room.style, room.gap
    taken: list[tuple[float, float]] = []
    placed: list[tuple[Callout, _Leader]] = []
    for callout in callouts:
        height = callout_height(callout, style)
        tops = [
            top
            for top in np.arange(column[1] + height, column[3] + 1e-9, 2.0 * style.scale).tolist()
            if not any(top - height < upper + gap and top > lower - gap for lower, upper in taken)
        ]
        best = _best(callout, room, tops, [leader.run for _, leader in placed])
        if best is None:
            return None
        taken.append((best.top - height, best.top))
        placed.append((callout, best))
    return placed


def _stacked(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts one below the other; None if they are too high together."""
    top = room.column[3]
    placed: list[tuple[Callout, _Leader]] = []
    for callout in sorted(callouts, key=lambda candidate: -max(place[1] for place in candidate.places)):
        height = callout_height(callout, room.style)
        if top - height < room.column[1]:
            return None
        runs = [leader.run for _, leader in placed]
        best = _best(callout, room, [top], runs) or _direct(callout, room, top)
        placed.append((callout, best))
        top -= height + room.gap
    return placed


def _direct(callout: Callout, room: _Room, top: float) -> "_Leader":
    """Leader straight to the feature nearest to the words."""
    view, left, style = room.view, room.column[0], room.style
    x, y, r = max(callout.places, key=lambda place: (place[0] + place[2], place[1]))
    at, radius = view.at((x, y)), view.scale * r
    end = left - 1.2 * style.scale, top - style.words / 2
    elbow = end[0] - 1.5 * style.scale, end[1]
    away = max(hypot(elbow[0] - at[0], elbow[1] - at[1]), 1e-9)
    tip = at[0] + radius * (elbow[0] - at[0]) / away, at[1] + radius * (elbow[1] - at[1]) / away
    # Not chosen where anything else is possible.
    return _Leader(CROSSED, 0.0, (tip, elbow, end), top)


def callout_width(callout: Callout, style: Style) -> float:
    """Width of a callout's words and frames."""
    height = style.words
    lines = [phrase_width(line, height) for line in callout.lines]
    frames = [frame_width(control, height) for control in callout.controls]
    if callout.datum and frames:
        frames[-1] += datum_reach(height)
    return max([*lines, *frames])


def callout_height(callout: Callout, style: Style) -> float:
    """Height of a callout's words and frames."""
    frames = len(callout.controls)
    return style.words * (sum(_steps(callout)) + 1 + FRAMES_APART * frames + 0.5 * bool(frames))


def _steps(callout: Callout) -> list[float]:
    """Distances between a callout's lines, in cap heights; a box needs more room."""
    pairs = pairwise(callout.lines)
    return [LINES_APART + 0.15 * ("[" in above) + 0.3 * ("[" in below) for above, below in pairs]


def _written(callout: Callout, x: float, top: float, style: Style, name: str) -> list[Shape]:
    """Words and frames of a callout below a height."""
    height = style.words
    shapes: list[Shape] = []
    base = top - height
    for number, (line, step) in enumerate(zip(callout.lines, (*_steps(callout), 0.0), strict=True)):
        shapes += phrase(line, x, base, height, f"{name}-{number}")
        base -= step * height
    for control in callout.controls:
        base -= FRAMES_APART * height
        shapes += tolerance_frame(control, x, base, height)
    if callout.datum and callout.controls:
        start = x + frame_width(callout.controls[-1], height)
        shapes += datum_letter(callout.datum, (start, base + height / 2), (1.0, 0.0), height)
    return shapes


def _best(callout: Callout, room: _Room, tops: Sequence[float], runs: Sequence[Run]) -> _Leader | None:
    """Cheapest leader over all features, heights of the words and slopes; None if there is none."""
    view, style, end = room.view, room.style, room.column[0] - 1.2 * room.style.scale
    nearest = sorted(callout.places, key=lambda place: (-place[0] - place[2], -place[1]))[:MOST_PLACES]
    candidates: list[tuple[float, _Leader, Circle]] = []
    for (x, y, r), top in product(nearest, tops):
        at, radius = view.at((x, y)), view.scale * r
        level = top - style.words / 2
        drop = level - at[1]
        elbows = [end - 3.5 * style.scale, *(at[0] + abs(drop) / slant for slant in SLANTS)]
        for number, elbow in enumerate(elbows):
            if not at[0] + radius < elbow <= elbows[0]:
                continue
            away = hypot(elbow - at[0], drop)
            if away < radius + 1.5 * style.head:
                continue
            tip = at[0] + radius * (elbow - at[0]) / away, at[1] + radius * drop / away
            run = tip, (elbow, level), (end, level)
            length = away - radius + end - elbow + (BEND if number else 0.0)
            candidates.append((length, _Leader(length, length, run, top), (*at, radius)))
    best: _Leader | None = None
    # What a leader hits is only looked for if it may still be the best: the shortest come first.
    for length, trial, circle in sorted(candidates, key=lambda candidate: candidate[0]):
        if best and length >= best.cost:
            break
        crossed = int(np.sum(line_distances(trial.run, runs) < 0.5)) if runs else 0
        cost = length + room.cost_of(trial.run, circle) + CROSSED * crossed
        if best is None or cost < best.cost:
            best = replace(trial, cost=cost)
    return best


def _hits(run: Run, room: _Room, circle: Circle) -> float:
    """Cost of circles, other than its own, within half a millimeter of a leader, and of lines that it crosses."""
    others = room.circles[np.any(np.abs(room.circles - circle) > 1e-6, axis=-1)]
    is_hit = np.zeros(len(others), dtype=bool)
    crossed = 0
    a, b = room.segments[:, 0], room.segments[:, 1]
    for first, last in ((run[0], run[1]), (run[1], run[2])):
        start, end = np.array(first), np.array(last)
        way = end - start
        share = np.clip((others[:, :2] - start) @ way / max(float(way @ way), 1e-12), 0, 1)
        is_hit |= np.hypot(*(others[:, :2] - start - share[:, None] * way).T) < others[:, 2] + 0.5
        # Two segments cross where the ends of each are on both sides of the other.
        apart = _side(start, end, a) * _side(start, end, b) < 0
        crossed += int(np.sum(apart & (_side(a, b, start) * _side(a, b, end) < 0)))
    return HIT * int(is_hit.sum()) + OVER * crossed


def _side(a: Array, b: Array, point: Array) -> Array:
    """Twice the signed area of a triangle: positive if the point is to the left of the line from a to b."""
    return np.asarray((b - a)[..., 0] * (point - a)[..., 1] - (b - a)[..., 1] * (point - a)[..., 0])


def _along_axis(run: Run, view: DrawingView) -> int:
    """Number of segments of a leader that lie on the x axis or nearly along it."""
    axis = view.at((0.0, 0.0))[1]
    legs = ((run[0], run[1]), (run[1], run[2]))
    return sum(max(abs(a[1] - axis), abs(b[1] - axis)) < 4 and abs(b[0] - a[0]) > 5 for a, b in legs)
