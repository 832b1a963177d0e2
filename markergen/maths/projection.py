"""Batched pinhole projection of control points, marker planes and circles under many poses.

A pose is T_camera_marker: X_camera = R X_marker + t. Points come as (..., n, 2), lying in the marker's plane,
or (..., n, 3); poses as rotation (P, 3, 3) and translation (P, 3); the results carry both batches, (..., P, n, .).
"""

import numpy as np

from markergen.arrays import Array


def rotate(points: Array, rotation: Array) -> Array:
    """Return R X, shape (..., P, n, 3), for points (..., n, 2 or 3) and rotation (P, 3, 3)."""
    dimension = points.shape[-1]
    # One matrix product for all layouts and poses; the loop over small products costs three times as much.
    columns = rotation[:, :, :dimension].transpose(2, 0, 1).reshape(dimension, -1)
    rotated = points.reshape(-1, dimension) @ columns
    return rotated.reshape(*points.shape[:-1], len(rotation), 3).swapaxes(-3, -2)


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

    Points behind the camera are mirrored, as the formula has it; `to_camera` gives the depth.
    """
    return to_pixels(perspective(to_camera(points, rotation, translation)), matrix)


def plane_homography(rotation: Array, translation: Array, matrix: Array) -> Array:
    """H = K [r1 r2 t], shape (P, 3, 3), from marker plane coordinates in m to px."""
    return matrix @ np.concatenate([rotation[..., :2], translation[..., None]], axis=-1)


def decompose_homography(homography: Array, matrix: Array) -> tuple[Array, Array]:
    """Pose nearest to homographies H ~ K [r1 r2 t] from marker plane (m) to image (px).

    K^-1 H is scaled so that its first two columns have a mean length of 1 and the marker lies in front of the
    camera; the rotation is the orthogonal matrix nearest to those columns and their cross product.

    Parameters
    ----------
    homography : array (T, 3, 3)
    matrix : array (3, 3)
        Camera matrix K.

    Returns
    -------
    rotation (T, 3, 3), translation (T, 3) in m
        nan where the homography is not finite.
    """
    rotation, translation = np.full(homography.shape, np.nan), np.full(homography.shape[:2], np.nan)
    finite = np.isfinite(homography).all(axis=(-2, -1))
    columns = np.linalg.inv(matrix) @ homography[finite]
    lengths = np.linalg.norm(columns[..., :2], axis=-2).mean(axis=-1)
    columns = columns * (np.where(columns[..., 2, 2] < 0, -1.0, 1.0) / lengths)[:, None, None]
    normal = np.cross(columns[..., 0], columns[..., 1])
    left, _, right = np.linalg.svd(np.stack([columns[..., 0], columns[..., 1], normal], axis=-1))
    # The three columns are right-handed by construction, so the nearest orthogonal matrix is a rotation.
    rotation[finite] = left @ right
    translation[finite] = columns[..., 2]
    return rotation, translation


def apply_homography(homography: Array, points: Array) -> Array:
    """Map points (..., n, 2) by homographies (..., 3, 3); returns (..., n, 2)."""
    mapped = points @ homography[..., :, :2].swapaxes(-1, -2) + homography[..., None, :, 2]
    return mapped[..., :2] / mapped[..., 2:]


def circle_conic(center: Array, radius: Array | float) -> Array:
    """Symmetric C (..., 3, 3) with X'CX = 0 on the circle, for center (..., 2) and radius (...), same unit."""
    center = np.asarray(center, dtype=float)
    radius = np.broadcast_to(np.asarray(radius, dtype=float), center.shape[:-1])
    conic = np.zeros((*center.shape[:-1], 3, 3))
    conic[..., 0, 0] = conic[..., 1, 1] = 1
    conic[..., :2, 2] = conic[..., 2, :2] = -center
    conic[..., 2, 2] = np.sum(center**2, axis=-1) - radius**2
    return conic


def transform_conic(conic: Array, homography: Array) -> Array:
    """H^-T C H^-1: the conic (..., 3, 3) as seen through the homography (..., 3, 3)."""
    inverse = np.linalg.inv(homography)
    return inverse.swapaxes(-1, -2) @ conic @ inverse


def ellipse_of_conic(conic: Array) -> tuple[Array, Array, Array]:
    """Center (..., 2), semi-axes (..., 2) longest first, and angle (...) in rad of the longest axis from x.

    nan for a conic that is not a real ellipse (the circle crosses the camera's horizon).
    """
    quadratic = conic[..., :2, :2]
    center = np.asarray(-np.linalg.solve(quadratic, conic[..., :2, 2:])[..., 0], dtype=float)
    level = -(conic[..., 2, 2] + np.sum(conic[..., :2, 2] * center, axis=-1))
    values, vectors = np.linalg.eigh(quadratic)
    # C and -C are the same conic: the sign of the larger eigenvalue normalizes it.
    sign = np.sign(values[..., 1])
    ratio = level[..., None] * sign[..., None] / (values * sign[..., None])
    semi = np.sqrt(np.where((ratio > 0) & (values.prod(axis=-1) > 0)[..., None], ratio, np.nan))
    order = np.argsort(-semi, axis=-1)
    semi = np.take_along_axis(semi, order, axis=-1)
    longest = np.take_along_axis(vectors, order[..., None, :1], axis=-1)[..., 0]
    return center, semi, np.arctan2(longest[..., 1], longest[..., 0])


def circle_image(center: Array, radius: Array | float, homography: Array) -> tuple[Array, Array, Array]:
    """Image ellipse (see `ellipse_of_conic`) of circles of the marker plane under the homography (..., 3, 3)."""
    return ellipse_of_conic(transform_conic(circle_conic(center, radius), homography))


def center_offset(center: Array, radius: Array | float, homography: Array) -> Array:
    """Ellipse center minus image of the circle's center, (..., 2) px: the error of a plain centroid."""
    center = np.asarray(center, dtype=float)
    return circle_image(center, radius, homography)[0] - apply_homography(homography, center[..., None, :])[..., 0, :]
