"""Read tables of poses: below a line of column names, or lines of numbers of TUM's RGB-D tools and evo, EuRoC, kapture,
KITTI and COLMAP.

The names may be those of ROS's tools: ``field.pose.position.x``, ``%time``. Comments that name the columns, or the
quaternion's order, are followed. A row below names is T_camera_marker, X_camera = R X_marker + t; lines of numbers are
the camera in the world, which is the marker frame. An image of COLMAP is T_camera_world, scaled to m: IMAGE_ID QW QX QY
QZ TX TY TZ CAMERA_ID NAME in images.txt, each followed by a line of points, and the same in images.bin.
"""

# tests: tests/read/test_poses.py

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.recorded_poses import COLUMNS
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.conventions import (
    ASKED,
    CAMERA_IN_MARKER,
    MARKER_IN_CAMERA,
    RawPoses,
    camera_in_marker,
    frame_of_columns,
    is_body,
)
from markergen.read.poses.rows import LONGEST_LINE, MATRIX_COLUMNS, WANTED, RowsFile, lines_of, table_poses
from markergen.read.remarks import remark

FORM = "timestamp tx ty tz qx qy qz qw"
MATRIX = (4, 12, 16)
"""Numbers of a line of matrices [R t]: a row, three rows, or with 0 0 0 1."""
LAST = r"|-?0(\.0*)?(e[-+]00)?( -?0(\.0*)?(e[-+]00)?){2} 1(\.0*)?(e[-+]00)?"
_NUMBERS = re.compile(rb"[-+.\d][-+.\deE]*(?:[\s,;]+[-+.\dnaifNIF][-+.\deEnaifNIF]*)*[\s,;]*")


def _has_names(file: RowsFile) -> bool:
    """True if the first line has the names of columns."""
    return bool(file.header) and file.first[:1] not in (b"[", b"{") and not re.match(rb"[-+.\d]", file.first)


def _named(file: RowsFile) -> RawPoses:
    table = file.table()
    line, names = next(table)
    return RawPoses(table_poses(file, names, table, file.place(line)), frame_of_columns(names))


def _count(file: RowsFile) -> int:
    """Number of words of the first line, if all are numbers, or a comment names them; else 0."""
    if file.first[:1].isalpha() or not (_NUMBERS.fullmatch(file.first) or file.header):
        return 0
    return len(file.first.decode("utf-8", "replace").split(file.delimiter))


def _is_matrices(file: RowsFile) -> bool:
    second = next((line for number, line in islice(file.lines(), 1, 2)), b"")
    is_log = _count(file) == 3 and len(second.split()) == 4 and file.first.split()[0].isdigit()
    return (_count(file) in MATRIX and not file.header) or is_log


def _read(file: RowsFile) -> RawPoses:
    names = file.header
    if names:
        frame = ASKED if any(map(is_body, names)) or "device_id" in names else CAMERA_IN_MARKER
        if any("kapture" in comment.lower() for comment in file.comments):
            frame = MARKER_IN_CAMERA  # Its trajectories map the world to the device.
            devices = {cells[1] for _, cells in file.table() if len(cells) > 1} if "device_id" in names else {""}
            if len(devices) > 1:
                remark(f"{file.name}: the poses of {len(devices)} devices are taken for those of one camera")
        return RawPoses(table_poses(file, names, file.table(), f"a comment of {file.name}"), frame)
    order = file.stated.get("order", "xyzw")
    if _count(file) != len(FORM.split()):
        problem, remedy = str(_count(file)), f"for T_camera_marker write a header of {WANTED}"
        raise InputError(f"8 numbers {FORM} at {file.place(next(file.lines())[0])}", problem, remedy)
    names = FORM.split()[:4] + [f"q{axis}" for axis in order]
    return RawPoses(table_poses(file, names, file.table(), file.name), CAMERA_IN_MARKER)


def _matrices(file: RowsFile) -> Iterator[tuple[int, list[str]]]:
    """Yield the twelve numbers of each matrix, from one line or from four, which Open3D's logs precede by numbers."""
    rows: list[str] = []
    for line, cells in file.table():
        if len(cells) == 3 and not rows:
            continue
        rows += cells
        if len(cells) not in MATRIX or len(rows) > MATRIX[-1]:
            raise InputError(f"4, 12 or 16 numbers of [R t] at {file.place(line)}", str(len(cells)), "correct the line")
        if len(cells) == MATRIX[1] or len(rows) == MATRIX[-1]:
            if not re.fullmatch(LAST, " ".join(rows[12:])):
                raise InputError(f"0 0 0 1 at {file.place(line)}", "others", "correct the line")
            yield line, rows[:12]
            rows = []
    if rows:
        raise InputError(f"whole matrices in {file.name}", f"{len(rows)} numbers at its end", "correct the file")


