"""Layouts in space: feasible positions of dots on pillars that do not occlude each other, and the search among them.

The search polishes many layouts with random heights under the constraints of occlusion.
"""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from math import dist

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.model.occlusion import Passage, passage
from markergen.objectives import Objective
from markergen.optimize.ending import Ended
from markergen.optimize.polish import ALL_PAIRS_UP_TO, REACH, SOFTNESSES, Clearances, slsqp
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import KEPT, Optimum, distinct_best
from markergen.optimize.trace import Record
from markergen.options import Progress
from markergen.units import NEGLIGIBLE

Index = NDArray[np.int64]

ROUNDING = 1e-10
"""Violation in m attributed to rounding, as in `FeasibleRegion`."""

AT_ONCE = 500_000
"""Lines of sight in one chunk, about 50 MB."""

RAYS = 360
"""Number of points on a dot's rim sampled by the independent check."""

STARTS, AS_MANY_UP_TO = 24, 8
"""Number of starts for up to 8 dots; proportionally fewer for more dots."""

ITERATIONS, ROUNDS = 60, 8
"""Maximum number of iterations of a polish, and of successive polishes, each constrained by the lines of sight that all
previous ones came to touch."""

QUICK, QUICK_ROUNDS = 30, 3
"""The same for polishes that only rank layouts."""

TIGHTEST = 3
"""Number of poses added to the constraints at once for each dot and pillar."""

NEAR = 0.25
"""Maximum gap, as a fraction of the spacing, of lines of sight included in the constraints before they are blocked."""

CLEAR = 1e-7
"""Depth in m of a pillar in a line of sight up to which correcting the layout costs nothing."""

BLOCK = 20
"""Number of dots that move at once if there are more than `ALL_PAIRS_UP_TO`: the time of a step is cubic in it."""

GAIN, STALE = 1e-5, 2
"""Relative gain, and number of successive rounds that do not exceed it, after which the polish ends."""

LEAST, LEAST_SHARE = 2e-4, 0.1
"""Minimum height in m of a pillar, a layer of a 3-D print; at most this share of the relief.

Lines of sight raise low dots by 8 to 35 um, which no process makes. With eight dots and a relief of 10 mm, laying
four of 35 um on the plate costs 1.2e-5 of the objective; a dot of 0.59 mm beside pillars of 20 mm is of use and stays.
"""

RESTED = 1e-6
"""Movement in radii below which a layout without occlusion has converged."""


