"""Rotations in space, and least-squares alignments in the plane: rigid, mirrored, or scaled."""

import numpy as np

from markergen.arrays import Array


def skew(vectors: Array) -> Array:
    """Return [v]x with [v]x w = v x w, shape (..., 3, 3), for vectors of shape (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(vectors, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def exponential(vectors: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in rad (Rodrigues' formula).

    exp([v]x) = I + sinc(a) [v]x + (1 - cos a)/a^2 [v]x^2 with a = |v|; exact at a = 0.
    """
    cross = skew(vectors)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    half_sinc = np.sinc(angle / (2 * np.pi))
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half_sinc**2 * (cross @ cross)


def logarithm(rotations: Array) -> Array:
    """Rotation vectors (..., 3) in rad of rotation matrices (..., 3, 3), angle in [0, pi).

    Goes through the quaternion's vector part, so it is accurate near the identity; at exactly pi the sign of
    the axis is arbitrary.
    """
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(rotations, dtype=float)
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec().reshape(*matrices.shape[:-2], 3)


def left_jacobian(vectors: Array) -> Array:
    """Matrices J (..., 3, 3) of rotation vectors v (..., 3) in rad: exp([v + d]x) = exp([J d]x) exp([v]x), d small.

    J = I + (1 - cos a)/a^2 [v]x + (a - sin a)/a^3 [v]x^2 with a = |v|; the series where a is small.
    """
    cross = skew(vectors)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    half_sinc = np.sinc(angle / (2 * np.pi))
    # Below 0.01 rad the difference loses digits, and the series' next term is below 1e-10.
    cubic = np.where(angle < 1e-2, 1 / 6 - angle**2 / 120, (angle - np.sin(angle)) / np.maximum(angle, 1e-2) ** 3)
    return np.eye(3) + 0.5 * half_sinc**2 * cross + cubic * (cross @ cross)


def angle_between(first: Array, second: Array) -> Array:
    """Angle in rad of first^T second, for rotation matrices (..., 3, 3).

    Uses |first - second|_F = 2 sqrt(2) sin(angle/2), which stays accurate at small angles, where the trace formula
    loses half of the digits. Entries that are not finite give nan.
    """
    chord = np.sqrt(np.sum((first - second) ** 2, axis=(-2, -1))) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.minimum(chord, 1.0))


def inverse_pose(pose: tuple[Array, Array]) -> tuple[Array, Array]:
    """Inverse (R', -R' t) of poses (..., 3, 3) and (..., 3)."""
    back = pose[0].swapaxes(-1, -2)
    return back, -np.einsum("...ij,...j->...i", back, pose[1])


def pose_product(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Poses (..., 3, 3) and (..., 3) of the first after the second: X -> R1 (R2 X + t2) + t1."""
    return first[0] @ second[0], np.einsum("...ij,...j->...i", first[0], second[1]) + first[1]


def rotation_z(angles: Array | float) -> Array:
    """Rotation matrices (..., 3, 3) about the z axis by angles (...) in rad."""
    angle = np.asarray(angles, dtype=float)
    return exponential(np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=-1))


def rigid_motion(source: Array, target: Array, mirror: bool = False) -> tuple[Array, Array]:
    """Rotation R and translation t that minimize the squared distances of R source + t from the target.

    Parameters
    ----------
    source, target : arrays (..., m, 2), or (m, 3)
    mirror : bool
        Take the best R of determinant -1 instead, in the plane.

    Returns
    -------
    arrays (..., 2, 2) and (..., 2), or (3, 3) and (3,)
        In the plane R is the identity, or the mirror x -> -x, where all source points or all target points coincide.
    """
    if source.shape[-1] == 3:
        from scipy.spatial.transform import Rotation

        middle, goal = source.mean(axis=0), target.mean(axis=0)
        rotation = Rotation.align_vectors(target - goal, source - middle)[0].as_matrix()
        return rotation, goal - rotation @ middle
    flip = np.array([-1.0 if mirror else 1.0, 1.0])
    middle, goal = (points.mean(axis=-2, keepdims=True) for points in (source, target))
    a, b = (source - middle) * flip, target - goal
    # In the plane the best angle has a closed form: the argument of the sum of conj(a) b as complex numbers.
    cosine = np.sum(a * b, axis=(-2, -1))
    sine = np.sum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], axis=-1)
    angle = np.arctan2(sine, cosine)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2) * flip
    return rotation, goal[..., 0, :] - (rotation @ middle[..., 0, :, None])[..., 0]


def scaled_motion(source: Array, target: Array, mirror: bool = False) -> tuple[Array, Array, Array]:
    """Rotation R, scales s along x and y of the source, translation t: target = R diag(s) source + t, least squares.

    Gauss-Newton on angle, scales and translation from the rigid motion; exact after a few steps for scales near 1.

    Parameters
    ----------
    source, target : arrays (m, 2)
        Three points or more, not all collinear.

    Returns
    -------
    arrays (2, 2), (2,) and (2,)
        Rotation, scales, translation; not finite where the points do not determine them.
    """
    rotation, _ = rigid_motion(source, target, mirror)
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    a, b = source - middle, target - goal
    scale = np.ones(2)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    for _ in range(20):
        moved = a * scale @ rotation.T
        columns = [moved @ quarter.T, np.outer(a[:, 0], rotation[:, 0]), np.outer(a[:, 1], rotation[:, 1])]
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
