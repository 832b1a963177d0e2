"""The camera table of a design spec, alone or as [camera], in TOML, JSON or YAML; it holds every lens model."""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import json

from markergen.read.cameras import CAMERA_FORMATS, COVARIANCE, CameraRecord
from markergen.read.cameras.keys import keyed


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


CAMERA_FORMATS.register("markergen")(keyed("markergen", (".toml",), write=_write))
