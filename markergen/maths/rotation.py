"""Rotations: exponential map, angles between rotations, planar turns."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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


def angle_between(first: Array, second: Array) -> Array:
    """Angle in rad of first^T second, for rotation matrices (..., 3, 3).

    Uses |first - second|_F = 2 sqrt(2) sin(angle/2), which keeps its digits at small angles where the trace
    formula loses half of them. Entries that are not finite give nan.
    """
    chord = np.sqrt(np.sum((first - second) ** 2, axis=(-2, -1))) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.minimum(chord, 1.0))


def turn_z(angles: Array | float) -> Array:
    """Rotation matrices (..., 3, 3) about the z axis by angles (...) in rad."""
    angle = np.asarray(angles, dtype=float)
    return exponential(np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=-1))
