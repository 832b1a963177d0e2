"""Drafting in mm on paper: lettering, dimensions, center lines and hatching."""
# tests: tests/workshop/drafting/test_views.py

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, dist, hypot, pi, sin, sqrt

import numpy as np

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
    closed_line,
    filled,
    frame_lines,
    polygon,
    rectangle,
    rotated,
)
from markergen.drawing.text import SHIFT, text, text_width
from markergen.geometry.contour import Contour, area, flattened
from markergen.geometry.region import Region
from markergen.workshop.drafting.drawing import ViewFace

THICK, THIN = 0.4, 0.18
"""Line widths in mm of visible edges, and of dimension, center and other thin lines (ISO 128)."""

DARK = "#b9b9b9"
"""Fill of dark parts: pale enough for numbers on it, and not to be mistaken for the marker."""

FILLS = {"dark": DARK, "engraved": BLACK}
"""Fill of a face that is seen, by its material; a cut face is hatched only."""

WORDS = "words"
"""Default name of text; text with a name of its own goes into the layer of texts."""

CLOSE = 6.0
"""Distance in mm between dimension lines, on A4."""

SMOOTH = 2e-3
"""Maximum distance in mm on paper of a drawn line from its arc."""

OFF, BEYOND = 0.8, 1.5
"""Gap between an edge and its extension line, and overshoot beyond the dimension line, mm on A4."""


LETTERS = 2.5
"""Minimum cap height in mm of what is written on a drawing (ISO 3098), on any paper."""


@dataclass(frozen=True)
class Style:
    """Sizes in mm on the sheet's paper; `scale` is 1 on A4, and no letters are smaller than `least`."""

    scale: float = 1.0
    least: float = LETTERS

    @property
    def words(self) -> float:
        """Cap height of dimensions."""
        return max(2.1 * self.scale, self.least)

    @property
    def small(self) -> float:
        """Cap height of tables and notes."""
        return max(1.75 * self.scale, self.least)

    def smaller(self) -> "Style":
        """Style for more than there is room for."""
        return Style(0.9 * self.scale, 0.9 * self.least)

    @property
    def head(self) -> float:
        """Length of an arrowhead."""
        return 2.3 * self.scale


@dataclass(frozen=True)
class Lettering(FilledPath):
    """Line of words as outlines, with the data needed to write them as text in a format with fonts.

    Attributes
    ----------
    start : (x, y)
        Start of the baseline, mm.
    height : float
        Cap height, mm.
    upright : bool
        True if it reads upward, from the right side of the sheet.
    face : {"regular", "bold"}
    """

    text: str = ""
    start: Point = (0.0, 0.0)
    height: float = 1.0
    upright: bool = False
    face: str = "regular"


def lettering(
    label: str,
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
    path = text(label, x, y, height, align, face, color, name)
    back = SHIFT[align] * text_width(label, height, face)
    start = (x, y - back) if upright else (x - back, y)
    segments = (rotated(path, x, y) if upright else path).segments
    return Lettering(segments, name, color, label, start, height, upright, face)


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
    """Draw a face with its outline and edges; a cut face is hatched instead, and letters are black all over."""
    fill = FILLS.get(face.material, WHITE) if not hatched else WHITE
    rings = [view.trace(contour) for contour in face.contours]
    # For the nonzero fill rule a ring inside an odd number of others is a hole and must run clockwise.
    outer = [sum(inside(ring[0], other) for other in rings if other is not ring) % 2 == 0 for ring in rings]
    are_positive = [area(contour) > 0 for contour in face.contours]
    ways = (
        r if is_positive == whole else r[::-1] for r, is_positive, whole in zip(rings, are_positive, outer, strict=True)
    )
    shapes: list[Shape] = [filled(ways, "", fill)]
    if hatched:
        return shapes + hatching(face, view, style or Style())
    if face.material == "engraved":
        return shapes
    width = THIN / 2 if face.fine else THICK
    shapes += [closed_line(ring, width) for ring in rings]
    return shapes + [closed_line(view.trace(edge), THIN) for edge in face.edges]


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


def center_line(a: Point, b: Point, style: Style) -> list[Shape]:
    """Chain line: alternating long and short dashes, with a long one at both ends."""
    long, gap, short = 6.0 * style.scale, 1.0 * style.scale, 0.6 * style.scale
    length = hypot(b[0] - a[0], b[1] - a[1])
    if length < 2 * long:
        return [Line((a, b), THIN)]
    count = max(int((length - long) / (long + 2 * gap + short)), 1)
    long = (length - count * (2 * gap + short)) / (count + 1)
    shapes: list[Shape] = []

    def part(start: float, end: float) -> Line:
        ends = ((a[0] + (b[0] - a[0]) * at / length, a[1] + (b[1] - a[1]) * at / length) for at in (start, end))
        return Line(tuple(ends), THIN)

    at = 0.0
    for _ in range(count):
        shapes += [part(at, at + long), part(at + long + gap, at + long + gap + short)]
        at += long + 2 * gap + short
    return [*shapes, part(at, length)]


def center_circle(x: float, y: float, radius: float, style: Style) -> list[Shape]:
    """Chain line along a circle on paper."""
    dash = 5.0 * style.scale
    count = max(int(2 * pi * radius / (1.6 * dash)), 8)
    step = 2 * pi / count
    shapes: list[Shape] = []
    for k in range(count):
        for start, end in ((0.0, 0.66), (0.79, 0.87)):
            angles = [(k + start + (end - start) * i / 12) * step for i in range(13)]
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
    x0: float, x1: float, y: float, from_y: float | tuple[float, float], label: str, style: Style
) -> list[Shape]:
    """Horizontal dimension between two positions on paper, on a line at height y; extension lines start at `from_y`."""
    starts = from_y if isinstance(from_y, tuple) else (from_y, from_y)
    shapes: list[Shape] = []
    for x, start in zip((x0, x1), starts, strict=True):
        shapes += _extension((x, start), (x, y), style)
    width = text_width(label, style.words)
    outside = x1 - x0 < 2.6 * style.head
    beside = width > x1 - x0 - (0 if outside else 2 * style.head * 0.5)
    shapes += _arrows((x0, y), (x1, y), outside, style)
    if beside:
        # To the right of the arrows, on an extended dimension line.
        start = x1 + (1.9 * style.head if outside else 0.0)
        ground, *written = _size(label, start + style.scale, y + 0.7 * style.scale, style)
        shapes += [ground, Line(((x1, y), (start + width + 1.5 * style.scale, y)), THIN), *written]
    else:
        shapes += _size(label, (x0 + x1) / 2, y + 0.7 * style.scale, style, "center")
    return shapes


