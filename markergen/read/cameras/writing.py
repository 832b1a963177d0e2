"""Write a camera as a file of the format that its name says."""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

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
from markergen.read.endings import by_ending


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
    forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
    return by_ending(((end, form) for form in forms if form.write for end in form.endings), Path(path), "a camera file")
