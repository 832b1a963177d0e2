import re
from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.bounds.crowding import BLOT_PX, crowded, separating_gap
from markergen.detect.detector import Detector
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.maths.dot_crlb import center_covariance
from markergen.maths.information import pose_jacobian
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle, polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.poses import PoseDistribution
from markergen.model.spec import ImageNoise, Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.observation import DotNoise
from markergen.optimize import design as designing
from markergen.optimize.design import design
from markergen.optimize.dot_size import (
    choose_dots,
    largest_that_leaves_room,
    pixels_across,
    smallest_detectable,
    wanted_pixels,
)
from markergen.read.poses import poses_from
from markergen.render import Optics, render_view

PLATE = polygon_from([np.array([[-0.08, -0.05], [0.08, -0.05], [0.08, 0.05], [-0.08, 0.05]])])


@pytest.fixture(scope="module")
def few(setting):
    """Every seventh pose of the paper: as many distances and tilts, in a seventh of the time."""
    return PoseDistribution("few", setting.poses.rotation[::7], setting.poses.translation[::7])


@pytest.fixture(scope="module")
def best(few):
    """The size for image noise alone."""
    return choose_dots(Spec(dot="auto"), few)


def polygon_error(poses, diameter, name="pose", print_sigma=0.0):
    """Predicted error of the pentagon on the inset rim."""
    noisy = Setting(Circle(0.15), PAPER_CAMERA, poses, DotNoise(diameter, print_sigma=print_sigma))
    points = regular_polygon(5, 0.15 - 0.6 * diameter)
    return OBJECTIVES[name](noisy)(points[None])[0]


def test_no_diameter_of_a_scan_promises_less(few, best):
    size = best
    scan = [polygon_error(few, diameter) for diameter in np.arange(0.012, 0.09, 0.001)]
    # Whole tenths of a millimeter about a flat minimum.
    assert polygon_error(few, size.diameter) <= min(scan) * 1.0001
    assert size.diameter == round(size.diameter, 4)
    assert size.clearance == pytest.approx(size.diameter / 10)
    output = re.fullmatch(
        r"([\d.]+) mm, with the least predicted error of ([\d.]+) mm for image noise alone: larger ones are .*",
        size.reason,
    )
    assert float(output[1]) == pytest.approx(1e3 * size.diameter)
    # Three digits are told, and the pentagon is not quite the best for so few poses.
    assert float(output[2]) == pytest.approx(1e3 * polygon_error(few, size.diameter), rel=0.01)
    assert choose_dots(Spec(dot="auto"), few) == size


def test_a_print_error_asks_for_smaller_dots(few, best):
    # 3 um err as much as the image does: the best size is inside the range.
    size = choose_dots(Spec(dot="auto", print_sigma=3e-6), few)
    scan = [polygon_error(few, diameter, print_sigma=3e-6) for diameter in np.arange(0.018, 0.09, 0.001)]
    # The layout is polished in 15 steps, and judged here by the pentagon that it nearly is.
    assert polygon_error(few, size.diameter, print_sigma=3e-6) <= min(scan) * 1.0005
    assert smallest_detectable(PAPER_CAMERA, few) < size.diameter < best.diameter
    assert sentence("for noise", sentence("print error", "0.003 mm")) in size.reason
    assert not size.warning


def test_the_total_of_image_and_print_is_least(few, best):
    # By the budget, which knows nothing of objectives and designs.
    sizes = {0.0: best, 1e-4: choose_dots(Spec(dot="auto", print_sigma=1e-4), few)}
    total = {sigma: budget_of(few, size.diameter) for sigma, size in sizes.items()}
    assert total[1e-4] <= budget_of(few, 0.036)
    assert total[0.0] > 1.3 * budget_of(few, 0.036)
    output = re.fullmatch(
        r"a print error of 0\.1 mm would outweigh what dots of this size gain \(([\d.]+) mm instead of ([\d.]+) mm for "
        r"([\d.]+) mm\): use --print-sigma 0\.1mm",
        sizes[0.0].warning,
    )
    # Three digits are told; the layout is the pentagon but for 1 %.
    assert float(output[1]) == pytest.approx(1e3 * polygon_error(few, sizes[0.0].diameter, print_sigma=1e-4), rel=0.015)
    assert float(output[2]) == pytest.approx(
        1e3 * polygon_error(few, float(output[3]) / 1e3, print_sigma=1e-4), rel=0.015
    )
    assert not sizes[1e-4].warning


