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
from itertools import pairwise, product
from math import hypot, inf, radians, tan

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
    drawn,
    inside,
    leader,
    on_white,
    upright,
)
from markergen.drawing.fabrication_drawing import Callout, Dimension, DotLabel, Workpiece, around, millimeters
from markergen.drawing.label_placement import place_numbers
from markergen.drawing.paper import Frame
from markergen.drawing.scene import GRAY, WHITE, Box, Disk, Point, Shape, bounds
from markergen.drawing.text import text, text_width
from markergen.geometry.contour import flattened

Array = NDArray[np.float64]

SCALES = (10, 5, 2, 1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200)
"""Of ISO 5455."""

LEAST_VIEW = 20.0
"""Size in mm on paper of the front view, below which it shows nothing."""

NEAR = 0.05
"""Off an arc in mm of the marker: near enough to tell what a number stands on."""

LEAST_NUMBER = 1.2
"""Height in mm of the smallest number of a dot; a smaller one is left out, and the table tells."""

SLANTS = tuple(tan(radians(angle)) for angle in (30, 45, 60, 75))
"""Slopes of leaders that come to lie level before they reach their words."""

MOST_PLACES = 12
"""Of the features that are alike, those nearest to the words, which are tried."""

HIT, CROSSED, BEND = 100.0, 300.0, 2.0
"""What it costs, in mm of leader, to run across a feature or along the axis, across another leader, or to bend."""


@dataclass(frozen=True)
class ViewPlacement:
    """Where the two views go on a page, and at what scale."""

    scale: float
    front: DrawingView
    side: DrawingView
    callouts: Box


def lay_out(work: Workpiece, frame: Frame, room: Box) -> ViewPlacement | None:
    """Largest scale at which both views fit in a part of the page with what belongs to them; None if they do not."""
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
        # What is left over is shared out; the callouts stand beside the view, not at the page's far end.
        group = room[0] + (room[2] - room[0] - width - beside - column) / 2
        down = room[3] - room[1] - height - thick - above - gap - below
        x = group + 2.2 * tiers - scale * left
        y = room[3] - above - down * 0.4 - scale * top
        z = y + scale * bottom - gap - down * 0.2 - scale * head
        start = group + width + beside + 10 * frame.scale
        callouts = (start, room[1] + tiers, start + wide, room[3] - 2 * frame.scale)
        return ViewPlacement(scale, DrawingView(x, y, scale), DrawingView(x, z, scale), callouts)
    return None


def draw_front(work: Workpiece, layout: ViewPlacement, frame: Frame) -> list[Shape]:
    """Both views with dimensions, numbers and callouts."""
    style, view = Style(frame.scale), layout.front
    shapes: list[Shape] = []
    for face in work.front:
        shapes += drawn(face, view)
    shapes += _axes(work, view, style)
    shapes += _numbers(work, view, style)
    shapes += _sizes(work, layout, style)
    marks = [bounds(shape) for shape in shapes if shape.name]
    return shapes + place_callouts(work.callouts, view, layout.callouts, style, marks)


def _reach(work: Workpiece) -> Box:
    """Box around the front view and the origin."""
    left, bottom, right, top = around(work.front)
    return min(left, 0.0), min(bottom, 0.0), max(right, 0.0), max(top, 0.0)


