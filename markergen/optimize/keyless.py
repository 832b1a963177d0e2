"""Layouts whose dots are told apart by their place alone, by so many pixels, without a key ring.

The least objective subject to a label safety of at least so many px (see `markergen.optimize.label_ambiguity`), by
cutting planes: of a layout the rivals that are too near are found and become constraints, each a labeling at a pose;
the layout is polished under these, and looked at again, until there are no new ones. A constraint's derivative is in
closed form: D is a minimum over the rival's poses, so these need not be differentiated,

    dD = sum over j of e_j . (dm_T(X_s(j)) - dm_T'(X_j)) / D,    e_j = m_T(X_s(j)) - m_T'(X_j).

From a symmetric layout no derivative leads away, D = 0 being the tip of a cone: starts are the optimum without the
demand, shaken, and random layouts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.objectives import Objective
from markergen.optimize.label_ambiguity import (
    LabelSafety,
    find_rivals,
    layout_safety,
    representative,
    safety_of,
    worst_rivals,
)
from markergen.optimize.polish import ALL_PAIRS_UP_TO, REACH, Clearances, slsqp
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.rival_labelings import Rivals, SeenLayout, seen_layout
from markergen.optimize.search import Optimum, search
from markergen.optimize.trace import Record
from markergen.options import Progress

Array = NDArray[np.float64]

SHAKES = (0.05, 0.1, 0.1, 0.15, 0.15, 0.2, 0.2, 0.3)
"""How far the optimum without the demand is shaken, in radii, for one start each."""

RANDOM = 2
"""Random starts besides; in a disk they end far above the shaken ones."""

ROUNDS, ITERATIONS, RESTED = 12, 40, 1e-3
"""Rounds of cutting, and iterations of SLSQP in each; a layout that moves by less than this share of the radius in one
has come to rest."""

STALE = 6
"""Rounds that do not make a layout safer, which is not safe enough, before it is given up."""

BEATEN = 1e-3
"""A layout that is worse than another by more than this share, and still to be cut, is given up."""

CUTS, CUTS_PER_DOT, CUT_POSES, NEAR = 20, 1, 4, 1.3
"""New constraints in one round: nearest labelings of all and of each dot, at how many poses each, up to this factor of
what is demanded."""

LOOKED, FOLLOWED = 4, 40
"""Poses at which a round looks for rivals, and to which it follows those it finds; the end looks at more."""

FINALISTS, FINISHES = 4, 8
"""The best layouts that are looked at from all poses, and cut again up to so many times."""

HOPELESS = 0.8
"""Share of the demand below which a layout that all cuts were made of is not cut to the end."""

PRICE = 20.0
"""What lacking all of the safety costs, in logarithms of the objective: more than any layout is worth."""

SLACK = 1e-3
"""Share of the demand that the constraints ask for on top, so that the rounded result still has it."""

SOFTNESS = 0.003
"""Of objectives with kinks (see `markergen.optimize.polish`)."""


@dataclass(frozen=True, eq=False)
class AsymmetricOptimum:
    """The best layout with safe labels that was found.

    Attributes
    ----------
    points : array (n, 2), m
    value : float
        Of the objective.
    safety : LabelSafety
        Of equal dots, over all poses.
    demanded : float
        Safety in px that was asked for.
    free : Optimum
        The optimum without the demand.
    """

    points: Array
    value: float
    safety: LabelSafety
    demanded: float
    free: Optimum

    @property
    def reached(self) -> bool:
        """Whether the layout is as safe as was demanded."""
        return self.safety.least >= self.demanded

    @property
    def cost(self) -> float:
        """By what share the objective is above the optimum without the demand."""
        return self.value / self.free.value - 1

    @property
    def sentence(self) -> str:
        """What was reached and what it costs."""
        reached = f"labels are safe to {self.safety.least:.3g} px without a key ring"
        if not self.reached:
            return f"{reached}, less than the {self.demanded:g} px demanded"
        return f"{reached}, which costs {100 * self.cost:.1f} % of the objective"

    def or_refuse(self) -> "AsymmetricOptimum":
        """Return this one.

        Raises
        ------
        InputError
            If it is less safe than was demanded.
        """
        if self.reached:
            return self
        # Rounded down, so that it can be reached.
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

    Camera and poses are those of the objective's setting. Where no layout is safe enough, the safest that was met.

    Parameters
    ----------
    px : float
        Label safety, above 0.
    restarts : int
        Random starts of the search without the demand, and of that with it; 0 is the defaults.
    rough, record
        As `search` takes them.
    """
    free = search(objective, region, n, rng, restarts, progress, rough, record)
    scale = region.boundary.radius
    shaken = free.points + rng.normal(size=(len(SHAKES), n, 2)) * (scale * np.array(SHAKES))[:, None, None]
    shaken = region.project(shaken)
    if record:
        record("shaken", np.tile(free.points, (len(shaken), 1, 1)), shaken)
    starts = np.concatenate([shaken, region.sample(restarts or RANDOM, n, rng)])
    found = [_Candidate(free.points, free.value, _safety(objective, free.points))]
    if found[0].safety.least < px:
        looked = representative(objective.setting.poses, LOOKED)
        followed = representative(objective.setting.poses, FOLLOWED)
        layouts, bar = list[_Layout](), np.inf
        for done, start in enumerate(starts):
            if progress:
                progress("asymmetric", done, len(starts) + FINALISTS)
            layouts.append(_cut(objective, region, start, px, _Cuts(objective, looked, followed), bar, record))
            if layouts[-1].px >= px and region.holds(layouts[-1].points[None])[0]:
                bar = min(bar, layouts[-1].value)
        layouts = [each for each in layouts if region.holds(each.points[None])[0]]
        # What lacks little is cut to the end with the others.
        layouts.sort(key=lambda each: (max(HOPELESS * px - each.px, 0.0), each.value))
        for done, each in enumerate(layouts[:FINALISTS], start=1):
            found += _finished(objective, region, each, px, record)
            if progress:
                progress("asymmetric", len(starts) + done, len(starts) + FINALISTS)
    best = min(found, key=lambda each: each.rank(px))
    return AsymmetricOptimum(best.points, best.value, best.safety, px, free)


