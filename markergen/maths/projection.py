"""Batched pinhole projection of control points under many poses.

A pose is T_camera_marker: X_camera = R X_marker + t. Points come as (..., n, 2), lying in the marker's plane,
or (..., n, 3); poses as rotation (P, 3, 3) and translation (P, 3); the results carry both batches, (..., P, n, .).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rotate(points: Array, rotation: Array) -> Array:
    """Return R X, shape (..., P, n, 3), for points (..., n, 2 or 3) and rotation (P, 3, 3)."""
    dimension = points.shape[-1]
    # One matrix product for all layouts and poses; the loop over small products costs three times as much.
    columns = rotation[:, :, :dimension].transpose(2, 0, 1).reshape(dimension, -1)
    turned = points.reshape(-1, dimension) @ columns
    return turned.reshape(*points.shape[:-1], len(rotation), 3).swapaxes(-3, -2)


def rotate_each(points: Array, rotation: Array) -> Array:
    """Return R X, shape (T, n, 3), for points (T, n, 2 or 3) and rotation (T, 3, 3), each with its own."""
    return points @ rotation[:, :, : points.shape[-1]].swapaxes(-1, -2)


def to_camera(points: Array, rotation: Array, translation: Array) -> Array:
    """Return R X + t in the camera frame, m, shape (..., P, n, 3)."""
    return rotate(points, rotation) + translation[:, None, :]


def perspective(camera_points: Array) -> Array:
    """Divide by depth: normalized image coordinates (..., 2) of camera points (..., 3); no check of the sign of z."""
    return camera_points[..., :2] / camera_points[..., 2:]


def to_pixels(normalized: Array, matrix: Array) -> Array:
    """Apply the camera matrix (3, 3) to normalized coordinates (..., 2); returns px, pixel centers at integers."""
    return normalized @ matrix[:2, :2].T + matrix[:2, 2]


def from_pixels(pixels: Array, matrix: Array) -> Array:
    """Undo `to_pixels`: normalized image coordinates (..., 2) of pixel coordinates (..., 2)."""
    return (pixels - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T


def project(points: Array, rotation: Array, translation: Array, matrix: Array) -> Array:
    """Pixel coordinates (..., P, n, 2) of marker points (..., n, 2 or 3) under P poses.

    Points behind the camera come out mirrored, as the formula has it; `to_camera` tells the depth.
    """
    return to_pixels(perspective(to_camera(points, rotation, translation)), matrix)


def plane_homography(rotation: Array, translation: Array, matrix: Array) -> Array:
    """H = K [r1 r2 t], shape (P, 3, 3), from marker plane coordinates in m to px."""
    return matrix @ np.concatenate([rotation[..., :2], translation[..., None]], axis=-1)


def apply_homography(homography: Array, points: Array) -> Array:
    """Map points (..., n, 2) by homographies (..., 3, 3); returns (..., n, 2)."""
    mapped = points @ homography[..., :, :2].swapaxes(-1, -2) + homography[..., None, :, 2]
    return mapped[..., :2] / mapped[..., 2:]
