"""Exact distances to segments, to arcs, and into polygons; and regions at least some distance inside an outline.

The boundary of an `Interior` consists of parts of a few curves: each segment of the outline offset inward, an arc
around each corner that points inward (a hole's corner, say), and each circle of the outline with a smaller radius or,
around a hole, a larger one. Where two of these curves intersect, one may leave the region. So every curve is split at
all intersections, and a part belongs to the boundary if its midpoint is deep enough. There is no polygonal
approximation, and regions of several parts need no special care.
"""
# tests: tests/model/test_boundary.py

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.geometry.contour import Contour, rings_and_circles
from markergen.geometry.region import Region, shapely

Index = NDArray[np.int64]
Box = tuple[Array, Array]
"""Lower left and upper right corner (2,)."""

BLOCK = 2**15
"""Maximum number of pairs of a point and a curve processed at once, so that their arrays fit in the cache."""

MANY = 2**16
"""Number of pairs above which it pays to exclude distant curves first."""

CELLS = 48
"""Number of cells along the longer side of the grid of candidate curves."""


class Curves(ABC):
    """Curves in the plane, numbered from 0."""

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def gaps(self, points: Array, index: Index | slice) -> Array:
        """Distances from points (P, 2) to curves (P, k), or (P, s) to all, or an increasing function of them."""

    @abstractmethod
    def distance(self, gaps: Array) -> Array:
        """Distances from values of `gaps`."""

    @abstractmethod
    def box(self) -> Box:
        """Bounding box of all curves, or a larger one where many points are expected."""

    def nearest(self, points: Array) -> Index:
        """Index (P,) of the curve nearest to each of the points (P, 2); the first of equally near ones."""
        if len(points) * len(self) < MANY:
            return self._nearest_of_all(points)
        grid = self._cells
        index = np.empty(len(points), dtype=np.int64)
        cell = grid.cell(points)
        index[cell < 0] = self._nearest_of_all(points[cell < 0])
        width = np.where(cell < 0, 0, grid.width[cell])
        for table in grid.tables:
            here = np.flatnonzero(width == table.shape[1])
            rows = max(1, BLOCK // table.shape[1])
            for low in range(0, len(here), rows):
                part = here[low : low + rows]
                candidates = table[grid.row[cell[part]]]
                best = np.argmin(self.gaps(points[part], candidates), axis=1)
                index[part] = candidates[np.arange(len(part)), best]
        return index

    def _nearest_of_all(self, points: Array) -> Index:
        index = np.empty(len(points), dtype=np.int64)
        rows = max(1, BLOCK // len(self))
        for low in range(0, len(points), rows):
            index[low : low + rows] = np.argmin(self.gaps(points[low : low + rows], slice(None)), axis=1)
        return index

    @cached_property
    def _cells(self) -> "_Cells":
        return _Cells(self)


class _Cells:
    """Grid of cells over the curves and their surroundings, each with the curves that may be nearest to a point in it.

    From the center of a cell to any of its points the distance to a curve changes by at most half a diagonal, so curves
    more than a full diagonal farther than the nearest one are excluded. The lists are padded with their last curve to
    powers of two, so that points in cells with similar numbers of candidates are processed as one array.
    """

    def __init__(self, curves: Curves) -> None:
        low, high = curves.box()
        # All curves may coincide in one point.
        margin = 0.1 * float(np.max(high - low)) or 1.0
        self.low = low - margin
        size = high - low + 2 * margin
        self.step = float(np.max(size)) / CELLS
        self.shape = np.maximum(np.ceil(size / self.step).astype(int), 1)
        x, y = (self.low[k] + self.step * (np.arange(self.shape[k]) + 0.5) for k in (0, 1))
        middles = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        cells, candidates = [], []
        rows = max(1, BLOCK // len(curves))
        for start in range(0, len(middles), rows):
            distance = curves.distance(curves.gaps(middles[start : start + rows], slice(None)))
            is_candidate = distance <= distance.min(axis=1, keepdims=True) + 1.001 * np.sqrt(2) * self.step
            cell, curve = np.nonzero(is_candidate)
            cells.append(cell + start)
            candidates.append(curve)
        curve, count = np.concatenate(candidates), np.bincount(np.concatenate(cells), minlength=len(middles))
        first = np.cumsum(count) - count
        self.width = 2 ** np.ceil(np.log2(count)).astype(int)
        self.row = np.zeros(len(middles), dtype=np.int64)
        self.tables = []
        for width in np.unique(self.width):
            here = np.flatnonzero(self.width == width)
            self.row[here] = np.arange(len(here))
            self.tables.append(curve[first[here, None] + np.minimum(np.arange(width), count[here, None] - 1)])

    def cell(self, points: Array) -> Index:
        """Index (P,) of the cell containing each of the points (P, 2), -1 for points outside the grid."""
        x, y = ((points - self.low) / self.step).T
        inside = (x >= 0) & (x < self.shape[0]) & (y >= 0) & (y < self.shape[1])
        cell = np.where(inside, x, 0).astype(np.int64) * self.shape[1] + np.where(inside, y, 0).astype(np.int64)
        return np.where(inside, cell, -1)


@dataclass(frozen=True, eq=False)
class Segments(Curves):
    """Segments (s) from `start` to `end`, both (s, 2); a segment may degenerate to a point."""

    start: Array
    end: Array
    around: Box | None = None
    """See `Curves.box`."""

    def __len__(self) -> int:
        return len(self.start)

    @cached_property
    def step(self) -> Array:
        """Vectors (s, 2) from start to end."""
        return self.end - self.start

    @cached_property
    def normal(self) -> Array:
        """Unit vectors (s, 2) to the left."""
        length = np.linalg.norm(self.step, axis=-1, keepdims=True)
        return np.stack([-self.step[:, 1], self.step[:, 0]], axis=-1) / np.where(length > 0, length, np.inf)

    @cached_property
    def _columns(self) -> tuple[Array, ...]:
        square = np.sum(self.step**2, axis=-1, keepdims=True)
        # Its product with a point's offset from the start is the parameter on the segment, 0 for a degenerate segment.
        per_length = self.step / np.where(square > 0, square, np.inf)
        return tuple(np.ascontiguousarray(c) for c in np.concatenate([self.start, self.step, per_length], axis=1).T)

    def gaps(self, points: Array, index: Index | slice) -> Array:
        """See `Curves.gaps`: squares of the distances."""
        start_x, start_y, step_x, step_y, per_x, per_y = (column[index] for column in self._columns)
        x, y = points[:, :1] - start_x, points[:, 1:] - start_y
        place = x * per_x
        place += y * per_y
        np.clip(place, 0.0, 1.0, out=place)
        x -= place * step_x
        y -= place * step_y
        x *= x
        y *= y
        x += y
        return x

    def distance(self, gaps: Array) -> Array:
        """See `Curves.distance`."""
        return np.sqrt(gaps)

    def box(self) -> Box:
        """See `Curves.box`."""
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        return self.around or (low.min(axis=0), high.max(axis=0))

    def place(self, points: Array, index: Index) -> Array:
        """Parameters (P,) of the nearest points on segments, from 0 at the start to 1 at the end."""
        start_x, start_y, _, _, per_x, per_y = (column[index] for column in self._columns)
        return np.clip((points[:, 0] - start_x) * per_x + (points[:, 1] - start_y) * per_y, 0.0, 1.0)

    def at(self, index: Index, place: Array) -> Array:
        """Points (P, 2) at parameters 0 to 1 on segments; exact at the ends."""
        inner = self.start[index] + place[:, None] * self.step[index]
        return np.where(place[:, None] < 1, inner, self.end[index])

    def foot(self, points: Array, index: Index) -> Array:
        """Nearest points (P, 2) on segments."""
        return self.at(index, self.place(points, index))

    def surround(self, points: Array) -> Mask:
        """True for points (P, 2) that the closed outlines made of these segments surround an odd number of times."""
        odd = np.empty(len(points), dtype=bool)
        rows = max(1, BLOCK // len(self))
        for low in range(0, len(points), rows):
            x, y = points[low : low + rows, :1], points[low : low + rows, 1:]
            rising = self.step[:, 1] > 0
            spans = (self.start[:, 1] > y) != (self.end[:, 1] > y)
            left = self.step[:, 0] * (y - self.start[:, 1]) > self.step[:, 1] * (x - self.start[:, 0])
            odd[low : low + rows] = np.count_nonzero(spans & (left == rising), axis=1) % 2 == 1
        return odd


@dataclass(frozen=True, eq=False)
class Arcs(Curves):
    """Circular arcs (a).

    Attributes
    ----------
    center : array (a, 2)
    radius : array (a,)
    middle : array (a,), rad
        Direction from the center to the arc's midpoint.
    half : array (a,), rad
        Angle from the midpoint to either end, up to pi.
    around : (low, high), optional
        See `Curves.box`.
    """

    center: Array
    radius: Array
    middle: Array
    half: Array
    around: Box | None = None

    def __len__(self) -> int:
        return len(self.radius)

    @cached_property
    def heading(self) -> Array:
        """Unit vectors (a, 2) from the center to the midpoint."""
        return np.stack([np.cos(self.middle), np.sin(self.middle)], axis=-1)

    @cached_property
    def _columns(self) -> tuple[Array, ...]:
        parts = (*self.center.T, *self.heading.T, self.radius, np.cos(self.half), np.sin(self.half))
        return tuple(np.ascontiguousarray(part) for part in parts)

    def gaps(self, points: Array, index: Index | slice) -> Array:
        """See `Curves.gaps`: the distances."""
        center_x, center_y, ahead, left, radius, cos, sin = (column[index] for column in self._columns)
        x, y = points[:, :1] - center_x, points[:, 1:] - center_y
        # Along the direction to the midpoint, and perpendicular to it.
        along, aside = x * ahead + y * left, np.abs(y * ahead - x * left)
        beyond = along * sin < aside * cos
        # Relative to the end if that is nearest. Not hypot, which takes ten times as long.
        along -= np.where(beyond, radius * cos, 0.0)
        aside -= np.where(beyond, radius * sin, 0.0)
        along *= along
        aside *= aside
        along += aside
        np.sqrt(along, out=along)
        along -= np.where(beyond, 0.0, radius)
        return np.abs(along, out=along)

    def distance(self, gaps: Array) -> Array:
        """See `Curves.distance`."""
        return gaps

    def box(self) -> Box:
        """See `Curves.box`."""
        reach = self.radius[:, None]
        return self.around or ((self.center - reach).min(axis=0), (self.center + reach).max(axis=0))

    def from_middle(self, points: Array, index: Index) -> Array:
        """Angle (P,) in rad from the midpoint of arcs to points (P, 2), from -pi to pi."""
        offset, heading = points - self.center[index], self.heading[index]
        cross = heading[:, 0] * offset[:, 1] - heading[:, 1] * offset[:, 0]
        return np.arctan2(cross, np.sum(heading * offset, axis=-1))

    def at(self, index: Index, angle: Array) -> Array:
        """Points (P, 2) on arcs, each at an angle from the arc's midpoint."""
        direction = self.middle[index] + angle
        return self.center[index] + self.radius[index, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)

    def foot(self, points: Array, index: Index) -> Array:
        """Nearest points (P, 2) on arcs."""
        angle, half = self.from_middle(points, index), self.half[index]
        return self.at(index, np.clip(angle, -half, half))


class Edges:
    """Edges of closed polygons (m, 2) with the region to their left; `size` is their approximate extent."""

    def __init__(self, rings: Sequence[Array], size: float) -> None:
        self._sizes, self._size = [len(ring) for ring in rings], size
        self._edges = Segments(np.concatenate(rings), np.concatenate([np.roll(r, -1, axis=0) for r in rings]))

    def depth(self, points: Array) -> Array:
        """Signed distances (P,) from points (P, 2) to the nearest edge, positive inside."""
        sign, offset, _, _ = self._seen_from(points)
        return sign * np.hypot(*offset.T)

    def depth_gradient(self, points: Array) -> Array:
        """Gradients (P, 2) of `depth`; if several edges are equally near, that of one of them."""
        sign, offset, index, at_corner = self._seen_from(points)
        distance = np.hypot(*offset.T)
        apart = distance > 1e-12 * self._size
        # Nearest to an edge: its normal, free of rounding errors even on the outline; at a corner: the mean of two.
        gradient = self._edges.normal[index]
        within = at_corner & ~apart
        gradient[within] = self._bisectors[self._corner(points[within], index[within])]
        around = at_corner & apart
        gradient[around] = offset[around] * (sign[around] / distance[around])[:, None]
        return gradient

    def _seen_from(self, points: Array) -> tuple[Array, Array, Index, Mask]:
        """Sign (P,), 1 inside and -1 outside, offset (P, 2) from the nearest point, its edge, and if it is a corner.

        The side of the nearest edge determines the sign; at a corner, the sides of both its edges do, unless outlines
        touch there: then all edges count.
        """
        edges, (before, _, sharp, touching) = self._edges, self._corners
        index = edges.nearest(points)
        place = edges.place(points, index)
        left = self._left_of(points, index)
        at_corner = (place <= 0) | (place >= 1)
        if at_corner.any():
            where = np.flatnonzero(at_corner)
            corner = self._corner(points[where], index[where])
            after_edge, before_edge = (self._left_of(points[where], edge) for edge in (corner, before[corner]))
            left[where] = np.where(sharp[corner], after_edge & before_edge, after_edge | before_edge)
            where = where[touching[corner]]
            left[where] = edges.surround(points[where])
        return np.where(left, 1.0, -1.0), points - edges.at(index, place), index, at_corner

    def _corner(self, points: Array, index: Index) -> Index:
        """Corners (P,): the nearer ends of edges."""
        return np.where(self._edges.place(points, index) > 0.5, self._corners[1][index], index)

    @cached_property
    def _bisectors(self) -> Array:
        normal = self._edges.normal
        both = normal + normal[self._corners[0]]
        return both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), np.finfo(float).tiny)

    def _left_of(self, points: Array, index: Index) -> Mask:
        step, offset = self._edges.step[index], points - self._edges.start[index]
        return step[:, 0] * offset[:, 1] >= step[:, 1] * offset[:, 0]

    @cached_property
    def _corners(self) -> tuple[Index, Index, Mask, Mask]:
        """For each corner: previous and next corner, whether it turns left, and whether outlines touch there."""
        first = np.cumsum([0, *self._sizes[:-1]])
        numbers = [start + np.arange(size) for start, size in zip(first, self._sizes, strict=True)]
        before, after = (np.concatenate([np.roll(ring, step) for ring in numbers]) for step in (1, -1))
        edges = self._edges
        sharp = edges.step[before, 0] * edges.step[:, 1] > edges.step[before, 1] * edges.step[:, 0]
        tree = shapely.STRtree(shapely.linestrings(np.stack([edges.start, edges.end], axis=1)))
        corners, _ = tree.query(shapely.points(edges.start), predicate="dwithin", distance=1e-9 * self._size)
        return before, after, sharp, np.bincount(corners, minlength=len(edges)) > 2


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
    # Parts were cut from one sorted list, so adjacent ones share their end to the last bit.
    fresh[1:] = (of[1:] != of[:-1]) | (low[1:] > high[:-1])
    starts = np.flatnonzero(fresh)
    lasts = np.append(starts[1:], len(of))[: len(starts)] - 1
    return low[starts], high[lasts], of[starts]


def _cuts(lines: Segments, arcs: Arcs) -> tuple[Index, Array, Index, Array]:
    """Intersections of the curves: indices of lines and parameters 0 to 1 on them, indices of arcs and angles on them.

    Intersections slightly beyond an end are kept, so that two curves with a common end do not miss each other by
    rounding.
    """
    count = len(lines)
    low = np.concatenate([np.minimum(lines.start, lines.end), arcs.center - arcs.radius[:, None]])
    high = np.concatenate([np.maximum(lines.start, lines.end), arcs.center + arcs.radius[:, None]])
    # Boxes of curves that only touch must meet as well.
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
    # Division by infinity gives 0 instead of a warning; `met` leaves these pairs out.
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
    # Distance of the radical line from the first center.
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
