"""Callouts: words in a column, and leaders from them that keep off everything else as well as they can."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import hypot, inf, radians, tan

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.scene import Box, Point, Shape
from markergen.drawing.text import text
from markergen.drawing.workshop import Callout
from markergen.drawing.workshop_lines import Style, View, leader

Array = NDArray[np.float64]

SLANTS = tuple(tan(radians(angle)) for angle in (30, 45, 60, 75))
"""Slopes of leaders that come to lie level before they reach their words."""

MOST_PLACES = 12
"""Of the features that are alike, those nearest to the words, which are tried."""

HIT, CROSSED, BEND = 100.0, 300.0, 2.0
"""What it costs, in mm of leader, to run across a feature or along the axis, across another leader, or to bend."""


@dataclass(frozen=True)
class _Leader:
    cost: float
    run: tuple[Point, Point, Point]
    """Tip, elbow, and end at the words."""
    top: float
    """Upper end of the words."""


def place_callouts(
    callouts: Sequence[Callout], view: View, column: Box, style: Style, marks: Sequence[Box] = ()
) -> list[Shape]:
    """Words and leaders; those with the fewest places to point at choose first.

    Parameters
    ----------
    callouts : sequence of Callout
    view : View
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
    view: View,
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


def _along_axis(run: tuple[Point, Point, Point], view: View) -> int:
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
