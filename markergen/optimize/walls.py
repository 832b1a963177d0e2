"""The outline in pieces that are smooth each, and what of them and of the other dots is near each dot.

The depth of a point has a kink wherever two edges are equally near, in every corner above all, and that is where
dots go. A descent that sees one edge at a time staggers between them; one that sees each as a constraint of its own
goes straight into the corner.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

CORNER, BEND = np.deg2rad(10.0), np.deg2rad(45.0)
"""A wall ends at a corner that turns by more than the first, and where it has turned by the second in all."""


@dataclass(frozen=True, eq=False)
class Walls:
    """Smooth pieces of an outline, the region to their left: w chains of up to s segments, then c circles.

    Attributes
    ----------
    start, step : arrays (w, s, 2), m
        Short chains have their last segment repeated.
    count : array (w,)
        Segments of each chain.
    open_start, open_end : arrays (w, s) of bool
        Ends of chains at corners that point outward: there the edge goes on as a straight line.
    circles : array (c, 4)
        As of `Boundary.curves`.
    """

    start: Array
    step: Array
    count: Index
    open_start: Mask
    open_end: Mask
    circles: Array

    def __len__(self) -> int:
        return len(self.start) + len(self.circles)

    def distance(self, points: Array, walls: Index, signed: Mask | bool = False) -> tuple[Array, Array]:
        """Distances (m,) in m from points (m, 2) to a wall each, and their gradients (m, 2).

        Where `signed` is true they are negative on the side away from the region, and an end at a corner that points
        outward is taken for a straight line without an end, so that the sign is right beyond it.
        """
        distance, gradient = np.empty(len(points)), np.empty((len(points), 2))
        signed = np.broadcast_to(np.asarray(signed), walls.shape)
        straight = walls < len(self.start)
        if straight.any():
            found = self._to_chains(points[straight], walls[straight], signed[straight])
            distance[straight], gradient[straight] = found
        if not straight.all():
            x, y, radius, side = self.circles[walls[~straight] - len(self.start)].T
            offset = points[~straight] - np.stack([x, y], axis=-1)
            away = np.hypot(*offset.T)
            distance[~straight] = side * (radius - away)
            gradient[~straight] = -side[:, None] * offset / np.maximum(away, np.finfo(float).tiny)[:, None]
        return distance, gradient

    def _to_chains(self, points: Array, walls: Index, signed: Mask) -> tuple[Array, Array]:
        start, step = self.start[walls], self.step[walls]
        length = np.linalg.norm(step, axis=-1)
        unit = step / length[..., None]
        offset = points[:, None] - start
        along = np.sum(offset * unit, axis=-1)
        low = np.where(self.open_start[walls] & signed[:, None], -np.inf, 0.0)
        high = np.where(self.open_end[walls] & signed[:, None], np.inf, length)
        away = offset - np.clip(along, low, high)[..., None] * unit
        nearest = np.argmin(np.sum(away**2, axis=-1), axis=1)
        rows = np.arange(len(points))
        away, unit = away[rows, nearest], unit[rows, nearest]
        beside: Mask = ((along >= low) & (along <= high))[rows, nearest]
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
        left, distance = np.sum(away * normal, axis=-1), np.hypot(*away.T)
        # Around the end of a chain the region is on either side of its line.
        last = self.count[walls] - 1
        behind, beyond = along[rows, nearest] < 0, along[rows, nearest] > length[rows, nearest]
        ended = ~beside & (((nearest == 0) & behind) | ((nearest == last) & beyond))
        sign = np.where((left < 0) & signed & ~ended, -1.0, 1.0)
        # Beside an edge its normal has no rounding, even on the edge.
        flat = (beside & signed) | (distance < 1e-12)
        gradient = sign[:, None] * away / np.maximum(distance, np.finfo(float).tiny)[:, None]
        return np.where(flat, left, sign * distance), np.where(flat[:, None], normal, gradient)


def walls_of(boundary: Boundary) -> Walls:
    """The outline of a boundary in smooth pieces."""
    rings, circles = boundary.curves()
    chains = [chain for ring in rings for chain in _chains(ring)]
    longest = max((len(corners) - 1 for corners, *_ in chains), default=1)
    start, step = np.zeros((2, len(chains), longest, 2))
    opened, closing = np.zeros((2, len(chains), longest), dtype=bool)
    for i, (corners, first, last) in enumerate(chains):
        index = np.minimum(np.arange(longest), len(corners) - 2)
        start[i], step[i] = corners[index], (corners[1:] - corners[:-1])[index]
        opened[i, 0], closing[i, len(corners) - 2 :] = first, last
    count = np.array([len(corners) - 1 for corners, *_ in chains], dtype=np.int64)
    return Walls(start, step, count, opened, closing, circles)


def _chains(ring: Array) -> list[tuple[Array, bool, bool]]:
    """Corners (k, 2) of each smooth piece of a closed polygon, and whether its first and last point outward."""
    after = np.roll(ring, -1, axis=0) - ring
    before = np.roll(after, 1, axis=0)
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=-1))
    sharp = np.abs(turn) > CORNER
    # The first piece begins at a corner, if there is one.
    shift = int(np.argmax(sharp))
    ring, turn, sharp = np.roll(ring, -shift, axis=0), np.roll(turn, -shift), np.roll(sharp, -shift)
    ends, bent = [0], 0.0
    for i in range(1, len(ring)):
        bent += abs(turn[i])
        if sharp[i] or bent > BEND:
            ends.append(i)
            bent = 0.0
    outward = sharp & (turn > 0)
    return [
        (np.take(ring, np.arange(a, b + 1), axis=0, mode="wrap"), bool(outward[a]), bool(outward[b % len(ring)]))
        for a, b in zip(ends, [*ends[1:], len(ring)], strict=True)
    ]
