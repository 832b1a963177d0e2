"""Camera files as written, read as the programs that they are for read them."""

import json

import numpy as np
import pytest
import yaml

from markergen.errors import InputError, OutputError
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.read.cameras.covariance import camera_covariance, counted, read_camera_covariance

NAMES = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
LENS = Camera(640, 480, 501.25, 500.5, 318.0, 241.0, Distortion("radtan", (-0.1, 0.02, 1e-5, -3e-7, 0.3)))
FLAT = Camera(640, 480, 501.25, 500.5, 318.0, 241.0, Distortion("radtan", (-0.1, 0.02, 1e-5, -3e-7, 0.0)))
FISHEYE = Camera(640, 480, 301.25, 300.5, 318.0, 241.0, Distortion("equidistant", (0.1, 0.02, -1e-5, 3e-7)))
COVARIANCE = np.diag(np.arange(1.0, 10)) * 1e-3 + 1e-4


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".xml", ".json"])
@pytest.mark.parametrize("camera", [LENS, FISHEYE, PAPER_CAMERA], ids=["radtan", "fisheye", "pinhole"])
def test_opencv_reads_it(tmp_path, suffix, camera):
    import cv2

    path = tmp_path / f"camera{suffix}"
    k = len(camera.parameter_names)
    covariance = COVARIANCE[:k, :k]
    camera.save(path, covariance, rms=0.0625)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), camera.matrix)
    np.testing.assert_array_equal(storage.getNode("distortion_coefficients").mat().ravel(), camera.cv2_distortion)
    np.testing.assert_array_equal(storage.getNode("camera_covariance").mat(), covariance)
    parameters = storage.getNode("camera_parameters")
    assert [parameters.at(i).string() for i in range(parameters.size())] == list(camera.parameter_names)
    assert storage.getNode("avg_reprojection_error").real() == 0.0625
    sizes = [storage.getNode(key).real() for key in ("image_width", "image_height", "fisheye_model")]
    assert sizes == [640, 480, camera is FISHEYE]


@pytest.mark.parametrize(
    ("camera", "model", "count"),
    [(LENS, "plumb_bob", 5), (PAPER_CAMERA, "plumb_bob", 5), (FISHEYE, "equidistant", 4)],
)
def test_ros_has_all_that_its_parser_asks_for(tmp_path, camera, model, count):
    # camera_calibration_parsers looks these keys up, with these sizes, and no others.
    camera.save(tmp_path / "camera.ros.yaml")
    results = yaml.safe_load((tmp_path / "camera.ros.yaml").read_text())
    assert (results["image_width"], results["image_height"], results["distortion_model"]) == (640, 480, model)
    assert isinstance(results["camera_name"], str)
    sizes = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
    for key, size in {**sizes, "distortion_coefficients": (1, count)}.items():
        table = results[key]
        assert (table["rows"], table["cols"]) == size
        assert len(table["data"]) == np.prod(size)
        assert all(isinstance(value, float) for value in table["data"])
    # What is rectified by them is the undistorted image, with the same matrix.
    matrix = np.reshape(results["camera_matrix"]["data"], (3, 3))
    np.testing.assert_array_equal(np.reshape(results["rectification_matrix"]["data"], (3, 3)), np.eye(3))
    np.testing.assert_array_equal(np.reshape(results["projection_matrix"]["data"], (3, 4))[:, :3], matrix)


@pytest.mark.parametrize(("camera", "model"), [(FLAT, "radtan"), (PAPER_CAMERA, "none"), (FISHEYE, "equidistant")])
def test_kalibr_has_all_that_its_reader_asks_for(tmp_path, camera, model):
    camera.save(tmp_path / "camera.kalibr.yaml", np.diag([1.0, 1, 1, 1] + [0.0] * len(camera.distortion.names)))
    chain = yaml.safe_load((tmp_path / "camera.kalibr.yaml").read_text())
    # One entry for each camera: anything else at the top would be taken for one.
    assert list(chain) == ["cam0"]
    results = chain["cam0"]
    assert (results["camera_model"], results["distortion_model"]) == ("pinhole", model)
    assert len(results["distortion_coeffs"]) == {"none": 0, "radtan": 4, "equidistant": 4}[model]
    assert results["intrinsics"] == [camera.fx, camera.fy, camera.cx, camera.cy]
    # Its reader refuses whole numbers there, and a resolution that is not whole.
    assert all(isinstance(value, float) for value in results["intrinsics"] + results["distortion_coeffs"])
    assert [type(side) for side in results["resolution"]] == [int, int]
    assert isinstance(results["rostopic"], str)
    assert results["cam_overlaps"] == []


@pytest.mark.parametrize(
    ("camera", "model", "rest"),
    [
        (PAPER_CAMERA, "PINHOLE", []),
        (FLAT, "OPENCV", [-0.1, 0.02, 1e-5, -3e-7]),
        (LENS, "FULL_OPENCV", [-0.1, 0.02, 1e-5, -3e-7, 0.3, 0.0, 0.0, 0.0]),
        (FISHEYE, "OPENCV_FISHEYE", [0.1, 0.02, -1e-5, 3e-7]),
    ],
)
@pytest.mark.parametrize("name", ["cameras.txt", "mine.colmap.txt"])
def test_colmap_counts_from_the_corner(tmp_path, name, camera, model, rest):
    camera.save(tmp_path / name, None if camera is FLAT else np.eye(len(camera.parameter_names)), 0.1)
    lines = (tmp_path / name).read_text().splitlines()
    # COLMAP skips lines that begin with #.
    (phrase,) = [line.split() for line in lines if not line.startswith("#")]
    assert phrase[:4] == ["1", model, "640", "480"]
    values = [float(word) for word in phrase[4:]]
    assert values == [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, *rest]


