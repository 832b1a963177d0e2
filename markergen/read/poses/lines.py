"""A file of poses as lines and words; nothing here keeps more of it in memory than its bytes and its numbers."""

import csv
import io
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.files import read_start

Array = NDArray[np.float64]

LARGEST_FILE = 50_000_000
"""Bytes."""

MOST_ROWS = 100_000
"""Poses of one file: an hour of video, and two seconds to look through."""

MOST_LINES = 2 * MOST_ROWS + 1000
"""Two for each pose, and comments."""

LONGEST_LINE = 10_000
"""Bytes of a line with numbers; the longest of them have some 300."""


def read_bytes(path: Path) -> bytes:
    """Bytes of a file; raises InputError if it cannot be read, is no text, is empty, or is beyond `LARGEST_FILE`."""
    try:
        data = read_start(path, LARGEST_FILE + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character.
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"a readable file of poses at {brief(str(path))}", str(reason), "check the path") from None
    place = brief(str(path))
    if len(data) > LARGEST_FILE:
        raise InputError(
            f"a file of poses of at most {LARGEST_FILE // 10**6} MB at {place}", "a larger one", "take every tenth pose"
        )
    if not data.strip():
        raise InputError(f"a file of poses at {place}", "an empty file", "check the path")
    if data.count(b"\n") > MOST_LINES:
        raise InputError(
            f"at most {MOST_ROWS} poses at {place}", f"more than {MOST_LINES} lines", "take every tenth pose"
        )
    if b"\0" in data:
        raise InputError(f"text at {place}", "bytes that are not text", "write the poses as text")
    return data


@dataclass(frozen=True)
class PoseFile:
    """A file by name and bytes, without a byte order mark."""

    name: str
    data: bytes

    def lines(self, blank: bool = False) -> Iterator[tuple[int, bytes]]:
        """Lines with their numbers, from 1, without the blanks around them; no comments, and empty ones if `blank`."""
        for number, line in enumerate(io.BytesIO(self.data), 1):
            stripped = line.strip()
            if stripped[:1] != b"#" and (blank or stripped):
                yield number, stripped

    @cached_property
    def first(self) -> bytes:
        """The first line that is neither empty nor a comment, or what of it is not too long; empty if there is none."""
        return next((line[:LONGEST_LINE] for _, line in self.lines()), b"")

    @cached_property
    def odd(self) -> bool:
        """Whether there may be numbers such as 1_0, which Python takes for 10."""
        return b"_" in self.data

    def place(self, number: int) -> str:
        """Line and file, for messages."""
        return f"line {number} of {self.name}"

    def table(self) -> Iterator[tuple[int, list[str]]]:
        """Rows with their line numbers, of words separated by commas, semicolons, tabs or blanks, as the first has it.

        Words may stand in double quotes.
        """
        first = self.first.decode("utf-8", "replace")
        delimiter = next((mark for mark in ",;\t" if mark in first), None)
        if b'"' not in self.data:
            yield from ((number, self.text(number, line).split(delimiter)) for number, line in self.lines())
            return
        for number, line in self.lines():
            # Line by line: a quote that is not closed ends there.
            reader = csv.reader([self.text(number, line)], delimiter=delimiter or " ", skipinitialspace=True)
            try:
                yield number, next(reader)
            except csv.Error as error:
                raise InputError(f"a row at {self.place(number)}", str(error), "correct the line") from None

    def text(self, number: int, line: bytes) -> str:
        """Text of a line."""
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
    """Rows of numbers that are collected from a file, each with where it stands."""

    file: PoseFile
    width: int
    _numbers: "array[float]" = field(default_factory=lambda: array("d"))
    _lines: "array[int]" = field(default_factory=lambda: array("l"))

    def add(self, line: int, words: Sequence[str]) -> None:
        """Add a row of `width` words; `line` is its place."""
        try:
            self._numbers.extend(map(float, words))
        except ValueError:
            bad = next(word for word in words if not _is_number(word))
            raise InputError(f"numbers at {self.file.place(line)}", brief(bad), "correct the line") from None
        if self.file.odd and any("_" in word for word in words):
            raise InputError(f"numbers at {self.file.place(line)}", brief(" ".join(words)), "take out the _")
        if len(self._lines) == MOST_ROWS:
            raise InputError(f"at most {MOST_ROWS} poses in {self.file.name}", "more", "take every tenth pose")
        self._lines.append(line)

    def values(self) -> Array:
        """Return array (P, width); raises InputError if there are no rows."""
        if not self._lines:
            raise InputError(f"at least one pose in {self.file.name}", "none", "check the file")
        return np.frombuffer(self._numbers, dtype=float).reshape(-1, self.width)

    def place(self, index: int) -> str:
        """Where row `index` stands."""
        return self.file.place(self._lines[index])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
