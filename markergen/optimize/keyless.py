"""Layouts identified by position alone: their dots without a key ring, or plates of a rig without tags.

Minimizes the objective subject to a minimum label safety in px (see `markergen.bounds.confusion`) by cutting
planes: rivals of a layout that are too near become constraints, each a labeling at a pose; the layout is polished under
these and examined again, until there are no new ones. A constraint's derivative has a closed form: D is a minimum over
the rival's poses, so these need not be differentiated,

    dD = sum over j of e_j . (dm_T(X_s(j)) - dm_T'(X_j)) / D,    e_j = m_T(X_s(j)) - m_T'(X_j).

A symmetric layout, D = 0, is the tip of a cone, from which no derivative leads away: starts are perturbations of the
unconstrained optimum, and random layouts. There are no more of them once a few agree, as in the search without demand.

Plates are distinguished by layouts that no affine map takes to each other, which has no derivative of use: such layouts
are found by random variation.
"""
# tests: tests/optimize/test_keyless.py tests/optimize/test_rig.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.bounds.confusion.affine import affine_distance, partial_distance, self_distance
from markergen.bounds.confusion.perspective import (
    LabelSafety,
    find_rivals,
    layout_safety,
    representative,
    safety_of,
    worst_rivals,
)
from markergen.bounds.confusion.rival_fits import Rivals, SeenLayout, seen_layout
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.objectives import Objective
from markergen.optimize.ending import Ended, end_if_due, is_due
from markergen.optimize.polish import ALL_PAIRS_UP_TO, REACH, Clearances, polish, slsqp
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import Optimum, agreed, search
from markergen.optimize.trace import Record
from markergen.options import Progress

SHAKES = (0.05, 0.1, 0.1, 0.15, 0.15, 0.2, 0.2, 0.3)
"""Perturbations of the unconstrained optimum, in radii, for one start each."""

RANDOM = 2
"""Number of additional random starts; in a disk they end far above the perturbed ones."""

ROUNDS, ITERATIONS, RESTED = 12, 40, 1e-3
"""Maximum number of cutting rounds, of SLSQP iterations in each, and movement per round, as a fraction of the radius,
below which a layout has converged."""

STALE = 6
"""Number of rounds without improvement after which a layout that is not safe enough is abandoned."""

BEATEN = 1e-3
"""Relative difference by which an unfinished layout may be worse than another before it is abandoned."""

CUTS, CUTS_PER_DOT, CUT_POSES, NEAR = 20, 1, 4, 1.3
"""New constraints per round: numbers of nearest labelings overall and per dot, number of poses for each, and maximum
safety as a multiple of the demand."""

LOOKED, FOLLOWED = 4, 40
"""Numbers of poses at which a round searches for rivals, and to which it follows them; the final check uses more."""

FINALISTS, FINISHES, REACHED = 4, 8, 2e-4
"""Number of best layouts examined from all poses, maximum number of times that each is cut again, and relative
difference to the next one below which a finished layout is the result: more cuts never make a layout better."""

HOPELESS = 0.8
"""Fraction of the demand below which a layout is not cut again in the final stage."""

PRICE = 20.0
"""Penalty for zero safety, added to the logarithm of the objective: larger than any difference between layouts."""

SLACK = 1e-3
"""Margin of the constraints over the demand, as a fraction of it, so that the rounded result still satisfies it."""

SOFTNESS = 0.003
"""Softness for objectives with kinks (see `markergen.optimize.polish`)."""


FIRST, CHILDREN, PARENTS, GENERATIONS = 256, 96, 8, 16
"""Numbers of layouts tried at first and in each generation, of those that are varied, and of generations."""

LARGEST, SMALLEST = 0.4, 0.003
"""Steps at first and of the last generation, in radii of the boundary."""

PARTLY = 2.0
"""How much a distance counts that leaves out a dot."""


