"""OpenCV's FileStorage in YAML, XML or JSON, as its calibration sample and many programs write it.

Written as text, because the output of FileStorage, unlike the input that it accepts, depends on OpenCV's version.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from markergen.read.cameras import CAMERA_FORMATS, CameraRecord
from markergen.read.cameras.document import opencv_matrix
from markergen.read.cameras.keys import keyed

LENSES = ("none", "radtan", "rational", "equidistant")
"""Models that OpenCV and ROS have."""


def _write(record: CameraRecord, ending: str) -> str:
    camera = record.camera
    values = {
        "image_width": camera.width,
        "image_height": camera.height,
        "fisheye_model": int(camera.distortion.model == "equidistant"),
        "camera_matrix": camera.matrix,
        "distortion_coefficients": camera.cv2_distortion[:, None],
        **record.extras,
    }
    syntax = {".xml": _xml, ".json": _json}.get(ending, _yaml)
    return syntax({key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()})


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) and isinstance(value[0], list)


def _yaml(values: Mapping[str, Any]) -> str:
    items = values.items()
    lines = [opencv_matrix(key, it, "d") if _is_matrix(it) else f"{key}: {json.dumps(it)}\n" for key, it in items]
    return "%YAML:1.0\n---\n" + "".join(lines)


def _json(values: Mapping[str, Any]) -> str:
    def stored(value: Any) -> Any:
        if not _is_matrix(value):
            return value
        size = {"type_id": "opencv-matrix", "rows": len(value), "cols": len(value[0]), "dt": "d"}
        return {**size, "data": [entry for row in value for entry in row]}

    return json.dumps({key: stored(value) for key, value in values.items()}, indent=1) + "\n"


def _xml(values: Mapping[str, Any]) -> str:
    lines = []
    for key, value in values.items():
        if _is_matrix(value):
            size = f"<rows>{len(value)}</rows><cols>{len(value[0])}</cols><dt>d</dt>"
            rows = "\n".join(" ".join(map(repr, row)) for row in value)
            lines.append(f'<{key} type_id="opencv-matrix">{size}<data>\n{rows}</data></{key}>\n')
        else:
            lines.append(f"<{key}>{' '.join(map(str, value)) if isinstance(value, list) else repr(value)}</{key}>\n")
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{"".join(lines)}</opencv_storage>\n'


CAMERA_FORMATS.register("opencv")(
    keyed("opencv", (".yaml", ".yml", ".xml", ".json"), lambda record: record.camera.distortion.model in LENSES, _write)
)
