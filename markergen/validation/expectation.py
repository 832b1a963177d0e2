"""Errors to expect at each pose: from the first-order covariance where it is right, sampled elsewhere.

The first-order covariance is right as long as the image changes linearly over one standard deviation of the pose, and
as long as no other pose fits as well. At each pose three numbers tell whether it is:

- the curvature max_i |h(+i) + h(-i) - 2 h(0)| / |h(+i) - h(-i)|, where h(+-i) is the image from one standard deviation
  along principal axis i of the covariance to either side, and |.| weighs points as the estimate does (Bates & Watts'
  relative curvature);
- the probability Phi(-D/2) that noise makes the mirrored pose fit better, D^2 being chi2 of the mirrored pose that
  fits the exact image best;
- how much one standard deviation of the calibration, along each principal axis of its covariance, changes the effect
  of one standard deviation of the pose along its two largest axes, in standard deviations of the rotation: nothing, to
  first order. In a frontal pose fx too long beside fy looks like a tilt to one side, which lets other errors tilt the
  marker all the more.

Elsewhere print, image noise and calibration errors are drawn, and the pose is estimated as in `detect.pose`: the better
of two weighted descents, one of which begins at the mirrored pose.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.estimators.budget import PoseBudget, print_covariance
from markergen.estimators.weighted_pose import normalized_covariance, refine_weighted
from markergen.maths.conics import mirrored_poses, pose_rows
from markergen.maths.information import apply_pose_step, flip_separation, mirrored_rotation
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import angle_between
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import budget_of, counted_covariance
from markergen.validation.metrics import FLIP_SEPARATION, pose_failed
from markergen.validation.print_error import displacement
from markergen.validation.views import SyntheticViews

CURVED = 0.05
"""Curvature, and share of the standard deviation, from which poses are sampled; below, first order is right to 3 %."""
FLIPPING = 1e-4
"""Probability of a flip from which poses are sampled; rarer flips are added to the covariance."""
DISTINCT = 0.1
"""Minimum angle between a pose and its mirrored one in standard deviations; nearer ones are one minimum."""
MOST_DRAWS, LEAST_DRAWS = 500, 25
"""Number of estimates drawn at a pose; of 500, the RMS of a Gaussian error is uncertain by 3 %, of 25 by 14 %."""
DOTS, DRAWS = 500_000, 2_000_000
"""Maximum number of images of dots that are sampled, and of draws at all poses together."""
BLOCK = 4096
"""Number of estimates made at once, which bounds the memory."""
_STREAM = 1
"""Distinguishes the random numbers of a pose from those of its trials."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Errors to expect at P poses, and T draws of them at each.

    Attributes
    ----------
    first_order_deg, first_order_mm : arrays (P,)
        RMS errors by the covariance alone.
    rotation_deg, translation_mm : arrays (P,)
        RMS errors, with flips; inf where the pose is undetermined.
    flip_rate, failure_rate : arrays (P,)
        Shares of flips and of failures, which the RMS excludes; see `metrics`.
    sampled : array (P,) of bool
        Where the errors are those of the draws; elsewhere they follow from the covariance.
    drawn_deg, drawn_mm : arrays (P, T)
        Draws of the errors; nan for failures.
    """

    first_order_deg: Array
    first_order_mm: Array
    rotation_deg: Array
    translation_mm: Array
    flip_rate: Array
    failure_rate: Array
    sampled: Mask
    drawn_deg: Array
    drawn_mm: Array

    def as_dict(self) -> dict[str, Any]:
        """Return the values of every pose, without the draws."""
        return {key: value.tolist() for key, value in vars(self).items() if not key.startswith("drawn")}


@dataclass(frozen=True, eq=False)
class _Images:
    """What is drawn and weighed at P poses: exact normalized images, their covariances, and the budget of the pose."""

    series: SyntheticViews[Marker]
    budget: PoseBudget
    exact: Array
    image: Array
    root: Array
    moved: Array | None

    @property
    def points(self) -> Array:
        return self.series.marker.xyz

    def refined(self, poses: Any, seen: Array, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
        marker = self.series.marker
        bare = np.zeros(len(marker))
        errors = self.series.errors.of(marker)
        return refine_weighted(marker.xyz, bare, seen, self.image[poses], rotation, translation, errors)


def expect(
    series: SyntheticViews[Marker],
    bare_px: float = 0.0,
    seed: int = 0,
    sample: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Expectation:
    """Errors to expect at the poses of a series, for its optics, print and calibration.

    Parameters
    ----------
    bare_px : float
        Noise of bare points, which have no image, on every coordinate.
    seed : int
        The draws of a pose depend on it and the pose's number alone.
    sample : bool
        Sample all poses, not only those where first order is wrong.
    progress : callable or None
        Called with the number of sampled poses done and their total.
    """
    images = _images(series, bare_px)
    poses, total = series.poses, images.budget.total
    rotation_deg, translation = images.budget.rotation_deg["total"], images.budget.translation["total"]
    is_determined: Mask = np.asarray(np.isfinite(total).all(axis=(-2, -1)))
    chance, flip_deg, flip_mm = np.zeros(len(poses)), np.zeros(len(poses)), np.zeros(len(poses))
    chance[is_determined], flip_deg[is_determined], flip_mm[is_determined] = _flips(images, is_determined)
    chosen = is_determined.copy()
    if not sample:
        bent = np.maximum(_curvature(images, is_determined), _calibration_curvature(images, is_determined))
        chosen[is_determined] = (chance[is_determined] > FLIPPING) | (bent > CURVED)
    limit = min(DOTS // max(int(chosen.sum()) * len(series.marker), 1), DRAWS // len(poses))
    count = int(np.clip(limit, LEAST_DRAWS, MOST_DRAWS))
    expected = Expectation(
        rotation_deg,
        1e3 * translation,
        np.sqrt(rotation_deg**2 + chance * flip_deg**2),
        np.sqrt((1e3 * translation) ** 2 + chance * flip_mm**2),
        chance,
        np.zeros(len(poses)),
        chosen,
        np.full((len(poses), count), np.inf),
        np.full((len(poses), count), np.inf),
    )
    _draw_first_order(expected, images, np.flatnonzero(is_determined & ~chosen), seed, flip_deg, flip_mm)
    numbers = np.flatnonzero(chosen)
    at_once = max(1, BLOCK // count)
    for start in range(0, len(numbers), at_once):
        _draw_estimates(expected, images, numbers[start : start + at_once], seed)
        if progress:
            progress(min(start + at_once, len(numbers)), len(numbers))
    return expected


def _images(series: SyntheticViews[Marker], bare_px: float) -> _Images:
    marker, camera, poses = series.marker, series.camera, series.poses
    pixels = np.broadcast_to(counted_covariance(series, bare_px), (len(poses), len(marker), 2, 2))
    exact = perspective(to_camera(marker.xyz, poses.rotation, poses.translation))
    lens = np.linalg.inv(camera.pixel_jacobian(exact))
    values, vectors = np.linalg.eigh(pixels)
    root = lens @ (vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
    moved = None
    if series.errors.camera_covariance is not None:
        values, vectors = np.linalg.eigh(series.errors.camera_covariance)
        moved = lens @ camera.parameter_jacobian(exact) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return _Images(series, budget_of(series, bare_px), exact, normalized_covariance(exact, pixels, camera), root, moved)


def _flips(images: _Images, poses: Mask) -> tuple[Array, Array, Array]:
    """Probability of a flip, and the errors in degrees and mm of the mirrored pose that fits best."""
    rotation, translation = images.series.poses.rotation[poses], images.series.poses.translation[poses]
    start = mirrored_poses(images.points, rotation, translation)
    flipped, place, chi2 = images.refined(poses, images.exact[poses], *start)
    flip_deg = np.rad2deg(angle_between(flipped, rotation))
    apart = flip_deg > DISTINCT * images.budget.rotation_deg["total"][poses]
    from scipy.special import ndtr

    chance = np.where(np.isfinite(chi2) & apart, ndtr(-np.sqrt(np.maximum(chi2, 0.0)) / 2), 0.0)
    flip_mm = 1e3 * np.linalg.norm(place - translation, axis=-1)
    return chance, np.where(chance > 0, flip_deg, 0.0), np.where(chance > 0, flip_mm, 0.0)


def _curvature(images: _Images, poses: Mask) -> Array:
    """Largest curvature (P,) of the image over a standard deviation along the principal axes of the covariance."""
    rotation, translation = images.series.poses.rotation[poses], images.series.poses.translation[poses]
    exact, errors = images.exact[poses], images.series.errors.of(images.series.marker)
    spread = images.image[poses] + print_covariance(
        pose_rows(images.points, rotation, translation), images.points, rotation, errors
    )
    weight = np.linalg.inv(spread)
    steps = _steps(images, poses)

    def size(change: Array) -> Array:
        return np.asarray(np.sqrt(np.einsum("pni,pnij,pnj->p", change, weight, change)))

    def seen(step: Array) -> Array:
        return perspective(to_camera(images.points, *apply_pose_step(rotation, translation, step)))

    curvature = np.zeros(len(rotation))
    for i in range(6):
        there, back = seen(steps[:, :, i]), seen(-steps[:, :, i])
        linear = size(there - back)
        bent = size(there + back - 2 * exact)
        curvature = np.maximum(curvature, bent / np.maximum(linear, np.finfo(float).tiny))
    return curvature


def _calibration_curvature(images: _Images, poses: Mask) -> Array:
    """Largest rotation (P,), in standard deviations, that calibration and another error make only together."""
    rotation, translation = images.series.poses.rotation[poses], images.series.poses.translation[poses]
    largest = np.zeros(len(rotation))
    if images.moved is None:
        return largest
    steps, exact = _steps(images, poses), images.exact[poses]
    sides = [side * column for column in np.moveaxis(images.moved[poses], -1, 0) for side in (1, -1)]
    alone = [images.refined(poses, exact + moved, rotation, translation)[0] @ rotation.mT for moved in sides]
    for i in (4, 5):
        there = apply_pose_step(rotation, translation, steps[:, :, i])
        seen = perspective(to_camera(images.points, *there))
        for moved, without in zip(sides, alone, strict=True):
            together = images.refined(poses, seen + moved, *there)[0] @ there[0].mT
            largest = np.maximum(largest, angle_between(together, without))
    return np.asarray(np.rad2deg(largest) / images.budget.rotation_deg["total"][poses])


def _steps(images: _Images, poses: Mask) -> Array:
    """Standard deviations (P, 6, 6) of the pose along the principal axes of its covariance, in columns, rising.

    Distances count as fractions of that to the marker.
    """
    scale = np.ones((int(poses.sum()), 6))
    scale[:, 3:] = images.series.poses.distance[poses, None]
    values, vectors = np.linalg.eigh(images.budget.total[poses] / scale[:, :, None] / scale[:, None, :])
    return np.asarray(scale[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _draw_first_order(
    expected: Expectation, images: _Images, poses: NDArray[np.intp], seed: int, flip_deg: Array, flip_mm: Array
) -> None:
    """Draw errors from the covariance, with flips at their probability."""
    count = expected.drawn_deg.shape[1]
    total = images.budget.total
    for pose in poses:
        rng = _rng(seed, int(pose))
        normal = rng.standard_normal((count, 6))
        # The sizes of both parts are drawn independently: no statement is made about them together.
        parts = [np.maximum(np.linalg.eigvalsh(total[pose][k : k + 3, k : k + 3]), 0.0) for k in (0, 3)]
        flipped = rng.random(count) < expected.flip_rate[pose]
        squares = [normal[:, 3 * k : 3 * k + 3] ** 2 @ parts[k] for k in (0, 1)]
        expected.drawn_deg[pose] = np.sqrt(np.rad2deg(1) ** 2 * squares[0] + flipped * flip_deg[pose] ** 2)
        expected.drawn_mm[pose] = np.sqrt(1e6 * squares[1] + flipped * flip_mm[pose] ** 2)


def _draw_estimates(expected: Expectation, images: _Images, poses: NDArray[np.intp], seed: int) -> None:
    """Draw images of the marker at some poses, estimate its pose in each, and note the errors."""
    series, count = images.series, expected.drawn_deg.shape[1]
    true = PoseDistribution("drawn", series.poses.rotation[poses], series.poses.translation[poses])
    seen = np.stack([_draw_image(images, int(pose), count, seed) for pose in poses]).reshape(-1, len(series.marker), 2)
    rotation, translation = (np.repeat(part, count, axis=0) for part in (true.rotation, true.translation))
    at = np.repeat(poses, count)
    first = images.refined(at, seen, rotation, translation)
    second = images.refined(at, seen, *mirrored_poses(images.points, *first[:2]))
    better = second[2] < first[2]
    estimate = np.where(better[:, None, None], second[0], first[0])
    place = np.where(better[:, None], second[1], first[1])
    off = np.linalg.norm(place - translation, axis=-1)
    te_pct = 100 * off / np.linalg.norm(translation, axis=-1)
    error = angle_between(estimate, rotation)
    lost = pose_failed(images.points, estimate, place, te_pct)
    mirrored = mirrored_rotation(rotation, translation)
    apart = flip_separation(true.rotation, true.translation, images.budget.total[poses]) >= FLIP_SEPARATION
    flipped = (angle_between(estimate, mirrored) < error) & np.repeat(apart, count) & ~lost
    drawn_deg = np.where(lost, np.nan, np.rad2deg(error)).reshape(-1, count)
    drawn_mm = np.where(lost, np.nan, 1e3 * off).reshape(-1, count)
    expected.drawn_deg[poses], expected.drawn_mm[poses] = drawn_deg, drawn_mm
    kept = np.maximum(np.isfinite(drawn_deg).sum(axis=1), 1)
    expected.rotation_deg[poses] = np.sqrt(np.nansum(drawn_deg**2, axis=1) / kept)
    expected.translation_mm[poses] = np.sqrt(np.nansum(drawn_mm**2, axis=1) / kept)
    expected.flip_rate[poses] = flipped.reshape(-1, count).mean(axis=1)
    expected.failure_rate[poses] = lost.reshape(-1, count).mean(axis=1)


def _draw_image(images: _Images, pose: int, count: int, seed: int) -> Array:
    """Draw normalized images (T, n, 2) of the marker with print errors, image noise and calibration errors."""
    series, rng = images.series, _rng(seed, pose)
    noise = rng.standard_normal((count, len(series.marker), 2))
    printed = images.points + displacement(series.marker, series.errors, rng, prints=(count,))
    rotation, translation = series.poses.rotation[pose], series.poses.translation[pose]
    seen = perspective(printed @ rotation.T + translation) + (images.root[pose] @ noise[..., None])[..., 0]
    if images.moved is not None:
        seen += np.einsum("nik,tk->tni", images.moved[pose], rng.standard_normal((count, images.moved.shape[-1])))
    return np.asarray(seen)


def _rng(seed: int, pose: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(pose, _STREAM)))


def without_calibration(series: SyntheticViews[Marker]) -> SyntheticViews[Marker]:
    """Return the series with an exact calibration, as that of the views, which are rendered with the camera itself."""
    return replace(series, errors=replace(series.errors, camera_covariance=None))
