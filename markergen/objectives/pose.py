"""Objectives based on the pose covariance, including the default: displacement of the marker's rim."""
# tests: tests/objectives/test_observation.py

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import displacement_weight, pose_jacobian, pose_jacobian_pullback
from markergen.model.poses import RIM_POINTS
from markergen.objectives.base import OBJECTIVES, Criterion, TraceObjective


class PoseCovarianceObjective(TraceObjective):
    """Root of trace(W C), C the CRLB of the pose (w, dt), see `markergen.maths.information`; allows relief."""

    default_restarts = 8

    def _jacobian(self, points: Array) -> Array:
        poses = self.setting.poses
        return pose_jacobian(points, poses.rotation, poses.translation, self.setting.camera.focal)

    def _plane(self) -> Array:
        # In the camera frame, moving a point in the plane is equivalent to translating the marker.
        in_plane = self.setting.poses.rotation[:, :, :2]
        return np.concatenate([np.zeros_like(in_plane), in_plane], axis=1)

    def _jacobian_pullback(self, cotangent: Array, points: Array) -> Array:
        poses = self.setting.poses
        return pose_jacobian_pullback(cotangent, points, poses.rotation, poses.translation, self.setting.camera.focal)


@OBJECTIVES.register("pose")
class PoseObjective(PoseCovarianceObjective):
    """Expected RMS displacement in m of the boundary's rim in the camera frame, for the noise of the setting.

    W is the mean over rim points b of J_b'J_b, J_b = d(R b + t). As a length, it needs no relative weight of rotation
    and translation. On a plate of a rig, the points are those of the whole body.
    """

    unit = "m"
    criterion = Criterion("pose_m", "pose mm", 1e3, place=1)

    def _weight(self) -> Array:
        carrier = self.setting.carrier
        points = carrier.points if carrier else self.setting.boundary.rim(RIM_POINTS)
        return displacement_weight(points, self.setting.poses.rotation)
