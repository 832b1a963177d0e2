"""Closed contours of straight lines and arcs, stored as in DXF and CAD kernels: corners, and a bulge for each side.

The bulge of a side is the tangent of a quarter of its arc's angle, counterclockwise positive: 0 for a straight line, 1
for a semicircle to the left. Lengths are in any consistent unit. `filleted` rounds corners between lines and arcs.
"""
# tests: tests/geometry/test_contour.py tests/geometry/test_fillet.py

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import acos, asin, atan, atan2, ceil, copysign, cos, hypot, inf, pi, remainder, sin, sqrt, tan

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError

Point = tuple[float, float]
Side = tuple[Point, Point, float]
"""Start, end and bulge."""

COARSEST = pi / 4
"""Maximum angle in rad of an arc replaced by one chord."""

MOST_CHORDS = 100_000
"""Maximum number of chords for the arcs of one contour."""


@dataclass(frozen=True)
class Contour:
    """Closed contour of straight lines and arcs.

    Attributes
    ----------
    points : tuple of (x, y)
        Corners, without repeating the first; counterclockwise, or clockwise around a hole. Two suffice if a side is an
        arc.
    bulges : tuple of float
        Bulges of the sides from each corner to the next one, the last one to the first. Empty if all are straight.
    about : (x, y, radius) or None
        Exact center and radius of a full circle made by `circle`, because its corners have lost digits of them.

    Examples
    --------
    >>> area(Contour(((1.0, 0.0), (-1.0, 0.0)), (1.0, 1.0)))
    3.141592653589793
    """

    points: tuple[Point, ...]
    bulges: tuple[float, ...] = ()
    about: tuple[float, float, float] | None = field(default=None, repr=False, compare=False)

    @property
    def has_arcs(self) -> bool:
        """True if at least one side is an arc."""
        return any(self.bulges)

    @property
    def is_circle(self) -> bool:
        """True if the contour consists of two semicircles."""
        return self.bulges in ((1.0, 1.0), (-1.0, -1.0))

    @property
    def sides(self) -> list[Side]:
        """All sides, starting at the first corner."""
        bulges = self.bulges or (0.0,) * len(self.points)
        return list(zip(self.points, (*self.points[1:], *self.points[:1]), bulges, strict=True))

    @property
    def as_circle(self) -> tuple[float, float, float] | None:
        """Center x, y and radius of a circle; None for any other contour."""
        if self.about or not self.is_circle:
            return self.about
        (x, y), (u, v) = self.points
        return (x + u) / 2, (y + v) / 2, hypot(x - u, y - v) / 2


def circle(radius: float, x: float = 0.0, y: float = 0.0, hole: bool = False) -> Contour:
    """Full circle made of two semicircles; clockwise for a hole."""
    sign = -1.0 if hole else 1.0
    return Contour(((x + radius, y), (x - radius, y)), (sign, sign), (x, y, radius))


def rings_and_circles(contours: Iterable[Contour]) -> tuple[list[Array], Array]:
    """Split contours into polygons (m, 2) without arcs, and full circles (c, 4) as center x, y, radius and side.

    The side is 1 for a circle with its interior to its left, and -1 for one around a hole.
    """
    rings, circles = [], []
    for contour in contours:
        if (whole := contour.as_circle) is None:
            rings.append(np.array(contour.points, dtype=float))
        else:
            circles.append((*whole, contour.bulges[0]))
    return rings, np.array(circles, dtype=float).reshape(-1, 4)


def center_of(side: Side) -> Point:
    """Center of an arc side: to the left of its chord for a left turn of less than half a turn."""
    (x, y), (u, v), bulge = side
    # The chord c is 2 r sin(a/2) of an arc a; with bulge b = tan(a/4), cot(a/2) = (1 - b^2) / (2 b), and the center is
    # c/2 cot(a/2) off the chord.
    away = (1 - bulge**2) / (4 * bulge)
    return (x + u) / 2 - (v - y) * away, (y + v) / 2 + (u - x) * away


def radius_of(side: Side) -> float:
    """Radius of a side; infinite for a straight line."""
    (x, y), (u, v), bulge = side
    # sin(a/2) = 2 b / (1 + b^2) for a bulge b = tan(a/4).
    return hypot(u - x, v - y) * (1 + bulge**2) / (4 * abs(bulge)) if bulge else inf


