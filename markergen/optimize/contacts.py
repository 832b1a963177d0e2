"""Which edges and which other dots each dot may come to touch, as constraints of a layout."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.optimize.walls import Walls

Array = NDArray[np.float64]
Index = NDArray[np.int64]


MOST_WALLS = 16
"""Most walls that count for one dot, the nearest: of a toothed outline hundreds may be in reach, and time and memory of
SLSQP grow with the square of their number. What passes one of the others is put back by `Region.project`."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """Dots and walls, and pairs of dots, that may touch.

    Attributes
    ----------
    walls : Walls
    dot, wall : arrays (a,)
        Indices of the dots and of their walls.
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
        """Those that depend on where some dots are."""
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
        Distance in m from the walls that the points have now.
    to_wall, to_dot : float
        Distances in m up to which a wall and another control point count; `to_dot` below 0 is for no pairs.
    """
    n, count = len(points), len(walls)
    each = np.repeat(points, count, axis=0), np.tile(np.arange(count), n)
    distance = walls.distance(*each)[0].reshape(n, count)
    near = distance <= to_wall
    if count > MOST_WALLS:
        near &= distance <= np.partition(distance, MOST_WALLS - 1, axis=1)[:, MOST_WALLS - 1 : MOST_WALLS]
    dot, wall = np.nonzero(near)
    # A wall that has its back to the dot, or that as an endless line would be in its way, is no more than an obstacle.
    signed = walls.distance(points[dot], wall, True)[0] >= inset - 1e-9
    first, second = np.triu_indices(n, 1)
    close = np.linalg.norm(points[first] - points[second], axis=-1) <= to_dot
    return Contacts(walls, dot, wall, signed, first[close], second[close])
