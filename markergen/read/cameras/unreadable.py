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
    (rb"xcr:\w+=", "a camera of RealityCapture or RealityScan", _COLMAP),
    (rb"CamType:|\AParGroup", "camera parameters of HALCON", "cam_par_to_cam_mat gives K: write it as YAML"),
    (rb"^#\s*Focal Length mm", "a camera of Pix4D", "write its lengths in px as fx, fy, cx, cy in YAML"),
    (rb"\ANVM_V\d", "a scene of VisualSFM", _COLMAP),
    (rb"VICON_RADIAL|<intrinsic [^>]*focallength", "a calibration of Vicon or Qualisys", _OPENCV),
    (rb"<lensdatabase", "lenses of lensfun, whose models are others", "calibrate with OpenCV"),
    (rb"<sdf\b|<robot\b|<mujoco\b", "a simulator's model", "save one message of its camera_info topic"),
    (rb"cameraParameters with properties", "what MATLAB prints", "write jsonencode(toStruct(params)) to a file"),
    (rb"CALIBRATION_LensDistortionModel", "a raw calibration of an Azure Kinect", "save its ROS camera_info"),
    (rb"\"img_name\"\s*:", "cameras of a Gaussian splatting, without centers", _COLMAP),
    (rb"\"sensor_token\"\s*:", "sensors of nuScenes", "write one camera_intrinsic alone as JSON"),
    (rb"\ABLENDER", "a scene of Blender", "write its sensor as fx, fy, cx, cy in px as YAML"),
    (rb"\A\x89HDF", "an HDF5 file", _ARRAYS),
    (rb"CAHVORE?\b|^Model = CAHV", "a CAHVOR camera", "convert it to mrcal's LENSMODEL_OPENCV8"),
]  # fmt: skip
"""What such a file has, what it is, and what to do."""

_BEGINNING = 20_000


def refuse_unreadable(document: Document) -> None:
    """Refuse a file that is recognized and not read; raises InputError with the way out."""
    for signature, name, remedy in UNREADABLE:
        if re.search(signature, document.data[:_BEGINNING], re.MULTILINE):
            raise InputError(f"a camera in {document.name}", name, remedy)