def budget_of(poses, diameter):
    """RMS rotation error in degrees of the pentagon on the inset rim, with a print error of 0.1 mm."""
    points, (R, t) = regular_polygon(5, 0.15 - 0.6 * diameter), (poses.rotation, poses.translation)
    jacobian = pose_jacobian(points, R, t, PAPER_CAMERA.focal).reshape(-1, 5, 2, 6)
    image = ImageNoise()
    spread = center_covariance(
        jacobian[..., 3:] @ R[:, None, :, :2] * diameter / 2, image.edge_px, image.contrast_to_noise
    )
    total = pose_budget(points, R, t, PAPER_CAMERA, spread, ErrorSources(print_sigma=1e-4)).rotation_deg["total"]
    return np.sqrt(np.mean(total**2))


def test_an_auto_design_is_a_marker_like_any_other():
    result = design(Spec(dot="auto", n=4, restarts=1, poses="cone:distance=0.6..1.5m,tilt=0..60,count=20"))
    marker = result.marker
    assert from_json(to_json(marker).decode()).dot_diameter == result.dots.diameter
    assert marker.provenance["spec"]["dot"] == "auto"
    assert marker.provenance["noise"] == result.setting.noise_words
    assert result.setting.noise == DotNoise(result.dots.diameter)
    assert result.setting.noise_words in result.summary
    assert result.warnings == (result.dots.warning,)
    assert "use --print-sigma" in result.dots.warning
    assert result.criteria["design"]["pose_m"] <= result.criteria["ngon"]["pose_m"] * 1.0001


def test_a_design_is_for_the_print_error_it_was_asked_for():
    actual = design(Spec(n=4, noise_model="image", print_sigma=1e-4, restarts=1))
    assert actual.setting.noise == DotNoise(actual.dots.diameter, print_sigma=1e-4)
    assert actual.marker.provenance["spec"]["print_sigma"] == 1e-4
    assert actual.marker.provenance["noise"].endswith(sentence("print error", "0.1 mm"))
    assert not actual.warnings


def test_the_homography_wants_smaller_dots_farther_out(few):
    size = choose_dots(Spec(dot="auto", objective="homography"), few)
    scan = np.arange(0.02, 0.08, 0.002)
    homography, pose = ([polygon_error(few, diameter, name) for diameter in scan] for name in ("homography", "pose"))
    assert scan[np.argmin(homography)] < scan[np.argmin(pose)]
    # The regular polygon is nearly, not quite, the best layout for the homography.
    assert polygon_error(few, size.diameter, "homography") <= min(homography) * 1.01
    assert " px" + sentence("for noise", " alone") in size.reason


def test_dots_are_never_too_small_to_be_detected():
    # A coarse camera, for which the best dots of a small marker would be a few pixels.
    coarse = Camera(320, 240, 400.0, 400.0, 160.0, 120.0)
    spec = Spec(dot="auto", n=4, boundary=Circle(0.06), camera=coarse, restarts=1)
    actual = design(spec)
    least = smallest_detectable(coarse, actual.setting.poses)
    assert actual.dots.diameter == least
    assert pixels_across(least, coarse, actual.setting.poses) == pytest.approx(4.0, rel=0.01)
    assert "4 px wide and 6 px long in 94 %" in actual.dots.reason
    assert not actual.warnings


def test_room_may_leave_less_than_detection_needs(few):
    spec = Spec(dot="auto", n=6, boundary=Circle(0.012))
    size = choose_dots(spec, few)
    assert size.diameter == largest_that_leaves_room(spec)
    assert "90 % of the largest" in size.reason
    assert f"; {smallest_detectable(PAPER_CAMERA, few) * 1e3:g} mm would be" in size.reason


def test_no_room_at_all_is_refused(setting):
    with pytest.raises(InputError, match=r"dots of 0\.1 mm"):
        choose_dots(Spec(dot="auto", n=20, boundary=Circle(2e-4)), setting.poses)


def test_smallest_detectable_looks_at_both_axes(setting):
    # Tilts decide here; seen frontally alone, the long axis would.
    assert smallest_detectable(PAPER_CAMERA, setting.poses) == pytest.approx(0.018, abs=0.001)
    frontal = type(setting.poses)("frontal", setting.poses.rotation[:20], setting.poses.translation[:20])
    assert smallest_detectable(PAPER_CAMERA, frontal) == pytest.approx(6 * 0.6 / 800)


def test_a_given_clearance_is_kept_and_progress_ends_full(few):
    calls = []
    size = choose_dots(Spec(dot="auto", n=4, clearance=0.02), few, lambda *call: calls.append(call))
    assert size.clearance == 0.02
    assert calls[-1][1] == calls[-1][2]
    assert {stage for stage, *_ in calls} == {"dot size"}


