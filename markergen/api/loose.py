"""What callers may give in several forms, made into the one that the engines take."""

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.findings import brief
from markergen.model.marker import Marker
from markergen.model.marker_json import from_json, read_marker
from markergen.model.poses import PoseDistribution
from markergen.read.cameras import read_camera
from markergen.read.poses import poses_from, read_poses
from markergen.read.spec_file import spec_from_mapping

MarkerLike = Marker | str | PathLike[str] | dict[str, Any]
"""A marker, the path of its marker.json, or what is in it."""


def marker_of(value: object) -> Marker:
    """Marker itself, or of the path of a marker.json or what is in one.

    Raises
    ------
    InputError
        If it is anything else, or no marker.
    """
    if isinstance(value, Marker):
        return value
    if isinstance(value, Mapping):
        try:
            return from_json(json.dumps(dict(value)), "the dictionary")
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError("a dictionary as in marker.json", str(error), "give it plain JSON values") from None
    if isinstance(value, str | PathLike):
        return read_marker(Path(value))
    raise InputError("a marker", brief(value), "give a Marker, the path of its marker.json, or a dictionary")


def camera_of(value: object) -> Camera | None:
    """Camera itself, or of a calibration file or a dictionary; None for None.

    Raises
    ------
    InputError
        If it is anything else, or holds no camera.
    """
    if value is None or isinstance(value, Camera):
        return value
    if isinstance(value, Mapping):
        return spec_from_mapping({"camera": dict(value)}, "the dictionary").camera
    if isinstance(value, str | PathLike):
        return read_camera(Path(value))
    raise InputError("a camera", brief(value), "give a Camera, the path of a calibration file, or a dictionary")


def poses_of(value: object) -> PoseDistribution | None:
    """Poses themselves, or of a preset, a cone, or a file; None for None.

    Raises
    ------
    InputError
        If it is anything else, or holds no poses.
    """
    if value is None or isinstance(value, PoseDistribution):
        return value
    if isinstance(value, str):
        return poses_from(value)
    if isinstance(value, PathLike):
        return read_poses(Path(value))
    raise InputError("poses", brief(value), "give a text such as cone:tilt=0..60, a path, or a PoseDistribution")


def files_among(*values: object) -> list[Path]:
    """Those values that may be paths: what no output may be written over."""
    return [Path(value) for value in values if isinstance(value, str | PathLike) and str(value)]


def markers_of(value: MarkerLike | Sequence[MarkerLike]) -> tuple[Marker, ...]:
    """One marker or several, each as `marker_of` takes it."""
    return tuple(map(marker_of, value)) if isinstance(value, list | tuple) else (marker_of(value),)  # type: ignore[arg-type]


def path_of(value: object) -> Path:
    """Path of a text or path-like object.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if isinstance(value, str | PathLike):
        return Path(value)
    raise InputError("a path", brief(value), "give a text or a pathlib.Path")


def paths_of(values: Sequence[object]) -> list[Path]:
    """Paths of texts and path-like objects, one or more.

    Raises
    ------
    InputError
        If there is none, or one is anything else.
    """
    if not values:
        raise InputError("a path to write to", "none", 'give one or more, such as "marker.pdf"')
    return [path_of(value) for value in values]
