"""Camera matrix and distortion coefficients as OpenCV and ROS write them, which is nearly the same."""

import re
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras.document import Table
from markergen.read.cameras.models import make_camera, make_distortion, pinhole_of

MATRIX = ("camera_matrix", "K", "intrinsic_matrix", "mtx")
COEFFICIENTS = ("distortion_coefficients", "D", "dist_coeffs", "distortion_coeffs", "dist")
MODEL = ("distortion_model",)
WIDTH, HEIGHT = ("image_width", "width"), ("image_height", "height")
SIZE = ("image_size", "resolution", "img_size")


def camera_of(table: Table, model: str) -> Camera:
    """Camera of a table with matrix, coefficients and image size; `model` names the distortion model."""
    key = table.key(*MATRIX)
    coefficients_key = table.find(*COEFFICIENTS)
    model_key = table.find(*MODEL) or coefficients_key or ""
    matrix = _entries(table, key, (3, 3))
    coefficients = [] if coefficients_key is None else _entries(table, coefficients_key, None)
    if coefficients_key is None:
        # What is misspelled must not become a camera without distortion.
        near = [key for key in table.values if re.search("dist|coef", key, re.IGNORECASE) and key != model_key]
        if near or model not in ("", "none"):
            found = f"only {brief(near[0])}" if near else "none"
            raise InputError(f"the key {COEFFICIENTS[0]} in {table.place()}", found, "add it, or check the path")
    distortion = make_distortion(model, coefficients, table.place(model_key), table.place(coefficients_key or ""))
    size_key, width, height = _size(table)
    pinhole = pinhole_of(matrix, table.place(key))
    return make_camera(width, height, pinhole, distortion, table.place(key), table.place(size_key))


def camera_of_arrays(matrix: Any, distortion: Any, size: Any, fisheye: bool = False) -> Camera:
    """Camera of OpenCV's arrays; see `Camera.from_cv2`."""
    entries = _array(matrix, "matrix")
    if entries.shape != (3, 3):
        raise InputError("a 3x3 camera matrix", f"an array of shape {entries.shape}", "give cv2's camera matrix")
    coefficients = np.zeros(0) if distortion is None else _array(distortion, "distortion")
    if coefficients.ndim > 2 or coefficients.size != max(coefficients.shape, default=0):
        found = f"an array of shape {coefficients.shape}"
        raise InputError("distortion coefficients in one row or column", found, "give cv2's distortion coefficients")
    sides = _array(size, "size")
    if sides.shape != (2,) or not (sides == np.round(sides)).all():
        raise InputError("a size (width, height) in px", brief(size), "of an image it is image.shape[1::-1]")
    lens = make_distortion("fisheye" if fisheye else "", coefficients.ravel().tolist(), "fisheye", "distortion")
    width, height = (int(side) for side in sides)
    return make_camera(width, height, pinhole_of(entries.ravel().tolist(), "matrix"), lens, "matrix", "size")


def _array(values: Any, name: str) -> "np.ndarray[Any, np.dtype[np.float64]]":
    try:
        array = np.asarray(values)
        if array.dtype.kind in "iuf" and np.isfinite(array).all():
            return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"an array of finite numbers as {name}", brief(values), "give what cv2 returns")


def _size(table: Table) -> tuple[str, int, int]:
    if table.find(*WIDTH) is None and (key := table.find(*SIZE)) is not None:
        size = table.numbers(key)
        if len(size) != 2 or not all(side.is_integer() for side in size):
            raise InputError(f"width and height at {table.place(key)}", brief(size), "correct the file")
        return key, int(size[0]), int(size[1])
    width, height = table.whole(*WIDTH), table.whole(*HEIGHT)
    return f"{table.key(*WIDTH)} and {table.key(*HEIGHT)}", width, height


def _entries(table: Table, key: str, shape: tuple[int, int] | None) -> list[float]:
    """Entries row by row of a matrix with rows, cols and data, or of a plain list; a vector if no shape is given."""
    if not isinstance(table.values[key], dict):
        return table.numbers(key)
    matrix = table.table(key)
    rows, columns, data = matrix.whole("rows"), matrix.whole("cols"), matrix.numbers("data")
    if rows * columns != len(data):
        raise InputError(
            f"as many numbers as rows times cols at {matrix.place('data')}",
            f"{rows} x {columns} and {len(data)} numbers",
            "correct the file",
        )
    if shape is not None and (rows, columns) != shape:
        raise InputError(
            f"{shape[0]} rows and {shape[1]} cols at {table.place(key)}", f"{rows} x {columns}", "correct the file"
        )
    if shape is None and len(data) and 1 not in (rows, columns):
        raise InputError(f"one row or one column at {table.place(key)}", f"{rows} x {columns}", "correct the file")
    return data
