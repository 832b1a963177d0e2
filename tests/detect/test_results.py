"""What results say beside dots and pose: states of tags, turns, verdicts, and true reasons."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.detect import Detector, detect
from markergen.detect.results import lines_of
from markergen.maths.rotation import angle_between, rotation_z
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.marker import build_marker
from markergen.model.poses import paper
from markergen.model.rig import Plate, Rig
from markergen.model.tag import parse_tag
from markergen.render import Optics, render_view

POSES = paper()
POSE = POSES.rotation[130], POSES.translation[130]
GRID = 0.06 * np.stack(np.meshgrid([-1.5, -0.5, 0.5, 1.5], [-1, 0, 1]), axis=-1).reshape(-1, 2)


def view(body, pose=POSE, camera=PAPER_CAMERA):
    return render_view(body, camera, *pose, Optics(), np.random.default_rng(0))


@pytest.fixture(scope="module")
def grid():
    return build_marker(GRID, Circle(0.15), diameter=0.03, clearance=0.003, keyed=False)


@pytest.fixture(scope="module")
def tagged(pentagon):
    return replace(pentagon, tag=parse_tag("aruco:DICT_4X4_50:7", 0.08))


def test_a_layout_that_repeats_is_reported_with_its_turns(grid):
    finding = detect(view(grid), grid, PAPER_CAMERA)
    assert not finding.ok
    assert finding.reason.endswith(sentence("repeats", 180))
    np.testing.assert_allclose(finding.turns, [np.pi], atol=0.01)
    assert sorted(finding.guess) == list(range(12))


def test_any_labeling_is_kept_in_a_video(grid):
    detector, finding, off = Detector(grid, PAPER_CAMERA, symmetric="any"), (), []
    # More than a turn in all: the labeling that looks upright changes twice on the way.
    for k, angle in enumerate(np.deg2rad(np.arange(0, 400, 20))):
        rotation = POSE[0] @ rotation_z(angle)
        finding = detector(view(grid, (rotation, POSE[1])), near=finding, whole=k % 5 == 4)
        (result,) = finding
        assert result.ok, result.reason
        assert result.finding.tracked == (k > 0 and k % 5 != 4)
        np.testing.assert_allclose(result.as_dict()["turns_deg"], [180], atol=0.5)
        off.append(angle_between(result.rotation, rotation))
        exact = PAPER_CAMERA.project(result.xyz, result.rotation[None], result.translation[None])[0]
        assert np.abs(result.pixels - exact).max() < 0.05
        assert result.ids.tolist() == list(range(12))
    # The same of the two all the time, whichever it is.
    assert np.ptp(off) < 0.01
    assert min(abs(off[0]), abs(off[0] - np.pi)) < 0.01
    assert sentence("turned", 180) in str(result)


def test_a_mirrored_image_is_called_mirrored(tagged):
    (finding,) = Detector(tagged, PAPER_CAMERA)(view(tagged)[:, ::-1])
    assert (finding.ok, finding.finding.state) == (False, "mirrored")
    assert "mirrored" in finding.reason


@pytest.mark.parametrize(("sigma", "state"), [(0.001, "mirrored"), (0.003, "mirrored"), (0, "ambiguous")])
def test_a_mirrored_image_of_a_nearly_symmetric_layout_is_called_mirrored(sigma, state, grid):
    off = np.random.default_rng(1).normal(0, 1, GRID.shape)
    marker = build_marker(GRID + sigma * off, Circle(0.15), diameter=0.03, clearance=0.003, keyed=False)
    assert detect(view(marker), marker, PAPER_CAMERA).ok == (sigma > 0)
    finding = detect(view(marker)[:, ::-1], marker, PAPER_CAMERA)
    assert (finding.ok, finding.finding.state) == (False, state)


def test_what_became_of_the_tag(tagged):
    image = view(tagged)
    corners = detect(image, tagged, PAPER_CAMERA).tag
    hidden = image.copy()
    low, high = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int) + 1
    hidden[low[1] : high[1], low[0] : high[0]] = 128
    bare, other = replace(tagged, tag=None), replace(tagged, tag=replace(tagged.tag, id=3))
    cases = {"read": (image, tagged), "not read": (hidden, tagged), "other": (image, other), "none": (image, bare)}
    for state, (picture, marker) in cases.items():
        finding = detect(picture, marker, PAPER_CAMERA)
        assert finding.tag_state == state
        # Another one of its family might have this layout.
        assert finding.ok == (state in ("read", "none"))
        assert (finding.tag is not None) == (state == "read")
    assert detect(hidden, tagged, PAPER_CAMERA).as_dict()["tag_state"] in ("covered", "unclear", "faint")


def test_a_wrong_camera_file_is_named(ngon):
    pose, marker = (POSES.rotation[390], POSES.translation[390]), ngon(8)
    finding = detect(view(marker, pose, replace(PAPER_CAMERA, fx=640.0, fy=640.0)), marker, PAPER_CAMERA)
    assert not finding.verdict.consistent
    causes = {cause.name: cause for cause in finding.verdict.causes}
    assert abs(causes["focal length"].value - np.log(0.8)) < 4 * causes["focal length"].sigma
    output = finding.as_dict()["verdict"]
    assert (output["consistent"], [cause["name"] for cause in output["causes"]]) == (False, list(causes))
    assert sentence("inconsistent") in str(finding)
    right = detect(view(marker, pose), marker, PAPER_CAMERA)
    assert right.verdict.consistent
    assert sentence("inconsistent") not in str(right)


def test_a_print_that_is_stretched_is_called_so(ngon):
    drawn = ngon(8)
    narrow = tuple(replace(point, x=0.97 * point.x) for point in drawn.control_points)
    finding = detect(view(replace(drawn, control_points=narrow)), drawn, PAPER_CAMERA)
    assert not finding.verdict.consistent
    assert finding.verdict.causes[0].name == "stretch x"
    assert abs(finding.verdict.causes[0].value + 0.03) < 4 * finding.verdict.causes[0].sigma


def test_plates_that_are_exchanged_are_named(ngon, irregular):
    apart = ((0.0, -0.2, 0.0), (0.0, 0.2, 0.0))
    left, right = (Plate(name, marker, np.eye(3), place) for name, marker, place in
                   zip("ab", (ngon(8), irregular), apart, strict=True))  # fmt: skip
    swapped = Rig((replace(left, translation=apart[1]), replace(right, translation=apart[0])))
    camera = Camera(1280, 960, 800, 800, 639.5, 479.5)
    pose = POSE[0], np.array([0.0, 0.0, 1.5])
    finding = detect(view(swapped, pose, camera), Rig((left, right)), camera)
    assert (finding.ok, finding.finding.state) == (False, "contradicted")
    assert "a and b exchanged" in finding.reason
    assert detect(view(swapped, pose, camera), swapped, camera).ok


def test_a_search_without_time_says_that_it_was_cut(irregular):
    dots = build_marker(GRID, Circle(0.15), diameter=0.02, clearance=0.002)
    image = view(dots)
    detector = Detector(irregular, PAPER_CAMERA)
    (cut,), (ended,) = detector(image, deadline=1e-6), detector(image, deadline=60)
    assert not cut.ok
    assert not ended.ok
    assert cut.reason.endswith(sentence("cut"))
    assert sentence("cut") not in ended.reason


def test_markers_that_were_not_found_share_a_line_beside_one_that_was(tagged):
    family = [replace(tagged, tag=replace(tagged.tag, id=number)) for number in (5, 6, 7)]
    names = ["family-5.json", "family-6.json", "family-7.json"]
    results = [replace(result, names=names) for result in Detector(family, PAPER_CAMERA)(view(family[2]))]
    seen, unseen = lines_of(results)
    assert seen.startswith("family-7.json, 5 of 5 dots")
    assert unseen == "not found: family-5.json, family-6.json"
    assert lines_of(results[:2]) == [str(result) for result in results[:2]]
    assert lines_of(results[1:]) == [str(result) for result in results[1:]]
