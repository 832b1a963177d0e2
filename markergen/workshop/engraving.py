"""Engraving on the back of a plate, read from behind: name, spec hash, tag, origin, x-axis and ids.

Letters are outlines of the sheet font with exact arcs for its curves, not the text of a CAD kernel: the fabrication
sheet shows them without a kernel, and they are the same on every machine.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import atan2, hypot, inf, tan

import numpy as np

from markergen.drawing.text import text, text_width
from markergen.geometry.contour import Contour, Point, center_of
from markergen.geometry.outlines import polygon
from markergen.geometry.region import Region
from markergen.model.marker import ControlPoint, Marker, marker_name
from markergen.solid.plate import grouped
from markergen.solid.primitives import Primitive, Prism, mm
from markergen.workshop.drafting.drawing import EngravedText
from markergen.workshop.manufacturability import FLOOR
from markergen.workshop.projection import plan

DEPTH = 0.3
"""Depth in mm: one or two layers of a printer, one pass of an engraver."""

WALL = 0.5
"""Minimum material in mm between the engraving and pockets above it."""

MARGIN = 1.0
"""Minimum distance in mm from edges, holes and other engraving."""

HEIGHTS = (6.0, 5.0, 4.0, 3.0, 2.5)
"""Heights of capital letters in mm, tried in order; strokes are a fifth as wide."""

LARGEST_ID, SMALLEST_ID = 4.0, 2.5
"""Maximum and minimum height in mm of the digits behind dots."""

STEPS = 32
"""Number of positions tried for the title along each axis."""

LINE = 1.6
"""Line spacing in cap heights."""

SMALLEST_SIDE = 1e-4
"""Minimum side of a letter in mm; flatter arcs become lines."""

SHAPE = 0.006
"""Maximum deviation of letters from their font in cap heights: invisible, and it halves the number of faces."""

MOST_BULGE = 0.8
"""Maximum bulge of one arc in a letter: nearly a half turn."""


@dataclass(frozen=True)
class Engraving:
    """Bodies to cut from the back, sentences about anything omitted, and what is written."""

    cut: tuple[Prism, ...] = ()
    notes: tuple[str, ...] = ()
    texts: tuple[EngravedText, ...] = ()


@dataclass(frozen=True)
class _Block:
    """A block to engrave: contours in plan view, outer ones counterclockwise, the box it occupies, and its text."""

    contours: tuple[Contour, ...]
    box: tuple[float, float, float, float]
    text: EngravedText | None = None


def engraving(marker: Marker, plate: Region, bottom: float, cut: Sequence[Primitive]) -> Engraving:
    """Engrave the back of a plate where there is room.

    Parameters
    ----------
    plate : Region
        Outline in mm.
    bottom : float
        Height of the back, mm.
    cut : sequence of Primitive
        All other bodies that are cut from the plate.
    """
    thickness, least = mm(marker.substrate.thickness), DEPTH + FLOOR
    if thickness < least:
        return Engraving(
            notes=(f"The back is not engraved: a plate of {thickness:.6g} mm is thinner than {least:.6g} mm.",)
        )
    deep = Region.union(plan(body) for body in cut if body.span[0] < bottom + DEPTH + WALL)
    room = _FreeBack(plate.offset(-MARGIN, segments=8) - deep.offset(MARGIN, segments=8))
    left, low, right, high = plate.box
    lacking = []
    if not room.take(_axes(min(1.0, max(right - left, high - low) / 60))):
        lacking.append("origin and x-axis")
    # Ids have fixed places; the title goes where they leave room, or else takes its room first.
    with_ids = room.copy()
    unnamed, titled = _ids(marker, with_ids), _title(marker, with_ids)
    if titled:
        room = with_ids
    elif _title(marker, room):
        unnamed = _ids(marker, room)
    else:
        room = with_ids
        lacking.append("name and spec hash")
    if unnamed:
        more = f" and {len(unnamed) - 5} more" if len(unnamed) > 5 else ""
        lacking.append(f"id{'s' * (len(unnamed) > 1)} {', '.join(unnamed[:5])}{more}")
    notes = (f"The back has no room for: {'; '.join(lacking)}.",) if lacking else ()
    letters = [piece for block in room.taken for piece in grouped(block.contours)]
    cuts = tuple(Prism(outer, tuple(holes), bottom, bottom + DEPTH) for outer, *holes in letters)
    return Engraving(cuts, notes, tuple(block.text for block in room.taken if block.text))


class _FreeBack:
    """Free room on the back, and the blocks that occupy some of it."""

    def __init__(self, free: Region, taken: Sequence[_Block] = ()) -> None:
        self._free = free
        self.taken = [*taken]

    def copy(self) -> "_FreeBack":
        """Return a copy, in which later blocks take room independently."""
        return _FreeBack(self._free, self.taken)

    def take(self, block: _Block) -> bool:
        """Place a block if its room is free; return whether it was."""
        box = Region.rectangle(*block.box)
        if not self._free.surrounds(box):
            return False
        self._free -= box.offset(MARGIN, "miter")
        self.taken.append(block)
        return True

    def take_somewhere(self, lines: Sequence[str], height: float) -> bool:
        """Place lines of text in the free room nearest to the middle; return whether there was any."""
        if not self._free:
            return False
        left, low, right, high = self._free.box
        x, y = (left + right) / 2, (low + high) / 2
        # Ordered from the upper left as seen from behind.
        dx, dy = np.meshgrid(*((np.arange(STEPS + 1) / STEPS - 0.5) * size for size in (left - right, low - high)))
        fits = self._free.surrounds_boxes(
            np.array(_lines(lines, x, y, height).box) + np.stack([dx, dy, dx, dy], axis=-1)
        )
        if not fits.any():
            return False
        best = np.unravel_index(np.argmin(np.where(fits, np.hypot(dx, dy).round(6), np.inf)), fits.shape)
        return self.take(_lines(lines, x + float(dx[best]), y + float(dy[best]), height))


def _title(marker: Marker, room: _FreeBack) -> bool:
    """Place the title in the largest letters that fit; return whether any do."""
    return any(room.take_somewhere(lines, height) for height in HEIGHTS for lines in _titles(marker))


def _ids(marker: Marker, room: _FreeBack) -> list[str]:
    """Place each id that fits; return the others."""
    points = marker.control_points
    return [str(point.id) for point in points if not any(room.take(block) for block in _behind(point, points))]


def _titles(marker: Marker) -> Iterator[tuple[str, ...]]:
    """Yield ways to break the title into lines."""
    name, spec = marker_name(marker).split("-", 1)
    tag = (str(marker.tag),) if marker.tag else ()
    yield (f"{name} {spec}", *tag)
    yield (name, spec, *tag)


def _behind(point: ControlPoint, points: Sequence[ControlPoint]) -> Iterator[_Block]:
    """Yield positions for a control point's id: behind its dot, else beside it where no other dot is closer."""
    x, y, size = point.x * 1e3, point.y * 1e3, point.feature.diameter * 1e3
    height = min(LARGEST_ID, 0.4 * size)
    if height >= SMALLEST_ID:
        yield _lines((str(point.id),), x, y, height)
    height = max(height, SMALLEST_ID)
    # A box extends 0.8 heights from its middle.
    away = size / 2 + 0.85 * height + MARGIN
    others = [(p.x * 1e3, p.y * 1e3) for p in points if p is not point]
    for dx, dy in ((0, -away), (0, away), (-away, 0), (away, 0)):
        if all(hypot(x + dx - u, y + dy - v) > 1.5 * away for u, v in others):
            yield _lines((str(point.id),), x + dx, y + dy, height)


