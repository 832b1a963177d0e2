"""cv2.solvePnPGeneric over a batch, kept away from poses in which it fails.

Only the call itself is in the loop; everything before and after it is done for the whole batch.
"""

from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.estimators.base import Correspondences, PoseEstimates
from markergen.maths.rotation import exponential, turn_z

AWAY = np.diag([1.0, -1.0, -1.0])
"""Half turn about x: the marker's z then points away from the camera, and an upright frontal marker has R = I."""
MOST_SOLUTIONS = 18
"""Maximum number of solutions of any OpenCV method; SQPnP reserves room for this many."""


def solve_each(batch: Correspondences, method: str, solutions: int = 1) -> PoseEstimates:
    """Poses of every trial by cv2.SOLVEPNP_`method`, k = `solutions` or more, best first; nan for missing ones.

    For methods with one solution solvePnP is called, as solvePnPGeneric also reprojects, which takes 10 % of the time.
    """
    import cv2

    flag: int = getattr(cv2, f"SOLVEPNP_{method}")
    solve: Any = cv2.solvePnP if solutions == 1 else cv2.solvePnPGeneric
    matrix = batch.camera.matrix
    objects, images, rotations = opencv_arguments(batch)
    poses = np.full((len(images), MOST_SOLUTIONS, 2, 3), np.nan)
    for trial in np.flatnonzero(batch.solvable):
        try:
            count, vectors, translations, *_ = solve(objects[trial], images[trial], matrix, None, flags=flag)
        except cv2.error:
            continue
        if not count:
            continue
        if solutions == 1:
            poses[trial, 0] = vectors[:, 0], translations[:, 0]
            continue
        solutions = max(solutions, count)
        for k in range(count):
            poses[trial, k] = vectors[k][:, 0], translations[k][:, 0]
    poses = poses[:, :solutions]
    return best_first(batch, exponential(poses[:, :, 0]) @ rotations[:, None], poses[:, :, 1])


def opencv_arguments(batch: Correspondences) -> tuple[Array, Array, Array]:
    """Object points (T, n, 3), image points (T, n, 2) and turn (T, 3, 3) for OpenCV: R_marker = R_opencv turn.

    OpenCV's IPPE is wrong, yet reports success, where the rotation is a half turn about the optical axis or the
    marker's z points toward the camera. So the object is turned such that z points away and its orientation in the
    plane matches the image (the Procrustes angle between both), and the rotation is turned back afterwards.
    """
    images = np.where(batch.solvable[:, None, None], batch.image_points, 0.0)
    away = batch.xyz @ AWAY
    rotations = turn_z(_procrustes_angle(away[..., :2], images))
    return np.ascontiguousarray(away @ rotations.swapaxes(-1, -2)), np.ascontiguousarray(images), rotations @ AWAY


def best_first(batch: Correspondences, rotation: Array, translation: Array) -> PoseEstimates:
    """Sort the solutions (T, k, 3, 3), (T, k, 3) of every trial by reprojection error; nan for non-finite ones, last.

    OpenCV sorts the solutions of IPPE (though it does not rule out one behind the camera), but not those of SQPnP, the
    first of which is off by a radian for some layouts of four points.
    """
    finite = np.asarray(np.isfinite(rotation).all(axis=(-2, -1)) & np.isfinite(translation).all(axis=-1))
    rotation = np.where(finite[..., None, None], rotation, np.nan)
    translation = np.where(finite[..., None], translation, np.nan)
    solutions = rotation.shape[1]
    if solutions > 1:
        errors = [batch.reprojection_error(rotation[:, k], translation[:, k]) for k in range(solutions)]
        order = np.lexsort((np.stack(errors, axis=1), ~finite), axis=1)
        rotation = np.take_along_axis(rotation, order[..., None, None], axis=1)
        translation = np.take_along_axis(translation, order[..., None], axis=1)
    return PoseEstimates(rotation, translation)


def _procrustes_angle(points: Array, images: Array) -> Array:
    """Angle (T,) in rad of the rotation about the centroids that best aligns points (n, 2) or (T, n, 2) with images."""
    points = points - points.mean(axis=-2, keepdims=True)
    images = images - images.mean(axis=1, keepdims=True)
    sine = np.sum(points[..., 0] * images[..., 1] - points[..., 1] * images[..., 0], axis=-1)
    cosine = np.sum(points * images, axis=(-2, -1))
    return np.asarray(np.arctan2(sine, cosine))
