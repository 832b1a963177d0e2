"""Regions of the plane with straight edges: Boolean operations, offsets, distances and containment.

A `Region` is any number of separate pieces, with or without holes. This is the only module that imports GEOS, as
`shapely`, when it is first needed. Exact lines and arcs are a `Contour`, which `Region.of_contour` flattens.
Points are arrays (P, 2), and closed polygons arrays (m, 2) without repeating the first corner at the end; lengths are
in any unit.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from markergen.arrays import Array, Indices, Mask
from markergen.geometry.contour import Contour, flattened

Box = tuple[float, float, float, float]
"""Left, lower, right and upper end."""


_CENTERS = 12
"""Number of centers along each side of the grids on which rectangles grow."""


class _Shapely:
    """The functions of shapely, which is imported with the first of them."""

    def __getattr__(self, name: str) -> Any:
        import shapely

        setattr(self, name, getattr(shapely, name))
        return getattr(shapely, name)


shapely = _Shapely()


class Region:
    """Immutable part of the plane, possibly empty.

    ``a | b`` is the union, ``a & b`` the intersection, ``a - b`` the part of a outside b, and ``a ^ b`` the symmetric
    difference. Lines and points where two regions merely touch are omitted.

    Examples
    --------
    >>> frame = Region.rectangle(0, 0, 4, 3) - Region.rectangle(1, 1, 3, 2)
    >>> frame.area, len(frame.rings), frame.contains([[0.5, 0.5], [2, 1.5]]).tolist()
    (10.0, 2, [True, False])
    """

    __slots__ = ("_shape",)

    def __init__(self, shape: Any = None) -> None:
        """Make the empty region; only this package wraps shapely geometries."""
        self._shape = shapely.Polygon() if shape is None else shape

    @classmethod
    def polygon(cls, outer: ArrayLike, holes: Iterable[ArrayLike] = (), mend: bool = False) -> "Region":
        """Make the inside of a closed polygon, minus holes; `mend` repairs self-intersections."""
        shape = shapely.Polygon(outer, list(holes))
        return cls(shapely.make_valid(shape) if mend else shape)

    @classmethod
    def rectangle(cls, left: float, low: float, right: float, high: float) -> "Region":
        """Make an axis-parallel rectangle from its limits."""
        return cls(shapely.box(left, low, right, high))

    @classmethod
    def disk(cls, x: float, y: float, radius: float, segments: int = 512) -> "Region":
        """Make a disk as a polygon with vertices on its rim, `segments` in each quarter."""
        return cls(shapely.Point(x, y).buffer(radius, quad_segs=segments))

    @classmethod
    def enclosed(cls, rings: Iterable[ArrayLike]) -> "Region":
        """Make the region enclosed by closed polygons, outer ones counterclockwise and holes clockwise.

        They are applied from the outside in, so a hole may contain islands.
        """
        corners = [np.asarray(ring, dtype=float) for ring in rings]
        areas = np.array([signed_area(ring) for ring in corners])
        shape = shapely.Polygon()
        for i in np.argsort(-np.abs(areas), kind="stable"):
            change = shapely.union if areas[i] > 0 else shapely.difference
            shape = change(shape, shapely.Polygon(corners[i]))
        return cls(shape)

    @classmethod
    def odd(cls, rings: Iterable[ArrayLike]) -> "Region":
        """Make the region inside an odd number of closed polygons of any orientation."""
        shape = shapely.Polygon()
        for ring in sorted((shapely.Polygon(ring) for ring in rings), key=lambda ring: -ring.area):
            shape = shapely.symmetric_difference(shape, ring)
        return cls(shape)

    @classmethod
    def of_contour(cls, outer: Contour, holes: Iterable[Contour], off: float) -> "Region":
        """Make the inside of a contour, minus holes; arcs become chords at most `off` from them."""
        return cls.polygon(flattened(outer, off), [flattened(hole, off) for hole in holes])

    @classmethod
    def union(cls, regions: Iterable["Region"], grid: float | None = None) -> "Region":
        """Join any number of regions; snapping corners to a `grid` closes slits between neighbors."""
        return cls(shapely.union_all([region._shape for region in regions], grid_size=grid))

    def __or__(self, region: "Region") -> "Region":
        return Region(shapely.union(self._shape, region._shape))

    def __and__(self, region: "Region") -> "Region":
        return Region(shapely.intersection(self._shape, region._shape))

    def __sub__(self, region: "Region") -> "Region":
        return Region(shapely.difference(self._shape, region._shape))

    def __xor__(self, region: "Region") -> "Region":
        return Region(shapely.symmetric_difference(self._shape, region._shape))

    def __bool__(self) -> bool:
        """True if the region has an area."""
        return self.area > 0

    def offset(self, by: float, corners: Literal["round", "miter"] = "round", segments: int = 16) -> "Region":
        """Grow by a distance, or shrink for a negative one; round corners get `segments` chords per quarter turn."""
        style = "mitre" if corners == "miter" else "round"
        return Region(shapely.buffer(self._shape, by, quad_segs=segments, join_style=style))

    def oriented(self) -> "Region":
        """Orient outer rings counterclockwise and holes clockwise."""
        return Region(shapely.orient_polygons(self._shape))

    def filled(self) -> "Region":
        """Fill all holes."""
        return Region.union(Region(shapely.Polygon(piece._shape.exterior)) for piece in self.pieces)

    def mapped(self, function: Callable[[Array], Array], step: float | None = None) -> "Region":
        """Map all corners by a function from points (P, 2) to points, and repair any resulting self-intersections.

        With a `step`, edges are first subdivided to at most that length, so that they may become curved.
        """
        shape = self._shape if step is None else shapely.segmentize(self._shape, step)
        return Region(shapely.make_valid(shapely.transform(shape, function)))

    @property
    def area(self) -> float:
        """Area, excluding holes."""
        return float(self._shape.area)

    @property
    def perimeter(self) -> float:
        """Length of the edge, including that of holes."""
        return float(self._shape.length)

    @property
    def crosses_itself(self) -> bool:
        """True if the edge crosses or touches itself; the area is then wrong until it is repaired."""
        return not self._shape.is_valid

    @property
    def box(self) -> Box:
        """Left, lower, right and upper end; nan for the empty region."""
        left, low, right, high = self._shape.bounds
        return left, low, right, high

    @property
    def pieces(self) -> "list[Region]":
        """Separate pieces, each an outer ring and its holes; degenerate parts are omitted."""
        return [Region(part) for part in self._polygons()]

    @property
    def rings(self) -> tuple[Array, ...]:
        """Closed polygons (m, 2), for each piece the outer one and then its holes; see `oriented`."""
        rings = shapely.get_rings(np.array(self._polygons(), dtype=object))
        return tuple(shapely.get_coordinates(ring)[:-1] for ring in rings)

    def contains(self, points: ArrayLike) -> Mask:
        """True for points (P, 2) inside; those on the edge are not."""
        shapely.prepare(self._shape)
        inside: Mask = shapely.contains(self._shape, _points(points))
        return inside

    def depth(self, points: ArrayLike) -> Array:
        """Signed distances (...) from points (..., 2) to the edge, positive inside."""
        return self._signed(shapely.boundary(self._shape), _points(points))

    def clearance(self, others: "Sequence[ArrayLike | Region]") -> Array:
        """Distances (k,) to the edge from regions, closed polygons (m, 2) or points (1, 2), negative unless inside."""
        return self._signed(shapely.boundary(self._shape), _shapes(others))

    def distance(self, points: ArrayLike) -> Array:
        """Distances (...) from points (..., 2); 0 inside."""
        distances: Array = shapely.distance(self._shape, _points(points))
        return distances

    def covers(self, region: "Region") -> bool:
        """True if no part of another region is outside."""
        return bool(self._shape.covers(region._shape))

    def surrounds(self, region: "Region") -> bool:
        """True if another region is inside and does not touch the edge."""
        return bool(shapely.contains_properly(self._shape, region._shape))

    def surrounds_boxes(self, boxes: ArrayLike) -> Mask:
        """True for axis-parallel rectangles (..., 4), left, low, right and high, inside and clear of the edge."""
        shapely.prepare(self._shape)
        inside: Mask = shapely.contains_properly(self._shape, shapely.box(*np.moveaxis(np.asarray(boxes), -1, 0)))
        return inside

    def meets(self, region: "Region") -> bool:
        """True if it has a point in common with another region, even if only on their edges."""
        return bool(self._shape.intersects(region._shape))

    def within(self, points: ArrayLike, distance: float) -> Mask:
        """True for points (P, 2) inside or at most a distance outside."""
        shapely.prepare(self._shape)
        within: Mask = shapely.dwithin(self._shape, _points(points), distance)
        return within

    def runs(self, line: ArrayLike) -> list[Array]:
        """Parts (m, 2) of a polyline through points (k, 2) that lie in the region."""
        inside = shapely.line_merge(shapely.intersection(shapely.LineString(line), self._shape))
        parts = shapely.get_parts(inside) if not inside.is_empty else ()
        return [shapely.get_coordinates(part) for part in parts if part.geom_type == "LineString" and part.length > 0]

    def triangles(self) -> tuple[Array, Array]:
        """Triangulate into clockwise triangles (t, 3, 2), and return them with their areas (t,)."""
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(self._shape))
        corners = shapely.get_coordinates(shapely.get_exterior_ring(parts)).reshape(-1, 4, 2)[:, :3]
        return corners, shapely.area(parts)

    def inner_point(self) -> tuple[float, float]:
        """Return a point (x, y) inside, clear of the edge."""
        point = self._shape.representative_point()
        return float(point.x), float(point.y)

    def largest_circle(self, tolerance: float) -> tuple[float, float]:
        """Find the center (x, y) of the largest circle inside, to a tolerance in length."""
        line = shapely.get_coordinates(shapely.maximum_inscribed_circle(self._shape, tolerance=tolerance))
        return float(line[0, 0]), float(line[0, 1])

    def largest_rectangle(self, width: float, height: float) -> float:
        """Find the scale of the largest rectangle inside whose sides have this ratio, low by a percent at most.

        It may be turned by multiples of 7.5 degrees. For each angle, rectangles grow about a grid of centers until they
        touch the edge, and then about finer grids around the best of them.
        """
        best, half = 0.0, np.array([width, height]) / 2
        for angle in np.arange(0, np.pi, np.pi / 24):
            rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            rotated = self.mapped(lambda points, rotation=rotation: points @ rotation)  # type: ignore[misc]
            low, high = np.array(rotated.box).reshape(2, 2)
            middle, reach, most = (low + high) / 2, (high - low) / 2, float(((high - low) / (2 * half)).min())
            for _ in range(4):
                steps = np.linspace(-1, 1, _CENTERS)
                centers = middle + reach * np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
                fits, fails = np.zeros(len(centers)), np.full(len(centers), most)
                for _ in range(12):
                    tried = (fits + fails) / 2
                    corners = tried[:, None] * half
                    inside = rotated.surrounds_boxes(np.concatenate([centers - corners, centers + corners], axis=-1))
                    fits, fails = np.where(inside, tried, fits), np.where(inside, fails, tried)
                middle, reach = centers[fits.argmax()], reach * 2 / (_CENTERS - 1)
                best = max(best, float(fits.max()))
        return best

    def _polygons(self) -> list[Any]:
        return [part for part in shapely.get_parts(self._shape) if part.geom_type == "Polygon" and not part.is_empty]

    def _signed(self, edge: Any, shapes: Any) -> Array:
        far = shapely.distance(edge, shapes)
        return np.where(shapely.covers(self._shape, shapes), far, -far)


def signed_area(ring: Array) -> float:
    """Area of a closed polygon (m, 2), positive if counterclockwise."""
    # Relative to a corner, to avoid cancellation for a small outline far from the origin.
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def pairs_in_boxes(points: Array, low: Array, high: Array, most: int) -> Iterator[tuple[Indices, Indices]]:
    """Yield which points (m, 2) lie in which boxes, from their least and greatest corners (n, 2), edges included.

    Parameters
    ----------
    most : int
        Number of pairs in one item, which a single box may exceed.
    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    tree = shapely.STRtree(shapely.points(points[finite]))
    # At most as many pairs as points within the bounds of a box along one of the axes.
    number = np.min([
        np.searchsorted(places, high[:, axis], "right") - np.searchsorted(places, low[:, axis], "left")
        for axis, places in enumerate(np.sort(points[finite], axis=0).T)
    ], axis=0)  # fmt: skip
    filled = np.flatnonzero(number)
    for boxes in np.split(filled, np.flatnonzero(np.diff(np.cumsum(number[filled]) // most)) + 1):
        box, point = tree.query(shapely.box(*low[boxes].T, *high[boxes].T))
        yield finite[point], boxes[box]


def pairwise_distances(ones: Sequence[ArrayLike | Region], others: Sequence[ArrayLike | Region]) -> Array:
    """Distances (m, k) between regions, closed polygons (m, 2) or points (1, 2); 0 where they intersect."""
    distances: Array = shapely.distance(_shapes(ones)[:, None], _shapes(others)[None])
    return distances


def line_distances(line: ArrayLike, others: Sequence[ArrayLike]) -> Array:
    """Distances (k,) from a polyline through points to other polylines; 0 where they cross."""
    lines = np.array([shapely.LineString(points) for points in others], dtype=object)
    distances: Array = shapely.distance(shapely.LineString(line), lines)
    return distances


def parents(rings: Sequence[ArrayLike]) -> list[int] | None:
    """Index of the smallest polygon around each of several polygons (m, 2), -1 for none; None if two of them meet."""
    shapes = np.array([shapely.Polygon(ring) for ring in rings], dtype=object)
    edges = shapely.boundary(shapes)
    if shapely.STRtree(edges).query(edges, predicate="intersects").shape[1] > len(edges):
        return None
    starts = shapely.points(np.array([np.asarray(ring, dtype=float)[0] for ring in rings]))
    around, order = np.full(len(rings), -1), np.argsort(-shapely.area(shapes), kind="stable")
    shapely.prepare(shapes)
    for place, k in enumerate(order):
        within = order[place + 1 :]
        # Smaller ones come later, so that the last one stays.
        around[within[shapely.contains(shapes[k], starts[within])]] = k
    return [int(k) for k in around]


def hull(points: ArrayLike) -> Array:
    """Corners (m, 2) of the convex hull of points (P, 2)."""
    return shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(points)))[:-1]


def enclosing_circle(points: ArrayLike) -> tuple[Array, float]:
    """Center (2,) and radius of the smallest enclosing circle of points (P, 2)."""
    cloud = shapely.MultiPoint(points)
    center = shapely.get_coordinates(shapely.minimum_bounding_circle(cloud).centroid)[0]
    return center, float(shapely.minimum_bounding_radius(cloud))


def _points(points: ArrayLike) -> Any:
    return shapely.points(np.asarray(points, dtype=float))


def _shapes(others: Sequence[ArrayLike | Region]) -> Any:
    shapes = []
    for shape in others:
        if isinstance(shape, Region):
            shapes.append(shape._shape)
        else:
            corners = np.asarray(shape, dtype=float)
            shapes.append(shapely.Point(corners[0]) if len(corners) == 1 else shapely.Polygon(corners))
    return np.array(shapes, dtype=object)