def _axes(unit: float) -> _Block:
    """A cross at the origin whose x-axis is an arrow, labeled x."""
    half, arm, end = 0.4 * unit, 4.0 * unit, 14.0 * unit
    strokes = [
        Region.rectangle(-arm, -half, end - 2 * unit, half),
        Region.rectangle(-half, -arm, half, arm),
        Region.polygon([(end, 0), (end - 3 * unit, 1.5 * unit), (end - 3 * unit, -1.5 * unit)]),
    ]
    (corners,) = Region.union(strokes).oriented().rings
    letter = _lines(("x",), end + 3 * unit, 0.8 * unit, max(3 * unit, SMALLEST_ID))
    return _Block((polygon(corners), *letter.contours), (-arm, -arm, letter.box[2], arm))


def _lines(lines: Sequence[str], x: float, y: float, height: float) -> _Block:
    """Lines of text around (x, y), mirrored to be read from behind."""
    wide = max(text_width(line, height, "bold") for line in lines)
    tall = height * (1 + LINE * (len(lines) - 1))
    contours: list[Contour] = []
    for number, line in enumerate(lines):
        base = tall / 2 - height - number * LINE * height
        for letter in _outlines(line, height):
            points = tuple((round(x - u, 6), round(y + base + v, 6)) for u, v in letter.points)
            # Mirroring reverses the direction of turns.
            contours.append(Contour(points, tuple(-bulge for bulge in letter.bulges)))
    # Some letters have descenders.
    box = x - wide / 2, y - tall / 2 - 0.3 * height, x + wide / 2, y + tall / 2 + 0.1 * height
    return _Block(tuple(contours), box, EngravedText(tuple(lines), height, box))


