"""The coordinates that A is written in, and the paper's bounds of the relative error of a homography in each."""

import numpy as np
from numpy.typing import NDArray

from markergen.maths.dlt import condition, dlt_matrix, normalization
from markergen.maths.projection import from_pixels
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.studies.paper.options import BOUNDARY

Array = NDArray[np.float64]


def written(coordinates: str, points: Array, pixels: Array, pose: PoseDistribution, camera: Camera) -> list[Array]:
    """Object points and one or more sets of image points (B, n, 2) in some coordinates (see `ConditionObjective`).

    Parameters
    ----------
    points : array (B, n, 2), m
    pixels : array (k, B, n, 2), px
        The first ones are exact: ``hartley`` normalizes all by these, because two matrices can be compared only if
        they are written alike.
    pose : PoseDistribution
        Of one pose.

    Returns
    -------
    list of arrays (B, n, 2)
        Object points, then the k sets of image points.
    """
    if coordinates == "pixel":
        return [points, *pixels]
    normalized = from_pixels(pixels, camera.matrix)
    if coordinates == "metric":
        return [points, *normalized]
    if coordinates == "unit":
        x, y, z = pose.translation[0]
        return [points / BOUNDARY.radius, *((normalized - np.array([x, y]) / z) * z / BOUNDARY.radius)]
    center, scale = normalization(points)
    image_center, image_scale = normalization(normalized[0])
    return [(points - center) * scale, *((normalized - image_center) * image_scale)]


def conditions(coordinates: str, points: Array, pose: PoseDistribution, camera: Camera) -> Array:
    """c(A), shape (B,), of layouts (B, n, 2) under one pose; inf where it is not determined."""
    pixels = camera.project(points, pose.rotation, pose.translation)[:, 0]
    objects, images = written(coordinates, points, pixels[None], pose, camera)
    return condition(objects, images)


def bound_ratios(
    coordinates: str, points: Array, exact: Array, noisy: Array, pose: PoseDistribution, camera: Camera
) -> tuple[Array, Array]:
    """Relative error of the DLT's h (B,) over the paper's upper bound, and the paper's lower bound over that error.

    xi = |h - h_hat| / |h_hat|, at most c(A) |A - A~| / |A| and at least |A~ (h - h_hat)| / (|A~| |h_hat|), with
    spectral norms and h, h_hat the unit vectors of least singular value of A, A~, of the same sign. Above 1 a bound is
    broken.

    Parameters
    ----------
    points : array (B, n, 2), m
    exact, noisy : arrays (B, n, 2), px
    """
    objects, clean, noised = written(coordinates, points, np.stack([exact, noisy]), pose, camera)
    matrix, disturbed = dlt_matrix(objects, clean), dlt_matrix(objects, noised)
    h, h_hat = (np.linalg.svd(a)[2][..., 8, :] for a in (matrix, disturbed))
    h_hat *= np.where(np.sum(h * h_hat, axis=-1) < 0, -1.0, 1.0)[:, None]
    error = np.linalg.norm(h - h_hat, axis=-1)
    singular = np.linalg.svd(matrix, compute_uv=False)
    # |A - A~| c / |A| = |A - A~| / s8: with n = 4 the eighth is the last one.
    upper = np.linalg.norm(matrix - disturbed, 2, axis=(-2, -1)) / singular[..., 7]
    moved = np.linalg.norm(np.einsum("bij,bj->bi", disturbed, h - h_hat), axis=-1)
    lower = moved / np.linalg.norm(disturbed, 2, axis=(-2, -1))
    return error / upper, lower / error
