"""Read a table of poses below a line of column names, separated by commas, semicolons, tabs or blanks.

The names may be those of ROS's tools: ``field.pose.position.x``, ``%time``.
"""

# tests: tests/read/test_poses.py

from markergen.model.poses import COLUMNS
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.conventions import ASKED, ASKED_COLUMN, MARKER_IN_CAMERA, RawPoses, column_of, is_body
from markergen.read.poses.rows import WANTED, WHICH_WAY, RowsFile, lines_of, table_poses


def _fits(file: RowsFile) -> bool:
    return file.first[:1] not in (b"[", b"{") and bool(file.header) and not _has_numbers(file)


def _has_numbers(file: RowsFile) -> bool:
    return file.first[:1].isdigit() or file.first[:1] in b"+-."


def _read(file: RowsFile) -> RawPoses:
    table = file.table()
    line, names = next(table)
    return RawPoses(table_poses(file, names, table, file.place(line)), frame_of(names))


def frame_of(names: list[str]) -> str:
    """Return the frame of poses with these columns; poses over time may be those of a camera, a body or a marker."""
    open_names = any(is_body(name) or ASKED_COLUMN.fullmatch(name.strip().lower()) for name in names)
    return ASKED if open_names or "time" in (column_of(name).kind for name in names) else MARKER_IN_CAMERA


POSE_FORMATS.register("csv")(
    PoseFormat(
        f"a header of {WANTED}",
        WHICH_WAY,
        _fits,
        _read,
        (".csv",),
        lambda numbers, _: lines_of(numbers, ",", COLUMNS.replace(" ", ",") + "\n"),
    )
)
