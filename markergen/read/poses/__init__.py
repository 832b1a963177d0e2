"""Pose distributions: a preset, a cone, or a file in a format that is recognized by content."""

import hashlib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, among, brief
from markergen.files import exists
from markergen.guard import read
from markergen.model.poses import POSES, PoseDistribution, is_named, named_poses, pose_forms
from markergen.model.recorded_poses import RecordedPoses
from markergen.read.formats import Format, recognized, refuse_unreadable, unknown_format
from markergen.read.poses.conventions import (
    MARKER_IN_CAMERA,
    READING,
    PoseConvention,
    RawPoses,
    marker_in_camera,
    settled_frame,
)
from markergen.read.poses.rows import MOST_LINES, MOST_ROWS, RowsFile, numbers_of
from markergen.registry import Registry

AS_WRITTEN = PoseConvention()


class PoseFormat(Format[RowsFile, RawPoses | NDArray[np.float64], NDArray[np.float64]]):
    """A pose file format, which is read as poses with their frame and axes, and written from numbers.

    Plain numbers (P, 7), as in `RecordedPoses`, are T_camera_marker.
    """


POSE_FORMATS: Registry[PoseFormat] = Registry("pose format", __name__, "markergen.pose_formats", PoseFormat)
"""Formats by name."""
BINARY = ("npy", "colmap")
"""Those of which a file need not be text."""


def poses_from(source: Any, **reading: Any) -> PoseDistribution:
    """Make poses from a text (``paper``, ``cone:tilt=40..70``; see `named_poses`), a file (see `read_poses`) or values.

    A distribution is returned unchanged, and a path object is always a file. In a text, a file with the name of a
    preset needs its folder: ``./paper``. Values are those of `Poses.load`. `reading` is what is known of the poses of a
    file, by the options `READING`.

    Raises InputError if it is none of these, or as the readers raise; TypeError for another option.
    """
    if unknown := set(reading).difference(READING):
        raise TypeError(f"poses take {', '.join(READING)}, not {', '.join(sorted(unknown))}")
    source = poses_as_stated(source, reading)
    if isinstance(source, PoseDistribution):
        return source
    if isinstance(source, PathLike):
        return read_poses(Path(source))
    if isinstance(source, str):
        poses = settled_poses(source)
        return named_poses(poses) if isinstance(poses, str) else poses
    if callable(source):
        return poses_from(source(np.random.default_rng(0)))
    if hasattr(source, "to_csv"):
        return _reading_of("the DataFrame", source.to_csv(index=False).encode(), AS_WRITTEN)[0]
    return RecordedPoses.from_numbers(numbers_of_arrays(source))


FORMS = "matrices (k, 4, 4) of T_camera_marker, or pairs of rotation vector and translation"


def numbers_of_arrays(source: Any, scale: float = 1.0, place: str = "poses[{}]") -> NDArray[np.float64]:
    """Numbers (P, 7) of matrices (k, 4, 4), or of pairs of vectors (k, 2, 3), with the length of their unit in m.

    Raises InputError for another form, no pose, or a rotation that is none.
    """
    try:
        values = np.array(source if hasattr(source, "__len__") else list(source), dtype=float)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape[-2:] == (4, 4) and (values[..., 3, :] == [0, 0, 0, 1]).all():
        matrices = values.reshape(-1, 4, 4)
        translation, rotation = matrices[:, :3, 3], matrices[:, :3, :3].reshape(-1, 9)
    elif values.ndim > 2 and values.shape[1:3] == (2, 3) and values.size == 6 * len(values):
        rotation, translation = values.reshape(-1, 2, 3).swapaxes(0, 1)
    else:
        remedy = f"give a text such as cone:tilt=0..60, a path, {FORMS}, a DataFrame, or a function of a generator"
        form = f"an array of shape {values.shape}" if values.size else brief(source)
        if values.shape[-2:] == (4, 4):
            form, remedy = f"{form} whose last rows are not 0 0 0 1", "transpose them, or complete their last rows"
        raise InputError("poses", form, remedy)
    if not len(translation):
        raise InputError("at least one pose", "none", f"give {FORMS}")
    return numbers_of(scale * translation, rotation, place.format)