def tangent(side: Side, end: bool) -> Point:
    """Unit tangent of a side at its end or its start."""
    (x, y), (u, v), bulge = side
    length = ((u - x) ** 2 + (v - y) ** 2) ** 0.5
    # Chord and tangent differ by half of the arc's angle, which is 4 atan(bulge).
    angle = 2 * atan(bulge) * (1 if end else -1)
    dx, dy = (u - x) / length, (v - y) / length
    return dx * cos(angle) - dy * sin(angle), dx * sin(angle) + dy * cos(angle)


def turns_of(contour: Contour) -> list[float]:
    """Angle in rad, positive to the left, by which the contour turns at each of its corners; 0 where it is smooth."""
    sides = contour.sides
    angles = []
    for before, after in zip((sides[-1], *sides[:-1]), sides, strict=True):
        (ax, ay), (bx, by) = tangent(before, end=True), tangent(after, end=False)
        angles.append(atan2(ax * by - ay * bx, ax * bx + ay * by))
    return angles


def area(contour: Contour) -> float:
    """Signed area, positive if counterclockwise: shoelace formula, and a circular segment for each arc."""
    total = 0.0
    for (x, y), (u, v), bulge in contour.sides:
        chord = (u - x) ** 2 + (v - y) ** 2
        total += (x * v - u * y) / 2
        if bulge:
            angle = 4 * atan(bulge)
            # r^2 (a - sin a) / 2 with r = c / (2 sin(a/2)); the sign of the angle decides the side.
            total += chord * (angle - sin(angle)) / (8 * sin(angle / 2) ** 2)
    return total


