"""Cameras of other programs, each read as its own formulas project."""

import json
import struct

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.read.cameras import read_camera
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.formats import UNREADABLE
from markergen.read.remarks import collected_remarks

FILE = "camera.yaml"
LENS = (0.1, -0.2, 0.001, -0.002, 0.03, 0.02, -0.01, 0.004)
EYE = (-0.01, 0.003, -0.001, 0.0002)
NUMBERS = {"fx": 700.25, "fy": 701.5, "cx": 642.125, "cy": 355.75}
ONE_BY_ONE = dict(zip(("k1", "k2", "p1", "p2"), LENS[:4], strict=True))
EYE_BY_ONE = dict(zip(("k1", "k2", "k3", "k4"), EYE, strict=True))
SIDES = {"width": 1280, "height": 720}
MATRIX = [[700.25, 0, 642.125], [0, 701.5, 355.75], [0, 0, 1]]
ROWS = [number for row in MATRIX for number in row]
RADTAN, FIVE, RATIONAL = ("radtan", LENS[:4]), ("radtan", LENS[:5]), ("rational", LENS)
FISHEYE, FLAT = ("equidistant", EYE), ("none", ())


def lines(values, prefix=""):
    return "".join(f"{prefix}{key}: {value}\n" for key, value in values.items())


def camodocal(kind, projection, distortion=None):
    text = f"%YAML:1.0\n---\nmodel_type: {kind}\ncamera_name: left\nimage_width: 1280\nimage_height: 720\n"
    text += "" if distortion is None else f"distortion_parameters:\n{lines(distortion, '   ')}"
    return text + f"projection_parameters:\n{lines(projection, '   ')}"


def mrcal(model, terms=()):
    values = [*NUMBERS.values(), *terms]
    return (
        f"# generated with a tool\n{{\n 'lensmodel': 'LENSMODEL_{model}',\n # fx,fy,cx,cy\n 'intrinsics': {values},\n"
        " 'rt_cam_ref': [0,0,0,0,0,0],\n 'imagersize': [ 1280, 720,],\n 'icam_intrinsics': 0,\n"
        " 'optimization_inputs': b'ab[{,:#cd',\n}\n"
    )


