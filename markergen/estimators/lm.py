"""Levenberg-Marquardt on the reprojection error: the maximum-likelihood pose under Gaussian noise of the image."""

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.base import turned
from markergen.estimators.ippe import IPPE
from markergen.estimators.sqpnp import SQPNP
from markergen.maths.information import information, turned_jacobian
from markergen.maths.projection import perspective, to_pixels
from markergen.maths.rotation import exponential

Array = NDArray[np.float64]

STEP = 1e-10
"""A trial has converged when a step turns by less than this, in rad, and moves by less than this share of |t|."""
ITERATIONS = 100
DAMPING, LEAST_DAMPING, FACTOR = 1e-3, 1e-10, 10.0
"""Marquardt's lambda to begin with, its floor (J'J may be singular), and what it is divided or multiplied by."""


class LevenbergMarquardt(PoseEstimator):
    """Levenberg-Marquardt from the better solution of IPPE (for control points in space: from SQPnP's)."""

    name = "lm"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        rotation, translation = refine(batch, *batch.once(IPPE if batch.planar else SQPNP).best)
        return PoseEstimates(rotation[:, None], translation[:, None])


def refine(batch: Correspondences, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Minimize the squared reprojection error of every trial over its pose.

    Solves (J'J + lambda diag J'J) s = J'r and applies s = (w, dt) as R <- exp([w]x) R, t <- t + dt, J being
    `maths.information.pose_jacobian` and r the residuals in px, with Marquardt's rule for lambda. The noise is that of
    the image as taken: with a lens, J and r are multiplied by its derivative at the measured points.

    All trials take their steps together and leave when they have converged. cv2.solvePnPRefineLM finds the same poses
    (a test says so) but takes three times as long, one call per trial, and stops after 20 iterations, which is too
    few for far frontal poses.

    Parameters
    ----------
    batch : Correspondences
    rotation, translation : arrays (T, 3, 3) and (T, 3)
        Where to start; a trial that starts at nan or with a point behind the camera stays there.

    Returns
    -------
    rotation (T, 3, 3), translation (T, 3) in m
    """
    rotation, translation = rotation.copy(), translation.copy()
    focal = batch.camera.focal
    trials = np.flatnonzero(batch.solvable & np.isfinite(batch.reprojection_error(rotation, translation)))
    residual = _residual(batch, trials, rotation[trials], translation[trials])
    damping = np.full(len(trials), DAMPING)
    for _ in range(ITERATIONS):
        if not len(trials):
            break
        R, t = rotation[trials], translation[trials]
        jacobian = _taken(batch, trials, turned_jacobian(turned(batch.of(trials), R), t, focal))
        step = _damped_step(jacobian, residual, damping)
        R, t = exponential(step[:, :3]) @ R, t + step[:, 3:]
        new_residual = _residual(batch, trials, R, t)
        before, after = (np.einsum("tk,tk->t", r, r) for r in (residual, new_residual))
        # At the minimum both sums are equal but for rounding (1e-13 px in a coordinate); no step is refused for that.
        better = after <= before * (1 + 1e-12)
        rotation[trials[better]], translation[trials[better]] = R[better], t[better]
        residual[better] = new_residual[better]
        damping = np.where(better, np.maximum(damping / FACTOR, LEAST_DAMPING), damping * FACTOR)
        distance = np.linalg.norm(t, axis=-1)
        size = np.maximum(np.linalg.norm(step[:, :3], axis=-1), np.linalg.norm(step[:, 3:], axis=-1) / distance)
        going = size > STEP
        trials, residual, damping = trials[going], residual[going], damping[going]
    return rotation, translation


def _residual(batch: Correspondences, trials: NDArray[np.intp], rotation: Array, translation: Array) -> Array:
    """Image minus projection (trials, 2n) in px as taken; inf where a point is behind the camera."""
    seen = turned(batch.of(trials), rotation) + translation[:, None]
    behind = np.any(seen[..., 2] <= 0, axis=-1)
    seen[behind] = 1.0
    residual = batch.image_points[trials] - to_pixels(perspective(seen), batch.camera.matrix)
    residual = _taken(batch, trials, residual.reshape(len(trials), 2 * batch.xyz.shape[-2], 1))[..., 0]
    residual[behind] = np.inf
    return residual


def _taken(batch: Correspondences, trials: NDArray[np.intp], rows: Array) -> Array:
    """Rows (trials, 2n, k) in px as taken, of those in ideal px."""
    if batch.lens is None:
        return rows
    # Counted out, because of no trials at all no size can be left to numpy.
    pairs = rows.reshape(len(trials), batch.xyz.shape[-2], 2, rows.shape[-1])
    return (batch.lens[trials] @ pairs).reshape(rows.shape)


def _damped_step(jacobian: Array, residual: Array, damping: Array) -> Array:
    """Solve (J'J + lambda diag J'J) s = J'r; s has shape (T, 6)."""
    normal = information(jacobian)
    diagonal = np.arange(6)
    normal[:, diagonal, diagonal] *= 1 + damping[:, None]
    gradient = np.einsum("tki,tk->ti", jacobian, residual)
    return np.linalg.solve(normal, gradient[..., None])[..., 0]


LM = LevenbergMarquardt()
ESTIMATORS.register(LM.name)(LM)
