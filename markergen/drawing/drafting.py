"""Drafting in mm on paper: lettering, dimensions, center lines, hatching, and callouts with unobstructed leaders."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import cos, dist, hypot, inf, pi, radians, sin, sqrt, tan

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.fabrication_drawing import Callout, ViewFace
from markergen.drawing.scene import (
    BLACK,
    GRAY,
    WHITE,
    Box,
    FilledPath,
    Line,
    Point,
    Shape,
    bounds,
    polygon,
    rectangle,
    turned,
)
from markergen.drawing.text import SHIFT, text, text_width
from markergen.geometry.contour import Contour, flattened
from markergen.geometry.region import Region, line_distances

Array = NDArray[np.float64]

THICK, THIN = 0.4, 0.18
"""Line widths in mm of visible edges, and of dimension, center and other thin lines (ISO 128)."""

DARK = "#b9b9b9"
"""Fill of dark parts: pale enough for numbers on it, and not to be mistaken for the marker."""

WORDS = "words"
"""Default name of text; text with a name of its own goes into the layer of texts."""

CLOSE = 6.0
"""Distance in mm between dimension lines, on A4."""

SLANTS = tuple(tan(radians(angle)) for angle in (30, 45, 60, 75))
"""Slopes of leaders in front of their horizontal landing."""

MOST_PLACES = 12
"""Maximum number of identical features, nearest to the words first, to which a leader is tried."""

HIT, CROSSED, BEND = 100.0, 300.0, 2.0
"""Costs of a leader, as mm of length: crossing a feature or running along the axis, crossing a leader, and a bend."""

SMOOTH = 2e-3
"""Maximum distance in mm on paper of a drawn line from its arc."""

OFF, BEYOND = 0.8, 1.5
"""Gap between an edge and its extension line, and overshoot beyond the dimension line, mm on A4."""


@dataclass(frozen=True)
class Style:
    """Sizes in mm on the sheet's paper; `scale` is 1 on A4."""

    scale: float = 1.0

    @property
    def words(self) -> float:
        """Cap height of dimensions."""
        return 2.1 * self.scale

    @property
    def small(self) -> float:
        """Cap height of tables and notes."""
        return 1.75 * self.scale

    @property
    def head(self) -> float:
        """Length of an arrowhead."""
        return 2.3 * self.scale


@dataclass(frozen=True)
class Lettering(FilledPath):
    """Line of words as outlines, with the data needed to write them as text in a format with fonts.

    Attributes
    ----------
    words : str
    start : (x, y)
        Start of the baseline, mm.
    height : float
        Cap height, mm.
    upright : bool
        True if it reads upward, from the right side of the sheet.
    face : {"regular", "bold"}
    """

    words: str = ""
    start: Point = (0.0, 0.0)
    height: float = 1.0
    upright: bool = False
    face: str = "regular"


def lettering(
    words: str,
    x: float,
    y: float,
    height: float,
    align: str = "left",
    upright: bool = False,
    face: str = "regular",
    color: str = BLACK,
    name: str = WORDS,
) -> Lettering:
    """Letter words aligned at (x, y), rotated a quarter turn counterclockwise about it if upright; see `text`."""
    path = text(words, x, y, height, align, face, color, name)
    back = SHIFT[align] * text_width(words, height, face)
    start = (x, y - back) if upright else (x - back, y)
    segments = (turned(path, x, y) if upright else path).segments
    return Lettering(segments, name, color, words, start, height, upright, face)


@dataclass(frozen=True)
class DrawingView:
    """Position and scale of a view on paper: its origin at (x, y), lengths times `scale`."""

    x: float
    y: float
    scale: float

    def at(self, point: Point) -> Point:
        """Position on paper of a point of the view."""
        return self.x + self.scale * point[0], self.y + self.scale * point[1]

    def trace(self, contour: Contour) -> list[Point]:
        """Vertices on paper of a polygon that follows a contour's arcs within `SMOOTH`."""
        return [self.at(point) for point in flattened(contour, SMOOTH / self.scale)]

    def box(self, box: Box) -> Box:
        """Position on paper of a box of the view."""
        return *self.at(box[:2]), *self.at(box[2:])


def drawn(face: ViewFace, view: DrawingView, hatched: bool = False, style: Style | None = None) -> list[Shape]:
    """Draw a face with its outline and edges; a cut face is hatched instead."""
    fill = DARK if face.material == "dark" else WHITE
    rings = [view.trace(contour) for contour in face.contours]
    # For the nonzero fill rule a ring inside an odd number of others is a hole and must run clockwise.
    filled = (
        _directed(ring, sum(inside(ring[0], other) for other in rings if other is not ring) % 2 == 0) for ring in rings
    )
    shapes: list[Shape] = [FilledPath(tuple(s for ring in filled for s in polygon(ring, "", fill).segments), "", fill)]
    if hatched:
        return shapes + hatching(face, view, style or Style())
    width = THIN / 2 if face.fine else THICK
    shapes += [Line((*ring, ring[0]), width) for ring in rings]
    return shapes + [Line((*edge, edge[0]), THIN) for edge in map(view.trace, face.edges)]


