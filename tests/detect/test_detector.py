"""What users of OpenCV rely on: poses that projectPoints takes out, one detector for all frames."""

import doctest
import json
import logging
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from markergen.detect import Detector, detect, detector
from markergen.errors import InputError
from markergen.maths.rotation import angle_between, exponential
from markergen.model.body_json import to_json
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.marker import Marker
from markergen.model.poses import paper, paper_roll
from markergen.model.tag import parse_tag
from markergen.render import Optics, render_view

POSES, ROLLED = paper(), paper_roll()
CAMERAS = {
    "none": PAPER_CAMERA,
    "radtan": replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.28, 0.09, 0.001, -0.0005, 0.0))),
    "rational": replace(PAPER_CAMERA, distortion=Distortion("rational", (0.1, -0.2, 1e-3, 2e-3, 0.05, 0.3, 0.1, 0.01))),
}
CAMERA = CAMERAS["radtan"]
CAMERA_INFO = """\
image_width: 640
image_height: 480
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.09, 0.001, -0.0005, 0.0]}
"""


def look(marker, pose=130, camera=CAMERA, optics=None, poses=POSES):
    rng = np.random.default_rng(pose)
    return render_view(marker, camera, poses.rotation[pose], poses.translation[pose], optics or Optics(), rng)


def reprojected(result, camera):
    pixels, _ = cv2.projectPoints(result.xyz, result.rvec, result.tvec, camera.matrix, camera.cv2_distortion)
    return pixels[:, 0]


@pytest.fixture(scope="module")
def frame(pentagon):
    return look(pentagon)


@pytest.fixture(scope="module")
def detect_pentagon(pentagon):
    return Detector(pentagon, CAMERA)


@pytest.fixture(scope="module")
def hidden_ring(pentagon):
    """A frame in which the key ring is missing."""
    return look(replace(pentagon, control_points=pentagon.control_points[1:]))


@pytest.mark.parametrize("lens", CAMERAS)
def test_opencv_projects_the_pose_onto_the_pixels(pentagon, lens):
    camera = CAMERAS[lens]
    finder = Detector(pentagon, camera)
    for pose in (3, 130, 277, 399):
        (finding,) = finder(look(pentagon, pose, camera, poses=ROLLED))
        assert finding.ok
        assert finding.reason == ""
        np.testing.assert_array_equal(finding.ids, [10, 11, 12, 13, 14])
        assert finding.rvec.shape == finding.tvec.shape == (3, 1)
        assert finding.rvec.dtype == finding.tvec.dtype == np.float64
        # 0.005 px of noise, and what its pose leaves of it.
        assert np.abs(reprojected(finding, camera) - finding.pixels).max() < 0.1
        np.testing.assert_allclose(cv2.Rodrigues(finding.rvec)[0], finding.rotation, atol=1e-9)
        np.testing.assert_array_equal(finding.tvec.ravel(), finding.translation)
        assert np.rad2deg(angle_between(finding.rotation, ROLLED.rotation[pose])) < 1
        assert np.abs(finding.translation - ROLLED.translation[pose]).max() < 0.01
        # And OpenCV comes to the same pose from these pixels.
        ok, rvec, tvec = cv2.solvePnP(
            finding.xyz, finding.pixels, camera.matrix, camera.cv2_distortion, finding.rvec, finding.tvec, True
        )
        assert ok
        assert np.abs(tvec - finding.tvec).max() < 2e-3
        assert rvec.shape == finding.rvec.shape


def test_fisheye_coefficients_are_those_of_cv2_fisheye(pentagon):
    camera = replace(PAPER_CAMERA, fx=500.0, fy=500.0, distortion=Distortion("equidistant", (-0.02, 0.005, 0, 0)))
    (finding,) = Detector(pentagon, camera)(look(pentagon, camera=camera))
    points = finding.xyz[:, None]
    pixels, _ = cv2.fisheye.projectPoints(points, finding.rvec, finding.tvec, camera.matrix, camera.cv2_distortion)
    assert np.abs(pixels[:, 0] - finding.pixels).max() < 0.1


def test_opencv_draws_its_axes_at_the_origin(detect_pentagon, frame):
    (finding,) = detect_pentagon(frame)
    canvas = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
    before = canvas.copy()
    cv2.drawFrameAxes(canvas, CAMERA.matrix, CAMERA.cv2_distortion, finding.rvec, finding.tvec, 0.05)
    x, y = np.rint(cv2.projectPoints(np.zeros((1, 3)), finding.rvec, finding.tvec, CAMERA.matrix, None)[0]).astype(int)[
        0, 0
    ]
    changed = (canvas != before).any(axis=-1)
    assert changed[y - 2 : y + 3, x - 2 : x + 3].any()
    assert not changed[:40, :40].any()


