"""Rigid motions and covariances as they are given: rows of numbers, and what is refused."""
# tests: tests/model/test_rig.py tests/model/test_marker.py

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError

Rows = tuple[tuple[float, ...], ...]

ROUNDING = 1e-9
"""Tolerance for a rotation's orthonormality, and for a covariance, as correlations, to be symmetric and positive."""


def check_pose(rotation: Rows, translation: tuple[float, ...], of: str = "") -> None:
    """Refuse what is no rotation (3, 3), orthonormal to 1e-9 and not mirrored, and translation (3,) with InputError."""
    if [len(row) for row in rotation] != [3] * 3 or len(translation) != 3:
        raise InputError("a pose of 3x3 and 3 numbers", f"{len(rotation)} rows", "give rotation, translation")
    matrix = np.array(rotation)
    # Written so that nan and numbers whose squares overflow do not pass.
    bounded = bool((np.abs(matrix) <= 1 + ROUNDING).all() and np.isfinite(translation).all())
    if not (
        bounded
        and np.abs(matrix @ matrix.T - np.eye(3)).max() <= ROUNDING
        and abs(np.linalg.det(matrix) - 1) <= ROUNDING
    ):
        raise InputError(
            f"a pose {of}{' ' * bool(of)}with a rotation: three orthonormal rows and determinant 1",
            "another matrix" if bounded else "numbers out of range",
            "write it with all its digits",
        )


def check_covariance(values: Array, unit: str = "") -> None:
    """Refuse a matrix that is no covariance: finite, symmetric and positive semidefinite up to `ROUNDING`.

    The last two as correlations, as variances may differ by orders of magnitude.

    Raises
    ------
    InputError
    """
    if not np.isfinite(values).all():
        raise InputError("a finite covariance", "nan or inf", "correct it")
    variances = np.diag(values)
    if variances.min() < 0:
        raise InputError("variances of 0 or more", f"{variances.min()}{unit}", "correct the covariance")
    scale = np.sqrt(variances)
    inverse = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    correlation = values * inverse[:, None] * inverse
    certain = scale == 0
    if values[certain].any() or values[:, certain].any() or np.abs(correlation).max() > 1 + ROUNDING:
        raise InputError("a covariance", "one that exceeds its variances", "are these correlations?")
    if np.abs(correlation - correlation.T).max() > ROUNDING:
        raise InputError("a symmetric covariance", "another", "write it with all its digits")
    if np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -ROUNDING * len(correlation):
        raise InputError("a positive semidefinite covariance", "a negative eigenvalue", "write all its digits")
