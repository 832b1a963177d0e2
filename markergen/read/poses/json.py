"""Read a JSON array of poses, each an object with the columns of the CSV table, alone or as ``{"poses": [...]}``."""

# tests: tests/read/test_poses.py

import json
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.rows import WANTED, WHICH_WAY, RowsFile, columns_of, numbers_of

LARGEST_JSON = 5_000_000
"""Maximum size in bytes; as Python objects they may take forty times as much."""


def _fits(file: RowsFile) -> bool:
    return file.data.lstrip()[:1] in (b"[", b"{")


def _read(file: RowsFile) -> Array:
    poses = _poses(file)
    names = list(poses[0])
    columns, count = columns_of(names, _place(file, 0))
    picked = [names[column] for column in columns]
    values = np.empty((len(poses), len(picked)))
    for index, pose in enumerate(poses):
        if set(pose) != set(names):
            odd = next(iter(set(pose) ^ set(names)))
            raise InputError(
                f"the keys of pose 0 at {_place(file, index)}", f"{brief(odd)} differs", "correct the file"
            )
        values[index] = [_number(pose[name], f"{name} of {_place(file, index)}") for name in picked]
    return numbers_of(values[:, :count], values[:, count:], lambda index: _place(file, index))


def _poses(file: RowsFile) -> list[dict[str, Any]]:
    if len(file.data) > LARGEST_JSON:
        raise InputError(
            f"at most {LARGEST_JSON // 10**6} MB of JSON in {file.name}", "more", "write this many poses as CSV"
        )
    try:
        content = json.loads(file.data.decode(), object_pairs_hook=_distinct)
    except UnicodeDecodeError:
        raise InputError(f"text in {file.name}", "bytes that are not UTF-8 text", "write the file as UTF-8") from None
    except RecursionError:
        raise InputError(f"poses in {file.name}", "endless nesting", "check the file") from None
    except ValueError as error:
        raise InputError(f"complete JSON in {file.name}", brief(str(error)), "correct the file") from None
    if isinstance(content, dict) and set(content) == {"poses"}:
        content = content["poses"]
    if not (isinstance(content, list) and content and all(isinstance(pose, dict) for pose in content)):
        raise InputError(f"an array of poses in {file.name}", brief(content), f"each is an object with {WANTED}")
    return content


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a key twice in one object")
    return content


def _number(value: object, place: str) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    raise InputError(f"a number for {place}", brief(value), "correct the file")


def _place(file: RowsFile, index: int) -> str:
    return f"pose {index} of {file.name}"


POSE_FORMATS.register("json")(PoseFormat(f"an array of objects with {WANTED}", WHICH_WAY, _fits, _read))