KANNALA = dict(zip(("k2", "k3", "k4", "k5", "mu", "mv", "u0", "v0"), (*EYE, *NUMBERS.values()), strict=True))
NERF = {"fl_x": 700.25, "fl_y": 701.5, "cx": 642.625, "cy": 356.25, "w": 1280, "h": 720, "frames": []}
DEPTHAI = {**SIDES, "intrinsicMatrix": MATRIX, "extrinsics": {}, "lensPosition": 135, "specHfovDeg": 68.0}
VALUES = {**SIDES, **NUMBERS}
REALSENSE = {**SIDES, "fx": 700.25, "fy": 701.5, "ppx": 642.125, "ppy": 355.75}
ORB = 'Camera.type: "PinHole"\nCamera.width: 1280\nCamera.height: 720\n'
FILES = {
    "camodocal pinhole": (camodocal("PINHOLE", NUMBERS, ONE_BY_ONE), RADTAN),
    "camodocal fisheye": (camodocal("KANNALA_BRANDT", KANNALA), FISHEYE),
    "orb-slam": (f"%YAML:1.0\n{ORB}{lines(NUMBERS, 'Camera.')}{lines(ONE_BY_ONE, 'Camera.')}", RADTAN),
    "orb-slam 3": (f"{ORB}{lines(NUMBERS, 'Camera1.')}{lines(ONE_BY_ONE, 'Camera1.')}ThDepth: 3\n", RADTAN),
    "orb-slam fisheye": (
        ORB.replace("PinHole", "KannalaBrandt8") + lines({**NUMBERS, **EYE_BY_ONE}, "Camera."), FISHEYE,
    ),
    "stella": (
        "Camera:\n  name: x\n  model: perspective\n  cols: 1280\n  rows: 720\n"
        f"{lines({**NUMBERS, **ONE_BY_ONE, 'k3': LENS[4]}, '  ')}", FIVE,
    ),
    "stella fisheye": (
        f"Camera:\n  model: fisheye\n  cols: 1280\n  rows: 720\n{lines({**NUMBERS, **EYE_BY_ONE}, '  ')}", FISHEYE,
    ),
    "photonvision": (
        json.dumps({"resolution": SIDES, "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": ROWS},
                    "distCoeffs": {"rows": 1, "cols": 8, "type": 6, "data": LENS}, "lensmodel": "LENSMODEL_OPENCV",
                    "calobjectSize": {"width": 7, "height": 7}}), RATIONAL,
    ),
    "photonvision of old": (
        json.dumps({"resolution": SIDES, "cameraIntrinsics": {"rows": 3, "cols": 3, "data": ROWS},
                    "cameraExtrinsics": {"rows": 1, "cols": 5, "data": LENS[:5]}}), FIVE,
    ),
    "nerf": (json.dumps({**NERF, **ONE_BY_ONE, "camera_model": "OPENCV", "aabb_scale": 16}), RADTAN),
    "nerf fisheye": (json.dumps({**NERF, **EYE_BY_ONE, "camera_model": "OPENCV_FISHEYE"}), FISHEYE),
    "nerf flag": (json.dumps({**NERF, **EYE_BY_ONE, "is_fisheye": True}), FISHEYE),
    "mrcal pinhole": (mrcal("PINHOLE"), FLAT),
    "mrcal 4": (mrcal("OPENCV4", LENS[:4]), RADTAN),
    "mrcal 5": (mrcal("OPENCV5", LENS[:5]), FIVE),
    "mrcal 8": (mrcal("OPENCV8", LENS), RATIONAL),
    "mrcal 12": (mrcal("OPENCV12", (*LENS, 0, 0, 0, 0)), RATIONAL),
    "basalt": (
        json.dumps({"value0": {"T_imu_cam": [], "resolution": [[1280, 720]],
                               "intrinsics": [{"camera_type": "kb4", "intrinsics": {**NUMBERS, **EYE_BY_ONE}}]}}),
        FISHEYE,
    ),
    "basalt pinhole": (
        json.dumps({"value0": {"intrinsics": [{"camera_type": "pinhole", "intrinsics": NUMBERS}],
                               "resolution": [[1280, 720]]}}), FLAT,
    ),
    "realsense": (json.dumps({**REALSENSE, "model": "distortion.brown_conrady", "coeffs": LENS[:5]}), FIVE),
    "realsense inverse": (
        json.dumps({**REALSENSE, "model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5}), FLAT,
    ),
    "depthai": (
        json.dumps({"boardName": "x", "cameraData": [
            [0, {**DEPTHAI, "cameraType": 0, "distortionCoeff": [*LENS, *[0] * 6]}]]}), RATIONAL,
    ),
    "depthai fisheye": (
        json.dumps({"cameraData": [[1, {**DEPTHAI, "cameraType": 1, "distortionCoeff": [*EYE, *[0] * 10]}]]}), FISHEYE,
    ),
    "single numbers": (json.dumps({**VALUES, **ONE_BY_ONE}), RADTAN),
    "single numbers and a list": (json.dumps({**VALUES, "D": EYE, "model": "KannalaBrandt8"}), FISHEYE),
}  # fmt: skip


def pixels_by_opencv(rays, model, terms):
    import cv2

    points, zero = np.column_stack([rays, np.ones(len(rays))])[:, None], np.zeros(3)
    matrix = np.array(MATRIX)
    if model == "equidistant":
        return cv2.fisheye.projectPoints(points, zero, zero, matrix, np.array(terms))[0][:, 0]
    return cv2.projectPoints(points, zero, zero, matrix, np.array(terms or [0.0] * 4))[0][:, 0]


@pytest.mark.parametrize("name", FILES)
def test_each_program_s_camera_projects_as_opencv_does(write, name):
    text, (model, terms) = FILES[name]
    with collected_remarks() as remarks:
        camera = read_camera(write(text))
    assert (camera.width, camera.height, camera.distortion.model) == (1280, 720, model)
    rays = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
    np.testing.assert_allclose(camera.to_pixels(rays), pixels_by_opencv(rays, model, terms), atol=1e-9)
    assert not [line for line in remarks if "folds" not in line and "ThDepth" not in line and "aabb" not in line]


def binary(*cameras):
    data = struct.pack("<Q", len(cameras))
    for number, model, sides, parameters in cameras:
        data += struct.pack("<IiQQ", number, model, *sides) + struct.pack(f"<{len(parameters)}d", *parameters)
    return data


def test_colmap_s_binary_file(write):
    first = (7, 4, (1280, 720), (700.25, 701.5, 642.625, 356.25, *LENS[:4]))
    second = (9, 8, (100, 80), (90.0, 50.0, 40.0, 0.01))
    data = binary(first, second)
    path = write(data, "cameras.bin")
    one = read_camera(f"{path}#7")
    rays = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
    np.testing.assert_allclose(one.to_pixels(rays), pixels_by_opencv(rays, "radtan", LENS[:4]), atol=1e-9)
    assert read_camera(f"{path}#9").distortion.model == "equidistant"
    assert read_camera(write(binary(second), "one.bin")) == read_camera(f"{path}#9")
    with pytest.raises(InputError, match="found 7, 9; choose"):
        read_camera(path)
    for damaged in (data[:-1], data + b"\0", data[:60]):
        with pytest.raises(InputError):
            read_camera(write(damaged, "cut.bin"))


INTERACTIVE = """<?xml version="1.0"?>
<opencv_storage>
<calibrationDate>"Thu Nov 26 10:00:00 2026"</calibrationDate>
<framesCount>30</framesCount>
<cameraResolution>
  1280 720</cameraResolution>
<cameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>900. 0. 639.5 0. 901. 359.5 0. 0. 1.</data></cameraMatrix>
<cameraMatrix_std_dev type_id="opencv-matrix"><rows>4</rows><cols>1</cols><dt>d</dt>
  <data>1. 2. 0.8 0.7</data></cameraMatrix_std_dev>
<dist_coeffs type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt>
  <data>0.1 -0.2 0. 0. 0.03</data></dist_coeffs>
<dist_coeffs_std_dev type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
  <data>0.01 0.02 0. 0. 0.1</data></dist_coeffs_std_dev>
<avg_reprojection_error>2.1e-01</avg_reprojection_error>
</opencv_storage>
"""


def test_interactive_calibration_with_its_standard_deviations(write):
    path = write(INTERACTIVE)
    with collected_remarks() as remarks:
        camera = read_camera(path)
    assert not remarks
    assert (camera.width, camera.height, camera.fy, camera.distortion.coefficients[4]) == (1280, 720, 901.0, 0.03)
    covariance = camera_covariance(None, path, camera)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [1, 2, 0.8, 0.7, 0.01, 0.02, 0, 0, 0.1])
    wrong = INTERACTIVE.replace("<rows>4</rows>", "<rows>5</rows>").replace("0.8 0.7", "0.8 0.7 3")
    with pytest.raises(InputError, match="4 standard deviations"):
        camera_covariance(None, write(wrong), camera)


