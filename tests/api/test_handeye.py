"""A camera on a robot by rendered photographs, from Python and from the terminal."""

# The command is tested here, too, on the same photographs.

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import markergen as mg
from markergen.calibration.handeye import HandEye, HandEyeFit, RobotPoses
from markergen.cli import main
from markergen.maths.rotation import angle_between, exponential, inverse_pose, logarithm, pose_product
from markergen.render import Optics, render_view

CAMERA = mg.Camera(400, 300, 500.0, 500.0, 199.5, 149.5)
SCALE = 1.02
CARRIED = exponential(np.array([0.1, -0.2, 1.5])), np.array([0.03, -0.05, 0.08])
FIXED = exponential(np.array([0.4, 0.1, -0.7])), np.array([0.5, -0.2, 0.1])
STATED = {"robot_frame": "flange-in-base", "robot_unit": "mm", "robot_rotation": "kuka"}
WORDS = [f"--{key.replace('_', '-')}={value}" for key, value in STATED.items()]
GRID = Path(__file__).parents[3] / "shared" / "photos" / "robot_grid"


def table_of(flange, names):
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(flange[0]).as_euler("ZYX", degrees=True)
    rows = [
        f"{name},{','.join(map(repr, map(float, row)))}"
        for name, row in zip(names, np.c_[1e3 * flange[1], angles], strict=True)
    ]
    return "photo,X,Y,Z,A,B,C\n" + "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A marker, six photographs of it, the camera, and poses of a robot of both mountings."""
    folder, rng = tmp_path_factory.mktemp("robot"), np.random.default_rng(0)
    marker = mg.design(n=5, radius="60mm", dot="20mm", restarts=1).marker
    marker.save(folder / "marker.json")
    CAMERA.save(folder / "camera.yaml")
    (folder / "photos").mkdir()
    leans = [[0.5, 0, 0.3], [-0.5, 0.1, 0], [0, 0.5, 1.0], [0.1, -0.5, -0.8], [0.4, 0.4, 2.0], [-0.3, 0.4, -2.0]]
    rotation = exponential(np.array(leans)) @ np.diag([1.0, -1.0, -1.0])
    translation = np.array([[0.0, 0.0, 0.35]]) + rng.uniform(-0.02, 0.02, (6, 3))
    for k in range(6):
        image = render_view(marker, CAMERA, rotation[k], translation[k], Optics(), rng)
        cv2.imwrite(str(folder / f"photos/{k}.png"), image)
    moving = rotation, SCALE * translation
    for name, poses in (("hand", inverse_pose(moving)), ("beside", moving)):
        flange = pose_product(pose_product(FIXED, poses), inverse_pose(CARRIED))
        (folder / f"{name}.csv").write_text(table_of(flange, map(str, range(6))))
    return folder


@pytest.fixture(autouse=True)
def here(made, monkeypatch):
    monkeypatch.chdir(made)
    return made


@pytest.mark.parametrize(("table", "mounting"), [("hand", "eye-in-hand"), ("beside", "eye-to-hand")])
def test_camera_and_marker_are_found_in_both_mountings(table, mounting):
    result = mg.handeye("marker.json", "photos", f"{table}.csv", "camera.yaml", mounting=mounting, workers=1, **STATED)
    X, Z = (CARRIED, FIXED) if table == "hand" else (FIXED, CARRIED)
    for pose, true in ((result.camera_pose, X), (result.marker_pose, Z)):
        assert np.rad2deg(angle_between(pose[0], true[0])) < 0.2
        assert np.linalg.norm(pose[1] - true[1]) < 2e-3
    assert result.scale == pytest.approx(SCALE, abs=5e-3)
    error = np.concatenate([part for pose, true in ((result.camera_pose, X), (result.marker_pose, Z))
                            for part in (logarithm(pose[0] @ true[0].T), pose[1] - true[1])])  # fmt: skip
    assert (np.abs(error) < 4 * result.sigma[:12]).all()
    assert result.names == (
        ("T_flange_camera", "T_base_marker") if table == "hand" else ("T_base_camera", "T_flange_marker")
    )
    assert len(result.photos) == 6
    assert not result.open
    assert len(result.brief()) <= 8
    results = json.loads(result.to_json())
    assert results[result.names[0]]["translation"] == pytest.approx(list(result.camera_pose[1]))
    assert np.shape(results["covariance"]) == (13, 13) == (len(results["unknowns"]),) * 2
    assert len(results["photos"]) == 6
    ax = result.plot()
    ax.figure.draw_without_rendering()
    # The legend is below the axes, and the names of photographs are inside.
    assert ax.get_legend().get_window_extent().y1 < ax.get_window_extent().y0
    assert max(text.get_window_extent().x1 for text in ax.texts) < ax.get_window_extent().x1
    assert len(ax.texts) == 6


def test_three_photographs_show_no_size_and_leave_none_over():
    photos = [f"photos/{k}.png" for k in range(3)]
    text = str(mg.handeye("marker.json", photos, "hand.csv", "camera.yaml", workers=1, **STATED))
    assert "too roughly to check the marker's size" in text
    assert "3 photographs leave none over" in text
    assert "left-out pose" not in text


