"""Read COLMAP's images.txt: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points, for every image.

images.bin holds the same.
"""

# tests: tests/read/test_poses.py

import re

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.read.poses import POSE_FORMATS, PoseFormat
from markergen.read.poses.conventions import scale_of
from markergen.read.poses.images_bin import image_poses, is_images
from markergen.read.poses.rows import LONGEST_LINE, Rows, RowsFile, numbers_of

WHICH_WAY = (
    "each image is T_camera_world, X_camera = R X_world + t, as COLMAP writes it, scaled to m; the world is the marker"
    " frame (x right, y up, z out of the printed face)"
)
FORM = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"

_IMAGE = re.compile(rb"\d+(\s+[-+.0-9a-zA-Z]+){7}\s+\d+\s+[^\s]")


def _fits(file: RowsFile) -> bool:
    return is_images(file.data) or _IMAGE.match(file.first) is not None


def _read(file: RowsFile) -> NDArray[np.float64]:
    scale = scale_of(file.convention, file.stated.get("unit", ""), file.name)
    if is_images(file.data):
        values = image_poses(file.data)
        return numbers_of(values[:, 4:] * scale, values[:, [1, 2, 3, 0]], lambda index: f"image {index} of {file.name}")
    if file.stated.get("order", "wxyz") != "wxyz":
        raise InputError(f"{FORM} in {file.name}", "a comment with qw at the end", "reorder the columns")
    rows = Rows(file, 7)
    points = False
    for line, content in file.lines(blank=True):
        image = _IMAGE.match(content) is not None
        if points:
            # If the empty lines were removed, lines of poses would be taken for points.
            if image and not re.match(rb"[-+.0-9eE\s]*\Z", content):
                raise InputError(
                    f"the points of an image, or an empty line, at {file.place(line)}",
                    "another image",
                    "leave the empty lines in",
                )
        elif not content:
            continue
        elif not image:
            raise InputError(
                f"{FORM} at {file.place(line)}", brief(content[:100].decode("utf-8", "replace")), "correct it"
            )
        else:
            cells = content[:LONGEST_LINE].decode("utf-8", "replace").split(maxsplit=8)[1:8]
            if len(cells) < 7:
                raise InputError(f"{FORM} at {file.place(line)}", "an endless number", "correct it")
            rows.add(line, cells)
        points = not points
    values = rows.values()
    return numbers_of(values[:, 4:] * scale, values[:, [1, 2, 3, 0]], rows.place)


def _write(numbers: NDArray[np.float64], ending: str) -> str:
    del ending
    rows = numbers[:, [6, 3, 4, 5, 0, 1, 2]].tolist()
    lines = (f"{i} {' '.join(map(repr, row))} 1 {i}.png\n\n" for i, row in enumerate(rows, 1))
    return f"# {FORM}\n" + "".join(lines)


POSE_FORMATS.register("colmap")(
    PoseFormat(f"lines of {FORM}, each with one of points", WHICH_WAY, _fits, _read, ("images.txt",), _write)
)