@dataclass(frozen=True, eq=False)
class _Candidate:
    points: Array
    value: float
    safety: LabelSafety

    def rank(self, px: float) -> tuple[float, float]:
        """Safe ones by the objective, then the others by their safety."""
        return max(px - self.safety.least, 0.0), self.value


@dataclass(frozen=True, eq=False)
class _Layout:
    """A layout that was cut, with its safety as far as the cuts know it."""

    points: Array
    value: float
    px: float
    cuts: "_Cuts"

    def rank(self, px: float) -> tuple[float, float]:
        return max(px - self.px, 0.0), self.value


class _Cuts:
    """Rivals that a layout has to keep away from, and how it does: they are followed as it moves."""

    def __init__(self, objective: Objective, looked: NDArray[np.intp], followed: NDArray[np.intp]) -> None:
        self.objective, self.looked, self.followed = objective, looked, followed
        self.rivals: Rivals | None = None

    def add(self, points: Array, px: float) -> float:
        """Look for rivals of points (n, 2); keep those nearer than `NEAR` times px. Returns the safety."""
        scene = self.scene(points)
        found = find_rivals(scene, self.looked)
        if self.rivals is not None:
            found = found.joined(scene.refit(self.rivals))
        labelings = np.unique(found.take(self._chosen(found, np.inf, 1)).labeling, axis=0)
        poses = self.followed
        found = found.joined(scene.fit(np.repeat(labelings, len(poses), axis=0), np.tile(poses, len(labelings))))
        self.keep(found, px)
        return float(found.px.min())

    def keep(self, found: Rivals, px: float) -> None:
        """Make constraints of those of `found` that are nearer than `NEAR` times px."""
        new = found.take(self._chosen(found, NEAR * px, CUT_POSES))
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
        """Nearest rivals of all and of each dot, each labeling at the `poses` where it is nearest."""
        order = np.argsort(rivals.distance, kind="stable")
        _, first, group = np.unique(rivals.labeling[order], axis=0, return_index=True, return_inverse=True)
        nearest = np.sort(first)
        per_dot = rivals.take(order[nearest]).best_per_dot(CUTS_PER_DOT)
        labelings = np.unique(np.concatenate([group.ravel()[nearest[:CUTS]], group.ravel()[nearest[per_dot]]]))
        chosen = np.concatenate([order[group.ravel() == one][:poses] for one in labelings])
        return chosen[rivals.px[chosen] < limit]


