"""Experiments, one for each kind of cell: their computation and resulting arrays."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import AnyEstimator
from markergen.model.camera import PAPER_CAMERA
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.optimize.problem import fewer
from markergen.optimize.relief import ReliefRoom, search_relief
from markergen.optimize.search import Descent, descend, search
from markergen.optimize.trace import Recorder
from markergen.studies.cells import Cell, Result
from markergen_paper.measurements import (
    ESTIMATORS_FLAT,
    ESTIMATORS_RELIEF,
    Kept,
    bound_ratios,
    conditions,
    layout_trials,
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

FURTHER = ("dlt", "ippe", "lm", Harker(), OpenCv(), PlainDlt(), Decomposition(), FromDlt())
"""Estimators compared beside the paper's three: names, or estimators of this study."""

FRONTAL, POINTS = 0, 4
"""Pose of the paper's example, at 0.6 m, and its number of points."""

FIRST_STEPS = 0.2
"""Share of a descent's steps that are its first ones."""

GAINED = ("c", "homography_px", "rotation_deg")
"""Quantities reduced by a descent: c(A), and the errors caused by 1 px of noise to first order."""

STARTED_FROM, NEAR_BEST = 20, 0.02
"""Number of random starts, and the maximum relative excess over the best final value for a descent to be shown."""

RESTARTS, RELIEF_STARTS, RANDOM = 8, 4, 25
"""Number of random starts of a search over all poses, in the plane and in space, and of random layouts beside it."""

FEW_RESTARTS = 2
"""Number of random starts up to which a search that needs autograd is a descent alone."""

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
    settings = cell.settings
    poses = poses_of(settings["poses"])
    parts = [
        _one_pose(settings, poses.taken(np.array([i]), 0), _rng(cell, index))
        for i, index in enumerate(settings["poses"])
    ]
    return {key: np.stack([part[key] for part in parts]) for key in parts[0]}


def _one_pose(settings: Mapping[str, Any], pose: PoseDistribution, rng: np.random.Generator) -> Kept:
    n, starts = settings["n"], settings["starts"]
    layouts = {"ill": REGION.sample(starts, n, rng)}
    for name, count in settings["optimized"].items():
        layouts[name] = descend(objective_for(name, pose), REGION, layouts["ill"][:count]).points
    # A fifth as many trials as the random layouts.
    layouts["ngon"] = _polygons(n, max(2, starts // 5))
    result: Kept = {}
    for name, batch in layouts.items():
        kept = layout_trials(batch, pose, PAPER_CAMERA, settings["noise_px"], settings["runs"], rng)
        result |= {f"{name}.{key}": value for key, value in kept.items()}
        for coordinates in COORDINATES:
            c = conditions(coordinates, batch, pose, PAPER_CAMERA)
            result[f"{name}.c.{coordinates}"] = c.astype(np.float32)
        if name != "ngon":
            result[f"{name}.layouts"] = batch.astype(np.float32)
        result |= _bounds(name, batch[:BOUNDED], pose, settings["noise_px"], rng)
    return result


def _bounds(name: str, layouts: Array, pose: PoseDistribution, noise_px: float, rng: np.random.Generator) -> Kept:
    exact = PAPER_CAMERA.project(layouts, pose.rotation, pose.translation)[:, 0]
    noisy = exact + noise_px * rng.standard_normal(exact.shape)
    result: Kept = {}
    for coordinates in COORDINATES:
        upper, lower = bound_ratios(coordinates, layouts, exact, noisy, pose, PAPER_CAMERA)
        result[f"{name}.upper.{coordinates}"] = upper.astype(np.float32)
        result[f"{name}.lower.{coordinates}"] = lower.astype(np.float32)
    return result


def _rng(cell: Cell, pose: int) -> np.random.Generator:
    """Random generator of a pose, independent of the other poses of its cell."""
    return np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(pose,)))


def _polygons(n: int, count: int) -> Array:
    """Copies (count, n, 2) of the regular polygon; the paper's square has its corners at 45 degrees."""
    ngon = regular_polygon(n, BOUNDARY.radius) @ _turn(np.pi / 4 if n == 4 else 0.0)
    return np.broadcast_to(ngon, (count, n, 2))


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
    settings = cell.settings
    poses = poses_of(settings["poses"])
    rows = [
        _one_pose_by_all(settings, poses.taken(np.array([i]), 0), _rng(cell, index))
        for i, index in enumerate(settings["poses"])
    ]
    return {key: np.stack([row[key] for row in rows]) for key in rows[0]}


def _one_pose_by_all(settings: Mapping[str, Any], pose: PoseDistribution, rng: np.random.Generator) -> Kept:
    n, starts = settings["n"], settings["starts"]
    truth = (pose.rotation[0], pose.translation[0])
    ill = REGION.sample(starts, n, rng)
    layouts = {"ill": ill, "metric": descend(objective_for("metric", pose), REGION, ill).points}
    layouts["ngon"] = _polygons(n, starts)
    # One batch for all: Levenberg-Marquardt takes as many steps as its slowest trial.
    together = np.concatenate(list(layouts.values()))
    estimators: list[str | AnyEstimator] = [*FURTHER, FromTruth(*truth), FromPoor(*truth)]
    kept = layout_trials(together, pose, PAPER_CAMERA, settings["noise_px"], settings["runs"], rng, estimators)
    result: Kept = {"metric.layouts": layouts["metric"].astype(np.float32)}
    for i, name in enumerate(layouts):
        part = slice(i * starts, (i + 1) * starts)
        result |= {f"{name}.{key}": value[part] for key, value in kept.items()}
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
    poses = poses_of(settings["poses"])
    result: dict[str, list[Array]] = defaultdict(list)
    for i in range(len(poses)):
        objective = objective_for("metric", poses.taken(np.array([i]), 0))
        for name, region in (("disk", REGION), ("rectangle", RECTANGLE)):
            starts = region.sample(settings["starts"], settings["n"], rng)
            descents = descend(objective, region, starts)
            result[f"{name}.c"].append(descents.values)
            result[f"{name}.moved"].append(np.linalg.norm(descents.points - starts, axis=-1).mean(axis=-1))
    return {key: np.stack(rows) for key, rows in result.items()}


