"""Symbols of technical drawings in mm on paper: tolerance frames, datum letters, boxed sizes, projection, finish."""
# tests: tests/workshop/drafting/test_rig_drawing.py tests/workshop/drafting/test_views.py

from collections.abc import Sequence
from itertools import pairwise
from math import cos, hypot, pi, sin

from markergen.drawing.scene import BLACK, Box, Line, Point, Shape, closed_line, frame_lines, polygon
from markergen.drawing.text import text_width
from markergen.workshop.drafting.drawing import Control
from markergen.workshop.drafting.pen import THIN, WORDS, Style, arrow, lettering

FRAME = 2.0
"""Height of a tolerance frame and of a datum's box, in cap heights."""

PAD = 0.45
"""Space beside words in a box, in cap heights."""

TRIANGLE = 0.9
"""Height of a datum's triangle in cap heights; it is about as wide."""

FRAMES_APART = 2.5
"""Distance between tolerance frames below each other, in cap heights."""


def phrase(label: str, x: float, y: float, height: float, name: str = WORDS) -> list[Shape]:
    """Line of words from (x, y) on; what stands in brackets is in a box instead, as theoretically exact."""
    shapes: list[Shape] = []
    for part, exact in _parts(label):
        pad = PAD * height if exact else 0.0
        word = lettering(part, x + pad, y, height, name=name)
        if part.strip():
            shapes.append(word)
        wide = text_width(part, height) + 2 * pad
        if exact:
            shapes.append(frame_lines((x, y - 0.4 * height, x + wide, y + 1.35 * height), THIN))
        x += wide + 0.5 * pad
    return shapes


def phrase_width(label: str, height: float) -> float:
    """Width of a line set by `phrase`."""
    return sum(text_width(part, height) + (2.5 * PAD * height if exact else 0.0) for part, exact in _parts(label))


def _parts(label: str) -> list[tuple[str, bool]]:
    parts: list[tuple[str, bool]] = []
    for piece in label.split("["):
        exact, bracket, rest = piece.partition("]")
        parts += [(exact, True), (rest, False)] if bracket else [(piece, False)]
    return [(part, exact) for part, exact in parts if part]


def frame_width(control: Control, height: float) -> float:
    """Width of a tolerance frame with the words before it."""
    return text_width(f"{control.of} ", height) * bool(control.of) + sum(_cells(control, height))


def tolerance_frame(control: Control, x: float, y: float, height: float) -> list[Shape]:
    """Tolerance frame (ISO 1101) whose words have their baseline at y; it starts at x with what it applies to."""
    shapes: list[Shape] = []
    if control.of:
        shapes.append(lettering(control.of, x, y, height))
        x += text_width(f"{control.of} ", height)
    low, high = y - (FRAME - 1) / 2 * height, y + (FRAME + 1) / 2 * height
    widths = _cells(control, height)
    shapes.append(frame_lines((x, low, x + sum(widths), high), THIN))
    shapes += _characteristic(control.symbol, x + widths[0] / 2, (low + high) / 2, height)
    x += widths[0]
    for cell, width in zip((control.zone, *control.datums), widths[1:], strict=True):
        shapes.append(Line(((x, low), (x, high)), THIN))
        shapes.append(lettering(cell, x + width / 2, y, height, "center"))
        x += width
    return shapes


def datum_letter(letter: str, foot: Point, direction: Point, height: float) -> list[Shape]:
    """Datum letter in its box, on a triangle whose base is at `foot`; both lie in a direction along an axis from it."""
    dx, dy = direction
    tall, half = TRIANGLE * height, 0.55 * height
    base = [(foot[0] - half * dy, foot[1] + half * dx), (foot[0] + half * dy, foot[1] - half * dx)]
    tip = foot[0] + tall * dx, foot[1] + tall * dy
    away = tall + 0.5 * height
    side = FRAME * height
    middle = foot[0] + (away + side / 2) * dx, foot[1] + (away + side / 2) * dy
    box = middle[0] - side / 2, middle[1] - side / 2, middle[0] + side / 2, middle[1] + side / 2
    return [
        polygon([*base, tip], "", BLACK),
        Line((tip, (foot[0] + away * dx, foot[1] + away * dy)), THIN),
        frame_lines(box, THIN),
        lettering(letter, middle[0], middle[1] - height / 2, height, "center", name=f"datum-{letter}"),
    ]


def datum_reach(height: float) -> float:
    """Distance from the foot of a datum's triangle to the far side of its box."""
    return (TRIANGLE + 0.5 + FRAME) * height


def face_datum(letter: str, control: Control, foot: Point, top: float, style: Style) -> list[Shape]:
    """Tolerance of a face, with an arrow from the frame down to `foot`, and below it the datum letter.

    The frame's words have their baseline at `top`; the letter is on the extension line through `foot`.
    """
    height = style.words
    x = foot[0]
    low = top - (FRAME - 1) / 2 * height
    width = frame_width(control, height)
    return [
        Line(((x, low), foot), THIN),
        arrow(foot, (0.0, -1.0), style),
        *tolerance_frame(control, x, top, height),
        *datum_letter(letter, (x + 0.6 * width, foot[1]), (0.0, -1.0), height),
    ]


