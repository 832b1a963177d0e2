"""Searches that end early return the best feasible layout so far, marked as interrupted."""

import json
from time import monotonic

import numpy as np
import pytest

from markergen.api.design import design
from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.poses import named_poses
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.ending import Ended, TimeLimit, current_limit, end_if_due, is_due, limited
from markergen.optimize.layouts import regular_layouts
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import search
from markergen.units import parse_duration


def test_a_limit_holds_inside_its_context_alone():
    end_if_due()
    with limited(TimeLimit(at=monotonic())) as _, pytest.raises(Ended):
        end_if_due()
    limit = TimeLimit(asked=True)
    with limited(limit):
        assert is_due()
        with limited(None):
            assert not is_due()
        assert current_limit() is limit
    assert not is_due()


ROOMS = {
    "disk": Circle(0.15),
    "L": polygon_from([[(0, 0), (0.3, 0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.3), (0, 0.3)]]),
}


@pytest.mark.parametrize("room", ROOMS.values(), ids=ROOMS)
@pytest.mark.parametrize("seconds", [0.0, 0.05, pytest.param(0.3, marks=pytest.mark.long)])
def test_an_interrupted_search_returns_a_feasible_layout(room, seconds, setting):
    region = FeasibleRegion(room, 0.02, 0.002)
    objective = OBJECTIVES["pose"](Setting(room, setting.camera, named_poses("cone:count=48")))
    limit = TimeLimit(at=monotonic() + seconds)
    with limited(limit):
        optimum = search(objective, region, 14, np.random.default_rng(0))
    assert limit.ended or monotonic() < limit.at
    assert region.holds(optimum.points[None]).all()
    assert optimum.value == pytest.approx(objective(optimum.points[None])[0])


def test_many_dots_are_at_once_as_good_as_the_best_regular_layout(setting):
    region = FeasibleRegion(Circle(0.15), 0.012, 0.0012)
    objective = OBJECTIVES["pose"](Setting(region.boundary, setting.camera, named_poses("cone:count=12")))
    with limited(TimeLimit(asked=True)):
        optimum = search(objective, region, 30, np.random.default_rng(0))
    layouts, _ = regular_layouts(region, 30)
    assert optimum.value == pytest.approx(objective(layouts).min())


def test_what_is_found_in_a_given_time_is_marked(tmp_path):
    path, poses = tmp_path / "marker.json", "cone:distance=0.6..1.5,tilt=0..70,count=12"
    result = design(n=14, boundary="rect:0.3x0.2", poses=poses, time="0.01s", output=path, json=tmp_path / "out.json")
    assert result.interrupted > 0
    assert json.loads(path.read_text())["provenance"]["search"]["interrupted_s"] == result.interrupted
    assert json.loads((tmp_path / "out.json").read_text())["interrupted_s"] == result.interrupted


def test_a_time_that_is_none_is_refused():
    for text in ("soon", "-3s", "0", "5 parsecs"):
        with pytest.raises(InputError):
            parse_duration(text)
