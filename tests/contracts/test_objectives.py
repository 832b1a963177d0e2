"""What every objective of the table promises, for every aggregate and every system of coordinates."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.criteria import columns, criteria, regular_polygon
from markergen.optimize.problem import fewer

AGGREGATED = [*AGGREGATES, "cvar:0.5"]
CASES = [
    (name, aggregate, coordinates)
    for name in OBJECTIVES
    for aggregate in AGGREGATED
    for coordinates in OBJECTIVES[name].coordinates
]


@pytest.fixture(scope="module")
def few(setting):
    """About fifty of the paper's poses: each has its own gradient."""
    return Setting(setting.boundary, setting.camera, fewer(setting.poses))


@pytest.mark.parametrize(("name", "aggregate", "coordinates"), CASES)
@pytest.mark.parametrize("softness", [0.0, 0.05])
def test_gradient_agrees_with_differences(few, name, aggregate, coordinates, softness):
    objective = OBJECTIVES[name](few, aggregate, coordinates)
    rng = np.random.default_rng(0)
    # Near a polygon, where c in pixels is small enough for differences of its value to mean something.
    points = regular_polygon(6, 0.11) + rng.normal(scale=0.015, size=(3, 6, 2))
    along = rng.normal(size=points.shape)
    # In pixels c is 1e4 to 1e5, so A'A carries a relative rounding of 1e-7 that a longer step has to drown.
    step = 1e-5 if coordinates == "pixel" else 1e-7
    ahead, behind = (objective.value_and_gradient(points + h * along, softness)[0] for h in (step, -step))
    value, gradient = objective.value_and_gradient(points, softness)
    exact = np.sum(gradient * along, axis=(1, 2))
    tolerance = 2e-2 if coordinates == "pixel" else 1e-5
    np.testing.assert_allclose(exact / value, (ahead - behind) / (2 * step) / value, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize(("name", "aggregate", "coordinates"), CASES)
def test_value_alone_is_the_value_beside_the_gradient(few, name, aggregate, coordinates):
    objective = OBJECTIVES[name](few, aggregate, coordinates)
    points = np.random.default_rng(1).uniform(-0.1, 0.1, (3, 5, 2))
    value, gradient = objective.value_and_gradient(points)
    np.testing.assert_allclose(objective(points), value, rtol=1e-12)
    assert gradient.shape == points.shape
    assert objective.per_pose(points).shape == (3, len(few.poses))
    # A batch is its layouts one by one, whatever the chunks.
    np.testing.assert_allclose([objective.value_and_gradient(p[None])[0][0] for p in points], value, rtol=1e-12)


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_the_order_of_the_points_does_not_matter(setting, name):
    objective = OBJECTIVES[name](setting)
    points = np.random.default_rng(2).uniform(-0.1, 0.1, (1, 6, 2))
    np.testing.assert_allclose(objective(points[:, ::-1]), objective(points), rtol=1e-10)


@pytest.mark.parametrize("name", [name for name in OBJECTIVES if name != "blunder"])  # A displacement in m of one dot.
def test_larger_markers_are_better(setting, name):
    objective = OBJECTIVES[name](setting)
    small, large = objective(np.stack([regular_polygon(5, 0.07), regular_polygon(5, 0.14)]))
    assert large < small


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_every_objective_is_documented(name):
    kind = OBJECTIVES[name]
    assert kind.__doc__
    assert kind.default_restarts >= 4
    assert kind.unit in {"m", "px", "deg", "%", ""}


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_a_criterion_has_a_column_and_is_the_objective(setting, name):
    kind = OBJECTIVES[name]
    if kind.criterion is None:
        return
    every = columns()
    assert every[name] is kind.criterion
    assert len({item.key for item in every.values()}) == len({item.column for item in every.values()}) == len(every)
    assert kind.criterion.title.isprintable()
    points = np.random.default_rng(4).uniform(-0.1, 0.1, (2, 6, 2))
    result = [row[kind.criterion.key] for row in criteria(points, setting)]
    np.testing.assert_allclose(result, kind(setting)(points), rtol=1e-9)


@pytest.mark.parametrize("name", list(OBJECTIVES))
def test_points_in_space_have_a_gradient_or_are_refused(setting, name):
    objective = OBJECTIVES[name](setting)
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-0.1, 0.1, (2, 6, 2)), rng.uniform(0, 0.02, (2, 6, 1))], axis=-1)
    if objective.planar_only:
        with pytest.raises(InputError, match="the marker's plane"):
            objective(points)
        return
    along, step = rng.normal(size=points.shape), 1e-7
    gradient = objective.value_and_gradient(points)[1]
    numeric = (objective(points + step * along) - objective(points - step * along)) / (2 * step)
    # Central differences over 1e-6 of the marker's size leave eight digits.
    np.testing.assert_allclose(np.sum(gradient * along, axis=(1, 2)), numeric, rtol=1e-6)
    # In the plane, the third coordinate makes no difference.
    points[..., 2] = 0
    np.testing.assert_allclose(objective(points), objective(points[..., :2]), rtol=1e-12)
