"""What callers may give in several forms, made into the one that the engines take."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.options.base import CameraLike
from markergen.read.poses import poses_from, read_poses

MarkerLike = Marker | str | PathLike[str] | dict[str, Any]
"""A marker, the path of its marker.json, or what is in it."""


def marker_of(value: MarkerLike) -> Marker:
    """Marker itself, or of whatever `Marker.load` takes."""
    return value if isinstance(value, Marker) else Marker.load(value)


def camera_of(value: CameraLike | None) -> Camera | None:
    """Camera itself, or of whatever `Camera.load` takes; None for None."""
    return value if value is None or isinstance(value, Camera) else Camera.load(value)


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


def markers_in(value: MarkerLike | Sequence[MarkerLike]) -> list[MarkerLike]:
    """One marker or several as a list; raises InputError if there is none."""
    every: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
    if not every:
        raise InputError("one marker or more", "none", "give a Marker, a path, or a list of them")
    return every


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
