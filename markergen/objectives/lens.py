"""The lens: from the Jacobian of ideal image points, those of a camera without distortion, to that of the points taken.

With x the normalized coordinates of a point and x' = d(x) what the lens makes of them, the two rows of an image point
are multiplied by D(x) = diag(f) d'(x) diag(1/f).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from markergen.maths.distortion import distortion_hessian
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import NO_DISTORTION, Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives.blocks import row_products, times_rows

Array = NDArray[np.float64]
LensPullback = Callable[[Array], tuple[Array, Array]]


def lens_blocks(camera: Camera, normalized: Array) -> Array:
    """D (..., 2, 2) at normalized coordinates (..., 2); nan where the lens does not see."""
    return camera.pixel_jacobian(normalized) / camera.focal


def through_lens(jacobian: Array, points: Array, camera: Camera, poses: PoseDistribution) -> Array:
    """Rows (..., P, 2n, k), px as taken, of those in ideal px, for points (..., n, 2 or 3) in m."""
    if camera.distortion == NO_DISTORTION:
        return jacobian
    normalized = perspective(to_camera(points, poses.rotation, poses.translation))
    return times_rows(lens_blocks(camera, normalized), jacobian)


def linearize_lens(
    jacobian: Array, points: Array, camera: Camera, poses: PoseDistribution
) -> tuple[Array, LensPullback]:
    """`through_lens`, and its pullback.

    The pullback takes a cotangent of the rows as taken to that of the rows in ideal px, and to the gradient
    (..., P, n, 2 or 3) with respect to the points of what D alone changes: <C, dD J> for the cotangent C.
    """
    seen = to_camera(points, poses.rotation, poses.translation)
    normalized = perspective(seen)
    blocks = lens_blocks(camera, normalized)

    def pullback(cotangent: Array) -> tuple[Array, Array]:
        distortion, focal = camera.distortion, camera.focal
        hessian = distortion_hessian(distortion.model, normalized, distortion.coefficients)
        by_block = row_products(cotangent, jacobian) * (focal[:, None] / focal)
        lateral = np.einsum("...ij,...ijk->...k", by_block, hessian) / seen[..., 2:]
        axial = -np.sum(lateral * normalized, axis=-1, keepdims=True)
        by_points = np.concatenate([lateral, axial], axis=-1) @ poses.rotation[:, :, : points.shape[-1]]
        return times_rows(blocks.swapaxes(-1, -2), cotangent), by_points

    return times_rows(blocks, jacobian), pullback
