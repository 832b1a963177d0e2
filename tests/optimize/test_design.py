from dataclasses import replace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.feature import RING_PIXELS
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.design import design, upright
from markergen.optimize.dot_size import choose_dots, wanted_diameter
from markergen.optimize.problem import FeasibleRegion, breach
from markergen.optimize.to_marker import members, numbered

FEW = "cone:distance=0.6..1.5m,tilt=0..60,count=8"


def test_the_default_marker(setting):
    result = design(Spec())
    marker = result.marker
    assert len(marker) == 5
    assert marker.dot_diameter == 0.036
    assert marker.control_points[0].feature.kind == "ring"
    assert [point.feature.kind for point in marker.control_points[1:]] == ["dot"] * 4
    assert marker.control_points[0].feature.inner_diameter == 0.018
    xy = marker.xyz[:, :2]
    # Upright: the key dot is straight up, as far out as dot and clearance allow.
    np.testing.assert_allclose(xy[0], [0, 0.15 - 0.018 - 0.0036], atol=1e-9)
    assert set(result.criteria) == {"design", "ngon", "square", "random"}
    assert result.criteria["design"]["pose_m"] <= result.criteria["ngon"]["pose_m"] * 1.001
    assert result.criteria["design"]["pose_m"] < 0.5 * result.criteria["random"]["pose_m"]


def test_equal_specs_give_equal_bytes_and_other_seeds_other_provenance():
    spec = Spec(n=4, restarts=1, poses=FEW)
    first, second = (to_json(design(spec).marker) for _ in range(2))
    assert first == second
    assert to_json(from_json(first.decode())) == first
    assert replace(spec, seed=1).hash != spec.hash


def test_constraints_hold_by_plain_arithmetic():
    for wanted in ({"n": 7}, {"n": 12, "dot": 0.05}, {"n": 5, "dot": 0.08}, {"n": 4, "boundary": Circle(0.04)}):
        spec = Spec(restarts=1, poses=FEW, **wanted)
        marker = design(spec).marker
        radius = marker.dot_diameter / 2
        assert np.hypot(*marker.xyz[:, :2].T).max() <= spec.boundary.radius - radius - marker.clearance + 1e-9
        gaps = [np.hypot(*(a - b)[:2]) for i, a in enumerate(marker.xyz) for b in marker.xyz[:i]]
        assert min(gaps) >= marker.dot_diameter + marker.clearance - 1e-9


def test_dots_follow_the_camera_and_the_poses(setting):
    assert wanted_diameter(setting.camera, setting.poses) == 0.036
    sharper = Camera(1280, 960, 1600.0, 1600.0, 640.0, 480.0)
    assert wanted_diameter(sharper, setting.poses) == 0.018


def test_dots_are_capped_by_the_room_and_the_cap_is_told(setting):
    size = choose_dots(Spec(n=12, boundary=Circle(0.05)), setting.poses)
    assert size.diameter < 0.036
    assert "8 px would need 36" in size.reason
    assert "this leaves" in size.reason


@pytest.mark.parametrize(
    ("spec", "phrase"),
    [
        (Spec(n=12, dot=0.08), "of which 8 fit"),
        (Spec(n=4, dot=0.2), "of which 1 fit"),
        (Spec(n=4, dot=0.4), "of which 0 fit"),
    ],
)
def test_dots_that_cannot_fit_say_how_many_do(setting, spec, phrase):
    with pytest.raises(InputError, match=phrase):
        choose_dots(spec, setting.poses)


def test_a_marker_that_no_pose_sees_is_refused():
    with pytest.raises(InputError, match="pose that sees"):
        design(Spec(boundary=Circle(2.0)))


def test_poses_that_see_only_a_part_are_counted():
    result = design(Spec(boundary=Circle(0.25), restarts=1))
    assert 0 < result.setting.poses.dropped < 400
    assert len(result.setting.poses) + result.setting.poses.dropped == 400
    assert result.marker.provenance["poses"] == {
        "name": "paper", "count": len(result.setting.poses), "dropped": result.setting.poses.dropped,
    }  # fmt: skip


def test_turning_upright_costs_nothing_and_numbers_run_round(setting):
    objective, region = OBJECTIVES["pose"](setting), FeasibleRegion(Circle(0.15))
    angle = 0.4
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = numbered(upright(regular_polygon(5, 0.15) @ rotation.T, objective, region))
    np.testing.assert_allclose(points, regular_polygon(5, 0.15), atol=1e-9)


def test_a_dot_at_the_center_comes_last():
    points = np.concatenate([np.zeros((1, 2)), regular_polygon(5, 1.0)])
    np.testing.assert_array_equal(numbered(points)[-1], [0, 0])


@pytest.mark.long
def test_studies_may_use_bare_points_and_are_warned():
    result = design(Spec(dot=0.0, clearance=0.0, restarts=1, poses=FEW))
    assert result.marker.dot_diameter == 0
    assert any("bare points" in warning for warning in result.warnings)
    small = design(Spec(dot=0.005, restarts=1, poses=FEW)).warnings
    assert any(f"takes {RING_PIXELS:g} px for the" in warning for warning in small)
    assert any(
        "Hartley" in warning
        for warning in design(Spec(n=4, objective="condition", coordinates="hartley", restarts=1, poses=FEW)).warnings
    )