def _axes(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """The marker frame: chain lines through the origin, with arrows at their positive ends."""
    left, bottom, right, top = view.box(_reach(work))
    x, y = view.at((0.0, 0.0))
    over = 4.5 * style.scale
    shapes: list[Shape] = [
        *center_line((left - over / 2, y), (right + over, y), style),
        *center_line((x, bottom - over / 2), (x, top + over), style),
        arrow((right + over, y), (1, 0), style),
        arrow((x, top + over), (0, 1), style),
        text("x", right + over + 0.8 * style.scale, y + 0.6 * style.scale, style.words, name="axis-x"),
        text("y", x + 1.2 * style.scale, top + over - style.words * 0.6, style.words, name="axis-y"),
    ]
    for callout in work.callouts:
        if callout.pitch:
            shapes += center_circle(x, y, view.scale * callout.pitch, style)
    return shapes


def _numbers(work: Workpiece, view: DrawingView, style: Style) -> list[Shape]:
    """Numbers in their dots where they fit, else beside them."""
    shapes: list[Shape] = []
    rest: list[tuple[str, Disk]] = []
    for label in work.labels:
        x, y = view.at((label.x, label.y))
        room = view.scale * (label.inner_radius or label.radius)
        width = text_width(label.words, 1.0)
        # Half the diagonal of the number, with some air, is at most the circle's radius.
        height = min(style.words, 0.85 * room / (hypot(width, 1.0) / 2))
        if height >= LEAST_NUMBER * style.scale:
            words = text(label.words, x, y - height / 2, height, "center", name=f"number-{label.words}")
            shapes += on_white(words, label_ground(work, label))
        else:
            # What has to stay free around the dot is the dot alone.
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
                shapes.append(text(name, *at, height, "center", name=f"number-{name}"))
    return shapes


def label_ground(work: Workpiece, label: DotLabel) -> str:
    """Color of what a number stands on: that of the uppermost face there."""
    at = label.x, label.y
    # Odd: in the outer contour and in none of its holes.
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
    """The side view, the overall size under it and beside the front view, and heights on the right."""
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
    shapes += stacked(work.heights, side, right, right + tier, tier, style)
    above = high + 1.5 * style.scale, left
    words = "seen from -y"
    shapes.append(text(words, above[1], above[0], 0.8 * style.words, color=GRAY, name="side-words"))
    return shapes


def stacked(
    spans: Sequence[Dimension], view: DrawingView, start: float, first: float, tier: float, style: Style
) -> list[Shape]:
    """Dimensions along z in the order given, each a tier farther to the right."""
    shapes: list[Shape] = []
    for number, span in enumerate(spans):
        y0, y1 = (view.at((0.0, z))[1] for z in (span.start, span.end))
        shapes += upright(y0, y1, first + number * tier, start, span.words, style)
    return shapes


@dataclass(frozen=True)
class _Leader:
    cost: float
    run: tuple[Point, Point, Point]
    """Tip, elbow, and end at the words."""
    top: float
    """Upper end of the words."""


def place_callouts(
    callouts: Sequence[Callout], view: DrawingView, column: Box, style: Style, marks: Sequence[Box] = ()
) -> list[Shape]:
    """Words and leaders; those with the fewest places to point at choose first.

    Parameters
    ----------
    callouts : sequence of Callout
    view : DrawingView
        What they point into.
    column : box
        Of the words, mm on paper; leaders come from its left.
    style : Style
    marks : sequence of box
        Words on paper that leaders should keep off.
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
            shapes.append(text(line, column[0], base, style.words, name=f"callout-{len(taken)}-{number}"))
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
    """Cheapest leader of all places, heights of the words and slants; None if no room is left for the words."""
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
    """How many circles but its own a leader runs across, or within half a millimeter of."""
    others = circles[np.any(np.abs(circles - own) > 1e-6, axis=-1)]
    near = np.zeros(len(others), dtype=bool)
    for a, b in ((run[0], run[1]), (run[1], run[2])):
        start, way = np.array(a), np.subtract(b, a)
        share = np.clip((others[:, :2] - start) @ way / max(float(way @ way), 1e-12), 0, 1)
        near |= np.hypot(*(others[:, :2] - start - share[:, None] * way).T) < others[:, 2] + 0.5
    return int(near.sum())


def _along_axis(run: tuple[Point, Point, Point], view: DrawingView) -> int:
    """How many pieces of a leader lie on the x axis or close beside it."""
    axis = view.at((0.0, 0.0))[1]
    legs = ((run[0], run[1]), (run[1], run[2]))
    return sum(max(abs(a[1] - axis), abs(b[1] - axis)) < 1.5 and abs(b[0] - a[0]) > 5 for a, b in legs)


def _crossings(run: tuple[Point, Point, Point], others: Sequence[tuple[Point, Point, Point]]) -> int:
    import shapely

    if not others:
        return 0
    lines = shapely.linestrings([np.array(other) for other in others])
    return int(np.sum(shapely.distance(shapely.LineString(run), lines) < 0.5))


def _as_circles(boxes: Sequence[Box]) -> Array:
    """Circles around boxes."""
    return np.array([((a + c) / 2, (b + d) / 2, hypot(c - a, d - b) / 2) for a, b, c, d in boxes]).reshape(-1, 3)
