"""The region that contains all dots. A new shape is a new subclass; no other code depends on the kind of shape."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import isfinite, pi
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, backward, circle, placed
from markergen.geometry.distance import Edges, Interior
from markergen.geometry.outlines import Ring, canonical_contours, polygons_of
from markergen.geometry.region import Region, enclosing_circle, signed_area
from markergen.units import LARGEST_LENGTH, SMALLEST_LENGTH, format_length

CIRCLE_CORNERS = 720
"""Corners of the polygon that approximates a circle in drawings; it is 1.4 um off at a radius of 0.15 m."""


class Boundary(ABC):
    """A closed region of the marker plane.

    The marker frame's origin is the center of its smallest enclosing circle, unless an imported outline keeps its own.
    """

    @property
    @abstractmethod
    def radius(self) -> float:
        """Radius r of the smallest enclosing circle in m: the marker's size, wherever the origin is."""

    @property
    @abstractmethod
    def center(self) -> tuple[float, float]:
        """Center (x, y) of the smallest enclosing circle in m: the origin, except for keep-outs and kept origins."""

    @property
    @abstractmethod
    def area(self) -> float:
        """Area in m^2."""

    @abstractmethod
    def depth(self, points: Array) -> Array:
        """Return the signed distance (...) in m from points (..., 2) to the outline: positive inside."""

    @abstractmethod
    def depth_gradient(self, points: Array) -> Array:
        """Return the gradient (..., 2) of `depth`: a unit vector straight into the region; zero where undefined."""

    @abstractmethod
    def project(self, points: Array, inset: float) -> Array:
        """Return the nearest points (..., 2) at least `inset` m inside the outline; deeper points stay in place.

        Where nothing is that deep, return the deepest point.
        """

    @abstractmethod
    def sample(self, count: int, inset: float, rng: "np.random.Generator") -> Array:
        """Draw (count, 2) points uniformly from the region inset by `inset` m; the deepest point if it is empty."""

    @abstractmethod
    def rim(self, count: int) -> Array:
        """Return points (count, 2) spread evenly along the outer outline, without its holes."""

    @abstractmethod
    def outlines(self) -> tuple[Array, ...]:
        """Return closed polygons (m, 2) in m, outer ones counterclockwise and holes clockwise; circles are polygons."""

    @abstractmethod
    def contours(self, flat: bool = False) -> tuple[Contour, ...]:
        """Return the exact outline: closed contours in m of lines and arcs, with the region to their left.

        If `flat`, the outline used by depth and search: the arcs of a `Polygon` are fine polygons; disks stay circles.
        """

    @property
    def region(self) -> Region:
        """Return the inside of `outlines`."""
        return Region.enclosed(self.outlines())

    @property
    def is_round(self) -> bool:
        """True if the outline consists of full circles."""
        return all(contour.is_circle for contour in self.contours(flat=True))

    @property
    def has_arcs(self) -> bool:
        """True if it has arcs, which `as_dict` writes as bulges and early programs cannot read."""
        return False

    @property
    def has_measures(self) -> bool:
        """True for a disk, or an upright rectangle about the origin, which are written by their dimensions.

        Any other outline is considered drawn, and is the outline of the plate (see `Substrate.edge_around`).
        """
        return False

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values with the shape's ``kind`` and its dimensions in m."""


