"""Smooth clearance constraints of a layout: to walls, the smooth pieces of an outline, and between dots.

The depth of a point has a kink wherever two edges are equally near, especially in corners, which is where dots go. A
descent with only the nearest edge as a constraint zigzags between the two; with a separate constraint for each edge it
goes straight into the corner.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.geometry.contour import rings_and_circles
from markergen.model.boundary import Boundary

Index = NDArray[np.int64]

CORNER, BEND = np.deg2rad(10.0), np.deg2rad(45.0)
"""Angles at which walls end: at a corner sharper than the first, or after a total turn of the second."""

BLOCK = 2**17
"""Pairs of point and segment per block, to limit memory."""

MOST_WALLS = 16
"""Maximum number of walls, the nearest ones, that constrain one dot: hundreds may be within reach on a toothed outline,
and time and memory of SLSQP grow with the square of their number. A dot that violates one of the others is moved back
by `FeasibleRegion.project`."""


@dataclass(frozen=True, eq=False)
class Walls:
    """Smooth pieces of an outline, the region to their left: w chains, of s segments in total, then c circles.

    Attributes
    ----------
    start, unit : arrays (s, 2)
        Starts in m and directions of the segments, chain after chain.
    length : array (s,), m
    first, count : arrays (w,)
        Index of the first segment of each chain, and number of its segments.
    open_start, open_end : arrays (s,) of bool
        Ends of chains at corners that point outward, beyond which the edge is extended as a straight line.
    circles : array (c, 4)
        Circles as returned by `rings_and_circles`.
    """

    start: Array
    unit: Array
    length: Array
    first: Index
    count: Index
    open_start: Mask
    open_end: Mask
    circles: Array

    def __len__(self) -> int:
        return len(self.first) + len(self.circles)

    def distance(self, points: Array, walls: Index, signed: Mask | bool = False) -> tuple[Array, Array]:
        """Distances (m,) in m from points (m, 2) to one wall each, and their gradients (m, 2).

        Where `signed` is true, distances are negative on the side away from the region, and the edge at a corner that
        points outward is extended as an infinite straight line, so that the sign is right beyond the corner.
        """
        distance, gradient = np.empty(len(points)), np.empty((len(points), 2))
        signed = np.broadcast_to(np.asarray(signed), walls.shape)
        straight = walls < len(self.first)
        if straight.any():
            to_chains = self._to_chains(points[straight], walls[straight], signed[straight])
            distance[straight], gradient[straight] = to_chains
        if not straight.all():
            x, y, radius, side = self.circles[walls[~straight] - len(self.first)].T
            offset = points[~straight] - np.stack([x, y], axis=-1)
            away = np.hypot(*offset.T)
            distance[~straight] = side * (radius - away)
            gradient[~straight] = -side[:, None] * offset / np.maximum(away, np.finfo(float).tiny)[:, None]
        return distance, gradient

    def _to_chains(self, points: Array, walls: Index, signed: Mask) -> tuple[Array, Array]:
        count = self.count[walls]
        ends = np.cumsum(count)
        if len(points) > 1 and ends[-1] > BLOCK:
            half = len(points) // 2
            parts = [self._to_chains(points[s], walls[s], signed[s]) for s in (slice(half), slice(half, None))]
            return np.concatenate([parts[0][0], parts[1][0]]), np.concatenate([parts[0][1], parts[1][1]])
        # All pairs of a point and a segment of its wall.
        pair = np.repeat(np.arange(len(points)), count)
        segment = np.arange(ends[-1]) + (self.first[walls] - ends + count)[pair]
        (x, y), (ux, uy) = (points[pair] - self.start[segment]).T, self.unit[segment].T
        along, left = x * ux + y * uy, y * ux - x * uy
        low = np.where(self.open_start[segment] & signed[pair], -np.inf, 0.0)
        high = np.where(self.open_end[segment] & signed[pair], np.inf, self.length[segment])
        past = along - np.clip(along, low, high)
        square = left**2 + past**2
        least = np.flatnonzero(square == np.minimum.reduceat(square, ends - count)[pair])
        # The first of several equally near segments, since the last write wins.
        nearest = np.zeros(len(points), dtype=np.int64)
        nearest[pair[least[::-1]]] = least[::-1]
        left, past, segment = left[nearest], past[nearest], segment[nearest]
        unit, distance = self.unit[segment], np.hypot(left, past)
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
        away = left[:, None] * normal + past[:, None] * unit
        # Around the end of a chain the region lies on both sides of its line.
        at_first, at_last = segment == self.first[walls], segment == self.first[walls] + count - 1
        ended = (at_first & (past < 0)) | (at_last & (past > 0))
        sign = np.where((left < 0) & signed & ~ended, -1.0, 1.0)
        # Beside an edge the normal is free of rounding errors, even on the edge itself.
        flat = ((past == 0) & signed) | (distance < 1e-12)
        gradient = sign[:, None] * away / np.maximum(distance, np.finfo(float).tiny)[:, None]
        return np.where(flat, left, sign * distance), np.where(flat[:, None], normal, gradient)


def walls_of(boundary: Boundary) -> Walls:
    """Split the outline of a boundary into smooth pieces."""
    rings, circles = rings_and_circles(boundary.contours(flat=True))
    chains = [chain for ring in rings for chain in _chains(ring)]
    empty = np.zeros((0, 2))
    start = np.concatenate([empty, *(corners[:-1] for corners, *_ in chains)])
    step = np.concatenate([empty, *(np.diff(corners, axis=0) for corners, *_ in chains)])
    count = np.array([len(corners) - 1 for corners, *_ in chains], dtype=np.int64)
    first = np.cumsum(count) - count
    opened, closing = np.zeros((2, len(start)), dtype=bool)
    opened[first] = [outward for _, outward, _ in chains]
    closing[first + count - 1] = [outward for *_, outward in chains]
    length = np.linalg.norm(step, axis=-1)
    return Walls(start, step / length[:, None], length, first, count, opened, closing, circles)


def _chains(ring: Array) -> list[tuple[Array, bool, bool]]:
    """Vertices (k, 2) of each smooth piece of a closed polygon, and whether its first and last point outward."""
    after = np.roll(ring, -1, axis=0) - ring
    before = np.roll(after, 1, axis=0)
    angle = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=-1))
    sharp = np.abs(angle) > CORNER
    # Start the first piece at a corner, if there is one.
    corner = int(np.argmax(sharp))
    ring, angle, sharp = np.roll(ring, -corner, axis=0), np.roll(angle, -corner), np.roll(sharp, -corner)
    ends, bent = [0], 0.0
    for i in range(1, len(ring)):
        bent += abs(angle[i])
        if sharp[i] or bent > BEND:
            ends.append(i)
            bent = 0.0
    outward = sharp & (angle > 0)
    return [
        (np.take(ring, np.arange(a, b + 1), axis=0, mode="wrap"), bool(outward[a]), bool(outward[b % len(ring)]))
        for a, b in zip(ends, [*ends[1:], len(ring)], strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of dot and wall, and pairs of dots, that may touch.

    Attributes
    ----------
    dot, wall : arrays (a,)
        Indices of dot and wall of each pair.
    signed : array (a,) of bool
        See `Walls.distance`.
    first, second : arrays (b,)
        Indices of the dots of each pair.
    """

    walls: Walls
    dot: Index
    wall: Index
    signed: NDArray[np.bool_]
    first: Index
    second: Index

    def of(self, dots: Index) -> "Contacts":
        """Subset that depends on the positions of the given dots."""
        wall, pair = np.isin(self.dot, dots), np.isin(self.first, dots) | np.isin(self.second, dots)
        return Contacts(
            self.walls, self.dot[wall], self.wall[wall], self.signed[wall], self.first[pair], self.second[pair]
        )

    def room(self, points: Array) -> Array:
        """Distances (a,) in m of control points (n, 2) from their walls."""
        return self.walls.distance(points[self.dot], self.wall, self.signed)[0]

    def room_jacobian(self, points: Array) -> Array:
        """Derivative (a, n, 2) of `room`."""
        jacobian = np.zeros((len(self.dot), *points.shape))
        gradient = self.walls.distance(points[self.dot], self.wall, self.signed)[1]
        jacobian[np.arange(len(self.dot)), self.dot] = gradient
        return jacobian

    def apart(self, points: Array) -> Array:
        """Vectors (b, 2) in m between the control points (n, 2) of each pair."""
        return points[self.first] - points[self.second]

    def apart_jacobian(self, points: Array, direction: Array) -> Array:
        """Derivative (b, n, 2) of `apart`, along directions (b, 2)."""
        jacobian = np.zeros((len(self.first), *points.shape))
        pairs = np.arange(len(self.first))
        jacobian[pairs, self.first], jacobian[pairs, self.second] = direction, -direction
        return jacobian


def contacts(walls: Walls, points: Array, inset: float, to_wall: float, to_dot: float) -> Contacts:
    """Contacts of control points (n, 2) in m with walls and with each other.

    Parameters
    ----------
    inset : float
        Distance in m that the points currently keep from walls.
    to_wall, to_dot : float
        Maximum distances in m of a wall and of another control point to be included; `to_dot` below 0 includes no
        pairs.
    """
    n, count = len(points), len(walls)
    pairs = np.repeat(points, count, axis=0), np.tile(np.arange(count), n)
    distance = walls.distance(*pairs)[0].reshape(n, count)
    is_near = distance <= to_wall
    if count > MOST_WALLS:
        is_near &= distance <= np.partition(distance, MOST_WALLS - 1, axis=1)[:, MOST_WALLS - 1 : MOST_WALLS]
    dot, wall = np.nonzero(is_near)
    # Unsigned for a wall that faces away from the dot, or whose straight extension would wrongly exclude the dot.
    signed = walls.distance(points[dot], wall, True)[0] >= inset - 1e-9
    first, second = np.triu_indices(n, 1)
    close = np.linalg.norm(points[first] - points[second], axis=-1) <= to_dot
    return Contacts(walls, dot, wall, signed, first[close], second[close])
