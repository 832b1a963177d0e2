"""From numbers of a file to poses: every way to write a rotation becomes a quaternion, and what is none is refused."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.recorded_poses import COLUMNS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Place = Callable[[int], str]
"""Where the pose of that index stands, for messages: ``line 7 of poses.csv``."""

LARGEST_DISTANCE = 1e6
"""Largest coordinate of a translation in m."""

TOLERANCE = 1e-3
"""How far the length of a quaternion may be from 1, and R'R from the identity: some files round to three digits."""

DECIMALS = 12
"""Of the numbers that are kept: pm and 1e-12 rad."""

TRANSLATION = ("tx", "ty", "tz")
ROTATIONS = (
    ("qx", "qy", "qz", "qw"),
    ("rx", "ry", "rz"),
    ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"),
)
"""Columns of the ways to write a rotation: quaternion, rotation vector in rad, matrix row by row."""

WANTED = "tx ty tz and one of qx qy qz qw, rx ry rz, r11 r12 r13 r21 r22 r23 r31 r32 r33"


def numbers_of(translation: Array, rotation: Array, place: Place) -> Array:
    """Numbers (P, 7) of `RecordedPoses`, for translations (P, 3) in m and rotations (P, 4), (P, 3) or (P, 9).

    Quaternions come as x y z w, rotation vectors in rad, matrices row by row. Both q and -q are the same rotation;
    the one with w of 0 or more is taken.

    Raises
    ------
    InputError
        If a number is not finite, a place is beyond 1000 km, a quaternion is not of length 1, a rotation vector is
        longer than a whole turn, or a matrix is no rotation.
    """
    for values in (translation, rotation):
        _refuse(np.any(~np.isfinite(values), axis=-1), "finite numbers", values, place)
    _refuse(
        np.any(np.abs(translation) > LARGEST_DISTANCE, axis=-1), "a translation of at most 1000 km", translation, place
    )
    quaternion = {4: _unit, 3: _of_vectors, 9: _of_matrices}[rotation.shape[-1]](rotation, place)
    quaternion = quaternion * np.where(quaternion[:, 3:] < 0, -1.0, 1.0)
    # A sum with 0.0 takes the sign from a zero.
    return np.round(np.concatenate([translation, quaternion], axis=-1), DECIMALS) + 0.0


def inverses(numbers: Array) -> Array:
    """Numbers (P, 7) of the inverse poses."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(numbers[:, 3:]).inv()
    back = np.concatenate([-turn.apply(numbers[:, :3]), turn.as_quat(canonical=True)], axis=-1)
    return np.round(back, DECIMALS) + 0.0


def numbers_of_rows(rows: Sequence[str]) -> Array:
    """Numbers (P, 7) that `RecordedPoses.as_dict` has written, to the last bit; raises InputError for other rows."""

    def place(index: int) -> str:
        return f"row {index}"

    values = np.empty((len(rows), 7))
    for index, row in enumerate(rows):
        try:
            values[index] = [float(word) for word in row.split()]
        except ValueError:
            raise InputError(f"7 numbers {COLUMNS} at {place(index)}", brief(row), "correct the row") from None
    numbers_of(values[:, :3], values[:, 3:], place)
    return values


def _unit(quaternion: Array, place: Place) -> Array:
    # Clipped, because the square of a long one may be beyond what a double holds.
    length = np.linalg.norm(np.clip(quaternion, -2, 2), axis=-1)
    _refuse(np.abs(length - 1) > TOLERANCE, "a quaternion qx qy qz qw of length 1", quaternion, place)
    return quaternion / length[:, None]


def _of_vectors(vectors: Array, place: Place) -> Array:
    from scipy.spatial.transform import Rotation

    whole = 2 * np.pi + TOLERANCE
    # Degrees are told by being too large.
    angle = np.linalg.norm(np.clip(vectors, -whole, whole), axis=-1)
    beyond = (angle > whole) | (np.abs(vectors).max(axis=-1) > whole)
    _refuse(beyond, "a rotation vector rx ry rz in rad, at most a whole turn", vectors, place)
    quaternions: Array = Rotation.from_rotvec(vectors).as_quat()
    return quaternions


def _of_matrices(rows: Array, place: Place) -> Array:
    from scipy.spatial.transform import Rotation

    matrices = np.clip(rows, -2, 2).reshape(-1, 3, 3)
    off = np.abs(matrices.swapaxes(-1, -2) @ matrices - np.eye(3)).max(axis=(-2, -1))
    _refuse(off > TOLERANCE, "a rotation matrix r11..r33 with R'R = I", rows, place)
    _refuse(np.linalg.det(matrices) < 0, "a rotation matrix r11..r33, not a reflection", rows, place)
    quaternions: Array = Rotation.from_matrix(matrices).as_quat()
    return quaternions


def _refuse(bad: Mask, wanted: str, values: Array, place: Place) -> None:
    if bad.any():
        index = int(np.argmax(bad))
        found = " ".join(f"{value:.6g}" for value in values[index])
        raise InputError(f"{wanted} at {place(index)}", found, "correct the file")
