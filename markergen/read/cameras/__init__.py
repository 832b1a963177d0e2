"""Camera files: read in formats that are recognized by content, not by name, and written in that of the name."""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, among, brief
from markergen.files import exists
from markergen.guard import read
from markergen.model.camera import NAMED_CAMERAS, SIZE_AND_ANGLE, Camera, typical_camera
from markergen.read.cameras.document import Document, Fields, NoSizeError, document_of
from markergen.read.cameras.statements import check_order, doubts, refuse_lenses, remark_unused_keys
from markergen.read.formats import Format, recognized, refuse_unreadable, split, unknown_format
from markergen.read.images import find_images, size_in_file
from markergen.read.remarks import collected_remarks, remark
from markergen.read.videos import is_video, size_in_video
from markergen.registry import Registry

__all__ = ["CAMERA_FORMATS", "CameraFormat", "CameraRecord", "load_camera", "read_camera"]

NAMES, COVARIANCE, RMS = "camera_parameters", "camera_covariance", "avg_reprojection_error"
"""Keys, in every format, of the covariance's rows by name, the covariance, and OpenCV's RMS of the residuals."""


@dataclass(frozen=True, eq=False)
class CameraRecord:
    """A camera and what a calibration says of it besides.

    Attributes
    ----------
    covariance : array (k, k) or None
        Covariance of `Camera.parameter_names`.
    rms : float or None
        RMS of the residuals in px, of points.
    """

    camera: Camera
    covariance: NDArray[np.float64] | None = None
    rms: float | None = None

    @property
    def extras(self) -> dict[str, Any]:
        """Further keys of a file: plain numbers, a list of names, and an array (k, k)."""
        extras: dict[str, Any] = {} if self.rms is None else {RMS: self.rms}
        if self.covariance is not None:
            extras |= {NAMES: list(self.camera.parameter_names), COVARIANCE: self.covariance}
        return extras


@dataclass(frozen=True)
class CameraFormat(Format[Document, Camera, CameraRecord]):
    """A calibration file format, which is read as a camera; the second argument names one of several in a file.

    Attributes
    ----------
    holds : callable
        True if the format can hold a record: its lens, with all that is known of it.
    table : callable
        Returns the table that `CameraRecord.extras` are in, from the arguments of `read`.
    """

    holds: Callable[[CameraRecord], bool] = lambda _: True
    table: Callable[[Document, str | None], Fields] = lambda document, _: Fields(document.name, {})


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

    ``path#NAME`` selects one of several cameras in a file, such as ``camchain.yaml#cam1`` or ``cameras.txt#2``, and
    ``path#640x480`` gives the size of the images to a file without it. The principal point is converted to the
    convention of `Camera`: pixel centers at integers. `typical_camera` lists texts that stand for typical cameras.

    Raises InputError if the file cannot be read, has no known format, or is incomplete or inconsistent; the message
    names file and key.
    """
    text = str(path)
    if typical := typical_camera(text):
        return typical
    is_name = text.isalnum() or re.match(r"\d+x\d+@", text) or get_close_matches(text, NAMED_CAMERAS, cutoff=0.8)
    if is_name and not exists(Path(path)):
        remedy = among(text, [*NAMED_CAMERAS, SIZE_AND_ANGLE])
        raise InputError("a camera's file, a typical camera, or image size and angle of view", brief(text), remedy)
    return _camera_of(*sized_document(path))


_SIZE = re.compile(r"(\d{1,6})x(\d{1,6})")


def sized(source: Any, size: str | None, photos: Sequence[Any] = ()) -> Any:
    """Return the path of a camera's file with the size of its images: the one given, or that of photographs or a video.

    The first one's counts only for a file without a size; raises InputError.
    """
    if size is None and photos and isinstance(source, str | os.PathLike):
        try:
            with collected_remarks():
                load_camera(source)
        except NoSizeError:
            paths = [Path(photo) for photo in photos[:1] if isinstance(photo, str | os.PathLike)]
            is_film = bool(paths) and is_video(paths[0])
            paths = paths if is_film else find_images(paths)
            if sides := (size_in_video if is_film else size_in_file)(paths[0]):
                size = f"{sides[0]}x{sides[1]}"
                remark(f"{os.fspath(source)}: without a size of images, taken for {size} px of {paths[0].name}")
        except InputError:  # Shown where the camera is read.
            pass
    if size is None:
        return source
    if not isinstance(source, str | os.PathLike):
        actual = "no camera" if source is None else brief(source)
        raise InputError("a camera's file with --image-size", actual, "give --camera FILE, or leave it out")
    if not _SIZE.fullmatch(size):
        raise InputError("--image-size as width and height in px", brief(size), "write such as 640x480")
    return f"{os.fspath(source)}#{size}"


def sized_document(path: str | os.PathLike[str]) -> tuple[Document, str | None]:
    """Return a file's document with the size after ``#``, if there is one; or else the name of a camera there."""
    name, choice = split(os.fspath(path))
    if size := _SIZE.fullmatch(choice or ""):
        name, choice = split(name)
    return Document(*read(Path(name), "camera"), size=(int(size[1]), int(size[2])) if size else None), choice


def _camera_of(document: Document, choice: str | None) -> Camera:
    refuse_unreadable(document.name, document.data, "camera")
    if (name := recognized(CAMERA_FORMATS, document)) is None:
        refuse_lenses(document)
        raise unknown_format(CAMERA_FORMATS, document.name, "a camera")
    camera = CAMERA_FORMATS[name].read(document, choice)
    check_order(document, camera)
    remark_unused_keys(document, camera)
    for doubt in doubts(camera):
        remark(f"{document.name}: {doubt}")
    return camera
