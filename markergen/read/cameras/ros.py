"""ROS camera_info, as saved by camera_calibration or as a printed message.

K applies to the raw image; P applies to the rectified image and is ignored. In files that are written the rectified
image has the K of the raw one.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

from collections.abc import Mapping
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraRecord
from markergen.read.cameras.calibration import calibrated_camera
from markergen.read.cameras.document import document_of, yaml_text
from markergen.read.cameras.keys import keyed
from markergen.read.cameras.names import KEYS

FIELDS = ("height", "width", "distortion_model", "D", "d", "K", "k", "binning_x", "binning_y", "roi")
"""Relevant fields of a message, in ROS 1 and 2."""

MODELS = {"none": "plumb_bob", "radtan": "plumb_bob", "rational": "rational_polynomial", "equidistant": "equidistant"}
"""Names that sensor_msgs has for our lens models."""


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
        values = {**values, "roi": _attributes(roi, KEYS["part"])}
    return calibrated_camera(document_of(values, "the CameraInfo").fields)


def _attributes(message: Any, names: tuple[str, ...]) -> dict[str, Any]:
    values = {name: getattr(message, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None}


CAMERA_FORMATS.register("ros")(keyed("ros", (".ros.yaml", ".ros.yml"), _holds, _write))