def safety_gradient(scene: SeenLayout, rivals: Rivals) -> Array:
    """Derivative (K, n, 2), px per m, of the safety from each rival by the dots' places in the plane."""
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
    """Derivative (K, n, 2, 2), px per m, of the images of points (n, 3) by their places in the plane."""
    seen = points @ rotation.swapaxes(-1, -2) + translation[:, None]
    normalized = seen[..., :2] / seen[..., 2:]
    in_plane = rotation[:, None, :, :2]
    rows = (in_plane[..., :2, :] - normalized[..., None] * in_plane[..., 2:, :]) / seen[..., 2:, None]
    return camera.pixel_jacobian(normalized) @ rows


def _safety(objective: Objective, points: Array) -> LabelSafety:
    return layout_safety(points, objective.setting, keyed=False)


def _cut(
    objective: Objective,
    region: FeasibleRegion,
    start: Array,
    px: float,
    cuts: _Cuts,
    bar: float,
    record: Record | None,
) -> _Layout:
    """Polish a layout and cut it, in turns, until it rests, or is worse than `bar`, which more cuts never mend."""
    reach = _reach(region, len(start))
    points, px_now = start, cuts.add(start, px)
    best = _Layout(points, float(objective(points[None])[0]), px_now, cuts)
    stale = 0
    for _ in range(ROUNDS):
        after = _polish(objective, region, points, px * (1 + SLACK), cuts, reach, record)
        moved = float(np.abs(after - points).max())
        points = after
        px_now = cuts.add(points, px)
        layout = _Layout(points, float(objective(points[None])[0]), px_now, cuts)
        feasible = region.holds(points[None])[0]
        # Rounds that make it safer count as progress only where they do so by a share that can be seen.
        stale = 0 if layout.px > best.px * (1 + RESTED) else stale + 1
        if feasible and (layout.rank(px) < best.rank(px) or not region.holds(best.points[None])[0]):
            best = layout
        rests = moved < RESTED * region.boundary.radius and layout.px >= px
        if rests or layout.value > bar * (1 + BEATEN) or (layout.px < px and stale == STALE):
            break
    return best


def _finished(
    objective: Objective, region: FeasibleRegion, layout: _Layout, px: float, record: Record | None
) -> list["_Candidate"]:
    """A layout as it is seen from all poses, and cut by what is found there."""
    points, cuts, found = layout.points, layout.cuts, list[_Candidate]()
    reach = _reach(region, len(points))
    for finish in range(FINISHES + 1):
        rivals = worst_rivals(cuts.scene(points))
        safety = safety_of(cuts.scene(points), rivals=rivals)
        if region.holds(points[None])[0]:
            found.append(_Candidate(points, float(objective(points[None])[0]), safety))
        if safety.least >= px or finish == FINISHES or layout.px < HOPELESS * px:
            break
        cuts.keep(rivals, px)
        points = _polish(objective, region, points, px * (1 + SLACK), cuts, reach, record)
    return found


def _reach(region: FeasibleRegion, n: int) -> float:
    """How far a dot may go in one polish, m; see `markergen.optimize.polish`."""
    return np.inf if len(region.walls) == 1 and n <= ALL_PAIRS_UP_TO else REACH * region.boundary.radius


def _polish(
    objective: Objective,
    region: FeasibleRegion,
    start: Array,
    px: float,
    cuts: _Cuts,
    reach: float,
    record: Record | None,
) -> Array:
    """One run of SLSQP under the region's constraints and the cuts; what these lack of px has a price.

    With the lack as one more variable no start is infeasible, and what cannot be reached is approached.
    """
    n, scale = len(start), region.boundary.radius
    clear = Clearances(region, start, reach, scale)
    softness = SOFTNESS if objective.nonsmooth else 0.0
    known: dict[bytes, tuple[Array, Array]] = {}

    def safety(x: Array) -> tuple[Array, Array]:
        key = x[:-1].tobytes()
        if key not in known:
            known.clear()
            known[key] = cuts.safety(x[:-1].reshape(n, 2) * scale)
        return known[key]

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
    if record:
        record("asymmetric", start[None], points)
    return points[0]


def _without_repeats(rivals: Rivals) -> Rivals:
    """Rivals without those of the same labeling at the same pose; the last ones stay, which were found just now."""
    keys = np.concatenate([rivals.labeling, rivals.pose[:, None]], axis=1)[::-1]
    _, last = np.unique(keys, axis=0, return_index=True)
    return rivals.take(np.sort(len(rivals) - 1 - last))
