"""The camera table of a design spec, alone or as [camera], in TOML, JSON or YAML; it holds every lens model."""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import json

from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import CAMERA_FORMATS, COVARIANCE, NAMES, RMS, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import COEFFICIENTS, make_camera, no_choice, with_place
from markergen.read.cameras.document import Document, Fields


def _fields(document: Document) -> Fields:
    table = document.fields
    return table.fields("camera") if isinstance(table.values.get("camera"), dict) else table


def _fits(document: Document) -> bool:
    table = _fields(document)
    return "fx" in table.values and not table.find("k1", "ppx", *COEFFICIENTS)


def _read(document: Document, choice: str | None) -> Camera:
    no_choice(document.name, choice)
    table = _fields(document)
    # A misspelled distortion must not yield a camera without any.
    table.only("width", "height", "fx", "fy", "cx", "cy", "distortion", NAMES, COVARIANCE, RMS)
    distortion = Distortion()
    if "distortion" in table.values:
        lens = table.fields("distortion")
        lens.only("model", "coefficients")
        with with_place(lens.place()):
            distortion = Distortion(lens.text("model"), tuple(lens.numbers("coefficients")))
    fx, fy, cx, cy = (table.number(key) for key in ("fx", "fy", "cx", "cy"))
    width, height = table.whole("width"), table.whole("height")
    return make_camera(
        width, height, (fx, fy, cx, cy), distortion, table.place("fx fy cx cy"), table.place("width height")
    )


def _table(document: Document, choice: str | None) -> Fields:
    no_choice(document.name, choice)
    return _fields(document)


def _write(record: CameraRecord, ending: str) -> str:
    del ending
    values = record.camera.as_dict() | record.extras
    lens = values.pop("distortion", None)
    if COVARIANCE in values:
        values[COVARIANCE] = values[COVARIANCE].tolist()
    # Numbers, texts and lists are the same in TOML and JSON.
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    lines += ["", "[distortion]", *(f"{key} = {json.dumps(value)}" for key, value in lens.items())] if lens else []
    return "\n".join(lines) + "\n"


CAMERA_FORMATS.register("markergen")(
    CameraFormat("width, height, fx, fy, cx, cy, distortion", _fits, _read, _table, endings=(".toml",), write=_write)
)
