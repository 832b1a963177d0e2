import numpy as np
import pytest

from markergen.estimators import Correspondences
from markergen.estimators.lm import LM
from markergen.maths.dot_crlb import center_covariance
from markergen.maths.information import mirrored_rotation
from markergen.maths.projection import project
from markergen.maths.rotation import angle_between, exponential, logarithm
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution, paper
from markergen.render import DEFAULT_OPTICS
from markergen.validation.bounds import image_covariance, pose_bounds
from markergen.validation.trials import Experiment, run_trials


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


FISHEYE = Camera(640, 480, 250.0, 250.0, 320.0, 240.0, Distortion("equidistant", (0.0035, 0.0007, -0.002, 0.0002)))


def beside():
    """Near and off the axis, at 35 and 52.5 degrees."""
    poses = paper()
    kept = [45, 52, 67, 145]
    return PoseDistribution("beside", poses.rotation[kept], 0.4 * poses.translation[kept] + [0.2, 0.1, 0])


def test_through_a_lens_the_noise_is_that_of_the_image_as_taken():
    poses, points, step = beside(), polygon(5, 0.12), 1e-6
    ahead, behind = (
        [
            FISHEYE.project(points, exponential(h * e[:3]) @ poses.rotation, poses.translation + h * e[3:])
            for e in np.eye(6)
        ]
        for h in (step, -step)
    )
    jacobian = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)).reshape(len(poses), -1, 6) / (2 * step)
    result = pose_bounds(points, FISHEYE, poses, 0.2).information
    # Differences of pixels over 1e-6 leave seven digits.
    np.testing.assert_allclose(result, jacobian.swapaxes(1, 2) @ jacobian, rtol=1e-5, atol=1e-6 * result.max())


def test_trials_through_a_lens_have_the_covariance_of_the_bound():
    """2,000 trials at each of four poses: the mean NEES is 6, with a standard deviation of sqrt(12/8000) = 0.04.

    With unweighted residuals in ideal px it is 7.1. Five sigma, and 0.02 for second-order effects.
    """
    points, poses, noise_px = polygon(5, 0.12), beside(), 0.05
    bounds = pose_bounds(points, FISHEYE, poses, noise_px)
    trials = run_trials(Experiment(points, 0.15, FISHEYE, poses, bounds, noise_px, 2000, 0, ("lm",)), range(4))
    nees = np.concatenate([errors["lm"].nees for errors in trials])
    assert np.isfinite(nees).all()
    assert np.mean(nees) == pytest.approx(6, abs=5 * np.sqrt(12 / 8000) + 0.02)


def test_the_image_of_a_dot_is_judged_as_taken(make_ngon):
    """Small dots, whose images are affine: 0.3 % in size, of which the perspective of 4 mm at 250 mm is most."""
    marker, poses, optics, step = make_ngon(5, 0.12, 0.004), beside(), DEFAULT_OPTICS, 1e-5
    noise = float(optics.grey_noise(optics.exposure * (optics.dark + optics.light) / 2))
    contrast = optics.exposure * (optics.light - optics.dark)
    ahead, behind = (
        [FISHEYE.project(marker.xyz + h * e, poses.rotation, poses.translation) for e in np.eye(3)[:2]]
        for h in (step, -step)
    )
    affine = 0.002 * (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * step)
    expected = center_covariance(affine, optics.edge_blur, contrast / noise)
    result = image_covariance(marker, FISHEYE, poses, optics)
    scale = np.trace(expected, axis1=-2, axis2=-1)[..., None, None]
    assert np.abs((result - expected) / scale).max() < 0.003
