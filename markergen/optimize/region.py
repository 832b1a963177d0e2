"""Where control points may go: the boundary inset by dot and clearance, and a smallest spacing between them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.optimize.walls import Walls, walls_of

Array = NDArray[np.float64]

SWEEPS, GENTLE = 60, 10
"""Rounds of pushing apart and pulling inside, and how many of them push by no more than is needed."""


@dataclass(frozen=True)
class Region:
    """The feasible layouts of dots of one diameter.

    Attributes
    ----------
    boundary : Boundary
    diameter, clearance : float
        Of the dots, m.
    """

    boundary: Boundary
    diameter: float = 0.0
    clearance: float = 0.0

    @property
    def inset(self) -> float:
        """Smallest distance in m from a control point to the outline: dot radius plus clearance."""
        return self.diameter / 2 + self.clearance

    @property
    def spacing(self) -> float:
        """Smallest distance in m between control points: dot diameter plus clearance."""
        return self.diameter + self.clearance

    @cached_property
    def walls(self) -> Walls:
        """The outline in smooth pieces."""
        return walls_of(self.boundary)

    def sample(self, count: int, n: int, rng: np.random.Generator) -> Array:
        """Random layouts (count, n, 2): uniform points, pushed apart until they are feasible."""
        points = self.boundary.sample(count * n, self.inset, rng).reshape(count, n, 2)
        return self.project(points)

    def project(self, points: Array) -> Array:
        """Bring layouts (B, n, 2) into the region: pairs that are too close part evenly, points outside come in.

        A layout that is jammed is left with what `violation` tells.
        """
        points = self.boundary.project(points, self.inset)
        if not self.spacing:
            return points
        tight = np.flatnonzero(self._overlap(points).max(axis=(1, 2)) > 0)
        for sweep in range(SWEEPS):
            if not len(tight):
                break
            # Half the overlap each is the nearest remedy; what is jammed after that comes free when both overdo it.
            points[tight] = self._spread(points[tight], 0.5 if sweep < GENTLE else 1.0)
            tight = tight[self._overlap(points[tight]).max(axis=(1, 2)) > 1e-12]
        return points

    def violation(self, points: Array) -> Array:
        """Largest breach (B,) in m of the inset or the spacing; 0 or less is feasible."""
        outside = np.max(self.inset - self.boundary.depth(points), axis=-1)
        if not self.spacing or points.shape[1] < 2:
            return outside
        return np.maximum(outside, self._overlap(points).max(axis=(1, 2)))

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Tell which layouts (B, n, 2) are feasible, to a tenth of a nanometer."""
        return self.violation(points) <= 1e-10

    def _overlap(self, points: Array) -> Array:
        gaps = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)
        diagonal = np.arange(points.shape[1])
        gaps[:, diagonal, diagonal] = np.inf
        return self.spacing - gaps

    def _spread(self, points: Array, share: float) -> Array:
        difference = points[:, :, None] - points[:, None]
        distance = np.linalg.norm(difference, axis=-1)
        diagonal = np.arange(points.shape[1])
        distance[:, diagonal, diagonal] = np.inf
        # A hair more than needed, or the last gap would be approached only in the limit.
        push = np.maximum(self.spacing * (1 + 1e-9) - distance, 0.0) * share
        direction = difference / np.maximum(distance, 1e-12 * self.spacing)[..., None]
        # Coincident points have no direction of their own: part them along x.
        direction[..., 0] += np.where(distance == 0, np.sign(diagonal[:, None] - diagonal), 0.0)
        return self.boundary.project(points + np.sum(push[..., None] * direction, axis=2), self.inset)
