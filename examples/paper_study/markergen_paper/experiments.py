"""Experiments, one for each kind of cell: their computation and resulting arrays."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.camera import PAPER_CAMERA
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.optimize.polish import polish
from markergen.optimize.problem import fewer
from markergen.optimize.relief import ReliefRoom, search_relief
from markergen.optimize.search import descend, search
from markergen.optimize.trace import Recorder
from markergen.studies.cells import Cell, Result
from markergen_paper.descents import descend_by_pose
from markergen_paper.measurements import (
    ESTIMATORS_FLAT,
    ESTIMATORS_RELIEF,
    Kept,
    bound_ratios,
    conditions,
    images_of,
    layout_trials,
    one_by_one,
)
from markergen_paper.methods import Decomposition, FromDlt, FromPoor, FromTruth, Harker, OpenCv, PlainDlt
from markergen_paper.options import BOUNDARY, CAMERAS, COORDINATES, RECTANGLE, REGION, objective_for, poses_of
from markergen_paper.supersab import supersab

Array = NDArray[np.float64]

CONDITIONED, DESCENT, EARLY, JOINT = "conditioned", "descent", "early", "joint"
METHODS, LIMITS, SETTLING = "methods", "limits", "settling"
"""Kinds of cells."""

BOUNDED = 10
"""Number of layouts per pose on which the bounds of the relative error are tested, once each."""

FURTHER = ("dlt", "ippe", "lm", Harker(), OpenCv(), PlainDlt(), Decomposition(), FromDlt(), FromTruth, FromPoor)
"""Estimators compared beside the paper's three: names, or estimators of this study."""

FRONTAL, POINTS = 0, 4
"""Pose of the paper's example, at 0.6 m, and its number of points."""

FIRST_STEPS = 0.2
"""Share of a descent's steps that are its first ones."""

ERRORS = {"homography_px": "homography", "rotation_deg": "rotation"}
"""Errors reduced by a descent, caused by 1 px of noise to first order, and the objectives that they are."""

GAINED = ("c", *ERRORS)
"""Quantities reduced by a descent: c(A), and the errors."""

STARTED_FROM, NEAR_BEST = 20, 0.02
"""Number of random starts, and the maximum relative excess over the best final value for a descent to be shown."""

RESTARTS, RELIEF_STARTS, RANDOM = 8, 4, 25
"""Number of random starts of a search over all poses, in the plane and in space, and of random layouts beside it."""

FEW_RESTARTS = 2
"""Number of random starts up to which a search for c(A) is descents and at most one polish."""

RELIEFS = {"relief-20": 0.02, "relief-50": 0.05}
"""Heights in m available to control points."""


def work(cell: Cell) -> Result:
    """Compute a cell of any kind."""
    return _WORK[cell.kind](cell)


