from dataclasses import replace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.estimators import Correspondences, PoseEstimates, PoseEstimator
from markergen.maths.projection import project
from markergen.model.camera import PAPER_CAMERA, Distortion
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
    with pytest.raises(InputError, match="or more correspondences"):
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


def test_distorted_image_points_are_led_back_through_the_lens():
    camera = replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.4, 0.0, 1e-3, -5e-4)))
    poses = paper()
    taken = camera.project(SQUARE, poses.rotation[:3], poses.translation[:3])
    batch = Correspondences.from_distorted(SQUARE, taken, camera)
    ideal = camera.ideal.project(SQUARE, poses.rotation[:3], poses.translation[:3])
    # The inverse is good to 1e-13 of the focal length.
    np.testing.assert_allclose(batch.image_points, ideal, atol=1e-9)
    assert np.abs(taken - ideal).max() > 1
    # Its derivative, by differences of what the lens makes of ideal points.
    step = 1e-4
    ahead, behind = (
        [camera.to_pixels(camera.ideal.from_pixels(ideal + h * e)) for e in np.eye(2)] for h in (step, -step)
    )
    numeric = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * step)
    np.testing.assert_allclose(batch.lens, numeric, atol=1e-8)


def test_pixels_that_no_ray_comes_to_make_a_trial_unsolvable():
    camera = replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.4, 0.0, 0.0, 0.0)))
    pixels = np.array([[[300, 200], [340, 200], [340, 260], [300, 260]]], dtype=float).repeat(2, axis=0)
    pixels[1, 0] = [-900, 200]
    assert Correspondences.from_distorted(SQUARE, pixels, camera).solvable.tolist() == [True, False]


def test_without_a_lens_pixels_are_what_they_are():
    pixels = np.random.default_rng(0).uniform(0, 400, (2, 4, 2))
    batch = Correspondences.from_distorted(SQUARE, pixels, PAPER_CAMERA)
    assert batch.image_points is pixels
    assert batch.lens is None
