"""Make a camera from calibration values: lens models by all formats' names, camera matrix, and image size.

In every format the values have to be consistent: a matrix for another image size, skew, or a misspelled distortion is
refused with its place in the file.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from markergen.errors import InputError, brief, with_place
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import CameraRecord
from markergen.read.cameras.document import KEYS, NAMED, Fields, NoSizeError, document_of
from markergen.read.cameras.statements import BY_COUNT, check_statements, stated_lens
from markergen.read.remarks import remark

MATRIX, COEFFICIENTS, RADIAL, TANGENTIAL, _, WIDTH, HEIGHT, SIZE, SHAPE, *PINHOLE, FOCAL, PRINCIPAL, PART = (
    KEYS.values()
)
FX, FY, CX, CY = PINHOLE

SHORTEST, LONGEST = 0.02, 1e6
"""Range of focal lengths in image sides: fields of view from nearly 180 degrees to a fifth of an arc second."""


def calibrated_camera(table: Fields, corner: float = 0.0) -> Camera:
    """Make a camera from a table with a matrix, or focal lengths and principal point; coefficients; and image size.

    The lens is the one that any key of the table names; without a name, that of OpenCV. `corner` is the coordinate of a
    pixel's center from which the principal point counts.
    """
    model, model_place = stated_lens(table)
    check_statements(table)
    key, pinhole = _pinhole(table)
    size_key, width, height = _size(table)
    distortion = _distortion(table, model, model_place, flat=key in map(table.find, FX))
    fx, fy, cx, cy = pinhole
    place = table.place(key)
    camera = make_camera(width, height, (fx, fy, cx - corner, cy - corner), distortion, place, table.place(size_key))
    return _part(table, camera, place) if table.find("roi", "binning_x", "binning_y") else camera


def _pinhole(table: Fields) -> tuple[str, tuple[float, float, float, float]]:
    """Return the key of the matrix or of fx, and fx, fy, cx, cy."""
    if table.find(*MATRIX) is not None:
        key = table.key(*MATRIX)
        value = table.values[key]
        is_vector = isinstance(value, dict) and "1" in (value.get("rows"), value.get("cols"))
        values = entries(table, key, None if is_vector else (3, 3))
        is_flat = isinstance(value, list) and not any(isinstance(row, list) for row in value)
        if len(values) == 16 and values[3] == values[7] == values[11] == 0 and values[12:] == [0, 0, 0, 1]:
            values = [*values[:3], *values[4:7], *values[8:11]]
        if len(values) == 4:
            return key, (values[0], values[1], values[2], values[3])
        # One list, column by column, as Eigen has it; rows that are columns are Matlab's, which counts from 1.
        if is_flat and len(values) == 9 and values[6] and values[7] and not (values[2] or values[5]):
            values = np.reshape(values, (3, 3)).T.ravel().tolist()
        if len(values) != 9 and "intrinsics" in key:
            raise InputError(f"fu, fv, pu, pv at {table.place(key)}", brief(values), "correct the file")
        return key, pinhole_of(values, table.place(key))
    if table.find(*FX) is None and table.find(*FOCAL) is not None:
        key = table.key(*FOCAL)
        values = table.numbers(*FOCAL)
        if len(values) < 4:
            values += table.numbers(*PRINCIPAL)
        if len(values) != 4:
            problem, expected = brief(values), "two focal lengths in px and a center"
            raise InputError(f"{expected} at {table.place(key)}", problem, "correct the file")
        return key, (values[0], values[1], values[2], values[3])
    name = table.find(*FX) or table.key(*MATRIX)
    return name, (table.number(*FX), table.number(*FY), table.number(*CX), table.number(*CY))


def _part(table: Fields, camera: Camera, place: str) -> Camera:
    """Make the camera of the image as ROS sends it: the part of the sensor in `roi`, in pixels binned together."""
    size = np.array([camera.width, camera.height])
    binning = [table.whole(axis) if table.find(axis) else 1 for axis in ("binning_x", "binning_y")]
    roi = table.fields("roi") if table.find("roi") else Fields(table.file, {})
    offset, part = ([roi.whole(key) if roi.find(key) else 0 for key in keys] for keys in (PART[:2], PART[:1:-1]))
    # Zero is the full side.
    part = [side or (0 if start else full) for side, start, full in zip(part, offset, size.tolist(), strict=True)]
    if not ((np.array(offset) >= 0) & (np.array(part) > 0) & (np.array(offset) + part <= size)).all():
        raise InputError(f"a part of the image of {size[0]}x{size[1]} px at {table.place('roi')}",
                         f"{part[0]}x{part[1]} px at {offset[0]}, {offset[1]}", "correct the file")  # fmt: skip
    if not all(0 <= count <= side for count, side in zip(binning, part, strict=True)):
        raise InputError(f"a binning at {table.place('binning_x')}", brief(binning), "correct the file")
    bx, by = (max(count, 1) for count in binning)
    # The center of a binned pixel is that of its pixels: (b - 1)/2 from the first one's.
    pinhole = (camera.fx / bx, camera.fy / by, (camera.cx - offset[0] - (bx - 1) / 2) / bx,
               (camera.cy - offset[1] - (by - 1) / 2) / by)  # fmt: skip
    return make_camera(part[0] // bx, part[1] // by, pinhole, camera.distortion, place, table.place("roi"))


def _distortion(table: Fields, stated: str, model_place: str, flat: bool) -> Distortion:
    """Make the distortion from a list of coefficients, or from single ones; in a `flat` table these may be left out."""
    model = "" if stated == BY_COUNT else stated
    if table.find(*RADIAL) and table.find(*TANGENTIAL) and table.find(*COEFFICIENTS) is None:
        radial, place = table.numbers(*RADIAL), table.place(table.key(*RADIAL))
        split = [*radial[:2], *table.numbers(*TANGENTIAL), *radial[2:]]
        return make_distortion(model, split, model_place or place, place)
    key = table.find(*COEFFICIENTS)
    if key is not None:
        coefficients = entries(table, table.key(*COEFFICIENTS), None)
        if len(coefficients) == 4 and not stated and any(coefficients):
            remark(
                f"{table.place(key)}: four coefficients without a lens's name are taken as k1 k2 p1 p2 of radtan, not "
                "as k1 k2 k3 k4 of a fisheye: add distortion_model"
            )
        return make_distortion(model, coefficients, model_place or table.place(key), table.place(key))
    terms = {name: table.number(name) for name in NAMED if table.find(name)}
    if not terms and not (flat and model):
        # A misspelled key must not yield a camera without distortion.
        similar = [key for key in table.values if re.search("dist|coef", key, re.IGNORECASE)]
        similar = [key for key in similar if table.path_of(key) not in table.used]
        if similar or model not in ("", "none"):
            problem = f"only {brief(similar[0])}" if similar else "none"
            raise InputError(f"the key {COEFFICIENTS[0]} in {table.place()}", problem, "add it, or check the path")
        is_own = {*WIDTH[:2], *HEIGHT[:2], "fx", "fy", "cx", "cy"} >= {key.rpartition(".")[2] for key in table.values}
        if model != "none" and not is_own and not (flat and model_place and not stated):
            remark(f"{table.place()}: no distortion coefficients, which is taken as no distortion")
        return Distortion()
    if not model:
        model = "rational" if {"k4", "k5", "k6"} & terms.keys() else "radtan"
        if not {"p1", "p2"} & terms.keys() and "k4" in terms and not stated:
            raise InputError(f"the lens's name beside k1 to k4 in {table.place()}", "none", "add distortion_model")
    lists = [names for names in LENSES[model].coefficients if terms.keys() <= set(names)] or [()]
    if not lists[0] and any(terms.values()):
        names = ", ".join(LENSES[model].coefficients[-1]) or "none"
        odd = next(name for name in terms if name not in LENSES[model].coefficients[-1])
        raise InputError(f"the coefficients {names} of {model} in {table.place()}", odd, "correct the file")
    if missing := [name for name in lists[0] if name not in terms]:
        remark(f"{table.place()}: no {', '.join(missing)}, which is taken as 0")
    with with_place(f"at {table.place()}"):
        return Distortion(model if lists[0] else "none", tuple(terms.get(name, 0.0) for name in lists[0]))


FIELDS = ("height", "width", "distortion_model", "D", "d", "K", "k", "binning_x", "binning_y", "roi")
"""Relevant fields of a message, in ROS 1 and 2."""


def camera_of_message(message: Any) -> Camera:
    """Make a camera from a CameraInfo, an object or a dict; see `Camera.from_message`."""
    values = _fields(message, FIELDS)
    if not values:
        problem = f"{type(message).__name__} {brief(message)}"
        raise InputError("a message sensor_msgs/CameraInfo", problem, "Camera.load reads files")
    if "roi" in values:
        values["roi"] = _fields(values["roi"], PART)
    return calibrated_camera(document_of(values, "the CameraInfo").fields)


def _fields(message: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Values of the fields that a message has, an object or a dict."""
    is_dict = isinstance(message, Mapping)
    values = {name: message.get(name) if is_dict else getattr(message, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None}


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
    lens = make_distortion("equidistant" if fisheye else "", coefficients.ravel().tolist(), "fisheye", "distortion")
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
    """Return the keys of the image size, and width and height; refuse sizes that contradict each other."""
    sizes: dict[str, tuple[int, int]] = {}
    for keys in (SIZE, SHAPE):
        if (key := table.find(*keys)) is None:
            continue
        if isinstance(table.values[key], dict):
            sides: list[float] = [table.fields(*keys).whole(*WIDTH), table.fields(*keys).whole(*HEIGHT)]
        else:
            # That of an array has rows, columns and perhaps channels.
            sides = table.numbers(*keys)[1::-1] if keys is SHAPE else table.numbers(*keys)
        if len(sides) != 2 or not all(side.is_integer() for side in map(float, sides)):
            raise InputError(f"width and height at {table.place(key)}", brief(sides), "correct the file")
        sizes[key] = int(sides[0]), int(sides[1])
    if not sizes and table.size is None and table.find(*WIDTH) is None:
        remedy = "add it, or give --image-size, that of the photographs, such as 640x480"
        raise NoSizeError(f"the key {' or '.join(WIDTH[:2])} in {table.place()}", "none", remedy)
    if table.find(*WIDTH) is not None or (not sizes and table.size is None):
        width, height = table.whole(*WIDTH), table.whole(*HEIGHT)
        sizes[f"{table.key(*WIDTH)} and {table.key(*HEIGHT)}"] = width, height
    if table.size is not None:
        sizes["--image-size"] = table.size
    if len(set(sizes.values())) > 1:
        texts = [f"{width}x{height} at {key}" for key, (width, height) in sizes.items()]
        raise InputError(f"one image size in {table.place()}", " and ".join(texts), "remove the wrong one")
    return next((key, *size) for key, size in sizes.items())


def entries(table: Fields, key: str, shape: tuple[int, int] | None) -> list[float]:
    """Entries, row by row, of a plain list or a mapping with rows, cols and data; a vector if `shape` is None."""
    if isinstance(table.values[key], str) and not table.values[key].strip():
        table.key(key)
        return []
    if not isinstance(table.values[key], dict):
        return table.numbers(key)
    matrix = table.fields(key)
    rows, columns, data = matrix.whole("rows"), matrix.whole("cols"), matrix.numbers("data")
    if rows * columns != len(data):
        expected = f"rows times cols numbers at {matrix.place('data')}"
        raise InputError(expected, f"{rows} x {columns} and {len(data)} numbers", "correct the file")
    if shape is not None and (rows, columns) != shape:
        expected = f"{shape[0]} rows and {shape[1]} cols at {table.place(key)}"
        raise InputError(expected, f"{rows} x {columns}", "correct the file")
    if shape is None and len(data) and 1 not in (rows, columns):
        raise InputError(f"one row or one column at {table.place(key)}", f"{rows} x {columns}", "correct the file")
    return data


def make_distortion(name: str, coefficients: Sequence[float], model_place: str, place: str) -> Distortion:
    """Make the distortion of a model or, without its name, of OpenCV's by the number of coefficients.

    `model_place` and `place` locate the name and the coefficients in the file.
    """
    model = name or ("radtan" if len(coefficients) < 8 else "rational")
    with with_place(f"at {model_place}"):
        lens = LENSES[model]  # Raises if the model is a broken plug-in.
    # Without coefficients a fisheye is still not a pinhole camera: its image is linear in the angle.
    if not coefficients and lens.opencv:
        return Distortion()
    # OpenCV pads with zeros: 12 coefficients include thin prisms, 14 also a tilted sensor.
    most = max(map(len, lens.coefficients))
    cut = coefficients if any(coefficients[most:]) else coefficients[:most]
    with with_place(f"at {place}"):
        if len(cut) in (12, 14) and model == "rational":
            expected = "no thin prism and no tilted sensor, coefficients 9 to 14"
            raise InputError(expected, f"{len(cut)} coefficients that are not 0", "calibrate without these terms")
        return Distortion(model, tuple(cut))


def make_camera(
    width: int,
    height: int,
    matrix: tuple[float, float, float, float],
    distortion: Distortion,
    place: str,
    size_place: str,
) -> Camera:
    """Make a camera from an image size and (fx, fy, cx, cy); `place` and `size_place` locate them in the file.

    Raises InputError as `Camera` does, if the focal lengths are implausible, or if the principal point is outside the
    image: then size and matrix belong to different cameras or resolutions, or width and height are swapped.
    """
    fx, fy, cx, cy = matrix
    with with_place(f"at {size_place}"):
        Camera(width, height, 1.0, 1.0, 0.0, 0.0)
    with with_place(f"at {place}"):
        camera = Camera(width, height, fx, fy, cx, cy, distortion)
        if not (SHORTEST * width <= fx <= LONGEST * width and SHORTEST * height <= fy <= LONGEST * height):
            expected = f"focal lengths in px plausible for an image of {width}x{height} px"
            raise InputError(expected, f"fx={fx}, fy={fy}", "check the camera matrix; are these mm?")
        if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            expected = f"a principal point inside the image of {width}x{height} px"
            raise InputError(expected, f"cx={cx}, cy={cy}", "give the calibration of this image size")
    return camera


def pinhole_of(matrix: Sequence[float], place: str) -> tuple[float, float, float, float]:
    """Return (fx, fy, cx, cy) from the nine entries of a camera matrix, row by row.

    Raises InputError if it is not of the form [fx 0 cx; 0 fy cy; 0 0 1]: skew is not modeled, and Matlab's matrix is
    the transpose.
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
