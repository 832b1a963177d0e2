"""Curves of drawings, and their approximation by polylines within a tolerance."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import asin, ceil, pi, sqrt, tan
from typing import Self

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import center_of

MOST_POINTS = 100_000
"""Maximum number of points of one polyline."""

ROUND = 1e-6
"""Maximum deviation of an arc from a circle, as a share of its radius: files truncate digits."""

SHORTEST = 1e-3
"""Minimum angle in rad of an arc that is kept as one."""


class Curve(ABC):
    """A curve in the plane or in space (d = 2 or 3)."""

    @abstractmethod
    def mapped(self, matrix: Array) -> "Curve":
        """Return the image under an affine map (e, d + 1): x -> matrix[:, :d] x + matrix[:, d]."""

    @abstractmethod
    def sketch(self) -> Array:
        """Return a few points (m, d) on or around the curve that show its size and place."""

    @abstractmethod
    def flatten(self, tolerance: float) -> Array:
        """Return points (m, d) on the curve from start to end whose chords deviate by at most the tolerance."""

    def trace(self, tolerance: float) -> tuple[Array, Array]:
        """Return points (m, d) like `flatten`, and bulges (m - 1,) of the segments: 0 except for circular arcs."""
        points = self.flatten(tolerance)
        return points, np.zeros(len(points) - 1)


@dataclass(frozen=True)
class PointCurve(Curve):
    """A curve that follows its points (m, d), also through affine maps."""

    points: Array

    def mapped(self, matrix: Array) -> Self:
        """See `Curve.mapped`."""
        return replace(self, points=_map(matrix, self.points))

    def sketch(self) -> Array:
        """See `Curve.sketch`."""
        return self.points


class Polyline(PointCurve):
    """Line segments between points (m, d)."""

    def flatten(self, tolerance: float) -> Array:
        """See `Curve.flatten`."""
        del tolerance
        return self.points


class Bezier(PointCurve):
    """A Bezier curve of any degree, given by control points (degree + 1, d)."""

    def flatten(self, tolerance: float) -> Array:
        """See `Curve.flatten`; a chord over a step h deviates by at most h^2 / 8 times the maximum of f''."""
        degree = len(self.points) - 1
        bend = float(np.linalg.norm(np.diff(self.points, 2, axis=0), axis=1).max(initial=0.0)) * degree * (degree - 1)
        t = np.linspace(0.0, 1.0, _steps(sqrt(bend / (8 * tolerance))) + 1)[:, None, None]
        points = np.broadcast_to(self.points, (len(t), *self.points.shape))
        for _ in range(degree):  # de Casteljau's algorithm
            points = (1 - t) * points[:, :-1] + t * points[:, 1:]
        return points[:, 0]


@dataclass(frozen=True)
class Arc(Curve):
    """Elliptical arc: center + u cos(t) + v sin(t), t from `start` over `sweep` (rad), with any vectors u and v (d,).

    Any two conjugate semi-diameters define an ellipse, so that every affine map of an arc is an arc, even sheared.
    """

    center: Array
    u: Array
    v: Array
    start: float = 0.0
    sweep: float = 2 * pi

    def mapped(self, matrix: Array) -> "Arc":
        """See `Curve.mapped`."""
        linear = matrix[:, :-1]
        return Arc(_map(matrix, self.center), linear @ self.u, linear @ self.v, self.start, self.sweep)

    def sketch(self) -> Array:
        """See `Curve.sketch`."""
        return self._at(33)

    def flatten(self, tolerance: float) -> Array:
        """See `Curve.flatten`; a chord over an angle h of a circle deviates by r (1 - cos(h / 2)) = 2 r sin(h / 4)^2.

        An ellipse is a circle of its semi-major axis compressed along one direction, which increases no deviation. One
        without end has no points: nan.
        """
        if not np.isfinite([self.u, self.v]).all():
            return np.full((2, len(self.center)), np.nan)
        radius = float(np.linalg.norm(np.stack([self.u, self.v]), ord=2))
        if radius <= tolerance:
            return self._at(5)
        steps = _steps(abs(self.sweep) / (4 * asin(sqrt(tolerance / (2 * radius)))))
        # A multiple of four preserves a circle's extent and symmetry.
        return self._at(4 * ceil(steps / 4) + 1)

    def trace(self, tolerance: float) -> tuple[Array, Array]:
        """See `Curve.trace`; a circular arc in the plane is one arc of at most half a turn, or two."""
        long, short = np.linalg.svd(np.stack([self.u, self.v]), compute_uv=False)[:2]
        round_ = long - short <= min(ROUND * long, tolerance / 10) and long > tolerance
        if len(self.center) != 2 or not round_ or not SHORTEST <= abs(self.sweep) <= 2 * pi * (1 + ROUND):
            return super().trace(tolerance)
        halves = 1 if abs(self.sweep) <= pi * (1 + ROUND) else 2
        # u and v of the other hand turn the arc around.
        sweep = self.sweep if self.u[0] * self.v[1] > self.u[1] * self.v[0] else -self.sweep
        half = min(abs(sweep) / halves, pi)
        return self._at(halves + 1), np.full(halves, np.copysign(tan(half / 4), sweep) if half < pi else np.sign(sweep))

    def _at(self, count: int) -> Array:
        t = np.linspace(self.start, self.start + self.sweep, count)[:, None]
        return self.center + self.u * np.cos(t) + self.v * np.sin(t)


@dataclass(frozen=True)
class Spline(PointCurve):
    """A B-spline, rational if weights differ: control points (n, d), weights (n,) above 0, knots (n + degree + 1,).

    Its domain is from ``knots[degree]`` to ``knots[n]``.
    """

    weights: Array
    knots: Array
    degree: int

    def flatten(self, tolerance: float) -> Array:
        """See `Curve.flatten`: steps are halved until three points between their ends are near the chord.

        Initial steps divide each knot span more finely than a polynomial of this degree can oscillate.
        """
        spans = np.unique(self.knots[self.degree : len(self.points) + 1])
        # A piece of a spline is a polynomial of that degree, with fewer turns than samples.
        count = 2 * self.degree
        _steps((len(spans) - 1) * count)
        inner = np.arange(count) / count
        t = np.append((spans[:-1, None] + np.diff(spans)[:, None] * inner).ravel(), spans[-1])
        points = self._at(t)
        for _ in range(40):
            ends = np.diff(t)
            between = [self._at(t[:-1] + share * ends) for share in (0.25, 0.5, 0.75)]
            off = np.max([_distance(point, points[:-1], points[1:]) for point in between], axis=0)
            # Half the tolerance, since the curve may deviate more between the sampled points.
            coarse = off > tolerance / 2
            if not coarse.any():
                break
            _steps(len(t) + int(np.count_nonzero(coarse)))
            at = np.flatnonzero(coarse) + 1
            t, points = (
                np.insert(t, at, t[at - 1] + ends[coarse] / 2),
                np.insert(points, at, between[1][coarse], axis=0),
            )
        return points

    def _at(self, t: Array) -> Array:
        from scipy.interpolate import BSpline

        # A rational spline is a plain one in homogeneous coordinates.
        homogeneous = np.column_stack([self.points * self.weights[:, None], self.weights])
        values = BSpline(self.knots, homogeneous, self.degree)(t)
        return values[:, :-1] / values[:, -1:]


def bulge(start: Array, end: Array, amount: float) -> Curve:
    """Arc between points (2,) with bulge tan(angle / 4), positive if counterclockwise.

    The arc's sagitta is ``amount`` half chords; below 1e-7 it is a line.
    """
    chord = end - start
    # The sagitta is amount times half the chord; here the center would be more than a million chords away.
    if abs(amount) < 1e-7 or not chord.any():
        return Polyline(np.stack([start, end]))
    center = np.array(center_of(((start[0], start[1]), (end[0], end[1]), amount)))
    u = start - center
    return Arc(center, u, np.array([-u[1], u[0]]), 0.0, 4 * float(np.arctan(amount)))


def _map(matrix: Array, points: Array) -> Array:
    return points @ matrix[:, :-1].T + matrix[:, -1]


def _steps(count: float) -> int:
    if not count <= MOST_POINTS:
        expected = f"curves that {MOST_POINTS} points can approximate to the tolerance"
        raise InputError(expected, "a larger or more winding one", "simplify the outline, or give its --boundary-unit")
    return max(ceil(count), 1)


def _distance(points: Array, start: Array, end: Array) -> Array:
    """Distances (m,) of points (m, d) from segments."""
    chord = end - start
    square = np.maximum(np.sum(chord**2, axis=1), np.finfo(float).tiny)
    along = np.clip(np.sum((points - start) * chord, axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(points - start - along[:, None] * chord, axis=1)
