"""Condition number of the DLT matrix, the objective of Acuna & Willert (2018)."""
# tests: tests/objectives/test_objectives.py

from collections.abc import Callable

import autograd.numpy as anp
import numpy as np
from autograd.core import make_vjp
from autograd.extend import defvjp, primitive

from markergen.arrays import Array
from markergen.maths import dlt
from markergen.maths.projection import rotate_each, to_camera
from markergen.objectives.base import OBJECTIVES, Criterion, Objective, Pullback, Setting

condition_number: Callable[..., Array] = primitive(dlt.condition)
"""Condition number s1/s8 (`markergen.maths.dlt.condition`), differentiable by autograd.

autograd through a full SVD divides by differences of singular values and gives inf or nan where two of them coincide,
as they do at optima; this primitive uses the closed form instead.
"""


def _vjp(argument: int) -> object:
    def make(value: Array, object_points: Array, image_points: Array, softness: float = 0.0) -> Pullback:
        def vjp(cotangent: Array) -> Array:
            gradient = dlt.condition_and_gradient(object_points, image_points, softness)[argument]
            gradient = gradient * (cotangent * value)[..., None, None]
            return _sum_to(gradient, (object_points, image_points)[argument - 1].shape)

        return vjp

    return make


defvjp(condition_number, _vjp(1), _vjp(2), argnums=(0, 1))


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
        self._shift, self._stretch = np.zeros((count, 1, 2)), np.ones((count, 1, 2))
        if coordinates == "unit":
            depth = poses.translation[:, None, 2:]
            self._object_scale = 1 / setting.boundary.radius
            self._shift = poses.translation[:, None, :2] / depth
            self._stretch = depth / setting.boundary.radius * np.ones(2)
        elif coordinates == "pixel":
            self._stretch = np.broadcast_to(camera.focal, (count, 1, 2))
            self._shift = -camera.matrix[:2, 2] / self._stretch

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; of layouts (B, P, n, 2), one for each pose, gradients have the same shape."""
        if self._normalizes:
            return self._linearize_hartley(points, softness)
        rotation = self.setting.poses.rotation
        translation, one_each = self.setting.poses.translation, points.ndim == 4
        if one_each:
            camera_points = rotate_each(points, rotation) + translation[:, None]
        else:
            camera_points, points = to_camera(points, rotation, translation), points[:, None]
        depth = camera_points[..., 2:]
        normalized = camera_points[..., :2] / depth
        value, by_object, by_image = dlt.condition_and_gradient(
            points * self._object_scale, (normalized - self._shift) * self._stretch, softness
        )

        def pullback(weights: Array) -> Array:
            scale = (weights * value)[..., None, None]
            lateral = by_image * self._stretch * scale / depth
            axial = -np.sum(lateral * normalized, axis=-1, keepdims=True)
            chained = np.concatenate([lateral, axial], axis=-1) @ rotation[:, :, :2]
            gradient = chained + by_object * (self._object_scale * scale)
            return gradient if one_each else gradient.sum(axis=1)

        return value, pullback

    def _linearize_hartley(self, points: Array, softness: float) -> tuple[Array, Pullback]:
        rotation, translation = self.setting.poses.rotation, self.setting.poses.translation

        def values(layouts: Array) -> Array:
            layouts = layouts if layouts.ndim == 4 else layouts[:, None]
            camera_points = layouts @ rotation[:, :, :2].swapaxes(-1, -2) + translation[:, None]
            image = camera_points[..., :2] / camera_points[..., 2:]
            return condition_number(_hartley(layouts), _hartley(image), softness)

        vjp, value = make_vjp(values, points)
        return value, vjp


def _hartley(points: Array) -> Array:
    centered = points - anp.mean(points, axis=-2, keepdims=True)
    mean_square = anp.mean(anp.sum(centered**2, axis=-1, keepdims=True), axis=-2, keepdims=True)
    return centered * anp.sqrt(2 / mean_square)


def _sum_to(array: Array, shape: tuple[int, ...]) -> Array:
    extra = array.ndim - len(shape)
    axes = tuple(range(extra)) + tuple(i + extra for i, size in enumerate(shape) if size == 1 != array.shape[i + extra])
    return array.sum(axis=axes, keepdims=True).reshape(shape) if axes else array
