"""Estimators that the paper mentions but does not plot: other homographies, decomposition, LM from the true pose."""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import (
    ESTIMATORS,
    Correspondences,
    HomographyEstimator,
    PoseEstimates,
    PoseEstimator,
)
from markergen.estimators.lm import refine
from markergen.maths.dlt import dlt_matrix, normalization
from markergen.maths.projection import decompose_homography
from markergen.maths.rotation import exponential

Array = NDArray[np.float64]


class Harker(HomographyEstimator):
    """Orthogonalized DLT (Harker & O'Leary 2005), the one inside IPPE.

    The DLT's equations in u x and v x, centered, are projected onto the complement of the object points, which leaves
    three unknowns: the last row of the homography. nan where the points do not determine it.
    """

    name = "harker"

    def solve(self, batch: Correspondences) -> Array:
        """Homographies (T, 3, 3) with H[2, 2] = 1, from marker plane (m) to image (px)."""
        objects = np.broadcast_to(batch.xyz[..., :2], batch.image_points.shape)
        (object_center, object_scale), (center, scale) = normalization(objects), normalization(batch.image_points)
        p, q = (objects - object_center) * object_scale, (batch.image_points - center) * scale
        products = -q[..., :, None] * p[..., None, :]
        means = products.mean(axis=1)
        onto = np.linalg.pinv(p)
        # (T, n, 3) for x and y: -x p, centered, and -x; then their parts along p and the rest.
        sides = [np.concatenate([products[..., i, :] - means[:, None, i], -q[..., i : i + 1]], axis=-1) for i in (0, 1)]
        along = [onto @ side for side in sides]
        rest = np.concatenate([side - p @ part for side, part in zip(sides, along, strict=True)], axis=1)
        last = np.linalg.eigh(rest.swapaxes(-1, -2) @ rest)[1][..., :, :1]
        rows = [
            np.concatenate([-(along[i] @ last)[..., 0], -np.sum(means[:, i] * last[:, :2, 0], axis=1)[:, None]], axis=1)
            for i in (0, 1)
        ]
        return _unscaled(np.stack([*rows, last[..., 0]], axis=1), object_center, object_scale, center, scale)


class OpenCv(HomographyEstimator):
    """cv2.findHomography: the normalized DLT, and from five points on Levenberg-Marquardt on the reprojection error."""

    name = "opencv"

    def solve(self, batch: Correspondences) -> Array:
        """Homographies (T, 3, 3) with H[2, 2] = 1, nan where OpenCV finds none."""
        import cv2

        objects = np.broadcast_to(batch.xyz[..., :2], batch.image_points.shape)
        homography = np.full((len(objects), 3, 3), np.nan)
        for trial in np.flatnonzero(batch.solvable):
            solution: Any = cv2.findHomography(objects[trial], batch.image_points[trial], 0)[0]
            if solution is not None:
                homography[trial] = solution
        return homography


class PlainDlt(HomographyEstimator):
    """The DLT without normalization, in m and px."""

    name = "plain"

    def solve(self, batch: Correspondences) -> Array:
        """Homographies (T, 3, 3) with H[2, 2] = 1, from marker plane (m) to image (px)."""
        objects = np.broadcast_to(batch.xyz[..., :2], batch.image_points.shape)
        images = np.where(batch.solvable[:, None, None], batch.image_points, 0.0)
        # By singular values: A is so badly conditioned that those of A'A would cost half of the digits.
        h = np.linalg.svd(dlt_matrix(objects, images))[2][..., 8, :].reshape(-1, 3, 3)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(batch.solvable[:, None, None], h / h[:, 2:, 2:], np.nan)


class Decomposition(PoseEstimator):
    """The pose nearest to the normalized DLT's homography."""

    name = "decomposition"
    planar_only = True

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        dlt = ESTIMATORS["dlt"]
        assert isinstance(dlt, HomographyEstimator)
        rotation, translation = decompose_homography(batch.once(dlt), batch.camera.matrix)
        return PoseEstimates(rotation[:, None], translation[:, None])


class FromDlt(PoseEstimator):
    """Levenberg-Marquardt from the pose nearest to the normalized DLT's homography: the start of OpenCV's."""

    name = "lm from the dlt"
    planar_only = True

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        return _refined(batch, *batch.once(Decomposition()).best)


class FromTruth(PoseEstimator):
    """Levenberg-Marquardt from the true pose: what LM gives if its initial guess is perfect."""

    name = "lm from the truth"
    off_deg: ClassVar[float] = 0.0

    def __init__(self, rotation: Array, translation: Array) -> None:
        """Take the true poses (P, 3, 3), (P, 3) of a batch with as many trials of each, pose after pose."""
        self._poses = rotation, translation

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        trials = len(batch.image_points) // len(self._poses[0])
        # The same for all poses.
        axes = np.random.default_rng(trials).standard_normal((trials, 3))
        off = exponential(np.radians(self.off_deg) * axes / np.linalg.norm(axes, axis=-1, keepdims=True))
        rotation, translation = self._poses
        return _refined(batch, (rotation[:, None] @ off).reshape(-1, 3, 3), np.repeat(translation, trials, axis=0))


class FromPoor(FromTruth):
    """Levenberg-Marquardt from the true pose turned about a random axis of the marker, by 45 deg."""

    name = "lm from poor starts"
    off_deg = 45.0


def _refined(batch: Correspondences, rotation: Array, translation: Array) -> PoseEstimates:
    rotation, translation = refine(batch, rotation, translation)
    return PoseEstimates(rotation[:, None], translation[:, None])


def _unscaled(h: Array, object_center: Array, object_scale: Array, center: Array, scale: Array) -> Array:
    """Homographies between points, from those (T, 3, 3) between normalized ones, scaled to H[2, 2] = 1."""
    h = h.copy()
    # Columns: p = (X - X0) s; rows: x = x0 + q / s.
    h[..., :2] *= object_scale
    h[..., 2] -= (h[..., :2] @ object_center.swapaxes(-1, -2))[..., 0]
    h[:, :2] = h[:, :2] / scale + center.swapaxes(-1, -2) * h[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(h / h[:, 2:, 2:])
