"""Noisy trials of many layouts under one pose, all in one batch, and what is kept of them."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.estimators.base import turned
from markergen.maths.information import flip_separation
from markergen.maths.projection import project, to_camera
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.objectives.homography import validation_grid
from markergen.objectives.pose import PoseObjective
from markergen.studies.paper.options import BOUNDARY
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    flipped,
    homography_error_px2,
    rotation_error_deg,
    translation_error_pct,
)
from markergen.validation.trials import LEAST_DEPTH

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kept = dict[str, NDArray[np.float32]]
"""By estimator, measure and statistic, as in ``lm.rotation_deg.mean``: arrays (B,), one value for each layout."""

ESTIMATORS_FLAT = ("dlt", "epnp", "ippe", "lm")
ESTIMATORS_RELIEF = ("epnp", "sqpnp", "lm")

MEASURES = {"he_px2": ("dlt",), "rotation_deg": ("epnp", "ippe", "lm"), "translation_pct": ("epnp", "ippe", "lm")}
"""The measures of the paper, and the estimators that each is measured of."""

BLOCK = 4000
"""Trials that are solved at once: bounds the memory, and stays within the processor's cache."""


def layout_trials(
    layouts: Array,
    pose: PoseDistribution,
    camera: Camera,
    noise_px: float,
    runs: int,
    rng: np.random.Generator,
    estimators: Sequence[str] = ESTIMATORS_FLAT,
) -> Kept:
    """Mean and standard deviation of every error over the noisy runs of each layout, failures left out and counted.

    Parameters
    ----------
    layouts : array (B, n, 2 or 3), m
    pose : PoseDistribution
        Of one pose.
    noise_px : float
        Standard deviation of the noise on every image coordinate.
    runs : int
        Noisy runs of each layout.

    Returns
    -------
    dict of arrays (B,)
        ``dlt.he_px2.mean``, ``lm.rotation_deg.std``, ``lm.failed`` (share of the runs), ``lm.flipped`` and so on; nan
        where no run is left.
    """
    exact = camera.project(layouts, pose.rotation, pose.translation)[:, 0]
    covariance = PoseObjective(Setting(BOUNDARY, camera, pose)).covariance(layouts)
    with np.errstate(invalid="ignore"):
        can_flip = flip_separation(pose.rotation, pose.translation, covariance)[:, 0] > FLIP_SEPARATION * noise_px
    at_once = max(1, BLOCK // runs)
    parts = []
    for start in range(0, len(layouts), at_once):
        block = slice(start, start + at_once)
        images = exact[block, None] + noise_px * rng.standard_normal((len(exact[block]), runs, *exact.shape[1:]))
        own = np.repeat(layouts[block], runs, axis=0)
        batch = Correspondences(own, images.reshape(own.shape[0], *exact.shape[1:]), camera)
        flips = np.repeat(can_flip[block], runs)
        parts.append(
            {
                f"{name}.{key}": value
                for name in estimators
                for key, value in _summary(batch, name, pose, flips, runs).items()
            }
        )
    return {key: np.concatenate([part[key] for part in parts]).astype(np.float32) for key in parts[0]}


def stack(parts: Sequence[Kept], name: str) -> Kept:
    """Arrays (P, B) of `layout_trials` of P poses, under a name that comes before their own."""
    return {f"{name}.{key}": np.stack([part[key] for part in parts]) for key in parts[0]}


def _summary(batch: Correspondences, name: str, pose: PoseDistribution, can_flip: Mask, runs: int) -> dict[str, Array]:
    """What is kept of an estimator's trials: arrays (B,) from those (B * runs,) of the batch."""
    values: dict[str, Array] = {}
    if isinstance(estimator := ESTIMATORS[name], PoseEstimator):
        rotation, translation = batch.once(estimator).best
        te_pct = translation_error_pct(translation, pose.translation[0])
        depth = (turned(batch.xyz, rotation) + translation[:, None])[..., 2]
        # A comparison with nan is false, so what is not finite has failed as well.
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


def _validation(pose: PoseDistribution, camera: Camera) -> tuple[Array, Array]:
    """Validation points (m, 2) in m that the camera can see, and where it sees them, px."""
    grid = validation_grid(BOUNDARY.radius)
    depth = to_camera(grid, pose.rotation, pose.translation)[0, :, 2]
    grid = grid[depth > LEAST_DEPTH * pose.translation[0, 2]]
    return grid, project(grid, pose.rotation, pose.translation, camera.matrix)[0]


def _moments(values: Array, kept: Mask) -> Iterator[tuple[str, Array]]:
    """Mean and standard deviation of the kept values of each row (B, runs); nan where there are none."""
    count = kept.sum(axis=1)
    values = np.where(kept, values, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = values.sum(axis=1) / count
        yield "mean", mean
        yield "std", np.sqrt(np.where(kept, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / count)
