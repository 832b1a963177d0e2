"""The descent step by step: one in full with noisy runs, and how much is gained early in many."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.poses import PoseDistribution
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.supersab import descend
from markergen.optimize.trace import Recorder
from markergen.studies.cells import Cell, Result
from markergen.studies.paper.coordinates import conditions
from markergen.studies.paper.options import BOUNDARY, CAMERAS, COORDINATES, REGION, objective_for, poses_of
from markergen.studies.paper.trials import layout_trials

Array = NDArray[np.float64]

STEPS_KIND, EARLY_KIND = "descent", "early"

FRONTAL, POINTS = 0, 4
"""Pose of the paper's example, at 0.6 m, and its number of points."""

EARLY = 0.2
"""Share of a descent's steps that are its first ones."""

GAINED = ("c", "homography_px", "rotation_deg")
"""What a descent gains: c(A), and the errors that 1 px of noise causes to first order."""

STARTED_FROM, NEAR_BEST = 20, 0.02
"""Random starts, and how near to the best of their ends one has to end to be shown."""


def descent(cell: Cell) -> Result:
    """The fronto-parallel descent of four points, with noisy runs at each of its steps.

    Settings: ``camera`` (a name in `CAMERAS`), ``noise_px``, ``runs``, ``seed``.

    Returns
    -------
    dict of arrays, S steps
        ``layouts`` (S, 4, 2) in m, ``c.metric`` and so on (S,), ``lm.rotation_deg.mean`` and so on (S,), and with
        ``square.`` before them the same of the square on the rim, (1,).
    """
    settings = cell.settings
    pose, camera, rng = poses_of([FRONTAL]), CAMERAS[settings["camera"]], cell.rng
    recorder = Recorder()
    starts = REGION.sample(STARTED_FROM, POINTS, rng)
    found = descend(objective_for("metric", pose, camera), REGION, starts, record=recorder)
    # A start that ends in the best optimum, as the paper's does, and is neither near it nor degenerate.
    good = np.flatnonzero(found.values <= found.values.min() * (1 + NEAR_BEST))
    begun = conditions("metric", starts[good], pose, camera)
    chosen = good[np.argsort(begun, kind="stable")[len(good) // 2]]
    layouts = np.stack([layout for _, layout in recorder.way(found.points[chosen])])
    square = regular_polygon(POINTS, BOUNDARY.radius)[None] @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2)
    result: Result = {"layouts": layouts}
    for before, batch in (("", layouts), ("square.", square)):
        kept = layout_trials(batch, pose, camera, settings["noise_px"], settings["runs"], rng)
        result |= {before + key: value for key, value in kept.items()}
        result |= {f"{before}c.{name}": conditions(name, batch, pose, camera) for name in COORDINATES}
    return result


def early(cell: Cell) -> Result:
    """How much of what a descent gains it has gained in its first steps.

    Settings: ``coordinates``, ``n``, ``poses`` (indices), ``starts``, ``seed``.

    Returns
    -------
    dict of arrays (P, B)
        ``c``, ``homography_px`` and ``rotation_deg``: share of the fall of the logarithm that the first fifth of the
        steps brought, nan where the start determined nothing or nothing was gained; ``steps``: how many there were.
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
    found = descend(objective, REGION, REGION.sample(settings["starts"], settings["n"], rng), record=recorder)
    shares: dict[str, list[float]] = {key: [] for key in ("steps", *GAINED)}
    for points in found.points:
        way = np.stack([layout for _, layout in recorder.way(points)])
        shares["steps"].append(len(way) - 1)
        taken = round(EARLY * (len(way) - 1))
        for key, measure in measures.items():
            first, then, last = np.log(measure(way[[0, taken, -1]]))
            gained = np.isfinite([first, then, last]).all() and first > last
            shares[key].append((first - then) / (first - last) if gained else np.nan)
    return {key: np.array(values) for key, values in shares.items()}
