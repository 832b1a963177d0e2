"""Curves of drawings: flattened to polylines within a tolerance, and joined to closed contours."""

# tests: tests/read/outlines/test_curves.py tests/read/outlines/test_joining.py tests/read/outlines/test_left_out.py

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import asin, ceil, pi, sqrt, tan
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import Contour, center_of, flattened, merged
from markergen.geometry.outlines import SHALLOWEST, TOLERANCE, place
from markergen.geometry.region import Region
from markergen.read.remarks import MOST_LISTED, remark
from markergen.units import format_length

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
        sides = self.points[1:] - self.points[:-1]
        second = sides[1:] - sides[:-1]
        bend = sqrt(float((second * second).sum(axis=1).max(initial=0.0))) * degree * (degree - 1)
        t = _parameters(_steps(sqrt(bend / (8 * tolerance))))
        points = self.points[None]
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


@lru_cache(maxsize=64)
def _parameters(steps: int) -> Array:
    """Parameters (steps + 1, 1, 1) of a curve's points: text as outlines has thousands of curves of few steps."""
    parameters = np.linspace(0.0, 1.0, steps + 1)[:, None, None]
    parameters.flags.writeable = False
    return parameters


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


APART = 0.1
"""Minimum distance of a center line's ends from other loose ends, as a share of its length: the sides of a shape whose
corners do not quite meet have ends that are closer."""


@dataclass(frozen=True)
class Track:
    """Points (m, 2) in m along a named piece of outline; if closed, the last is joined to the first.

    Bulges (m - 1,) describe the segments between them, as in `Contour`.
    """

    name: str
    points: Array
    closed: bool
    bulges: Array


def closed_contours(tracks: Sequence[Track], tolerance: float, source: str, ignore_open: bool = False) -> list[Contour]:
    """Join tracks into closed contours, in the order of their first tracks, and merge arcs of one circle.

    Ends within `tolerance` (m) of each other are joined; points much closer than that are merged. `source` names the
    file in messages. Beside closed contours, shapes of zero area and lone straight lines that cross a contour are left
    out with a warning.

    Raises InputError if an end meets no other or more than one, or no outline has an area; the message says where.
    """
    rings: list[tuple[int, Track]] = []
    open_tracks: list[tuple[int, Track]] = []
    for i, track in enumerate(tracks):
        thin = _thinned(track, tolerance)
        if len(thin.points) == 1:  # Editors leave single points behind, which have no outline.
            continue
        if track.closed or _near(thin.points[0], thin.points[-1], tolerance):
            rings.append((i, thin))
        else:
            open_tracks.append((i, thin))
    if ignore_open and (loose := _loose([track for _, track in open_tracks], tolerance)):
        left_out = [track for k, (_, track) in enumerate(open_tracks) if k in loose]
        open_tracks = [item for k, item in enumerate(open_tracks) if k not in loose]
        if not rings and not open_tracks:
            raise InputError(f"closed outlines in {source}", f"{len(left_out)} open ones", "close one")
        remark_left_out(f"{source}, open", [(track.name, track.points[0]) for track in left_out], MOST_LISTED)
    lone = _lone_lines([track for _, track in open_tracks], tolerance)
    joined = _joined([open_tracks[k] for k in range(len(open_tracks)) if k not in lone], tolerance, source)
    closed = [(track, _contour(track, tolerance)) for _, track in sorted(rings + joined, key=lambda ring: ring[0])]
    contours = [contour for _, contour in closed if contour is not None]
    flat = [track for track, contour in closed if contour is None]
    lines = [open_tracks[k][1] for k in sorted(lone)]
    if lines and not _cross(lines, contours):
        _joined(open_tracks, tolerance, source)  # Raises the error about their ends.
    if flat and not contours:
        raise InputError(
            f"outlines with an area in {source}",
            f"{flat[0].name} of zero area at {place(flat[0].points[0])}",
            "draw it as a closed shape with an inside, or choose the outline's --layer",
        )
    for kind, left_out in (("of zero area", flat), ("a line that bounds nothing", lines)):
        remark_left_out(source, [(f"{track.name}, {kind},", track.points[0]) for track in left_out])
    return [merged(contour, tolerance) for contour in contours]


def remark_left_out(source: str, pieces: Sequence[tuple[str, ArrayLike]], most: int = 1) -> None:
    """Report in one line the names and places of pieces that are left out, if any; `most` of them are listed."""
    more = f", and {len(pieces) - most} more" if len(pieces) > most else ""
    if pieces:
        names = (f"{name} at {place(np.array(point))}" for name, point in pieces[:most])
        remark(f"left out of {source}: {', '.join(names)}{more}")