def _write(numbers: Array, _: str) -> str:
    back = camera_in_marker(numbers)
    return lines_of(np.column_stack([np.arange(float(len(back))), back]), head=f"# {FORM}\n")


def _write_kitti(numbers: Array, _: str) -> str:
    from scipy.spatial.transform import Rotation

    back = camera_in_marker(numbers)
    rows = np.concatenate([Rotation.from_quat(back[:, 3:]).as_matrix(), back[:, :3, None]], axis=2)
    return lines_of(rows.reshape(-1, 12))


# --- COLMAP -----------------------------------------------------------------------------------------------------------

IMAGE_FORM = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
IMAGE_COLUMNS = IMAGE_FORM.lower().split()[1:8]

_IMAGE = re.compile(rb"\d+(\s+[-+.0-9a-zA-Z]+){7}\s+\d+\s+[^\s]")


def _of_images(file: RowsFile) -> Array:
    if b"\0" in file.data[:8]:
        return table_poses(replace(file, row="image"), IMAGE_COLUMNS, enumerate(_unpacked(file.data)), file.name)
    if file.stated.get("order", "wxyz") != "wxyz":
        raise InputError(f"{IMAGE_FORM} in {file.name}", "a comment with qw at the end", "reorder the columns")
    return table_poses(file, IMAGE_COLUMNS, _images(file), file.name)


def _images(file: RowsFile) -> Iterator[tuple[int, list[str]]]:
    """Yield lines and numbers of the images of an images.txt."""
    points = False
    for line, content in file.lines(blank=True):
        image = _IMAGE.match(content) is not None
        if points:
            # If the empty lines were removed, lines of poses would be taken for points.
            if image and not re.match(rb"[-+.0-9eE\s]*\Z", content):
                expected = f"the points of an image, or an empty line, at {file.place(line)}"
                raise InputError(expected, "another image", "leave the empty lines in")
        elif not content:
            continue
        elif not image:
            problem = brief(content[:100].decode("utf-8", "replace"))
            raise InputError(f"{IMAGE_FORM} at {file.place(line)}", problem, "correct it")
        else:
            cells = content[:LONGEST_LINE].decode("utf-8", "replace").split(maxsplit=8)[1:8]
            if len(cells) < 7:
                raise InputError(f"{IMAGE_FORM} at {file.place(line)}", "an endless number", "correct it")
            yield line, cells
        points = not points


_POSE, _POINT = struct.Struct("<I7dI"), 24
"""Number, pose and camera of an image in images.bin, and bytes of a point: x, y, and its number in space."""


def _unpacked(data: bytes) -> Sequence[tuple[Any, ...]]:
    """Return the numbers of the images of an images.bin; none if it is something else."""
    count, place, poses = int.from_bytes(data[:8], "little"), 8, []
    if b"\0" not in data[:8] or not 0 < count <= len(data) // (_POSE.size + 9):
        return []
    for _ in range(count):
        name_end = data.find(b"\0", place + _POSE.size)
        if name_end < 0 or name_end + 9 > len(data):
            return []
        poses.append(_POSE.unpack_from(data, place)[1:8])
        place = name_end + 9 + _POINT * int.from_bytes(data[name_end + 1 : name_end + 9], "little")
    return poses if place == len(data) else []


def _write_images(numbers: Array, _: str) -> str:
    rows = numbers[:, [6, 3, 4, 5, 0, 1, 2]].tolist()
    lines = (f"{i} {' '.join(map(repr, row))} 1 {i}.png\n\n" for i, row in enumerate(rows, 1))
    return f"# {IMAGE_FORM}\n" + "".join(lines)


POSE_FORMATS.register("colmap")(
    PoseFormat(
        f"lines of {IMAGE_FORM}, each with one of points",
        lambda file: bool(_unpacked(file.data)) or _IMAGE.match(file.first) is not None,
        _of_images,
        ("images.txt",),
        _write_images,
    )
)
POSE_FORMATS.register("csv")(
    PoseFormat(
        f"a header of {WANTED}",
        _has_names,
        _named,
        (".csv",),
        lambda numbers, _: lines_of(numbers, ",", COLUMNS.replace(" ", ",") + "\n"),
    )
)
POSE_FORMATS.register("tum")(
    PoseFormat(
        f"lines of {FORM}",
        lambda file: _count(file) > 3 and not _is_matrices(file),
        _read,
        (".tum", ".tum.txt"),
        _write,
    )
)
POSE_FORMATS.register("kitti")(
    PoseFormat(
        "lines of 12 or 16 numbers [R t], or matrices in 4 lines",
        _is_matrices,
        lambda file: RawPoses(table_poses(file, MATRIX_COLUMNS, _matrices(file), file.name), CAMERA_IN_MARKER),
        (".kitti", ".kitti.txt"),
        _write_kitti,
    )
)
