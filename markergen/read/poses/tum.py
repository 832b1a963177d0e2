"""Read lines of numbers: trajectories of TUM's RGB-D tools and evo, EuRoC, kapture and KITTI.

Comments that name the columns, or the quaternion's order, are followed.
"""

# tests: tests/read/test_poses.py

import re
from collections.abc import Iterator
from itertools import islice

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.conventions import (
    ASKED,
    CAMERA_IN_MARKER,
    MARKER_IN_CAMERA,
    RawPoses,
    camera_in_marker,
    is_body,
)
from markergen.read.poses.rows import MATRIX_COLUMNS, WANTED, RowsFile, lines_of, table_poses
from markergen.read.remarks import remark

WHICH_WAY = (
    "each line is T_world_camera, the camera in the world, with t in m; the world is the marker frame (x right, y up,"
    " z out of the printed face), the camera frame has x right, y down, z forward"
)
FORM = "timestamp tx ty tz qx qy qz qw"
MATRIX = (4, 12, 16)
"""Numbers of a line of matrices [R t]: a row, three rows, or with 0 0 0 1."""
LAST = r"|-?0(\.0*)?(e[-+]00)?( -?0(\.0*)?(e[-+]00)?){2} 1(\.0*)?(e[-+]00)?"
_NUMBERS = re.compile(rb"[-+.\d][-+.\deE]*(?:[\s,;]+[-+.\dnaifNIF][-+.\deEnaifNIF]*)*[\s,;]*")


def _count(file: RowsFile) -> int:
    """Number of words of the first line, if all are numbers, or a comment names them; else 0."""
    if file.first[:1].isalpha() or not (_NUMBERS.fullmatch(file.first) or file.header):
        return 0
    return len(file.first.decode("utf-8", "replace").split(file.delimiter))


def _fits(file: RowsFile) -> bool:
    return _count(file) > 3 and (_count(file) not in MATRIX or bool(file.header))


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
    names = FORM.split()[:4] + [f"q{axis}" for axis in order]
    return RawPoses(table_poses(file, names, _eight(file), file.name), CAMERA_IN_MARKER)


def _eight(file: RowsFile) -> Iterator[tuple[int, list[str]]]:
    for line, cells in file.table():
        if len(cells) != 8:
            remedy = f"for T_camera_marker write a header of {WANTED}"
            raise InputError(f"8 numbers {FORM} at {file.place(line)}", str(len(cells)), remedy)
        yield line, cells


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


def _write(numbers: Array, ending: str) -> str:
    del ending
    back = camera_in_marker(numbers)
    return lines_of(np.column_stack([np.arange(float(len(back))), back]), head=f"# {FORM}\n")


def _write_kitti(numbers: Array, ending: str) -> str:
    del ending
    from scipy.spatial.transform import Rotation

    back = camera_in_marker(numbers)
    rows = np.concatenate([Rotation.from_quat(back[:, 3:]).as_matrix(), back[:, :3, None]], axis=2)
    return lines_of(rows.reshape(-1, 12))


POSE_FORMATS.register("tum")(PoseFormat(f"lines of {FORM}", WHICH_WAY, _fits, _read, (".tum", ".tum.txt"), _write))
POSE_FORMATS.register("kitti")(
    PoseFormat(
        "lines of 12 or 16 numbers [R t], or matrices in 4 lines",
        WHICH_WAY.replace("the camera in the world", "[R t] row by row"),
        _is_matrices,
        lambda file: RawPoses(table_poses(file, MATRIX_COLUMNS, _matrices(file), file.name), CAMERA_IN_MARKER),
        (".kitti", ".kitti.txt"),
        _write_kitti,
    )
)