def projection_symbol(x: float, y: float, height: float, first: bool) -> list[Shape]:
    """Symbol of first- or third-angle projection (ISO 5456-2) of a height, with its lower left corner at (x, y)."""
    middle, big, small = y + height / 2, height / 2, height / 4
    cone = x if first else x + 1.6 * height
    ring = x + 1.9 * height if first else x + height / 2
    end = cone + height
    # Both rings show from the left, the narrow end; in first-angle projection that view is on the right.
    sides = ((cone, middle - small), (end, middle - big), (end, middle + big), (cone, middle + small))
    shapes: list[Shape] = [closed_line(sides, THIN)]
    shapes += [_circle(ring, middle, radius) for radius in (big, small)]
    over = 0.12 * height
    shapes.append(Line(((cone - over, middle), (cone + height + over, middle)), THIN / 2))
    shapes.append(Line(((ring - big - over, middle), (ring + big + over, middle)), THIN / 2))
    shapes.append(Line(((ring, middle - big - over), (ring, middle + big + over)), THIN / 2))
    return shapes


def finish_symbol(x: float, y: float, height: float) -> list[Shape]:
    """Basic symbol of surface texture (ISO 21920-1) with its point at (x, y); `height` is that of the words beside."""
    run = ((x - 0.7 * height, y + 1.1 * height), (x, y), (x + 1.3 * height, y + 2.1 * height))
    return [Line(run, THIN)]


def _cells(control: Control, height: float) -> list[float]:
    """Widths of a frame's boxes: symbol, zone, and one for each datum."""
    cells = (control.zone, *control.datums)
    return [1.15 * FRAME * height, *(max(text_width(cell, height) + 2 * PAD * height, 1.8 * height) for cell in cells)]


def _characteristic(symbol: str, x: float, y: float, height: float) -> list[Shape]:
    """Symbol of a geometrical characteristic around (x, y)."""
    h = 0.7 * height
    if symbol == "position":
        over = 1.45 * h
        cross = [Line(((x - over, y), (x + over, y)), THIN), Line(((x, y - over), (x, y + over)), THIN)]
        return [_circle(x, y, 0.85 * h), *cross]
    if symbol == "flatness":
        corners = (
            (x - 1.3 * h, y - 0.7 * h),
            (x + 0.6 * h, y - 0.7 * h),
            (x + 1.3 * h, y + 0.7 * h),
            (x - 0.6 * h, y + 0.7 * h),
        )
        return [closed_line(corners, THIN)]
    if symbol == "perpendicularity":
        foot = y - 0.8 * h
        return [Line(((x - h, foot), (x + h, foot)), THIN), Line(((x, foot), (x, y + h)), THIN)]
    if symbol == "parallelism":
        lean = 0.45 * h
        return [Line(((x + d - lean, y - h), (x + d + lean, y + h)), THIN) for d in (-0.4 * h, 0.4 * h)]
    if symbol == "angularity":
        return [Line(((x + 0.9 * h, y + 0.7 * h), (x - h, y - 0.8 * h), (x + h, y - 0.8 * h)), THIN)]
    angles = [pi * k / 12 for k in range(13)]
    arc = [(x + 1.1 * h * cos(angle), y - 0.5 * h + 1.1 * h * sin(angle)) for angle in angles]
    return [closed_line(arc, THIN)]


def _circle(x: float, y: float, radius: float) -> Line:
    angles = [2 * pi * k / 32 for k in range(32)]
    return closed_line([(x + radius * cos(angle), y + radius * sin(angle)) for angle in angles], THIN)


def interrupted(shapes: Sequence[Shape], boxes: Sequence[Box], air: float) -> list[Shape]:
    """Lines without the pieces that come closer than `air` to boxes, so that they do not run through words."""
    wide = [(a - air, b - air, c + air, d + air) for a, b, c, d in boxes]
    kept: list[Shape] = []
    for shape in shapes:
        if not isinstance(shape, Line):
            kept.append(shape)
            continue
        for a, b in pairwise(shape.points):
            runs = [(0.0, 1.0)]
            for box in wide:
                hidden = _within(a, b, box)
                if hidden:
                    runs = [piece for run in runs for piece in _less(run, hidden)]
            for start, end in runs:
                if (end - start) * hypot(b[0] - a[0], b[1] - a[1]) > 0.05:
                    kept.append(Line((_along(a, b, start), _along(a, b, end)), shape.width, shape.name, shape.color))
    return kept


def _within(a: Point, b: Point, box: Box) -> tuple[float, float] | None:
    """Part of the segment from a to b that lies in a box, as shares of its length (Liang and Barsky)."""
    start, end = 0.0, 1.0
    for k in (0, 1):
        step = b[k] - a[k]
        low, high = box[k] - a[k], box[k + 2] - a[k]
        if abs(step) < 1e-12:
            if low > 0 or high < 0:
                return None
            continue
        first, last = sorted((low / step, high / step))
        start, end = max(start, first), min(end, last)
    return (start, end) if start < end else None


def _less(run: tuple[float, float], hidden: tuple[float, float]) -> list[tuple[float, float]]:
    pieces = [(run[0], min(run[1], hidden[0])), (max(run[0], hidden[1]), run[1])]
    return [piece for piece in pieces if piece[1] > piece[0]]


def _along(a: Point, b: Point, share: float) -> Point:
    return a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share
