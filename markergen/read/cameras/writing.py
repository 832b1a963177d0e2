"""Write a camera as a file of the format that its name says; which formats are read only, and which are written.

Text, because the output of OpenCV's FileStorage, unlike the input that it accepts, depends on its version.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import json
import os
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from markergen.errors import InputError, brief
from markergen.files import write_atomic
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, COVARIANCE, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import without_k3
from markergen.read.cameras.covariance import read_camera_covariance
from markergen.read.cameras.document import opencv_matrix, yaml_text
from markergen.read.cameras.keys import keyed
from markergen.read.cameras.programs import COLMAP, PROGRAMS
from markergen.read.formats import written_format


def camera_file(
    camera: Camera, path: str | os.PathLike[str], covariance: ArrayLike | None = None, rms: float | None = None
) -> None:
    """Write a camera to a file; see `Camera.save`."""
    write_atomic(Path(path), camera_bytes(camera, path, covariance, rms))


def camera_bytes(
    camera: Camera, path: str | os.PathLike[str], covariance: ArrayLike | None = None, rms: float | None = None
) -> bytes:
    """Return what `camera_file` writes, for a caller that replaces several files together."""
    form, ending = check_camera_path(path)
    checked = None if covariance is None else read_camera_covariance(np.asarray(covariance), camera)
    if rms is not None and not (isfinite(rms) and rms >= 0):
        raise InputError("the RMS of the residuals in px", brief(rms), "give 0 or more, or leave it out")
    record = CameraRecord(camera, checked, None if rms is None else float(rms))
    assert form.write is not None
    if not form.holds(record):
        name = Path(path).name
        stem = name[: -len(ending)].rstrip(".") or "camera"
        forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
        able = [form.endings[0].lstrip(".") for form in forms if form.write and form.holds(record)]
        raise InputError(
            f"a lens that {name} can hold",
            f"{camera.distortion.model} with {' '.join(camera.distortion.names)}",
            "write " + " or ".join(ending if ending == "cameras.txt" else f"{stem}.{ending}" for ending in able),
        )
    return form.write(record, ending).encode()


def check_camera_path(path: str | os.PathLike[str]) -> tuple[CameraFormat, str]:
    """Return the format that a file name stands for, and its ending, before any work is done for it."""
    return written_format(CAMERA_FORMATS, "a camera file", path)


# --- Formats ----------------------------------------------------------------------------------------------------------

LENSES = ("none", "radtan", "rational", "equidistant")
"""Models that OpenCV and ROS have."""


def _opencv(record: CameraRecord, ending: str) -> str:
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


ROS_MODELS = {"none": "plumb_bob", "radtan": "plumb_bob", "rational": "rational_polynomial"}
"""Names that sensor_msgs has for our lens models, where they differ."""


def _ros(record: CameraRecord, _: str) -> str:
    """A camera_info, in which the rectified image has the matrix of the raw one."""
    camera, coefficients = record.camera, record.camera.cv2_distortion
    if len(coefficients) == 4 and camera.distortion.model == "radtan":
        # camera_info's plumb_bob has five coefficients.
        coefficients = np.append(coefficients, 0.0)
    return yaml_text(
        {
            "image_width": camera.width,
            "image_height": camera.height,
            "camera_name": "camera",
            "camera_matrix": camera.matrix,
            "distortion_model": ROS_MODELS.get(camera.distortion.model, camera.distortion.model),
            "distortion_coefficients": coefficients[None],
            "rectification_matrix": np.eye(3),
            "projection_matrix": np.column_stack([camera.matrix, np.zeros(3)]),
            **record.extras,
        }
    )


def _kalibr_holds(record: CameraRecord) -> bool:
    lens = without_k3(record).camera.distortion
    return lens.model in ("none", "equidistant") or (lens.model == "radtan" and len(lens.coefficients) == 4)


def _kalibr(record: CameraRecord, _: str) -> str:
    record = without_k3(record)
    camera = record.camera
    # Kalibr takes floats alone as intrinsics, and does not read a chain without a topic.
    table = {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(camera.distortion.coefficients),
        "distortion_model": camera.distortion.model,
        "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "resolution": [camera.width, camera.height],
        "rostopic": "/cam0/image_raw",
        **record.extras,
    }
    return yaml_text({"cam0": table})


def _markergen(record: CameraRecord, _: str) -> str:
    values = record.camera.as_dict() | record.extras
    lens = values.pop("distortion", None)
    if COVARIANCE in values:
        values[COVARIANCE] = values[COVARIANCE].tolist()
    # Numbers, texts and lists are the same in TOML and JSON.
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    lines += ["", "[distortion]", *(f"{key} = {json.dumps(value)}" for key, value in lens.items())] if lens else []
    return "\n".join(lines) + "\n"


def _colmap(record: CameraRecord, _: str) -> str:
    record = without_k3(record)
    camera, lens, corner = record.camera, record.camera.distortion, PROGRAMS["colmap"].corner
    # Padded with zeros: a radial lens with k3 is a rational one without a denominator.
    model = next(
        name
        for name, (focals, kind, places, _) in COLMAP.items()
        if focals == 2
        and (kind == lens.model or (kind == "rational" and lens.model == "radtan"))
        and len(places) >= len(lens.coefficients)
    )
    padding = [0.0] * (len(COLMAP[model][2]) - len(lens.coefficients))
    parameters = [camera.fx, camera.fy, camera.cx + corner, camera.cy + corner, *lens.coefficients, *padding]
    lines = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for key, value in record.extras.items():
        lines.append(f"# {key}: {' '.join(map(str, np.ravel(value).tolist()))}")
    lines.append(f"1 {model} {camera.width} {camera.height} {' '.join(repr(float(value)) for value in parameters)}")
    return "\n".join(lines) + "\n"


def _is_opencv(record: CameraRecord) -> bool:
    return record.camera.distortion.model in LENSES


WRITTEN: dict[str, dict[str, Any]] = {
    "opencv": {"endings": (".yaml", ".yml", ".xml", ".json"), "holds": _is_opencv, "write": _opencv},
    "ros": {"endings": (".ros.yaml", ".ros.yml"), "holds": _is_opencv, "write": _ros},
    "kalibr": {"endings": (".kalibr.yaml", ".kalibr.yml"), "holds": _kalibr_holds, "write": _kalibr},
    "colmap": {"endings": ("cameras.txt", ".colmap.txt"), "holds": _is_opencv, "write": _colmap},
    "markergen": {"endings": (".toml",), "write": _markergen},
}
"""Formats that are written."""

for _name in PROGRAMS:
    CAMERA_FORMATS.register(_name)(keyed(_name, **WRITTEN.get(_name, {})))
