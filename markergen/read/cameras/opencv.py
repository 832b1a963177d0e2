"""Read OpenCV's FileStorage in YAML, XML or JSON, as written by its calibration sample and many programs."""

from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat
from markergen.read.cameras.calibration import MATRIX, MODEL, camera_of, no_choice
from markergen.read.cameras.document import Document

FISHEYE = ("fisheye_model", "fisheye")


def _fits(document: Document) -> bool:
    return document.fields.find(*MATRIX) is not None and document.fields.find(*MODEL) is None


def _read(document: Document, choice: str | None) -> Camera:
    no_choice(document.name, choice)
    table = document.fields
    key = table.find(*FISHEYE)
    # A flag is a number in FileStorage and a word in hand-written files.
    fisheye = key is not None and str(table.values[key]).strip().lower() not in ("0", "false", "no", "")
    return camera_of(table, "fisheye" if fisheye else "")


CAMERA_FORMATS.register("opencv")(CameraFormat("camera_matrix, distortion_coefficients, image_width", _fits, _read))
