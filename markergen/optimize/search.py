"""Global search for a flat layout.

In a disk: polishes of random layouts, of objectives with kinks a batch of descents. Where corners, holes or many dots
would trap them: exchange on a grid, polish, and moves of single dots. Most of it is for a subset of the poses, which is
enough to rank layouts; only the best few distinct results are polished for all poses. The best regular layouts are
polished as well, so that no result is worse than one of them. In a disk, a search ends early where independent random
starts agree on a layout than which a regular one is as good, and for many dots, where regular layouts nearly always end
best (in each of 16 tried with 26 to 100), once a few exchanges are no better.
"""
# tests: tests/optimize/test_search.py tests/optimize/test_optimize.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.objectives import Objective
from markergen.objectives.base import TraceObjective
from markergen.objectives.pose import PoseObjective
from markergen.optimize.ending import Ended, end_if_due, limited
from markergen.optimize.exchange import ExchangeTable, distances, edge, exchange, exchange_table, places, random_layout
from markergen.optimize.layouts import fitting, lattice, pack, regular_layouts
from markergen.optimize.polish import ALL_PAIRS_UP_TO, polish
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.trace import Record
from markergen.options import Progress
from markergen.units import format_length

Index = NDArray[np.int64]
Ranked = tuple[Array, float]
"""Layout (n, 2) or (n, 3) in m, and its value."""

POLISHED = 5
"""Number of distinct descents that are polished."""

DISTINCT, ALIKE = 2e-4, 0.02
"""Relative difference of values, and difference of distances between dots in radii, below which layouts count as the
same, so that only one is polished."""

AGREEING = 3
"""Number of independent starts whose agreement ends a search, and of those the best of which is shown first."""

SAME = 1e-6
"""Relative difference of values up to which a regular layout is preferred."""

RANDOM, PROBED = 48, 12
"""Number of random layouts that are polished for a subset of the poses in a disk, unless a regular one is as good, and
number up to which all but the first few are also polished for all poses, to see whether they agree. From a dozen dots
on, few poses never do: rotating a layout of 20 changes their value by 0.1 %, that of all 400 poses by 0.01 %."""

JITTER = 0.01
"""Random perturbation, in radii, of the starts of the polish: a descent from a symmetric layout can end at a saddle
point, such as two squares at a wrong angle to each other, which gradient steps do not leave."""

STARTS, MOST_DOTS = 12, 24
"""Number of exchanges from random layouts, up to so many dots; fewer for more."""

KEPT, KEPT_OF_MANY = 3, 5
"""Number of distinct layouts that are polished for all poses, and from `HOPPING` dots on."""

QUICK = 25
"""Iterations of the polishes that only rank layouts."""

MOVES = 4
"""Maximum number of rounds of moving single dots of a polished layout and polishing it again."""

GAIN = 1e-6
"""Relative gain that justifies another round."""

REGULAR, FEWEST_REGULAR, LIKELY = 6, 2, 24
"""Numbers of distinct regular layouts that are polished, if no fewer restarts are asked for, up to `MOST_HOPPING` dots,
the least for more, and of those other than polygons that a subset of the poses selects to be evaluated for all."""

OVERLAP = 0.7
"""Fraction of the spacing enforced in every other exchange: dots hardly ever touch on a grid, but do so once
polished."""

DRAWS = 5
"""Number of attempts at a random layout before dots count as jammed and overlaps are allowed at the start as well."""

CROWDED = 0.4
"""Fraction of the area covered by dots with their clearance above which dots can be packed in many ways, and single
dots cannot be moved elsewhere."""

SHAKES, SHAKES_OF_MANY, SHAKE = 2, 4, 0.25
"""Number of perturbations of the best crowded layout per start, from `HOPPING` dots on, and their size as a fraction of
the spacing."""