@dataclass(frozen=True, eq=False)
class ReliefRoom:
    """Set of feasible layouts (n, 3) of dots of one diameter on pillars.

    Attributes
    ----------
    region : FeasibleRegion
        Feasible region in the plane.
    height : float
        Maximum height, m.
    eyes : array (P, 3), m
        Camera positions from which every dot must be entirely visible; all higher than `height`.
    """

    region: FeasibleRegion
    height: float
    eyes: Array

    @cached_property
    def wall_radius(self) -> float:
        """Distance in m of lines of sight from the axis of a pillar; 0 for bare points, which hide nothing.

        It includes the clearance from the dot on the pillar, as in the plane: otherwise two images might merge.
        """
        return self.region.inset if self.region.diameter else 0.0

    @cached_property
    def radii(self) -> tuple[Array, Array]:
        """Radius of the dots in m and `wall_radius`, as arrays of shape ()."""
        return np.array(self.region.diameter / 2), np.array(self.wall_radius)

    @cached_property
    def shadow(self) -> float:
        """Maximum distance in m from its wall at which a pillar can hide anything on the plate."""
        # A pillar of height t hides lower points z up to (t - z)/(h - z) of the way to the eye, maximal for z = 0.
        way = np.linalg.norm(self.eyes[:, :2], axis=-1) + self.region.boundary.radius
        return float(np.max(self.height / self.eyes[:, 2] * way))

    def within(self, points: Array) -> Array:
        """Make a layout (n, 3) feasible: project it in the plane, then lower dots until nothing is hidden.

        From the lowest dot up, each keeps its height or is lowered to the largest height at which it hides none of
        those below it. It stays above these, so each dot is visited only once. A layout that is jammed in the plane
        remains so.
        """
        plane = self.region.project(points[None, :, :2])[0]
        heights = np.clip(points[:, 2], 0.0, self.height)
        waiting = np.arange(len(points))
        while self.wall_radius and len(waiting) > 1:
            low = waiting[np.argmin(heights[waiting])]
            waiting = waiting[waiting != low]
            ceiling = self._ceiling(np.append(plane[low], heights[low]), plane[waiting])
            heights[waiting] = np.minimum(heights[waiting], ceiling)
        return np.column_stack([plane, heights])

    def without_low_pillars(self, points: Array) -> Array:
        """Lay dots of a feasible layout (n, 3) that are lower than `LEAST` on the plate, and make it feasible again."""
        least = min(LEAST, LEAST_SHARE * self.height) if self.wall_radius else 0.0
        # What is negligible is rounded in the marker's file.
        while (is_low := (points[:, 2] >= NEGLIGIBLE) & (points[:, 2] < least)).any():
            points = self.within(np.column_stack([points[:, :2], np.where(is_low, 0.0, points[:, 2])]))
        return points

    def _ceiling(self, dot: Array, plane: Array) -> Array:
        """Maximum heights (m,) in m of pillars at (m, 2) that hide nothing of a lower dot (3,).

        With c the sum of both radii, they first touch at the smallest share s with |a - s d| = c - s r, see `passage`.
        """
        radius, wall = self.region.diameter / 2, self.wall_radius
        way, offset = self.eyes[:, :2] - dot[:2], (plane - dot[:2])[:, None]
        # A s^2 - 2 B s + C = 0, with smaller root C / (B + sqrt(B^2 - A C)).
        a = np.sum(way**2, axis=-1) - radius**2
        b = np.sum(offset * way, axis=-1) - (radius + wall) * radius
        c = np.maximum(np.sum(offset**2, axis=-1) - (radius + wall) ** 2, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = c / (b + np.sqrt(b**2 - a * c))
            # Without a root, or with one behind the dot, they never touch; if they touch from the start, it is 0.
            share = np.where(share >= 0, share, np.where((c == 0) & (b > 0), 0.0, np.inf))
            heights: Array = np.min(dot[2] + share * (self.eyes[:, 2] - dot[2]), axis=-1)
        return heights

    def holds(self, points: Array) -> bool:
        """True if a layout (n, 3) is feasible, to a tenth of a nanometer."""
        z = points[:, 2]
        return bool(
            self.region.holds(points[None, :, :2])[0]
            and z.min() >= 0
            and z.max() <= self.height
            and self.hides(points) <= ROUNDING
        )

    def hides(self, points: Array) -> float:
        """Maximum depth in m of a pillar in a line of sight; 0 or less if none blocks one."""
        if not self.wall_radius:
            return 0.0
        dot, pillar = self._neighbors(points, higher=True)
        return max((-float(sight.gap.min()) for _, sight in self._passages(points, dot, pillar)), default=0.0)

    def tightest(self, points: Array, up_to: float, count: int) -> "Sights":
        """Lines of sight with a gap of at most `up_to` m: the `count` smallest for each dot and pillar."""
        dot, pillar = self._neighbors(points)
        kept: list[Index] = [np.zeros((0, 3), dtype=np.int64)]
        for chunk, sight in self._passages(points, dot, pillar):
            poses = np.argsort(sight.gap, axis=-1, kind="stable")[:, :count]
            rows = np.repeat(np.arange(len(chunk)), poses.shape[1])
            is_near = sight.gap[rows, poses.ravel()] <= up_to
            taken = chunk[rows[is_near]]
            kept.append(np.stack([dot[taken], pillar[taken], poses.ravel()[is_near]], axis=-1))
        return Sights(self, np.concatenate(kept))

    def _neighbors(self, points: Array, higher: bool = False) -> tuple[Index, Index]:
        """Indices (m,) of dots and of pillars near enough to hide them."""
        if not self.wall_radius:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        gaps = np.linalg.norm(points[:, None, :2] - points[None, :, :2], axis=-1)
        is_near = gaps <= self.shadow + self.region.diameter / 2 + self.wall_radius
        is_near &= ~np.eye(len(points), dtype=bool)
        if higher:
            is_near &= points[None, :, 2] > points[:, None, 2]
        dot, pillar = np.nonzero(is_near)
        return dot, pillar

    def _passages(self, points: Array, dot: Index, pillar: Index) -> list[tuple[Index, Passage]]:
        size = max(1, AT_ONCE // len(self.eyes))
        chunks = [np.arange(start, min(start + size, len(dot))) for start in range(0, len(dot), size)]
        radius, wall = self.radii
        return [
            (chunk, passage(points[dot[chunk], None], radius, points[pillar[chunk], None], wall, self.eyes))
            for chunk in chunks
        ]


@dataclass(frozen=True, eq=False)
class Sights:
    """Selected lines of sight past pillars, as constraints of a layout.

    Attributes
    ----------
    triples : array (m, 3)
        Indices of dot, pillar and eye.
    """

    room: ReliefRoom
    triples: Index = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.triples)

    def joined(self, others: "Sights") -> "Sights":
        """Union of these and the others, without duplicates."""
        return Sights(self.room, np.unique(np.concatenate([self.triples, others.triples]), axis=0))

    def of(self, dots: Index) -> "Sights":
        """Subset that depends on the positions of the given dots."""
        return Sights(self.room, self.triples[np.isin(self.triples[:, :2], dots).any(axis=1)])

    def gap(self, points: Array) -> Array:
        """Gaps (m,) in m for a layout (n, 3), see `markergen.model.occlusion.Passage`."""
        return self._passage(points).gap

    def gap_jacobian(self, points: Array) -> Array:
        """Derivative (m, n, 3) of `gap`.

        Where the gap is minimal over the share s along the way, the derivative through s vanishes; at the pillar's top
        it does not.
        """
        dot, pillar, eye = self.triples.T
        sight = self._passage(points)
        share = sight.share[:, None]
        way = self.room.eyes[eye, :2] - points[dot, :2]
        away = points[pillar, :2] - points[dot, :2] - share * way
        away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), np.finfo(float).tiny)
        climb = self.room.eyes[eye, 2] - points[dot, 2]
        by_share = np.where(sight.topped, self.room.region.diameter / 2 - np.sum(away * way, axis=-1), 0.0)
        jacobian = np.zeros((len(self), *points.shape))
        rows = np.arange(len(self))
        jacobian[rows, pillar, :2] = away
        jacobian[rows, dot, :2] = -(1 - share) * away
        jacobian[rows, pillar, 2] = by_share / climb
        jacobian[rows, dot, 2] = by_share * (points[pillar, 2] - self.room.eyes[eye, 2]) / climb**2
        return jacobian

    def _passage(self, points: Array) -> Passage:
        dot, pillar, eye = self.triples.T
        radius, wall = self.room.radii
        return passage(points[dot], radius, points[pillar], wall, self.room.eyes[eye])