def inside(point: Point, ring: Sequence[Point]) -> bool:
    """True if a point lies in a ring: a ray from it crosses the ring an odd number of times."""
    x, y = point
    within = False
    for (ax, ay), (bx, by) in pairwise((*ring, ring[0])):
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            within = not within
    return within


def cut_edges(face: ViewFace, view: DrawingView, box: Box) -> list[Shape]:
    """Edges of a cut face, thin at the left and right ends of the box, where the solid continues beyond the view."""
    shapes: list[Shape] = []
    ends = [view.at((side, 0.0))[0] for side in (box[0], box[2])]
    for contour in face.contours:
        ring = view.trace(contour)
        for a, b in pairwise((*ring, ring[0])):
            cut_off = any(abs(a[0] - end) < 1e-6 and abs(b[0] - end) < 1e-6 for end in ends)
            shapes.append(Line((a, b), THIN / 2 if cut_off else THICK))
    return shapes


def hatching(face: ViewFace, view: DrawingView, style: Style) -> list[Shape]:
    """Hatch a face at 45 degrees: rising lines in light material, falling and denser lines in dark material."""
    sign, gap = (-1.0, 1.1 * style.scale) if face.material == "dark" else (1.0, 2.0 * style.scale)
    outer, *holes = (view.trace(contour) for contour in face.contours)
    region = Region.polygon(outer, holes, mend=True)
    left, bottom, right, top = region.box
    if not (right - left > 0 and top - bottom > 0):
        return []
    # Lines x - sign y = k * gap * sqrt(2), so that the lines of one material align across parts.
    step = gap * sqrt(2)
    corners = [x - sign * y for x in (left, right) for y in (bottom, top)]
    first, last = int(min(corners) // step), int(max(corners) // step)
    lines = [((k * step + sign * bottom, bottom), (k * step + sign * top, top)) for k in range(first, last + 1)]
    runs = [((a, b), (c, d)) for line in lines for (a, b), (c, d) in map(np.ndarray.tolist, region.runs(line))]
    return [Line(run, THIN * 0.7, "", GRAY) for run in runs if dist(*run) > 0.05]


def center_line(a: Point, b: Point, style: Style, color: str = BLACK) -> list[Shape]:
    """Chain line: alternating long and short dashes, with a long one at both ends."""
    long, gap, short = 6.0 * style.scale, 1.0 * style.scale, 0.6 * style.scale
    length = hypot(b[0] - a[0], b[1] - a[1])
    if length < 2 * long:
        return [Line((a, b), THIN, "", color)]
    count = max(int((length - long) / (long + 2 * gap + short)), 1)
    long = (length - count * (2 * gap + short)) / (count + 1)
    shapes: list[Shape] = []

    def part(start: float, end: float) -> Line:
        ends = ((a[0] + (b[0] - a[0]) * at / length, a[1] + (b[1] - a[1]) * at / length) for at in (start, end))
        return Line(tuple(ends), THIN, "", color)

    at = 0.0
    for _ in range(count):
        shapes += [part(at, at + long), part(at + long + gap, at + long + gap + short)]
        at += long + 2 * gap + short
    return [*shapes, part(at, length)]


def center_circle(x: float, y: float, radius: float, style: Style) -> list[Shape]:
    """Chain line along a circle on paper."""
    dash = 5.0 * style.scale
    count = max(int(2 * pi * radius / (1.6 * dash)), 8)
    turn = 2 * pi / count
    shapes: list[Shape] = []
    for k in range(count):
        for start, end in ((0.0, 0.66), (0.79, 0.87)):
            angles = [(k + start + (end - start) * i / 12) * turn for i in range(13)]
            shapes.append(Line(tuple((x + radius * cos(a), y + radius * sin(a)) for a in angles), THIN, "", GRAY))
    return shapes


def arrow(tip: Point, direction: Point, style: Style) -> FilledPath:
    """Arrowhead pointing in a direction."""
    length = hypot(*direction)
    ux, uy = direction[0] / length, direction[1] / length
    back, half = style.head, style.head / 6
    foot = tip[0] - back * ux, tip[1] - back * uy
    return polygon(
        [tip, (foot[0] - half * uy, foot[1] + half * ux), (foot[0] + half * uy, foot[1] - half * ux)], "", BLACK
    )


def across(
    x0: float, x1: float, y: float, from_y: float | tuple[float, float], words: str, style: Style
) -> list[Shape]:
    """Horizontal dimension between two positions on paper, on a line at height y; extension lines start at `from_y`."""
    starts = from_y if isinstance(from_y, tuple) else (from_y, from_y)
    shapes: list[Shape] = []
    for x, start in zip((x0, x1), starts, strict=True):
        shapes += _extension((x, start), (x, y), style)
    width = text_width(words, style.words)
    outside = x1 - x0 < 2.6 * style.head
    beside = width > x1 - x0 - (0 if outside else 2 * style.head * 0.5)
    shapes += _arrows((x0, y), (x1, y), outside, style)
    if beside:
        # To the right of the arrows, on an extended dimension line.
        start = x1 + (1.9 * style.head if outside else 0.0)
        ground, written = on_white(lettering(words, start + style.scale, y + 0.7 * style.scale, style.words))
        shapes += [ground, Line(((x1, y), (start + width + 1.5 * style.scale, y)), THIN), written]
    else:
        shapes += on_white(lettering(words, (x0 + x1) / 2, y + 0.7 * style.scale, style.words, "center"))
    return shapes


def upright(
    y0: float, y1: float, x: float, from_x: float | tuple[float, float], words: str, style: Style
) -> list[Shape]:
    """Vertical dimension between two heights on paper, on a line at x; its text reads from the right."""
    starts = from_x if isinstance(from_x, tuple) else (from_x, from_x)
    shapes: list[Shape] = []
    for y, start in zip((y0, y1), starts, strict=True):
        shapes += _extension((start, y), (x, y), style)
    width = text_width(words, style.words)
    outside = y1 - y0 < 2.6 * style.head
    shapes += _arrows((x, y0), (x, y1), outside, style)
    if width > y1 - y0 - style.head:
        # Horizontal above the upper arrow, where there is room.
        top = y1 + (1.9 * style.head if outside else 0.6 * style.scale)
        shapes.append(Line(((x, y1), (x, top + style.scale * 0.3)), THIN))
        shapes += on_white(lettering(words, x, top + 0.9 * style.scale, style.words, "center"))
    else:
        here = (x - 0.7 * style.scale, (y0 + y1) / 2)
        shapes += on_white(lettering(words, *here, style.words, "center", upright=True))
    return shapes


def on_white(words: Lettering, color: str = WHITE) -> list[Shape]:
    """Words on a background of their own, so that no line runs through them."""
    left, bottom, right, top = bounds(words)
    return [rectangle((left - 0.3, bottom - 0.25, right + 0.3, top + 0.25), "", color), words]


def leader(tip: Point, elbow: Point, end: Point, style: Style) -> list[Shape]:
    """Leader line from the words via an elbow to a point, with an arrowhead there."""
    return [
        Line((elbow, end), THIN),
        Line((tip, elbow), THIN),
        arrow(tip, (tip[0] - elbow[0], tip[1] - elbow[1]), style),
    ]


def frame_lines(box: Box, width: float) -> Line:
    """Closed line around a box."""
    left, bottom, right, top = box
    corners = (left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)
    return Line(corners, width)


def scale_words(scale: float) -> str:
    """Scale in words, such as ``1 : 2``."""
    return f"{scale:g} : 1" if scale >= 1 else f"1 : {round(1 / scale):g}"


@dataclass(frozen=True)
class _Leader:
    cost: float
    run: tuple[Point, Point, Point]
    """Tip, elbow and end at the words."""
    top: float
    """Upper end of the words."""


def place_callouts(
    callouts: Sequence[Callout], view: DrawingView, column: Box, style: Style, marks: Sequence[Box] = ()
) -> list[Shape]:
    """Place the words and leaders of callouts; those with the fewest features to point at choose first.

    Parameters
    ----------
    callouts : sequence of Callout
    view : DrawingView
        View that the leaders point into.
    column : box
        Column for the words, mm on paper; leaders start on its left.
    style : Style
    marks : sequence of box
        Words on paper that leaders should avoid.
    """
    step, gap = 1.75 * style.words, 1.4 * style.words
    circles = np.array([(*view.at((x, y)), view.scale * r) for each in callouts for x, y, r in each.places])
    circles = np.concatenate([circles.reshape(-1, 3), _as_circles(marks)])
    taken: list[tuple[float, float]] = []
    runs: list[tuple[Point, Point, Point]] = []
    shapes: list[Shape] = []
    for callout in sorted(callouts, key=lambda each: len(each.places)):
        height = step * (len(callout.lines) - 1) + style.words
        best = _best(callout, view, column, height, gap, circles, taken, runs, style)
        if best is None:
            continue
        taken.append((best.top - height, best.top))
        runs.append(best.run)
        shapes += leader(*best.run, style)
        for number, line in enumerate(callout.lines):
            base = best.top - style.words - number * step
            shapes.append(lettering(line, column[0], base, style.words, name=f"callout-{len(taken)}-{number}"))
    return shapes


def _best(
    callout: Callout,
    view: DrawingView,
    column: Box,
    height: float,
    gap: float,
    circles: Array,
    taken: Sequence[tuple[float, float]],
    runs: Sequence[tuple[Point, Point, Point]],
    style: Style,
) -> _Leader | None:
    """Cheapest leader over all features, heights of the words and slopes; None if there is no room for the words."""
    left, low, _, high = column
    tops = [
        top
        for top in np.arange(low + height, high + 1e-9, 2.0 * style.scale).tolist()
        if not any(top - height < upper + gap and top > lower - gap for lower, upper in taken)
    ]
    end = left - 1.2 * style.scale
    nearest = sorted(callout.places, key=lambda place: (-place[0] - place[2], -place[1]))[:MOST_PLACES]
    best: _Leader | None = None
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
            length = away - radius + end - elbow
            cost = length + (BEND if number else 0.0)
            bound = best.cost if best else inf
            if cost < bound:
                cost += HIT * _hits(run, circles, (*at, radius)) + CROSSED * _crossings(run, runs)
                cost += HIT * _along_axis(run, view)
            if cost < bound:
                best = _Leader(cost, run, top)
    return best


def _hits(run: tuple[Point, Point, Point], circles: Array, own: tuple[float, float, float]) -> int:
    """Number of circles, other than its own, that a leader crosses or passes within half a millimeter."""
    others = circles[np.any(np.abs(circles - own) > 1e-6, axis=-1)]
    near = np.zeros(len(others), dtype=bool)
    for a, b in ((run[0], run[1]), (run[1], run[2])):
        start, way = np.array(a), np.subtract(b, a)
        share = np.clip((others[:, :2] - start) @ way / max(float(way @ way), 1e-12), 0, 1)
        near |= np.hypot(*(others[:, :2] - start - share[:, None] * way).T) < others[:, 2] + 0.5
    return int(near.sum())


def _along_axis(run: tuple[Point, Point, Point], view: DrawingView) -> int:
    """Number of segments of a leader that lie on the x axis or close to it."""
    axis = view.at((0.0, 0.0))[1]
    legs = ((run[0], run[1]), (run[1], run[2]))
    return sum(max(abs(a[1] - axis), abs(b[1] - axis)) < 1.5 and abs(b[0] - a[0]) > 5 for a, b in legs)


def _crossings(run: tuple[Point, Point, Point], others: Sequence[tuple[Point, Point, Point]]) -> int:
    return int(np.sum(line_distances(run, others) < 0.5)) if others else 0


def _as_circles(boxes: Sequence[Box]) -> Array:
    """Circumscribed circles of boxes."""
    return np.array([((a + c) / 2, (b + d) / 2, hypot(c - a, d - b) / 2) for a, b, c, d in boxes]).reshape(-1, 3)


def _arrows(a: Point, b: Point, outside: bool, style: Style) -> list[Shape]:
    length = hypot(b[0] - a[0], b[1] - a[1])
    ux, uy = ((b[0] - a[0]) / length, (b[1] - a[1]) / length) if length else (1.0, 0.0)
    if not outside:
        return [Line((a, b), THIN), arrow(a, (-ux, -uy), style), arrow(b, (ux, uy), style)]
    far = 1.9 * style.head
    line = Line(((a[0] - far * ux, a[1] - far * uy), (b[0] + far * ux, b[1] + far * uy)), THIN)
    return [line, arrow(a, (ux, uy), style), arrow(b, (-ux, -uy), style)]


def _extension(start: Point, end: Point, style: Style) -> list[Shape]:
    """Extension line from just off an edge to just beyond the dimension line."""
    length = hypot(end[0] - start[0], end[1] - start[1])
    if length < OFF * style.scale:
        return []
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    off, beyond = OFF * style.scale, BEYOND * style.scale
    return [Line(((start[0] + off * ux, start[1] + off * uy), (end[0] + beyond * ux, end[1] + beyond * uy)), THIN)]


def _directed(points: Sequence[Point], counterclockwise: bool) -> list[Point]:
    area = sum(x * v - u * y for (x, y), (u, v) in pairwise((*points, points[0])))
    return list(points) if (area > 0) == counterclockwise else list(points)[::-1]
