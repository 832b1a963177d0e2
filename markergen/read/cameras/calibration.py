"""Make a camera from calibration values: lens models by all formats' names, camera matrix, and image size.

In every format the values have to be consistent: a matrix for another image size, skew, or a misspelled distortion is
refused with its place in the file.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import CameraRecord
from markergen.read.cameras.document import Fields

MATRIX = ("camera_matrix", "K", "intrinsic_matrix", "mtx")
COEFFICIENTS = ("distortion_coefficients", "D", "dist_coeffs", "distortion_coeffs", "dist")
MODEL = ("distortion_model",)
WIDTH, HEIGHT = ("image_width", "width"), ("image_height", "height")
SIZE = ("image_size", "resolution", "img_size")
"""Keys used by OpenCV, by ROS, and in hand-written files."""

SHORTEST, LONGEST = 1e-3, 1e6
"""Range of focal lengths in image sides: fields of view from nearly 180 degrees to a fifth of an arc second."""


def calibrated_camera(table: Fields, model: str) -> Camera:
    """Make a camera from a table with matrix, coefficients and image size; `model` names the distortion model."""
    key = table.key(*MATRIX)
    coefficients_key = table.find(*COEFFICIENTS)
    model_key = table.find(*MODEL) or coefficients_key or ""
    matrix = entries(table, key, (3, 3))
    coefficients = [] if coefficients_key is None else entries(table, coefficients_key, None)
    if coefficients_key is None:
        # A misspelled key must not yield a camera without distortion.
        similar = [key for key in table.values if re.search("dist|coef", key, re.IGNORECASE) and key != model_key]
        if similar or model not in ("", "none"):
            problem = f"only {brief(similar[0])}" if similar else "none"
            raise InputError(f"the key {COEFFICIENTS[0]} in {table.place()}", problem, "add it, or check the path")
    distortion = make_distortion(model, coefficients, table.place(model_key), table.place(coefficients_key or ""))
    size_key, width, height = _size(table)
    pinhole = pinhole_of(matrix, table.place(key))
    return make_camera(width, height, pinhole, distortion, table.place(key), table.place(size_key))


def camera_of_arrays(matrix: Any, distortion: Any, size: Any, fisheye: bool = False) -> Camera:
    """Make a camera from OpenCV's arrays; see `Camera.from_cv2`."""
    square = _array(matrix, "matrix")
    if square.shape != (3, 3):
        raise InputError("a 3x3 camera matrix", f"an array of shape {square.shape}", "give cv2's camera matrix")
    coefficients = np.zeros(0) if distortion is None else _array(distortion, "distortion")
    if coefficients.ndim > 2 or coefficients.size != max(coefficients.shape, default=0):
        shape = f"an array of shape {coefficients.shape}"
        raise InputError("distortion coefficients in one row or column", shape, "give cv2's distortion coefficients")
    sides = _array(size, "size")
    if sides.shape != (2,) or not (sides == np.round(sides)).all():
        raise InputError("a size (width, height) in px", brief(size), "for an image, image.shape[1::-1]")
    lens = make_distortion("fisheye" if fisheye else "", coefficients.ravel().tolist(), "fisheye", "distortion")
    width, height = (int(side) for side in sides)
    return make_camera(width, height, pinhole_of(square.ravel().tolist(), "matrix"), lens, "matrix", "size")


def _array(values: Any, name: str) -> "np.ndarray[Any, np.dtype[np.float64]]":
    try:
        array = np.asarray(values)
        if array.dtype.kind in "iuf" and np.isfinite(array).all():
            return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"an array of finite numbers as {name}", brief(values), "give what cv2 returns")


def _size(table: Fields) -> tuple[str, int, int]:
    if table.find(*WIDTH) is None and (key := table.find(*SIZE)) is not None:
        size = table.numbers(key)
        if len(size) != 2 or not all(side.is_integer() for side in size):
            raise InputError(f"width and height at {table.place(key)}", brief(size), "correct the file")
        return key, int(size[0]), int(size[1])
    width, height = table.whole(*WIDTH), table.whole(*HEIGHT)
    return f"{table.key(*WIDTH)} and {table.key(*HEIGHT)}", width, height