def vertical_dimension(
    y0: float, y1: float, x: float, from_x: float | tuple[float, float], label: str, style: Style
) -> list[Shape]:
    """Vertical dimension between two heights on paper, on a line at x; its text reads from the right."""
    starts = from_x if isinstance(from_x, tuple) else (from_x, from_x)
    shapes: list[Shape] = []
    for y, start in zip((y0, y1), starts, strict=True):
        shapes += _extension((start, y), (x, y), style)
    width = text_width(label, style.words)
    outside = y1 - y0 < 2.6 * style.head
    shapes += _arrows((x, y0), (x, y1), outside, style)
    if width > y1 - y0 - style.head:
        # Horizontal above the upper arrow, where there is room.
        top = y1 + (1.9 * style.head if outside else 0.6 * style.scale)
        shapes.append(Line(((x, y1), (x, top + style.scale * 0.3)), THIN))
        shapes += _size(label, x, top + 0.9 * style.scale, style, "center")
    else:
        shapes += _size(label, x - 0.7 * style.scale, (y0 + y1) / 2, style, "center", upright=True)
    return shapes


def beside(label: str, length: float, style: Style) -> float:
    """Half of the width that the words of an upright dimension of a length take across it."""
    width = text_width(label, style.words)
    return width / 2 if width > length - style.head else style.words + 0.7 * style.scale


def _size(label: str, x: float, y: float, style: Style, align: str = "left", upright: bool = False) -> list[Shape]:
    """Words of a dimension on white; in brackets they are theoretically exact, and in a box."""
    exact = label.startswith("[")
    # The box must not touch the dimension line.
    off = 0.5 * style.scale if exact else 0.0
    at = (x - off, y) if upright else (x, y + off)
    word = lettering(label.strip("[]"), *at, style.words, align, upright)
    if not exact:
        return on_white(word)
    left, bottom, right, top = bounds(word)
    pad = 0.3 * style.words
    return [*on_white(word), frame_lines((left - pad, bottom - pad, right + pad, top + pad), THIN)]


def on_white(label: Lettering) -> list[Shape]:
    """Words on a background of their own, so that no line runs through them."""
    left, bottom, right, top = bounds(label)
    return [rectangle((left - 0.3, bottom - 0.25, right + 0.3, top + 0.25), "", WHITE), label]


def leader(tip: Point, elbow: Point, end: Point, style: Style) -> list[Shape]:
    """Leader line from the words via an elbow to a point, with an arrowhead there."""
    return [
        Line((elbow, end), THIN),
        Line((tip, elbow), THIN),
        arrow(tip, (tip[0] - elbow[0], tip[1] - elbow[1]), style),
    ]


def scale_words(scale: float) -> str:
    """Scale in words, such as ``1 : 2``."""
    return f"{scale:g} : 1" if scale >= 1 else f"1 : {round(1 / scale):g}"


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