@dataclass(frozen=True)
class Circle(Boundary):
    """A disk, around the origin unless it is a keep-out.

    Raises
    ------
    InputError
        If the radius is not a number from 1 um to 1 km, or the center is farther off than 1 km.
    """

    size: float
    center: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.size > 0 or not isfinite(self.size):
            raise InputError(
                "a radius above 0", f"radius={self.size} m", "give a positive length such as 0.15 or 150mm"
            )
        if not SMALLEST_LENGTH <= self.size <= LARGEST_LENGTH:
            raise InputError("a radius of 1 um to 1 km", f"radius={self.size} m", "write its unit, such as 150mm")
        if not all(map(isfinite, self.center)):
            raise InputError("a finite center", f"center={self.center} m", "give two lengths")
        if not all(abs(x) <= LARGEST_LENGTH for x in self.center):
            raise InputError("a center of at most 1 km", f"center={self.center} m", "give two lengths")

    @property
    def radius(self) -> float:
        """See `Boundary.radius`."""
        return self.size

    @property
    def area(self) -> float:
        """See `Boundary.area`."""
        return pi * self.size**2

    def depth(self, points: Array) -> Array:
        """See `Boundary.depth`."""
        return self.size - np.hypot(points[..., 0] - self.center[0], points[..., 1] - self.center[1])

    def depth_gradient(self, points: Array) -> Array:
        """See `Boundary.depth_gradient`."""
        offset = points - self.center
        distance = np.hypot(offset[..., 0], offset[..., 1])[..., None]
        return -offset / np.maximum(distance, np.finfo(float).tiny)

    def project(self, points: Array, inset: float) -> Array:
        """See `Boundary.project`."""
        limit = max(self.size - inset, 0.0)
        offset = points - self.center
        distance = np.hypot(offset[..., 0], offset[..., 1])[..., None]
        inner = offset * (limit / np.maximum(distance, np.finfo(float).tiny))
        if self.center != (0.0, 0.0):
            inner = inner + self.center
        return np.where(distance > limit, inner, points)

    def sample(self, count: int, inset: float, rng: "np.random.Generator") -> Array:
        """See `Boundary.sample`."""
        distance = max(self.size - inset, 0.0) * np.sqrt(rng.random(count))
        return distance[:, None] * _directions(2 * pi * rng.random(count)) + self.center

    def rim(self, count: int) -> Array:
        """See `Boundary.rim`."""
        return self.size * _directions(2 * pi * np.arange(count) / count) + self.center

    def outlines(self) -> tuple[Array, ...]:
        """See `Boundary.outlines`."""
        return (self.rim(CIRCLE_CORNERS),)

    def contours(self, flat: bool = False) -> tuple[Contour, ...]:  # noqa: ARG002  (a circle is exact)
        """See `Boundary.contours`."""
        return (circle(self.size, *self.center),)

    @property
    def has_measures(self) -> bool:
        """See `Boundary.has_measures`."""
        return True

    def as_dict(self) -> dict[str, Any]:
        """See `Boundary.as_dict`; the center is left out if it is the origin."""
        center = {} if self.center == (0.0, 0.0) else {"center": list(self.center)}
        return {"kind": "circle", "radius": self.size, **center}

    def __str__(self) -> str:
        return f"disk of radius {format_length(self.size)}"


class _Drawn(Boundary):
    """A region whose interior is computed from its curves."""

    def project(self, points: Array, inset: float) -> Array:
        """See `Boundary.project`."""
        return _interior(self).project(points, inset)

    def sample(self, count: int, inset: float, rng: "np.random.Generator") -> Array:
        """See `Boundary.sample`."""
        return _interior(self).sample(count, inset, rng)


