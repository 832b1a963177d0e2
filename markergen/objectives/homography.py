"""Homography objective: expected error of the homography on and around the marker."""
# tests: tests/objectives/test_objectives.py tests/validation/test_metrics.py

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import homography_jacobian, homography_jacobian_pullback, information
from markergen.objectives.base import OBJECTIVES, Criterion, TraceObjective


def validation_grid(radius: float) -> Array:
    """Return the M = 49 validation points (49, 2) in m: a uniform 7 x 7 grid over a square of half-width 1.5 radius.

    Wider than the marker, as in Acuna & Willert (2018), to measure the homography beyond its control points.
    """
    steps = np.linspace(-1.5, 1.5, 7) * radius
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


@OBJECTIVES.register("homography")
class HomographyObjective(TraceObjective):
    """Root of the expected HE in px, HE the mean squared error over the validation grid, for the noise of the setting.

    HE = trace(W C) with C the CRLB of the eight parameters of the homography and W the mean over the grid of J_g'J_g.
    The noise is that of the distorted image, but the homography maps to undistorted px, and so its error is in
    undistorted px: a grid wider than the marker may extend beyond the domain of the lens model.
    """

    unit = "px"
    criterion = Criterion("homography_px", "homography px", place=4)
    planar_only = True
    default_restarts = 16

    def _weight(self) -> Array:
        grid = validation_grid(self.setting.boundary.radius)
        return information(self._jacobian(grid)) / len(grid)

    def _jacobian(self, points: Array) -> Array:
        poses, camera = self.setting.poses, self.setting.camera
        radius = self.setting.boundary.radius
        return homography_jacobian(points, poses.rotation, poses.translation, camera.focal, radius)

    def _plane(self) -> Array:
        # M (I + D) maps the plane point r (x, y) to the image of r (x + D13, y + D23) to first order, for all x and y.
        plane = np.zeros((8, 2))
        plane[2, 0] = plane[5, 1] = 1 / self.setting.boundary.radius
        return np.broadcast_to(plane, (len(self.setting.poses), 8, 2))

    def _jacobian_pullback(self, cotangent: Array, points: Array) -> Array:
        poses, camera = self.setting.poses, self.setting.camera
        radius = self.setting.boundary.radius
        return homography_jacobian_pullback(cotangent, points, poses.rotation, poses.translation, camera.focal, radius)
