"""Read COLMAP's images.txt: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points, for every image.

images.bin holds the same.
"""

# tests: tests/read/test_poses.py

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.rows import LONGEST_LINE, RowsFile, table_poses

WHICH_WAY = (
    "each image is T_camera_world, X_camera = R X_world + t, as COLMAP writes it, scaled to m; the world is the marker"
    " frame (x right, y up, z out of the printed face)"
)
FORM = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
COLUMNS = FORM.lower().split()[1:8]

_IMAGE = re.compile(rb"\d+(\s+[-+.0-9a-zA-Z]+){7}\s+\d+\s+[^\s]")


def _read(file: RowsFile) -> Array:
    if b"\0" in file.data[:8]:
        return table_poses(replace(file, row="image"), COLUMNS, enumerate(_unpacked(file.data)), file.name)
    if file.stated.get("order", "wxyz") != "wxyz":
        raise InputError(f"{FORM} in {file.name}", "a comment with qw at the end", "reorder the columns")
    return table_poses(file, COLUMNS, _images(file), file.name)


def _images(file: RowsFile) -> Iterator[tuple[int, list[str]]]:
    """Yield lines and numbers of the images of an images.txt."""
    points = False
    for line, content in file.lines(blank=True):
        image = _IMAGE.match(content) is not None
        if points:
            # If the empty lines were removed, lines of poses would be taken for points.
            if image and not re.match(rb"[-+.0-9eE\s]*\Z", content):
                expected = f"the points of an image, or an empty line, at {file.place(line)}"
                raise InputError(expected, "another image", "leave the empty lines in")
        elif not content:
            continue
        elif not image:
            problem = brief(content[:100].decode("utf-8", "replace"))
            raise InputError(f"{FORM} at {file.place(line)}", problem, "correct it")
        else:
            cells = content[:LONGEST_LINE].decode("utf-8", "replace").split(maxsplit=8)[1:8]
            if len(cells) < 7:
                raise InputError(f"{FORM} at {file.place(line)}", "an endless number", "correct it")
            yield line, cells
        points = not points


_POSE, _POINT = struct.Struct("<I7dI"), 24
"""Number, pose and camera of an image in images.bin, and bytes of a point: x, y, and its number in space."""


def _unpacked(data: bytes) -> Sequence[tuple[Any, ...]]:
    """Return the numbers of the images of an images.bin; none if it is something else."""
    count, place, poses = int.from_bytes(data[:8], "little"), 8, []
    if len(data) < 8 or not 0 < count <= len(data) // (_POSE.size + 9):
        return []
    for _ in range(count):
        name_end = data.find(b"\0", place + _POSE.size)
        if name_end < 0 or name_end + 9 > len(data):
            return []
        poses.append(_POSE.unpack_from(data, place)[1:8])
        place = name_end + 9 + _POINT * int.from_bytes(data[name_end + 1 : name_end + 9], "little")
    return poses if place == len(data) else []


def is_images(data: bytes) -> bool:
    """True if all bytes are those of an images.bin."""
    return b"\0" in data[:8] and len(_unpacked(data)) > 0


def _write(numbers: Array, ending: str) -> str:
    del ending
    rows = numbers[:, [6, 3, 4, 5, 0, 1, 2]].tolist()
    lines = (f"{i} {' '.join(map(repr, row))} 1 {i}.png\n\n" for i, row in enumerate(rows, 1))
    return f"# {FORM}\n" + "".join(lines)


POSE_FORMATS.register("colmap")(
    PoseFormat(
        f"lines of {FORM}, each with one of points",
        WHICH_WAY,
        lambda file: is_images(file.data) or _IMAGE.match(file.first) is not None,
        _read,
        ("images.txt",),
        _write,
    )
)