def entries(table: Fields, key: str, shape: tuple[int, int] | None) -> list[float]:
    """Entries, row by row, of a plain list or a mapping with rows, cols and data; a vector if `shape` is None."""
    if not isinstance(table.values[key], dict):
        return table.numbers(key)
    matrix = table.fields(key)
    rows, columns, data = matrix.whole("rows"), matrix.whole("cols"), matrix.numbers("data")
    if rows * columns != len(data):
        raise InputError(
            f"rows times cols numbers at {matrix.place('data')}",
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


@contextmanager
def with_place(place: str) -> Iterator[None]:
    """Add the place in the file to an error about a value."""
    try:
        yield
    except InputError as error:
        expected, problem, remedy = error.args
        raise InputError(f"{expected} at {place}", problem, remedy) from None


def make_distortion(name: str, coefficients: Sequence[float], model_place: str, place: str) -> Distortion:
    """Make the distortion of a model given by any of its names, or, without a name, of OpenCV's by coefficient count.

    `model_place` and `place` locate the name and the coefficients in the file.
    """
    model = ("radtan" if len(coefficients) < 8 else "rational") if name == "" else _named(name.lower(), model_place)
    # Without coefficients a fisheye is still not a pinhole camera: its image is linear in the angle.
    if not coefficients and LENSES[model].opencv:
        return Distortion()
    # OpenCV pads with zeros: 12 coefficients include thin prisms, 14 also a tilted sensor.
    most = max(map(len, LENSES[model].coefficients))
    cut = coefficients if any(coefficients[most:]) else coefficients[:most]
    with with_place(place):
        if len(cut) in (12, 14) and model == "rational":
            raise InputError(
                "no thin prism and no tilted sensor, coefficients 9 to 14",
                f"{len(cut)} coefficients that are not 0",
                "calibrate without these terms",
            )
        return Distortion(model, tuple(cut))


def _named(name: str, place: str) -> str:
    """Name in `Distortion` of a model, from its name in ROS, Kalibr or OpenCV code."""
    if name in LENSES:
        with with_place(place):
            LENSES[name]  # Raises if the model is a broken plug-in.
        return name
    aliases = {alias: model for model in LENSES for alias in LENSES[model].aliases}
    if name not in aliases:
        names = dict.fromkeys(word for model in LENSES for word in (model, *LENSES[model].aliases))
        raise InputError(f"a known distortion model at {place}", brief(name), f"known: {', '.join(names)}")
    return aliases[name]


def make_camera(
    width: int,
    height: int,
    matrix: tuple[float, float, float, float],
    distortion: Distortion,
    place: str,
    size_place: str,
) -> Camera:
    """Make a camera from an image size and (fx, fy, cx, cy); `place` and `size_place` locate them in the file.

    Raises
    ------
    InputError
        As `Camera` does, if the focal lengths are implausible, or if the principal point is outside the image: then
        size and matrix belong to different cameras or resolutions, or width and height are swapped.
    """
    fx, fy, cx, cy = matrix
    with with_place(size_place):
        Camera(width, height, 1.0, 1.0, 0.0, 0.0)
    with with_place(place):
        camera = Camera(width, height, fx, fy, cx, cy, distortion)
        if not (SHORTEST * width <= fx <= LONGEST * width and SHORTEST * height <= fy <= LONGEST * height):
            raise InputError(
                f"focal lengths in px plausible for an image of {width}x{height} px",
                f"fx={fx}, fy={fy}",
                "check the camera matrix; are these mm?",
            )
        if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise InputError(
                f"a principal point inside the image of {width}x{height} px",
                f"cx={cx}, cy={cy}",
                "give the calibration of this image size",
            )
    return camera


def pinhole_of(matrix: Sequence[float], place: str) -> tuple[float, float, float, float]:
    """Return (fx, fy, cx, cy) from the nine entries of a camera matrix, row by row.

    Raises
    ------
    InputError
        If it is not of the form [fx 0 cx; 0 fy cy; 0 0 1]: skew is not modeled, and Matlab's matrix is the transpose.
    """
    if len(matrix) != 9:
        raise InputError(f"a 3x3 camera matrix at {place}", f"{len(matrix)} numbers", "correct the file")
    fx, skew, cx, a, fy, cy, b, c, last = matrix
    # Rounding may leave traces of skew far below a pixel.
    if not (abs(skew) <= 1e-9 * abs(fx) and a == b == c == 0 and last == 1) and any(matrix):
        raise InputError(
            f"a camera matrix [fx 0 cx; 0 fy cy; 0 0 1] at {place}",
            f"[{fx} {skew} {cx}; {a} {fy} {cy}; {b} {c} {last}]",
            "transpose it if it is Matlab's, or calibrate without skew",
        )
    return fx, fy, cx, cy


def without_k3(record: CameraRecord) -> CameraRecord:
    """Return a record with the four coefficients of a radtan lens whose fifth is 0 and taken as exact."""
    lens, covariance = record.camera.distortion, record.covariance
    is_free = covariance is None or not covariance[-1].any()
    if lens.model != "radtan" or len(lens.coefficients) == 4 or lens.coefficients[4] or not is_free:
        return record
    camera = replace(record.camera, distortion=Distortion("radtan", lens.coefficients[:4]))
    return replace(record, camera=camera, covariance=None if covariance is None else covariance[:-1, :-1])


def no_choice(file: str, choice: str | None) -> None:
    """Refuse the name of a camera in a file that holds one."""
    if choice is not None:
        raise InputError(f"no camera name after {file}", brief(choice), "leave it out: the file holds one camera")
