"""ROS camera_info, as saved by camera_calibration or as a printed message.

K applies to the raw image; P applies to the rectified image and is ignored. In files that are written the rectified
image has the K of the raw one.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import MATRIX, MODEL, calibrated_camera, make_camera, no_choice
from markergen.read.cameras.document import Document, Fields, document_of, yaml_text

FIELDS = ("height", "width", "distortion_model", "D", "d", "K", "k", "binning_x", "binning_y", "roi")
PART = ("x_offset", "y_offset", "height", "width")
"""Relevant fields of a message, in ROS 1 and 2, and of its region of interest."""

MODELS = {
    "none": "plumb_bob",
    "radtan": "plumb_bob",
    "rational": "rational_polynomial",
    "equidistant": "equidistant",
}
"""Names that sensor_msgs has for our lens models."""


def _message(document: Document) -> Fields:
    """Return the message, which some tools nest in a key of its own."""
    wrapper = document.fields.find("camera_info")
    if wrapper is not None and isinstance(document.fields.values[wrapper], dict):
        return document.fields.fields(wrapper)
    return document.fields


def _fits(document: Document) -> bool:
    table = _message(document)
    return table.find(*MATRIX) is not None and table.find(*MODEL) is not None


def _read(document: Document, choice: str | None) -> Camera:
    no_choice(document.name, choice)
    table = _message(document)
    return _camera(table, [] if table is document.fields else [document.fields])


def _table(document: Document, choice: str | None) -> Fields:
    no_choice(document.name, choice)
    return _message(document)


def _holds(record: CameraRecord) -> bool:
    return record.camera.distortion.model in MODELS


def _write(record: CameraRecord, ending: str) -> str:
    del ending
    camera, coefficients = record.camera, record.camera.cv2_distortion
    if len(coefficients) == 4 and camera.distortion.model == "radtan":
        # camera_info's plumb_bob has five coefficients.
        coefficients = np.append(coefficients, 0.0)
    return yaml_text(
        {
            "image_width": camera.width,
            "image_height": camera.height,
            "camera_name": "camera",
            "camera_matrix": camera.matrix,
            "distortion_model": MODELS[camera.distortion.model],
            "distortion_coefficients": coefficients[None],
            "rectification_matrix": np.eye(3),
            "projection_matrix": np.column_stack([camera.matrix, np.zeros(3)]),
            **record.extras,
        }
    )


def camera_of_message(message: Any) -> Camera:
    """Make a camera from a CameraInfo, an object or a dict; see `Camera.from_message`."""
    if isinstance(message, Mapping):
        values = {key: value for key, value in message.items() if key in FIELDS}
    else:
        values = _attributes(message, FIELDS)
    if not values:
        problem = f"{type(message).__name__} {brief(message)}"
        raise InputError("a message sensor_msgs/CameraInfo", problem, "Camera.load reads files")
    roi = values.get("roi")
    if roi is not None and not isinstance(roi, Mapping):
        values = {**values, "roi": _attributes(roi, PART)}
    return _camera(document_of(values, "the CameraInfo").fields)


def _attributes(message: Any, names: tuple[str, ...]) -> dict[str, Any]:
    values = {name: getattr(message, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def _camera(table: Fields, around: Sequence[Fields] = ()) -> Camera:
    """Make the camera of the image as it is sent: the part of the sensor in `roi`, in pixels binned together."""
    camera = calibrated_camera(table, around)
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
    return make_camera(
        part[0] // bx,
        part[1] // by,
        (camera.fx / bx, camera.fy / by, (camera.cx - offset[0] - (bx - 1) / 2) / bx,
         (camera.cy - offset[1] - (by - 1) / 2) / by),
        camera.distortion,
        table.place(table.key(*MATRIX)),
        table.place("roi"),
    )  # fmt: skip


CAMERA_FORMATS.register("ros")(
    CameraFormat(
        "camera_matrix or K, and distortion_model", _fits, _read, _table, (".ros.yaml", ".ros.yml"), _holds, _write
    )
)