REFUSED = {
    "a known distortion model at model_type": camodocal("MEI", NUMBERS),
    "unified camera": camodocal("MEI", {"xi": 1, **NUMBERS}),
    "double sphere": json.dumps({"value0": {"intrinsics": [{"camera_type": "ds", "intrinsics": {**NUMBERS, "xi": 0.1}}],
                                           "resolution": [[1280, 720]]}}),
    "a known distortion model at lensmodel": mrcal("SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", [0] * 9),
    "8 intrinsics of LENSMODEL_OPENCV4": mrcal("OPENCV4", LENS[:5]),
    "no thin prism": mrcal("OPENCV12", (*LENS, 0, 0, 0.1, 0)),
    "RealSense lens": json.dumps({**REALSENSE, "model": "Inverse Brown Conrady", "coeffs": LENS[:5]}),
    "fl_x as of camera_angle_x": json.dumps({**NERF, "camera_angle_x": 0.3}),
    "one value at": json.dumps({**NERF, "frames": [{"fl_x": 3}]}),
    "a camera's name": json.dumps({"cameraData": [[0, DEPTHAI], [1, {**DEPTHAI, "width": 1281}]]}),
    "projection that is not modeled": json.dumps(
        {"cameraData": [[0, {**DEPTHAI, "cameraType": 2, "distortionCoeff": [0]}]]}
    ),
    "the coefficients none of none": json.dumps({**VALUES, "k1": 0.1, "model": "linear"}),
    "the coefficients k1, k2, k3, k4 of equidistant": json.dumps({**VALUES, "k1": 0.1, "p1": 0.1, "model": "fisheye"}),
    "the lens's name beside k1 to k4": json.dumps({**VALUES, **EYE_BY_ONE}),
}  # fmt: skip


