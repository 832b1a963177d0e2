"""Layouts in space: where dots on pillars may stand without one hiding another, and the search among such layouts.

The search starts from many layouts with random heights, each polished under what hides what.
"""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from math import dist

import numpy as np
from numpy.typing import NDArray

from markergen.model.occlusion import Passage, passage
from markergen.objectives import Objective
from markergen.optimize.polish import ALL_PAIRS_UP_TO, REACH, SOFTNESSES, Clearances, slsqp
from markergen.optimize.problem import TOLERANCE, FeasibleRegion
from markergen.optimize.search import DISTINCT, Optimum
from markergen.optimize.trace import Record
from markergen.options import Progress

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROUNDING = 1e-10
"""Breach in m that is put down to rounding, as that of a `FeasibleRegion`."""

AT_ONCE = 500_000
"""Lines of sight in one chunk: some 50 MB."""

RAYS = 360
"""Points of a dot's rim that are looked at by the independent check."""

STARTS, AS_MANY_UP_TO = 24, 8
"""Layouts of up to 8 dots that are started from; of more dots there are fewer, in proportion."""

KEPT = 3
"""How many distinct ones are polished for all poses."""

ITERATIONS, ROUNDS = 60, 8
"""Most iterations of a polish, and most polishes one after the other, each under the lines of sight that all before it
came to touch."""

QUICK, QUICK_ROUNDS = 30, 3
"""The same where it only tells good from bad."""

TIGHTEST = 3
"""Of each dot and pillar so many poses come into the constraints at once."""

NEAR = 0.25
"""Share of the spacing up to which lines of sight come into the constraints before they are crossed."""

CLEAR = 1e-7
"""A layout in which no pillar stands deeper than this many m in a line of sight loses nothing where that is mended."""

BLOCK = 20
"""Of more dots than `ALL_PAIRS_UP_TO` so many move at once: the time of a step grows with the cube of their number."""

GAIN, STALE = 1e-5, 2
"""Rounds that gain no more than this share, so many of them one after the other, are the last."""

RESTED = 1e-6
"""A layout that moves by less than this many radii, with nothing hidden, is done."""


