import numpy as np
import pytest
from markergen_paper.descents import descend_by_pose
from markergen_paper.experiments import ROUTINES
from markergen_paper.options import REGION, objective_for, poses_of
from markergen_paper.supersab import FIRST, GROW, SHRINK, supersab

from markergen.optimize.search import descend


class Bowl:
    """The value sum a x^2 of each layout."""

    def __init__(self, *curvatures):
        self.curvature = np.reshape(curvatures, (-1, 2))

    def value_and_gradient(self, points):
        return np.sum(self.curvature * points**2, axis=(1, 2)), 2 * self.curvature * points


def test_steps_are_those_of_the_algorithm_by_hand():
    # One coordinate moves: its steps, written out for a scalar.
    start, curvature = 0.06, 40.0
    x, previous, last = start, start, 0.0
    step, way = FIRST * 0.15 / (2 * curvature * start), []
    for _ in range(80):
        gradient = 2 * curvature * x
        if gradient * last < 0:
            step, x, previous, last = step * SHRINK, previous, x, 0.0
        else:
            step *= GROW if gradient * last > 0 else 1.0
            previous, x, last = x, x - step * gradient, gradient
        way.append(x)
    assert min(np.diff(np.sign(way))) < 0  # A step went too far, and was undone.
    result = supersab(Bowl(curvature, 0, 0, 0), REGION, np.array([[[start, 0.0], [0.0, 0.0]]]), 80)
    assert result.points[0, 0, 0] == pytest.approx(min([start, *way], key=abs), rel=1e-6)
    assert result.steps == 80


def test_both_routines_lower_c_and_stay_in_the_disk():
    objective = objective_for("metric", poses_of([25]))
    starts = REGION.sample(8, 5, np.random.default_rng(0))
    for options in ROUTINES.values():
        descent = descend_by_pose("metric", objective.setting.poses, starts[None], **options)
        assert np.all(descent.values[0] < objective(starts))
        assert REGION.holds(descent.points[0]).all()
        assert descent.values[0] == pytest.approx(objective(descent.points[0]))


def test_ours_does_not_depend_on_the_unit_of_the_objective():
    starts = np.array([[[0.06, 0.03], [0.0, 0.0]]])
    first, second = (descend(Bowl(a, a, a, a), REGION, starts, 5).points for a in (40.0, 41.0))
    assert first == pytest.approx(second, abs=2e-3)