HOPS, FEWEST_HOPS, HOP, HOPPING, MOST_HOPPING = 192, 24, 0.5, 12, 40
"""Number of perturbations of the best layout of all, and the least for many dots, in turn of all dots by this fraction
of the spacing and of one dot to anywhere; number of dots from which on a room with corners or holes calls for them,
as exchanges then miss the best layout by up to a percent; and that up to which all are made: for more dots there are as
many as take the same time, which grows with the cube of the number of dots."""

FINE_EDGE = 1200
"""Number of points on the edge that are tested for touching a dot."""


GROW, SHRINK = 1.2, 0.5
"""Factors of the step size. A growth of 1.05 takes three times as many steps to the same optimum; 1.2 is as reliable
here."""

LONGEST = 0.15
"""Maximum step of a coordinate, in radii, so that no step jumps across the marker."""


@dataclass(frozen=True)
class Optimum:
    """Best layout (n, 2) in m found, and its value."""

    points: Array
    value: float


def search(
    objective: Objective,
    region: FeasibleRegion,
    n: int,
    rng: np.random.Generator,
    restarts: int = 0,
    progress: Progress | None = None,
    rough: Objective | None = None,
    record: Record | None = None,
    first: Callable[[Array], None] | None = None,
) -> Optimum:
    """Find the layout of n control points in the region that minimizes the objective.

    Uses descents from random layouts in a disk, and exchange where corners, holes or many dots would trap them.

    Parameters
    ----------
    restarts : int
        Random starts, and the most regular ones; 0 takes the objective's own default, and of exchanges as many as suit
        n.
    rough : Objective or None
        The same criterion for fewer poses, which saves time in the exchange.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    record : callable or None
        Called with the layouts before and after each step (see `markergen.optimize.trace`).
    first : callable or None
        Called with the best layout (n, 2) of a few starts; what it raises ends the search.

    Raises
    ------
    InputError
        If no feasible layout with a finite objective is found.
    """
    task = Stages(objective, rough or objective, region, n, progress or _silent, record, first or _silent)
    try:
        optimum = task.searched(rng, restarts)
    except Ended:
        with limited(None):
            optimum = task.best_so_far()
    if not np.isfinite(optimum.value):
        raise InputError(
            f"a {region.boundary} with room for {n} control points that are not in one line",
            f"dots of {format_length(region.diameter)} with {format_length(region.clearance)} clearance",
            "use a larger marker, a smaller --dot or a smaller --n",
        )
    return optimum


def _silent(*_: object) -> None:
    """Tell nobody."""


