"""Optimization problem of a spec: an objective to minimize over the feasible region of layouts.

Also contains an independent check of layouts, which computes distances in other ways than the search does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import dist, hypot

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.errors import InputError, enumerated
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Circle, Without, area_without
from markergen.model.goal import NGON, Limit, parse_goal
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.composed import ComposedObjective
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize.constraints import Walls, walls_of
from markergen.read.poses import poses_from
from markergen.units import format_length, parse_length

FEW_POSES = 48
"""Number of poses that represent all in an exchange; its results are evaluated for all poses afterwards."""

SWEEPS, GENTLE = 60, 10
"""Number of rounds of pushing dots apart and inside, and how many of them push no more than needed."""

PAIRS = 2**20
"""Number of pairs of dots whose distances are computed at a time, to limit memory."""

KEPT = 1e-3
"""Relative excess over a bound of the objective that is tolerated."""

TRIED = 3
"""Number of random layouts at which the values of an objective are looked at before a search."""

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
    goal = parse_goal(spec.objective)
    kinds = [OBJECTIVES[name] for name in goal.names]
    if spec.relief and any(kind.planar_only for kind in kinds):
        raise InputError(
            "an objective for points in space with a relief",
            f"objective={spec.objective!r}",
            f"use --objective {enumerated(name for name in OBJECTIVES if not OBJECTIVES[name].planar_only)}",
        )
    if noisy and not all(kind.knows_noise for kind in kinds):
        raise InputError(
            "an objective that depends on the noise",
            f"objective={spec.objective!r} with the noise model image",
            f"use --objective {enumerated(name for name in OBJECTIVES if OBJECTIVES[name].knows_noise)}",
        )
    for limit in goal.limits:
        unit = unit_of(limit.name)
        if limit.unit != NGON and not absolute_scale(limit):
            raise InputError(
                f"a bound on {limit.name} in {unit or 'no unit'}, or in multiples of the regular polygon's",
                f"objective={spec.objective!r}",
                f"write {' '.join(f'{limit.name} <= {limit.most:g} {unit}'.split())}, or {limit.name} <= 1.05 {NGON}",
            )


def absolute_scale(limit: Limit) -> float:
    """Value, in the unit of its objective, of 1 in the unit of a bound; 0 if it is another. Lengths may have any."""
    kind, criterion = OBJECTIVES[limit.name], OBJECTIVES[limit.name].criterion
    if limit.unit in ("", unit_of(limit.name)):
        return 1 / criterion.factor if criterion else 1.0
    try:
        return parse_length(f"1{limit.unit}") if kind.unit == "m" else 0.0
    except InputError:
        return 0.0


def unit_of(name: str) -> str:
    """Unit of an objective in the table of criteria."""
    kind = OBJECTIVES[name]
    return kind.criterion.title.rpartition(" ")[2] if kind.criterion and kind.unit else kind.unit


def check_parts(spec: Spec, setting: Setting) -> None:
    """Refuse an aggregate or coordinates that the spec's criteria do not know; raises InputError."""
    for name in parse_goal(spec.objective).names:
        _part(spec, setting, name, spec.aggregate)


def check_criteria(spec: Spec) -> None:
    """Refuse names of criteria as `check_objective` and `check_parts`, before the poses of a spec are looked at."""
    check_objective(spec, spec.noise_model == "image")
    check_parts(spec, Setting(spec.boundary, spec.camera, poses_from("paper")))


def objective_of(spec: Spec, setting: Setting, ngon: Array | None = None) -> Objective:
    """Create the spec's objective for a setting; raises the errors of `check_objective`.

    Bounds are on the figures of the table of criteria, that is, with the aggregate of the criterion itself; the spec's
    aggregate is that of what is minimized.

    Parameters
    ----------
    ngon : array (1, n, 2) or None
        Regular polygon in m that the objective refers to, see `markergen.optimize.comparisons.reference`.
    """
    check_objective(spec, bool(setting.noise))
    goal = parse_goal(spec.objective)
    if goal.plain:
        return _part(spec, setting, goal.lead, spec.aggregate)
    parts = [_part(spec, setting, name, spec.aggregate) for _, name in goal.terms]
    sums = len(parts) > 1
    scales = [weight / _value(part, ngon) if sums else 1.0 for (weight, _), part in zip(goal.terms, parts, strict=True)]
    bounds = []
    for limit in goal.limits:
        part = _part(spec, setting, limit.name, "")
        scale = _value(part, ngon) if limit.unit == NGON else absolute_scale(limit)
        bounds.append((part, limit.most * scale))
    return ComposedObjective(list(zip(scales, parts, strict=True)), bounds)