@dataclass(frozen=True, repr=False)
class Polygon(_Drawn):
    """One or more regions with straight or arc edges, each with or without holes.

    Depth, projection and search approximate arcs by fine polygons within the region (see `polygons_of`).

    Attributes
    ----------
    rings : tuple of tuple of (x, y)
        Corners of closed outlines in m, marker frame, without repeating the first corner. An outline within another is
        a hole in it, one within the hole a region again; their orientation is irrelevant, and is normalized to
        counterclockwise for outer ones and clockwise for holes.
    bulges : tuple of tuple of float
        Bulges of the edges from each corner to the next, as in `Contour`; empty if all are straight.

    Raises
    ------
    InputError
        See `canonical_contours`.
    """

    rings: tuple[Ring, ...]
    bulges: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        contours = canonical_contours(self.rings, self.bulges)
        arcs = any(contour.has_arcs for contour in contours)
        bulges = tuple(contour.bulges or (0.0,) * len(contour.points) for contour in contours) if arcs else ()
        object.__setattr__(self, "rings", tuple(contour.points for contour in contours))
        object.__setattr__(self, "bulges", bulges)

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        # There are many corners; `as_dict` has them.
        return f"Polygon({str(self).partition(' of ')[2]}, {sum(map(len, self.rings))} corners)"

    def __getstate__(self) -> dict[str, Any]:
        # Cached results are not sent to other processes.
        return {"rings": self.rings, "bulges": self.bulges}

    @cached_property
    def _hash(self) -> int:
        return hash((self.rings, self.bulges))

    @cached_property
    def _arrays(self) -> tuple[Array, ...]:
        arrays = polygons_of(self.contours())
        for array in arrays:
            array.setflags(write=False)
        return arrays

    @cached_property
    def _edges(self) -> Edges:
        return Edges(self._arrays, self.radius)

    @cached_property
    def _circle(self) -> tuple[Array, float]:
        return enclosing_circle(np.concatenate(self._arrays))

    @property
    def radius(self) -> float:
        """See `Boundary.radius`."""
        return self._circle[1]

    @property
    def center(self) -> tuple[float, float]:
        """See `Boundary.center`."""
        return float(self._circle[0][0]), float(self._circle[0][1])

    @cached_property
    def area(self) -> float:
        """See `Boundary.area`; arcs are included exactly."""
        return sum(map(area, self.contours())) if self.has_arcs else sum(map(signed_area, self._arrays))

    def depth(self, points: Array) -> Array:
        """See `Boundary.depth`."""
        return self._edges.depth(points.reshape(-1, 2)).reshape(points.shape[:-1])

    def depth_gradient(self, points: Array) -> Array:
        """See `Boundary.depth_gradient`; if several edges are nearest, one of them decides."""
        return self._edges.depth_gradient(points.reshape(-1, 2)).reshape(points.shape)

    def rim(self, count: int) -> Array:
        """See `Boundary.rim`; evenly spaced over all outer outlines, starting half a step after the first corner."""
        outer = [np.concatenate([ring, ring[:1]]) for ring in self._arrays if signed_area(ring) > 0]
        lengths = [np.linalg.norm(np.diff(ring, axis=0), axis=-1) for ring in outer]
        ends = np.cumsum(np.concatenate(lengths))
        start, step = np.concatenate([ring[:-1] for ring in outer]), np.concatenate([np.diff(r, axis=0) for r in outer])
        along = ends[-1] * (np.arange(count) + 0.5) / count
        edge = np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1)
        left = (ends[edge] - along) / np.concatenate(lengths)[edge]
        return start[edge] + (1 - left)[:, None] * step[edge]

    def outlines(self) -> tuple[Array, ...]:
        """See `Boundary.outlines`."""
        return self._arrays

    def contours(self, flat: bool = False) -> tuple[Contour, ...]:
        """See `Boundary.contours`."""
        if flat and self.has_arcs:
            return tuple(Contour(tuple((x, y) for x, y in ring.tolist())) for ring in self._arrays)
        bulges = self.bulges or ((),) * len(self.rings)
        return tuple(Contour(ring, row) for ring, row in zip(self.rings, bulges, strict=True))

    @property
    def has_arcs(self) -> bool:
        """See `Boundary.has_arcs`."""
        return bool(self.bulges)

    @property
    def has_measures(self) -> bool:
        """See `Boundary.has_measures`."""
        x, y = ({abs(corner[axis]) for corner in self.rings[0]} for axis in (0, 1))
        return len(self.rings) == 1 and len(self.rings[0]) == 4 and len(x) == len(y) == 1 and not self.has_arcs

    def as_dict(self) -> dict[str, Any]:
        """See `Boundary.as_dict`; with bulges if there are arcs."""
        bulges = {"bulges": [list(row) for row in self.bulges]} if self.bulges else {}
        return {"kind": "polygon", "outlines": [[list(corner) for corner in ring] for ring in self.rings], **bulges}

    def __str__(self) -> str:
        points = np.concatenate(self._arrays)
        width, height = (format_length(float(size)) for size in np.round(np.ptp(points, axis=0), 9))
        regions = sum(signed_area(ring) > 0 for ring in self._arrays)
        holes = len(self._arrays) - regions
        parts = [f"{regions} regions"] * (regions > 1) + [f"{holes} hole{'s' * (holes > 1)}"] * (holes > 0)
        kind = "rectangle" if self.has_measures else "polygon"
        return f"{kind} of {width} x {height}" + (f" with {' and '.join(parts)}" if parts else "")


