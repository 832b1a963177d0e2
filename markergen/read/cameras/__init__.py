"""Read cameras from calibration files, in formats that are recognized by content, not by name."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from markergen.errors import InputError, brief
from markergen.files import exists
from markergen.guard import read
from markergen.model.camera import Camera
from markergen.read.cameras.document import Document, document_of
from markergen.registry import Registry

__all__ = ["CAMERA_FORMATS", "CameraFormat", "load_camera", "read_camera"]


@dataclass(frozen=True)
class CameraFormat:
    """A calibration file format.

    Attributes
    ----------
    signs : str
        Typical contents of such a file, for the message that no format fits.
    fits : callable
        Tells whether a document has this format; true for exactly one format if a file is usable.
    read : callable
        Makes a camera from a document; the second argument names one of several cameras, or is None.
    """

    signs: str
    fits: Callable[[Document], bool]
    read: Callable[[Document, str | None], Camera]


CAMERA_FORMATS: Registry[CameraFormat] = Registry("camera format", __name__, "markergen.camera_formats", CameraFormat)
"""Formats by name."""


def load_camera(source: object) -> Camera:
    """Read a camera from a path, an open file, or a mapping of a file's values; see `Camera.load`."""
    if isinstance(source, str | os.PathLike):
        return read_camera(source)
    if isinstance(source, Mapping):
        return _camera_of(document_of(source, "the dict"), None)
    if callable(getattr(source, "read", None)):
        return _camera_of(Document(*read(source, "camera")), None)
    raise InputError(
        "a path, an open file or a dict of a calibration",
        f"{type(source).__name__} {brief(source)}",
        "Camera.from_message takes a CameraInfo, Camera.from_cv2 a matrix",
    )


def read_camera(path: str | os.PathLike[str]) -> Camera:
    """Read the camera of a calibration file: OpenCV, ROS, Kalibr, COLMAP or a table of plain numbers.

    ``path#NAME`` selects one of several cameras in a file, such as ``camchain.yaml#cam1`` or ``cameras.txt#2``. The
    principal point is converted to the convention of `Camera`: pixel centers at integers.

    Raises
    ------
    InputError
        If the file cannot be read, has no known format, or is incomplete or inconsistent; the message names file and
        key.
    """
    path, choice = _split(Path(path))
    return _camera_of(Document(*read(path, "camera")), choice)


def _camera_of(document: Document, choice: str | None) -> Camera:
    for name in CAMERA_FORMATS:
        if CAMERA_FORMATS[name].fits(document):
            return CAMERA_FORMATS[name].read(document, choice)
    known = "; ".join(f"{name}: {CAMERA_FORMATS[name].signs}" for name in CAMERA_FORMATS)
    raise InputError(f"a camera in {document.name}", "an unknown format", f"known formats: {known}")


def _split(path: Path) -> tuple[Path, str | None]:
    stem, mark, choice = path.name.rpartition("#")
    if not mark or not stem or exists(path):
        return path, None
    return path.with_name(stem), choice
