"""Callouts: words and tolerance frames in a column, with leaders into a view that keep clear of what is drawn there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import hypot, radians, tan

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.scene import Box, Line, Point, Shape
from markergen.geometry.region import line_distances
from markergen.workshop.drafting.drawing import Callout
from markergen.workshop.drafting.pen import DrawingView, Style, leader
from markergen.workshop.drafting.symbols import (
    FRAMES_APART,
    datum_letter,
    datum_reach,
    frame_width,
    phrase,
    phrase_width,
    tolerance_frame,
)

Array = NDArray[np.float64]

SLANTS = tuple(tan(radians(angle)) for angle in (30, 45, 60, 75))
"""Slopes of leaders in front of their horizontal landing."""

MOST_PLACES = 12
"""Maximum number of identical features, nearest to the words first, to which a leader is tried."""

HIT, CROSSED, BEND = 100.0, 300.0, 2.0
"""Costs of a leader, as mm of length: crossing a feature or running along the axis, crossing a leader, and a bend."""


TRIES = 3
"""Number of orders in which callouts choose their places; the one with the least cost is taken."""

LINES_APART = 1.75
"""Distance between lines of words, in cap heights."""


@dataclass(frozen=True)
class _Leader:
    cost: float
    run: tuple[Point, Point, Point]
    """Tip, elbow and end at the words."""
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


def place_callouts(
    callouts: Sequence[Callout],
    view: DrawingView,
    column: Box,
    style: Style,
    marks: Sequence[Box] = (),
    lines: Sequence[Line] = (),
) -> list[Shape]:
    """Place the words and leaders of callouts; those with the fewest features to point at choose first.

    Parameters
    ----------
    view : DrawingView
        View that the leaders point into.
    column : box
        Column for the words, mm on paper; leaders start on its left.
    marks, lines : sequence
        Boxes of words, and lines on paper, that leaders should avoid.
    """
    circles = np.array([(*view.at((x, y)), view.scale * r) for each in callouts for x, y, r in each.places])
    room = _Room(
        view, column, 1.4 * style.words, style,
        np.concatenate([circles.reshape(-1, 3), _as_circles(marks)]),
        np.array([pair for line in lines for pair in pairwise(line.points)]).reshape(-1, 2, 2),
    )  # fmt: skip
    placed = _placed(callouts, room)
    while placed is None:
        # One below the other, in the order of what they point at, and smaller if there are too many.
        total = sum(callout_height(each, style) for each in callouts) + room.gap * (len(callouts) - 1)
        if total > column[3] - column[1]:
            style = Style(0.9 * style.scale)
        room = replace(room, gap=1.2 * style.words, style=style)
        placed = _stacked(callouts, room)
    shapes: list[Shape] = []
    for number, (callout, best) in enumerate(placed, 1):
        shapes += leader(*best.run, style)
        shapes += _written(callout, column[0], best.top, style, f"callout-{number}")
    return shapes


def _placed(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts where their leaders are best; None if there is no room for one of them."""
    orders = [sorted(callouts, key=lambda each: len(each.places))]
    found: list[list[tuple[Callout, _Leader]]] = []
    while len(found) < TRIES:
        placed = _in_order(orders[-1], room)
        if placed is None:
            break
        found.append(placed)
        if max((best.cost for _, best in placed), default=0.0) < HIT:
            break
        # What got the worst place chooses first the next time.
        orders.append([callout for callout, _ in sorted(placed, key=lambda each: -each[1].cost)])
    if found and max((best.cost for _, best in found[-1]), default=0.0) >= HIT:
        column_order = _stacked(callouts, room)
        found += [column_order] if column_order else []
    return min(found, key=lambda each: sum(best.cost for _, best in each), default=None)


def _in_order(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts each at the best place that those before it leave; None if there is none."""
    column, style, gap = room.column, room.style, room.gap
    taken: list[tuple[float, float]] = []
    found: list[tuple[Callout, _Leader]] = []
    for callout in callouts:
        height = callout_height(callout, style)
        tops = [
            top
            for top in np.arange(column[1] + height, column[3] + 1e-9, 2.0 * style.scale).tolist()
            if not any(top - height < upper + gap and top > lower - gap for lower, upper in taken)
        ]
        best = _best(callout, room, tops, [each.run for _, each in found])
        if best is None:
            return None
        taken.append((best.top - height, best.top))
        found.append((callout, best))
    return found


def _stacked(callouts: Sequence[Callout], room: _Room) -> list[tuple[Callout, "_Leader"]] | None:
    """Callouts one below the other; None if they are too high together."""
    top = room.column[3]
    found: list[tuple[Callout, _Leader]] = []
    for callout in sorted(callouts, key=lambda each: -max(place[1] for place in each.places)):
        height = callout_height(callout, room.style)
        if top - height < room.column[1]:
            return None
        runs = [each.run for _, each in found]
        best = _best(callout, room, [top], runs) or _direct(callout, room, top)
        found.append((callout, best))
        top -= height + room.gap
    return found


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
    return _Leader(CROSSED, (tip, elbow, end), top)


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


def _best(
    callout: Callout, room: _Room, tops: Sequence[float], runs: Sequence[tuple[Point, Point, Point]]
) -> _Leader | None:
    """Cheapest leader over all features, heights of the words and slopes; None if there is none."""
    view, style, end = room.view, room.style, room.column[0] - 1.2 * room.style.scale
    nearest = sorted(callout.places, key=lambda place: (-place[0] - place[2], -place[1]))[:MOST_PLACES]
    candidates: list[tuple[float, _Leader, tuple[float, float, float]]] = []
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
            candidates.append((length, _Leader(length, run, top), (*at, radius)))
    best: _Leader | None = None
    # What a leader hits is only looked for if it may still be the best: the shortest come first.
    for length, each, own in sorted(candidates, key=lambda candidate: candidate[0]):
        if best and length >= best.cost:
            break
        cost = length + HIT * _along_axis(each.run, view) + CROSSED * _crossings(each.run, runs)
        cost += HIT * _hits(each.run, room, own)
        if best is None or cost < best.cost:
            best = replace(each, cost=cost)
    return best


def _hits(run: tuple[Point, Point, Point], room: _Room, own: tuple[float, float, float]) -> int:
    """Number of circles, other than its own, within half a millimeter of a leader, and of lines that it crosses."""
    others = room.circles[np.any(np.abs(room.circles - own) > 1e-6, axis=-1)]
    near = np.zeros(len(others), dtype=bool)
    crossed = 0
    a, b = room.segments[:, 0], room.segments[:, 1]
    for first, last in ((run[0], run[1]), (run[1], run[2])):
        start, end = np.array(first), np.array(last)
        way = end - start
        share = np.clip((others[:, :2] - start) @ way / max(float(way @ way), 1e-12), 0, 1)
        near |= np.hypot(*(others[:, :2] - start - share[:, None] * way).T) < others[:, 2] + 0.5
        # Two segments cross where the ends of each are on both sides of the other.
        apart = _side(start, end, a) * _side(start, end, b) < 0
        crossed += int(np.sum(apart & (_side(a, b, start) * _side(a, b, end) < 0)))
    return int(near.sum()) + crossed


def _side(a: Array, b: Array, point: Array) -> Array:
    """Twice the signed area of a triangle: positive if the point is to the left of the line from a to b."""
    return np.asarray((b - a)[..., 0] * (point - a)[..., 1] - (b - a)[..., 1] * (point - a)[..., 0])


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
