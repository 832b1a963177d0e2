"""Region at least some distance inside an outline, by its exact boundary of line segments and arcs.

The boundary consists of parts of a few curves: each segment of the outline offset inward, an arc around each corner
that points inward (a hole's corner, say), and each circle of the outline with a smaller radius or, around a hole, a
larger one. Where two of these curves intersect, one may leave the region. So every curve is split at all
intersections, and a part belongs to the boundary if its midpoint is deep enough. There is no polygonal approximation,
and regions of several parts need no special care. `Interior` uses it to find nearest, deepest and random points.
"""
# tests: tests/model/test_boundary.py

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.geometry.contour import Contour, rings_and_circles
from markergen.geometry.distance import Arcs, Segments
from markergen.geometry.region import Region

Index = NDArray[np.int64]

SLACK = 1e-12
"""Tolerance for rounding errors, relative to the outline's size."""

ROUNDS = 100
"""Maximum number of rounds of rejection sampling."""

MOST_INSETS = 64
"""Maximum number of cached insets of one outline."""


class Interior:
    """Inside of an outline: its part with at least some depth, and random points in it.

    Parameters
    ----------
    contours : iterable of Contour
        Outline of straight sides and full circles, with the region to their left.
    depth : callable
        Depth (P,) of points (P, 2), exact inside the region.
    size : float
        Radius of a circle around the outline.
    region : callable
        The same as a region, with polygons for circles; called once, when points are first sampled.
    """

    def __init__(
        self,
        contours: Iterable[Contour],
        depth: Callable[[Array], Array],
        size: float,
        region: Callable[[], Region],
    ) -> None:
        self._curves, self._depth = rings_and_circles(contours), depth
        self._size, self._region = size, region
        self._insets: dict[float, Inset] = {}

    def project(self, points: Array, inset: float) -> Array:
        """Nearest points (..., 2) with a depth of at least `inset`, or the deepest; points so deep are unchanged."""
        flat = np.ascontiguousarray(points, dtype=float).reshape(-1, 2)
        shallow = self._depth(flat) < inset
        if not shallow.any():
            return points
        flat = flat.copy()
        flat[shallow] = self._inset(inset).nearest(flat[shallow])
        return flat.reshape(points.shape)

    def sample(self, count: int, inset: float, rng: "np.random.Generator") -> Array:
        """Sample (count, 2) points uniformly from the part with a depth of at least `inset`."""
        corners, share = self._triangles
        samples = np.zeros((0, 2))
        for _ in range(ROUNDS):
            if len(samples) >= count:
                return samples[:count]
            a, b, c = np.moveaxis(corners[np.searchsorted(share[:-1], rng.random(count))], 1, 0)
            u, v = rng.random((2, count, 1))
            u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
            points = a + u * (b - a) + v * (c - a)
            samples = np.concatenate([samples, points[self._depth(points) >= inset]])
        # That part is empty, or less than a hundredth of the whole.
        return np.concatenate([samples, self.project(points, inset)])[:count]

    def _inset(self, inset: float) -> "Inset":
        """Part with a depth of at least `inset`; the deepest part if nothing is that deep."""
        if inset not in self._insets:
            part = self._exactly(inset)
            if len(self._insets) == MOST_INSETS:
                self._insets.clear()
            self._insets[inset] = self._inset(self._deepest) if part.empty else part
        return self._insets[inset]

    def _exactly(self, inset: float) -> "Inset":
        return Inset(*self._curves, self._depth, inset, SLACK * self._size)

    @cached_property
    def _deepest(self) -> float:
        """Maximum depth of any point, too small by at most a billionth of the size."""
        # By bisection: Inset is exact, unlike GEOS's buffers in corners made of many short edges.
        low, high = 0.0, self._size
        while high - low > 1e-9 * self._size:
            middle = (low + high) / 2
            low, high = (low, middle) if self._exactly(middle).empty else (middle, high)
        return low

    @cached_property
    def _triangles(self) -> tuple[Array, Array]:
        """Triangles (t, 3, 2) of the region, and cumulative shares (t,) of the area."""
        corners, area = self._region().triangles()
        return corners, np.cumsum(area / area.sum())


