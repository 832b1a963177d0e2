"""Optimization problem of a spec: an objective to minimize over the feasible region of layouts.

Also contains an independent check of layouts, which computes distances in other ways than the search does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import dist, hypot

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Circle, area_without
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.base import either
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize.constraints import Walls, walls_of

Array = NDArray[np.float64]

FEW_POSES = 48
"""Number of poses that represent all in an exchange; its results are evaluated for all poses afterwards."""

SWEEPS, GENTLE = 60, 10
"""Number of rounds of pushing dots apart and inside, and how many of them push no more than needed."""

TOLERANCE = 1e-9
"""Violation in m that the independent check attributes to rounding."""


def room_of(spec: Spec) -> Boundary:
    """Region in which the spec allows dots: the boundary minus keep-outs and tag."""
    return area_without(spec.boundary, spec.blocked)


def check_objective(spec: Spec, noisy: bool) -> None:
    """Refuse an unknown objective, or one that does not support the spec's relief or the noise.

    Parameters
    ----------
    noisy : bool
        True if the objective must depend on the image noise.

    Raises
    ------
    InputError
        If the name is unknown, or the objective does not support the relief or the noise.
    """
    kind = OBJECTIVES[spec.objective]
    if spec.relief and kind.planar_only:
        raise InputError(
            "an objective for points in space with a relief",
            f"objective={spec.objective!r}",
            f"use --objective {either(name for name in OBJECTIVES if not OBJECTIVES[name].planar_only)}",
        )
    if noisy and not kind.knows_noise:
        raise InputError(
            "an objective that depends on the noise",
            f"objective={spec.objective!r} with the noise model image",
            f"use --objective {either(name for name in OBJECTIVES if OBJECTIVES[name].knows_noise)}",
        )


def objective_of(spec: Spec, setting: Setting) -> Objective:
    """Create the spec's objective for a setting; raises the errors of `check_objective`."""
    check_objective(spec, bool(setting.noise))
    objective = OBJECTIVES[spec.objective](setting, spec.aggregate, spec.coordinates)
    return SurvivalObjective(objective, spec.survive) if spec.survive else objective


def rough_of(spec: Spec, setting: Setting) -> Objective:
    """Create the spec's objective for a subset of the poses."""
    return objective_of(spec, replace(setting, poses=fewer(setting.poses)))


def fewer(poses: PoseDistribution, count: int = FEW_POSES) -> PoseDistribution:
    """Take every p-th pose, about `count` in all; p is prime, to avoid aliasing with a grid of poses."""
    most = len(poses) // count
    step = max((p for p in range(2, most + 1) if all(p % q for q in range(2, p))), default=1)
    return poses.taken(np.arange(0, len(poses), step), poses.dropped)


@dataclass(frozen=True)
class FeasibleRegion:
    """Set of feasible layouts of dots of one diameter.

    Attributes
    ----------
    boundary : Boundary
    diameter, clearance : float
        Diameter and clearance of the dots, m.
    gap : float
        Smallest gap between dots in m, where it is larger than the clearance.
    """

    boundary: Boundary
    diameter: float = 0.0
    clearance: float = 0.0
    gap: float = 0.0

    @property
    def inset(self) -> float:
        """Smallest distance in m from a control point to the outline: dot radius plus clearance."""
        return self.diameter / 2 + self.clearance

    @property
    def spacing(self) -> float:
        """Smallest distance in m between control points: dot diameter plus clearance or gap."""
        return self.diameter + max(self.clearance, self.gap)

    @cached_property
    def walls(self) -> Walls:
        """Smooth pieces of the outline."""
        return walls_of(self.boundary)

    def sample(self, count: int, n: int, rng: np.random.Generator) -> Array:
        """Random layouts (count, n, 2): uniform points, pushed apart until they are feasible."""
        points = self.boundary.sample(count * n, self.inset, rng).reshape(count, n, 2)
        return self.project(points)

    def project(self, points: Array) -> Array:
        """Bring layouts (B, n, 2) into the region: push close pairs apart evenly and points outside inward.

        A jammed layout remains infeasible; see `violation`.
        """
        points = self.boundary.project(points, self.inset)
        if not self.spacing:
            return points
        tight = np.flatnonzero(self._overlap(points).max(axis=(1, 2)) > 0)
        for sweep in range(SWEEPS):
            if not len(tight):
                break
            # Half the overlap each is the smallest correction; pairs still jammed after that come free by a larger one.
            points[tight] = self._spread(points[tight], 0.5 if sweep < GENTLE else 1.0)
            tight = tight[self._overlap(points[tight]).max(axis=(1, 2)) > 1e-12]
        return points

    def violation(self, points: Array) -> Array:
        """Largest violation (B,) in m of inset or spacing; 0 or less is feasible."""
        outside = np.max(self.inset - self.boundary.depth(points), axis=-1)
        if not self.spacing or points.shape[1] < 2:
            return outside
        return np.maximum(outside, self._overlap(points).max(axis=(1, 2)))

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Mask (B,) of the layouts (B, n, 2) that are feasible, to a tenth of a nanometer."""
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
        # Slightly more than needed; otherwise the last gap would be closed only in the limit.
        push = np.maximum(self.spacing * (1 + 1e-9) - distance, 0.0) * share
        direction = difference / np.maximum(distance, 1e-12 * self.spacing)[..., None]
        # Coincident points have no direction: separate them along x.
        direction[..., 0] += np.where(distance == 0, np.sign(diagonal[:, None] - diagonal), 0.0)
        return self.boundary.project(points + np.sum(push[..., None] * direction, axis=2), self.inset)


def breach(
    points: Array, boundary: Boundary, keep_outs: Sequence[Boundary], diameter: float, clearance: float
) -> float:
    """Largest violation in m of the constraints by a layout (n, 2 or 3) in m; 0 or less if it satisfies them.

    Every dot must lie entirely in the boundary, `clearance` or more from its outline, the keep-outs, and every other
    dot. Circles are measured by plain arithmetic, all else by GEOS from the outlines.
    """
    inset = diameter / 2 + clearance
    worst = max((diameter + clearance - dist(p[:2], q[:2]) for p, q in combinations(points.tolist(), 2)), default=0.0)
    for x, y, *_ in points.tolist():
        worst = max(worst, inset - _depth(x, y, boundary), *(inset + _depth(x, y, keep_out) for keep_out in keep_outs))
    return worst


def check(points: Array, boundary: Boundary, keep_outs: Sequence[Boundary], diameter: float, clearance: float) -> None:
    """Refuse a layout that violates its constraints (see `breach`) by more than a nanometer.

    Raises
    ------
    RuntimeError
        If it does, which means an error in the search, not the input.
    """
    worst = breach(points, boundary, keep_outs, diameter, clearance)
    if not worst <= TOLERANCE:
        raise RuntimeError(f"the layout that was found breaks its constraints by {worst:.3g} m")


def _depth(x: float, y: float, boundary: Boundary) -> float:
    """Distance in m from the outline, negative outside."""
    if isinstance(boundary, Circle):
        return boundary.size - hypot(x - boundary.center[0], y - boundary.center[1])
    return float(Region.odd(boundary.outlines()).depth(np.array([[x, y]]))[0])
