"""Measurements of layouts, each under one pose: errors of noisy trials, c(A), and the paper's bounds.

Layouts of several poses are measured in one batch.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import markergen as mg
from markergen.estimators import ESTIMATORS, AnyEstimator, Correspondences, PoseEstimator
from markergen.estimators.base import rotated
from markergen.maths.dlt import condition, normalization, relative_error_bounds
from markergen.maths.information import flip_separation
from markergen.maths.projection import from_pixels, project, to_camera
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.objectives.homography import validation_grid
from markergen.objectives.pose import PoseObjective
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    flipped,
    homography_error_px2,
    rotation_error_deg,
    translation_error_pct,
)
from markergen.validation.trials import LEAST_DEPTH
from markergen_paper.methods import FromTruth
from markergen_paper.options import BOUNDARY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kept = dict[str, NDArray[np.float32]]
"""By estimator, measure and statistic, as in ``lm.rotation_deg.mean``: arrays (P, B), one value for each layout."""

ESTIMATORS_FLAT = ("dlt", "epnp", "ippe", "lm")
ESTIMATORS_RELIEF = ("epnp", "sqpnp", "lm")

MEASURES = {"he_px2": ("dlt",), "rotation_deg": ("epnp", "ippe", "lm"), "translation_pct": ("epnp", "ippe", "lm")}
"""The paper's measures, and the estimators evaluated by each."""

BLOCK = 4000
"""Number of trials solved at once: limits the memory, and fits in the processor's cache."""


def layout_trials(
    layouts: Array,
    poses: PoseDistribution,
    camera: mg.Camera,
    noise_px: float,
    runs: int,
    rngs: Sequence[np.random.Generator],
    estimators: Sequence[str | AnyEstimator | type[FromTruth]] = ESTIMATORS_FLAT,
) -> Kept:
    """Mean and standard deviation of every error over the noisy runs of each layout; failures are only counted.

    Parameters
    ----------
    layouts : array (P, B, n, 2 or 3), m
        B layouts for each of P poses.
    noise_px : float
        Standard deviation of the noise on every image coordinate.
    runs : int
        Noisy runs of each layout.
    rngs : sequence of P generators
        They draw the noise, pose by pose.
    estimators : sequence of str, estimator or class
        Names in the table of estimators, or others; a class is an estimator that starts at the true pose.

    Returns
    -------
    dict of arrays (P, B)
        ``dlt.he_px2.mean``, ``lm.rotation_deg.std``, ``lm.failed`` (share of the runs), ``lm.flipped`` and so on; nan
        if no run succeeded.
    """
    exact, can_flip = images_of(layouts, poses, camera), _can_flip(layouts, poses, camera, noise_px)
    noise = np.stack([rng.standard_normal((layouts.shape[1], runs, *exact.shape[2:])) for rng in rngs])
    kept: Kept = defaultdict(lambda: np.empty(layouts.shape[:2], dtype=np.float32))
    for block in _blocks(len(layouts), layouts.shape[1], runs):
        truth = poses.taken(np.arange(len(poses))[block[0]], 0)
        images = exact[block][:, :, None] + noise_px * noise[block]
        repeated = np.repeat(layouts[block].reshape(-1, *layouts.shape[2:]), runs, axis=0)
        batch = Correspondences(repeated, images.reshape(len(repeated), *exact.shape[2:]), camera)
        flips = np.repeat(can_flip[block], runs)
        for solver in (_solver(estimator, truth) for estimator in estimators):
            for key, value in _summary(batch, solver, truth, flips, runs).items():
                kept[f"{solver.name}.{key}"][block] = value.reshape(layouts[block].shape[:2])
    return dict(kept)


