"""Ill- against well-conditioned layouts: random ones, and what descents make of them, pose by pose."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.supersab import descend
from markergen.studies.cells import Cell, Result
from markergen.studies.paper.coordinates import bound_ratios, conditions
from markergen.studies.paper.options import BOUNDARY, COORDINATES, REGION, objective_for, poses_of
from markergen.studies.paper.trials import Kept, layout_trials

Array = NDArray[np.float64]

KIND = "conditioned"

BOUNDED = 10
"""Layouts of each pose on which the bounds of the relative error are tried, once each."""


def conditioned(cell: Cell) -> Result:
    """Random and optimized layouts of n points under each pose of a cell.

    Settings: ``n``, ``poses`` (indices), ``starts``, ``runs``, ``noise_px``, ``optimized`` (by the name of an
    objective, how many of the starts it descends from), ``seed``.

    Returns
    -------
    dict of arrays (P, B), by set and what it tells
        Sets are ``ill`` (the random starts), the names of ``optimized``, and ``ngon``, the regular polygon on the rim.
        ``ill.c.unit`` is c(A) in unit coordinates, ``ill.lm.rotation_deg.mean`` and so on are those of
        `layout_trials`, ``metric.layouts`` (P, B, n, 2) the layouts in m, ``ill.upper.metric`` and ``.lower`` the
        ratios of `bound_ratios`.
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
    # The paper's square has its corners at 45 degrees; the polygon is tried as often as a fifth of the random layouts.
    ngon = regular_polygon(n, BOUNDARY.radius) @ _turn(np.pi / 4 if n == 4 else 0.0)
    layouts["ngon"] = np.broadcast_to(ngon, (max(2, starts // 5), n, 2))
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
    """Random numbers of a pose, of its own whichever other poses the cell has."""
    return np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(pose,)))


def _turn(angle: float) -> Array:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
