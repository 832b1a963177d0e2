"""Lines, words and columns of pose files, records of JSON, and the conversion of their numbers to poses.

Only a file's bytes and numbers are kept in memory. Rotations in any notation are converted to quaternions; invalid
ones are refused.
"""

# tests: tests/read/test_poses.py

import csv
import io
import json
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.errors import InputError, brief
from markergen.model.json_text import distinct
from markergen.model.recorded_poses import COLUMNS
from markergen.read.poses.conventions import PoseConvention, column_of, scale_of, stated, unit_of
from markergen.read.remarks import remark, remark_unused

Place = Callable[[int], str]
"""Function that returns the place of the pose with an index, for messages: ``line 7 of poses.csv``."""

MOST_ROWS = 100_000
"""Maximum number of poses in a file: an hour of video, read in two seconds."""

MOST_LINES = 2 * MOST_ROWS + 1000
"""Maximum number of lines: two per pose, and comments."""

LONGEST_LINE = 10_000
"""Maximum length in bytes of a line of numbers; actual lines have up to about 300."""

COMMENT = re.compile(rb"#|//|%\s")
"""How a comment begins; ROS begins a header with %time."""

MOST_COMMENTS = 100
"""Maximum number of comments that are read for what they state."""

DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")

FEWEST = 3
"""A header has at least this many columns of a pose."""

LARGEST_DISTANCE = 1e3
"""Maximum absolute coordinate of a translation in m: no marker is seen from farther."""

TOLERANCE = 1e-3
"""Allowed deviation of a quaternion's norm from 1 and of R'R from the identity: some files round to three digits."""

DECIMALS = 12
"""Number of decimals kept: pm and 1e-12 rad."""

TRANSLATION = ("tx", "ty", "tz")
ROTATIONS = (
    ("qx", "qy", "qz", "qw"),
    ("rx", "ry", "rz"),
    ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"),
)
"""Columns of the notations of a rotation: quaternion, rotation vector in rad, matrix row by row."""

MATRIX_COLUMNS = ("r11", "r12", "r13", "tx", "r21", "r22", "r23", "ty", "r31", "r32", "r33", "tz")
"""Numbers of a matrix [R t], row by row."""

WANTED = "tx ty tz and one of qx qy qz qw, rx ry rz, r11 r12 r13 r21 r22 r23 r31 r32 r33"

BOP = ("cam_R_m2c", "cam_t_m2c")
"""Keys of BOP's pose of a model in the camera."""

LARGEST_JSON = 5_000_000
"""Maximum size in bytes; as Python objects they may take forty times as much."""


