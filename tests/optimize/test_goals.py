"""Objectives with weights and bounds, from text to layout."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.body_json import to_json
from markergen.model.goal import parse_goal
from markergen.model.spec import Spec
from markergen.optimize import certificate
from markergen.optimize.design import design

VOLUME = "cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,roll=0,count=8"


def spec(objective, **more):
    return Spec(n=5, poses=VOLUME, dot=0.01, restarts=1, objective=objective, **more)


def ratio(result, key):
    return result.criteria["design"][key] / result.criteria["ngon"][key]


def test_a_bound_is_kept_and_the_rest_is_better_than_the_polygon():
    actual = design(spec("pose, rotation <= 1.05 ngon"))
    assert ratio(actual, "rotation_deg") <= 1.05 * (1 + 1e-3)
    assert ratio(actual, "pose_m") <= 0.95
    # The bound is what keeps the displacement from being as small as without it.
    assert ratio(actual, "rotation_deg") == pytest.approx(1.05, rel=1e-3)
    assert actual.value == pytest.approx(actual.criteria["design"]["pose_m"], rel=1e-3)
    assert actual.marker.provenance["spec"]["objective"] == "pose, rotation <= 1.05 ngon"


@pytest.mark.long
def test_the_lower_bound_of_the_criterion_alone_holds_with_bounds(monkeypatch):
    monkeypatch.setattr(certificate, "ROUNDS", 60)
    actual = design(spec("pose, rotation <= 1.05 ngon"))
    alone = design(spec("pose"))
    assert actual.certificate.lower_bound <= alone.value < actual.value
    assert actual.certificate.lower_bound == pytest.approx(alone.value, rel=0.01)


def test_weights_weigh_criteria_relative_to_the_polygon():
    actual = design(spec("pose + 0.5 rotation"))
    assert actual.value == pytest.approx(ratio(actual, "pose_m") + 0.5 * ratio(actual, "rotation_deg"), rel=1e-6)
    assert actual.value <= 1.5 * (1 + 1e-9)
    assert "weighted sum" in actual.certificate.sentence
    assert to_json(design(spec("pose+0.5  rotation")).marker) == to_json(actual.marker)


def test_a_bound_that_cannot_be_kept_is_refused():
    with pytest.raises(InputError, match=r"rotation <= 0.1 deg, found [\d.]+ deg"):
        design(spec("pose, rotation <= 0.1 deg"))


def test_a_weak_criterion_names_the_bound():
    actual = design(spec("pose"))
    assert any("or --objective 'pose, rotation <= ngon'" in warning for warning in actual.warnings)


@pytest.mark.parametrize(
    "text",
    ["pose,", "pose, rotation", "pose + ", "pose rotation", "0 pose + rotation", "pose, rotation > 1", "pose, a <= deg",
     "pose, rotation <= 0", "pose, rotation >= ngon", "-1 pose + rotation", ", rotation <= ngon", "pose <= ngon"],
)  # fmt: skip
def test_malformed_text_is_refused(text):
    with pytest.raises(InputError, match="or a weighted") as caught:
        Spec(objective=text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("pose, speed <= ngon", "speed"),
        ("pose, rotation <= 2 mm", "expected a bound on rotation in deg"),
        ("pose + homography", "expected an objective for points in space"),
    ],
)
def test_what_the_criteria_do_not_support_is_refused(text, phrase):
    with pytest.raises(InputError, match=phrase):
        design(Spec(objective=text, relief=0.02 if "homography" in text else 0.0))


def test_equal_goals_are_equal_specs_and_plain_ones_are_as_given():
    assert spec("pose,homography<=2px").hash == spec("pose , homography <= 2.0 px").hash
    assert str(parse_goal("condition")) == "condition"
    assert str(parse_goal("2 pose")) == "pose"
    assert str(parse_goal("pose; rotation < 1 deg")) == "pose, rotation <= 1 deg"
    limits = parse_goal("pose, translation <= 1%, rotation <= 1 ngon").limits
    assert [str(limit) for limit in limits] == ["translation <= 1 %", "rotation <= ngon"]
    assert np.all([limit.most == 1 for limit in limits])
