from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES
from markergen.objectives.aggregates import aggregate_of
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.objectives.observation import DotNoise
from markergen.objectives.survive import SurvivalObjective, hidden_dot_errors, losses
from markergen.optimize.problem import objective_of


@pytest.fixture(scope="module")
def few(setting):
    """Every ninth pose: all distances, tilts and many azimuths."""
    poses = PoseDistribution("few", setting.poses.rotation[::9], setting.poses.translation[::9])
    return replace(setting, poses=poses)


def layouts(dimension=2, n=7):
    rng = np.random.default_rng(0)
    points = regular_polygon(n, 0.1) + rng.normal(scale=0.02, size=(2, n, 2))
    return points if dimension == 2 else np.concatenate([points, rng.uniform(0, 0.02, (2, n, 1))], axis=-1)


def left(points, lost):
    """Layouts (S, B, n - lost, .) of all that can be left."""
    return np.stack([np.delete(points, loss, axis=1) for loss in combinations(range(points.shape[1]), lost)])


@pytest.mark.parametrize("aggregate", ["", "max", "cvar:0.8"])
@pytest.mark.parametrize("lost", [1, 2])
@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_it_is_the_worst_of_what_can_be_left(few, name, lost, aggregate):
    objective = OBJECTIVES[name](few, aggregate)
    surviving = SurvivalObjective(objective, lost)
    expected = np.max([objective(rest) for rest in left(layouts(), lost)], axis=0)
    # Taking information away, instead of adding up what is left, costs a digit or two of fifteen.
    np.testing.assert_allclose(surviving(layouts()), expected, rtol=1e-11)
    np.testing.assert_allclose(surviving.value_and_gradient(layouts())[0], expected, rtol=1e-11)
    assert surviving.per_pose(layouts()).shape == (2, len(few.poses))
    assert (surviving.unit, surviving.aggregate) == (objective.unit, objective.aggregate)
    assert surviving.nonsmooth


@pytest.mark.parametrize("noise", [None, DotNoise(0.03)])
@pytest.mark.parametrize("softness", [0.0, 0.05])
@pytest.mark.parametrize("lost", [1, 2])
@pytest.mark.parametrize(("name", "dimension"), [*((name, 2) for name in OBJECTIVES), ("pose", 3), ("rotation", 3)])
def test_gradient_agrees_with_differences(few, name, dimension, lost, softness, noise):
    objective = SurvivalObjective(OBJECTIVES[name](replace(few, noise=noise)), lost)
    points = layouts(dimension)
    along, step = np.random.default_rng(1).normal(size=points.shape), 1e-7
    gradient = objective.value_and_gradient(points, softness)[1]
    ahead, behind = (objective.value_and_gradient(points + h * along, softness)[0] for h in (step, -step))
    # Central differences over 1e-6 of the marker's size leave eight digits, fewer where c(A) is large.
    np.testing.assert_allclose(np.sum(gradient * along, axis=(1, 2)), (ahead - behind) / (2 * step), rtol=1e-5)


@pytest.mark.parametrize("softness", [0.1, 0.01])
def test_the_softened_value_is_just_above(few, softness):
    objective = SurvivalObjective(OBJECTIVES["pose"](few), 1)
    hard, soft = objective(layouts()), objective.value_and_gradient(layouts(), softness)[0]
    assert np.all(soft >= hard)
    assert np.all(soft <= hard * 7**softness * (1 + 1e-12))


def test_a_loss_that_leaves_a_line_is_infinite(few):
    line = np.stack([np.linspace(-0.1, 0.1, 5), np.zeros(5)], axis=-1)
    points = np.concatenate([line, [[0, 0.1]]])[None]
    objective = SurvivalObjective(OBJECTIVES["pose"](few), 1)
    assert OBJECTIVES["pose"](few)(points)[0] < 0.1
    for softness in (0.0, 0.05):
        value, gradient = objective.value_and_gradient(points, softness)
        # Rounding may leave a huge number instead of inf.
        assert value[0] > 1e3
        assert np.all(np.isfinite(gradient)) or np.isfinite(value[0])


def test_which_losses(few):
    assert losses(5, 1).tolist() == [[0], [1], [2], [3], [4]]
    assert losses(7, 3).shape == (35, 3)
    assert losses(4, 0).shape == (1, 0)
    for n, lost, phrase in [
        (4, 1, "four dots or more that are left, found n=4, survive=1; use --n 5 or more"),
        (6, 4, "0 to 3 lost dots"),
        (6, -1, "0 to 3 lost dots"),
        (24, 3, "at most 2000 sets of lost dots, found 2024 for n=24, survive=3"),
    ]:
        with pytest.raises(InputError, match=phrase):
            losses(n, lost)
    with pytest.raises(InputError, match="four dots"):
        SurvivalObjective(OBJECTIVES["pose"](few), 1)(np.zeros((1, 4, 2)))


def test_errors_with_hidden_dots(few):
    points = layouts()[0]
    table = hidden_dot_errors(points, few, 2)
    assert [row.hidden for row in table] == [0, 1, 2]
    assert table[0].worst_dots == ()
    for lost, row in enumerate(table):
        item = [criteria(rest, few)[0] for rest in left(points[None], lost)]
        for key in item[0]:
            values = [one[key] for one in item]
            assert row.worst[key] == pytest.approx(max(values), rel=1e-9)
            assert row.mean[key] == pytest.approx(np.mean(values), rel=1e-9)
        rest = np.delete(points, row.worst_dots, axis=0)
        assert criteria(rest[None], few)[0]["pose_m"] == pytest.approx(row.worst["pose_m"], rel=1e-9)
    assert table[0].worst["pose_m"] < table[1].mean["pose_m"] < table[1].worst["pose_m"] < table[2].worst["pose_m"]
    # Of a relief there is no homography, and a flat marker is no relief.
    raised = np.pad(points, ((0, 0), (0, 1)))
    assert hidden_dot_errors(raised, few, 1)[1] == table[1]
    raised[0, 2] = 0.01
    assert set(hidden_dot_errors(raised, few, 1)[1].worst) == {"pose_m", "rotation_deg", "translation_pct"}


def test_the_objective_of_a_spec(few):
    plain = objective_of(Spec(objective="rotation", aggregate="cvar:0.8"), few)
    assert (type(plain), plain.aggregate) == (OBJECTIVES["rotation"], "cvar:0.8")
    surviving = objective_of(Spec(n=7, objective="rotation", aggregate="cvar:0.8", survive=1), few)
    values = np.stack([plain.per_pose(rest) for rest in left(layouts(), 1)])
    expected = aggregate_of("cvar:0.8")(values, 0.0)[0].max(axis=0)
    np.testing.assert_allclose(surviving(layouts()), expected, rtol=1e-11)