def test_what_is_found_is_what_detect_finds(pentagon, detect_pentagon, frame):
    (finding,), plain = detect_pentagon(frame), detect(frame, pentagon, CAMERA)
    np.testing.assert_array_equal(finding.pixels, plain.pixels)
    np.testing.assert_array_equal(finding.pixel_covariance, plain.pixel_covariance)
    np.testing.assert_array_equal(finding.covariance, plain.pose.budget.total)
    np.testing.assert_array_equal(finding.homography, plain.homography)
    assert (finding.marker, finding.index, finding.tag, finding.pose.chi2) == (pentagon, 0, None, plain.pose.chi2)


def test_the_covariance_is_of_a_turn_from_the_left(detect_pentagon, pentagon):
    """The turn of the noise-free estimate between two noisy ones is exp([w]x), with w in the camera frame."""
    from markergen.maths.rotation import logarithm

    exact = Detector(pentagon, CAMERA, print_sigma=0)
    nees = []
    for pose in range(0, 400, 13):
        (finding,) = exact(look(pentagon, pose, poses=ROLLED))
        rotation = logarithm(ROLLED.rotation[pose] @ finding.rotation.T)
        error = np.concatenate([rotation, ROLLED.translation[pose] - finding.translation])
        nees.append(error @ np.linalg.solve(finding.covariance, error))
    # Mean of 31 of chi2 with 6 degrees of freedom: 0.62 of scatter, four times that.
    assert abs(np.mean(nees) - 6) < 2.5


def test_markers_come_as_objects_paths_and_contents(pentagon, irregular, frame, tmp_path):
    path = tmp_path / "marker.json"
    path.write_bytes(to_json(pentagon))
    content = json.loads(path.read_text())
    for source, name in [(pentagon, "marker"), (path, str(path)), (str(path), str(path)), (content, "marker")]:
        for stated in (source, [source], (source,), iter([source])):
            (finding,) = Detector(stated, CAMERA)(frame)
            assert finding.ok
            assert finding.as_dict()["marker"] == finding.name == name
    several = Detector([irregular, path], CAMERA)
    assert (len(several.markers), several.camera) == (2, CAMERA)
    assert several.names == ("marker 0", str(path))
    finding, missed = several(frame)
    assert (finding.ok, finding.index, finding.marker.xyz.tolist()) == (True, 1, pentagon.xyz.tolist())
    assert (missed.ok, missed.index, missed.marker) == (False, 0, irregular)
    assert missed.reason
    assert str(missed).startswith("marker 0 not found: ")


