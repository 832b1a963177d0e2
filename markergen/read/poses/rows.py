"""Lines, words and columns of pose files, and the conversion of their numbers to poses.

Only a file's bytes and numbers are kept in memory. Rotations in any notation are converted to quaternions; invalid
ones are refused.
"""

# tests: tests/read/test_poses.py

import csv
import io
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from markergen.arrays import Array, Mask
from markergen.errors import InputError, brief
from markergen.model.poses import COLUMNS

Place = Callable[[int], str]
"""Function that returns the place of the pose with an index, for messages: ``line 7 of poses.csv``."""

MOST_ROWS = 100_000
"""Maximum number of poses in a file: an hour of video, read in two seconds."""

MOST_LINES = 2 * MOST_ROWS + 1000
"""Maximum number of lines: two per pose, and comments."""

LONGEST_LINE = 10_000
"""Maximum length in bytes of a line of numbers; actual lines have up to about 300."""

LARGEST_DISTANCE = 1e6
"""Maximum absolute coordinate of a translation in m."""

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

WANTED = "tx ty tz and one of qx qy qz qw, rx ry rz, r11 r12 r13 r21 r22 r23 r31 r32 r33"

IGNORED = ("id", "index", "frame", "image", "name")
"""Columns that are allowed and ignored.

Time is not among them: a table with times is usually a trajectory, whose poses have the opposite direction."""

WHICH_WAY = (
    "each row is T_camera_marker, X_camera = R X_marker + t, with t in m: the marker's origin in the camera frame"
    " (x right, y down, z forward)"
)


@dataclass(frozen=True)
class RowsFile:
    """A file's name and bytes, without byte order mark."""

    name: str
    data: bytes

    def lines(self, blank: bool = False) -> Iterator[tuple[int, bytes]]:
        """Yield stripped lines with their numbers, from 1, without comments and (unless `blank`) empty lines."""
        for number, line in enumerate(io.BytesIO(self.data), 1):
            stripped = line.strip()
            if stripped[:1] != b"#" and (blank or stripped):
                yield number, stripped

    @cached_property
    def first(self) -> bytes:
        """First line that is neither empty nor a comment, truncated to `LONGEST_LINE`; empty if there is none."""
        return next((line[:LONGEST_LINE] for _, line in self.lines()), b"")

    @cached_property
    def odd(self) -> bool:
        """True if the file may contain numbers such as 1_0, which Python reads as 10."""
        return b"_" in self.data

    def place(self, number: int) -> str:
        """Return line and file, for messages."""
        return f"line {number} of {self.name}"

    def table(self) -> Iterator[tuple[int, list[str]]]:
        """Yield rows with line numbers, split at commas, semicolons, tabs or blanks as the first line is.

        Words may be in double quotes.
        """
        first = self.first.decode("utf-8", "replace")
        delimiter = next((mark for mark in ",;\t" if mark in first), None)
        if b'"' not in self.data:
            yield from ((number, self.text(number, line).split(delimiter)) for number, line in self.lines())
            return
        for number, line in self.lines():
            # Line by line, so that an unclosed quote ends with its line.
            reader = csv.reader([self.text(number, line)], delimiter=delimiter or " ", skipinitialspace=True)
            try:
                yield number, next(reader)
            except csv.Error as error:
                raise InputError(f"a row at {self.place(number)}", str(error), "correct the line") from None

    def text(self, number: int, line: bytes) -> str:
        """Decode a line."""
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"at most {LONGEST_LINE} characters at {self.place(number)}", str(len(line)), "check the file"
            )
        try:
            return line.decode()
        except UnicodeDecodeError:
            raise InputError(
                f"text at {self.place(number)}", "bytes that are not UTF-8 text", "write the file as UTF-8"
            ) from None


