"""Motions of the plane that bring points onto points: rigid, with a mirror, or with a scale along each axis."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rigid_motion(source: Array, target: Array, mirror: bool = False) -> tuple[Array, Array]:
    """Rotation R and shift t for which the squared distances of R source + t from the target are least.

    Parameters
    ----------
    source, target : arrays (..., m, 2)
    mirror : bool
        Take the best R of determinant -1 instead.

    Returns
    -------
    arrays (..., 2, 2) and (..., 2)
        The identity, or the mirror x -> -x, where all points of one side are the same.
    """
    flip = np.array([-1.0 if mirror else 1.0, 1.0])
    middle, goal = (points.mean(axis=-2, keepdims=True) for points in (source, target))
    a, b = (source - middle) * flip, target - goal
    # In the plane the best angle has a closed form: that of the sum of conj(a) b as complex numbers.
    cosine = np.sum(a * b, axis=(-2, -1))
    sine = np.sum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], axis=-1)
    angle = np.arctan2(sine, cosine)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2) * flip
    return rotation, goal[..., 0, :] - (rotation @ middle[..., 0, :, None])[..., 0]


def scaled_motion(source: Array, target: Array, mirror: bool = False) -> tuple[Array, Array, Array]:
    """Rotation R, scales s along x and y of the source, and shift t: target = R diag(s) source + t, least squares.

    Gauss-Newton on angle, scales and shift from the rigid motion; it is exact after a few steps for scales near 1.

    Parameters
    ----------
    source, target : arrays (m, 2)
        Three points or more, not on one line.

    Returns
    -------
    arrays (2, 2), (2,) and (2,)
        Rotation, scales, shift; not finite where the points do not determine them.
    """
    rotation, _ = rigid_motion(source, target, mirror)
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    a, b = source - middle, target - goal
    scale = np.ones(2)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    for _ in range(20):
        moved = a * scale @ rotation.T
        columns = [moved @ turn.T, np.outer(a[:, 0], rotation[:, 0]), np.outer(a[:, 1], rotation[:, 1])]
        jacobian = np.stack([column.ravel() for column in columns], axis=-1)
        step, _, rank, _ = np.linalg.lstsq(jacobian, (b - moved).ravel(), rcond=1e-9)
        if rank < 3:
            return rotation, np.full(2, np.nan), np.full(2, np.nan)
        c, s = np.cos(step[0]), np.sin(step[0])
        rotation = np.array([[c, -s], [s, c]]) @ rotation
        scale = scale + step[1:]
        if float(np.abs(step).max()) < 1e-14:
            break
    return rotation, scale, goal - rotation @ (scale * middle)