def search_relief(
    objective: Objective,
    room: ReliefRoom,
    flat: Array,
    rng: np.random.Generator,
    starts: int = 0,
    progress: Progress | None = None,
    rough: Objective | None = None,
    record: Record | None = None,
) -> Optimum:
    """Find the layout (n, 3) in the room that minimizes the objective, never worse than the flat one.

    Parameters
    ----------
    flat : array (n, 2), m
        A good flat layout: half of the starts use its positions, the others random ones; each dot starts at zero or
        maximum height, in the first start alternately.
    starts : int
        Number of starts; 0 selects it according to n.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    rough : Objective or None
        The same criterion for fewer poses, which saves time in ranking starts.
    record : callable or None
        Called with the layouts before and after each step (see `markergen.optimize.trace`).
    """
    n = len(flat)
    starts = starts or max(2, STARTS * AS_MANY_UP_TO // max(n, AS_MANY_UP_TO))
    candidates = []
    for done in range(starts):
        if progress:
            progress("relief", done, starts)
        plane = room.region.sample(1, n, rng)[0] if done % 2 else flat
        up = rng.integers(0, 2, n) if done else _every_second(flat)
        start = np.column_stack([plane, room.height * up])
        try:
            candidates.append(polish_relief(rough or objective, room, start, QUICK, QUICK_ROUNDS, record))
        except Ended:
            break
    level = np.column_stack([flat, np.zeros(n)])
    best = level, float(objective(level[None])[0])
    kept = distinct_best(candidates, KEPT if n <= ALL_PAIRS_UP_TO else 1)
    for done, (points, _) in enumerate(kept):
        if progress:
            progress("polish", done, len(kept))
        much = (ITERATIONS, ROUNDS) if n <= ALL_PAIRS_UP_TO else (QUICK, QUICK_ROUNDS)
        try:
            end = polish_relief(objective, room, points, *much, record=record)
        except Ended:
            end = points, float(objective(points[None])[0]) if room.holds(points) else np.inf
        made = room.without_low_pillars(end[0])
        if made is not end[0] and np.isfinite(end[1]):
            if record:
                record("relief", end[0][None], made[None])
            end = made, float(objective(made[None])[0])
        best = min(best, end, key=lambda pair: pair[1])
    if progress:
        progress("polish", len(kept), len(kept))
    return Optimum(*best)


def polish_relief(
    objective: Objective,
    room: ReliefRoom,
    start: Array,
    iterations: int = ITERATIONS,
    rounds: int = ROUNDS,
    record: Record | None = None,
) -> tuple[Array, float]:
    """Improve one layout (n, 3) in m; return the best feasible layout found and its value, inf if there is none."""
    region = room.region
    wide = len(region.walls) == 1 and len(start) <= ALL_PAIRS_UP_TO
    reach = np.inf if wide else REACH * region.boundary.radius
    rested = RESTED * region.boundary.radius if wide else 0.99 * reach
    best, best_value = start, float(objective(start[None])[0]) if room.holds(start) else np.inf
    current, sights = start, Sights(room)
    for softness in SOFTNESSES if objective.nonsmooth else (0.0,):
        stale = 0
        for number in range(rounds):
            sights = sights.joined(room.tightest(current, NEAR * region.spacing, TIGHTEST))
            way, end = [current], current
            for moving in _blocks(current, number):
                end = _run(objective, room, sights, end, moving, softness, iterations, reach, way)
            moved = float(np.abs(end - current).max())
            mended = room.within(end)
            if record:
                steps = np.stack([*way, end, mended])
                record("relief", steps[:-1], steps[1:])
            value = float(objective(mended[None])[0])
            stale = 0 if value < best_value * (1 - GAIN) else stale + 1
            if value < best_value and room.holds(mended):
                best, best_value = mended, value
            # Occlusion is tolerated for now: the next round includes it as a constraint.
            clear = room.hides(end) <= CLEAR
            current = mended if clear else end
            if (clear and moved < rested) or stale == STALE:
                break
    return best, best_value


def _run(
    objective: Objective,
    room: ReliefRoom,
    sights: Sights,
    start: Array,
    moving: Index,
    softness: float,
    iterations: int,
    reach: float,
    way: list[Array],
) -> Array:
    """Run SLSQP once from a layout (n, 3), moving some of the dots and appending its steps to `way`."""
    scale = room.region.boundary.radius
    clear, sights = Clearances(room.region, start[:, :2], reach, 1.0, moving), sights.of(moving)

    def laid(x: Array) -> Array:
        points = start.copy()
        points[moving] = x.reshape(-1, 3) * scale
        return points

    def log_value(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(laid(x)[None], softness)
        return float(np.log(value[0])), (gradient[0, moving] * (scale / value[0])).ravel()

    def slack(x: Array) -> Array:
        points = laid(x)
        return np.concatenate([clear.slack(points[:, :2]), sights.gap(points) / scale])

    def slack_jacobian(x: Array) -> Array:
        points = laid(x)
        plane = clear.slack_jacobian(points[:, :2])
        level = np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=-1)
        return np.concatenate([level, sights.gap_jacobian(points)])[:, moving].reshape(-1, 3 * len(moving))

    low, high = (start[moving] - reach) / scale, (start[moving] + reach) / scale
    low[:, 2], high[:, 2] = 0.0, room.height / scale
    begin = np.clip(start[moving] / scale, low, high).ravel()
    bounds = low.ravel(), high.ravel()
    return laid(slsqp(log_value, slack, slack_jacobian, begin, bounds, iterations, 1e-9, lambda x: way.append(laid(x))))


def _blocks(points: Array, number: int) -> list[Index]:
    """Groups of dots that move together: for many dots, parallel strips of about 20, in a new direction each time."""
    n = len(points)
    if n <= ALL_PAIRS_UP_TO:
        return [np.arange(n)]
    angle = number * np.pi * (3 - np.sqrt(5))
    order = np.argsort(points[:, 0] * np.cos(angle) + points[:, 1] * np.sin(angle), kind="stable")
    return [np.sort(block) for block in np.array_split(order, -(-n // BLOCK))]


def _every_second(flat: Array) -> Index:
    """1 for every second dot around the center, else 0: on a circle, the least occlusion and most information."""
    around = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]), kind="stable")
    up = np.empty(len(flat), dtype=np.int64)
    up[around] = np.arange(len(flat)) % 2
    return up


def relief_breach(points: Array, relief: float, diameter: float, clearance: float, eyes: Array) -> float:
    """Largest violation in m of the height constraints by a layout (n, 3) in m; 0 or less if it satisfies them.

    Every dot must be from 0 to `relief` above the plane and below all eyes (P, 3), and each ray from an eye to its rim
    must keep the clearance from all higher dots, including the vertical cylinders below them. The rim is sampled, with
    an error below a thousandth of a mm.
    """
    worst = max(
        float(-points[:, 2].min()), float(points[:, 2].max()) - relief, float(np.max(points[:, 2] - eyes[:, 2].min()))
    )
    if not diameter:
        return worst
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    rim = diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for low, high in combinations(points[np.argsort(points[:, 2], kind="stable")], 2):
        # Rays beside the cylinder; the others pass above or below.
        reached = (high[2] - low[2]) / (eyes[:, 2] - low[2])
        way = np.linalg.norm(eyes[:, :2] - low[:2], axis=-1)
        is_near = reached * way + diameter + clearance >= dist(low[:2], high[:2])
        if high[2] <= low[2] or not is_near.any():
            continue
        start = low[:2] + rim - high[:2]
        toward = eyes[is_near, None, :2] - high[:2] - start
        nearest = -np.sum(start * toward, axis=-1) / np.maximum(np.sum(toward**2, axis=-1), np.finfo(float).tiny)
        share = np.clip(nearest, 0.0, reached[is_near, None])
        passing = np.linalg.norm(start + share[..., None] * toward, axis=-1)
        worst = max(worst, diameter / 2 + clearance - float(passing.min()))
    return worst
