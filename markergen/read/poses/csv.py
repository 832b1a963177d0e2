"""Read a table of poses below a line of column names, separated by commas, semicolons, tabs or blanks."""

# tests: tests/read/test_poses.py

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.rows import WANTED, WHICH_WAY, Rows, RowsFile, columns_of, numbers_of


def _fits(file: RowsFile) -> bool:
    return file.first[:1].isalpha() or file.first[:1] in (b'"', b"_")


def _read(file: RowsFile) -> NDArray[np.float64]:
    table = file.table()
    line, names = next(table)
    columns, count = columns_of(names, file.place(line))
    rows = Rows(file, len(columns))
    for line, cells in table:
        if len(cells) != len(names):
            raise InputError(f"{len(names)} values at {file.place(line)}", str(len(cells)), "correct the line")
        rows.add(line, [cells[column] for column in columns])
    values = rows.values()
    return numbers_of(values[:, :count], values[:, count:], rows.place)


POSE_FORMATS.register("csv")(PoseFormat(f"a header of {WANTED}", WHICH_WAY, _fits, _read))
