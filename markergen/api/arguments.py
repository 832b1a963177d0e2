"""Conversion of the argument forms that callers may use to the one that the engines take."""
# tests: tests/api/test_compare.py tests/api/test_design.py

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.options import read_as
from markergen.options.kinds import CameraLike, MarkerLike
from markergen.read.cameras import sized
from markergen.read.cameras.covariance import camera_covariance, is_exact


def marker_of(value: MarkerLike) -> Marker:
    """Return a marker as it is, or load it from anything that `Marker.load` takes."""
    return value if isinstance(value, Marker) else Marker.load(value)


def as_camera(value: CameraLike | None) -> Camera | None:
    """Return a camera as it is, or load it from anything that `Camera.load` takes; None for None."""
    return value if value is None or isinstance(value, Camera) else Camera.load(value)


def known_camera(
    source: Any, photos: Any, settled: Mapping[str, Any], is_several: bool = False
) -> tuple[Any, Camera | None, Array | None]:
    """Return a camera's file with the size of the images, the camera, and its covariance: None where unknown.

    Raises
    ------
    InputError
        If ``settled["camera_covariance"]`` belongs to no camera, or one of several.
    """
    file = sized(source, settled["image_size"], photos if isinstance(photos, list | tuple) else [photos])
    camera, covariance = as_camera(file), settled["camera_covariance"]
    if covariance is not None and (camera is None or (is_several and not is_exact(covariance))):
        answer = ("several", "write it into the cameras' files, or give none")
        raise InputError(
            "a camera that the covariance belongs to", *(answer if is_several else ("none", "give it with --camera"))
        )
    return file, camera, None if camera is None else camera_covariance(covariance, file, camera)


def files_among(*values: object) -> list[Path]:
    """Return the values that may be input paths, which no output may overwrite."""
    return [Path(value) for value in values if isinstance(value, str | PathLike) and str(value)]


def as_path(value: object, wanted: str) -> Path:
    """Return the path of a string or path-like object; `wanted` describes it in the message.

    Raises
    ------
    InputError
        If it is anything else.
    """
    return paths_of([value], wanted)[0]


def paths_of(values: Sequence[object], wanted: str) -> list[Path]:
    """Return the paths of one or more strings or path-like objects; `wanted` describes them in the message.

    Raises
    ------
    InputError
        If there is none, or one of them is anything else.
    """
    if not values or any(value is None for value in values):
        raise InputError(wanted, "none", 'give a path, such as "marker.pdf"')
    try:
        return list(read_as("files", values, wanted))
    except InputError:
        raise InputError("a path", ", ".join(map(brief, values)), "give a text or a pathlib.Path") from None
