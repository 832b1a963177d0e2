"""Contours with filleted corners between lines and arcs."""

from math import atan, atan2, copysign, hypot, pi, remainder, sqrt, tan

from markergen.geometry.contour import Contour, Point, Side, center_of, radius_of, turns_of

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