def settling(cell: Cell) -> Result:
    """Ends of descents by SuperSAB as published, after few and many steps, and by ours with its own stopping rule.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``seed``.

    Returns
    -------
    dict of arrays (P, B)
        c(A) in metric coordinates, by the names in `ROUTINES`.
    """
    settings = cell.settings
    rows: dict[str, list[Array]] = defaultdict(list)
    for i, index in enumerate(settings["poses"]):
        objective = objective_for("metric", poses_of(settings["poses"]).taken(np.array([i]), 0))
        starts = REGION.sample(settings["starts"], settings["n"], _rng(cell, index))
        for name, routine in ROUTINES.items():
            rows[name].append(routine(objective, starts=starts).values)
    return {name: np.stack(ends).astype(np.float32) for name, ends in rows.items()}


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
    begun = conditions("metric", starts[good], pose, camera)
    chosen = good[np.argsort(begun, kind="stable")[len(good) // 2]]
    layouts = np.stack([layout for _, layout in recorder.way(descents.points[chosen])])
    square = regular_polygon(POINTS, BOUNDARY.radius)[None] @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2)
    result: Result = {"layouts": layouts}
    for before, batch in (("", layouts), ("square.", square)):
        kept = layout_trials(batch, pose, camera, settings["noise_px"], settings["runs"], rng)
        result |= {before + key: value for key, value in kept.items()}
        result |= {f"{before}c.{name}": conditions(name, batch, pose, camera) for name in COORDINATES}
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
    rows = [_shares(settings, poses.taken(np.array([i]), 0), rng) for i in range(len(poses))]
    return {key: np.stack([row[key] for row in rows]) for key in rows[0]}


def _shares(settings: Mapping[str, Any], pose: PoseDistribution, rng: np.random.Generator) -> dict[str, Array]:
    objective = objective_for(settings["coordinates"], pose)
    setting: Setting = objective.setting
    measures = {
        "c": objective,
        "homography_px": OBJECTIVES["homography"](setting),
        "rotation_deg": OBJECTIVES["rotation"](setting),
    }
    recorder = Recorder()
    descents = descend(objective, REGION, REGION.sample(settings["starts"], settings["n"], rng), record=recorder)
    shares: dict[str, list[float]] = {key: [] for key in ("steps", *GAINED)}
    for points in descents.points:
        way = np.stack([layout for _, layout in recorder.way(points)])
        shares["steps"].append(len(way) - 1)
        taken = round(FIRST_STEPS * (len(way) - 1))
        for key, measure in measures.items():
            first, then, last = np.log(measure(way[[0, taken, -1]]))
            gained = np.isfinite([first, then, last]).all() and first > last
            shares[key].append((first - then) / (first - last) if gained else np.nan)
    return {key: np.array(values) for key, values in shares.items()}


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
    rows = [
        layout_trials(
            layouts,
            poses.taken(np.array([i]), 0),
            PAPER_CAMERA,
            settings["noise_px"],
            settings["runs"],
            rng,
            estimators,
        )
        for i in range(len(poses))
    ]
    table = criteria(layouts, Setting(BOUNDARY, PAPER_CAMERA, poses))
    return {
        "layouts": layouts,
        **{key: np.stack([row[key] for row in rows]) for key in rows[0]},
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
        # autograd takes ten times as long as closed forms, and the optimum is degenerate for any set of poses.
        poses = fewer(poses)
        if restarts and restarts <= FEW_RESTARTS:
            # A quick look does not find how degenerate it is.
            return descend(objective_for(name, poses), REGION, REGION.sample(1, n, rng)).points
    if name not in RELIEFS:
        return search(objective_for(name, poses), REGION, n, rng, restarts or RESTARTS).points[None]
    # Bare points stand on pillars of zero width, which hide nothing.
    room = ReliefRoom(REGION, RELIEFS[name], eyes_of(poses))
    flat = regular_polygon(n, BOUNDARY.radius)
    rough = objective_for("pose", fewer(poses))
    return search_relief(objective_for("pose", poses), room, flat, rng, restarts or RELIEF_STARTS, rough=rough).points[
        None
    ]


ROUTINES: dict[str, Callable[..., Descent]] = {
    **{f"as published, {steps} steps": partial(supersab, region=REGION, steps=steps) for steps in (150, 700)},
    "ours, until it gains nothing": partial(descend, region=REGION),
}
"""Descents and their stopping rules."""

_WORK: dict[str, Callable[[Cell], Result]] = {
    CONDITIONED: conditioned,
    DESCENT: descent,
    EARLY: early,
    JOINT: joint,
    METHODS: methods,
    LIMITS: limits,
    SETTLING: settling,
}