@dataclass(frozen=True, eq=False)
class Stages:
    """Stages of a search for a layout of n dots; `rough` is the objective for a subset of the poses."""

    objective: Objective
    rough: Objective
    region: FeasibleRegion
    n: int
    tell: Progress = _silent
    record: Record | None = None
    first: Callable[[Array], None] = _silent
    ends: list[Ranked] = field(default_factory=list)

    def searched(self, rng: np.random.Generator, restarts: int) -> Optimum:
        """Return the best layout of all stages; its value is inf if none is feasible."""
        end_if_due()
        # Spawned, so that what callers draw afterwards does not depend on them.
        shaking, hopping = rng.spawn(2)
        walled = len(self.region.walls) > 1
        if walled:
            optimum, regular = self.exchanged(rng, restarts), self.from_regular(shaking, restarts)
        elif self.n > ALL_PAIRS_UP_TO:
            regular = self.from_regular(shaking, restarts, leading=True)
            optimum = self.exchanged(rng, restarts, regular)
        elif self.objective.nonsmooth:
            optimum = self.descended(rng, restarts or self.objective.default_restarts)
            regular = self.from_regular(shaking, restarts)
        else:
            return self.polished_at_random(rng, shaking, restarts)
        if not optimum.value * (1 - GAIN) <= regular.value:
            optimum = regular
        if walled and self.n >= HOPPING and np.isfinite(optimum.value):
            hops = max(FEWEST_HOPS, round(HOPS * min(1.0, MOST_HOPPING / self.n) ** 3))
            optimum = self.hopped(optimum, min(hops, 3 * restarts or hops), hopping)
        return optimum

    def best_so_far(self) -> Optimum:
        """Return the best of all layouts that were polished and of the regular ones; its value is inf if none fits."""
        layouts = [*(points for points, _ in distinct_best(self.ends, LIKELY)), *self.regular[0]]
        candidates = [(points, float(self.objective(points[None])[0])) for points in layouts]
        return Optimum(*min(candidates, key=lambda end: end[1], default=(np.empty((0, 2)), np.inf)))

    def polished(self, start: Array, objective: Objective | None = None, iterations: int = 60) -> Ranked:
        """Polish a layout, by default for all poses, and keep it for `best_so_far` if it is feasible."""
        end = polish(objective or self.objective, self.region, start, iterations, self.record)
        if np.isfinite(end[1]):
            self.ends.append(end)
        return end

    def quick(self, start: Array, objective: Objective | None = None) -> Ranked:
        """Polish a layout just so well that it can be ranked, by default for a subset of the poses."""
        return self.polished(start, objective or self.rough, QUICK)

    def finished(self, candidates: list[Ranked], stage: str, total: int) -> list[Ranked]:
        """Polish layouts for all poses, as the last of `total` steps of a stage."""
        ends = []
        for done, (points, _) in enumerate(candidates, total - len(candidates)):
            self.tell(stage, done, total)
            ends.append(self.polished(points))
        self.tell(stage, total, total)
        return ends

    def moved(self, points: Array, to: Array) -> Array:
        """Return the feasible layout nearest to the one (n, 2) that a layout is moved to, as a start for polishing."""
        start = self.region.project(to[None])
        if self.record:
            self.record("polish", points[None], start)
        return start[0]

    def exchange(self, table: ExchangeTable, spacing: float, begin: Index) -> Array:
        """Return the layout (n, 2) that exchanging the places of single dots leads to."""
        end = table.places[exchange(table, spacing, begin)]
        if self.record:
            self.record("exchange", table.places[begin][None], end[None])
        return end

    def holds(self, points: Array) -> bool:
        """Return whether a layout (n, 2) is feasible."""
        return bool(self.region.holds(points[None])[0])

    @cached_property
    def regular(self) -> tuple[Array, Array]:
        """Regular layouts (B, n, 2), all polygons and the others that few poses select, and their values (B,)."""
        layouts, count = regular_layouts(self.region, self.n)
        # Polygons are judged for all poses, since designs are compared with them.
        if len(layouts) > count:
            likely = count + np.argsort(self.rough(layouts[count:]), kind="stable")[:LIKELY]
            layouts = layouts[np.concatenate([np.arange(count), likely])]
        return layouts, self.objective(layouts) if len(layouts) else np.empty(0)

    def polished_at_random(self, rng: np.random.Generator, shaking: np.random.Generator, restarts: int) -> Optimum:
        """Return the best polish of random and regular layouts, or a regular one that is as good.

        Unless restarts are asked for, there are no more random starts once enough of them end at the best of all, the
        polishes of regular layouts included.
        """
        ends, starts, regular, others, probes = list[Ranked](), restarts or RANDOM, None, list[Ranked](), list[Ranked]()
        for done in range(starts):
            self.tell("polish", done, starts + POLISHED)
            ends.append(self.quick(self.region.sample(1, self.n, rng)[0]))
            self.shown(ends)
            if AGREEING < len(ends) <= PROBED and not (restarts or agreed(ends)):
                probes.append(self.quick(ends[-1][0], self.objective))
            if restarts or not (agreed(ends) or agreed(probes)):
                continue
            if not regular:
                if exact := self.as_regular(*self.polished(distinct_best(probes if agreed(probes) else ends, 1)[0][0])):
                    return exact
                regular = self.from_regular(shaking, AGREEING)
                others = [self.quick(regular.points)] if len(regular.points) else []
            ends = probes if agreed(probes, [(regular.points, regular.value)]) else ends
            if ends is probes or agreed(ends, others):
                break
        if not np.isfinite([value for _, value in ends]).any() and (packed := fitting(self.region, self.n)) is not None:
            ends.append(self.quick(packed))
        # Few poses rank layouts only nearly as all do.
        ends = [(points, float(self.objective(points[None])[0])) for points, value in ends if np.isfinite(value)]
        candidates = self.finished(distinct_best(ends, POLISHED), "polish", starts + POLISHED)
        regular = regular or self.from_regular(shaking, restarts)
        points, value = min([*candidates, (regular.points, regular.value)], key=lambda end: end[1])
        return self.as_regular(points, value) or Optimum(points, value)

    def as_regular(self, points: Array, value: float) -> Optimum | None:
        """Return a regular layout that is as good as a polished one (n, 2) of that value; None if none is or better."""
        layouts, values = self.regular
        as_good = np.flatnonzero(values <= value * (1 + SAME))
        if not len(as_good) or values.min() < value * (1 - SAME):
            return None
        if self.record:
            self.record("polish", points[None], layouts[as_good[0]][None])
        return Optimum(layouts[as_good[0]], float(values[as_good[0]]))

    def shown(self, ends: list[Ranked]) -> None:
        """Show the best of the first few ends, once there are enough."""
        points, value = distinct_best(ends, 1)[0]
        if len(ends) == AGREEING and np.isfinite(value):
            self.first(points)

    def from_regular(self, rng: np.random.Generator, restarts: int, leading: bool = False) -> Optimum:
        """Return the best result of polishing regular layouts, no worse than any regular polygon.

        If they are `leading`, the first is the layout that is shown.
        """
        layouts, values = self.regular
        if not len(layouts):
            return Optimum(layouts, np.inf)
        most = max(FEWEST_REGULAR, REGULAR * MOST_HOPPING // max(self.n, MOST_HOPPING))
        candidates = distinct_best(list(zip(layouts, values.tolist(), strict=True)), min(most, restarts or most))
        shakes = rng.normal(scale=JITTER * self.region.boundary.radius, size=(len(candidates), self.n, 2))
        total = len(shakes) + KEPT
        for done, (start, shake) in enumerate(zip([points for points, _ in candidates], shakes, strict=True)):
            self.tell("regular", done, total)
            if leading and done == 1:
                self.first(distinct_best(candidates, 1)[0][0])
            # A symmetric layout may be a saddle point, which gradient steps do not leave.
            for begin in (start, self.moved(start, start + shake)):
                points, _ = self.quick(begin)
                if self.holds(points):
                    candidates.append((points, float(self.objective(points[None])[0])))
        ends = distinct_best(candidates)
        return Optimum(*min([*ends, *self.finished(ends, "regular", total)], key=lambda end: end[1]))

    def descended(self, rng: np.random.Generator, restarts: int) -> Optimum:
        """Return the best of the descents from random layouts; its value is inf if none ends in a feasible layout."""
        region, ends = self.region, list[Ranked]()
        self.tell("descent", 0, 1)
        for start in region.sample(AGREEING, self.n, rng.spawn(1)[0]):
            ends.append(self.quick(start))
            self.shown(ends)
        starts = region.sample(restarts, self.n, rng)
        if not region.holds(starts).all():
            # Random points jam when the dots nearly fill the region, so one packed layout is a start as well.
            packed = fitting(region, self.n)
            starts = starts if packed is None else np.concatenate([starts, packed[None]])
        descent = descend(self.objective, region, starts, progress=partial(self.tell, "descent"), record=self.record)
        order = np.argsort(descent.values, kind="stable")
        best, best_value = descent.points[order[0]], float(descent.values[order[0]])
        chosen: list[int] = []
        for index in order[: np.isfinite(descent.values).sum()]:
            if not chosen or descent.values[index] > descent.values[chosen[-1]] * (1 + DISTINCT):
                chosen.append(int(index))
            if len(chosen) == POLISHED:
                break
        shakes = rng.normal(scale=JITTER * region.boundary.radius, size=(len(chosen), self.n, 2))
        for done, (index, shake) in enumerate(zip(chosen, shakes, strict=True), start=1):
            points, value = self.polished(self.moved(descent.points[index], descent.points[index] + shake))
            if value < best_value and self.holds(points):
                best, best_value = points, value
            self.tell("polish", done, len(chosen))
        return Optimum(best, best_value)

    def exchanged(self, rng: np.random.Generator, restarts: int, beside: Optimum | None = None) -> Optimum:
        """Return the best layout by exchange from random layouts; 0 starts: as many as suit n.

        Unless starts are asked for, there are no more of them, and no moves of dots, once a few are no better than the
        layout beside, which then is the result.
        """
        rough, region, n = self.rough, self.region, self.n
        starts = restarts or max(1, STARTS * MOST_DOTS // max(n, MOST_DOTS))
        shakes, kept = (SHAKES_OF_MANY, KEPT_OF_MANY) if n >= HOPPING else (SHAKES, KEPT)
        grid, spare = _grid(region, n, rng)
        end_if_due()
        guide = exchange_table(rough if isinstance(rough, TraceObjective) else PoseObjective(rough.setting), grid)
        ends, by_start = list[Ranked](), dict[bytes, Ranked]()
        least = self.quick(beside.points)[1] if beside and len(beside.points) and not restarts else np.nan
        for done in range(starts):
            self.tell("exchange", done, starts)
            begin, spacing = _start(guide, region.spacing, n, done, spare, rng)
            # Where dots jam, all starts are the same.
            if begin.tobytes() not in by_start:
                layout = self.exchange(guide, spacing, begin)
                if rough.nonsmooth:
                    layout = descend(rough, region, layout[None], record=self.record).points[0]
                by_start[begin.tobytes()] = self.quick(layout)
            ends.append(by_start[begin.tobytes()])
            if beside is None:
                self.shown(ends)
            elif len(ends) == min(AGREEING, starts) and distinct_best(ends, 1)[0][1] >= least * (1 - DISTINCT):
                return beside
        self.tell("exchange", starts, starts)
        candidates = distinct_best(ends, kept)
        if np.isinf(candidates[0][1]) and (packed := fitting(region, n)) is not None:
            candidates = [polish(rough, region, packed, record=self.record)]
        if n <= ALL_PAIRS_UP_TO and n * np.pi / 4 * region.spacing**2 > CROWDED * region.boundary.area:
            candidates = distinct_best([*candidates, *self.shaken(*candidates[0], shakes * starts, rng)], kept)
        judge = guide if isinstance(rough, TraceObjective) else exchange_table(rough, grid)
        rim = edge(region, FINE_EDGE)
        total = 2 * len(candidates)
        for done, (points, value) in enumerate(candidates):
            self.tell("polish", done, total)
            candidates[done] = self.relocated(points, value, judge, rim)
        ends = self.finished(distinct_best(candidates, kept), "polish", total)
        return Optimum(*min(ends, key=lambda end: end[1]))

    def shaken(self, points: Array, value: float, times: int, rng: np.random.Generator) -> list[Ranked]:
        """Successively better layouts, each obtained by perturbing all dots of the previous one and polishing."""
        layouts = []
        for _ in range(times):
            shake = rng.normal(scale=SHAKE * self.region.spacing, size=points.shape)
            moved, better = self.quick(self.moved(points, points + shake))
            if better < value * (1 - GAIN):
                points, value = moved, better
                layouts.append((points, value))
        return layouts

    def hopped(self, optimum: Optimum, hops: int, rng: np.random.Generator) -> Optimum:
        """Return the best layout that perturbing and polishing the given one again and again leads to."""
        region, points = self.region, optimum.points
        value = float(self.rough(points[None])[0])
        # Few poses rank layouts only nearly as all do: the best few are judged by all.
        ends = [(points, value)]
        for done in range(hops):
            self.tell("hops", done, hops)
            if done % 2:
                to = points.copy()
                to[rng.integers(len(points))] = region.boundary.sample(1, region.inset, rng)[0]
            else:
                to = points + rng.normal(scale=HOP * region.spacing, size=points.shape)
            end, better = self.quick(self.moved(points, to))
            if self.holds(end):
                ends.append((end, better))
                if better < value * (1 - GAIN):
                    points, value = end, better
        for end, _ in distinct_best(ends, KEPT_OF_MANY):
            points, value = self.polished(end)
            if value < optimum.value * (1 - GAIN) and self.holds(points):
                optimum = Optimum(points, value)
        self.tell("hops", hops, hops)
        return optimum

    def relocated(self, points: Array, value: float, judge: ExchangeTable, rim: Array) -> Ranked:
        """Move single dots of a polished layout to better places, such as beside another dot, and polish it again."""
        for _ in range(MOVES):
            table = judge.joined(np.concatenate([points, _touching(points, rim, self.region.spacing)]))
            moved, better = self.quick(self.exchange(table, self.region.spacing, np.arange(len(points))))
            if not (better < value * (1 - GAIN) and self.holds(moved)):
                break
            points, value = moved, better
        return points, value


def agreed(ends: list[Ranked], others: Sequence[Ranked] = ()) -> bool:
    """Return whether enough ends of independent starts have the least value of all, those of others included."""
    least = min((value for _, value in [*ends, *others]), default=np.inf)
    return bool(np.isfinite(least)) and sum(value <= least * (1 + DISTINCT) for _, value in ends) >= AGREEING


def _start(
    table: ExchangeTable, spacing: float, n: int, attempt: int, spare: Index, rng: np.random.Generator
) -> tuple[Index, float]:
    """Initial layout (n,) of an exchange, random unless dots jam, and its spacing in m.

    Layouts of dozens of dots do not overlap: separating them would take most of the time, and jammed layouts are nearly
    lattices anyway.
    """
    for share in (1.0, OVERLAP)[attempt % 2 :] if n <= ALL_PAIRS_UP_TO else (1.0,):
        for _ in range(DRAWS):
            drawn = random_layout(table.apart, share * spacing, n, rng)
            if drawn is not None:
                return drawn, share * spacing
    return spare, spacing


def _grid(region: FeasibleRegion, n: int, rng: np.random.Generator) -> tuple[Array, Index]:
    """Candidate positions (C, 2) in m for an exchange, and the indices (n,) of a layout."""
    grid = places(region, n)
    layout = random_layout(distances(grid), region.spacing, n, rng)
    if layout is not None:
        return grid, layout
    # Dots that nearly fill the region jam when placed one by one, so they start on a lattice, or as packed.
    dense = lattice(region.boundary, region.diameter, region.clearance, region.gap)
    if len(dense) < n:
        dense = pack(region.boundary, n, region.clearance)[0]
    return np.concatenate([dense, grid]), np.arange(n)


def _touching(points: Array, rim: Array, spacing: float) -> Array:
    """Positions on the edge where a dot would nearly touch one of those at points (n, 2)."""
    pitch = np.linalg.norm(np.diff(rim, axis=0), axis=-1)
    gap = np.linalg.norm(rim[:, None] - points, axis=-1) - spacing
    return rim[np.any((gap >= 0) & (gap <= 2 * np.median(pitch)), axis=1)]


def distinct_best(candidates: list[Ranked], count: int = KEPT) -> list[Ranked]:
    """Select the best few distinct layouts, best first.

    Layouts of one value may well differ: few poses cannot tell which of them is best for all.
    """
    kept: list[Ranked] = []
    for points, value in sorted(candidates, key=lambda pair: pair[1]):
        if not any(value <= kept_value * (1 + DISTINCT) and _alike(points, layout) for layout, kept_value in kept):
            kept.append((points, value))
            if len(kept) == count:
                break
    return kept


def _alike(first: Array, second: Array) -> bool:
    """Return whether two layouts (n, 2) are the same but for a motion, a reflection and the order of the dots."""
    apart, beside = (np.sort(distances(points), axis=None) for points in (first, second))
    return bool(np.abs(apart - beside).max() <= ALIKE * apart[-1] / 2)


@dataclass(frozen=True)
class Descent:
    """Best feasible layouts (B, n, 2) in m of a descent, their values (B,), and the number of steps.

    The value of a restart that was never feasible is inf.
    """

    points: Array
    values: Array
    steps: int


def descend(
    objective: Objective,
    region: FeasibleRegion,
    starts: Array,
    steps: int = 150,
    patience: int = 10,
    tolerance: float = 1e-3,
    progress: Callable[[int, int], None] | None = None,
    record: Record | None = None,
) -> Descent:
    """Descend from all starts (B, n, 2) at once with a step size for each coordinate, retiring those that end.

        X(t+1) = P(X(t) - a(t) grad log f(X(t)))

    with a step size a for each coordinate, which grows while the sign of that coordinate's gradient is constant and
    shrinks when it changes, and P the projection onto the feasible region. It follows the paper's descent (Acuna &
    Willert 2018, Eq. 12) and SuperSAB (Tollenaere 1990), but the logarithm makes steps independent of the objective's
    unit, and no step is undone; as published, both are in the study of the paper.

    A restart is retired when its best value has fallen by less than `tolerance`, relatively, over `patience` steps.
    `record` is called with the layouts before and after each step.
    """
    scale = region.boundary.radius
    points = region.project(starts.copy())
    if record:
        record("descent", starts, points)
    value, gradient = _log_gradient(objective, points)
    layouts, values = points.copy(), np.where(region.holds(points), value, np.inf)
    # The first step moves the fastest coordinate of each layout by a twentieth of the radius.
    fastest = np.max(np.abs(gradient), axis=(1, 2), keepdims=True)
    step = np.broadcast_to(0.05 * scale / np.maximum(fastest, 1e-300), points.shape).copy()
    # From here on every array but `layouts` and `values` contains only the active layouts.
    alive = np.arange(len(points))
    best, best_value, reference = points.copy(), values.copy(), values.copy()
    taken = 0
    for taken in range(1, steps + 1):
        end_if_due()
        moved = region.project(points - np.clip(step * gradient, -LONGEST * scale, LONGEST * scale))
        held = region.holds(moved)
        # Where the projection jams, the layout stays in place and its steps shrink until they are feasible.
        jammed = ~held & np.isfinite(best_value)
        moved[jammed] = points[jammed]
        step[jammed] *= SHRINK**2
        if record:
            record("descent", points, moved)
        points = moved
        value, fresh = _log_gradient(objective, points)
        agreement = fresh * gradient
        step *= np.where(agreement > 0, GROW, np.where(agreement < 0, SHRINK, 1.0))
        gradient = fresh
        better = held & (value < best_value)
        best[better], best_value[better] = points[better], value[better]
        if taken % patience == 0:
            with np.errstate(invalid="ignore"):
                improving = ~(best_value >= reference * (1 - tolerance))
            layouts[alive], values[alive] = best, best_value
            alive, reference = alive[improving], best_value[improving]
            objective = objective.of_layouts(improving)
            points, gradient, step, best, best_value = (
                array[improving] for array in (points, gradient, step, best, best_value)
            )
        if progress:
            progress(taken if len(alive) else steps, steps)
        if not len(alive):
            break
    layouts[alive], values[alive] = best, best_value
    return Descent(layouts, values, taken)


def _log_gradient(objective: Objective, points: Array) -> tuple[Array, Array]:
    value, gradient = objective.value_and_gradient(points)
    return value, gradient / value[:, None, None]
