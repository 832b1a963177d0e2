"""Measurements of layouts under one pose: errors of noisy trials, c(A), and the paper's bounds.

All layouts of a pose are measured in one batch.
"""

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
from markergen_paper.options import BOUNDARY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kept = dict[str, NDArray[np.float32]]
"""By estimator, measure and statistic, as in ``lm.rotation_deg.mean``: arrays (B,), one value for each layout."""

ESTIMATORS_FLAT = ("dlt", "epnp", "ippe", "lm")
ESTIMATORS_RELIEF = ("epnp", "sqpnp", "lm")

MEASURES = {"he_px2": ("dlt",), "rotation_deg": ("epnp", "ippe", "lm"), "translation_pct": ("epnp", "ippe", "lm")}
"""The paper's measures, and the estimators evaluated by each."""

BLOCK = 4000
"""Number of trials solved at once: limits the memory, and fits in the processor's cache."""


def layout_trials(
    layouts: Array,
    pose: PoseDistribution,
    camera: mg.Camera,
    noise_px: float,
    runs: int,
    rng: np.random.Generator,
    estimators: Sequence[str | AnyEstimator] = ESTIMATORS_FLAT,
) -> Kept:
    """Mean and standard deviation of every error over the noisy runs of each layout; failures are only counted.

    Parameters
    ----------
    layouts : array (B, n, 2 or 3), m
    pose : PoseDistribution
        A single pose.
    noise_px : float
        Standard deviation of the noise on every image coordinate.
    runs : int
        Noisy runs of each layout.
    estimators : sequence of str or estimator
        Names in the table of estimators, or others.

    Returns
    -------
    dict of arrays (B,)
        ``dlt.he_px2.mean``, ``lm.rotation_deg.std``, ``lm.failed`` (share of the runs), ``lm.flipped`` and so on; nan
        if no run succeeded.
    """
    solvers = [ESTIMATORS[name] if isinstance(name, str) else name for name in estimators]
    exact = camera.project(layouts, pose.rotation, pose.translation)[:, 0]
    covariance = PoseObjective(Setting(BOUNDARY, camera, pose)).covariance(layouts)
    with np.errstate(invalid="ignore"):
        can_flip = flip_separation(pose.rotation, pose.translation, covariance)[:, 0] > FLIP_SEPARATION * noise_px
    at_once = max(1, BLOCK // runs)
    parts = []
    for start in range(0, len(layouts), at_once):
        block = slice(start, start + at_once)
        images = exact[block, None] + noise_px * rng.standard_normal((len(exact[block]), runs, *exact.shape[1:]))
        repeated = np.repeat(layouts[block], runs, axis=0)
        batch = Correspondences(repeated, images.reshape(repeated.shape[0], *exact.shape[1:]), camera)
        flips = np.repeat(can_flip[block], runs)
        parts.append(
            {
                f"{solver.name}.{key}": value
                for solver in solvers
                for key, value in _summary(batch, solver, pose, flips, runs).items()
            }
        )
    return {key: np.concatenate([part[key] for part in parts]).astype(np.float32) for key in parts[0]}


def stack(parts: Sequence[Kept], name: str) -> Kept:
    """Stack results of `layout_trials` for P poses to arrays (P, B), with a prefix to their names."""
    return {f"{name}.{key}": np.stack([part[key] for part in parts]) for key in parts[0]}


def written(coordinates: str, points: Array, pixels: Array, pose: PoseDistribution, camera: mg.Camera) -> list[Array]:
    """Object points and one or more sets of image points (B, n, 2) in some coordinates (see `ConditionObjective`).

    Parameters
    ----------
    points : array (B, n, 2), m
    pixels : array (k, B, n, 2), px
        The first set is exact: ``hartley`` normalizes all sets by it, because two matrices are comparable only in the
        same coordinates.
    pose : PoseDistribution
        A single pose.

    Returns
    -------
    list of arrays (B, n, 2)
        Object points, then the k sets of image points.
    """
    if coordinates == "pixel":
        return [points, *pixels]
    normalized = from_pixels(pixels, camera.matrix)
    if coordinates == "metric":
        return [points, *normalized]
    if coordinates == "unit":
        x, y, z = pose.translation[0]
        return [points / BOUNDARY.radius, *((normalized - np.array([x, y]) / z) * z / BOUNDARY.radius)]
    center, scale = normalization(points)
    image_center, image_scale = normalization(normalized[0])
    return [(points - center) * scale, *((normalized - image_center) * image_scale)]


def conditions(coordinates: str, points: Array, pose: PoseDistribution, camera: mg.Camera) -> Array:
    """c(A), shape (B,), of layouts (B, n, 2) under one pose; inf if it is undefined."""
    pixels = camera.project(points, pose.rotation, pose.translation)[:, 0]
    objects, images = written(coordinates, points, pixels[None], pose, camera)
    return condition(objects, images)


def bound_ratios(
    coordinates: str, points: Array, exact: Array, noisy: Array, pose: PoseDistribution, camera: mg.Camera
) -> tuple[Array, Array]:
    """Relative error of the DLT's h (B,) over the paper's upper bound, and the paper's lower bound over that error.

    See `relative_error_bounds`; a ratio above 1 violates a bound.

    Parameters
    ----------
    points : array (B, n, 2), m
    exact, noisy : arrays (B, n, 2), px
    """
    objects, clean, noised = written(coordinates, points, np.stack([exact, noisy]), pose, camera)
    error, lower, upper = relative_error_bounds(objects, clean, noised)
    return error / upper, lower / error


def _summary(
    batch: Correspondences, estimator: AnyEstimator, pose: PoseDistribution, can_flip: Mask, runs: int
) -> dict[str, Array]:
    """Statistics of an estimator's trials: arrays (B,) from those (B * runs,) of the batch."""
    values: dict[str, Array] = {}
    if isinstance(estimator, PoseEstimator):
        rotation, translation = batch.once(estimator).best
        te_pct = translation_error_pct(translation, pose.translation[0])
        depth = (rotated(batch.xyz, rotation) + translation[:, None])[..., 2]
        # Comparisons with nan are false, so non-finite estimates also count as failed.
        kept = np.all(depth > 0, axis=-1) & (te_pct <= 100)
        flips = kept & can_flip & flipped(rotation, pose.rotation[0], pose.translation[0])
        values["flipped"] = flips.reshape(-1, runs).mean(axis=1)
        errors = {"rotation_deg": rotation_error_deg(rotation, pose.rotation[0]), "translation_pct": te_pct}
    else:
        homography = batch.once(estimator)
        he_px2 = homography_error_px2(homography, *_validation(pose, batch.camera))
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
