"""The image of a circle: conic, ellipse, and how far its center lies from the image of the circle's center."""

import numpy as np
from numpy.typing import NDArray

from markergen.maths.projection import apply_homography

Array = NDArray[np.float64]


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

    A conic that is no real ellipse (the circle crosses the camera's horizon) gives nan.
    """
    quadratic = conic[..., :2, :2]
    center = np.asarray(-np.linalg.solve(quadratic, conic[..., :2, 2:])[..., 0], dtype=float)
    level = -(conic[..., 2, 2] + np.sum(conic[..., :2, 2] * center, axis=-1))
    values, vectors = np.linalg.eigh(quadratic)
    # C and -C are the same conic: the sign of the larger eigenvalue decides which is meant.
    sign = np.sign(values[..., 1])
    ratio = level[..., None] * sign[..., None] / (values * sign[..., None])
    semi = np.sqrt(np.where((ratio > 0) & (values.prod(axis=-1) > 0)[..., None], ratio, np.nan))
    order = np.argsort(-semi, axis=-1)
    semi = np.take_along_axis(semi, order, axis=-1)
    longest = np.take_along_axis(vectors, order[..., None, :1], axis=-1)[..., 0]
    return center, semi, np.arctan2(longest[..., 1], longest[..., 0])


def circle_image(center: Array, radius: Array | float, homography: Array) -> tuple[Array, Array, Array]:
    """Ellipse (see `ellipse_of_conic`) that the homography (..., 3, 3) makes of circles of the marker plane."""
    return ellipse_of_conic(transform_conic(circle_conic(center, radius), homography))


def center_offset(center: Array, radius: Array | float, homography: Array) -> Array:
    """Ellipse center minus image of the circle's center, (..., 2) px: what a plain centroid is wrong by."""
    center = np.asarray(center, dtype=float)
    return circle_image(center, radius, homography)[0] - apply_homography(homography, center[..., None, :])[..., 0, :]
