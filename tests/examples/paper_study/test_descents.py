import numpy as np
import pytest
from markergen_paper.descents import PoseByPose, descend_by_pose
from markergen_paper.options import OBJECTIVE_OF, RECTANGLE, REGION, objective_for, poses_of
from markergen_paper.supersab import supersab

from markergen.model.camera import PAPER_CAMERA
from markergen.optimize.search import descend

POSES = poses_of([0, 47, 205])


@pytest.fixture(scope="module")
def starts():
    return REGION.sample(12, 5, np.random.default_rng(1)).reshape(3, 4, 5, 2)


def alone(name, row):
    return objective_for(name, POSES.taken(np.array([row]), 0))


@pytest.mark.parametrize("name", OBJECTIVE_OF)
def test_values_and_gradients_are_those_of_the_pose(name, starts):
    rows = np.array([2, 0, 0, 1])
    layouts = starts[0]
    values, gradients = PoseByPose(name, POSES, rows, PAPER_CAMERA).value_and_gradient(layouts)
    for row, layout, value, gradient in zip(rows, layouts, values, gradients, strict=True):
        expected = alone(name, row).value_and_gradient(layout[None])
        # In pixels rounding of A'A, whose condition is that of A squared, costs most digits.
        np.testing.assert_allclose(value, expected[0][0], rtol=1e-4)
        np.testing.assert_allclose(gradient, expected[1][0], rtol=1e-3, atol=1e-4 * np.abs(gradient).max())


@pytest.mark.parametrize("name", ["metric", "hartley", "pose"])
def test_descents_together_are_descents_alone(name, starts):
    together = descend_by_pose(name, POSES, starts)
    for row in range(3):
        ends = descend(alone(name, row), REGION, starts[row])
        np.testing.assert_allclose(together.points[row], ends.points, atol=1e-6)
        np.testing.assert_allclose(together.values[row], ends.values, rtol=1e-6)


def test_so_are_those_of_other_routines_and_regions(starts):
    together = descend_by_pose("metric", POSES, starts, region=RECTANGLE, routine=supersab, steps=20)
    for row in range(3):
        ends = supersab(alone("metric", row), RECTANGLE, starts[row], 20)
        np.testing.assert_allclose(together.points[row], ends.points, atol=1e-9)


def test_a_layout_that_determines_nothing_has_no_gradient(starts):
    line = np.linspace(-0.1, 0.1, 5)[:, None] * np.array([1.0, 0.5])
    layouts = np.stack([line, starts[0, 0]])
    for name in ("metric", "pose"):
        values, gradients = PoseByPose(name, POSES, np.array([1, 2]), PAPER_CAMERA).value_and_gradient(layouts)
        assert np.isfinite(values).tolist() == [False, True]
        assert np.isfinite(gradients).all()
        assert not gradients[0].any()