class Inset:
    """Region with a depth of at least `inset`.

    Parameters
    ----------
    rings : sequence of array (m, 2)
        Closed polygons with the region to their left.
    circles : array (c, 4)
        Center x, y and radius, and 1 with the region inside, -1 with the region outside.
    depth : callable
        Depth (P,) of points (P, 2), exact inside the region.
    slack : float
        Tolerance for rounding errors.
    """

    def __init__(
        self, rings: Sequence[Array], circles: Array, depth: Callable[[Array], Array], inset: float, slack: float
    ) -> None:
        def holds(points: Array, within: Array | float = 0.0) -> Mask:
            return depth(points) + within >= inset - slack

        lines, arcs = _moved(rings, inset), _rounded(rings, circles, inset)
        # Curves that are too shallow over their entire length are excluded first: far inside a fine outline, these are
        # nearly all, and all of them would intersect each other.
        middle = (lines.start + lines.end) / 2
        is_deep = holds(middle, np.hypot(*lines.step.T) / 2)
        lines = Segments(lines.start[is_deep], lines.end[is_deep])
        is_deep = holds(arcs.at(np.arange(len(arcs)), np.zeros(len(arcs))), arcs.radius * arcs.half)
        arcs = Arcs(arcs.center[is_deep], arcs.radius[is_deep], arcs.middle[is_deep], arcs.half[is_deep])
        line, place, arc, angle = _cuts(lines, arcs)
        every = np.arange(len(lines))
        first, last, of = _kept(
            np.concatenate([line, every, every]),
            np.concatenate([place, np.zeros(len(lines)), np.ones(len(lines))]),
            lambda index, middle: holds(lines.at(index, middle)),
        )
        corners = np.concatenate([lines.start, lines.end, *(arcs.center + s * arcs.radius[:, None] for s in (-1, 1))])
        around = corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)
        self.lines = Segments(lines.at(of, first), lines.at(of, last), around)
        every = np.arange(len(arcs))
        first, last, of = _kept(
            np.concatenate([arc, every, every]),
            np.concatenate([angle, -arcs.half, arcs.half]),
            lambda index, middle: holds(arcs.at(index, middle)),
        )
        middle, half = arcs.middle[of] + (first + last) / 2, (last - first) / 2
        self.arcs = Arcs(arcs.center[of], arcs.radius[of], middle, half, around)
        if self.empty:
            # A region may be a single point, such as the center of a square inset by half its side.
            ends = np.concatenate([lines.at(line, place), arcs.at(arc, angle)])
            ends = ends[holds(ends)]
            self.lines = Segments(ends, ends)

    @property
    def empty(self) -> bool:
        """True if no point is deep enough."""
        return not len(self.lines) and not len(self.arcs)

    def nearest(self, points: Array) -> Array:
        """Boundary points (P, 2) nearest to points (P, 2)."""
        feet = [pieces.foot(points, pieces.nearest(points)) for pieces in (self.lines, self.arcs) if len(pieces)]
        if len(feet) == 1:
            return feet[0]
        on_line, on_arc = feet
        nearer = np.hypot(*(points - on_arc).T) < np.hypot(*(points - on_line).T)
        return np.where(nearer[:, None], on_arc, on_line)


def _moved(rings: Sequence[Array], inset: float) -> Segments:
    start, end = _joined(rings), _joined([np.roll(ring, -1, axis=0) for ring in rings])
    offset = inset * Segments(start, end).normal
    return Segments(start + offset, end + offset)


def _rounded(rings: Sequence[Array], circles: Array, inset: float) -> Arcs:
    """Arcs around corners that point into the region, and circles offset into it."""
    radius = circles[:, 2] - inset * circles[:, 3]
    circles, radius = circles[radius >= 0], radius[radius >= 0]
    whole = np.full(len(circles), np.pi)
    if not inset:
        return Arcs(circles[:, :2], radius, 0 * whole, whole)
    corner = _joined(rings)
    before = corner - _joined([np.roll(ring, 1, axis=0) for ring in rings])
    after = _joined([np.roll(ring, -1, axis=0) for ring in rings]) - corner
    angle = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=-1))
    right = angle < 0
    normal = np.arctan2(before[right, 0], -before[right, 1])
    return Arcs(
        np.concatenate([corner[right], circles[:, :2]]),
        np.concatenate([np.full(right.sum(), inset), radius]),
        np.concatenate([normal + angle[right] / 2, 0 * whole]),
        np.concatenate([-angle[right] / 2, whole]),
    )


def _joined(rings: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros((0, 2)), *rings])


def _kept(index: Index, place: Array, holds: Callable[[Index, Array], Mask]) -> tuple[Array, Array, Index]:
    """First and last parameters (k,) of parts whose midpoints hold, adjacent parts joined, and their curves."""
    order = np.lexsort([place, index])
    index, place = index[order], place[order]
    same = (index[1:] == index[:-1]) & (place[1:] > place[:-1])
    low, high, of = place[:-1][same], place[1:][same], index[:-1][same]
    kept = holds(of, (low + high) / 2)
    low, high, of = low[kept], high[kept], of[kept]
    fresh = np.ones(len(of), dtype=bool)
    fresh[1:] = (of[1:] != of[:-1]) | (low[1:] > high[:-1])
    starts = np.flatnonzero(fresh)
    lasts = np.append(starts[1:], len(of))[: len(starts)] - 1
    return low[starts], high[lasts], of[starts]


