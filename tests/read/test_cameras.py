import io
import json
from array import array
from types import SimpleNamespace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.camera import NO_DISTORTION, PAPER_CAMERA, Camera, Distortion
from markergen.read.cameras import CAMERA_FORMATS, read_camera
from markergen.read.cameras.covariance import read_camera_covariance

FILE = "camera.yaml"

# As the tools write them: OpenCV's calibration sample (4 and 5), ROS's camera_calibration, a printed message, Kalibr,
# COLMAP.
OPENCV_YAML = """\
%YAML:1.0
---
calibration_time: "Tue 04 Mar 2025 10:12:55 AM CET"
nframes: 25
image_width: 640
image_height: 480
board_width: 9
board_height: 6
square_size: 2.4999999999999998e-02
# flags: +zero_tangent_dist
flags: 8
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.5746697810243404e+02, 0., 3.1950000000000000e+02, 0.,
       6.5746697810243404e+02, 2.3950000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -4.1802327018241026e-01, 5.0715243805833121e-01, 0., 0.,
       -5.7843596847939704e-01 ]
avg_reprojection_error: 3.2692045620038797e-01
per_view_reprojection_errors: !!opencv-matrix
   rows: 3
   cols: 1
   dt: f
   data: [ 1.78262725e-01, .Nan, 2.11562961e-01 ]
"""
OPENCV_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Tue 04 Mar 2025 10:12:55 AM CET"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<!-- flags: +fix_aspectRatio -->
<fisheye_model>1</fisheye_model>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    3.0125e+02 0. 3.21e+02 0. 3.0150000000000000e+02 2.385e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>4</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -1.25e-02 2.0000000000000000e-03
    -3.0e-03 5.0e-04</data></distortion_coefficients>
</opencv_storage>
"""
ROS_YAML = """\
image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [536.57137, 0, 315.05552, 0, 537.71388, 241.03827, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.396212, -1.08494, -1.64e-04, -0.0051, 1.008032]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [550.75, 0, 312.12, 0, 0, 556.34, 241.25, 0, 0, 0, 1, 0]
"""
ROS_MESSAGE = """\
header:
  seq: 12
  stamp: {secs: 1700000000, nsecs: 5}
  frame_id: "camera_optical"