def test_a_camera_comes_from_a_file(pentagon, frame, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA_INFO)
    for source in (path, str(path)):
        finder = Detector(pentagon, source)
        assert finder.camera == CAMERA
        assert finder(frame)[0].ok


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ([[]], {}, "one marker or more"),
        ([None], {}, "found NoneType None; give Marker.load"),
        ([5], {}, "marker.json, found int 5"),
        ([[None]], {}, "marker.json, found NoneType"),
        ([b"marker.json"], {}, "marker.json, found bytes"),
        (["no.json"], {}, "no.json"),
        ([{"format": "else"}], {}, "markergen-marker"),
        ([{"format": object()}], {}, "a marker of plain JSON values"),
        (["pentagon", 5], {}, "a calibration, found int 5"),
        (["pentagon", np.eye(3)], {}, "a calibration, found ndarray"),
        (["pentagon", "no.yaml"], {}, "no.yaml"),
        (["pentagon", CAMERA], {"print_sigma": "much"}, "print_sigma"),
        (["pentagon", CAMERA], {"print_sigma": -1e-3}, "print error of 0 to 1 m"),
        (["pentagon"], {"camera_covariance": np.eye(4)}, "a camera that the covariance belongs to"),
        (["pentagon", CAMERA], {"camera_covariance": np.eye(3)}, "4 standard deviations or 4x4 numbers"),
        (["pentagon", CAMERA], {"camera_covariance": [1, 2, 3, "x"]}, "a covariance of the camera's parameters"),
        (["pentagon", CAMERA], {"camera_covariance": -np.eye(4)}, "variances of 0 or more"),
        (["pentagon", CAMERA], {"symmetric": "magic"}, "none or any"),
        (["pentagon", CAMERA], {"symmetric": np.zeros(3)}, "none or any"),
        (["pentagon", CAMERA], {"scale_sigma": "much"}, "a scale error of 0 to 0.1"),
        (["pentagon", CAMERA], {"smallest": -1}, "smallest=-1"),
        (["pentagon", CAMERA], {"copies": 0}, "copies=0"),
        ([np.array(3)], {}, "found ndarray array(3)"),
        (["pentagon", CAMERA], {"copies": "two"}, "copies='two'"),
    ],
)
def test_what_no_detector_can_be_built_of(pentagon, arguments, options, message):
    arguments = [
        pentagon if isinstance(argument, str) and argument == "pentagon" else argument for argument in arguments
    ]
    with pytest.raises(InputError) as caught:
        Detector(*arguments, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_checks_are_made_when_it_is_built(ngon, make):
    with pytest.raises(InputError, match="a camera for a marker with relief"):
        Detector(ngon(5, heights=[0, 0, 0.01, 0, 0]))
    with pytest.raises(InputError, match="4 or more control points"):
        Detector(make([(0, 0), (0.1, 0), (0, 0.1)]), CAMERA)


def test_calibration_and_print_count_in_the_covariance(pentagon, frame):
    def sigma(**options):
        return Detector(pentagon, CAMERA, **options)(frame)[0].pose.budget.translation

    fine, coarse = sigma(print_sigma=0), sigma(print_sigma="0.5mm")
    assert fine["print"] == 0 < coarse["print"]
    assert fine["camera"] == 0
    row, matrix = sigma(camera_covariance=[5.0, 5, 1, 1]), sigma(camera_covariance=np.diag([25.0, 25, 1, 1]))
    assert row == matrix
    # 5 of 800 px of focal length are as much of the distance.
    assert row["camera"] == pytest.approx(5 / 800 * np.linalg.norm(POSES.translation[130]), rel=0.3)


def test_the_covariance_in_the_file_of_the_camera_counts(pentagon, frame, tmp_path):
    def sigma(*arguments, **options):
        return Detector(pentagon, *arguments, **options)(frame)[0].pose.budget.translation["camera"]

    path, row = tmp_path / "camera.yaml", [5.0, 5, 1, 1]
    CAMERA.save(path, row)
    expected = sigma(CAMERA, camera_covariance=row)
    assert sigma(path) == sigma(CAMERA, camera_covariance=path) == pytest.approx(expected, rel=1e-6)
    assert sigma(path, camera_covariance="none") == 0
    assert Detector(pentagon, path).note.startswith(f"{path}: its covariance is counted")
    assert Detector(pentagon, path, camera_covariance="none").note == ""
    assert "--camera" in Detector(pentagon, camera_covariance="none").note


def test_without_a_camera(pentagon, frame):
    (finding,) = Detector(pentagon)(cv2.cvtColor(look(pentagon, camera=PAPER_CAMERA), cv2.COLOR_GRAY2BGR))
    assert finding.ok
    pose = (
        finding.pose,
        finding.rvec,
        finding.tvec,
        finding.rotation,
        finding.translation,
        finding.covariance,
        finding.second,
    )
    assert pose == (None,) * 7
    assert finding.homography.shape == (3, 3)
    # Frames of any size.
    assert not Detector(pentagon)(frame[:100, :100])[0].ok


@pytest.mark.parametrize(
    ("focal", "lens"),
    [
        (500.0, Distortion()),
        (500.0, Distortion("radtan", (-0.45, 0.0, 0.0, 0.0))),
        (350.0, Distortion("equidistant", (0.02, -0.01, 0.0, 0.0))),
    ],
)
def test_a_whole_grid_is_found_through_a_strong_lens_without_a_camera(focal, lens):
    grid = Marker.grid("4x11 asymmetric", pitch=0.02)
    camera = replace(PAPER_CAMERA, fx=focal, fy=focal, distortion=lens)
    lying = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    pose = exponential([0.4, -0.3, 0.0]) @ lying, np.array([0.0, 0.0, 0.17 * focal / 400])
    (finding,) = Detector(grid)(render_view(grid, camera, *pose, Optics(), np.random.default_rng(1)))
    true = camera.project(grid.xyz, pose[0][None], pose[1][None])[0]
    assert len(finding.ids) == len(grid)
    # Grey levels tell centers to 0.02 px; a lens of one parameter bends large dots by the rest.
    assert np.abs(finding.pixels - true).max() < 0.3
    homography, _ = cv2.findHomography(grid.xyz[:, :2], true, 0)
    off = cv2.perspectiveTransform(grid.xyz[None, :, :2], homography)[0] - true
    assert finding.finding.bend == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))), rel=0.05, abs=0.05)
    assert ("px off since the lens bends it" in str(finding)) == (lens.model != "none")


