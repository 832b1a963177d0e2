"""What callers may give in several forms, made into the one that the engines take."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.options import CameraLike, MarkerLike, read_as


def marker_of(value: MarkerLike) -> Marker:
    """Marker itself, or of whatever `Marker.load` takes."""
    return value if isinstance(value, Marker) else Marker.load(value)


def camera_of(value: CameraLike | None) -> Camera | None:
    """Camera itself, or of whatever `Camera.load` takes; None for None."""
    return value if value is None or isinstance(value, Camera) else Camera.load(value)


def files_among(*values: object) -> list[Path]:
    """Those values that may be paths: what no output may be written over."""
    return [Path(value) for value in values if isinstance(value, str | PathLike) and str(value)]


def path_of(value: object, wanted: str) -> Path:
    """Path of a text or path-like object; what is `wanted` is for the message.

    Raises
    ------
    InputError
        If it is anything else.
    """
    return paths_of([value], wanted)[0]


def paths_of(values: Sequence[object], wanted: str) -> list[Path]:
    """Paths of texts and path-like objects, one or more; what is `wanted` is for the message.

    Raises
    ------
    InputError
        If there is none, or one is anything else.
    """
    if not values or any(value is None for value in values):
        raise InputError(wanted, "none", 'give a path, such as "marker.pdf"')
    try:
        return list(read_as("files", values, wanted))
    except InputError:
        raise InputError("a path", ", ".join(map(brief, values)), "give a text or a pathlib.Path") from None
