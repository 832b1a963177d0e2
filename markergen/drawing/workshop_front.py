"""First page of a fabrication sheet: the marker from the front and from the side, with dimensions and callouts.

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
| name, process, scale, materials, page    |
+------------------------------------------+
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot

import numpy as np

from markergen.drawing.furniture import GRAY, Frame
from markergen.drawing.numbers import place_numbers
from markergen.drawing.scene import WHITE, Box, Disk, Point, Shape, bounds
from markergen.drawing.text import text, text_width
from markergen.drawing.workshop import Face, Label, Span, Workpiece, around
from markergen.drawing.workshop_callouts import place_callouts
from markergen.drawing.workshop_lines import (
    CLOSE,
    DARK,
    Style,
    View,
    across,
    arrow,
    center_circle,
    center_line,
    drawn,
    on_white,
    upright,
)

SCALES = (10, 5, 2, 1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200)
"""Of ISO 5455."""

LEAST_VIEW = 20.0
"""Size in mm on paper of the front view, below which it shows nothing."""

LEAST_NUMBER = 1.2
"""Height in mm of the smallest number of a dot; a smaller one is left out, and the table tells."""


@dataclass(frozen=True)
class Layout:
    """Where the two views go on a page, and at what scale."""

    scale: float
    front: View
    side: View
    callouts: Box


def lay_out(work: Workpiece, frame: Frame, room: Box) -> Layout | None:
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
        return Layout(scale, View(x, y, scale), View(x, z, scale), callouts)
    return None


def draw_front(work: Workpiece, layout: Layout, frame: Frame) -> list[Shape]:
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


def _axes(work: Workpiece, view: View, style: Style) -> list[Shape]:
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


def _numbers(work: Workpiece, view: View, style: Style) -> list[Shape]:
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


def label_ground(work: Workpiece, label: Label) -> str:
    """Color of what a number stands on: that of the uppermost face there."""
    over = [face for face in work.front if _within(face, label.x, label.y)]
    return DARK if over and over[-1].material == "dark" else WHITE


def _within(face: Face, x: float, y: float) -> bool:
    """Whether a point is inside of a face, by the crossings of a ray with its rings."""
    left, bottom, right, top = face.box
    if not (left < x < right and bottom < y < top):
        return False
    inside = False
    for ring in face.rings:
        for (ax, ay), (bx, by) in pairwise((*ring, ring[0])):
            if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
                inside = not inside
    return inside


def _edge_points(work: Workpiece, view: View) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Points along all edges of the front view, at most half a millimeter apart."""
    points: list[Point] = []
    for face in work.front:
        for ring in (*face.rings, *face.edges):
            for a, b in pairwise((*map(view.at, ring), view.at(ring[0]))):
                count = max(int(hypot(b[0] - a[0], b[1] - a[1]) / 0.5), 1)
                points += [(a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count) for k in range(count)]
    return np.array(points).reshape(-1, 2)


def _sizes(work: Workpiece, layout: Layout, style: Style) -> list[Shape]:
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


def stacked(spans: Sequence[Span], view: View, start: float, first: float, tier: float, style: Style) -> list[Shape]:
    """Dimensions along z in the order given, each a tier farther to the right."""
    shapes: list[Shape] = []
    for number, span in enumerate(spans):
        y0, y1 = (view.at((0.0, z))[1] for z in (span.start, span.end))
        shapes += upright(y0, y1, first + number * tier, start, span.words, style)
    return shapes


def millimeters(value: float) -> str:
    """Length in mm as it is written on a drawing: whole microns, no zeros behind."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")