@dataclass(frozen=True, eq=False)
class AsymmetricOptimum:
    """Best layout with safe labels found.

    Attributes
    ----------
    points : array (n, 2), m
    value : float
        Value of the objective.
    safety : LabelSafety
        Label safety of equal dots, over all poses.
    demanded : float
        Demanded safety in px.
    free : Optimum
        Optimum without the demand.
    """

    points: Array
    value: float
    safety: LabelSafety
    demanded: float
    free: Optimum

    @property
    def reached(self) -> bool:
        """True if the layout has the demanded safety."""
        return self.safety.least >= self.demanded

    @property
    def binding(self) -> bool:
        """True if the layout is hardly safer than demanded: a rotation by itself then breaks the demand."""
        return self.safety.least < self.demanded * (1 + 2 * SLACK)

    @property
    def cost(self) -> float:
        """Relative increase of the objective over the optimum without the demand."""
        return self.value / self.free.value - 1

    @property
    def sentence(self) -> str:
        """Safety reached and its cost, in words."""
        reached = f"labels are safe to {self.safety.least:.3g} px without a key ring"
        if not self.reached:
            return f"{reached}, less than the {self.demanded:g} px demanded"
        return f"{reached}, which costs {100 * self.cost:.1f} % of the objective"

    def or_refuse(self) -> "AsymmetricOptimum":
        """Return this optimum if it has the demanded safety.

        Raises
        ------
        InputError
            If its safety is less than demanded.
        """
        if self.reached:
            return self
        # Rounded down, so that it is attainable.
        best = np.floor(100 * self.safety.least) / 100
        remedy = f"use --asymmetric {best:g} or less, another --n" if best else "use another --n"
        raise InputError(
            f"{len(self.points)} dots whose labels are safe to {self.demanded:g} px by their places alone",
            f"no layout safer than {best:g} px",
            f"{remedy} or more room, or leave it out and have a key ring",
        )


def asymmetric_search(
    objective: Objective,
    region: FeasibleRegion,
    n: int,
    rng: np.random.Generator,
    px: float,
    restarts: int = 0,
    progress: Progress | None = None,
    rough: Objective | None = None,
    record: Record | None = None,
) -> AsymmetricOptimum:
    """Find the layout (n, 2) of n equal dots that minimizes the objective with a label safety of `px` or more.

    Camera and poses are those of the objective's setting. If no layout is safe enough, return the safest one found.
    Raises InputError if no image is large enough for the demand.

    Parameters
    ----------
    px : float
        Demanded label safety, above 0.
    restarts : int
        Number of random starts of the searches without and with the demand; 0 selects the defaults.
    rough, record
        See `search`.
    """
    camera = objective.setting.camera
    if px >= (diagonal := float(np.hypot(camera.width, camera.height))):
        raise InputError(
            f"a label safety below the image's diagonal of {diagonal:.4g} px", f"{px:g} px", "use --asymmetric 3"
        )
    free = search(objective, region, n, rng, restarts, progress, rough, record)
    scale = region.boundary.radius
    shaken = free.points + rng.normal(size=(len(SHAKES), n, 2)) * (scale * np.array(SHAKES))[:, None, None]
    shaken = region.project(shaken)
    if record:
        record("shaken", np.tile(free.points, (len(shaken), 1, 1)), shaken)
    starts = np.concatenate([shaken, region.sample(restarts or RANDOM, n, rng)])
    candidates = [_Candidate(free.points, free.value, layout_safety(free.points, objective.setting, keyed=False))]
    if candidates[0].safety.least < px:
        looked = representative(objective.setting.poses, LOOKED)
        followed = representative(objective.setting.poses, FOLLOWED)
        layouts, ends = list[_CutLayout](), list[tuple[Array, float]]()
        for done, start in enumerate(starts):
            if progress:
                progress("asymmetric", done, len(starts) + FINALISTS)
            bar = min((value for _, value in ends), default=np.inf)
            try:
                layouts.append(_cut(start, px, _Cuts(objective, region, record, looked, followed), bar))
            except Ended:
                break
            if layouts[-1].px >= px and region.holds(layouts[-1].points[None])[0]:
                ends.append((layouts[-1].points, layouts[-1].value))
                if not restarts and agreed(ends):
                    break
        layouts = [layout for layout in layouts if region.holds(layout.points[None])[0]]
        # Layouts that lack little are finished with the others.
        layouts.sort(key=lambda layout: (max(HOPELESS * px - layout.px, 0.0), layout.value))
        for done, layout in enumerate(layouts[:FINALISTS]):
            best = min(candidates, key=lambda candidate: candidate.rank(px))
            if best.safety.least >= px and best.value <= layout.value * (1 + REACHED):
                break
            if progress:
                progress("asymmetric", len(starts) + done, len(starts) + FINALISTS)
            candidates += _finished(layout, px)
        if progress:
            progress("asymmetric", 1, 1)
    best = min(candidates, key=lambda candidate: candidate.rank(px))
    return AsymmetricOptimum(best.points, best.value, best.safety, px, free)


@dataclass(frozen=True, eq=False)
class _Candidate:
    points: Array
    value: float
    safety: LabelSafety

    def rank(self, px: float) -> tuple[float, float]:
        """Sort key: safe layouts by objective, then the others by safety."""
        return max(px - self.safety.least, 0.0), self.value


