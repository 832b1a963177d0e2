"""Condition number of the DLT matrix, the objective of Acuna & Willert (2018)."""
# tests: tests/objectives/test_objectives.py

import numpy as np

from markergen.arrays import Array
from markergen.maths import dlt
from markergen.maths.projection import rotate_each, to_camera
from markergen.objectives.base import OBJECTIVES, Criterion, Objective, Pullback, Setting


@OBJECTIVES.register("condition")
class ConditionObjective(Objective):
    """Condition number c(A) = s1/s8 of the DLT matrix per pose (Eq. 11).

    It depends on the coordinates used in A. ``unit`` (default): object (X - center)/r and image
    (x - x_center) z_center / r with x = K^-1 px, so that a frontal boundary is the unit disk on both sides and the
    unit of length does not matter. ``metric``: m and K^-1 px, as in the paper. ``pixel``: m and px. ``hartley``: each
    set of points normalized separately; c is then independent of size and the markers shrink to nothing, so it is for
    studies only.

    A homography does not model lens distortion, so the DLT uses undistorted points; px are undistorted px.
    """

    unit = ""
    criterion = Criterion("condition", "c(A)", place=5, noiseless="the condition number of the DLT matrix")
    knows_noise = False
    default_aggregate = "logmean"
    coordinates = ("unit", "metric", "pixel", "hartley")
    nonsmooth_values = True
    planar_only = True
    default_restarts = 24

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        super().__init__(setting, aggregate, coordinates)
        poses, camera, count = setting.poses, setting.camera, len(setting.poses)
        self._normalizes = coordinates == "hartley"
        self._object_scale = 1.0
        # Image coordinates are (x - shift) * stretch, with one shift and stretch for each pose.
        self._center, self._stretch = np.zeros((count, 1, 2)), np.ones((count, 1, 2))
        if coordinates == "unit":
            depth = poses.translation[:, None, 2:]
            self._object_scale = 1 / setting.boundary.radius
            self._center = poses.translation[:, None, :2] / depth
            self._stretch = depth / setting.boundary.radius * np.ones(2)
        elif coordinates == "pixel":
            self._stretch = np.broadcast_to(camera.focal, (count, 1, 2))
            self._center = -camera.matrix[:2, 2] / self._stretch

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; of layouts (B, P, n, 2), one for each pose, gradients have the same shape."""
        rotation = self.setting.poses.rotation
        translation, one_each = self.setting.poses.translation, points.ndim == 4
        if one_each:
            camera_points = rotate_each(points, rotation) + translation[:, None]
        else:
            camera_points, points = to_camera(points, rotation, translation), points[:, None]
        depth = camera_points[..., 2:]
        normalized = camera_points[..., :2] / depth
        if self._normalizes:
            (objects, to_points), (images, to_image) = _hartley(points), _hartley(normalized)
        else:
            objects, images = points * self._object_scale, (normalized - self._center) * self._stretch
        value, by_object, by_image = dlt.condition_and_gradient(objects, images, softness)

        def pullback(weights: Array) -> Array:
            scale = (weights * value)[..., None, None]
            if self._normalizes:
                lateral, direct = to_image(by_image * scale) / depth, to_points(by_object * scale)
            else:
                lateral = by_image * self._stretch * scale / depth
                direct = by_object * (self._object_scale * scale)
            axial = -np.sum(lateral * normalized, axis=-1, keepdims=True)
            chained = np.concatenate([lateral, axial], axis=-1) @ rotation[:, :, :2]
            return chained + direct if one_each else (chained + direct).sum(axis=1)

        return value, pullback


def _hartley(points: Array) -> tuple[Array, Pullback]:
    """Hartley's normalized points (..., n, 2), and the pullback of a gradient with respect to them."""
    center, scale = dlt.normalization(points)
    centered = points - center

    def pullback(gradient: Array) -> Array:
        # The scale is sqrt(2 / s) with s the mean square of the centered points.
        along = np.sum(gradient * centered, axis=(-2, -1), keepdims=True)
        even = gradient - gradient.mean(axis=-2, keepdims=True)
        return scale * even - along * scale**3 / (2 * points.shape[-2]) * centered

    return centered * scale, pullback