@dataclass(frozen=True, eq=False)
class ReliefRoom:
    """The feasible layouts (n, 3) of dots of one diameter on pillars.

    Attributes
    ----------
    region : FeasibleRegion
        Where they may be in the plane.
    height : float
        How high they may stand, m.
    eyes : array (P, 3), m
        From where every dot must be seen whole; all higher than `height`.
    """

    region: FeasibleRegion
    height: float
    eyes: Array

    @cached_property
    def wall_radius(self) -> float:
        """How far in m lines of sight stay from the axis of a pillar; 0 for bare points, which hide nothing.

        They keep the clearance from the dot on it, as dots do in the plane: seen closer together, two would be one.
        """
        return self.region.inset if self.region.diameter else 0.0

    @cached_property
    def radii(self) -> tuple[Array, Array]:
        """Radius of the dots in m, and `wall_radius`, as arrays ()."""
        return np.array(self.region.diameter / 2), np.array(self.wall_radius)

    @cached_property
    def shadow(self) -> float:
        """How far in m from its wall a pillar may hide anything on the plate, at most."""
        # A pillar of height t hides what is lower up to (t - z)/(h - z) of the way to the eye, which is most for z = 0.
        way = np.linalg.norm(self.eyes[:, :2], axis=-1) + self.region.boundary.radius
        return float(np.max(self.height / self.eyes[:, 2] * way))

    def within(self, points: Array) -> Array:
        """Bring a layout (n, 3) into the room: in the plane as the region does, and down until nothing is hidden.

        From the lowest dot up, each keeps its height or takes the largest at which it hides nothing of those below it.
        What is brought down so stays above these, so no dot has to be looked at twice. A layout that is jammed in the
        plane stays so.
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

    def _ceiling(self, dot: Array, plane: Array) -> Array:
        """Largest heights (m,) in m of pillars at (m, 2) that hide nothing of a lower dot (3,).

        With c the radii of both, they come to touch at the smallest share s with |a - s d| = c - s r, see `passage`.
        """
        radius, wall = self.region.diameter / 2, self.wall_radius
        way, offset = self.eyes[:, :2] - dot[:2], (plane - dot[:2])[:, None]
        # A s^2 - 2 B s + C = 0, whose smaller root is C over B and the discriminant's root.
        a = np.sum(way**2, axis=-1) - radius**2
        b = np.sum(offset * way, axis=-1) - (radius + wall) * radius
        c = np.maximum(np.sum(offset**2, axis=-1) - (radius + wall) ** 2, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = c / (b + np.sqrt(b**2 - a * c))
            # Where there is no root, or it lies behind the dot, they never touch; where they do from the start, at 0.
            share = np.where(share >= 0, share, np.where((c == 0) & (b > 0), 0.0, np.inf))
            heights: Array = np.min(dot[2] + share * (self.eyes[:, 2] - dot[2]), axis=-1)
        return heights

    def holds(self, points: Array) -> bool:
        """Tell whether a layout (n, 3) is feasible, to a tenth of a nanometer."""
        z = points[:, 2]
        return bool(
            self.region.holds(points[None, :, :2])[0]
            and z.min() >= 0
            and z.max() <= self.height
            and self.hides(points) <= ROUNDING
        )

    def hides(self, points: Array) -> float:
        """Largest depth in m to which a pillar stands in a line of sight; 0 or less if none does."""
        if not self.wall_radius:
            return 0.0
        dot, pillar = self._neighbors(points, higher=True)
        return max((-float(found.gap.min()) for _, found in self._passages(points, dot, pillar)), default=0.0)

    def tightest(self, points: Array, up_to: float, count: int) -> "Sights":
        """Lines of sight whose gap is at most `up_to` m: of each dot and pillar the `count` with the smallest."""
        dot, pillar = self._neighbors(points)
        kept: list[Index] = [np.zeros((0, 3), dtype=np.int64)]
        for chunk, found in self._passages(points, dot, pillar):
            poses = np.argsort(found.gap, axis=-1, kind="stable")[:, :count]
            rows = np.repeat(np.arange(len(chunk)), poses.shape[1])
            near = found.gap[rows, poses.ravel()] <= up_to
            taken = chunk[rows[near]]
            kept.append(np.stack([dot[taken], pillar[taken], poses.ravel()[near]], axis=-1))
        return Sights(self, np.concatenate(kept))

    def _neighbors(self, points: Array, higher: bool = False) -> tuple[Index, Index]:
        """Dots and pillars (m,) that are near enough for one to be hidden by the other."""
        if not self.wall_radius:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        gaps = np.linalg.norm(points[:, None, :2] - points[None, :, :2], axis=-1)
        near = gaps <= self.shadow + self.region.diameter / 2 + self.wall_radius
        near &= ~np.eye(len(points), dtype=bool)
        if higher:
            near &= points[None, :, 2] > points[:, None, 2]
        dot, pillar = np.nonzero(near)
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
    """Some lines of sight past pillars, as constraints of a layout.

    Attributes
    ----------
    room : ReliefRoom
    triples : array (m, 3)
        Indices of dot, pillar and eye.
    """

    room: ReliefRoom
    triples: Index = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.triples)

    def joined(self, others: "Sights") -> "Sights":
        """These and others, each once."""
        return Sights(self.room, np.unique(np.concatenate([self.triples, others.triples]), axis=0))

    def of(self, dots: Index) -> "Sights":
        """Those that depend on where some dots stand."""
        return Sights(self.room, self.triples[np.isin(self.triples[:, :2], dots).any(axis=1)])

    def gap(self, points: Array) -> Array:
        """Gaps (m,) in m for a layout (n, 3), see `markergen.model.occlusion.Passage`."""
        return self._passage(points).gap

    def gap_jacobian(self, points: Array) -> Array:
        """Derivative (m, n, 3) of `gap`.

        By the way the share s is left out where the gap is least over it; at the pillar's top it counts.
        """
        dot, pillar, eye = self.triples.T
        found = self._passage(points)
        share = found.share[:, None]
        way = self.room.eyes[eye, :2] - points[dot, :2]
        away = points[pillar, :2] - points[dot, :2] - share * way
        away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), np.finfo(float).tiny)
        climb = self.room.eyes[eye, 2] - points[dot, 2]
        by_share = np.where(found.topped, self.room.region.diameter / 2 - np.sum(away * way, axis=-1), 0.0)
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
    """Find the layout (n, 3) in the room that minimizes the objective; it is never worse than the flat one.

    Parameters
    ----------
    flat : array (n, 2), m
        A good flat layout: half of the starts have its places, the others random ones; each dot starts from the plane
        or from the top, in the first one every second dot around.
    starts : int
        0 takes a number that suits n.
    progress : callable or None
        Called with the stage, what is done of it, and its total.
    rough : Objective or None
        The same criterion for fewer poses, which saves time in telling good starts from bad ones.
    record : callable or None
        Called with what each step makes of layouts (see `markergen.optimize.trace`).
    """
    n = len(flat)
    starts = starts or max(2, STARTS * AS_MANY_UP_TO // max(n, AS_MANY_UP_TO))
    found = []
    for done in range(starts):
        if progress:
            progress("relief", done, starts)
        plane = room.region.sample(1, n, rng)[0] if done % 2 else flat
        up = rng.integers(0, 2, n) if done else _every_second(flat)
        start = np.column_stack([plane, room.height * up])
        found.append(polish_relief(rough or objective, room, start, QUICK, QUICK_ROUNDS, record))
    best = _flat(objective, flat)
    kept = _distinct(found)[: KEPT if n <= ALL_PAIRS_UP_TO else 1]
    for done, (points, _) in enumerate(kept):
        if progress:
            progress("polish", done, len(kept))
        much = (ITERATIONS, ROUNDS) if n <= ALL_PAIRS_UP_TO else (QUICK, QUICK_ROUNDS)
        end = polish_relief(objective, room, points, *much, record=record)
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
    """Improve one layout (n, 3) in m; return what is feasible and best on the way, and its value, inf if nothing is."""
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
            # What is hidden may stay so for now: the next round knows of it.
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
    """One run of SLSQP from a layout (n, 3), of which some dots move; its steps are added to `way`."""
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
    """Dots that move together: of many, strips of some 20 side by side, across another direction each time."""
    n = len(points)
    if n <= ALL_PAIRS_UP_TO:
        return [np.arange(n)]
    angle = number * np.pi * (3 - np.sqrt(5))
    order = np.argsort(points[:, 0] * np.cos(angle) + points[:, 1] * np.sin(angle), kind="stable")
    return [np.sort(block) for block in np.array_split(order, -(-n // BLOCK))]


def _every_second(flat: Array) -> Index:
    """1 for every second dot around the center, 0 for the others: in a ring it is what hides least and tells most."""
    around = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]), kind="stable")
    up = np.empty(len(flat), dtype=np.int64)
    up[around] = np.arange(len(flat)) % 2
    return up


def _flat(objective: Objective, flat: Array) -> tuple[Array, float]:
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points, float(objective(points[None])[0])


def _distinct(found: list[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Those of layouts with their values that are distinct by value, the best first."""
    kept: list[tuple[Array, float]] = []
    for points, value in sorted(found, key=lambda pair: pair[1]):
        if not kept or value > kept[-1][1] * (1 + DISTINCT):
            kept.append((points, value))
    return kept