def conditioned(cell: Cell) -> Result:
    """Random and optimized layouts of n points under each pose of a cell.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``runs``, ``noise_px``, ``optimized`` (number of starts to descend
    from, by name of an objective), ``seed``.

    Returns
    -------
    dict of arrays (P, B), by set and quantity
        Sets are ``ill`` (the random starts), the names of ``optimized``, and ``ngon``, the regular polygon on the rim.
        ``ill.c.unit`` is c(A) in unit coordinates, ``ill.lm.rotation_deg.mean`` and so on are those of `layout_trials`,
        ``metric.layouts`` (P, B, n, 2) the layouts in m, ``ill.upper.metric`` and ``.lower`` the ratios of
        `bound_ratios`.
    """
    settings, rngs = cell.settings, _rngs(cell)
    n, starts, poses = settings["n"], settings["starts"], poses_of(settings["poses"])
    layouts = {"ill": _drawn(starts, n, rngs)}
    for name, count in settings["optimized"].items():
        layouts[name] = descend_by_pose(name, poses, layouts["ill"][:, :count]).points
    # A fifth as many trials as the random layouts.
    layouts["ngon"] = _polygons(n, (len(poses), max(2, starts // 5)))
    result: Kept = {}
    for name, batch in layouts.items():
        kept = layout_trials(batch, poses, PAPER_CAMERA, settings["noise_px"], settings["runs"], rngs)
        result |= {f"{name}.{key}": value for key, value in kept.items()}
        for coordinates in COORDINATES:
            c = conditions(coordinates, batch, poses, PAPER_CAMERA)
            result[f"{name}.c.{coordinates}"] = c.astype(np.float32)
        if name != "ngon":
            result[f"{name}.layouts"] = batch.astype(np.float32)
        result |= _bounds(name, batch[:, :BOUNDED], poses, settings["noise_px"], rngs)
    return result


def _bounds(
    name: str, layouts: Array, poses: PoseDistribution, noise_px: float, rngs: Sequence[np.random.Generator]
) -> Kept:
    exact = images_of(layouts, poses, PAPER_CAMERA)
    noisy = exact + noise_px * np.stack([rng.standard_normal(exact.shape[1:]) for rng in rngs])
    result: Kept = {}
    for coordinates in COORDINATES:
        upper, lower = bound_ratios(coordinates, layouts, exact, noisy, poses, PAPER_CAMERA)
        result[f"{name}.upper.{coordinates}"] = upper.astype(np.float32)
        result[f"{name}.lower.{coordinates}"] = lower.astype(np.float32)
    return result


def _drawn(count: int, n: int, rngs: Sequence[np.random.Generator]) -> Array:
    """Random layouts (P, count, n, 2) in the disk, those of a pose by its generator."""
    return np.stack([REGION.sample(count, n, rng) for rng in rngs])


def _rngs(cell: Cell) -> list[np.random.Generator]:
    return [_rng(cell, index) for index in cell.settings["poses"]]


def _rng(cell: Cell, pose: int) -> np.random.Generator:
    """Random generator of a pose, independent of the other poses of its cell."""
    return np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(pose,)))


def _polygons(n: int, shape: tuple[int, int]) -> Array:
    """Copies (*shape, n, 2) of the regular polygon; the paper's square has its corners at 45 degrees."""
    ngon = regular_polygon(n, BOUNDARY.radius) @ _turn(np.pi / 4 if n == 4 else 0.0)
    return np.broadcast_to(ngon, (*shape, n, 2))


def _turn(angle: float) -> Array:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def methods(cell: Cell) -> Result:
    """The errors of further estimators, of random layouts, of those with the least c(A), and of the regular polygon.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``runs``, ``noise_px``, ``seed``.

    Returns
    -------
    dict of arrays (P, B)
        Named as those of `conditioned`, with the sets ``ill``, ``metric`` and ``ngon``, the estimators `FURTHER`, and
        LM from the true pose and from poor ones.
    """
    settings, rngs = cell.settings, _rngs(cell)
    n, starts, poses = settings["n"], settings["starts"], poses_of(settings["poses"])
    ill = _drawn(starts, n, rngs)
    layouts = {"ill": ill, "metric": descend_by_pose("metric", poses, ill).points}
    layouts["ngon"] = _polygons(n, (len(poses), starts))
    # One batch for all: Levenberg-Marquardt takes as many steps as its slowest trial.
    together = np.concatenate(list(layouts.values()), axis=1)
    kept = layout_trials(together, poses, PAPER_CAMERA, settings["noise_px"], settings["runs"], rngs, FURTHER)
    result: Kept = {"metric.layouts": layouts["metric"].astype(np.float32)}
    for i, name in enumerate(layouts):
        part = slice(i * starts, (i + 1) * starts)
        result |= {f"{name}.{key}": value[:, part] for key, value in kept.items()}
    return result


def limits(cell: Cell) -> Result:
    """Descents in a disk and in a rectangle of its area.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``seed``.

    Returns
    -------
    dict of arrays (P, B), by region
        ``disk.c`` is c(A) at the end in metric coordinates, ``disk.moved`` the mean distance of the points from their
        starts in m; and those of the ``rectangle``.
    """
    settings, rng = cell.settings, cell.rng
    poses, regions = poses_of(settings["poses"]), {"disk": REGION, "rectangle": RECTANGLE}
    drawn = [
        [region.sample(settings["starts"], settings["n"], rng) for region in regions.values()]
        for _ in range(len(poses))
    ]
    result: Result = {}
    for (name, region), starts in zip(regions.items(), np.stack(drawn, axis=1), strict=True):
        descents = descend_by_pose("metric", poses, starts, region=region)
        result[f"{name}.c"] = descents.values
        result[f"{name}.moved"] = np.linalg.norm(descents.points - starts, axis=-1).mean(axis=-1)
    return result


def settling(cell: Cell) -> Result:
    """Ends of descents by SuperSAB as published, after few and many steps, and by ours with its own stopping rule.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``seed``.

    Returns
    -------
    dict of arrays (P, B)
        c(A) in metric coordinates, by the names in `ROUTINES`.
    """
    settings = cell.settings
    poses, starts = poses_of(settings["poses"]), _drawn(settings["starts"], settings["n"], _rngs(cell))
    return {
        name: descend_by_pose("metric", poses, starts, **options).values.astype(np.float32)
        for name, options in ROUTINES.items()
    }


def descent(cell: Cell) -> Result:
    """Fronto-parallel descent of four points, with noisy runs at each of its steps.

    Settings: ``camera`` (a name in `CAMERAS`), ``noise_px``, ``runs``, ``seed``.

    Returns
    -------
    dict of arrays, S steps
        ``layouts`` (S, 4, 2) in m, ``c.metric`` and so on (S,), ``lm.rotation_deg.mean`` and so on (S,), and the same
        for the square on the rim, (1,), with the prefix ``square.``.
    """
    settings = cell.settings
    pose, camera, rng = poses_of([FRONTAL]), CAMERAS[settings["camera"]], cell.rng
    recorder = Recorder()
    starts = REGION.sample(STARTED_FROM, POINTS, rng)
    descents = descend(objective_for("metric", pose, camera), REGION, starts, record=recorder)
    # A start that ends in the best optimum, like the paper's, and is neither near it nor degenerate.
    good = np.flatnonzero(descents.values <= descents.values.min() * (1 + NEAR_BEST))
    begun = conditions("metric", starts[None, good], pose, camera)[0]
    chosen = good[np.argsort(begun, kind="stable")[len(good) // 2]]
    layouts = np.stack([layout for _, layout in recorder.way(descents.points[chosen])])
    square = regular_polygon(POINTS, BOUNDARY.radius)[None] @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2)
    result: Result = {"layouts": layouts}
    for before, batch in (("", layouts), ("square.", square)):
        kept = layout_trials(batch[None], pose, camera, settings["noise_px"], settings["runs"], [rng])
        result |= {before + key: value[0] for key, value in kept.items()}
        result |= {f"{before}c.{name}": conditions(name, batch[None], pose, camera)[0] for name in COORDINATES}
    return result


def early(cell: Cell) -> Result:
    """Share of a descent's gain that its first steps achieve.

    Settings: ``coordinates``, ``n``, ``poses`` (indices), ``starts``, ``seed``.

    Returns
    -------
    dict of arrays (P, B)
        ``c``, ``homography_px`` and ``rotation_deg``: share of the decrease of the logarithm achieved in the first
        fifth of the steps, nan if the start was degenerate or nothing was gained; ``steps``: number of steps.
    """
    settings, rng = cell.settings, cell.rng
    poses = poses_of(settings["poses"])
    recorder = Recorder()
    starts = _drawn(settings["starts"], settings["n"], [rng] * len(poses))
    descents = descend_by_pose(settings["coordinates"], poses, starts, record=recorder)
    shares: dict[str, list[Array]] = defaultdict(list)
    for ends, pose in zip(descents.points, one_by_one(poses), strict=True):
        ways = [np.stack([layout for _, layout in recorder.way(points)]) for points in ends]
        shares["steps"].append(np.array([len(way) - 1 for way in ways]))
        moments = np.stack([way[[0, round(FIRST_STEPS * (len(way) - 1)), -1]] for way in ways])
        objective = objective_for(settings["coordinates"], pose)
        measures = {key: OBJECTIVES[name](objective.setting) for key, name in ERRORS.items()}
        for key, measure in {"c": objective, **measures}.items():
            first, then, last = np.log(measure(moments.reshape(-1, *moments.shape[2:]))).reshape(len(ways), 3).T
            gained = np.isfinite(first) & np.isfinite(then) & np.isfinite(last) & (first > last)
            with np.errstate(invalid="ignore", divide="ignore"):
                shares[key].append(np.where(gained, (first - then) / (first - last), np.nan))
    return {key: np.stack(rows) for key, rows in shares.items()}


def joint(cell: Cell) -> Result:
    """One kind of layout of n points, and its errors under every pose.

    Settings: ``layout`` (an objective's name, ``ngon``, ``random``, or a relief), ``n``, ``poses`` (indices), ``runs``,
    ``restarts`` if there are fewer than usual, ``noise_px``, ``seed``.

    Returns
    -------
    dict of arrays
        ``layouts`` (B, n, 2 or 3) in m, ``lm.rotation_deg.mean`` and so on (P, B), and the criteria of
        `objectives.criteria` by name, (B,), for noise of 1 px.
    """
    settings, rng = cell.settings, cell.rng
    poses = poses_of(settings["poses"])
    layouts = layouts_of(settings["layout"], settings["n"], settings["poses"], rng, settings.get("restarts"))
    estimators = ESTIMATORS_RELIEF if layouts.shape[-1] == 3 else ESTIMATORS_FLAT
    at_poses = np.broadcast_to(layouts, (len(poses), *layouts.shape))
    rngs = [rng] * len(poses)
    kept = layout_trials(at_poses, poses, PAPER_CAMERA, settings["noise_px"], settings["runs"], rngs, estimators)
    table = criteria(layouts, Setting(BOUNDARY, PAPER_CAMERA, poses))
    return {
        "layouts": layouts,
        **kept,
        **{key: np.array([row[key] for row in table]) for key in table[0]},
    }


def layouts_of(name: str, n: int, indices: list[int], rng: np.random.Generator, restarts: int | None) -> Array:
    """Layouts (B, n, 2), or (1, n, 3) with relief, in m."""
    if name == "ngon":
        return regular_polygon(n, BOUNDARY.radius)[None]
    if name == "random":
        return REGION.sample(RANDOM, n, rng)
    poses = poses_of(indices)
    if name == "hartley":
        # The optimum is degenerate for any set of poses.
        poses = fewer(poses)
        if restarts and restarts <= FEW_RESTARTS:
            # A quick look does not find how degenerate it is.
            return descend(objective_for(name, poses), REGION, REGION.sample(1, n, rng)).points
    if name in COORDINATES and restarts and restarts <= FEW_RESTARTS:
        # Most of a search is polishes: a quick look has as many starts as the whole study, and polishes the best end.
        objective = objective_for(name, poses)
        ends = descend(objective, REGION, REGION.sample(RESTARTS, n, rng))
        return polish(objective, REGION, ends.points[np.argmin(ends.values)])[0][None]
    if name not in RELIEFS:
        rough = objective_for(name, fewer(poses))
        return search(objective_for(name, poses), REGION, n, rng, restarts or RESTARTS, rough=rough).points[None]
    # Bare points stand on pillars of zero width, which hide nothing.
    room = ReliefRoom(REGION, RELIEFS[name], eyes_of(poses))
    flat = regular_polygon(n, BOUNDARY.radius)
    rough = objective_for("pose", fewer(poses))
    return search_relief(objective_for("pose", poses), room, flat, rng, restarts or RELIEF_STARTS, rough=rough).points[
        None
    ]


ROUTINES: dict[str, dict[str, Any]] = {
    **{f"as published, {steps} steps": {"routine": supersab, "steps": steps} for steps in (150, 700)},
    "ours, until it gains nothing": {},
}
"""Descents and their stopping rules: options of `descend_by_pose`."""

_WORK: dict[str, Callable[[Cell], Result]] = {
    CONDITIONED: conditioned,
    DESCENT: descent,
    EARLY: early,
    JOINT: joint,
    METHODS: methods,
    LIMITS: limits,
    SETTLING: settling,
}