@pytest.mark.parametrize("phrase", REFUSED)
def test_what_is_not_modeled_is_refused_by_name(write, phrase):
    with pytest.raises(InputError) as caught:
        read_camera(write(REFUSED[phrase]))
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


BEGINNINGS = [
    b'{"control_points": []}',
    b"\x93NUMPY\x01\0v\0{'descr'", b"PK\x03\x04\x14\0", b"\x80\x04\x95", b"MATLAB 5.0 MAT-file",
    b"% x\nfc = [ 657 ; 658 ];", b"#ROSBAG V2.0\n", b"SQLite format 3\0",
    b"<calibration>\n<projection>frame</projection>", b'{"sfm_data_version": "0.3"}', b"# Bundle file v0.3\n",
    b"#polynomial coefficients for the DIRECT mapping function", b' Intrinsic of "Color" / 640x480',
    b'<rdf:Description xcr:Version="3" xcr:DistortionModel="brown3"', b'Camera:  CamType:  "area_scan_division";',
    b"#Focal Length mm assuming a sensor width of 17.30x12.98mm\nF 15.1\n", b"NVM_V3\n\n2\na.jpg 700 1 0 0 0\n",
    b'<Cameras><Camera><KeyFrame VICON_RADIAL="0 0"/>', b'<lensdatabase version="1">',
    b'<sdf version="1.6"><model name="c">',
    b"p = \n\n  cameraParameters with properties:\n",
    b'{"CalibrationInformation": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}}',
    b'[{"id": 0, "img_name": "a", "width": 1280}]', b'[{"token": "a", "sensor_token": "b"}]', b"BLENDER-v300",
    b"\x89HDF\r\n",
    b"cam0 (/cam0/image_raw):\n    type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>",
    b'{"polymorphic_name": "libCalib::CameraModelOpenCV"}',
    '{"CaptureSettings": [{"ImageType": 0, "Width": 640, "Height": 480, "FOV_Degrees": 90}]}',
    "P0: 7.188560e+02 0 6.071928e+02 0 0 7.188560e+02 1.852157e+02 0 0 0 1 0\n",
    '{"CameraCalibrations": [{"Label": "camera-rgb", "Projection": {"Name": "FisheyeRadTanThinPrism"}}]}',
    b"Model = CAHV = perspective, linear\n",
]  # fmt: skip


@pytest.mark.parametrize(("data", "row"), list(zip(BEGINNINGS, UNREADABLE["camera"], strict=True)))
def test_other_programs_files_are_named_with_a_way_out(write, data, row):
    with pytest.raises(InputError) as caught:
        read_camera(write(data))
    assert caught.value.args[1:] == row[1:]


def test_single_numbers_are_one_camera(write):
    values = {**VALUES, **ONE_BY_ONE}
    assert Camera.load(values).distortion.names == ("k1", "k2", "p1", "p2")
    path = write(json.dumps(values))
    with pytest.raises(InputError, match="no camera name"):
        read_camera(f"{path}#1")