def _cuts(lines: Segments, arcs: Arcs) -> tuple[Index, Array, Index, Array]:
    """Intersections of the curves: indices of lines and parameters 0 to 1 on them, indices of arcs and angles on them.

    Intersections slightly beyond an end are kept, so that two curves with a common end do not miss each other by
    rounding.
    """
    import shapely

    count = len(lines)
    low = np.concatenate([np.minimum(lines.start, lines.end), arcs.center - arcs.radius[:, None]])
    high = np.concatenate([np.maximum(lines.start, lines.end), arcs.center + arcs.radius[:, None]])
    hair = 1e-9 * max(float(np.abs(low).max(initial=0)), float(np.abs(high).max(initial=0)))
    boxes = shapely.box(*(low - hair).T, *(high + hair).T)
    i, j = shapely.STRtree(boxes).query(boxes)
    both = (i < count) & (j < count) & (i != j)
    line, place = _line_line(lines, i[both], j[both])
    mixed = (i < count) & (j >= count)
    line_too, place_too, arc, angle = _line_arc(lines, arcs, i[mixed], j[mixed] - count)
    round_ = (i >= count) & (j >= count) & (i != j)
    arc_too, angle_too = _arc_arc(arcs, i[round_] - count, j[round_] - count)
    return (
        np.concatenate([line, line_too]),
        np.concatenate([place, place_too]),
        np.concatenate([arc, arc_too]),
        np.concatenate([angle, angle_too]),
    )


def _line_line(lines: Segments, i: Index, j: Index) -> tuple[Index, Array]:
    first, second = lines.step[i], lines.step[j]
    between = lines.start[j] - lines.start[i]
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    safe = np.where(cross != 0, cross, np.inf)
    place = (between[:, 0] * second[:, 1] - between[:, 1] * second[:, 0]) / safe
    there = (between[:, 0] * first[:, 1] - between[:, 1] * first[:, 0]) / safe
    met = (cross != 0) & _within(place) & _within(there)
    return i[met], np.clip(place[met], 0.0, 1.0)


def _line_arc(lines: Segments, arcs: Arcs, i: Index, j: Index) -> tuple[Index, Array, Index, Array]:
    step, offset, radius = lines.step[i], lines.start[i] - arcs.center[j], arcs.radius[j]
    length = np.linalg.norm(step, axis=-1)
    safe = np.where(length > 0, length, np.inf)
    foot = -np.sum(offset * step, axis=-1) / safe
    away = (offset[:, 0] * step[:, 1] - offset[:, 1] * step[:, 0]) / safe
    # A line that misses the circle by a rounding error counts as tangent.
    reach = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
    reaches = np.abs(away) <= radius * (1 + 1e-9)
    crossings: list[tuple[Index, Array, Index, Array]] = []
    for sign in (-1, 1):
        place = (foot + sign * reach) / safe
        point = offset + place[:, None] * step
        angle = arcs.from_middle(arcs.center[j] + point, j)
        met = reaches & _within(place) & (np.abs(angle) <= arcs.half[j] + 1e-9)
        half = arcs.half[j[met]]
        crossings.append((i[met], np.clip(place[met], 0.0, 1.0), j[met], np.clip(angle[met], -half, half)))
    first, second = crossings
    return tuple(np.concatenate(pair) for pair in zip(first, second, strict=True))  # type: ignore[return-value]


def _arc_arc(arcs: Arcs, i: Index, j: Index) -> tuple[Index, Array]:
    between, radius_i, radius_j = arcs.center[j] - arcs.center[i], arcs.radius[i], arcs.radius[j]
    distance = np.linalg.norm(between, axis=-1)
    safe = np.where(distance > 0, distance, np.inf)
    along = (distance**2 + radius_i**2 - radius_j**2) / (2 * safe)
    reaches = (distance > 0) & (np.abs(along) <= radius_i * (1 + 1e-9))
    across = np.sqrt(np.maximum(radius_i**2 - along**2, 0.0))
    unit = between / safe[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
    indices, angles = [], []
    for sign in (-1, 1):
        point = along[:, None] * unit + sign * across[:, None] * normal
        angle, there = (arcs.from_middle(arcs.center[i] + point, k) for k in (i, j))
        met = reaches & (np.abs(angle) <= arcs.half[i] + 1e-9) & (np.abs(there) <= arcs.half[j] + 1e-9)
        half = arcs.half[i[met]]
        indices.append(i[met])
        angles.append(np.clip(angle[met], -half, half))
    return np.concatenate(indices), np.concatenate(angles)


def _within(place: Array) -> Mask:
    return (place >= -1e-9) & (place <= 1 + 1e-9)