def test_a_ring_that_the_border_cuts_tells_how_a_regular_layout_is_turned(ngon):
    # Seen as in the photograph in which all dots but the ring fitted a rotation by 30 deg.
    camera = Camera(960, 720, 900.0, 903.0, 475.0, 362.0)
    marker = ngon(12, diameter=0.01668)
    rotation = np.array([[0.7741, 0.5284, -0.3487], [0.5987, -0.7901, 0.1316], [-0.206, -0.3107, -0.9279]])
    rotation, translation = (
        np.linalg.svd(rotation)[0] @ np.linalg.svd(rotation)[2],
        1.7833 * np.array([-0.0203, -0.0291, 0.2398]),
    )
    detector = Detector(marker, camera, print_sigma=1e-8)
    for seed in range(4):
        image = render_view(marker, camera, rotation, translation, Optics(), np.random.default_rng(seed))
        (finding,) = detector(image)
        assert 10 in finding.ids
        assert np.rad2deg(angle_between(finding.rotation, rotation)) < 0.1


def test_a_single_marker_whose_tag_should_be_readable_names_no_other_body(pentagon):
    tagged = replace(pentagon, tag=parse_tag("aruco:DICT_4X4_50:7", 0.05))
    (finding,) = Detector(tagged, CAMERA)(look(pentagon, 10))
    assert finding.reason == "its tag cannot be read, and bodies of this layout differ by their tags alone"


def test_dots_without_labels_are_all_there(detect_pentagon, hidden_ring, pentagon):
    centers = detect_pentagon.dots(cv2.cvtColor(hidden_ring, cv2.COLOR_GRAY2BGR))
    exact = CAMERA.project(pentagon.xyz[1:], POSES.rotation[[130]], POSES.translation[[130]])[0]
    distance = np.linalg.norm(centers[:, None] - exact, axis=-1)
    assert centers.shape == (4, 2)
    # Not corrected for perspective, which is a tenth of a pixel here.
    assert distance.min(axis=0).max() < 0.3
    assert detect_pentagon.dots(np.full((480, 640), 200, np.uint8)).shape == (0, 2)


@pytest.mark.parametrize(
    ("rotation", "translation", "ok"),
    [
        ([[0.756, 0.011, 0.654], [0.264, -0.92, -0.29], [0.599, 0.392, -0.699]], (-0.103, 0.08, 0.292), False),
        ([[-0.324, -0.941, 0.102], [-0.931, 0.298, -0.212], [0.169, -0.163, -0.972]], (-0.118, 0.157, 0.431), True),
    ],
)
def test_a_grid_that_the_border_cuts_is_not_moved_by_a_row(make, rotation, translation, ok):
    # Poses in which every second dot of the grid, which are in the same columns, was nearly all out of view.
    camera = Camera(480, 360, 450.0, 451.0, 240.0, 178.0)
    row, column = np.divmod(np.arange(44), 4)
    points = 0.02 * np.stack([2 * column + row % 2, row], axis=-1)
    grid = make(points - points.mean(axis=0), rings=(), diameter=0.018)
    left, _, right = np.linalg.svd(rotation)
    for seed in range(3):
        image = render_view(grid, camera, left @ right, np.array(translation), Optics(), np.random.default_rng(seed))
        (finding,) = Detector(grid, camera)(image)
        assert finding.ok == ok
        assert "labels are ambiguous" in finding.reason or np.abs(finding.translation - translation).max() < 0.002