def _loose(tracks: list[Track], tolerance: float) -> set[int]:
    """Indices of tracks that end where no other does, also once the others of these are gone."""
    loose: set[int] = set()
    ends, tree = _ends(tracks)
    meeting = [set(ends_near) - {end} for end, ends_near in enumerate(tree.query_ball_point(ends, tolerance))]
    todo = [end // 2 for end, others in enumerate(meeting) if not others]
    while todo:
        if (k := todo.pop()) not in loose:
            loose.add(k)
            for end in (2 * k, 2 * k + 1):
                for other in meeting[end]:
                    meeting[other].discard(end)
                    todo += [other // 2] if not meeting[other] else []
    return loose


def _lone_lines(tracks: list[Track], tolerance: float) -> set[int]:
    """Indices of straight tracks whose ends meet no other and are not even near the loose ends of others."""
    lone = set()
    ends, tree = _ends(tracks)
    for k, track in enumerate(tracks):
        chord = track.points[-1] - track.points[0]
        length = float(np.hypot(*chord))
        across = (track.points - track.points[0]) @ np.array([-chord[1], chord[0]]) / length
        straight = not track.bulges.any() and float(np.abs(across).max()) <= tolerance
        neighbors = tree.query_ball_point(ends[2 * k : 2 * k + 2], max(APART * length, tolerance))
        if straight and not {int(end) // 2 for ends_near in neighbors for end in ends_near} - {k}:
            lone.add(k)
    return lone


def _cross(lines: list[Track], contours: list[Contour]) -> bool:
    """Tell whether each line has its middle inside a contour and an end outside, as center lines have."""
    ends = np.array([line.points[[0, -1]] for line in lines])
    regions = [Region.of_contour(contour, (), TOLERANCE) for contour in contours]
    crossed = [
        region.contains(ends.mean(axis=1)) & ~(region.contains(ends[:, 0]) & region.contains(ends[:, 1]))
        for region in regions
    ]
    return bool(np.any(crossed, axis=0).all())


def _joined(tracks: list[tuple[int, Track]], tolerance: float, source: str) -> list[tuple[int, Track]]:
    """Join open tracks into rings: each end 2 i (start) or 2 i + 1 (end) of track i has exactly one partner."""
    if not tracks:
        return []
    partners = _partners([track for _, track in tracks], tolerance, source)
    rings = []
    left = dict.fromkeys(range(len(tracks)))
    while left:
        first = next(iter(left))
        end, parts = 2 * first, []
        while end // 2 in left:
            del left[end // 2]
            part = tracks[end // 2][1]
            parts.append(replace(part, points=part.points[::-1], bulges=-part.bulges[::-1]) if end % 2 else part)
            end = partners[end ^ 1]
        index, track = tracks[first]
        # Each part starts at the end of the last one.
        points = np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])])
        rings.append((index, Track(track.name, points, True, np.concatenate([part.bulges for part in parts]))))
    return rings


def _ends(tracks: Sequence[Track]) -> tuple[Array, Any]:
    """First and last points (2 t, 2) of tracks, and a tree of them."""
    from scipy.spatial import cKDTree

    ends = np.array([end for track in tracks for end in (track.points[0], track.points[-1])]).reshape(-1, 2)
    return ends, cKDTree(ends)


def _partners(tracks: Sequence[Track], tolerance: float, source: str) -> list[int]:
    """Index of the partner of each end (2 t,)."""
    from scipy.spatial import cKDTree

    ends, tree = _ends(tracks)
    # Three neighbors suffice to detect a branch.
    distances, partners = tree.query(ends, k=min(3, len(ends)))
    meeting = np.count_nonzero(distances <= tolerance, axis=1)
    if (meeting == 1).any():
        alone = np.flatnonzero(meeting == 1)
        loose = ends[alone]
        gaps, partner = cKDTree(loose).query(loose, k=2)
        # A single loose end has no partner; report the gap to its nearest neighbor.
        i = int(np.argmin(gaps[:, 1])) if len(alone) > 1 else 0
        there = loose[partner[i, 1]] if len(alone) > 1 else ends[partners[alone[0], 1]]
        gap = float(np.hypot(*(there - loose[i])))
        more = len(alone) // 2 - 1
        raise InputError(
            f"closed outlines in {source}",
            f"{tracks[alone[i] // 2].name} open: a gap of {format_length(gap)} between {place(loose[i])} and "
            f"{place(there)}{f', and {more} more gaps' if more > 0 else ''}",
            "close it there, choose the outline's --layer, or leave open lines out with --ignore-open",
        )
    if (meeting > 2).any():
        i = int(np.flatnonzero(meeting > 2)[0])
        raise InputError(
            f"outlines that do not branch in {source}",
            f"three or more ends at {place(ends[i])}, one of {tracks[i // 2].name}",
            "remove what is drawn twice or joins two sides, or choose the outline's --layer",
        )
    self_first = partners[:, 0] == np.arange(len(ends))
    return np.where(self_first, partners[:, 1], partners[:, 0]).tolist()


def _thinned(track: Track, tolerance: float) -> Track:
    """Drop points within a tenth of the tolerance of the last point kept."""
    points, apart = track.points, tolerance / 10
    steps = np.hypot(*np.diff(points, axis=0).T)
    if np.all(steps > apart):
        return track
    kept = [0]
    for k in range(1, len(points)):
        if not _near(points[k], points[kept[-1]], apart):
            kept.append(k)
    # Arcs are half a turn at most, so that one with close ends is short.
    return Track(track.name, points[kept], track.closed, track.bulges[np.array(kept[1:], dtype=int) - 1])


def _contour(track: Track, tolerance: float) -> Contour | None:
    """Contour of a closed track; None if it has no area."""
    points, bulges = track.points, np.append(track.bulges, 0.0)
    if _near(points[0], points[-1], tolerance):
        points, bulges = points[:-1], bulges[:-1]
    bulges = np.where(np.abs(bulges) < SHALLOWEST, 0.0, bulges)
    contour = Contour(tuple((x, y) for x, y in points.tolist()), tuple(bulges.tolist()) if bulges.any() else ())
    corners = np.array(flattened(contour, 100 * tolerance))
    return None if len(corners) < 3 or _thin(corners, tolerance) else contour


def _thin(points: Array, tolerance: float) -> bool:
    """Tell whether an outline is nowhere wider than the tolerance."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if np.ptp(points @ axes[1]) <= tolerance:
        return True
    inside = Region.polygon(points)
    # A figure eight may have no area either, but is reported as self-intersecting.
    return inside.area <= tolerance * inside.perimeter / 2 and not inside.crosses_itself


def _near(a: Array, b: Array, tolerance: float) -> bool:
    return bool(np.hypot(*(a - b)) <= tolerance)
