"""A table of poses with a line of column names above it, separated by commas, semicolons, tabs or blanks."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.lines import PoseFile, Rows
from markergen.read.poses.numbers import ROTATIONS, TRANSLATION, WANTED, numbers_of

Array = NDArray[np.float64]

IGNORED = ("id", "index", "frame", "image", "name")
"""Columns that may stand beside the pose and are not read.

A time is not one of them: a table with times is most often a trajectory, whose poses go the other way."""

WHICH_WAY = (
    "each row is T_camera_marker, X_camera = R X_marker + t, with t in m: the marker's origin in the camera frame"
    " (x right, y down, z forward)"
)


def columns_of(names: Sequence[str], place: str) -> tuple[list[int], int]:
    """Where among the columns those of the pose stand, translation first, and how many of them are the translation.

    Raises
    ------
    InputError
        If a column is missing, there twice, or unknown, or there are several rotations.
    """
    plain = [name.strip().lower() for name in names]
    twice = next((name for index, name in enumerate(plain) if name in plain[:index]), None)
    if twice is not None:
        raise InputError(f"every column once at {place}", f"{brief(twice)} twice", "correct the header")
    known = {*TRANSLATION, *IGNORED}.union(*ROTATIONS)
    unknown = next((name for name in plain if name not in known), None)
    if unknown is not None:
        advice = "; poses over time are read from a TUM trajectory, which has no header" if "time" in unknown else ""
        raise InputError(f"the columns {WANTED} at {place}", brief(unknown), f"correct the header{advice}")
    given = [rotation for rotation in ROTATIONS if set(rotation) & set(plain)]
    if len(given) != 1:
        found = " and ".join(rotation[0] for rotation in given) or "no rotation"
        raise InputError(f"one kind of rotation at {place}", found, f"the columns are {WANTED}")
    wanted = (*TRANSLATION, *given[0])
    missing = [name for name in wanted if name not in plain]
    if missing:
        raise InputError(f"the columns {' '.join(wanted)} at {place}", f"no {' '.join(missing)}", "add them")
    return [plain.index(name) for name in wanted], len(TRANSLATION)


def _fits(file: PoseFile) -> bool:
    return file.first[:1].isalpha() or file.first[:1] in (b'"', b"_")


def _read(file: PoseFile) -> Array:
    table = file.table()
    line, names = next(table)
    columns, count = columns_of(names, file.place(line))
    rows = Rows(file, len(columns))
    for line, words in table:
        if len(words) != len(names):
            raise InputError(f"{len(names)} values at {file.place(line)}", str(len(words)), "correct the line")
        rows.add(line, [words[column] for column in columns])
    values = rows.values()
    return numbers_of(values[:, :count], values[:, count:], rows.place)


POSE_FORMATS.register("csv")(PoseFormat(f"a header of {WANTED}", WHICH_WAY, _fits, _read))