@dataclass
class Rows:
    """Rows of numbers collected from a file, each with its line."""

    file: RowsFile
    width: int
    _numbers: "array[float]" = field(default_factory=lambda: array("d"))
    _lines: "array[int]" = field(default_factory=lambda: array("l"))

    def add(self, line: int, cells: Sequence[str]) -> None:
        """Add a row of `width` words at `line`."""
        try:
            self._numbers.extend(map(float, cells))
        except ValueError:
            bad = next(word for word in cells if not _is_number(word))
            raise InputError(f"numbers at {self.file.place(line)}", brief(bad), "correct the line") from None
        if self.file.odd and any("_" in word for word in cells):
            raise InputError(f"numbers at {self.file.place(line)}", brief(" ".join(cells)), "remove the _")
        if len(self._lines) == MOST_ROWS:
            raise InputError(f"at most {MOST_ROWS} poses in {self.file.name}", "more", "take every tenth pose")
        self._lines.append(line)

    def values(self) -> Array:
        """Return array (P, width); raises InputError if there are no rows."""
        if not self._lines:
            raise InputError(f"at least one pose in {self.file.name}", "none", "check the file")
        return np.frombuffer(self._numbers, dtype=float).reshape(-1, self.width)

    def place(self, index: int) -> str:
        """Return the place of row `index`."""
        return self.file.place(self._lines[index])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def columns_of(names: Sequence[str], place: str) -> tuple[list[int], int]:
    """Indices of the pose's columns, translation first, and the number of those of the translation.

    Raises
    ------
    InputError
        If a column is missing, duplicate or unknown, or there is more than one rotation.
    """
    plain = [name.strip().lower() for name in names]
    twice = next((name for index, name in enumerate(plain) if name in plain[:index]), None)
    if twice is not None:
        raise InputError(f"every column once at {place}", f"{brief(twice)} twice", "correct the header")
    columns = {*TRANSLATION, *IGNORED}.union(*ROTATIONS)
    unknown = next((name for name in plain if name not in columns), None)
    if unknown is not None:
        advice = "; poses over time are read from a TUM trajectory, which has no header" if "time" in unknown else ""
        raise InputError(f"the columns {WANTED} at {place}", brief(unknown), f"correct the header{advice}")
    rotations = [rotation for rotation in ROTATIONS if set(rotation) & set(plain)]
    if len(rotations) != 1:
        problem = " and ".join(rotation[0] for rotation in rotations) or "no rotation"
        raise InputError(f"one kind of rotation at {place}", problem, f"the columns are {WANTED}")
    wanted = (*TRANSLATION, *rotations[0])
    missing = [name for name in wanted if name not in plain]
    if missing:
        raise InputError(f"the columns {' '.join(wanted)} at {place}", f"no {' '.join(missing)}", "add them")
    return [plain.index(name) for name in wanted], len(TRANSLATION)


def numbers_of(translation: Array, rotation: Array, place: Place) -> Array:
    """Convert translations (P, 3) in m and rotations (P, 4), (P, 3) or (P, 9) to numbers (P, 7) of `RecordedPoses`.

    Quaternions are x y z w, rotation vectors are in rad, matrices are row by row. Of q and -q, which are the same
    rotation, the one with w >= 0 is returned.

    Raises
    ------
    InputError
        If a number is not finite, a translation exceeds 1000 km, a quaternion is not normalized, a rotation vector
        exceeds a full turn, or a matrix is not a rotation.
    """
    for values in (translation, rotation):
        _refuse(np.any(~np.isfinite(values), axis=-1), "finite numbers", values, place)
    _refuse(
        np.any(np.abs(translation) > LARGEST_DISTANCE, axis=-1), "a translation of at most 1000 km", translation, place
    )
    quaternion = {4: _unit, 3: _of_vectors, 9: _of_matrices}[rotation.shape[-1]](rotation, place)
    quaternion = quaternion * np.where(quaternion[:, 3:] < 0, -1.0, 1.0)
    # Adding 0.0 turns -0.0 into 0.0.
    return np.round(np.concatenate([translation, quaternion], axis=-1), DECIMALS) + 0.0


def inverses(numbers: Array) -> Array:
    """Invert poses given as numbers (P, 7)."""
    from scipy.spatial.transform import Rotation

    inverse = Rotation.from_quat(numbers[:, 3:]).inv()
    back = np.concatenate([-inverse.apply(numbers[:, :3]), inverse.as_quat(canonical=True)], axis=-1)
    return np.round(back, DECIMALS) + 0.0


def numbers_of_rows(rows: Sequence[str]) -> Array:
    """Parse the numbers (P, 7) written by `RecordedPoses.as_dict`, exactly; raises InputError for invalid rows."""

    def place(index: int) -> str:
        return f"row {index}"

    values = np.empty((len(rows), 7))
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


def _refuse(bad: Mask, wanted: str, values: Array, place: Place) -> None:
    if bad.any():
        index = int(np.argmax(bad))
        pose = " ".join(f"{value:.6g}" for value in values[index])
        raise InputError(f"{wanted} at {place(index)}", pose, "correct the file")