def test_a_coefficient_that_is_unsure_is_not_left_out(tmp_path):
    path = tmp_path / "camera.kalibr.yaml"
    exact = COVARIANCE.copy()
    exact[-1] = exact[:, -1] = 0
    FLAT.save(path, exact)
    np.testing.assert_array_equal(read_camera_covariance(path, FLAT), exact)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"radtan with k1 k2 p1 p2 k3; write cameras.txt"):
        FLAT.save(path, COVARIANCE)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "arguments", "phrase"),
    [
        ("camera", {}, "known endings: .colmap.txt, .json"),
        ("camera.txt", {}, "a name for a camera file, found 'camera.txt'"),
        ("c.yaml", {"covariance": np.eye(5)}, "4 standard deviations or 4x4 numbers or 9 standard"),
        ("c.yaml", {"covariance": -np.eye(9)}, "variances of 0 or more"),
        ("c.yaml", {"rms": np.nan}, "the RMS of the residuals in px, found nan"),
        ("c.yaml", {"rms": -1.0}, "the RMS of the residuals in px, found -1.0"),
    ],
)
def test_what_cannot_be_written_is_one_line(tmp_path, name, arguments, phrase):
    with pytest.raises(InputError) as caught:
        LENS.save(tmp_path / name, **arguments)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(OutputError):
        LENS.save(tmp_path / "none" / "camera.yaml")


def stored(tmp_path, **changes):
    """Write OpenCV's JSON with a covariance, with some keys changed."""
    path = tmp_path / "camera.json"
    LENS.save(path, COVARIANCE)
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    return path


def test_a_covariance_is_read_by_the_names_of_its_parameters(tmp_path):
    few = {"rows": 2, "cols": 2, "data": [4, 1, 1, 9]}
    results = read_camera_covariance(stored(tmp_path, camera_parameters=["k1", "fy"], camera_covariance=few), LENS)
    expected = np.zeros((9, 9))
    expected[4, 4], expected[1, 1], expected[1, 4], expected[4, 1] = 4, 9, 1, 1
    np.testing.assert_array_equal(results, expected)
    # Rows of zeros may be of parameters that this lens has not.
    one = {"rows": 2, "cols": 2, "data": [4, 0, 0, 0]}
    results = read_camera_covariance(stored(tmp_path, camera_parameters=["fx", "k6"], camera_covariance=one), LENS)
    assert results[0, 0] == results.sum() == 4


@pytest.mark.parametrize(
    ("changes", "phrase"),
    [
        ({"camera_parameters": NAMES[:8]}, "8 rows and 8 cols at camera_covariance"),
        ({"camera_parameters": ["fx"] * 9}, "every parameter once at camera_parameters"),
        ({"camera_parameters": [*NAMES[:8], "k9"]}, "a covariance of fx fy cx cy k1"),
        ({"camera_parameters": {"fx": 1}}, "a list of names at camera_parameters"),
        ({"camera_parameters": [["fx"]]}, "a list of names at camera_parameters"),
        ({"camera_covariance": [1.0, 2.0]}, "9x9 numbers at camera_covariance"),
        ({"camera_covariance": {"rows": 9, "cols": 9, "data": [1] * 80}}, "rows times cols numbers"),
        ({"camera_covariance": {"rows": 9, "cols": 9, "data": [-1] * 81}}, "variances of 0 or more"),
        ({"camera_covariance": {"rows": 9, "cols": 9, "data": ["nan"] * 81}}, "a finite number"),
    ],
)
def test_a_wrong_covariance_in_a_camera_is_one_line(tmp_path, changes, phrase):
    path = stored(tmp_path, **changes)
    for read in (lambda: read_camera_covariance(path, LENS), lambda: camera_covariance(None, path, LENS)):
        with pytest.raises(InputError) as caught:
            read()
        assert phrase in str(caught.value)
        assert "\n" not in str(caught.value)


def test_the_one_given_comes_before_the_one_in_the_file(tmp_path):
    path = stored(tmp_path)
    np.testing.assert_array_equal(camera_covariance(None, path, LENS), COVARIANCE)
    np.testing.assert_array_equal(camera_covariance(None, json.loads(path.read_text()), LENS), COVARIANCE)
    np.testing.assert_array_equal(camera_covariance(np.ones(4), path, LENS), np.diag([1.0] * 4 + [0] * 5))
    assert camera_covariance("none", path, LENS) is None
    assert camera_covariance(None, LENS, LENS) is None
    assert counted(None, path, COVARIANCE).startswith(f"{path}: its covariance")
    assert counted(path, path, COVARIANCE) == counted(None, path, None) == ""


def test_one_of_several_cameras_has_its_own(tmp_path):
    path = tmp_path / "camera.kalibr.yaml"
    FISHEYE.save(path, np.eye(8))
    chain = yaml.safe_load(path.read_text())
    chain["cam1"] = {
        **chain["cam0"],
        "camera_covariance": {"rows": 8, "cols": 8, "data": (4 * np.eye(8)).ravel().tolist()},
    }
    path.write_text(yaml.safe_dump(chain))
    assert (
        camera_covariance(None, f"{path}#cam1", FISHEYE)[0, 0]
        == read_camera_covariance(f"{path}#cam1", FISHEYE)[0, 0]
        == 4
    )
    assert camera_covariance(None, path, FISHEYE)[0, 0] == 1