def test_dots_that_run_together_in_images_are_told_with_the_gap_that_serves():
    poses = PoseDistribution("frontal", np.diag([1.0, -1, -1])[None], np.array([[0.0, 0, 1.0]]))
    camera, diameter = Camera(640, 480, 800, 800, 320, 240), 0.01
    for gap in (0.0012, 0.0018):  # 0.96 and 1.44 px
        points = np.array([[0.0, 0, 0], [diameter + gap, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
        message = crowded(points, diameter, camera, poses)
        assert bool(message) == (800 * gap < BLOT_PX)
        if message:
            assert "100 %" in message[0]
            assert "--gap 1.5mm" in message[0]  # 1.2 px
    assert crowded(points, 0.0, camera, poses) == []


def test_dots_for_a_blurred_image_are_larger_and_found():
    image, text = ImageNoise(blur_px=2.0), "cone:distance=1.2..1.4,tilt=0..20,count=8"
    poses = poses_from(text)
    usual, marker = (
        design(Spec(n=5, poses=text, image_noise=noise, restarts=1)).marker for noise in (ImageNoise(), image)
    )
    assert marker.dot_diameter > usual.dot_diameter
    assert pixels_across(marker.dot_diameter, PAPER_CAMERA, poses) >= wanted_pixels(image)
    detector, rng = Detector(marker, PAPER_CAMERA), np.random.default_rng(0)
    for pose in zip(poses.rotation, poses.translation, strict=True):
        assert detector(render_view(marker, PAPER_CAMERA, *pose, Optics(blur_px=2.0), rng))[0].ok


def test_a_blur_fills_gaps_between_dots():
    poses = PoseDistribution("frontal", np.diag([1.0, -1, -1])[None], np.array([[0.0, 0, 1.0]]))
    camera, diameter, gap = Camera(640, 480, 800, 800, 320, 240), 0.02, 0.003
    points = np.array([[0.0, 0, 0], [diameter + gap, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    assert crowded(points, diameter, camera, poses) == []
    [message] = crowded(points, diameter, camera, poses, ImageNoise(blur_px=1.75))
    assert "3 px apart in 100 %" in message
    assert "--gap 3.8mm" in message


def test_images_of_dots_that_keep_the_gap_stay_apart_wherever_they_are(setting):
    """Checks the gap, from derivatives at the rim, on pairs of dots anywhere in the room and in any direction."""
    rng, diameter = np.random.default_rng(3), 0.02
    gap = separating_gap(Circle(0.13).rim(64), PAPER_CAMERA, setting.poses)
    for kept, apart in ((gap, True), (0.93 * gap, False)):
        first, angle = Circle(0.13).sample(4000, 0.0, rng), rng.uniform(0, 2 * np.pi, 4000)
        second = first + (diameter + kept) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        pairs = np.stack([first, second], axis=1)[np.hypot(*second.T) <= 0.13]
        pixels = PAPER_CAMERA.project(pairs.reshape(-1, 2), setting.poses.rotation, setting.poses.translation)
        seen = np.linalg.norm(np.diff(pixels.reshape(len(setting.poses), -1, 2, 2), axis=2)[:, :, 0], axis=-1)
        images = np.sort((seen * kept / (diameter + kept)).min(axis=1))
        assert (images[int(0.05 * len(images))] >= BLOT_PX) == apart


def test_a_gap_that_no_dots_of_the_best_layout_need_is_none(monkeypatch):
    # As if the first layouts that the search comes upon were crowded, but not its result.
    monkeypatch.setattr(designing, "crowding", lambda *_: 1.0)
    free = design(Spec(n=5, boundary=Circle(0.15), restarts=1))
    assert (free.gap.reason, free.spec.gap) == ("clearance", 0.0)


@pytest.mark.parametrize("boundary", [Circle(0.08), pytest.param(PLATE, marks=pytest.mark.long)], ids=["disk", "plate"])
def test_a_design_of_which_nothing_else_is_said_keeps_images_of_dots_apart(boundary):
    spec = Spec(n=12, boundary=boundary, poses="cone:distance=0.8..1.2,tilt=0..60,count=6", restarts=1)
    actual = design(spec)
    assert actual.spec.gap > 0
    assert not [message for message in actual.warnings if "apart" in message]
    assert f"{actual.spec.gap * 1e3:g} mm or more" in actual.summary
    again = design(actual.spec)
    assert again.marker.control_points == actual.marker.control_points
    assert (actual.gap.reason, again.gap.reason) == ("images", "asked")
    # What is asked for is done, with a warning.
    asked = design(replace(spec, dot=choose_dots(spec, poses_from(spec.poses)).diameter))
    assert asked.spec.gap == 0
    assert any("use --gap" in message for message in asked.warnings)
