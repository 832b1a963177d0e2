"""The pose that a homography of the marker plane stands for."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