def relief_breach(points: Array, relief: float, diameter: float, clearance: float, eyes: Array) -> float:
    """Largest breach in m of the promises that a layout (n, 3) in m makes in height; 0 or less if it keeps them.

    Every dot stands from 0 to `relief` over the plane and below all eyes (P, 3), and each ray from an eye to its rim
    keeps the clearance from all dots that are higher, or rather from the upright cylinders below these. The rim is
    sampled, which leaves out less than a thousandth of a mm of it.
    """
    worst = max(
        float(-points[:, 2].min()), float(points[:, 2].max()) - relief, float(np.max(points[:, 2] - eyes[:, 2].min()))
    )
    if not diameter:
        return worst
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    rim = diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for low, high in combinations(points[np.argsort(points[:, 2], kind="stable")], 2):
        # Heights at which a ray is beside the cylinder; it leaves the others above or below.
        reached = (high[2] - low[2]) / (eyes[:, 2] - low[2])
        way = np.linalg.norm(eyes[:, :2] - low[:2], axis=-1)
        near = reached * way + diameter + clearance >= dist(low[:2], high[:2])
        if high[2] <= low[2] or not near.any():
            continue
        start = low[:2] + rim - high[:2]
        toward = eyes[near, None, :2] - high[:2] - start
        nearest = -np.sum(start * toward, axis=-1) / np.maximum(np.sum(toward**2, axis=-1), np.finfo(float).tiny)
        share = np.clip(nearest, 0.0, reached[near, None])
        passing = np.linalg.norm(start + share[..., None] * toward, axis=-1)
        worst = max(worst, diameter / 2 + clearance - float(passing.min()))
    return worst


def check_relief(points: Array, relief: float, diameter: float, clearance: float, eyes: Array) -> None:
    """Refuse a layout that breaks its promises in height (see `relief_breach`) by more than a nanometer.

    Raises
    ------
    RuntimeError
        If it does: a search has gone wrong, which is no fault of the user's.
    """
    worst = relief_breach(points, relief, diameter, clearance, eyes)
    if not worst <= TOLERANCE:
        raise RuntimeError(f"the relief that was found breaks its constraints by {worst:.3g} m")
