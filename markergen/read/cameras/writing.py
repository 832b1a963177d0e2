"""Write a camera as a file of the format that its name says."""

import os
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from markergen.errors import InputError, brief
from markergen.files import write_atomic
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat, CameraRecord
from markergen.read.cameras.covariance import read_camera_covariance


def camera_file(
    camera: Camera,
    path: str | os.PathLike[str],
    covariance: ArrayLike | None = None,
    rms: float | None = None,
) -> None:
    """Write a camera to a file; see `Camera.save`."""
    path = Path(path)
    form, ending = _format(path)
    known = None if covariance is None else read_camera_covariance(np.asarray(covariance), camera)
    if rms is not None and not (isfinite(rms) and rms >= 0):
        raise InputError("the RMS of the residuals in px", brief(rms), "give 0 or more, or leave it out")
    record = CameraRecord(camera, known, None if rms is None else float(rms))
    if not form.holds(record):
        stem = path.name[: -len(ending)].rstrip(".") or "camera"
        forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
        able = [each.endings[0].lstrip(".") for each in forms if each.write and each.holds(record)]
        raise InputError(
            f"a lens that {path.name} can hold",
            f"{camera.distortion.model} with {' '.join(camera.distortion.names)}",
            "write " + " or ".join(each if each == "cameras.txt" else f"{stem}.{each}" for each in able),
        )
    assert form.write is not None
    write_atomic(path, form.write(record, ending).encode())


def _written() -> list[tuple[str, CameraFormat]]:
    """Endings of file names with their formats, the longest first."""
    forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
    pairs = [(ending, form) for form in forms if form.write for ending in form.endings]
    return sorted(pairs, key=lambda pair: -len(pair[0]))


def _format(path: Path) -> tuple[CameraFormat, str]:
    for ending, form in _written():
        if path.name.lower().endswith(ending):
            return form, ending
    known = ", ".join(sorted(ending for ending, _ in _written()))
    raise InputError("a name for a camera file", brief(path.name), f"known endings: {known}")
