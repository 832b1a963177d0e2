"""Trials: noise on the image points of a pose, estimates from them, errors of the estimates."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import ESTIMATORS, AnyEstimator, Correspondences, PoseEstimator
from markergen.maths.projection import project, to_camera
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives.homography import validation_grid
from markergen.validation.bounds import PoseBounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    flipped,
    homography_error_px2,
    homography_failed,
    pose_failed,
    pose_nees,
    rotation_error_deg,
    translation_error_pct,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK = 4096
"""Trials that are solved at once: bounds the memory whatever the number of runs."""
NEES_OF = "lm"
"""The maximum-likelihood estimator, the one whose covariance the bound is."""
LEAST_DEPTH = 0.1
"""Validation points nearer to the camera's plane than this share of the marker's distance are left out of HE."""


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of one pose estimator, arrays (T,) for a pose or (P, T) for all: RE, TE, and what went wrong.

    `nearest_deg` is the RE of the solution that is nearest to the truth, whichever the estimator prefers: what a second
    look, such as another image, could make of it. NEES is nan where it is not defined: a failure or a flip, no noise,
    or another estimator than LM.
    """

    rotation_deg: Array
    nearest_deg: Array
    translation_pct: Array
    nees: Array
    failed: Mask
    flipped: Mask


@dataclass(frozen=True, eq=False)
class HomographyErrors:
    """Errors of one homography estimator, arrays (T,) for a pose or (P, T) for all: HE in ideal px^2, and failures.

    A homography knows no lens: it maps to the image of a camera without distortion.
    """

    he_px2: Array
    failed: Mask


Errors = PoseErrors | HomographyErrors


@dataclass(frozen=True, eq=False)
class Experiment:
    """Everything that decides the trials; each pose has its own random numbers, whoever computes it and when.

    Attributes
    ----------
    points : array (n, 3), m
    radius : float
        Of the marker, m; the validation grid goes by it.
    camera : Camera
    poses : PoseDistribution
    bounds : PoseBounds
    noise_px : float
    runs : int
        Trials per pose.
    seed : int
    estimators : tuple of str
    """

    points: Array
    radius: float
    camera: Camera
    poses: PoseDistribution
    bounds: PoseBounds
    noise_px: float
    runs: int
    seed: int
    estimators: tuple[str, ...]


def run_trials(experiment: Experiment, indices: Iterable[int]) -> list[dict[str, Errors]]:
    """Errors of every estimator, arrays (runs,), for each of the poses with these indices."""
    return [_run_pose(experiment, index) for index in indices]


def noisy_images(experiment: Experiment, index: int) -> Iterable[Array]:
    """Blocks (T, n, 2) of the image points of a pose with noise, `runs` in total; the same for the same seed.

    Their px are those of the image as taken, through the lens.
    """
    rng = np.random.default_rng(np.random.SeedSequence(experiment.seed, spawn_key=(index,)))
    rotation, translation = experiment.poses.rotation[[index]], experiment.poses.translation[[index]]
    exact = experiment.camera.project(experiment.points, rotation, translation)
    for start in range(0, experiment.runs, BLOCK):
        count = min(BLOCK, experiment.runs - start)
        yield exact + experiment.noise_px * rng.standard_normal((count, *exact.shape[1:]))


def join(parts: list[dict[str, Errors]], stack: bool) -> dict[str, Errors]:
    """Join errors by estimator: stacked along a new first axis, or one after the other."""
    together = np.stack if stack else np.concatenate
    return {
        name: type(first)(**{key: together([vars(part[name])[key] for part in parts]) for key in vars(first)})
        for name, first in parts[0].items()
    }


def _run_pose(experiment: Experiment, index: int) -> dict[str, Errors]:
    blocks = []
    for images in noisy_images(experiment, index):
        batch = Correspondences.from_distorted(experiment.points, images, experiment.camera)
        blocks.append({name: _errors(experiment, index, batch, ESTIMATORS[name]) for name in experiment.estimators})
    return join(blocks, stack=False)


def _errors(experiment: Experiment, index: int, batch: Correspondences, estimator: AnyEstimator) -> Errors:
    rotation, translation = experiment.poses.rotation[index], experiment.poses.translation[index]
    if not isinstance(estimator, PoseEstimator):
        homography = batch.once(estimator)
        grid = validation_grid(experiment.radius)
        depth = to_camera(grid, rotation[None], translation[None])[0, :, 2]
        grid = grid[depth > LEAST_DEPTH * translation[2]]
        pixels = project(grid, rotation[None], translation[None], experiment.camera.matrix)[0]
        he_px2 = homography_error_px2(homography, grid, pixels)
        return HomographyErrors(he_px2, homography_failed(batch.object_points[:, :2], homography, he_px2))
    found = batch.once(estimator)
    estimates = found.best
    te_pct = translation_error_pct(estimates[1], translation)
    failed = pose_failed(batch.object_points, *estimates, te_pct)
    can_flip = experiment.bounds.separation[index] > FLIP_SEPARATION
    flips = ~failed & flipped(estimates[0], rotation, translation) & can_flip
    nees = np.full(len(te_pct), np.nan)
    if estimator.name == NEES_OF and experiment.noise_px:
        kept = ~(failed | flips)
        information = experiment.bounds.information[index] / experiment.noise_px**2
        nees[kept] = pose_nees(estimates[0][kept], estimates[1][kept], rotation, translation, information)
    every_deg = rotation_error_deg(found.rotation, rotation)
    nearest_deg = np.fmin.reduce(every_deg, axis=1)
    return PoseErrors(every_deg[:, 0], nearest_deg, te_pct, nees, failed, flips)
