"""Read a JSON array of poses, each an object with the columns of the CSV table, alone or as ``{"poses": [...]}``.

nerf's transforms.json has ``frames`` with a ``transform_matrix``: the camera in the world, with OpenGL's axes.
"""

# tests: tests/read/test_poses.py

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.recorded_poses import COLUMNS
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.conventions import (
    ASKED,
    CAMERA_IN_MARKER,
    RawPoses,
    camera_in_marker,
    frame_of_columns,
    stated,
)
from markergen.read.poses.rows import MATRIX_COLUMNS, ROTATIONS, WANTED, RowsFile, columns_of, records, table_poses
from markergen.read.remarks import remark_unused

NERF_NAME, NERF_KEY = "transforms.json", "transform_matrix"
NERF = re.compile(
    r"camera_(?:model|angle_\w+|id)|fl_[xy]|c[xy]|[wh]|[kp]\d|is_fisheye|aabb_scale|\w*path|sharpness|rotation|\w*(?:_id|name)|time\w*"
)
"""Keys of the camera and of images in nerf's transforms.json."""


def _read(file: RowsFile) -> RawPoses:
    poses, around = records(file)
    is_nerf = NERF_KEY in poses[0]
    if is_nerf:
        around = {key: value for table in (around, *poses) for key, value in table.items()
                  if not (key == NERF_KEY or NERF.fullmatch(key))}  # fmt: skip
    lines = {key: f"{key}: {value}" for key, value in around.items()}
    file.stated.update(stated(lines.values(), file.name))
    remark_unused(file.name, [key for key, line in lines.items() if not stated([line], file.name)])
    file, statements = replace(file, row="pose"), file.stated
    file.stated.update(statements)
    flat = [_flat({NERF_KEY: pose.get(NERF_KEY)} if is_nerf else pose) for pose in poses]
    names = list(flat[0])
    for index, pose in enumerate(flat):
        if odd := set(pose) ^ set(names):
            problem = f"{brief(next(iter(odd)))} differs"
            raise InputError(f"the keys of pose 0 at {file.place(index)}", problem, "correct the file")
    used = [names[column] for column in columns_of(names, file.place(0))[0]]
    rows = ((index, [_number(pose[name], f"{name} of {file.place(index)}") for name in used])
            for index, pose in enumerate(flat))  # fmt: skip
    numbers = table_poses(file, used, rows, file.place(0))
    if is_nerf:
        return RawPoses(numbers, CAMERA_IN_MARKER, "opengl")
    # A matrix alone may be the pose of anything in anything, unless its key says it.
    keys = [key for key in poses[0] if key not in flat[0]] if set(MATRIX_COLUMNS) <= set(names) else []
    return RawPoses(numbers, stated(keys, file.name).get("frame", ASKED) if keys else frame_of_columns(names))


def _flat(pose: dict[str, Any]) -> dict[str, Any]:
    """Join nested keys, position.x, and number the entries of vectors and matrices: tvec.x, r11."""
    values: dict[str, Any] = {}
    for key, value in pose.items():
        if isinstance(value, list):
            numbers = [item for row in value for item in (row if isinstance(row, list) else [row])]
            order = next((order for order in ("wxyz", "xyzw") if order in key.lower()), "")
            forms: dict[int, Sequence[str]] = {3: [f"{key}.{axis}" for axis in "xyz"], 9: ROTATIONS[2]}
            forms |= {4: [f"q{axis}" for axis in order], 12: MATRIX_COLUMNS, 16: MATRIX_COLUMNS}
            names = forms.get(len(numbers), ())
            is_whole = numbers[len(MATRIX_COLUMNS) :] in ([], [0, 0, 0, 1])
            values |= dict(zip(names, numbers, strict=False)) if names and is_whole else {key: value}
        else:
            inner = _flat(value) if isinstance(value, dict) else {}
            values |= {f"{key}.{name}": item for name, item in inner.items()} if inner else {key: value}
    return values


def _number(value: object, place: str) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    raise InputError(f"a number for {place}", brief(value), "correct the file")


def _write(numbers: Array, ending: str) -> str:
    if ending == NERF_NAME:
        from scipy.spatial.transform import Rotation

        back, matrices = camera_in_marker(numbers, "opengl"), np.tile(np.eye(4), (len(numbers), 1, 1))
        matrices[:, :3, :3], matrices[:, :3, 3] = Rotation.from_quat(back[:, 3:]).as_matrix(), back[:, :3]
        return json.dumps({"frames": [{NERF_KEY: matrix} for matrix in matrices.tolist()]}, indent=1) + "\n"
    rows = [json.dumps(dict(zip(COLUMNS.split(), row, strict=True))) for row in numbers.tolist()]
    return "[\n" + ",\n".join(rows) + "\n]\n"


POSE_FORMATS.register("json")(
    PoseFormat(
        f"an array of objects with {WANTED}",
        lambda file: file.data.lstrip()[:1] in (b"[", b"{"),
        _read,
        (".json", NERF_NAME),
        _write,
    )
)