@dataclass(frozen=True, eq=False)
class _CutLayout:
    """A layout that was cut, with its safety according to the cuts."""

    points: Array
    value: float
    px: float
    cuts: "_Cuts"

    def rank(self, px: float) -> tuple[float, float]:
        return max(px - self.px, 0.0), self.value


class _Cuts:
    """Rivals as constraints of a layout, refitted as it moves."""

    def __init__(
        self,
        objective: Objective,
        region: FeasibleRegion,
        record: Record | None,
        looked: NDArray[np.intp],
        followed: NDArray[np.intp],
    ) -> None:
        self.objective, self.region, self.record = objective, region, record
        self.looked, self.followed = looked, followed
        self.rivals: Rivals | None = None

    def add(self, points: Array, px: float) -> float:
        """Search for rivals of points (n, 2), keep those nearer than `NEAR` times px, and return the safety."""
        scene = self.scene(points)
        rivals = find_rivals(scene, self.looked)
        if self.rivals is not None:
            rivals = rivals.joined(scene.refit(self.rivals))
        labelings = np.unique(rivals.take(self._chosen(rivals, np.inf, 1)).labeling, axis=0)
        poses = self.followed
        rivals = rivals.joined(scene.fit(np.repeat(labelings, len(poses), axis=0), np.tile(poses, len(labelings))))
        self.keep(rivals, px)
        return float(rivals.px.min())

    def keep(self, rivals: Rivals, px: float) -> None:
        """Add those of the rivals that are nearer than `NEAR` times px to the constraints."""
        new = rivals.take(self._chosen(rivals, NEAR * px, CUT_POSES))
        self.rivals = new if self.rivals is None else _without_repeats(self.rivals.joined(new))

    def scene(self, points: Array) -> SeenLayout:
        setting = self.objective.setting
        return seen_layout(points, np.zeros(len(points), dtype=np.intp), setting.camera, setting.poses)

    def safety(self, points: Array) -> tuple[Array, Array]:
        """Safety (K,) of points (n, 2) from each rival, in px, and its derivative (K, n, 2) per m."""
        assert self.rivals is not None
        scene = self.scene(points)
        rivals = scene.refit(self.rivals)
        lost = np.flatnonzero(~np.isfinite(rivals.distance))
        if len(lost):
            fresh = scene.fit(rivals.labeling[lost], rivals.pose[lost])
            source = np.arange(len(rivals))
            source[lost] = len(rivals) + np.arange(len(lost))
            rivals = rivals.joined(fresh).take(source)
        self.rivals = rivals
        return rivals.px, safety_gradient(scene, rivals)

    def _chosen(self, rivals: Rivals, limit: float, poses: int) -> NDArray[np.intp]:
        """Indices of the nearest rivals overall and per dot, each labeling at the `poses` where it is nearest."""
        order = np.argsort(rivals.distance, kind="stable")
        _, first, group = np.unique(rivals.labeling[order], axis=0, return_index=True, return_inverse=True)
        nearest = np.sort(first)
        per_dot = rivals.take(order[nearest]).best_per_dot(CUTS_PER_DOT)
        labelings = np.unique(np.concatenate([group.ravel()[nearest[:CUTS]], group.ravel()[nearest[per_dot]]]))
        chosen = np.concatenate([order[group.ravel() == labeling][:poses] for labeling in labelings])
        return chosen[rivals.px[chosen] < limit]


def safety_gradient(scene: SeenLayout, rivals: Rivals) -> Array:
    """Derivative (K, n, 2), px per m, of the safety from each rival with respect to positions in the plane."""
    true = _image_rows(
        scene.points, scene.camera, scene.poses.rotation[rivals.pose], scene.poses.translation[rivals.pose]
    )
    rival = _image_rows(scene.points, scene.camera, rivals.rotation, rivals.translation)
    images = np.take_along_axis(scene.images[rivals.pose], rivals.labeling[..., None], axis=1)
    offset = images - scene.camera.project(scene.points, rivals.rotation, rivals.translation)
    gradient = np.zeros((*rivals.labeling.shape, 2))
    rows = np.arange(len(rivals))[:, None]
    taken = true[rows, rivals.labeling]
    gradient[rows, rivals.labeling] = np.einsum("kni,knij->knj", offset, taken)
    gradient -= np.einsum("kni,knij->knj", offset, rival)
    size = 2 * np.sqrt(len(scene.points)) * np.maximum(rivals.distance, 1e-9)
    return gradient / size[:, None, None]


