"""Calibrations of programs that are recognized and not read, each with a way out."""

# tests: tests/read/test_camera_programs.py

import re

from markergen.errors import InputError
from markergen.read.cameras.document import Document

_ARRAYS = "in Python, Camera.from_cv2(K, D, (width, height)).save('camera.yaml') writes one that is read"
_OPENCV = "export it as OpenCV's XML or YAML, or calibrate with OpenCV"
_COLMAP = "convert it to COLMAP, and give cameras.txt"

UNREADABLE: list[tuple[bytes, str, str]] = [
    (rb"\A\x93NUMPY", "a NumPy array, without an image size", _ARRAYS),
    (rb"\APK\x03\x04", "an archive such as .npz", _ARRAYS),
    (rb"\A\x80[\x02-\x05]", "a Python pickle, which may run programs", _ARRAYS),
    (rb"\AMATLAB \d", "a MAT-file", "cameraIntrinsicsToOpenCV of MATLAB gives K and D: write them as YAML"),
    (rb"^\s*fc\s*=\s*\[", "Calib_Results.m", "write fc and cc as camera_matrix, kc as distortion_coefficients"),
    (rb"\A#ROSBAG", "a ROS bag", "save one message: rostopic echo -n 1 /camera/camera_info > camera.yaml"),
    (rb"\ASQLite format 3", "a database", "save one camera_info of a ROS bag, or cameras.txt of COLMAP"),
    (rb"<projection>|<chunks?\b|<calibration class|agisoft", "a calibration of Agisoft Metashape", _OPENCV),
    (rb"\"sfm_data_version\"|\"featuresFolders\"", "a scene of OpenMVG or Meshroom", _COLMAP),
    (rb"\A# Bundle file", "a scene of Bundler", _COLMAP),
    (rb"DIRECT mapping function|<poly\b.*ocam", "OCamCalib's polynomial", "calibrate with cv2.fisheye"),
    (rb"^\s*Intrinsic of \"", "all intrinsics of a RealSense", "write one as JSON: width, height, fx, fy, ppx..."),
    (rb"CAHVORE?\b|^Model = CAHV", "a CAHVOR camera", "convert it to mrcal's LENSMODEL_OPENCV8"),
]  # fmt: skip
"""What such a file has, what it is, and what to do."""

_BEGINNING = 20_000


def refuse_unreadable(document: Document) -> None:
    """Refuse a file that is recognized and not read; raises InputError with the way out."""
    for signature, name, remedy in UNREADABLE:
        if re.search(signature, document.data[:_BEGINNING], re.MULTILINE):
            raise InputError(f"a camera in {document.name}", name, remedy)