def poses_as_stated(poses: Any, options: Mapping[str, Any]) -> Any:
    """Return poses read as the options `READING` say; unchanged if none of them is given.

    Raises InputError if one is given and the poses are not those of a file, or as `read_poses` does.
    """
    option = next((key for key in READING if options.get(key) is not None), None)
    if option is None:
        return poses
    if not isinstance(poses, str | PathLike) or (isinstance(poses, str) and is_named(poses)):
        expected = f"a file of poses with --{option.replace('_', '-')}"
        raise InputError(expected, "none" if poses is None else brief(poses), "give --poses FILE, or leave it out")
    return read_poses(Path(poses), stated_convention(options) or AS_WRITTEN)


def stated_convention(options: Mapping[str, Any]) -> PoseConvention | None:
    """Return what the options `READING` say; None if none of them is given."""
    asked = {key: options[key] for key in READING if options.get(key) is not None}
    if not asked:
        return None
    body = None
    if (path := asked.get("camera_in_body")) is not None:
        # By its numbers it is like the pose of a marker in a camera.
        camera = read_poses(Path(path), PoseConvention(MARKER_IN_CAMERA, "opencv"))
        if len(camera) != 1:
            raise InputError(f"one pose, of the camera in the body, in {camera.file}", str(len(camera)), "leave one")
        body = camera.numbers[0]
    frame, axes, unit, _ = (asked.get(key) for key in READING)
    return PoseConvention(frame, axes, unit, body)


def settled_poses(wish: str) -> str | RecordedPoses:
    """Convert a text for `poses_from` to its form in a spec: a file is read, and equal cones get equal texts."""
    if is_named(wish):
        return named_poses(wish).name
    path = Path(wish)
    # 0.4-0.8m is no file.
    if not path.name or not (path.suffix[1:].isalpha() or len(path.parts) > 1 or exists(path)):
        remedy = f"{among(wish.partition(':')[0], POSES, pose_forms())}, and files of poses"
        raise InputError("a known pose distribution", brief(wish), remedy)
    return read_poses(path)


def read_poses(path: Path | str, convention: PoseConvention = AS_WRITTEN) -> RecordedPoses:
    """Read the poses of a file: a table of T_camera_marker as CSV or JSON, or a format of `POSE_FORMATS`.

    The `convention` may replace what a format says of the direction of its poses.

    Raises InputError if the file cannot be read, has more than 100,000 poses or 50 MB, has no known format, or a pose
    is invalid; the message names file and line. If the poses may be those of a body, or the file contradicts itself.
    """
    return pose_reading(path, convention)[0]


def pose_reading(path: Path | str, convention: PoseConvention) -> tuple[RecordedPoses, str, str, str]:
    """Read poses as `read_poses` does, with the name of their format, and the frame and axes of its poses."""
    path = Path(path)
    _, data = read(path, "poses")
    return _reading_of(path.name if path.name.isprintable() else brief(path.name), data, convention)


def _reading_of(name: str, data: bytes, convention: PoseConvention) -> tuple[RecordedPoses, str, str, str]:
    """Read the poses of a file's content."""
    if data.count(b"\n") > MOST_LINES:
        expected = f"at most {MOST_ROWS} poses in {name}"
        raise InputError(expected, f"more than {MOST_LINES} lines", "take every tenth pose")
    text = data.removeprefix(b"\xef\xbb\xbf")
    if b"\n" not in text:  # Some Mac spreadsheets end lines with a carriage return.
        text = text.replace(b"\r", b"\n")
    file = RowsFile(name, text, convention)
    if (kind := next((name for name in BINARY if POSE_FORMATS[name].fits(file)), None)) is None:
        refuse_unreadable(file.name, text, "poses")
        if b"\0" in data:
            raise InputError(f"text in {name}", "bytes that are not text", "write the poses as text")
        kind = recognized(POSE_FORMATS, file)
    if kind is None:
        raise unknown_format(POSE_FORMATS, file.name, "poses")
    reading = POSE_FORMATS[kind].read(file)
    raw = reading if isinstance(reading, RawPoses) else RawPoses(reading)
    frame, axes = settled_frame(convention, raw, file.stated, file.name)
    numbers = marker_in_camera(raw.numbers, frame, axes, convention.camera_in_body)
    body = [] if convention.camera_in_body is None else convention.camera_in_body.tolist()
    stated = convention.frame, convention.axes, convention.unit, body
    digest = hashlib.sha256(data + (repr(stated) if any(stated) else "").encode()).hexdigest()
    return RecordedPoses.of(numbers, file.name, digest), kind, frame, axes