def _image_rows(points: Array, camera: Camera, rotation: Array, translation: Array) -> Array:
    """Derivative (K, n, 2, 2), px per m, of the images of points (n, 3) with respect to positions in the plane."""
    seen = points @ rotation.swapaxes(-1, -2) + translation[:, None]
    normalized = seen[..., :2] / seen[..., 2:]
    in_plane = rotation[:, None, :, :2]
    rows = (in_plane[..., :2, :] - normalized[..., None] * in_plane[..., 2:, :]) / seen[..., 2:, None]
    return camera.pixel_jacobian(normalized) @ rows


def _cut(start: Array, px: float, cuts: _Cuts, bar: float) -> _CutLayout:
    """Alternately polish and cut a layout until it converges, or is worse than `bar`, which cuts never improve."""
    objective, region = cuts.objective, cuts.region
    points, px_now = start, cuts.add(start, px)
    best = _CutLayout(points, float(objective(points[None])[0]), px_now, cuts)
    stale = 0
    for _ in range(ROUNDS):
        after = _polish(points, px * (1 + SLACK), cuts)
        moved = float(np.abs(after - points).max())
        points = after
        px_now = cuts.add(points, px)
        layout = _CutLayout(points, float(objective(points[None])[0]), px_now, cuts)
        feasible = region.holds(points[None])[0]
        # Only a noticeable relative gain in safety counts as progress.
        stale = 0 if layout.px > best.px * (1 + RESTED) else stale + 1
        if feasible and (layout.rank(px) < best.rank(px) or not region.holds(best.points[None])[0]):
            best = layout
        rests = moved < RESTED * region.boundary.radius and layout.px >= px
        if rests or layout.value > bar * (1 + BEATEN) or (layout.px < px and stale == STALE):
            break
    return best


def _finished(layout: _CutLayout, px: float) -> list["_Candidate"]:
    """Examine a layout from all poses, and cut it by the rivals found there."""
    points, cuts, candidates = layout.points, layout.cuts, list[_Candidate]()
    objective, region = cuts.objective, cuts.region
    for finish in range(FINISHES + 1):
        rivals = worst_rivals(cuts.scene(points))
        safety = safety_of(cuts.scene(points), rivals=rivals)
        if region.holds(points[None])[0]:
            candidates.append(_Candidate(points, float(objective(points[None])[0]), safety))
        if safety.least >= px or finish == FINISHES or layout.px < HOPELESS * px or is_due():
            break
        cuts.keep(rivals, px)
        points = _polish(points, px * (1 + SLACK), cuts)
    return candidates


