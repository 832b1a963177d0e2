"""From what users have, as an object, a path or a dictionary, to the objects that everything else works with."""

import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.marker_json import from_json, read_marker
from markergen.model.poses import PoseDistribution
from markergen.options import read_as
from markergen.read.cameras import read_camera
from markergen.read.poses import poses_from, read_poses
from markergen.read.spec_file import spec_from_mapping

MarkerLike = Marker | str | PathLike[str] | Mapping[str, Any]
"""A marker, the path of its marker.json, or what is in it."""


def marker_from(given: object) -> Marker:
    """Return a marker as it is, of a path, or of a dictionary in the form of marker.json.

    Raises
    ------
    InputError
        If it is nothing of that, or the file is no marker.
    """
    if isinstance(given, Marker):
        return given
    if isinstance(given, Mapping):
        try:
            return from_json(json.dumps(dict(given)), "the dictionary")
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError("a dictionary as in marker.json", str(error), "give it plain JSON values") from None
    return read_marker(_path(given, "a marker: a Marker, the path of its marker.json, or a dictionary as in one"))


def camera_from(given: object) -> Camera | None:
    """Return a camera as it is, of a path, or of a dictionary as in marker.json; None for None.

    Raises
    ------
    InputError
        If it is nothing of that, or the file holds no camera.
    """
    if given is None or isinstance(given, Camera):
        return given
    if isinstance(given, Mapping):
        return spec_from_mapping({"camera": dict(given)}, "the dictionary").camera
    return read_camera(_path(given, "a camera: a Camera, the path of a calibration file, or a dictionary"))


def poses_of(given: object) -> str | PoseDistribution | None:
    """Return poses as they are, or of a path; None for None. A text is a preset, a cone, or a path.

    Raises
    ------
    InputError
        If it is nothing of that, or the file holds no poses.
    """
    if given is None or isinstance(given, PoseDistribution):
        return given
    if isinstance(given, str):
        return poses_from(given)
    return read_poses(_path(given, "poses: a text such as 'paper' or 'cone:tilt=0..60', a path, or a PoseDistribution"))


def files_among(*given: object) -> list[Path]:
    """Return those of the arguments that are paths or texts, so that no output is written over them."""
    return [Path(each) for each in given if isinstance(each, str | PathLike) and each]


def _path(given: object, expected: str) -> Path:
    try:
        path: Path = read_as("file", given, "")
    except InputError as error:
        raise InputError(expected, error.args[1], "see help() of the function") from None
    return path
