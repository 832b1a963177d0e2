"""Table of pose and homography estimators; no other package calls cv2.solvePnP.

``Correspondences(object_points, image_points, camera).once(ESTIMATORS["lm"]).best`` is the pose of every trial.
"""

from markergen.estimators.base import (
    Correspondences,
    Estimator,
    HomographyEstimator,
    PoseEstimates,
    PoseEstimator,
)
from markergen.registry import Registry

AnyEstimator = PoseEstimator | HomographyEstimator

ESTIMATORS: Registry[AnyEstimator] = Registry("estimator", "markergen.estimators", "markergen.estimators", AnyEstimator)
"""Estimators by name."""

__all__ = [
    "ESTIMATORS",
    "AnyEstimator",
    "Correspondences",
    "Estimator",
    "HomographyEstimator",
    "PoseEstimates",
    "PoseEstimator",
]
