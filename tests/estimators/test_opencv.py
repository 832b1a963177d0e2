import numpy as np

from markergen.estimators import Correspondences
from markergen.estimators.base import best_first
from markergen.maths.projection import project
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper

SQUARE = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])


def two_solutions():
    """Two trials of which the first solves the first, the second the second."""
    poses = paper()
    true = [100, 200]
    pixels = project(SQUARE, poses.rotation[true], poses.translation[true], PAPER_CAMERA.matrix)
    batch = Correspondences(SQUARE, pixels, PAPER_CAMERA)
    pairs = np.array([[100, 150], [150, 200]])
    return batch, poses.rotation[pairs].copy(), poses.translation[pairs].copy()


def test_best_first_orders_each_trial_by_its_own_errors():
    batch, rotation, translation = two_solutions()
    result = best_first(batch, rotation, translation)
    assert np.array_equal(result.best[0], rotation[[0, 1], [0, 1]])
    assert np.array_equal(result.best[1], translation[[0, 1], [0, 1]])
    assert np.array_equal(result.rotation[:, 1], rotation[[0, 1], [1, 0]])


def test_what_is_behind_the_camera_comes_after_what_is_in_front():
    batch, rotation, translation = two_solutions()
    # The same image points, from behind.
    rotation[0, 0] = rotation[0, 0] @ np.diag([-1.0, -1.0, 1.0])
    translation[0, 0] *= -1
    result = best_first(batch, rotation, translation)
    assert np.array_equal(result.translation[0], translation[0, ::-1])


def test_what_is_not_finite_comes_last():
    batch, rotation, translation = two_solutions()
    rotation[0, 0, 0, 0] = np.nan
    translation[0, 1] *= -1
    result = best_first(batch, rotation, translation)
    assert np.array_equal(result.translation[0, 0], translation[0, 1])
    assert np.isnan(result.rotation[0, 1]).all()
    assert np.isnan(result.translation[0, 1]).all()