@pytest.mark.parametrize("camera", [CAMERA, None])
def test_ambiguous_dots_have_pixels_and_no_labels(ngon, camera):
    plain = ngon(5, rings=())
    image = look(plain, camera=CAMERA if camera else PAPER_CAMERA)
    (finding,) = Detector(plain, camera)(image)
    assert not finding.ok
    assert "labels are ambiguous" in finding.reason
    assert (finding.ids.size, finding.xyz.shape) == (0, (0, 3))
    assert finding.pixels.shape == (5, 2)
    assert finding.pixel_covariance.shape == (5, 2, 2)
    assert np.linalg.eigvalsh(finding.pixel_covariance).min() > 0
    exact = (camera or PAPER_CAMERA).project(plain.xyz, POSES.rotation[[130]], POSES.translation[[130]])[0]
    distance = np.linalg.norm(finding.pixels[:, None] - exact, axis=-1)
    # Each is one of the dots, and corrected: plain centers of ellipses are a tenth of a pixel off here.
    assert sorted(distance.argmin(axis=1)) == [0, 1, 2, 3, 4]
    assert distance.min(axis=1).max() < 0.05
    assert (finding.rvec, finding.homography, finding.tag) == (None, None, None)
    output = finding.as_dict()
    assert (output["found"], output["ids"], len(output["missing"])) == (False, [], 5)
    np.testing.assert_array_equal(output["pixels"], finding.pixels)
    assert np.shape(output["ellipse_centers"]) == (5, 2)


def test_two_markers_that_claim_the_same_dots_both_have_them(pentagon, frame):
    both = Detector([pentagon, pentagon], CAMERA)(frame)
    assert [item.reason[-21:] for item in both] == ["marker 0 and marker 1", "marker 1 and marker 0"]
    assert [item.pixels.shape for item in both] == [(5, 2), (5, 2)]


def test_a_frame_without_the_marker(detect_pentagon):
    (finding,) = detect_pentagon(np.full((480, 640), 200, np.uint8))
    assert (finding.ok, finding.ids.shape, finding.pixels.shape, finding.rvec) == (False, (0,), (0, 2), None)
    assert "found 0 dots" in finding.reason
    canvas = np.full((480, 640, 3), 200, np.uint8)
    assert finding.draw(canvas) is canvas
    assert (canvas == 200).all()


def test_second_solution(pentagon):
    # From 3 m, tilted a little: the marker's perspective is less than what the print may be wrong by.
    far = replace(POSES, translation=np.array([[0, 0, 3.0]] * 400))
    (finding,) = Detector(pentagon, CAMERA, print_sigma="3mm")(look(pentagon, 30, poses=far))
    assert finding.ok
    rotation, translation = finding.pose.alternative
    np.testing.assert_array_equal(finding.second.rotation, rotation)
    np.testing.assert_array_equal(finding.second.tvec, translation[:, None])
    np.testing.assert_allclose(cv2.Rodrigues(finding.second.rvec)[0], rotation, atol=1e-9)
    assert 0.1 < finding.second.likelihood_ratio <= 1


@pytest.mark.parametrize("scale", [1, 257])
@pytest.mark.parametrize("camera", [CAMERA, None])
def test_drawing(pentagon, camera, scale):
    grey = look(pentagon, camera=camera or PAPER_CAMERA).astype(np.uint16 if scale > 1 else np.uint8) * scale
    (finding,) = Detector(pentagon, camera)(grey)
    copy = finding.draw(grey)
    assert copy.shape == (480, 640, 3)
    assert copy.dtype == grey.dtype
    assert copy.max() > 240 * scale
    changed = (copy != grey[..., None]).any(axis=-1)
    assert all(changed[y, x] for x, y in np.rint(finding.pixels).astype(int))
    assert not changed[:40, :40].any()
    one_channel = finding.draw(grey[..., None])
    np.testing.assert_array_equal(one_channel, copy)
    color = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    assert finding.draw(color) is color
    np.testing.assert_array_equal(color, copy)
    opaque = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)
    assert finding.draw(opaque) is opaque
    np.testing.assert_array_equal(opaque[..., :3], copy)
    assert (opaque[..., 3] == np.iinfo(grey.dtype).max).all()
    # Views are drawn into as well.
    plain = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    mirrored = plain[:, ::-1].copy()[:, ::-1]
    assert finding.draw(mirrored) is mirrored
    np.testing.assert_array_equal(mirrored, copy)


def test_ambiguous_dots_are_drawn_as_dots_alone(detect_pentagon, hidden_ring):
    (finding,) = detect_pentagon(hidden_ring)
    assert not finding.ok
    copy = finding.draw(hidden_ring)
    changed = (copy != hidden_ring[..., None]).any(axis=-1)
    assert all(changed[y, x] for x, y in np.rint(finding.pixels).astype(int))
    # Crosses of nine pixels twice, smoothed, and nothing else.
    assert changed.sum() < 4 * 60