height: 720
width: 1280
distortion_model: "rational_polynomial"
D: [0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.40, -2.35, 1.41]
K: [608.1, 0.0, 639.2, 0.0, 607.9, 366.5, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [600.0, 0.0, 640.0, 0.0, 0.0, 600.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
"""
KALIBR_YAML = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  distortion_model: radtan
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.9999, 0.0021, 0.0042, -0.11]
  - [-0.0022, 0.9998, 0.0135, 0.0004]
  - [-0.0042, -0.0135, 0.9998, -0.0006]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.0020, 0.0002]
  distortion_model: equidistant
  intrinsics: [190.978, 190.973, 254.931, 256.897]
  resolution: [512, 512]
  rostopic: /cam1/image_raw
"""
COLMAP_TXT = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
1 OPENCV 3072 2304 2559.81 2561.02 1536 1152 -0.031 0.012 0.0001 -0.0002
2 SIMPLE_RADIAL 1000 800 900.5 500 400 0.05
"""
COLMAP_LINE = COLMAP_TXT.splitlines()[-1]
PLAIN = {"width": 640, "height": 480, "fx": 800.0, "fy": 801.5, "cx": 320.0, "cy": 240.0}


def test_opencv_yaml(write):
    assert read_camera(write(OPENCV_YAML)) == Camera(
        640, 480, 657.46697810243404, 657.46697810243404, 319.5, 239.5,
        Distortion("radtan", (-0.41802327018241026, 0.50715243805833121, 0.0, 0.0, -0.57843596847939704)),
    )  # fmt: skip


def test_opencv_xml_of_a_fisheye(write):
    # Told from YAML by what is in it, not by the name.
    assert read_camera(write(OPENCV_XML)) == Camera(
        640, 480, 301.25, 301.5, 321.0, 238.5, Distortion("equidistant", (-0.0125, 0.002, -0.003, 0.0005))
    )


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("count", [0, 4, 5, 8, 14])
def test_what_this_opencv_writes(tmp_path, suffix, count):
    import cv2

    path = tmp_path / f"camera.{suffix}"
    coefficients = np.array([0.1, -0.2, 1e-3, 1 / 3, 0.02, 0.3, 0.1, -0.05, 0, 0, 0, 0, 0, 0])[:count]
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", np.array([[1000 / 3, 0, 640], [0, 1e3 / 7, 360], [0, 0, 1]]))
    if count:
        storage.write("distortion_coefficients", coefficients[:, None])
    storage.release()
    model = {0: "none", 4: "radtan", 5: "radtan", 8: "rational", 14: "rational"}[count]
    # To the last bit; the six zeros of a tilted sensor with thin prisms are not needed.
    assert read_camera(path) == Camera(
        1280, 720, 1000 / 3, 1e3 / 7, 640.0, 360.0, Distortion(model, tuple(coefficients[:8]))
    )


def test_hand_written_opencv(write):
    text = "K: [[500, 0, 320], [0, 510, 240], [0, 0, 1]]\nD: [[-0.1, 0.01, 0, 0]]\nimage_size: [640, 480]\n"
    camera = Camera(640, 480, 500.0, 510.0, 320.0, 240.0, Distortion("radtan", (-0.1, 0.01, 0.0, 0.0)))
    assert read_camera(write(text)) == camera
    assert read_camera(write("fisheye: true\n" + text)).distortion.model == "equidistant"
    old = OPENCV_YAML.replace("camera_matrix", "Camera_Matrix").replace("image_width", "image_Width")
    assert read_camera(write(old)) == read_camera(write(OPENCV_YAML))


def test_ros_yaml_takes_k_not_p(write):
    assert read_camera(write(ROS_YAML)) == Camera(
        640, 480, 536.57137, 537.71388, 315.05552, 241.03827,
        Distortion("radtan", (0.396212, -1.08494, -1.64e-4, -0.0051, 1.008032)),
    )  # fmt: skip


def test_ros_messages(write):
    camera = Camera(
        1280, 720, 608.1, 607.9, 639.2, 366.5,
        Distortion("rational", (0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.40, -2.35, 1.41)),
    )  # fmt: skip
    assert read_camera(write(ROS_MESSAGE)) == camera
    # ROS 2 has small letters; some tools wrap the message.
    small = ROS_MESSAGE.replace("D:", "d:").replace("K:", "k:").replace("P:", "p:").replace("R:", "r:")
    assert read_camera(write(small)) == camera
    lines = ROS_MESSAGE.replace("---\n", "").splitlines()
    assert read_camera(write("camera_info:\n" + "\n".join("  " + line for line in lines))) == camera
    simulated = ROS_MESSAGE.replace("rational_polynomial", "plumb_bob")
    simulated = simulated.replace("[0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.40, -2.35, 1.41]", "[]")
    assert read_camera(write(simulated)) == camera.ideal


def test_kalibr(write):
    path = write(KALIBR_YAML, "camchain.yaml")
    first = Camera(
        752, 480, 461.629, 460.152, 362.680, 246.049,
        Distortion("radtan", (-0.27695497, 0.06712482, 0.00087538, 0.00011556)),
    )  # fmt: skip
    assert read_camera(path) == read_camera(f"{path}#cam0") == first
    assert read_camera(f"{path}#cam1") == Camera(
        512, 512, 190.978, 190.973, 254.931, 256.897, Distortion("equidistant", (0.0034, 0.0007, -0.0020, 0.0002))
    )
    none = KALIBR_YAML.replace("distortion_model: radtan", "distortion_model: none").replace(
        "[-0.27695497, 0.06712482, 0.00087538, 0.00011556]", "[]"
    )
    assert read_camera(write(none)) == first.ideal
    with pytest.raises(InputError, match=r"'cam2' in .*, found cam0, cam1; add #cam0"):
        read_camera(f"{path}#cam2")
    # A file whose name has the mark is that file.
    assert read_camera(write(KALIBR_YAML, "chain#cam1")) == first


def test_colmap_counts_from_the_corner(write):
    path = write(COLMAP_TXT, "cameras.txt")
    assert read_camera(f"{path}#1") == Camera(
        3072, 2304, 2559.81, 2561.02, 1535.5, 1151.5, Distortion("radtan", (-0.031, 0.012, 0.0001, -0.0002))
    )
    second = Camera(1000, 800, 900.5, 900.5, 499.5, 399.5, Distortion("radtan", (0.05, 0.0, 0.0, 0.0)))
    assert read_camera(f"{path}#2") == second
    with pytest.raises(InputError, match=r"#1, found 1, 2; choose"):
        read_camera(path)
    with pytest.raises(InputError, match="the camera '3' in"):
        read_camera(f"{path}#3")
    assert read_camera(write(COLMAP_LINE)) == second


@pytest.mark.parametrize(
    ("line", "camera"),
    [
        ("SIMPLE_PINHOLE 100 80 90 50 40", ((90, 90), "none", ())),
        ("PINHOLE 100 80 90 91 50 40", ((90, 91), "none", ())),
        ("RADIAL 100 80 90 50 40 .1 .2", ((90, 90), "radtan", (0.1, 0.2, 0, 0))),
        ("FULL_OPENCV 100 80 90 91 50 40 1 2 3 4 5 6 7 8", ((90, 91), "rational", (1, 2, 3, 4, 5, 6, 7, 8))),
        ("OPENCV_FISHEYE 100 80 90 91 50 40 .1 .2 .3 .4", ((90, 91), "equidistant", (0.1, 0.2, 0.3, 0.4))),
        ("RADIAL_FISHEYE 100 80 90 50 40 .1 .2", ((90, 90), "equidistant", (0.1, 0.2, 0, 0))),
        ("SIMPLE_RADIAL_FISHEYE 100 80 90 50 40 .1", ((90, 90), "equidistant", (0.1, 0, 0, 0))),
        ("SIMPLE_FISHEYE 100 80 90 50 40", ((90, 90), "equidistant", (0, 0, 0, 0))),
        ("FISHEYE 100 80 90 91 50 40", ((90, 91), "equidistant", (0, 0, 0, 0))),
    ],
)
def test_colmap_models(write, line, camera):
    focal, model, coefficients = camera
    assert read_camera(write(f"7 {line}\n")) == Camera(100, 80, *focal, 49.5, 39.5, Distortion(model, coefficients))


def test_plain_tables(write):
    toml = "\n".join(f"{key} = {value}" for key, value in PLAIN.items())
    pinhole = Camera(640, 480, 800.0, 801.5, 320.0, 240.0)
    lens = Distortion("radtan", (-0.1, 0.01, 0.0, 1e-4))
    assert read_camera(write(toml)) == read_camera(write("# mine\n[camera]\n" + toml)) == pinhole
    table = '\n[distortion]\nmodel = "radtan"\ncoefficients = [-0.1, 0.01, 0, 1e-4]\n'
    assert read_camera(write(toml + table)).distortion == lens
    # What a camera writes, it reads.
    camera = Camera(640, 480, 800 / 3, 801.5, 320.0, 240.0, lens)
    for text in (json.dumps(camera.as_dict()), json.dumps({"camera": camera.as_dict()}, indent=2)):
        assert read_camera(write(text)) == camera
    assert read_camera(write(json.dumps(camera.ideal.as_dict()))).distortion == NO_DISTORTION


def test_the_table_of_formats_is_told_where_none_fits(write):
    with pytest.raises(InputError) as caught:
        read_camera(write("a: 1\n"))
    assert {"colmap", "kalibr", "markergen", "opencv", "ros"} < set(CAMERA_FORMATS)
    assert all(name in str(caught.value) and CAMERA_FORMATS[name].signs in str(caught.value) for name in CAMERA_FORMATS)


def damaged(text, old, new):
    assert old in text
    return text.replace(old, new)


BAD = [
    (OPENCV_YAML, "image_width: 640\n", "", "the key image_width or width in"),
    (OPENCV_YAML, "image_width: 640", "image_width: 640.5", "a whole number at image_width in"),
    (OPENCV_YAML, "image_width: 640", "image_width: 0", "at image_width and image_height in"),
    (OPENCV_YAML, "image_width: 640", "image_width: 300", "principal point inside the image of 300x480 px at camera_m"),
    (OPENCV_YAML, "data: [ 6.5746697810243404e+02, 0.,", "data: [ -6e2, 0.,", "focal lengths at camera_matrix in"),
    (OPENCV_YAML, "data: [ 6.5746697810243404e+02, 0.,", "data: [ 6e2, 0.5,", "[fx 0 cx; 0 fy cy; 0 0 1] at camera_m"),
    (OPENCV_YAML, "data: [ 6.5746697810243404e+02, 0.,", "data: [ .Nan, 0.,", "finite number at camera_matrix.data in"),
    (OPENCV_YAML, "data: [ 6.5746697810243404e+02, 0.,", "data: [ 0.,", "rows times cols numbers at camera_matrix.d"),
    (OPENCV_YAML, "0., 0., 1. ]", "0., 0., 1. ", "complete YAML or JSON in"),
    (OPENCV_YAML, "image_height: 480", "image_width: 480", "line 6: a key twice"),
    (OPENCV_YAML, "rows: 5\n   cols: 1", "rows: 1\n   cols: 1", "distortion_coefficients.data in"),
    (OPENCV_YAML, "-5.7843596847939704e-01", "1, 2", "rows times cols numbers at distortion_coefficients."),
    (OPENCV_YAML, "flags: 8", "flags: *a", "line 11: an alias of nothing"),
    (OPENCV_XML, "5.0e-04", "5.0e-04 1", "distortion_coefficients.data in"),
    (OPENCV_XML, "</opencv_storage>", "", "complete XML in"),
    (OPENCV_XML, "<opencv_storage>", '<!DOCTYPE x [<!ENTITY a "b">]><opencv_storage>', "a document type"),
    (ROS_YAML, "  rows: 3\n  cols: 3\n  data: [5", "  rows: 2\n  cols: 3\n  data: [5", "camera_matrix.data in"),
    (ROS_YAML, "  cols: 5", "  cols: 4", "found 1 x 4 and 5 numbers; correct the file"),
    (ROS_YAML, "plumb_bob", "double_sphere", "a known distortion model at distortion_model in"),
    (ROS_YAML, "plumb_bob", "equidistant", "4 coefficients of the distortion model 'equidistant' at distortion_coeff"),
    (ROS_YAML, "plumb_bob", "none", "0 coefficients of the distortion model 'none' at distortion_coefficients in"),
    (ROS_YAML, "241.03827", "641.03827", "a principal point inside the image of 640x480 px at camera_matrix in"),
    (ROS_MESSAGE, "binning_x: 0", "binning_x: -2", "a binning at binning_x in"),
    (ROS_MESSAGE, "  width: 0", "  width: 1640", "a part of the image of 1280x720 px at roi in"),
    (ROS_MESSAGE, "K: [608.1", "K: [[608.1]", "finite number at K in"),
    (ROS_MESSAGE, "K: [608.1, ", "K: [", "a 3x3 camera matrix at K in"),
    (KALIBR_YAML, "camera_model: pinhole", "camera_model: omni", "model at cam0.camera_model in"),
    (KALIBR_YAML, "distortion_model: radtan", "distortion_model: fov", "model at cam0.distortion_model in"),
    (KALIBR_YAML, "[752, 480]", "[752]", "width and height at cam0.resolution in"),
    (KALIBR_YAML, "[461.629, ", "[", "fu, fv, pu, pv at cam0.intrinsics in"),
    (KALIBR_YAML, "-0.27695497, ", "", "of the distortion model 'radtan' at cam0.distortion_coeffs"),
    (KALIBR_YAML, "  intrinsics: [461.629, 460.152, 362.680, 246.049]\n", "", "the key camera_matrix or K in"),
    (COLMAP_LINE, "SIMPLE_RADIAL 1000 800", "FOV 1000 800 900", "a known distortion model at 2.distortion_model in"),
    (COLMAP_LINE, " 0.05", "", "4 parameters of SIMPLE_RADIAL at camera 2 in"),
    (COLMAP_LINE, "1000 800", "1e9 800", "an image size of 1 to 20000 pixels at 2.width"),
    (COLMAP_LINE, "0.05", "nan", "a finite number at 2.D in"),
    (COLMAP_LINE, " 1000 800 900.5 500 400 0.05", " 9", "MODEL WIDTH HEIGHT PARAMS at camera 2"),
    (json.dumps(PLAIN), '"cy"', '"cz"', "the key cy or ppy in"),
    (json.dumps(PLAIN), "801.5", "true", "a finite number at fy in"),
    (json.dumps(PLAIN), "801.5", "1e999", "a finite number at fy in"),
    (json.dumps(PLAIN), "}", ', "distortion": 3}', "coefficients of the distortion model 'radtan' at distortion in"),
    (json.dumps(PLAIN), "}", ', "distortion": {"model": "omni", "coefficients": []}}', "model at distortion.model in"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "old", "new", "phrase"), BAD)
def test_each_kind_of_damage_is_named(write, text, old, new, phrase):
    path = write(damaged(text, old, new), "mine.cfg")
    with pytest.raises(InputError) as caught:
        read_camera(path)
    assert phrase in str(caught.value)
    assert "mine.cfg" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_terms_that_are_not_modeled_are_refused(write):
    numbers = ", ".join(["0.1"] * 12)
    text = f"K: [500, 0, 320, 0, 510, 240, 0, 0, 1]\nD: [{numbers}]\nimage_size: [640, 480]\n"
    with pytest.raises(InputError, match="thin prism and"):
        read_camera(write(text))


@pytest.mark.parametrize(
    ("data", "phrase"),
    [
        (b"", "an empty file"),
        (b" \n", "an empty file"),
        (b"\x89PNG\r\n\x1a\n\0\0", "bytes that are not UTF-8 text"),
        (b"a: \0", "bytes that are not UTF-8 text"),
        (b"just words", "an unknown format"),
        (b"- 1\n- 2\n", "an unknown format"),
        (b" " * 1_000_000 + b"a", "at most 1 MB"),
        (b"[" * 500_000, "endless nesting"),
        (b"- " * 400_000, "endless nesting"),
        (b"a=" + b"[" * 5000, "endless nesting"),
        (b"a" + b".a" * 49_000 + b" = 1", "at most 10 kB of TOML"),
        (b"fx = " + b"9" * 5000, "an endless number"),
        (b"<a>" * 200_000, "complete XML"),
        (b'<!DOCTYPE l [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><l>&b;</l>', "a document type"),
        (b"? [a]\n: 1\n", "a key that is not text"),
        (b"a: \x01", "characters that are not text"),
        (b"a: &a [*a]\nK: *a\nimage_width: 3\n", "a finite number at K"),
    ],
)
def test_what_is_no_calibration_is_one_line(write, data, phrase):
    with pytest.raises(InputError) as caught:
        read_camera(write(data))
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_aliases_are_not_expanded(write):
    levels = "".join(f"b{i}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]\n" for i in range(40))
    with pytest.raises(InputError, match="at K in"):
        read_camera(write(f"a: &a0 [1, 1]\n{levels}K: *a40\n"))
    merges = "".join(f"b{i}: &a{i + 1} {{<<: [{', '.join([f'*a{i}'] * 9)}]}}\n" for i in range(40))
    with pytest.raises(InputError, match="an unknown format"):
        read_camera(write(f"a: &a0 {{x: 1}}\n{merges}"))
    # An alias for what stands elsewhere is fine: YAML writers use them for equal lists.
    path = write(damaged(KALIBR_YAML, "[752, 480]", "&size [752, 480]").replace("[512, 512]", "*size"))
    assert (read_camera(f"{path}#cam1").width, read_camera(f"{path}#cam1").height) == (752, 480)


def test_files_that_cannot_be_read(tmp_path):
    for path, phrase in ((tmp_path, "Is a directory"), (tmp_path / "none.yaml", "No such file"), ("a\0b", "null")):
        with pytest.raises(InputError, match=phrase):
            read_camera(path)
        with pytest.raises(InputError, match=phrase):
            read_camera_covariance(path, PAPER_CAMERA)
    (tmp_path / "one.yaml").write_text(ROS_YAML)
    with pytest.raises(InputError, match="'cam1'; leave it"):
        read_camera(tmp_path / "one.yaml#cam1")


NUMBERS = {"width": 640, "height": 480, "fx": 800.0, "fy": 801.0, "cx": 320.0, "cy": 240.0}
LENS = Distortion("radtan", (0.1, -0.2, 0.001, 0.002, 0.0))
BENT = Camera(**NUMBERS, distortion=LENS)
MATRIX = np.array([[800, 0, 320], [0, 801, 240], [0, 0, 1.0]])


def test_a_camera_is_loaded_from_whatever_holds_it(write, tmp_path):
    path = write(ROS_YAML)
    camera = read_camera(path)
    with path.open("rb") as binary, path.open(encoding="utf-8") as text:
        for source in (str(path), path, binary, text, io.StringIO(ROS_YAML), io.BytesIO(ROS_YAML.encode())):
            assert Camera.load(source) == camera
    assert Camera.load(BENT.as_dict()) == BENT
    assert Camera.load({**BENT.as_dict(), "fx": np.float32(800), "cx": np.float64(320)}) == BENT
    assert (
        Camera.load({"camera_matrix": MATRIX, "dist": np.array([LENS.coefficients]), "image_size": (640, 480)}) == BENT
    )


def test_one_of_several_cameras_is_loaded_by_name(write):
    path = write(KALIBR_YAML)
    assert Camera.load(f"{path}#cam1") == read_camera(f"{path}#cam1") != Camera.load(f"{path}#cam0")


@pytest.mark.parametrize(
    ("source", "phrase"),
    [
        (3, "expected a path, an open file or a dict of a calibration, found int 3"),
        (None, "found NoneType None"),
        ([NUMBERS], "found list"),
        (BENT, "found Camera Camera(width="),
        ("no/such.yaml", "No such file"),
        ("a\0b", "null"),
        ({}, "a camera in the dict, found an unknown format"),
        ({**NUMBERS, "fx": None}, "a finite number at fx in the dict, found 'null'"),
        ({**NUMBERS, "fx": float("nan")}, "a finite number at fx in the dict"),
        ({**NUMBERS, "fx": object()}, "text, numbers, lists and dicts in the dict"),
        ({**NUMBERS, "skew": 0.5}, "no skew at skew in the dict"),
        (io.StringIO(""), "a camera file at the open file, found an empty file"),
        (io.BytesIO(b"\xff\xff"), "text in the open file"),
        (io.StringIO(" " * 1_000_001), "at most 1 MB"),
    ],
)
def test_what_is_no_camera_is_one_line(source, phrase):
    with pytest.raises(InputError) as caught:
        Camera.load(source)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


def info(**change):
    """As rclpy makes a CameraInfo: numpy for K, an array for D."""
    roi = SimpleNamespace(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    fields = {
        "header": SimpleNamespace(frame_id="camera"), "height": 480, "width": 640, "distortion_model": "plumb_bob",
        "d": array("d", LENS.coefficients), "k": MATRIX.ravel(), "r": np.eye(3).ravel(), "p": np.zeros(12),
        "binning_x": 0, "binning_y": 0, "roi": roi,
    }  # fmt: skip
    return SimpleNamespace(**fields | change)


def test_a_message_of_ros_is_the_camera_that_it_describes(write):
    assert Camera.from_message(info()) == BENT
    ros1 = SimpleNamespace(
        height=480, width=640, distortion_model="plumb_bob", D=LENS.coefficients, K=tuple(MATRIX.ravel()), R=(), P=()
    )
    assert Camera.from_message(ros1) == BENT
    assert Camera.from_message(vars(ros1)) == BENT
    assert Camera.from_message({**vars(info()), "roi": {"x_offset": 0, "width": 640}}) == BENT
    assert Camera.from_message(info(distortion_model="", d=[])) == BENT.ideal
    part = Camera.from_message(
        info(binning_x=2, binning_y=2, roi=SimpleNamespace(x_offset=100, y_offset=60, width=400, height=300))
    )
    # A point of the full image, in pixels of the part that hold four of it each.
    ray = np.array([0.01, 0.02])
    full = BENT.to_pixels(ray) - [100, 60]
    np.testing.assert_allclose(part.to_pixels(ray), (full + 0.5) / 2 - 0.5, atol=1e-12)
    assert (part.width, part.height) == (200, 150)
    fisheye = Camera.from_message(info(distortion_model="equidistant", d=[0.1, 0, 0, 0]))
    assert fisheye.distortion == Distortion("equidistant", (0.1, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("message", "phrase"),
    [
        (3, "a message sensor_msgs/CameraInfo, found int 3"),
        ({}, "a message sensor_msgs/CameraInfo, found dict {}"),
        (info(binning_x=1000), "a binning at binning_x in the CameraInfo, found [1000, 0]"),
        (info(roi=SimpleNamespace(x_offset=8)), "a part of the image of 640x480 px at roi in the CameraInfo"),
        (info(roi=SimpleNamespace(x_offset=400, width=320)), "found 320x480 px at 400, 0"),
        (info(k=np.zeros(9)), "finite positive focal lengths at k in the CameraInfo"),
        (info(k=[1.0]), "a 3x3 camera matrix at k in the CameraInfo"),
        (info(k=None), "the key camera_matrix or K in the CameraInfo"),
        (info(d=None), "the key distortion_coefficients"),
        (info(d=[0.1] * 5 + [np.nan] * 3), "a finite number at d in the CameraInfo"),
        (info(distortion_model="omni"), "a known distortion model at distortion_model in the CameraInfo"),
        (info(width="wide"), "a finite number at width"),
        (info(width=0), "an image size of 1 to 20000 pixels"),
        (info(width=320), "a principal point inside the image of 320x480 px"),
        (info(width=SimpleNamespace()), "text, numbers, lists and dicts in the CameraInfo"),
    ],
)
def test_messages_are_refused_as_files_are(message, phrase):
    with pytest.raises(InputError) as caught:
        Camera.from_message(message)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("shape", [(5,), (5, 1), (1, 5)])
def test_arrays_of_opencv_in_any_shape(shape):
    assert Camera.from_cv2(MATRIX, np.reshape(LENS.coefficients, shape), (640, 480)) == BENT


def test_arrays_of_opencv():
    assert Camera.from_cv2(MATRIX.tolist(), None, np.zeros((480, 640, 3)).shape[1::-1]) == BENT.ideal
    assert Camera.from_cv2(MATRIX, np.zeros((0,)), [640, 480]) == BENT.ideal
    assert Camera.from_cv2(MATRIX, [0.1, 0.2, 0, 0], (640, 480)).distortion == Distortion("radtan", (0.1, 0.2, 0, 0))
    for count in (8, 12, 14):
        camera = Camera.from_cv2(MATRIX, [0.1] * 8 + [0.0] * (count - 8), (640.0, 480.0))
        assert camera.distortion == Distortion("rational", (0.1,) * 8)
    camera = Camera.from_cv2(MATRIX, np.full((4, 1), 0.01), (640, 480), fisheye=True)
    assert camera.distortion == Distortion("equidistant", (0.01,) * 4)


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        ((None, None, (640, 480)), "an array of finite numbers as matrix, found None"),
        ((np.eye(4), None, (640, 480)), "a 3x3 camera matrix, found an array of shape (4, 4)"),
        ((MATRIX.T, None, (640, 480)), "transpose it"),
        ((MATRIX * np.nan, None, (640, 480)), "an array of finite numbers as matrix"),
        (("matrix", None, (640, 480)), "an array of finite numbers as matrix, found 'matrix'"),
        ((MATRIX, "0", (640, 480)), "an array of finite numbers as distortion"),
        ((MATRIX, [[0.1], [0.2, 0]], (640, 480)), "an array of finite numbers as distortion"),
        ((MATRIX, np.zeros((2, 4)), (640, 480)), "distortion coefficients in one row or column, found an array of"),
        (
            (MATRIX, [0.1] * 3, (640, 480)),
            "4 or 5 coefficients of the distortion model 'radtan' at distortion",
        ),
        ((MATRIX, [0.1] * 14, (640, 480)), "no thin prism and no tilted sensor"),
        (
            (MATRIX, None, (480, 640, 3)),
            "a size (width, height) in px, found (480, 640, 3); for an image",
        ),
        ((MATRIX, None, None), "an array of finite numbers as size"),
        ((MATRIX, None, (640.5, 480)), "a size (width, height) in px"),
        ((MATRIX, None, (300, 480)), "a principal point inside the image of 300x480 px"),
        (
            (MATRIX, None, (640, 480), True),
            "4 coefficients of the distortion model 'equidistant' at distortion",
        ),
        ((MATRIX, [0.1] * 5, (640, 480), True), "4 coefficients of the distortion model 'equidistant'"),
    ],
)
def test_arrays_that_are_no_camera_are_refused(arguments, phrase):
    with pytest.raises(InputError) as caught:
        Camera.from_cv2(*arguments)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
