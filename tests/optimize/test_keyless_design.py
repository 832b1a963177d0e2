"""Markers whose layout tells the labels: no key ring, and nothing that claims one."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.bounds.confusion.perspective import label_safety
from markergen.errors import InputError
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle
from markergen.model.spec import Spec
from markergen.model.tag import Tag
from markergen.optimize import keyless
from markergen.optimize.design import design, upright

SPEC = Spec(n=5, asymmetric=2.0, restarts=1, poses="cone:distance=0.6..1.2,tilt=0..60,count=9")


@pytest.fixture(autouse=True)
def few_starts(monkeypatch):
    """Fewer starts than a user's, for time."""
    monkeypatch.setattr(keyless, "SHAKES", (0.1,))
    monkeypatch.setattr(keyless, "FINALISTS", 2)


def test_the_layout_tells_the_labels():
    actual = design(SPEC, traced=True)
    marker = from_json(to_json(actual.marker).decode())
    assert {point.feature.kind for point in marker.control_points} == {"dot"}
    # Rounding to a tenth of a nanometer is far less than the search asks for on top.
    assert label_safety(marker, actual.setting).least >= 2.0
    assert actual.labels.least >= 2.0
    assert "the layout, safety >= 2 px" in actual.summary
    assert actual.labels.sentence in actual.summary
    assert marker.provenance["labels"] == actual.labels.sentence
    assert "ring" not in actual.summary + to_json(marker).decode()
    stages = [step.stage for step in actual.trace]
    assert "asymmetric" in stages
    assert actual.trace[-1].objective == pytest.approx(actual.criteria["design"]["pose_m"])


def test_undecided_labels_are_warned_about_but_where_a_tag_has_them():
    tiny = Spec(n=5, dot=0.002, boundary=Circle(0.006), restarts=1, poses="cone:distance=1..2,tilt=50..70,count=9")
    result = design(tiny)
    assert not result.labels.is_decided
    assert any(warning.startswith(result.labels.sentence) for warning in result.warnings)
    tagged = replace(result, body=replace(result.marker, tag=Tag("aruco:DICT_4X4_50", 0, 0.001)))
    assert not any(result.labels.sentence in warning for warning in tagged.warnings)
    assert not any("labels" in warning for warning in design(SPEC).warnings)


def test_the_key_ring_is_named_where_there_is_one():
    result = design(Spec(n=4, restarts=1, poses=SPEC.poses))
    assert "dot 0 is the key ring\n" in result.summary
    assert result.labels.px[0] == np.inf
    assert design(Spec(n=4, dot=0.0, restarts=1, poses=SPEC.poses)).labels is None


def test_a_demand_that_cannot_be_met_is_refused_with_what_can(monkeypatch):
    monkeypatch.setattr(keyless, "ROUNDS", 1)
    with pytest.raises(InputError, match=r"to 300 px .* safer than [1-9]"):
        design(Spec(n=4, asymmetric=300.0, restarts=1, poses=SPEC.poses))


def test_a_turn_that_is_not_allowed_is_not_made(criterion, rooms):
    from markergen.model.boundary import Circle
    from markergen.objectives.criteria import regular_polygon
    from markergen.optimize.problem import FeasibleRegion

    disk = Circle(0.15)
    rotation = np.array([[0.9, -np.sqrt(0.19)], [np.sqrt(0.19), 0.9]])
    points, region = regular_polygon(5, 0.15) @ rotation.T, FeasibleRegion(disk)
    assert upright(points, criterion(disk), region, lambda _: False) is points
    assert upright(points, criterion(disk), region, lambda _: True) is not points
