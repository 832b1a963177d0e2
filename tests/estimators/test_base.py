import numpy as np
import pytest

from markergen.errors import InputError
from markergen.estimators import Correspondences, PoseEstimates, PoseEstimator
from markergen.maths.projection import project
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper

SQUARE = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])


class Counting(PoseEstimator):
    name = "counting"

    def __init__(self):
        self.calls = 0

    def solve(self, batch):
        self.calls += 1
        return PoseEstimates(np.zeros((1, 1, 3, 3)), np.zeros((1, 1, 3)))


def test_an_estimator_solves_a_batch_once():
    batch = Correspondences(SQUARE, np.zeros((1, 4, 2)), PAPER_CAMERA)
    estimator = Counting()
    assert batch.once(estimator) is batch.once(estimator)
    assert estimator.calls == 1


@pytest.mark.parametrize(
    ("points", "pixels"),
    [((3, 2), (1, 3, 2)), ((4, 2), (1, 5, 2)), ((4, 2), (4, 2)), ((4, 4), (1, 4, 2)), ((4, 2), (1, 4, 3))],
)
def test_shapes_that_do_not_fit_are_refused(points, pixels):
    with pytest.raises(InputError, match="four or more correspondences"):
        Correspondences(np.zeros(points), np.zeros(pixels), PAPER_CAMERA)


def test_planar_looks_at_the_heights():
    pixels = np.zeros((1, 4, 2))
    flat = np.c_[SQUARE, np.zeros(4)]
    assert Correspondences(SQUARE, pixels, PAPER_CAMERA).planar
    assert Correspondences(flat, pixels, PAPER_CAMERA).planar
    assert not Correspondences(flat + np.array([0, 0, 0.01]), pixels, PAPER_CAMERA).planar
    assert np.array_equal(Correspondences(SQUARE, pixels, PAPER_CAMERA).xyz, flat)


def test_reprojection_error_is_the_mean_squared_distance():
    poses = paper()
    pixels = project(SQUARE, poses.rotation[:2], poses.translation[:2], PAPER_CAMERA.matrix)
    # One of four points is off by (3, 4) px in the second trial: 25 px^2 over four points.
    pixels[1, 2] += [3, 4]
    batch = Correspondences(SQUARE, pixels, PAPER_CAMERA)
    assert np.allclose(batch.reprojection_error(poses.rotation[:2], poses.translation[:2]), [0, 25 / 4])
    behind = batch.reprojection_error(poses.rotation[:2], -poses.translation[:2])
    assert np.array_equal(behind, [np.inf, np.inf])
    assert np.array_equal(batch.reprojection_error(np.full((2, 3, 3), np.nan), np.ones((2, 3))), [np.inf, np.inf])