def _blocks(poses: int, layouts: int, runs: int) -> list[tuple[slice, slice]]:
    """Poses and layouts of at most `BLOCK` trials each: whole poses where they fit."""
    at_once = max(1, BLOCK // runs)
    if layouts <= at_once:
        together = at_once // layouts
        return [(slice(pose, pose + together), slice(None)) for pose in range(0, poses, together)]
    starts = range(0, layouts, at_once)
    return [(slice(pose, pose + 1), slice(start, start + at_once)) for pose in range(poses) for start in starts]


def _solver(estimator: str | AnyEstimator | type[FromTruth], truth: PoseDistribution) -> AnyEstimator:
    if isinstance(estimator, str):
        return ESTIMATORS[estimator]
    return estimator(truth.rotation, truth.translation) if isinstance(estimator, type) else estimator


def _can_flip(layouts: Array, poses: PoseDistribution, camera: mg.Camera, noise_px: float) -> Mask:
    """Layouts (P, B) with which an estimate nearer to the mirrored pose counts as a flip."""
    separations = []
    for layout, pose in zip(layouts, one_by_one(poses), strict=True):
        covariance = PoseObjective(Setting(BOUNDARY, camera, pose)).covariance(layout)
        with np.errstate(invalid="ignore"):
            separations.append(flip_separation(pose.rotation, pose.translation, covariance)[:, 0])
    return np.stack(separations) > FLIP_SEPARATION * noise_px


def one_by_one(poses: PoseDistribution) -> Iterator[PoseDistribution]:
    """Distributions of one pose each."""
    return (poses.taken(np.array([index]), 0) for index in range(len(poses)))


def images_of(layouts: Array, poses: PoseDistribution, camera: mg.Camera) -> Array:
    """Images (P, B, n, 2) in px of layouts (P, B, n, 2 or 3) in m, the B of each pose under that pose alone."""
    views = zip(layouts, poses.rotation[:, None], poses.translation[:, None], strict=True)
    return np.stack([camera.project(*view)[:, 0] for view in views])


def written(coordinates: str, points: Array, pixels: Array, poses: PoseDistribution, camera: mg.Camera) -> list[Array]:
    """Object points and one or more sets of image points (P, B, n, 2) in some coordinates (see `ConditionObjective`).

    Parameters
    ----------
    points : array (P, B, n, 2), m
    pixels : array (k, P, B, n, 2), px
        The first set is exact: ``hartley`` normalizes all sets by it, because two matrices are comparable only in the
        same coordinates.

    Returns
    -------
    list of arrays (P, B, n, 2)
        Object points, then the k sets of image points.
    """
    if coordinates == "pixel":
        return [points, *pixels]
    normalized = from_pixels(pixels, camera.matrix)
    if coordinates == "metric":
        return [points, *normalized]
    if coordinates == "unit":
        lateral, depth = np.split(poses.translation[:, None, None], [2], axis=-1)
        return [points / BOUNDARY.radius, *((normalized - lateral / depth) * depth / BOUNDARY.radius)]
    center, scale = normalization(points)
    image_center, image_scale = normalization(normalized[0])
    return [(points - center) * scale, *((normalized - image_center) * image_scale)]


def conditions(coordinates: str, points: Array, poses: PoseDistribution, camera: mg.Camera) -> Array:
    """c(A), shape (P, B), of layouts (P, B, n, 2), the B of each pose under that pose alone; inf if it is undefined."""
    objects, images = written(coordinates, points, images_of(points, poses, camera)[None], poses, camera)
    return condition(objects, images)


def bound_ratios(
    coordinates: str, points: Array, exact: Array, noisy: Array, poses: PoseDistribution, camera: mg.Camera
) -> tuple[Array, Array]:
    """Relative error of the DLT's h (P, B) over the paper's upper bound, and the paper's lower bound over that error.

    See `relative_error_bounds`; a ratio above 1 violates a bound.

    Parameters
    ----------
    points : array (P, B, n, 2), m
    exact, noisy : arrays (P, B, n, 2), px
    """
    objects, clean, noised = written(coordinates, points, np.stack([exact, noisy]), poses, camera)
    error, lower, upper = relative_error_bounds(objects, clean, noised)
    return error / upper, lower / error


def _summary(
    batch: Correspondences, estimator: AnyEstimator, poses: PoseDistribution, can_flip: Mask, runs: int
) -> dict[str, Array]:
    """Statistics of an estimator's trials: arrays (B,) from those (B * runs,) of the batch, as many of each pose."""
    trials = len(batch.image_points) // len(poses)
    values: dict[str, Array] = {}
    if isinstance(estimator, PoseEstimator):
        rotation, translation = batch.once(estimator).best
        true_rotation, true_translation = (
            np.repeat(truth, trials, axis=0) for truth in (poses.rotation, poses.translation)
        )
        te_pct = translation_error_pct(translation, true_translation)
        depth = (rotated(batch.xyz, rotation) + translation[:, None])[..., 2]
        # Comparisons with nan are false, so non-finite estimates also count as failed.
        kept = np.all(depth > 0, axis=-1) & (te_pct <= 100)
        flips = kept & can_flip & flipped(rotation, true_rotation, true_translation)
        values["flipped"] = flips.reshape(-1, runs).mean(axis=1)
        errors = {"rotation_deg": rotation_error_deg(rotation, true_rotation), "translation_pct": te_pct}
    else:
        homography = batch.once(estimator)
        parts = zip(np.split(homography, len(poses)), one_by_one(poses), strict=True)
        he_px2 = np.concatenate([homography_error_px2(part, *_validation(pose, batch.camera)) for part, pose in parts])
        depth = np.einsum("tni,ti->tn", batch.xyz[..., :2], homography[:, 2, :2]) + 1
        kept = np.isfinite(he_px2) & np.all(depth > 0, axis=-1)
        errors = {"he_px2": he_px2}
    values["failed"] = 1 - kept.reshape(-1, runs).mean(axis=1)
    for key, error in errors.items():
        for statistic, value in _moments(error.reshape(-1, runs), kept.reshape(-1, runs)):
            values[f"{key}.{statistic}"] = value
    return values


def _validation(pose: PoseDistribution, camera: mg.Camera) -> tuple[Array, Array]:
    """Validation points (m, 2) in m visible to the camera, and their images, px."""
    grid = validation_grid(BOUNDARY.radius)
    depth = to_camera(grid, pose.rotation, pose.translation)[0, :, 2]
    grid = grid[depth > LEAST_DEPTH * pose.translation[0, 2]]
    return grid, project(grid, pose.rotation, pose.translation, camera.matrix)[0]


def _moments(values: Array, kept: Mask) -> Iterator[tuple[str, Array]]:
    """Mean and standard deviation of the kept values of each row (B, runs); nan if there are none."""
    count = kept.sum(axis=1)
    values = np.where(kept, values, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = values.sum(axis=1) / count
        yield "mean", mean
        yield "std", np.sqrt(np.where(kept, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / count)