def test_frames_that_cannot_be_drawn_into(detect_pentagon, frame):
    (finding,) = detect_pentagon(frame)
    locked = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
    locked.flags.writeable = False
    with pytest.raises(InputError, match="read-only"):
        finding.draw(locked)
    with pytest.raises(InputError, match="found None"):
        finding.draw(None)
    grey = frame.copy()
    grey.flags.writeable = False
    assert finding.draw(grey).shape == (480, 640, 3)


def test_pickled(detect_pentagon, frame):
    (finding,) = detect_pentagon(frame)
    (again,) = pickle.loads(pickle.dumps(detect_pentagon))(frame)
    copy = pickle.loads(pickle.dumps(finding))
    for other in (again, copy):
        np.testing.assert_array_equal(other.pixels, finding.pixels)
        np.testing.assert_array_equal(other.rvec, finding.rvec)
        assert other.as_dict() == finding.as_dict()


def test_one_detector_in_several_threads(pentagon):
    tagged = replace(pentagon, tag=parse_tag("aruco:DICT_4X4_50:7", 0.05))
    finder = Detector(tagged, CAMERA)
    frames = [look(tagged, pose, poses=ROLLED) for pose in (3, 60, 130, 200, 277, 330)]
    whole = [finder(frame) for frame in frames]
    nearby = [finder(frame, nearby) for frame, nearby in zip(frames, whole, strict=True)]
    alone = [finding for (finding,) in whole + nearby]
    with ThreadPoolExecutor(4) as pool:
        together = [finding for (finding,) in pool.map(finder, frames * 6, ([None] * 6 + whole) * 3)]
    for k, finding in enumerate(together):
        np.testing.assert_array_equal(finding.pixels, alone[k % 12].pixels)
        np.testing.assert_array_equal(finding.tag, alone[k % 12].tag)
        np.testing.assert_array_equal(finding.covariance, alone[k % 12].covariance)


def test_nothing_is_printed_or_logged(detect_pentagon, frame, hidden_ring, capfd, caplog):
    with caplog.at_level(logging.INFO):
        for image in (frame, hidden_ring):
            detect_pentagon(image)[0].draw(image)
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


def test_short_in_print(detect_pentagon, frame, hidden_ring, pentagon):
    (finding,), (lost,) = detect_pentagon(frame), detect_pentagon(hidden_ring)
    assert repr(detect_pentagon) == "Detector(marker; 640x480 px)"
    assert repr(Detector([pentagon] * 5)) == "Detector(marker 0, marker 1, marker 2 and 2 more; no camera)"
    assert repr(finding).startswith("<Found: marker, 5 of 5 dots, ")
    assert repr(lost).startswith("<Found: marker not found: ")
    assert max(len(repr(finding)), len(repr(lost))) < 200
    assert "5 of 5 dots" in finding._repr_html_()
    assert "ambiguous" in lost._repr_html_()
    assert len(finding._repr_html_()) < 1000


def test_html_is_escaped(pentagon, frame, tmp_path):
    path = tmp_path / "<b>.json"
    path.write_bytes(to_json(pentagon))
    assert "<b>" not in Detector(path, CAMERA)(frame)[0]._repr_html_()


def test_examples_in_the_docstrings():
    result = doctest.testmod(detector)
    assert result.attempted > 20
    assert result.failed == 0


def test_the_loop_of_the_documentation(pentagon, frame, tmp_path, monkeypatch, capsys):
    text = (Path(__file__).parents[2] / "docs" / "detect.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    (tmp_path / "marker.json").write_bytes(to_json(pentagon))
    (tmp_path / "camera.yaml").write_text(CAMERA_INFO)
    writer = cv2.VideoWriter(str(tmp_path / "video.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (640, 480))
    for image in (frame, np.full((480, 640), 200, np.uint8)):
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs/detect.md", "exec"), {})
    finding, lost = capsys.readouterr().out.splitlines()
    assert finding.startswith("[10 11 12 13 14] [")
    assert lost.startswith("found 0 dots")


def test_opencv_coefficients():
    assert not Camera(640, 480, 800, 800, 320, 240).cv2_distortion.any()
    assert CAMERA.cv2_distortion.tolist() == [-0.28, 0.09, 0.001, -0.0005, 0.0]
    assert CAMERAS["rational"].cv2_distortion.shape == (8,)
