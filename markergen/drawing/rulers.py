"""Rulers along x and y, and where a sheet has room for them."""

from collections.abc import Iterable, Sequence
from math import sqrt

from markergen.drawing.furniture import FINE, Drawn, ink_points
from markergen.drawing.numbers import quiet_radius
from markergen.drawing.scene import Box, Disk, Line, Point, Shape, bounds
from markergen.drawing.text import text
from markergen.drawing.transform import shifted, turned

LENGTHS = (200, 150, 100, 50, 20)
"""Of rulers in mm, the best first."""

BAND = 3.8
"""Width of a ruler whose numbers stand beside its ticks, mm on A4."""

AIR = 0.8
"""Between a ruler and what is beside it, mm on A4."""

LONG, SHORT, DIGITS = 3.2, 1.8, 1.5
"""Heights of ticks and numbers, mm on A4."""

Span = tuple[float, float]


def ruler(
    start: Point, length: int, axis: int, scale: float, factor: float = 1.0, inward: int = 1, name: str = "ruler"
) -> Drawn:
    """Ruler from `start` along x (axis 0) or y (1), a tick every 10 mm, a number at every 50 (20 on short ones).

    Parameters
    ----------
    start : (x, y)
    length : int
        What it is to measure, mm; drawn `factor` times as long.
    axis : int
    scale : float
        Of ticks and numbers.
    factor : float
    inward : int
        Side of the base line that its ticks are on: 1 up or right, -1 down or left.
    name : str
    """

    def at(along: float, aside: float) -> Point:
        along, aside = along * factor, aside * inward * scale
        return (start[0] + along, start[1] + aside) if axis == 0 else (start[0] + aside, start[1] + along)

    marks: list[Shape] = [Line((at(0, 0), at(length, 0)), FINE, name)]
    texts: list[Shape] = []
    step, height = (50 if length >= 50 else length), DIGITS * scale
    for mm in range(0, length + 1, 10):
        marks.append(Line((at(mm, 0), at(mm, LONG if mm % step == 0 else SHORT)), FINE, f"{name}-{mm}"))
        if mm == 0 or mm % step:
            continue
        # Before its tick and above the short ones, so that the whole ruler keeps to a narrow band.
        words = f"{mm} mm" if mm == length else str(mm)
        low = (SHORT + 0.4) * scale
        near = low if inward > 0 else -low - height
        x, y = start[0] + (mm * factor if axis == 0 else 0), start[1] + (mm * factor if axis == 1 else 0)
        if axis == 0:
            texts.append(text(words, x - 0.7 * scale, y + near, height, "right", name=f"{name}-number-{mm}"))
        else:
            upright = text(words, x - 0.7 * scale, y, height, "right", name=f"{name}-number-{mm}")
            texts.append(shifted(turned(upright, x, y), near + height, 0.0))
    return marks, texts


def placed(
    strips: Sequence[tuple[Box, int]],
    axis: int,
    scale: float,
    factor: float,
    disks: Iterable[Disk],
    shapes: Iterable[Shape],
    name: str,
) -> tuple[int, Drawn]:
    """Longest ruler of `LENGTHS` that one of the strips of a page has room for, and its length; 0 if none has.

    Parameters
    ----------
    strips : sequence of (box, inward)
        Where it may stand, the best first, each `BAND * scale` wide: from its base line inward (1 up or right).
    axis : int
        0 along x, 1 along y.
    scale, factor : float
        See `ruler`.
    disks : iterable of Disk
        Dots; it keeps out of their quiet zones.
    shapes : iterable of Shape
        All else that it must not touch.
    name : str
    """
    dots, others = list(disks), list(shapes)
    free = [(strip, inward, _free(strip, axis, dots, others, AIR * scale)) for strip, inward in strips]
    for length in LENGTHS:
        for strip, inward, spans in free:
            for low, high in spans:
                if high - low >= length * factor + FINE:
                    base = strip[1 - axis] if inward > 0 else strip[3 - axis]
                    begin = low + FINE / 2
                    start = (begin, base) if axis == 0 else (base, begin)
                    return length, ruler(start, length, axis, scale, factor, inward, name)
    return 0, ([], [])


def _free(strip: Box, axis: int, disks: Sequence[Disk], shapes: Sequence[Shape], air: float) -> list[Span]:
    """Spans along a strip that nothing blocks."""
    low, high = strip[1 - axis], strip[3 - axis]
    blocked: list[Span] = []
    for disk in disks:
        along, aside = (disk.x, disk.y) if axis == 0 else (disk.y, disk.x)
        gap, reach = max(low - aside, aside - high, 0.0), quiet_radius(disk)
        if gap < reach:
            half = sqrt(reach**2 - gap**2)
            blocked.append((along - half, along + half))
    for shape in shapes:
        if isinstance(shape, Line) and len(shape.points) > 2:
            points = ink_points([shape])
            near = points[(points[:, 1 - axis] > low - air) & (points[:, 1 - axis] < high + air), axis]
            blocked += [(float(place) - 1 - air, float(place) + 1 + air) for place in near]
        else:
            box = bounds(shape)
            if box[1 - axis] < high + air and box[3 - axis] > low - air:
                blocked.append((box[axis] - air, box[axis + 2] + air))
    spans, place = [], strip[axis]
    for begin, end in [*sorted(blocked), (strip[axis + 2], strip[axis + 2])]:
        if begin > place:
            spans.append((place, min(begin, strip[axis + 2])))
        place = max(place, end)
    return spans