def _outlines(line: str, height: float) -> Iterator[Contour]:
    """Outlines of a line of text around x = 0, with as few arcs as `SHAPE` allows."""
    begin = start = (0.0, 0.0)
    sides: list[tuple[Point, ...]] = []
    for command, points in text(line, 0.0, 0.0, height, "center", "bold").segments:
        (*control, end) = points or (begin,)
        if command == "M":
            begin, sides = end, []
        elif hypot(end[0] - start[0], end[1] - start[1]) > SMALLEST_SIDE:
            # At its middle a quadratic curve is halfway between its chord and its control point.
            middle = [((start[0] + 2 * u + end[0]) / 4, (start[1] + 2 * v + end[1]) / 4) for u, v in control]
            sides.append((start, *middle, end))
        start = end
        if command == "Z":
            yield _with_arcs(sides, SHAPE * height)


def _with_arcs(sides: Sequence[tuple[Point, ...]], off: float) -> Contour:
    """Contour of lines and arcs, each arc replacing as many consecutive three-point curves as possible."""
    points: list[Point] = []
    bulges: list[float] = []
    first = 0
    while first < len(sides):
        last, bulge = first, _bulge(sides[first]) if len(sides[first]) == 3 else 0.0
        while last + 1 < len(sides) and bulge and len(sides[last + 1]) == 3:
            run = [point for side in sides[first : last + 2] for point in side[:-1]] + [sides[last + 1][-1]]
            longer = _bulge((run[0], run[len(run) // 2], run[-1]))
            if not 0 < longer / bulge < inf or abs(longer) > MOST_BULGE or _off(run, longer) > off:
                break
            last, bulge = last + 1, longer
        points.append(sides[first][0])
        bulges.append(bulge)
        first = last + 1
    return Contour(tuple(points), tuple(bulges))


def _bulge(arc: Sequence[Point]) -> float:
    """Bulge of the arc through three points, from the angle at the middle one."""
    (x, y), (u, v), (p, q) = arc
    cross = (x - u) * (q - v) - (y - v) * (p - u)
    dot = (x - u) * (p - u) + (y - v) * (q - v)
    flat = abs(cross) < SMALLEST_SIDE * hypot(p - x, q - y)
    return 0.0 if flat else -tan(atan2(cross, -dot) / 2)


def _off(run: Sequence[Point], bulge: float) -> float:
    """Maximum distance of points from the circle of an arc between the first and the last one."""
    x, y = center_of((run[0], run[-1], bulge))
    distances = [hypot(u - x, v - y) for u, v in run]
    return max(abs(distance - distances[0]) for distance in distances)
