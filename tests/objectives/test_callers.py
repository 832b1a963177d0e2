"""Objectives that a caller passes as they are."""

import autograd.numpy as anp
import numpy as np
import pytest

import markergen as mg
from markergen.objectives import OBJECTIVES
from markergen.objectives.autograd import AutogradObjective

pytestmark = pytest.mark.usefixtures("only_our_objectives")
FEW = {"n": 5, "radius": "50mm", "restarts": 2, "poses": "cone:count=20"}


def depth(points, view):
    return anp.sqrt(view.covariance(points)[..., 5, 5])


def test_a_function_is_minimized():
    by_depth, by_pose = mg.design(objective=depth, **FEW), mg.design(**FEW)
    assert by_depth.marker.provenance["spec"]["objective"] == "depth"
    view = OBJECTIVES["depth"](by_depth.setting)
    assert by_depth.value == pytest.approx(view(by_depth.marker.xyz[None, :, :2])[0])
    # What the pose's layout costs along the line of sight.
    assert by_depth.value <= view(by_pose.marker.xyz[None, :, :2])[0] * (1 + 1e-9)


def test_its_gradient_is_that_of_differences():
    mg.design(objective=depth, **FEW)
    objective = OBJECTIVES["depth"](mg.design(**FEW).setting)
    points = 0.03 * np.random.default_rng(0).uniform(-1, 1, (1, 5, 2))
    gradient = objective.value_and_gradient(points)[1]
    step = np.zeros_like(points)
    step[0, 2, 1] = 1e-7
    difference = (objective(points + step) - objective(points - step)) / 2e-7
    assert gradient[0, 2, 1] == pytest.approx(difference[0], rel=1e-5)


@pytest.mark.long
def test_a_class_is_minimized_and_a_cell_may_be_run_again():
    for power in (1, 2):

        class Volume(AutogradObjective):
            power_of_it = power

            def values(self, points):
                return anp.exp(-anp.linalg.slogdet(self.information(points))[1] / 12) ** self.power_of_it

        value = mg.design(objective=Volume, **FEW).value
        assert OBJECTIVES["volume"] is Volume
    assert 0 < value < 1


@pytest.mark.parametrize(
    ("objective", "phrase"),
    [
        (lambda points: 1, r"points and view, found <lambda>\(points\)"),
        (lambda points, view: "a", "found 'a'"),
        (lambda points, view: np.linalg.det(view.information(points)), r"autograd\.numpy"),
        (lambda points, view: view.rotation, r"rotation.*view\.covariance"),
        (lambda points, view: anp.sum(points**2), r"found shape \(\); .* \(\d+, 20\)"),
    ],
)
def test_a_function_of_another_form_is_refused(objective, phrase):
    with pytest.raises(mg.InputError, match=phrase):
        mg.design(objective=objective, **FEW)


@pytest.mark.parametrize("objective", [5, ["pose"], type("Pose", (), {}), type("Own", (), {})])
def test_what_is_no_objective_is_refused(objective):
    with pytest.raises(mg.InputError):
        mg.design(objective=objective, **FEW)


@pytest.mark.parametrize(("value", "phrase"), [(-40.0, "above 0"), (np.nan, "numbers")])
def test_values_that_have_no_logarithm_are_refused_before_the_search(value, phrase):
    def constant(points, view):
        return value + 0 * view.covariance(points)[..., 0, 0]

    with pytest.raises(mg.InputError, match=phrase):
        mg.design(objective=constant, **FEW)