@dataclass(frozen=True)
class Without(_Drawn):
    """A boundary without its keep-outs, the region for dots. Size, rim and origin are the boundary's.

    `depth` is the smallest of the distances to the boundary and to each keep-out: exact inside, a lower bound of the
    distance outside.
    """

    boundary: Boundary
    keep_outs: tuple[Boundary, ...]

    @property
    def radius(self) -> float:
        """See `Boundary.radius`; that of the boundary."""
        return self.boundary.radius

    @property
    def center(self) -> tuple[float, float]:
        """See `Boundary.center`; that of the boundary."""
        return self.boundary.center

    @cached_property
    def area(self) -> float:
        """See `Boundary.area`; circles are approximated by fine polygons."""
        return sum(map(signed_area, self.outlines()))

    def depth(self, points: Array) -> Array:
        """See `Boundary.depth`."""
        depth = self.boundary.depth(points)
        for keep_out in self.keep_outs:
            depth = np.minimum(depth, -keep_out.depth(points))
        return depth

    def depth_gradient(self, points: Array) -> Array:
        """See `Boundary.depth_gradient`."""
        depth, gradient = self.boundary.depth(points), self.boundary.depth_gradient(points)
        for keep_out in self.keep_outs:
            outside = -keep_out.depth(points)
            gradient = np.where((outside < depth)[..., None], -keep_out.depth_gradient(points), gradient)
            depth = np.minimum(depth, outside)
        return gradient

    def rim(self, count: int) -> Array:
        """See `Boundary.rim`; that of the boundary."""
        return self.boundary.rim(count)

    def outlines(self) -> tuple[Array, ...]:
        """See `Boundary.outlines`."""
        return self._outlines

    @cached_property
    def _outlines(self) -> tuple[Array, ...]:
        taken = Region.union([keep_out.region for keep_out in self.keep_outs])
        return (self.boundary.region - taken).oriented().rings

    def contours(self, flat: bool = False) -> tuple[Contour, ...]:
        """See `Boundary.contours`; includes parts outside the region."""
        taken = (contour for keep_out in self.keep_outs for contour in keep_out.contours(flat))
        return (*self.boundary.contours(flat), *map(backward, taken))

    def as_dict(self) -> dict[str, Any]:
        """See `Boundary.as_dict`."""
        return {
            "kind": "without",
            "boundary": self.boundary.as_dict(),
            "keep_outs": [keep_out.as_dict() for keep_out in self.keep_outs],
        }

    def __str__(self) -> str:
        count = len(self.keep_outs)
        return f"{self.boundary} with {count} keep-out{'s' * (count > 1)}"


def polygon_from(outlines: Sequence[Array | Contour], origin: str = "center") -> Polygon:
    """Build a polygon from outlines in m, with the origin moved to the center of the smallest enclosing circle.

    Coordinates are rounded to whole picometers, to remove the rounding errors of the shift.

    Parameters
    ----------
    outlines : sequence of array (m, 2) or Contour
    origin : {"center", "file"}
        ``file`` keeps the origin.

    Raises
    ------
    InputError
        See `Polygon`.
    """
    if origin not in ("center", "file"):
        raise InputError("an origin of center or file", repr(origin), "use --origin center or --origin file")
    corners = [outline.points if isinstance(outline, Contour) else outline for outline in outlines]
    bulges = [outline.bulges if isinstance(outline, Contour) else () for outline in outlines]
    contours = canonical_contours(corners, bulges)
    center = middle_of(contours) if origin == "center" else np.zeros(2)
    moved = [placed(contour, 1.0, center, 12) for contour in contours]
    return Polygon(tuple(contour.points for contour in moved), tuple(contour.bulges for contour in moved))


def middle_of(contours: Sequence[Contour]) -> Array:
    """Center (2,) of the smallest circle around a drawing, where a marker's origin comes to lie."""
    return enclosing_circle(np.concatenate(polygons_of(contours)))[0]


def filled_outline(contour: Contour) -> Boundary:
    """Make the region inside a contour in m, whichever way it turns, such as that of a hole; it keeps its place."""
    if (whole := contour.as_circle) is not None:
        x, y, radius = (round(value, 12) for value in whole)
        return Circle(radius, (x, y))
    return polygon_from([contour], "file")


def area_without(boundary: Boundary, keep_outs: Sequence[Boundary]) -> Boundary:
    """Return the region for dots: the boundary, or what the keep-outs leave of it.

    Raises
    ------
    InputError
        If they leave nothing.
    """
    if not keep_outs:
        return boundary
    left = Without(boundary, tuple(keep_outs))
    if not left.area > 1e-9 * boundary.area:
        raise InputError(
            "keep-outs that leave room in the boundary", f"{left} and nothing left", "use fewer or smaller keep-outs"
        )
    return left


@lru_cache(maxsize=64)
def _interior(boundary: Boundary) -> Interior:
    return Interior(boundary.contours(flat=True), boundary.depth, boundary.radius, lambda: boundary.region)


def _directions(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)
