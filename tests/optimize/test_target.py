"""Targets: the smallest marker that reaches an error, or why none does."""

import re

import numpy as np
import pytest

from markergen.bounds.dot_covariances import marker_budget
from markergen.errors import InputError
from markergen.model.boundary import Circle, Polygon
from markergen.model.camera import PAPER_CAMERA
from markergen.model.goal import parse_target
from markergen.model.poses import paper
from markergen.model.spec import AUTO, Spec
from markergen.objectives import Setting
from markergen.objectives.criteria import regular_polygon
from markergen.optimize import target as targets
from markergen.optimize.dot_count import Forecast, sources_of
from markergen.optimize.target import at_distance, sampled_error, settled

NEAR = "cone:distance=0.5..0.8,tilt=30..60,count=40"


def test_poses_move_to_the_distance_along_their_lines_of_sight():
    moved = at_distance(paper(), 2.0)
    np.testing.assert_allclose(moved.distance, 2.0)
    # Four distances become one, and the 20 frontal poses are turned about the optical axis.
    assert len(moved) == 100
    np.testing.assert_allclose(np.unique(np.round(moved.polar_angle_deg, 3)), [0, 17.5, 35, 52.5, 70], atol=1e-3)


def test_where_first_order_holds_sampling_agrees_with_it(monkeypatch):
    spec, target = Spec(n=AUTO, poses=NEAR), parse_target("1deg@0.6m")
    chosen = Forecast(regular_polygon(8, 0.12), 0.03, 0.01, 0.0)
    poses = at_distance(spec_poses(), 0.6)
    setting = Setting(Circle(0.15), PAPER_CAMERA, poses)
    result = marker_budget(chosen.points, chosen.diameter, setting, spec.image_noise, sources_of(spec))
    first = float(np.sqrt(np.mean(result.rotation_deg["total"] ** 2)))
    assert sampled_error(chosen, spec, target) == pytest.approx(first, rel=1e-9)
    monkeypatch.setattr("markergen.optimize.target.LARGEST_DEG", 0.0)
    # 2,560 estimates know their RMS to 1.4 %; with unequal weights LM is a little worse than the bound.
    assert sampled_error(chosen, spec, target) == pytest.approx(first, rel=0.06)


def spec_poses():
    from markergen.read.poses import poses_from

    return poses_from(NEAR)


def test_the_smallest_disk_reaches_a_target_that_a_smaller_one_does_not():
    spec = Spec(n=AUTO, boundary=Circle(0.06), poses=NEAR, target="1mm@0.6m", dot=0.012)
    choice = settled(spec)
    assert choice.spec.target == ""
    assert choice.spec.objective == "translation"
    assert 0.02 < choice.spec.boundary.radius < 0.06
    assert "that reach 1mm@0.6m: predicted 0." in choice.reason


def test_a_target_out_of_reach_names_what_limits():
    small = Polygon((((-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)),))
    spec = Spec(n=AUTO, boundary=small, poses=NEAR, target="0.001deg@0.6m", dot=0.012)
    with pytest.raises(InputError, match=r"the print alone gives 0\.\d+ deg") as error:
        settled(spec)
    assert "in this room" in str(error.value)


def test_a_source_alone_gives_no_more_than_all_of_them(monkeypatch):
    # Where the error is sampled, it may be less than to first order.
    monkeypatch.setattr(targets, "sampled_error", lambda *_: 0.02)
    spec = Spec(n=AUTO, boundary=Circle(0.06), poses=NEAR, target="0.01deg@0.6m", dot=0.012)
    with pytest.raises(InputError) as error:
        settled(spec)
    optimum = re.search(r"found 0\.02 deg with .* the print alone gives (0\.\d+) deg", str(error.value))
    assert 0.015 < float(optimum[1]) <= 0.02
