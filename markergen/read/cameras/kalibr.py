"""Kalibr's camchain: one table per camera, cam0, cam1, ..."""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

from markergen.read.cameras import CAMERA_FORMATS, CameraRecord
from markergen.read.cameras.calibration import without_k3
from markergen.read.cameras.document import yaml_text
from markergen.read.cameras.keys import keyed


def _holds(record: CameraRecord) -> bool:
    lens = without_k3(record).camera.distortion
    return lens.model in ("none", "equidistant") or (lens.model == "radtan" and len(lens.coefficients) == 4)


def _write(record: CameraRecord, ending: str) -> str:
    del ending
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


CAMERA_FORMATS.register("kalibr")(keyed("kalibr", (".kalibr.yaml", ".kalibr.yml"), _holds, _write))