def _part(spec: Spec, setting: Setting, name: str, aggregate: str) -> Objective:
    """One criterion of a spec's objective, after the worst loss of dots if the spec asks for it."""
    kinds = [OBJECTIVES[term] for term in parse_goal(spec.objective).names]
    # Of several criteria, only those that depend on the coordinates need to know them.
    any_takes = any(spec.coordinates in kind.coordinates for kind in kinds)
    takes_coordinates = not any_takes or spec.coordinates in OBJECTIVES[name].coordinates
    objective = OBJECTIVES[name](setting, aggregate, spec.coordinates if takes_coordinates else "unit")
    return SurvivalObjective(objective, spec.survive) if spec.survive else objective


def _value(part: Objective, ngon: Array | None) -> float:
    if ngon is None:
        raise ValueError("the objective refers to a regular polygon, which is not given")
    return float(part(ngon)[0])


def check_bounds(objective: Objective, points: Array, spec: Spec) -> None:
    """Refuse a layout (n, 2 or 3) in m that breaks a bound of the spec's objective by more than `KEPT`.

    Raises
    ------
    InputError
        If it does.
    """
    if not isinstance(objective, ComposedObjective):
        return
    for limit, (part, most), excess in zip(
        parse_goal(spec.objective).limits, objective.bounds, objective.excess(points[None])[:, 0], strict=True
    ):
        if not excess <= KEPT:
            criterion = OBJECTIVES[limit.name].criterion
            factor = criterion.factor if criterion else 1.0
            best, asked = (
                f"{value * factor:.4g} {unit_of(limit.name)}".strip() for value in (part(points[None])[0], most)
            )
            where = f" (that is, {asked})" if limit.unit == NGON else ""
            raise InputError(
                f"a layout with {limit}{where}", f"{best} in the best one", "allow more, or use more dots or more room"
            )


def check_values(objective: Objective, region: "FeasibleRegion", spec: Spec) -> None:
    """Refuse an objective whose values at random layouts are not above 0: searches take their logarithms.

    Raises
    ------
    InputError
        If some are 0 or less, or none is a number.
    """
    layouts = region.sample(TRIED, spec.n, np.random.default_rng(spec.seed))
    with np.errstate(all="ignore"):
        values = objective.per_pose(layouts)
    if not np.isfinite(values).any():
        raise InputError("numbers as values of the objective", "none at random layouts", "look into the objective")
    if np.nanmin(values) <= 0:
        raise InputError(
            "values of the objective above 0",
            f"{np.nanmin(values):.4g} at a random layout",
            "use an increasing function of it: of a log-determinant of 3 x 3, exp(it / 6) with the aggregate logmean",
        )


