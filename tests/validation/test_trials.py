from dataclasses import replace

import numpy as np
import pytest

from markergen.maths.projection import project
from markergen.model.camera import PAPER_CAMERA, Distortion
from markergen.model.poses import PoseDistribution, paper
from markergen.validation import trials
from markergen.validation.bounds import pose_bounds
from markergen.validation.trials import Experiment, join, noisy_images, run_trials


def experiment(marker, runs=5, noise_px=0.2, estimators=("dlt", "ippe", "lm"), seed=0):
    poses = paper()
    kept = [10, 30, 350]
    poses = PoseDistribution("few", poses.rotation[kept], poses.translation[kept])
    bounds = pose_bounds(marker.xyz, PAPER_CAMERA, poses, noise_px)
    return Experiment(marker.xyz, 0.15, PAPER_CAMERA, poses, bounds, noise_px, runs, seed, estimators)


def images(*args, index=0, **options):
    return np.concatenate(list(noisy_images(experiment(*args, **options), index)))


def test_noise_is_gaussian_of_the_given_size_around_the_exact_points(pentagon):
    found = images(pentagon, runs=20_000, noise_px=0.5)
    setup = experiment(pentagon)
    exact = project(pentagon.xyz, setup.poses.rotation[:1], setup.poses.translation[:1], PAPER_CAMERA.matrix)[0]
    residual = (found - exact).reshape(20_000, -1)
    # Five standard deviations of a mean (sigma/sqrt(N)) and of a covariance (sigma^2 sqrt(2/N)).
    assert np.abs(residual.mean(axis=0)).max() < 5 * 0.5 / np.sqrt(20_000)
    assert np.abs(np.cov(residual.T) - 0.25 * np.eye(10)).max() < 5 * 0.25 * np.sqrt(2 / 20_000)


def test_each_pose_and_seed_has_its_own_noise(pentagon):
    assert np.array_equal(images(pentagon), images(pentagon))
    first = images(pentagon) - images(pentagon, noise_px=0.0)
    second = images(pentagon, index=1) - images(pentagon, noise_px=0.0, index=1)
    other = images(pentagon, seed=1) - images(pentagon, noise_px=0.0)
    assert np.abs(first - second).min() > 0
    assert np.abs(first - other).min() > 0


def test_many_runs_come_in_blocks(pentagon, monkeypatch):
    whole = images(pentagon, runs=10)
    monkeypatch.setattr(trials, "BLOCK", 4)
    blocks = list(noisy_images(experiment(pentagon, runs=10), 0))
    assert [len(block) for block in blocks] == [4, 4, 2]
    assert np.array_equal(np.concatenate(blocks), whole)
    errors = run_trials(experiment(pentagon, runs=10), [0])[0]
    assert {name: errors[name].failed.shape for name in errors} == {"dlt": (10,), "ippe": (10,), "lm": (10,)}


def test_errors_vanish_with_the_noise(pentagon):
    """To 1e-5 px, deg and % as every estimator is exact; NEES is not defined."""
    for errors in run_trials(experiment(pentagon, noise_px=0.0), range(3)):
        assert np.sqrt(errors["dlt"].he_px2).max() < 1e-5
        assert errors["lm"].rotation_deg.max() < 1e-5
        assert errors["lm"].translation_pct.max() < 1e-5
        assert np.isnan(errors["lm"].nees).all()
        assert not any(part.failed.any() for part in errors.values())


def test_nees_is_that_of_lm_alone(pentagon):
    errors = run_trials(experiment(pentagon), [1])[0]
    assert np.isfinite(errors["lm"].nees).all()
    assert np.isnan(errors["ippe"].nees).all()


def test_validation_points_at_the_horizon_are_left_out(pentagon):
    """A marker so near that part of the wider grid lies behind the camera still has a finite HE."""
    poses = paper()
    near = PoseDistribution("near", poses.rotation[[90]], 0.4 * poses.translation[[90]])
    setup = experiment(pentagon)
    setup = Experiment(pentagon.xyz, 0.15, PAPER_CAMERA, near, setup.bounds, 0.0, 2, 0, ("dlt",))
    assert np.sqrt(run_trials(setup, [0])[0]["dlt"].he_px2).max() < 1e-5


@pytest.mark.parametrize(("stack", "shape"), [(True, (3, 5)), (False, (15,))])
def test_join(pentagon, stack, shape):
    parts = run_trials(experiment(pentagon), range(3))
    joined = join(parts, stack=stack)
    assert joined["lm"].rotation_deg.shape == shape
    assert np.array_equal(joined["dlt"].he_px2.ravel(), np.concatenate([part["dlt"].he_px2 for part in parts]))


def test_noise_is_that_of_the_image_as_taken_and_the_homography_ideal(pentagon):
    lens = Distortion("radtan", (-0.3, 0.1, 1e-3, -5e-4))
    setup = replace(experiment(pentagon, runs=4, noise_px=0.0), camera=replace(PAPER_CAMERA, distortion=lens))
    poses = setup.poses
    taken = setup.camera.project(pentagon.xyz, poses.rotation[:1], poses.translation[:1])[0]
    found = np.concatenate(list(noisy_images(setup, 0)))
    np.testing.assert_array_equal(found, np.broadcast_to(taken, found.shape))
    assert (
        np.abs(taken - project(pentagon.xyz, poses.rotation[:1], poses.translation[:1], PAPER_CAMERA.matrix)).max() > 1
    )
    for errors in run_trials(setup, range(3)):
        # As exact as without a lens, see above.
        assert np.sqrt(errors["dlt"].he_px2).max() < 1e-5
        assert errors["lm"].rotation_deg.max() < 1e-5
        assert errors["ippe"].rotation_deg.max() < 1e-5
