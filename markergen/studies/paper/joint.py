"""One layout for all poses, which is what a marker has: every objective, n-gon, random layouts, and relief."""

import numpy as np
from numpy.typing import NDArray

from markergen.model.camera import PAPER_CAMERA
from markergen.model.occlusion import eyes_of
from markergen.objectives import Setting
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.optimize.problem import fewer
from markergen.optimize.relief import ReliefRoom, search_relief
from markergen.optimize.search import search
from markergen.studies.cells import Cell, Result
from markergen.studies.paper.options import BOUNDARY, REGION, objective_for, poses_of
from markergen.studies.paper.trials import ESTIMATORS_FLAT, ESTIMATORS_RELIEF, layout_trials

Array = NDArray[np.float64]

KIND = "joint"

RESTARTS, RELIEF_STARTS, RANDOM = 8, 4, 25
"""Random starts of a search over all poses, in the plane and in space, and random layouts that stand beside it."""

RELIEFS = {"relief-20": 0.02, "relief-50": 0.05}
"""Heights in m that control points may have."""


def joint(cell: Cell) -> Result:
    """One kind of layout of n points, and its errors under every pose.

    Settings: ``layout`` (an objective's name, ``ngon``, ``random``, or a relief), ``n``, ``poses`` (indices), ``runs``,
    ``noise_px``, ``seed``.

    Returns
    -------
    dict of arrays
        ``layouts`` (B, n, 2 or 3) in m, ``lm.rotation_deg.mean`` and so on (P, B), and the criteria of
        `objectives.criteria` under their names, (B,), for noise of 1 px.
    """
    settings, rng = cell.settings, cell.rng
    poses = poses_of(settings["poses"])
    layouts = layouts_of(settings["layout"], settings["n"], settings["poses"], rng)
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


def layouts_of(name: str, n: int, indices: list[int], rng: np.random.Generator) -> Array:
    """Layouts (B, n, 2), or (1, n, 3) with relief, in m."""
    if name == "ngon":
        return regular_polygon(n, BOUNDARY.radius)[None]
    if name == "random":
        return REGION.sample(RANDOM, n, rng)
    poses = poses_of(indices)
    if name == "hartley":
        # autograd takes ten times as long as the closed forms, and the optimum is degenerate for any poses.
        poses = fewer(poses)
    if name not in RELIEFS:
        return search(objective_for(name, poses), REGION, n, rng, RESTARTS).points[None]
    # Bare points stand on pillars of no width, which hide nothing.
    room = ReliefRoom(REGION, RELIEFS[name], eyes_of(poses))
    flat = regular_polygon(n, BOUNDARY.radius)
    rough = objective_for("pose", fewer(poses))
    return search_relief(objective_for("pose", poses), room, flat, rng, RELIEF_STARTS, rough=rough).points[None]
