import numpy as np
import pytest

from markergen.estimators import Correspondences
from markergen.estimators.lm import LM
from markergen.maths.information import mirrored_rotation
from markergen.maths.projection import project
from markergen.maths.rotation import angle_between, logarithm
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, paper
from markergen.validate.bounds import pose_bounds


def polygon(n, radius=0.15):
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)


@pytest.mark.parametrize(
    ("n", "rotation_deg", "translation_pct"),
    [(4, 3.1023, 0.6078), (5, 2.7742, 0.5431), (6, 2.5325, 0.4958), (7, 2.3446, 0.4590), (8, 2.1932, 0.4293)],
)
def test_reference_values_of_regular_polygons(n, rotation_deg, translation_pct):
    """RMS over the paper's 400 poses at 1 px, to the digits that are known."""
    bounds = pose_bounds(polygon(n), PAPER_CAMERA, paper(), 1.0)
    assert np.sqrt(np.mean(bounds.rotation_deg**2)) == pytest.approx(rotation_deg, abs=5e-5)
    assert np.sqrt(np.mean(bounds.translation_pct**2)) == pytest.approx(translation_pct, abs=5e-5)


def test_bounds_go_with_the_noise():
    unit, fifth = (pose_bounds(polygon(5), PAPER_CAMERA, paper(), noise) for noise in (1.0, 0.2))
    assert fifth.rotation_deg == pytest.approx(unit.rotation_deg / 5)
    assert fifth.translation_pct == pytest.approx(unit.translation_pct / 5)
    assert fifth.separation == pytest.approx(unit.separation * 5)
    assert np.array_equal(fifth.information, unit.information)


def test_without_noise_the_bound_is_zero_and_the_poses_far_apart():
    bounds = pose_bounds(polygon(5), PAPER_CAMERA, paper(), 0.0)
    assert not bounds.rotation_deg.any()
    assert np.isinf(bounds.separation).all()


def test_separation_is_in_units_of_the_rotation_bound():
    poses = paper()
    bounds = pose_bounds(polygon(5), PAPER_CAMERA, poses, 0.2)
    apart = np.rad2deg(angle_between(poses.rotation, mirrored_rotation(poses.rotation, poses.translation)))
    assert bounds.separation == pytest.approx(apart / bounds.rotation_deg)


def test_sampled_covariance_is_the_bound():
    """20,000 LM poses at 35 degrees: whitened by the bound, their covariance is the identity.

    Its entries have a standard deviation of sqrt(2/N) = 0.01 on the diagonal and less off it; five of those are
    allowed. Second-order effects are below 0.003 at this pose. It does not prove the bound for frontal poses.
    """
    poses, count = paper(), 20_000
    one = PoseDistribution("one", poses.rotation[[45]], poses.translation[[45]])
    points = polygon(5)
    pixels = project(points, one.rotation, one.translation, PAPER_CAMERA.matrix)
    pixels = pixels + 0.2 * np.random.default_rng(0).normal(size=(count, 5, 2))
    rotation, translation = Correspondences(points, pixels, PAPER_CAMERA).once(LM).best
    error = np.concatenate([logarithm(rotation @ one.rotation[0].T), translation - one.translation[0]], axis=-1)
    information = pose_bounds(points, PAPER_CAMERA, one, 0.2).information[0] / 0.2**2
    whitened = np.linalg.cholesky(information).T @ np.cov(error.T) @ np.linalg.cholesky(information)
    assert one.polar_angle_deg[0] == pytest.approx(35)
    assert np.abs(whitened - np.eye(6)).max() < 5 * np.sqrt(2 / count)