def _polish(start: Array, px: float, cuts: _Cuts) -> Array:
    """Run SLSQP once under the region's constraints and the cuts, with a penalty on missing safety.

    With the missing safety as an additional variable every start is feasible, and unattainable demands are approached.
    """
    objective, region = cuts.objective, cuts.region
    n, scale = len(start), region.boundary.radius
    # As far as in `markergen.optimize.polish`.
    reach = np.inf if len(region.walls) == 1 and n <= ALL_PAIRS_UP_TO else REACH * scale
    clear = Clearances(region, start, reach, scale)
    softness = SOFTNESS if objective.nonsmooth else 0.0
    computed: dict[bytes, tuple[Array, Array]] = {}

    def safety(x: Array) -> tuple[Array, Array]:
        key = x[:-1].tobytes()
        if key not in computed:
            computed.clear()
            computed[key] = cuts.safety(x[:-1].reshape(n, 2) * scale)
        return computed[key]

    def cost(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(x[:-1].reshape(1, n, 2) * scale, softness)
        by_points = (gradient[0] * (scale / value[0])).ravel()
        return float(np.log(value[0])) + PRICE * x[-1], np.append(by_points, PRICE)

    def slack(x: Array) -> Array:
        return np.concatenate([clear.slack(x[:-1].reshape(n, 2)), safety(x)[0] / px - 1 + x[-1]])

    def slack_jacobian(x: Array) -> Array:
        by_safety = safety(x)[1] * (scale / px)
        rows = np.concatenate([clear.slack_jacobian(x[:-1].reshape(n, 2)), by_safety]).reshape(-1, 2 * n)
        by_lack = np.zeros(len(rows))
        by_lack[len(rows) - len(by_safety) :] = 1.0
        return np.concatenate([rows, by_lack[:, None]], axis=1)

    x = np.append(start.ravel() / scale, 0.0)
    x[-1] = max(0.0, 1 - float(safety(x)[0].min(initial=px)) / px)
    low, high = x - reach / scale, x + reach / scale
    low[-1], high[-1] = 0.0, np.inf
    end = slsqp(cost, slack, slack_jacobian, x, (low, high), ITERATIONS, 1e-9)
    points = region.project(end[:-1].reshape(1, n, 2) * scale)
    if cuts.record:
        cuts.record("asymmetric", start[None], points)
    return points[0]


def _without_repeats(rivals: Rivals) -> Rivals:
    """Remove duplicates of the same labeling at the same pose, keeping the last, which is the most recent."""
    keys = np.concatenate([rivals.labeling, rivals.pose[:, None]], axis=1)[::-1]
    _, last = np.unique(keys, axis=0, return_index=True)
    return rivals.take(np.sort(len(rivals) - 1 - last))


def distinct_layout(
    objective: Objective,
    rough: Objective,
    region: FeasibleRegion,
    start: Array,
    others: list[Array],
    distance: float,
    rng: np.random.Generator,
    largest: float = LARGEST,
) -> Array:
    """Find a layout (n, 2) that minimizes an objective, at least a distance from others and from itself relabeled.

    Random variations of the start and of the best ones found, with steps that become smaller; then a polish, if that
    keeps the distances.

    Parameters
    ----------
    rough : Objective
        The same criterion for fewer poses.
    others : list of array (m, 2)
    distance : float
        Smallest `affine_distance` in m, and `PARTLY` times the smallest `partial_distance`.

        If no layout has it, the one that lacks least is returned.
    largest : float
        Largest step, in radii of the boundary: the smaller, the fewer layouts are tried.
    """
    scale, n = region.boundary.radius, len(start)

    measures: list[Callable[[Array], Array]] = [
        self_distance,
        *(partial(affine_distance, other=rival) for rival in others),
        *(partial(_partly, other=rival) for rival in others),
    ]

    def apart(layouts: Array) -> float:
        return float(min(measure(layouts[None])[0] for measure in measures))

    count = round(FIRST * largest / LARGEST)
    steps = rng.choice(np.geomspace(0.02, largest, 12), size=count)[:, None, None] * scale
    mirrored = np.where(rng.random(count)[:, None, None] < 0.5, np.array([-1.0, 1.0]), 1.0)
    pool = np.concatenate([start[None], start * mirrored + steps * rng.normal(size=(count, n, 2))])
    pool = np.concatenate([pool, region.sample(count // 4, n, rng)])
    # The ring at each of the dots.
    pool = np.concatenate([pool, [np.roll(start, places, axis=0) for places in range(1, n)]])
    best, rank = _ranked(pool, region, rough, measures, distance)
    generations = round(GENERATIONS * np.log(largest / 2 / SMALLEST) / np.log(LARGEST / 2 / SMALLEST))
    sizes = np.geomspace(largest / 2, SMALLEST, generations) * scale
    for size in sizes:
        end_if_due()
        parents = best[np.arange(CHILDREN) % len(best)]
        # Half of the children move one dot only.
        moved = np.where(rng.random((CHILDREN, 1)) < 0.5, np.eye(n)[rng.integers(n, size=CHILDREN)], 1.0)
        children = parents + size * moved[..., None] * rng.normal(size=parents.shape)
        most = rank[-1, 0] if len(rank) == PARENTS else np.inf
        fresh, fresh_rank = _ranked(children, region, rough, measures, distance, most)
        both, ranks = np.concatenate([best, fresh]), np.concatenate([rank, fresh_rank])
        order = np.lexsort(ranks.T[::-1])[:PARENTS]
        best, rank = both[order], ranks[order]
    layout = best[0]
    polished, _ = polish(objective, region, layout)
    kept = region.holds(polished[None])[0] and apart(polished) >= min(distance, apart(layout))
    return polished if kept else layout


def _partly(layouts: Array, other: Array) -> Array:
    return PARTLY * partial_distance(layouts, other)


def _ranked(
    layouts: Array,
    region: FeasibleRegion,
    rough: Objective,
    measures: Sequence[Callable[[Array], Array]],
    distance: float,
    most: float = np.inf,
) -> tuple[Array, Array]:
    """Feasible layouts that lack `most` or less, the best `PARENTS`, with their ranks (k, 2): lack of distance, value.

    Measures of distance come in the order of their cost, and values take longer: only those are computed that decide.
    """
    layouts = region.project(layouts)
    layouts = layouts[region.holds(layouts)]
    lack = np.zeros(len(layouts))
    for measure in measures:
        lack = np.maximum(lack, distance - measure(layouts))
        layouts, lack = layouts[lack <= most], lack[lack <= most]
    nearest = np.argsort(lack, kind="stable")[: max(PARENTS, (lack == 0).sum())]
    rank = np.stack([lack[nearest], rough(layouts[nearest]) if len(nearest) else np.zeros(0)], axis=-1)
    order = np.lexsort(rank.T[::-1])[:PARENTS]
    return layouts[nearest[order]], rank[order]