def box(contour: Contour) -> tuple[float, float, float, float]:
    """Left, lower, right and upper end, including the extreme points of arcs."""
    points = list(contour.points)
    for side in contour.sides:
        (x, y), _, bulge = side
        if not bulge:
            continue
        cx, cy = center_of(side)
        radius, angle = hypot(x - cx, y - cy), 4 * atan(bulge)
        start = atan2(y - cy, x - cx)
        for k in range(4):
            swept = (k * pi / 2 - start) * (1 if angle > 0 else -1) % (2 * pi)
            if swept < abs(angle):
                points.append((cx + radius * (1, 0, -1, 0)[k], cy + radius * (0, 1, 0, -1)[k]))
    xs, ys = zip(*points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def flattened(contour: Contour, off: float) -> list[Point]:
    """Vertices of a polygon inscribed in the contour's arcs, within a distance `off` of them."""
    return divided(contour, chord_counts(contour, off))


def chord_counts(contour: Contour, off: float, largest: float = COARSEST) -> list[int]:
    """Number of chords for each side, within a distance `off` of it and of at most the `largest` angle in rad."""
    return [
        ceil(abs(4 * atan(side[2])) / min(2 * acos(max(1 - off / radius_of(side), 0.0)), largest)) if side[2] else 1
        for side in contour.sides
    ]


def divided(contour: Contour, counts: Sequence[int]) -> list[Point]:
    """Vertices of an inscribed polygon with the given number of chords for each side."""
    points: list[Point] = []
    for ((x, y), (u, v), bulge), count in zip(contour.sides, counts, strict=True):
        points.append((x, y))
        angle = 4 * atan(bulge)
        for k in range(1, count):
            # Length of the chord to the point at this part of the angle, and its rotation from the full chord.
            part = angle * k / count
            scale, rotation = sin(part / 2) / sin(angle / 2), (part - angle) / 2
            points.append(
                (
                    x + scale * ((u - x) * cos(rotation) - (v - y) * sin(rotation)),
                    y + scale * ((u - x) * sin(rotation) + (v - y) * cos(rotation)),
                )
            )
    return points


def inner_polygon(contour: Contour, off: float) -> Array:
    """Vertices (m, 2) of a polygon within a distance `off` of the contour that never leaves the contour's left side.

    Arcs to the left become chords, and arcs to the right tangents, so every point inside the polygon, or outside that
    of a hole, is also inside the contour, or outside the hole. Each arc gets an even number of steps, which keeps the
    symmetry of a circle.

    Raises
    ------
    InputError
        If its arcs need more than `MOST_CHORDS`, or are not finite.
    """
    points: list[Point] = []
    for side in contour.sides:
        start, _, bulge = side
        points.append(start)
        if not bulge:
            continue
        (cx, cy), radius, angle = center_of(side), radius_of(side), 4 * atan(bulge)
        # 1 - cos h = 2 sin^2 (h / 2), which avoids cancellation for large radii.
        share = off / (2 * radius) if bulge > 0 else off / (2 * (radius + off))
        # Chords inside a left turn are off by r (1 - cos h), tangents outside of a right turn by r (1 / cos h - 1), h
        # half a step.
        count = abs(angle) / min(4 * asin(min(sqrt(share), 1.0)), COARSEST) if share > 0 else inf
        if not len(points) + count < MOST_CHORDS:
            raise InputError(
                f"arcs that {MOST_CHORDS} chords can follow to {off:.3g} of their unit",
                f"a radius of {radius:.3g}",
                "check the bulges",
            )
        steps = 2 * ceil(count / 2)
        first = atan2(start[1] - cy, start[0] - cx)
        reach, places = (radius, range(1, steps)) if bulge > 0 else (radius / cos(angle / steps / 2), range(steps))
        for k in places:
            at = first + angle * (k if bulge > 0 else k + 0.5) / steps
            points.append((cx + reach * cos(at), cy + reach * sin(at)))
    return np.array(points, dtype=float).reshape(-1, 2)


def offset(contour: Contour, distance: float) -> Contour:
    """Contour offset to its left: parallel lines with mitered corners, and concentric arcs.

    Arcs must join smoothly at both ends. Sides that would reverse are not detected.
    """
    sides = contour.sides
    moved = []
    for before, after in zip((sides[-1], *sides[:-1]), sides, strict=True):
        (x, y), (ax, ay), (bx, by) = after[0], tangent(before, end=True), tangent(after, end=False)
        # The miter of normals m and n at distance d is d (m + n) / (1 + m . n).
        share = distance / (1 + ax * bx + ay * by)
        moved.append((x - share * (ay + by), y + share * (ax + bx)))
    return Contour(tuple(moved), contour.bulges)


def backward(contour: Contour) -> Contour:
    """Reversed contour, starting at its last corner."""
    # 0.0 - b, as -b would make a straight side's bulge -0.0, which shows in files.
    bulges = (*(0.0 - b for b in contour.bulges[-2::-1]), *(0.0 - b for b in contour.bulges[-1:]))
    return Contour(contour.points[::-1], bulges, contour.about)


def reversed_contour(contour: Contour) -> Contour:
    """Reversed contour, starting at the same corner."""
    points, bulges = contour.points, contour.bulges
    return Contour((*points[:1], *points[:0:-1]), tuple(0.0 - bulge for bulge in bulges[::-1]), contour.about)


def mirrored(contour: Contour) -> Contour:
    """Contour mirrored in the x axis (y becomes -y)."""
    return Contour(tuple((x, -y) for x, y in contour.points), tuple(0.0 - bulge for bulge in contour.bulges))


def placed(
    contour: Contour, scale: float, origin: Sequence[float] | Array = (0.0, 0.0), digits: int | None = None
) -> Contour:
    """Contour shifted, then scaled, with coordinates rounded to the given decimals; -0 becomes 0.

    For a circle, center and radius are rounded, so that its diameter keeps its digits.
    """
    whole = contour.as_circle
    if whole and digits is not None:
        x, y, radius = (
            round(value * scale, digits) + 0.0 for value in (whole[0] - origin[0], whole[1] - origin[1], whole[2])
        )
        points = circle(radius, x, y).points
        return Contour(tuple((round(u, digits) + 0.0, round(v, digits) + 0.0) for u, v in points), contour.bulges)
    moved = (np.array(contour.points, dtype=float) - origin) * scale
    if digits is not None:
        moved = np.round(moved, digits)
    return Contour(tuple(map(tuple, (moved + 0.0).tolist())), contour.bulges)


def merged(contour: Contour, off: float) -> Contour:
    """Merge arcs that form a full circle within `off`, all turning the same way; return any other contour unchanged."""
    bulges = np.array(contour.bulges)
    if contour.is_circle or not (len(bulges) and (np.all(bulges > 0) or np.all(bulges < 0))):
        return contour
    if abs(abs(float(np.sum(4 * np.arctan(bulges)))) - 2 * pi) > 0.01:
        return contour
    corner = np.array(contour.points)
    chord = np.roll(corner, -1, axis=0) - corner
    # The midpoint of an arc that turns left lies to the right of its chord.
    middle = corner + chord / 2 + bulges[:, None] / 2 * np.stack([chord[:, 1], -chord[:, 0]], axis=-1)
    points = np.concatenate([corner, middle])
    center, radius = fitted_sphere(points)
    if np.max(np.abs(np.hypot(*(points - center).T) - radius)) > off:
        return contour
    return circle(radius, float(center[0]), float(center[1]), hole=bool(bulges[0] < 0))


def fitted_sphere(points: Array) -> tuple[Array, float]:
    """Center (d,) and radius of the circle or sphere that fits points (m, d) best, |x|^2 = 2 c'x + const."""
    mean = points.mean(axis=0)
    about = points - mean
    *center, rest = np.linalg.lstsq(np.column_stack([2 * about, np.ones(len(about))]), np.sum(about**2, axis=1))[0]
    return mean + center, sqrt(max(float(rest + np.dot(center, center)), 0.0))


def without_loops(contour: Contour, largest: float, longest: float) -> tuple[Contour, list[Point]]:
    """Cut off loops of less than an area and a length where a contour crosses itself; and return where they were."""
    sides, places = contour.sides, []
    first = clear = 0
    while clear < len(sides) and len(sides) > 3:
        for last, point, length in _returns(sides, first, longest):
            count = len(sides)
            inner = [sides[(first + k) % count] for k in range(1, (last - first) % count)]
            loop = [_part(sides[first], point, True), *inner, _part(sides[last], point, False)]
            corners, bulges = zip(*((start, bulge) for start, _, bulge in loop), strict=True)
            if length < longest and abs(area(Contour(corners, bulges))) < largest:
                kept = [sides[(last + k) % count] for k in range(1, (first - last) % count)]
                sides = [_part(sides[first], point, False), _part(sides[last], point, True), *kept]
                places.append(point)
                first = 0
                break
        else:
            first, clear = (first + 1) % len(sides), clear + 1
    if not places:
        return contour, []
    return Contour(tuple(side[0] for side in sides), tuple(side[2] for side in sides)), places


def _returns(sides: Sequence[Side], first: int, longest: float) -> Iterable[tuple[int, Point, float]]:
    """Yield later sides that cross a side, with the crossing, while the way to them is short."""
    u, v = sides[first][1]
    way = 0.0
    for step in range(1, len(sides) - 1):
        last = (first + step) % len(sides)
        side = sides[last]
        if step > 1:
            way += _length(sides[last - 1])
        if way >= longest:
            return
        reach = longest + _length(side)
        if step > 1 or side[2] or sides[first][2]:
            for point in _crossings(sides[first], side, 0.0) if hypot(side[0][0] - u, side[0][1] - v) < reach else []:
                before, after = _along(sides[first], point), _along(side, point)
                if DUST < before < _length(sides[first]) - DUST and DUST < after < _length(side) - DUST:
                    yield last, point, way + _length(sides[first]) - before + after


def _part(side: Side, point: Point, rest: bool) -> Side:
    """Part of a side from a point on it to its end, or else from its start to the point."""
    share = _along(side, point) / _length(side)
    bulge = tan(atan(side[2]) * (1 - share if rest else share))
    return (point, side[1], bulge) if rest else (side[0], point, bulge)


Cut = tuple[Point, Point, float]
"""Start, end and bulge of the arc that fillets a corner."""

DUST = 1e-9
"""Length tolerance: a side may be too short by it, and a remainder below it counts as used up."""

HALVINGS = 60
"""Halvings in the search for a radius; 40 give the 1e-12 that `largest_fillet` promises, 60 a double's rounding."""


def filleted(contour: Contour, radius: float, sharp: float) -> Contour | None:
    """Fillet all corners that turn by more than `sharp` rad, to either side; None if there is no room for the radius.

    Coordinates are in a unit in which `DUST` is negligible, such as mm.
    """
    sides, count = contour.sides, len(contour.points)
    cuts: list[Cut] = []
    for k, angle in enumerate(turns_of(contour)):
        cut = _cut(sides[k - 1], sides[k], angle, radius) if abs(angle) > sharp else (sides[k][0], sides[k][0], 0.0)
        if cut is None:
            return None
        cuts.append(cut)
    points: list[Point] = []
    bulges: list[float] = []
    for k, (side, (first, start, bulge)) in enumerate(zip(sides, cuts, strict=True)):
        end, whole = cuts[(k + 1) % count][0], side[1]
        low = _along(side, start) if bulge else 0.0
        high = _along(side, end) if end != whole else _length(side)
        if high - low < -DUST:
            return None
        if bulge:
            points.append(first)
            bulges.append(bulge)
        if high - low > DUST:
            points.append(start)
            # The remainder of an arc turns by the remaining share of its angle.
            part = 4 * atan(side[2]) * (high - low) / _length(side)
            bulges.append(side[2] if (start, end) == side[:2] else tan(part / 4))
    return Contour(tuple(points), tuple(bulges))


def largest_fillet(contour: Contour, sharp: float, fails: float) -> float:
    """Largest radius for which `filleted` has room, below a radius that fails; too small by at most 1e-12 of that."""
    low, high = 0.0, fails
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if filleted(contour, middle, sharp) is None else (middle, high)
    return low


def _cut(before: Side, after: Side, angle: float, radius: float) -> Cut | None:
    """Arc of a radius tangent to two sides at the corner between them."""
    x, y = after[0]
    if not before[2] and not after[2]:
        (ax, ay), (bx, by) = (x - before[0][0], y - before[0][1]), (after[1][0] - x, after[1][1] - y)
        angle = atan2(ax * by - ay * bx, ax * bx + ay * by)
        back, on = (radius * tan(abs(angle) / 2) / hypot(u, v) for u, v in ((ax, ay), (bx, by)))
        return (x - back * ax, y - back * ay), (x + on * bx, y + on * by), tan(angle / 4)
    # The arc's center lies one radius to the inner side of both.
    middles = _crossings(before, after, copysign(radius, angle))
    if not middles:
        return None
    u, v = min(middles, key=lambda middle: hypot(middle[0] - x, middle[1] - y))
    start, end = _foot(before, (u, v)), _foot(after, (u, v))
    (ax, ay), (bx, by) = (start[0] - u, start[1] - v), (end[0] - u, end[1] - v)
    sweep = atan2(ax * by - ay * bx, ax * bx + ay * by)
    fits = sweep * angle > 0 and _along(before, start) > -DUST and _along(after, end) < _length(after) + DUST
    return (start, end, tan(sweep / 4)) if fits else None


def _crossings(first: Side, second: Side, left: float) -> list[Point]:
    """Intersections of two sides offset to their left and extended beyond their ends."""
    if not first[2] and second[2]:
        first, second = second, first
    if not first[2]:
        return _crossing_lines(first, second) if not left else []
    (cx, cy), reach = center_of(first), radius_of(first) - copysign(left, first[2] * left)
    if reach <= 0:
        return []
    if not second[2]:
        (x, y), (u, v), _ = second
        length = hypot(u - x, v - y)
        dx, dy = (u - x) / length, (v - y) / length
        away = dx * (cy - y) - dy * (cx - x) - left
        # Perpendicular foot of the center on the offset line.
        fx, fy = cx + dy * away, cy - dx * away
        across = reach**2 - away**2
        return [(fx + s * dx, fy + s * dy) for s in _both(across)]
    (gx, gy), reach_too = center_of(second), radius_of(second) - copysign(left, second[2] * left)
    apart = hypot(gx - cx, gy - cy)
    if reach_too <= 0 or not apart:
        return []
    dx, dy = (gx - cx) / apart, (gy - cy) / apart
    along = (apart**2 + reach**2 - reach_too**2) / (2 * apart)
    return [(cx + along * dx - s * dy, cy + along * dy + s * dx) for s in _both(reach**2 - along**2)]


def _crossing_lines(first: Side, second: Side) -> list[Point]:
    (x, y), (u, v), _ = first
    (a, b), (c, d), _ = second
    cross = (u - x) * (d - b) - (v - y) * (c - a)
    if abs(cross) <= 1e-12 * hypot(u - x, v - y) * hypot(c - a, d - b):
        return []
    share = ((a - x) * (d - b) - (b - y) * (c - a)) / cross
    return [(x + share * (u - x), y + share * (v - y))]


def _both(square: float) -> tuple[float, ...]:
    return (sqrt(square), -sqrt(square)) if square >= 0 else ()


def _foot(side: Side, point: Point) -> Point:
    """Nearest point on a side extended beyond its ends."""
    (x, y), (u, v), bulge = side
    px, py = point
    if bulge:
        (cx, cy), radius = center_of(side), radius_of(side)
        away = hypot(px - cx, py - cy)
        return cx + radius * (px - cx) / away, cy + radius * (py - cy) / away
    share = ((px - x) * (u - x) + (py - y) * (v - y)) / ((u - x) ** 2 + (v - y) ** 2)
    return x + share * (u - x), y + share * (v - y)


def _length(side: Side) -> float:
    (x, y), (u, v), bulge = side
    return abs(4 * atan(bulge)) * radius_of(side) if bulge else hypot(u - x, v - y)


def _along(side: Side, point: Point) -> float:
    """Arc length from the start of a side to a point on it, negative before its start."""
    (x, y), (u, v), bulge = side
    px, py = point
    if not bulge:
        return ((px - x) * (u - x) + (py - y) * (v - y)) / hypot(u - x, v - y)
    (cx, cy), sweep = center_of(side), 4 * atan(bulge)
    middle = atan2(y - cy, x - cx) + sweep / 2
    from_middle = remainder(atan2(py - cy, px - cx) - middle, 2 * pi)
    return radius_of(side) * (copysign(from_middle, from_middle * bulge) + abs(sweep) / 2)