def test_the_command_writes_results_and_plot(here, capfd):
    arguments = ["handeye", "marker.json", "photos", "--robot", "hand.csv", "--camera", "camera.yaml", *WORDS]
    assert main([*arguments, "-o", "result.json", "-o", "plot.svg"]) == 0
    text, _ = capfd.readouterr()
    assert "T_flange_camera" in text
    assert "T_base_marker" in text
    assert json.loads((here / "result.json").read_text())["mounting"] == "eye-in-hand"
    assert b"<svg" in (here / "plot.svg").read_bytes()


@pytest.mark.parametrize(
    ("phrase", "named"),
    [
        (["--robot", "hand.csv"], "--robot-frame"),
        (["--robot", "few.csv", *WORDS], "three|3"),
        (["--robot", "hand.csv", "--mounting", "eye-to-hand", *WORDS], "--mounting eye-in-hand"),
        (["--robot", "exchanged.csv", *WORDS], "2.png"),
        (["--robot", "none.csv", *WORDS], "none.csv"),
        (["--robot", "hand.csv", "--mounting", "both", *WORDS], "eye-to-hand"),
    ],
)
def test_refusals_are_one_line_and_nothing_is_written(phrase, named, here, capfd):
    lines = (here / "hand.csv").read_text().splitlines()
    (here / "few.csv").write_text("\n".join(lines[:3]))
    rows = [line.partition(",")[2] for line in lines[1:]]
    rows[2], rows[4] = rows[4], rows[2]
    (here / "exchanged.csv").write_text("\n".join([lines[0], *(f"{k},{row}" for k, row in enumerate(rows))]))
    command = ["handeye", "marker.json", "photos", "--camera", "camera.yaml", "-o", "not.json", *phrase]
    assert main(command) == 2
    output, complaint = capfd.readouterr()
    assert output == ""
    assert complaint.count("\n") == 1
    assert any(word in complaint for word in named.split("|"))
    assert not (here / "not.json").exists()


def test_directions_are_open_where_their_sigma_is_large_and_a_zero_has_no_sign():
    places = np.array([[0.6, -1e-9, 0], [0, 0.1, 0]])
    robot = RobotPoses(np.tile(np.eye(3), (2, 1, 1)), places, np.zeros(1), FIXED, True)
    covariance = np.diag([1e-3] * 3 + [1e-3] * 3 + [1e-3] * 3 + [1e-3] * 3 + [1e-3]) ** 2
    views, network = SimpleNamespace(translation=np.array([[0, 0, 0.5]])), SimpleNamespace(freedom=())
    adjustment = SimpleNamespace(views=views, rms=0.01, network=network)
    result = HandEye(HandEyeFit(robot, adjustment, covariance, np.zeros((1, 6))), (), (), {})
    assert not [sentence for sentence in result.brief() if "-0.000" in sentence]
    # As large as the poses are off, or larger than these show.
    assert "off by at most 1.0 mm and at most 0.057 deg" in " ".join(result.brief())
    result = HandEye(HandEyeFit(robot, adjustment, covariance, np.full((1, 6), 1.1e-3)), (), (), {})
    assert "off by 1.0 mm and 0.057 deg" in " ".join(result.brief())
    assert not result.open
    covariance[9:12, 9:12] += 0.3**2 * np.outer([0, 0.6, -0.8], [0, 0.6, -0.8])
    covariance[0, 0] = np.deg2rad(5) ** 2
    rotated, moved = result.open
    assert ("marker" in rotated, "(1.00 0.00 0.00)" in rotated, "5 deg" in rotated) == (True, True, True)
    assert ("camera" in moved, "(0.00 -0.60 0.80)" in moved, "300 mm" in moved) == (True, True, True)
    beside = HandEye(replace(result.fit, robot=replace(robot, on_hand=False)), (), (), {})
    assert "marker" in beside.open[1]


def test_matrices_with_images():
    photos = [cv2.imread(f"photos/{k}.png") for k in range(6)]
    matrices = np.tile(np.eye(4), (5, 1, 1))
    with pytest.raises(mg.InputError, match="4, 4"):
        mg.handeye("marker.json", photos, matrices, CAMERA)
    with pytest.raises(mg.InputError, match="axes"):
        mg.handeye("marker.json", photos, np.tile(np.eye(4), (6, 1, 1)), CAMERA, workers=1)


@pytest.mark.long
@pytest.mark.skipif(not GRID.is_dir(), reason=f"no photographs in {GRID}")
def test_a_real_robot_whose_four_poses_turn_about_one_axis():
    stated = {"robot_frame": "flange-in-base", "robot_unit": "m", "workers": 1}
    files = GRID / "marker.json", GRID, str(GRID / "*.flange-pose.yaml"), GRID / "camera.yaml"
    with pytest.raises(mg.InputError, match="parallel axes"):
        mg.handeye(*files, **stated)
    loose = Path("loose.txt")
    loose.write_text("30 30 20 20 0.2 0.2 0.001 0.001 0.0001\n")
    result = mg.handeye(*files, one_axis=True, camera_covariance=loose, **stated)
    # With all fifteen photographs f is 530 px, the file's is a nominal 550; the offset along the axis stays open.
    assert result.camera.fx == pytest.approx(530, abs=8)
    assert result.scale == pytest.approx(1.0, abs=0.03)
    assert sum("(1.00" in sentence or "(0.99" in sentence for sentence in result.open) == 2
    rotation, translation = np.linalg.norm(result.left_out.reshape(-1, 2, 3), axis=2).T
    assert np.rad2deg(rotation).max() < 2
    assert translation.max() < 0.06