@dataclass(frozen=True)
class RowsFile:
    """A file's name and bytes, without byte order mark, and what a user says of its poses."""

    name: str
    data: bytes
    convention: PoseConvention = field(default_factory=PoseConvention)
    row: str = "line"

    def lines(self, blank: bool = False) -> Iterator[tuple[int, bytes]]:
        """Yield stripped lines with their numbers, from 1, without comments and (unless `blank`) empty lines."""
        for number, line in enumerate(io.BytesIO(self.data), 1):
            stripped = line.strip()
            if not COMMENT.match(stripped) and (blank or stripped):
                yield number, stripped

    @cached_property
    def first(self) -> bytes:
        """First line that is neither empty nor a comment, truncated to `LONGEST_LINE`; empty if there is none."""
        return next((line[:LONGEST_LINE] for _, line in self.lines()), b"")

    @cached_property
    def comments(self) -> list[str]:
        """Comments, without their mark; at most a hundred."""
        marked = (line for line in map(bytes.strip, io.BytesIO(self.data)) if COMMENT.match(line))
        return [
            line[:LONGEST_LINE].lstrip(b"#/% ").decode("utf-8", "replace") for line in islice(marked, MOST_COMMENTS)
        ]

    @cached_property
    def stated(self) -> dict[str, str]:
        """What the comments state about order, unit, frame and axes."""
        return stated(self.comments, self.name)

    @cached_property
    def delimiter(self) -> str | None:
        """What separates the columns, going by the first row; None for blanks."""
        return next((mark for mark in ",;\t" if mark.encode() in self.first), None)

    @cached_property
    def header(self) -> list[str]:
        """Names of all columns: the first row, if it has no numbers, or a comment with as many names; else none."""
        first = self.first.decode("utf-8", "replace")
        cells = _cells(first, self.delimiter)
        if not any(_is_number(cell) for cell in cells):
            return cells if sum(column_of(cell).kind[:1] in ("t", "q", "r") for cell in cells) >= FEWEST else []
        for text in self.comments[::-1]:
            comment = text.rpartition(":")[2]
            names = _cells(comment, self.delimiter if self.delimiter and self.delimiter in comment else None)
            if len(names) != len(cells) and "," in comment:
                names = _cells(comment, ",")
            kinds = [column_of(name).kind for name in names]
            has_quaternion = sum(kind[:1] == "q" for kind in kinds) == len(ROTATIONS[0])
            is_whole = has_quaternion and {"tx", "ty", "tz"} <= set(kinds)
            if (
                not is_whole
                and sum(kind[:1] in ("t", "q", "r") for kind in kinds) > FEWEST
                and not stated([text], self.name)
            ):
                if has_quaternion:
                    remedy = "name them tx ty tz qx qy qz qw, or leave the comment out"
                    raise InputError(f"known names of columns in a comment of {self.name}", brief(text), remedy)
                remark(f"{self.name}: a comment about columns is not understood, and not followed: {brief(text)}")
            if is_whole:
                if len(names) != len(cells):
                    expected = f"{len(names)} columns as a comment says in {self.name}"
                    raise InputError(expected, str(len(cells)), "correct it")
                return names
        return []

    def place(self, number: int) -> str:
        """Return line and file, for messages."""
        return f"{self.row} {number} of {self.name}"

    def table(self) -> Iterator[tuple[int, list[str]]]:
        """Yield rows with line numbers, split at commas, semicolons, tabs or blanks as the first line is.

        Words may be in double quotes.
        """
        delimiter = self.delimiter
        quoted = b'"' in self.data
        for number, line in self.lines():
            text = self.text(number, line)
            cells = self._quoted(number, text) if quoted else text.split(delimiter)
            if quoted or delimiter != ",":
                comma = next((cell.strip() for cell in cells if DECIMAL_COMMA.fullmatch(cell)), None)
                if comma is not None:
                    problem = f"{brief(comma)}, perhaps with a decimal comma"
                    raise InputError(f"numbers with decimal points at {self.place(number)}", problem, "write them so")
            yield number, cells

    def _quoted(self, number: int, text: str) -> list[str]:
        """Words of a row, some in double quotes; an unclosed quote ends with its line."""
        try:
            return next(csv.reader([text], delimiter=self.delimiter or " ", skipinitialspace=True))
        except csv.Error as error:
            raise InputError(f"a row at {self.place(number)}", str(error), "correct the line") from None

    def text(self, number: int, line: bytes) -> str:
        """Decode a line."""
        if len(line) > LONGEST_LINE:
            expected = f"at most {LONGEST_LINE} characters at {self.place(number)}"
            raise InputError(expected, str(len(line)), "check the file")
        try:
            return line.decode()
        except UnicodeDecodeError:
            expected = f"text at {self.place(number)}"
            raise InputError(expected, "bytes that are not UTF-8 text", "write the file as UTF-8") from None


