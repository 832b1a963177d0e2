"""Weighted sums and bounds as one objective."""

import numpy as np
import pytest

from markergen.objectives import OBJECTIVES
from markergen.objectives.composed import ComposedObjective
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.survive import SurvivalObjective


def parts(setting, lost):
    made = [OBJECTIVES[name](setting) for name in ("pose", "rotation", "homography")]
    return [SurvivalObjective(item, lost) if lost else item for item in made]


@pytest.mark.parametrize("softness", [0.0, 0.05, 2.0])
@pytest.mark.parametrize("lost", [0, 1])
def test_gradient_agrees_with_differences(setting, softness, lost):
    rng = np.random.default_rng(0)
    points = regular_polygon(6, 0.11) + rng.normal(scale=0.015, size=(3, 6, 2))
    pose, rotation, homography = parts(setting, lost)
    # The first bound is broken by 10 % or more, the second one is kept.
    broken, kept = float(rotation(points).min()) / 1.1, 2 * float(homography(points).max())
    objective = ComposedObjective([(1.0, pose), (0.3, rotation)], [(rotation, broken), (homography, kept)])
    along, step = rng.normal(size=points.shape), 1e-7
    ahead, behind = (objective.value_and_gradient(points + h * along, softness)[0] for h in (step, -step))
    value, gradient = objective.value_and_gradient(points, softness)
    np.testing.assert_allclose(
        np.sum(gradient * along, axis=(1, 2)) / value, (ahead - behind) / (2 * step) / value, rtol=1e-4, atol=1e-4
    )
    np.testing.assert_allclose(objective(points), objective.value_and_gradient(points)[0], rtol=1e-12)


def test_the_value_is_the_sum_where_bounds_are_kept_and_more_elsewhere(setting):
    pose, rotation, _ = parts(setting, 0)
    points = regular_polygon(5, 0.12)[None]
    plain, rotated = pose(points), float(rotation(points)[0])
    np.testing.assert_allclose(ComposedObjective([(2.0, pose)], [(rotation, rotated)])(points), 2 * plain, rtol=1e-12)
    # h = log 1.01 costs a factor of (1 + h)^100.
    above = ComposedObjective([(1.0, pose)], [(rotation, rotated / 1.01)])
    np.testing.assert_allclose(above(points), plain * (1 + np.log(1.01)) ** 100, rtol=1e-9)
    np.testing.assert_allclose(above.excess(points), [[np.log(1.01)]])
    assert above.unit == "m"
    assert above.nonsmooth


def test_a_degenerate_layout_is_infinite_and_has_no_gradient(setting):
    pose, rotation, _ = parts(setting, 0)
    objective = ComposedObjective([(1.0, pose)], [(rotation, 0.1)])
    value, gradient = objective.value_and_gradient(np.zeros((1, 5, 2)))
    assert np.isinf(value).all()
    assert not gradient.any()
