"""Read arrays of poses in .npy files: T_camera_marker, as arrays are in Python."""

# tests: tests/read/test_pose_arrays.py

import io
import warnings

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.read.poses import POSE_FORMATS, PoseFormat, numbers_of_arrays
from markergen.read.poses.conventions import MARKER_IN_CAMERA, RawPoses, scale_of
from markergen.read.poses.rows import MOST_ROWS, RowsFile

MAGIC = b"\x93NUMPY"
MATRICES = {12: (3, 4), 16: (4, 4)}
"""Shapes of matrices [R t] by the count of their numbers, where a row has a matrix."""


def _array(data: bytes) -> Array | None:
    """Array of numbers in a .npy file; None if it is something else, or has fewer than it claims."""
    if not data.startswith(MAGIC):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.load(io.BytesIO(data), allow_pickle=False, max_header_size=1000)
    except Exception:  # The header is Python code, whose parsers raise a dozen kinds of errors on damaged text.
        return None
    return values.astype(float) if values.dtype.kind in "fiu" else None


def _is_poses(file: RowsFile) -> bool:
    """True for shapes of poses: a camera's matrix, its covariance and its standard deviations have others."""
    values = _array(file.data)
    if values is None:
        return False
    shape = values.shape
    return shape == (4, 4) or shape[1:] in ((4, 4), (3, 4), (2, 3), (2, 3, 1), (12,), (16,))


def _read(file: RowsFile) -> RawPoses:
    values = _array(file.data)
    assert values is not None
    if len(values) > MOST_ROWS:
        raise InputError(f"at most {MOST_ROWS} poses in {file.name}", str(len(values)), "take every tenth pose")
    if values.ndim == 2 and values.shape != (4, 4):
        values = values.reshape(-1, *MATRICES[values.shape[1]])
    if values.shape[1:] == (3, 4):
        last = np.broadcast_to([[0.0, 0.0, 0.0, 1.0]], (len(values), 1, 4))
        values = np.concatenate([values, last], axis=1)
    scale = scale_of(file.convention, "", file.name)
    return RawPoses(numbers_of_arrays(values, scale, f"pose {{}} of {file.name}"), MARKER_IN_CAMERA)


POSE_FORMATS.register("npy")(PoseFormat("matrices (k, 4, 4)", _is_poses, _read))