def check_count(names: Sequence[Any], words: Sequence[str], place: str) -> None:
    """Refuse a row that has another number of words than there are columns."""
    if len(words) != len(names):
        commas = "write decimal points, not commas" if len(words) == 2 * len(names) else "correct the line"
        raise InputError(f"{len(names)} values at {place}", str(len(words)), commas)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _cells(line: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def columns_of(names: Sequence[str], place: str) -> tuple[list[int], str]:
    """Indices of the pose's columns, those of the translation first, and its unit or "".

    Columns that are neither used nor known to be irrelevant are reported. Raises InputError if a column is missing or
    duplicate, a unit is not known, or there is more than one rotation.
    """
    columns = {name: column_of(name) for name in names}
    kinds = [columns[name].kind for name in names]
    plain = [name.strip().lower() for name in names]
    for index, (kind, name) in enumerate(zip(kinds, plain, strict=True)):
        problem = f"{brief(names[index])} twice" if name in plain[:index] else ""
        if not problem and kind not in ("", "ignored", "time") and kind in kinds[:index]:
            problem = f"{brief(names[kinds.index(kind)])} and {brief(names[index])}, both read as {kind}"
        if problem:
            raise InputError(f"every column once at {place}", problem, "correct the header")
    rotations = [rotation for rotation in ROTATIONS if set(rotation) & set(kinds)]
    if len(rotations) != 1:
        is_euler = any(re.search(r"\b(roll|pitch|yaw|heading|omega|phi|kappa|euler)", name) for name in plain)
        none = "Euler angles, whose order is not stated" if is_euler else "no rotation"
        problem = " and ".join(rotation[0] for rotation in rotations) or none
        raise InputError(f"one kind of rotation at {place}", problem, f"the columns are {WANTED}")
    wanted = (*TRANSLATION, *rotations[0])
    if missing := [name for name in wanted if name not in kinds]:
        raise InputError(f"the columns {' '.join(wanted)} at {place}", f"no {' '.join(missing)}", "add them")
    remark_unused(place, (f"column {name}" for name, kind in zip(names, kinds, strict=True) if not kind))
    used = {kind: columns[names[kinds.index(kind)]].unit for kind in wanted}
    for kind in rotations[0]:
        if used[kind] not in ("", "-", "1", "rad") or (kind[0] == "q" and used[kind] == "rad"):
            raise InputError(f"a rotation in rad at {place}", brief(used[kind]), "convert it to rad")
    return [kinds.index(name) for name in wanted], unit_of([used[kind] for kind in TRANSLATION], place)


def table_poses(file: RowsFile, names: Sequence[str], rows: Iterable[tuple[int, Sequence[Any]]], place: str) -> Array:
    """Read the numbers (P, 7) of rows whose columns have these names, in m; `place` is that of the names."""
    columns, unit = columns_of(names, place)
    kinds = [column_of(name).kind for name in names]
    if "rx" in kinds and "angle" in file.stated:
        raise InputError(f"a rotation in rad in {file.name}", "a comment about degrees", "convert it to rad")
    order = "".join(kind[1] for kind in kinds if kind[:1] == "q")
    if order and file.stated.get("order", order) != order:
        problem = f"{order} and {file.stated['order']}"
        raise InputError(f"one order of the quaternion in {file.name}", problem, "correct it")
    numbers, lines, has_marks = array("d"), array("l"), b"_" in file.data
    for line, cells in rows:
        check_count(names, cells, file.place(line))
        picked = [cells[column] for column in columns]
        try:
            numbers.extend(map(float, picked))
        except ValueError:
            bad = brief(next(word for word in picked if not _is_number(word)))
            raise InputError(f"numbers at {file.place(line)}", bad, "correct the line") from None
        # Python reads 1_0 as 10.
        if has_marks and any("_" in str(word) for word in picked):
            raise InputError(f"numbers at {file.place(line)}", brief(" ".join(picked)), "remove the _")
        if len(lines) == MOST_ROWS:
            raise InputError(f"at most {MOST_ROWS} poses in {file.name}", "more", "take every tenth pose")
        lines.append(line)
    if not lines:
        raise InputError(f"at least one pose in {file.name}", "none", "check the file")
    values = np.frombuffer(numbers, dtype=float).reshape(-1, len(columns))
    scale = scale_of(file.convention, unit or file.stated.get("unit", ""), file.name)
    return numbers_of(values[:, :3] * scale, values[:, 3:], lambda index: file.place(lines[index]))


def numbers_of(translation: Array, rotation: Array, place: Place, unit_option: str = "--poses-unit") -> Array:
    """Convert translations (P, 3) in m and rotations (P, 4), (P, 3) or (P, 9) to numbers (P, 7) of `RecordedPoses`.

    Quaternions are x y z w, rotation vectors are in rad, matrices are row by row. Of q and -q, which are the same
    rotation, the one with w >= 0 is returned. `unit_option` is what states another unit, for messages.

    Raises InputError if a number is not finite, a translation exceeds 1 km, a quaternion is not normalized, a rotation
    vector exceeds a full turn, or a matrix is not a rotation.
    """
    for values in (translation, rotation):
        _refuse(np.any(~np.isfinite(values), axis=-1), "finite numbers", values, place)
    _refuse(
        np.any(np.abs(translation) > LARGEST_DISTANCE, axis=-1),
        "a translation of at most 1 km",
        translation,
        place,
        f"is the unit another? Give {unit_option} mm",
    )
    quaternion = {4: _unit, 3: _of_vectors, 9: _of_matrices}[rotation.shape[-1]](rotation, place)
    quaternion = quaternion * np.where(quaternion[:, 3:] < 0, -1.0, 1.0)
    # Adding 0.0 turns -0.0 into 0.0.
    return np.round(np.concatenate([translation, quaternion], axis=-1), DECIMALS) + 0.0


def lines_of(rows: Array, mark: str = " ", head: str = "") -> str:
    """Return lines of numbers that read back the same."""
    return head + "".join(mark.join(map(repr, row)) + "\n" for row in rows.tolist())


def numbers_of_rows(rows: Sequence[str]) -> Array:
    """Parse the numbers (P, 7) written by `RecordedPoses.as_dict`, exactly; raises InputError for invalid rows."""
    place, values = "row {}".format, np.empty((len(rows), 7))
    for index, row in enumerate(rows):
        try:
            values[index] = [float(word) for word in row.split()]
        except ValueError:
            raise InputError(f"7 numbers {COLUMNS} at {place(index)}", brief(row), "correct the row") from None
    numbers_of(values[:, :3], values[:, 3:], place)
    return values


def _unit(quaternion: Array, place: Place) -> Array:
    # Clipped, since the squares of huge values overflow.
    length = np.linalg.norm(np.clip(quaternion, -2, 2), axis=-1)
    _refuse(np.abs(length - 1) > TOLERANCE, "a quaternion qx qy qz qw of length 1", quaternion, place)
    return quaternion / length[:, None]


def _of_vectors(vectors: Array, place: Place) -> Array:
    from scipy.spatial.transform import Rotation

    whole = 2 * np.pi + TOLERANCE
    # Degrees are recognized by their size.
    angle = np.linalg.norm(np.clip(vectors, -whole, whole), axis=-1)
    beyond = (angle > whole) | (np.abs(vectors).max(axis=-1) > whole)
    _refuse(beyond, "a rotation vector rx ry rz in rad, at most a whole turn", vectors, place)
    quaternions: Array = Rotation.from_rotvec(vectors).as_quat()
    return quaternions


def _of_matrices(rows: Array, place: Place) -> Array:
    from scipy.spatial.transform import Rotation

    matrices = np.clip(rows, -2, 2).reshape(-1, 3, 3)
    off = np.abs(matrices.swapaxes(-1, -2) @ matrices - np.eye(3)).max(axis=(-2, -1))
    _refuse(off > TOLERANCE, "a rotation matrix r11..r33 with R'R = I", rows, place)
    _refuse(np.linalg.det(matrices) < 0, "a rotation matrix r11..r33, not a reflection", rows, place)
    quaternions: Array = Rotation.from_matrix(matrices).as_quat()
    return quaternions


def _refuse(bad: Mask, wanted: str, values: Array, place: Place, remedy: str = "correct the file") -> None:
    if bad.any():
        index = int(np.argmax(bad))
        pose = " ".join(f"{value:.6g}" for value in values[index])
        raise InputError(f"{wanted} at {place(index)}", pose, remedy)


def records(file: RowsFile) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the poses, and what stands beside them."""
    if len(file.data) > LARGEST_JSON:
        most = f"at most {LARGEST_JSON // 10**6} MB of JSON in {file.name}"
        raise InputError(most, "more", "write this many poses as CSV")
    try:
        content = json.loads(file.data.decode(), object_pairs_hook=distinct)
    except (ValueError, RecursionError) as error:
        problem = "endless nesting" if isinstance(error, RecursionError) else str(error)[:80]
        raise InputError(f"complete JSON in {file.name}", problem, "correct the file") from None
    around: dict[str, Any] = {}
    content = _listed(content, file.name)
    if isinstance(content, dict) and (key := next((key for key in ("poses", "frames") if key in content), None)):
        around = {name: value for name, value in content.items() if name != key}
        content = content[key]
    if isinstance(content, list) and content and all(isinstance(pose, list) for pose in content):
        content = [{"matrix": pose} for pose in content]
    if not (isinstance(content, list) and content and all(isinstance(pose, dict) for pose in content)):
        raise InputError(f"an array of poses in {file.name}", "something else", f"each is an object with {WANTED}")
    return content, around


def _listed(content: Any, name: str) -> Any:
    """Return the poses that OpenCV's rvecs and tvecs, or BOP's scene_gt in mm, are; or else the content."""
    if not isinstance(content, dict):
        return content
    rotations, places = content.get("rvecs"), content.get("tvecs")
    if isinstance(rotations, list) and isinstance(places, list) and len(rotations) == len(places):
        return [{"rvec": rotation, "tvec": place} for rotation, place in zip(rotations, places, strict=True)]
    images = list(content.values())
    objects = [item for image in images if isinstance(image, list) for item in image]
    if not objects or not all(isinstance(item, dict) and isinstance(item.get(BOP[1]), list) for item in objects):
        return content
    if len(objects) != len(images):
        raise InputError(f"one object for each image in {name}", "several", "leave the entries of one obj_id")
    axes = ("tx_mm", "ty_mm", "tz_mm")
    return [{"R": item.get(BOP[0]), **dict(zip(axes, item[BOP[1]], strict=False))} for item in objects]
