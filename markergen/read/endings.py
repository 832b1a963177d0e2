"""Formats that are written, by the ending of a file's name."""

# tests: tests/api/test_inspect.py tests/read/test_camera_files.py

from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from markergen.errors import InputError, brief

T = TypeVar("T")


def by_ending(pairs: Iterable[tuple[str, T]], path: str | Path, what: str) -> tuple[T, str]:
    """Return the format that a file's name stands for, and its ending, of which the longest counts.

    Raises InputError if there is none, with the known endings.
    """
    endings, name = dict(pairs), Path(path).name
    for ending in sorted(endings, key=len, reverse=True):
        if name.lower().endswith(ending):
            return endings[ending], ending
    raise InputError(f"a name for {what}", brief(name), f"known endings: {', '.join(sorted(endings))}")
