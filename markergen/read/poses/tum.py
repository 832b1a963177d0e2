"""Read a trajectory as written by TUM's RGB-D tools and evo: lines of timestamp tx ty tz qx qy qz qw."""

# tests: tests/read/test_poses.py

import re

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.rows import WANTED, Rows, RowsFile, inverses, numbers_of

WHICH_WAY = (
    "each line is T_world_camera, the camera in the world, with t in m; the world is the marker frame (x right, y up,"
    " z out of the printed face), the camera frame has x right, y down, z forward"
)
FORM = "timestamp tx ty tz qx qy qz qw"


def _fits(file: RowsFile) -> bool:
    return re.match(rb"[-+.\d]", file.first) is not None and len(file.first.split()) < 10


def _read(file: RowsFile) -> NDArray[np.float64]:
    rows = Rows(file, 8)
    for line, cells in file.table():
        if len(cells) != 8:
            raise InputError(
                f"8 numbers {FORM} at {file.place(line)}",
                str(len(cells)),
                f"for T_camera_marker write a header of {WANTED}",
            )
        rows.add(line, cells)
    values = rows.values()
    return inverses(numbers_of(values[:, 1:4], values[:, 4:], rows.place))


POSE_FORMATS.register("tum")(PoseFormat(f"lines of {FORM}", WHICH_WAY, _fits, _read))