def test_a_design_with_keep_outs_keeps_out(shapes):
    hole = Circle(0.012, (0.09, 0.04))
    result = design(Spec(n=5, boundary=shapes["rectangle"], keep_outs=(hole,), dot=0.02, restarts=1, poses=FEW))
    assert result.marker.keep_outs == (hole,)
    xy = result.marker.xyz[:, :2]
    assert np.hypot(*(xy - hole.center).T).min() >= 0.012 + 0.01 + 0.002 - 1e-9
    assert np.abs(xy[:, 0]).max() <= 0.1 - 0.012 + 1e-9
    assert np.abs(xy[:, 1]).max() <= 0.05 - 0.012 + 1e-9
    # The hole takes the corner away from the dot that would be there.
    free = design(Spec(n=5, boundary=shapes["rectangle"], dot=0.02, restarts=1, poses=FEW))
    assert result.criteria["design"]["pose_m"] > free.criteria["design"]["pose_m"] * 1.001
    assert result.seconds > 0


def test_what_does_not_fit_beside_keep_outs_is_refused(shapes):
    holes = tuple(Circle(0.04, (x, 0.0)) for x in (-0.05, 0.05))
    with pytest.raises(InputError, match=r"of which [0-3] fit"):
        design(Spec(n=5, boundary=shapes["rectangle"], keep_outs=holes, dot=0.03))


def test_a_broken_layout_is_an_internal_error(monkeypatch):
    from markergen.optimize import design as module

    monkeypatch.setattr(module, "upright", lambda points, *_: points * 1.01)
    with pytest.raises(RuntimeError, match="breaks its constraints"):
        design(Spec(n=4, restarts=1, poses=FEW))


def test_a_traced_design_tells_its_way_and_is_the_same():
    plain, traced = (design(Spec(n=4, restarts=1, poses=FEW), traced=traced) for traced in (False, True))
    assert to_json(plain.marker) == to_json(traced.marker)
    assert plain.trace == ()
    assert [step.stage for step in traced.trace[:2]] == ["start", "polish"]
    assert traced.trace[-1].objective == pytest.approx(traced.criteria["design"]["pose_m"])


@pytest.mark.parametrize("n", [4, *(pytest.param(n, marks=pytest.mark.long) for n in (6, 8))])
def test_one_sided_poses_are_worth_an_own_layout(n):
    poses = "cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,count=20"
    result = design(Spec(n=n, poses=poses, restarts=1))
    assert result.criteria["design"]["pose_m"] <= 0.95 * result.criteria["ngon"]["pose_m"]


SPEC = Spec(tag="aruco:DICT_4X4_50:7", tag_side=0.06, restarts=1)


def test_a_criterion_below_0_is_compared_like_any_other(setting):
    result = design(Spec(n=4, restarts=1, dot=0.02, poses=FEW))
    negative = {layout: {key: -value for key, value in row.items()} for layout, row in result.criteria.items()}
    assert isinstance(replace(result, criteria=negative).warnings, tuple)


@pytest.fixture(scope="module")
def marker():
    return design(SPEC).marker


def test_the_dots_keep_clear_of_the_tag_and_stay_on_the_rim(marker):
    assert marker.tag == SPEC.placed_tag
    assert breach(marker.xyz, marker.boundary, marker.blocked, marker.dot_diameter, marker.clearance) <= 1e-9
    # The tag costs nothing: 36 mm dots with 3.6 mm of clearance are 128.4 mm out, a regular pentagon.
    assert np.hypot(*marker.xyz[:, :2].T) == pytest.approx(0.1284, abs=1e-6)
    criteria = marker.provenance["criteria"]
    # A flat optimum: a ten-thousandth is less than any print shows.
    assert criteria["design"]["pose_m"] == pytest.approx(criteria["ngon"]["pose_m"], rel=1e-4)


def test_a_tag_in_the_way_moves_the_dots():
    # With the quiet zone 8/6 of 150 mm: its corners are 141 mm out, and dots of 20 mm pass beside them alone.
    spec = Spec(n=4, tag="aruco:DICT_4X4_50", tag_side=0.15, dot=0.02, restarts=1, poses=FEW.replace("8", "30"))
    marker = design(spec).marker
    assert breach(marker.xyz, marker.boundary, marker.blocked, marker.dot_diameter, marker.clearance) <= 1e-9
    angles = np.rad2deg(np.arctan2(marker.xyz[:, 1], marker.xyz[:, 0])) % 90
    # The corners stand at 45 degrees to the axes.
    assert np.all(np.abs(angles - 45) > 10)


def test_every_member_is_as_if_designed_by_itself():
    spec = replace(SPEC, n=4, poses=FEW)
    marker = design(spec).marker
    three = members(marker, spec, (3, 7, 12))
    assert [item.tag.id for item in three] == [3, 7, 12]
    assert all(item.control_points == marker.control_points for item in three)
    assert three[1] == marker
    alone = design(replace(spec, tag="aruco:DICT_4X4_50:12")).marker
    assert to_json(three[2]) == to_json(alone)
    assert len({item.spec_hash for item in three}) == 3
    assert from_json(to_json(three[0]).decode()) == three[0]


def test_a_family_needs_tags_that_there_are(marker):
    with pytest.raises(InputError, match="id of 0 to 49"):
        members(marker, SPEC, (3, 50))
    with pytest.raises(InputError, match="--tag"):
        members(replace(marker, tag=None), SPEC, (3,))


def test_dots_of_any_size_leave_the_tag_its_place():
    with pytest.raises(InputError, match="dots that fit"):
        design(Spec(boundary=Circle(0.05), tag="aruco:DICT_4X4_50", tag_side=0.05, dot=0.03))
