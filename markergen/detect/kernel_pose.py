"""Calls of the compiled part that estimate poses and judge labelings: see kernel_pose.c."""
# tests: tests/detect/test_kernel.py

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.kernel import at, indices, library, shaped

_DAMPING, _POSE, _JUDGE = 5, 4, 11
"""Lengths of rows in kernel_pose.c."""


def estimate_pose(
    dots: tuple[Array, Array, Array, Array, Array],
    flat: bool,
    rotation: Array,
    translation: Array,
    steps: int,
    settings: tuple[float, ...],
    damping: tuple[float, ...],
) -> tuple[Array, Array, Array, Array, float]:
    """Return one or two poses, or none, with chi2, covariances, scale: see kernel_pose.c, and the twin in pose.py.

    Parameters
    ----------
    dots : tuple
        Points (n, 3), radii (n,), centers seen (n, 2), their covariance (n, 2, 2), and that of the print (n, 3, 3).
    flat : bool
        True if there is a mirrored pose.
    rotation, translation : arrays (k, 3, 3) and (k, 3)
        Starts.
    settings, damping : tuple
        As in kernel_pose.c, and as for `refine_poses`.
    """
    loaded = library()
    assert loaded is not None
    n, k = len(dots[0]), len(rotation)
    shapes: tuple[tuple[int, ...], ...] = (3,), (), (2,), (2, 2), (3, 3)
    given = [shaped(each, n, *shape) for each, shape in zip(dots, shapes, strict=True)]
    turn, shift, chi2 = np.empty((k + 2, 3, 3)), np.empty((k + 2, 3)), np.empty(k + 2)
    turn[:k], shift[:k] = rotation, translation
    covariance, scale = np.empty((2, 6, 6)), np.empty(1)
    arrays = [shaped(settings, _POSE), shaped(damping, _DAMPING), covariance, scale]
    inputs, outputs, rest = ([at(each) for each in part] for part in (given, (turn, shift, chi2), arrays))
    count = loaded.estimate_pose(n, k, *inputs, flat, *outputs, steps, *rest)
    if count < 0:
        raise MemoryError("no memory for a pose")
    return turn[:count], shift[:count], chi2[:count], covariance, float(scale[0])


def homography(points: Array, image: Array) -> Array:
    """Return the homography (3, 3) from points (n, 2) to their images (n, 2): see kernel_pose.c."""
    loaded = library()
    assert loaded is not None
    n, found = len(points), np.empty((3, 3))
    loaded.homography(n, *(at(each) for each in (shaped(points, n, 2), shaped(image, n, 2), found)))
    return found


def judge_poses(
    labels: NDArray[np.intp],
    ellipses: tuple[Array, Array | None],
    predicted: tuple[Array, Array, NDArray[np.bool_]],
    printing: Array,
    settings: tuple[float, ...],
) -> tuple[NDArray[np.intp], Array]:
    """Return missing dots and largest misfits (k,) of labelings (k, n): see kernel_pose.c, twin in identification.py.

    Parameters
    ----------
    ellipses : tuple
        Centers (b, 2), and additional misfits (b,) or None.
    predicted : tuple
        Pixels (k, n, 2), shapes (k, n, 2, 2), and which are seen (k, n).
    printing : array (k,), px
    settings : tuple
        As in kernel_pose.c.
    """
    loaded = library()
    assert loaded is not None
    (k, n), (center, rough), (pixels, shape, seen) = labels.shape, ellipses, predicted
    arrays = [
        indices(labels, len(center), k, n, least=-1),
        shaped(center, len(center), 2),
        None if rough is None else shaped(rough, len(center)),
        shaped(pixels, k, n, 2),
        shaped(shape, k, n, 2, 2),
        shaped(seen, k, n, dtype=np.bool_),
        shaped(printing, k),
        shaped(settings, _JUDGE),
    ]
    missing, bound = np.empty(k, dtype=np.int64), np.empty(k)
    loaded.judge_poses(k, n, *(None if each is None else at(each) for each in (*arrays, missing, bound)))
    return missing, bound
