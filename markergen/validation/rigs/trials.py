"""Noisy trials of a rig: its pose from the noisy image points of all dots in view, and from those of one plate."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.maths.information import covariance, flip_separation
from markergen.model.poses import PoseDistribution
from markergen.pool import chunks_of, map_counted, workers_for
from markergen.validation.bounds import PoseBounds, pose_bounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    efficiency,
    flipped,
    pose_failed,
    pose_nees,
    rms,
    rotation_error_deg,
    statistics,
    translation_error_pct,
)
from markergen.validation.rigs.bounds import Visibility
from markergen.validation.trials import NEES_OF, POSES_AT_ONCE, WORTH_A_WORKER, check_trials

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RigErrors:
    """Errors of the estimates, arrays (P, T), and their bounds (P,); see `PoseErrors` and `PoseBounds`."""

    rotation_deg: Array
    translation_pct: Array
    nees: Array
    failed: Mask
    flipped: Mask
    bound_deg: Array
    bound_pct: Array

    def summary(self, poses: Mask) -> dict[str, Any]:
        """Return statistics over some poses, and their bounds, as plain values."""
        failed, flips = self.failed[poses], self.flipped[poses]
        rotation_deg, nees = self.rotation_deg[poses], self.nees[poses]
        bound = {"rotation_deg": rms(self.bound_deg[poses]), "translation_pct": rms(self.bound_pct[poses])}
        if not failed.size:
            return {"poses": int(poses.sum()), "bound": bound}
        return {
            "poses": int(poses.sum()),
            "bound": bound,
            "rotation_deg": statistics(rotation_deg[~failed]),
            "translation_pct": statistics(self.translation_pct[poses][~failed]),
            "flip_rate": np.mean(flips),
            "failure_rate": np.mean(failed),
            "efficiency": efficiency(rotation_deg, ~(failed | flips), self.bound_deg[poses]),
            "nees": float(np.nanmean(nees)) if np.isfinite(nees).any() else None,
        }


@dataclass(frozen=True, eq=False)
class _Trials:
    shown: Visibility
    noise_px: float
    runs: int
    seed: int


def run_trials(
    shown: Visibility,
    noise_px: float,
    runs: int,
    seed: int,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, RigErrors]:
    """Estimate the pose of a rig by LM from noisy image points, at every pose that shows enough dots of a plate.

    Returns
    -------
    dict
        ``joint``: from all dots in view; ``alone``: from those of the plate with the least bound. Where a pose
        shows too few dots, errors are nan and bounds infinite.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    check_trials(noise_px, runs, seed)
    poses = len(shown.series.poses)
    workers = workers_for(workers, 1 + poses * runs // WORTH_A_WORKER)
    work = partial(_chunk, _Trials(shown, noise_px, runs, seed))
    parts = [each for part in map_counted(work, chunks_of(poses, POSES_AT_ONCE), workers, progress) for each in part]
    return {
        name: RigErrors(*(np.stack([getattr(part[name], each.name) for part in parts]) for each in fields(RigErrors)))
        for name in ("joint", "alone")
    }


def _chunk(trials: _Trials, indices: Iterable[int]) -> list[dict[str, RigErrors]]:
    return [_at(trials, pose) for pose in indices]


def _at(trials: _Trials, pose: int) -> dict[str, RigErrors]:
    shown, series = trials.shown, trials.shown.series
    if not shown.served[pose]:
        none, false = np.full(trials.runs, np.nan), np.zeros(trials.runs, dtype=bool)
        nothing = RigErrors(none, none, none, false, false, np.array(np.inf), np.array(np.inf))
        return {"joint": nothing, "alone": nothing}
    here = PoseDistribution("here", series.poses.rotation[[pose]], series.poses.translation[[pose]])
    rng = np.random.default_rng(np.random.SeedSequence(trials.seed, spawn_key=(pose,)))
    exact = series.camera.project(series.rig.xyz, here.rotation, here.translation)[0]
    images = exact + trials.noise_px * rng.standard_normal((trials.runs, *exact.shape))
    bounds = {
        k: pose_bounds(series.rig.xyz[shown.dots(pose, k)], series.camera, here, trials.noise_px)
        for k in (None, *shown.enough(pose))
    }
    best = min(shown.enough(pose), key=lambda k: float(bounds[k].rotation_deg[0]))
    most = int(shown.of_plates[pose].argmax())
    return {
        "joint": _errors(trials, here, images, shown.dots(pose), most, bounds[None]),
        "alone": _errors(trials, here, images, shown.dots(pose, best), best, bounds[best]),
    }


def _errors(
    trials: _Trials, here: PoseDistribution, images: Array, dots: Indices, plate: int, bounds: PoseBounds
) -> RigErrors:
    """Errors of the estimates from some dots, in the frame of a plate: flips are those of its mirrored pose."""
    rig, camera = trials.shown.series.rig, trials.shown.series.camera
    each = rig.markers[plate]
    turn, shift = (part[0] for part in each.camera_pose(here.rotation, here.translation))
    points = each.to_marker(rig.xyz[dots])
    if np.abs(points[:, 2]).max() < 1e-9 * rig.radius:
        points[:, 2] = 0.0
    if not len(images):
        none, false = np.zeros(0), np.zeros(0, dtype=bool)
        return RigErrors(none, none, none, false, false, bounds.rotation_deg[0], bounds.translation_pct[0])
    estimator = ESTIMATORS[NEES_OF]
    assert isinstance(estimator, PoseEstimator)
    rotation, place = Correspondences.from_distorted(points, images[:, dots], camera).once(estimator).best
    found = rotation @ each.rotation_matrix.T
    moved = place - found @ each.translation_vector
    te_pct = translation_error_pct(moved, here.translation[0])
    failed = pose_failed(points, rotation, place, te_pct)
    apart = trials.noise_px * FLIP_SEPARATION < flip_separation(turn[None], shift[None], covariance(bounds.information))
    flips = ~failed & flipped(rotation, turn, shift) & apart
    nees = np.full(len(images), np.nan)
    kept = ~(failed | flips)
    if trials.noise_px:
        information = bounds.information[0] / trials.noise_px**2
        nees[kept] = pose_nees(found[kept], moved[kept], here.rotation[0], here.translation[0], information)
    return RigErrors(
        rotation_error_deg(found, here.rotation[0]), te_pct, nees, failed, flips,
        bounds.rotation_deg[0], bounds.translation_pct[0],
    )  # fmt: skip
