"""Kalibr's camchain: one table per camera, cam0, cam1, ..."""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import re

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import make_camera, make_distortion, without_k3
from markergen.read.cameras.document import Document, Fields, yaml_text
from markergen.read.cameras.statements import BY_COUNT, check_statements, lens_name, stated_lens

_NAME = re.compile(r"cam\d{1,3}")


def _names(document: Document) -> list[str]:
    return [key for key, value in document.fields.values.items() if _NAME.fullmatch(key) and isinstance(value, dict)]


def _table(document: Document, choice: str | None) -> Fields:
    names = _names(document)
    name = "cam0" if choice is None else choice
    if name not in names:
        raise InputError(
            f"the camera {brief(name)} in {document.name}", ", ".join(names[:20]), f"add #{names[0]} to the path"
        )
    return document.fields.fields(name)


def _read(document: Document, choice: str | None) -> Camera:
    table = _table(document, choice)
    model = table.text("camera_model")
    if model != "pinhole":
        raise InputError(
            f"the camera model pinhole at {table.place('camera_model')}",
            repr(model),
            "calibrate with pinhole-radtan or pinhole-equi",
        )
    check_statements([table])
    intrinsics, size = table.numbers("intrinsics"), table.numbers("resolution")
    if len(intrinsics) != 4:
        raise InputError(f"fu, fv, pu, pv at {table.place('intrinsics')}", brief(intrinsics), "correct the file")
    if len(size) != 2 or not all(side.is_integer() for side in size):
        raise InputError(f"width and height at {table.place('resolution')}", brief(size), "correct the file")
    model = table.text("distortion_model")
    coefficients = [] if model == "none" else table.numbers("distortion_coeffs")
    if table.find("distortion_coeffs") and model == "none":
        table.key("distortion_coeffs")
    stated, place = stated_lens([table])
    if stated not in (BY_COUNT, "") and model and stated != lens_name(model):
        raise InputError(
            f"one lens at {table.place('distortion_model')}", f"another at {place}", "remove the wrong one"
        )
    distortion = make_distortion(
        model or "none", coefficients, table.place("distortion_model"), table.place("distortion_coeffs")
    )
    fu, fv, pu, pv = intrinsics
    width, height = (int(side) for side in size)
    return make_camera(
        width, height, (fu, fv, pu, pv), distortion, table.place("intrinsics"), table.place("resolution")
    )


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


CAMERA_FORMATS.register("kalibr")(
    CameraFormat(
        "cam0 with camera_model, intrinsics, resolution",
        lambda document: bool(_names(document)),
        _read,
        _table,
        (".kalibr.yaml", ".kalibr.yml"),
        _holds,
        _write,
    )
)