def rough_of(spec: Spec, setting: Setting, ngon: Array | None = None) -> Objective:
    """Create the spec's objective for a subset of the poses."""
    return objective_of(spec, replace(setting, poses=fewer(setting.poses)), ngon)


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

    @property
    def without_gap(self) -> "FeasibleRegion":
        """The region in which dots keep only their clearance from each other."""
        return replace(self, gap=min(self.gap, self.clearance))

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
        tight = np.flatnonzero(self._overlap(points) > 0)
        for sweep in range(SWEEPS):
            if not len(tight):
                break
            # Half the overlap each is the smallest correction; pairs still jammed after that come free by a larger one.
            points[tight] = self._spread(points[tight], 0.5 if sweep < GENTLE else 1.0)
            tight = tight[self._overlap(points[tight]) > 1e-12]
        return points

    def violation(self, points: Array) -> Array:
        """Largest violation (B,) in m of inset or spacing; 0 or less is feasible."""
        outside = np.max(self.inset - self.boundary.depth(points), axis=-1)
        if not self.spacing or points.shape[1] < 2:
            return outside
        return np.maximum(outside, self._overlap(points))

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Mask (B,) of the layouts (B, n, 2) that are feasible, to a tenth of a nanometer."""
        return self.violation(points) <= 1e-10

    def _overlap(self, points: Array) -> Array:
        """Largest overlap (B,) in m of two dots of each layout (B, n, 2)."""
        return self.spacing - np.concatenate(
            [distance.min(axis=1, initial=np.inf) for *_, distance in _between(points)]
        )

    def _spread(self, points: Array, share: float) -> Array:
        moved, done = points.copy(), 0
        for first, second, difference, distance in _between(points):
            # Slightly more than needed; otherwise the last gap would be closed only in the limit.
            layout, pair = np.nonzero(distance < self.spacing * (1 + 1e-9))
            length, direction = distance[layout, pair], difference[layout, pair]
            # Coincident points have no direction: separate them along x.
            direction[length == 0, 0] = -1e-12 * self.spacing
            push = (self.spacing * (1 + 1e-9) - length) * share / np.maximum(length, 1e-12 * self.spacing)
            np.add.at(moved, (done + layout, first[pair]), push[:, None] * direction)
            np.subtract.at(moved, (done + layout, second[pair]), push[:, None] * direction)
            done += len(distance)
        return self.boundary.project(moved, self.inset)


def _between(points: Array) -> Iterator[tuple[Indices, Indices, Array, Array]]:
    """Pairs (q,) of dots, and the vectors (b, q, 2) and distances (b, q) between them, of some layouts at a time."""
    first, second = np.triu_indices(points.shape[1], 1)
    for part in np.array_split(points, len(points) * len(first) // PAIRS + 1):
        difference = part[:, first] - part[:, second]
        yield first, second, difference, np.hypot(difference[..., 0], difference[..., 1])


@dataclass(frozen=True)
class Fault:
    """What is wrong with some dots of a layout, in words."""

    dots: tuple[int, ...]
    words: str


def faults(points: Array, region: FeasibleRegion) -> list[Fault]:
    """Find the dots of a layout (n, 2 or 3) in m that are out of the region or too near to each other."""
    plane = points[:, :2]
    room = region.boundary
    whole = room.boundary if isinstance(room, Without) else room
    outside, beyond = (region.inset - area.depth(plane[None])[0] for area in (room, whole))
    breaches = []
    for dot in np.flatnonzero(outside > TOLERANCE).tolist():
        at_edge = beyond[dot] == outside[dot]
        where = "the edge of the room, or beyond it" if at_edge else "a region without dots, or in it"
        breaches.append(Fault((dot,), f"dot {dot} is {format_length(outside[dot])} too near to {where}"))
    short = region.spacing - np.linalg.norm(plane[:, None] - plane, axis=-1)
    for first, second in np.argwhere(np.triu(short > TOLERANCE, 1)).tolist():
        sentence = f"dots {first} and {second} are {format_length(short[first, second])} too near to each other"
        breaches.append(Fault((first, second), sentence))
    return breaches


def breach(
    points: Array, boundary: Boundary, keep_outs: Sequence[Boundary], diameter: float | Array, clearance: float
) -> float:
    """Largest violation in m of the constraints by a layout (n, 2 or 3) in m; 0 or less if it satisfies them.

    Every dot, of a diameter in m for all or of its own, must lie entirely in the boundary, `clearance` or more from its
    outline, the keep-outs, and every other dot. Circles are measured by plain arithmetic, all else by GEOS from the
    outlines.
    """
    dots = list(zip(points.tolist(), np.broadcast_to(diameter, len(points)).tolist(), strict=True))
    pairs = combinations(dots, 2)
    worst = max(((d + e) / 2 + clearance - dist(p[:2], q[:2]) for (p, d), (q, e) in pairs), default=0.0)
    for (x, y, *_), size in dots:
        inset = size / 2 + clearance
        worst = max(worst, inset - _depth(x, y, boundary), *(inset + _depth(x, y, keep_out) for keep_out in keep_outs))
    return worst


def check(worst: float, kind: str = "layout") -> None:
    """Refuse a layout, or its relief, that breaks its constraints by more than a nanometer, in m (see `breach`).

    Raises
    ------
    RuntimeError
        If it does, which means an error in the search, not the input.
    """
    if not worst <= TOLERANCE:
        raise RuntimeError(f"the {kind} that was found breaks its constraints by {worst:.3g} m")


def _depth(x: float, y: float, boundary: Boundary) -> float:
    """Distance in m from the outline, negative outside."""
    if isinstance(boundary, Circle):
        return boundary.size - hypot(x - boundary.center[0], y - boundary.center[1])
    return float(Region.odd(boundary.outlines()).depth(np.array([[x, y]]))[0])
