"""Levenberg-Marquardt on the reprojection error: the maximum-likelihood pose under Gaussian image noise."""

from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array, Mask
from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.base import rotated
from markergen.maths.information import apply_pose_step, rotated_jacobian
from markergen.maths.levenberg_marquardt import Arrays, Attempt, Damping, LeastSquares, levenberg_marquardt
from markergen.maths.projection import perspective, to_pixels
from markergen.model.camera import Camera

STEP = 1e-10
"""Convergence threshold: a step rotates by less than this, in rad, and translates by less than this fraction of |t|."""
ITERATIONS = 100
"""Maximum number of steps: in the paper's poses, at noise of 0.2 px, 5 steps make the RMS error of the rotation 0.6 %
larger than 100 do, 20 steps 7e-5 of it, and 50 steps 5e-6.
"""
DAMPING = Damping(start=1e-3, least=1e-10, slack=1e-12)
"""Damping never falls to 0, as J'J may be singular; 1e-12 of the sum of squares is about 1e-13 px in a coordinate."""


class LevenbergMarquardt(PoseEstimator):
    """Levenberg-Marquardt from the better IPPE solution (for non-coplanar control points, from SQPnP's)."""

    name = "lm"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        start = ESTIMATORS["ippe" if batch.planar else "sqpnp"]
        assert isinstance(start, PoseEstimator)
        rotation, translation = refine(batch, *batch.once(start).best)
        return PoseEstimates(rotation[:, None], translation[:, None])


def refine(batch: Correspondences, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Minimize the squared reprojection error of every trial over its pose (see `markergen.maths.levenberg_marquardt`).

    The unknowns are the pose (w, dt) of `maths.information`, the residuals are in px. Noise applies to the distorted
    image: with lens distortion, residuals and their derivatives are multiplied by the lens derivative at the measured
    points.

    cv2.solvePnPRefineLM finds the same poses (tested) but takes three times as long, one call per trial, and stops
    after 20 iterations, which is too few for distant frontal poses.

    Parameters
    ----------
    rotation, translation : arrays (T, 3, 3) and (T, 3)
        Initial pose; a trial whose initial pose is nan or has a point behind the camera stays there.

    Returns
    -------
    rotation (T, 3, 3), translation (T, 3) in m
    """
    rotation, translation = rotation.copy(), translation.copy()
    trials = np.flatnonzero(batch.solvable & np.isfinite(batch.reprojection_error(rotation, translation)))
    lens = None if batch.lens is None else batch.lens[trials]
    problems = Reprojection(batch.of(trials), batch.image_points[trials], lens, batch.camera)
    poses = rotation[trials], translation[trials]
    (rotation[trials], translation[trials]), _ = levenberg_marquardt(problems, poses, DAMPING, ITERATIONS)
    return rotation, translation


@dataclass(frozen=True, eq=False)
class Reprojection(LeastSquares):
    """Reprojection residuals of T trials.

    Attributes
    ----------
    object_points : array (n, 3) or (T, n, 3), m
    image_points : array (T, n, 2), undistorted px
    lens : array (T, n, 2, 2) or None
        See `Correspondences.lens`.
    """

    object_points: Array
    image_points: Array
    lens: Array | None
    camera: Camera

    def residuals(self, unknowns: Arrays) -> Arrays:
        """Sum of squares (T,), image minus projection (T, 2n) in distorted px; inf if a point is behind the camera."""
        rotation, translation = unknowns
        seen = rotated(self.object_points, rotation) + translation[:, None]
        behind = np.any(seen[..., 2] <= 0, axis=-1)
        seen[behind] = 1.0
        residual = self.image_points - to_pixels(perspective(seen), self.camera.matrix)
        residual = self._distorted(residual.reshape(len(residual), 2 * residual.shape[1], 1))[..., 0]
        residual[behind] = np.inf
        return np.einsum("tk,tk->t", residual, residual), residual

    def jacobian(self, unknowns: Arrays, results: Arrays) -> Array:
        """See `LeastSquares.jacobian`."""
        del results
        rotation, translation = unknowns
        return self._distorted(rotated_jacobian(rotated(self.object_points, rotation), translation, self.camera.focal))

    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """See `LeastSquares.moved`."""
        return apply_pose_step(unknowns[0], unknowns[1], step)

    def converged(self, attempt: Attempt) -> Mask:
        """Mask of the converged trials, see `STEP`."""
        rotation, translation, distance = (
            np.linalg.norm(vectors, axis=-1) for vectors in (attempt.step[:, :3], attempt.step[:, 3:], attempt.tried[1])
        )
        size = np.maximum(rotation, translation / distance)
        # A nan step ends its trial as well.
        return ~np.asarray(size > STEP)

    def take(self, chosen: Mask) -> "Reprojection":
        """See `LeastSquares.take`."""
        points = self.object_points if self.object_points.ndim == 2 else self.object_points[chosen]
        lens = None if self.lens is None else self.lens[chosen]
        return Reprojection(points, self.image_points[chosen], lens, self.camera)

    def _distorted(self, rows: Array) -> Array:
        """Convert rows (T, 2n, k) from undistorted to distorted px."""
        if self.lens is None:
            return rows
        pairs = rows.reshape(*self.image_points.shape, rows.shape[-1])
        return (self.lens @ pairs).reshape(rows.shape)


LM = LevenbergMarquardt()
ESTIMATORS.register(LM.name)(LM)
