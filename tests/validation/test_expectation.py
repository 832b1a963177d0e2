"""Errors to expect: first order where it holds, and the estimator's own where it does not."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.estimators import ESTIMATORS, Correspondences
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import PAPER_CAMERA, Distortion
from markergen.model.poses import PoseDistribution, paper
from markergen.validation.bounds import budget_of, image_covariance
from markergen.validation.expectation import expect, without_calibration
from markergen.validation.metrics import rms, rotation_error_deg
from markergen.validation.print_error import displacement
from markergen.validation.views import SyntheticViews

POSES = paper()


def series(marker, indices, errors=None, camera=PAPER_CAMERA):
    poses = PoseDistribution("some", POSES.rotation[indices], POSES.translation[indices])
    return SyntheticViews(marker, camera, poses, 0, errors=errors or ErrorSources())


def at(distance, tilt, count=1):
    """Indices of the first poses at a distance and tilt."""
    nearby = np.abs(POSES.distance - distance) < 1e-6
    return np.flatnonzero(nearby & (np.abs(POSES.polar_angle_deg - tilt) < 1e-3))[:count]


def test_where_first_order_holds_it_is_taken_and_sampling_agrees(pentagon):
    chosen = series(pentagon, np.concatenate([at(0.6, 35), at(0.9, 52.5), at(1.2, 70), at(0.6, 0)]))
    result, drawn = expect(chosen), expect(chosen, sample=True)
    budget = budget_of(chosen)
    assert not result.sampled.any()
    assert drawn.sampled.all()
    np.testing.assert_array_equal(result.rotation_deg, budget.rotation_deg["total"])
    np.testing.assert_allclose(result.translation_mm, 1e3 * budget.translation["total"])
    # 500 draws of a chi square of one degree of freedom or more: 3.2 % and less, four times that.
    np.testing.assert_allclose(drawn.rotation_deg, result.rotation_deg, rtol=0.13)
    np.testing.assert_allclose(drawn.translation_mm, result.translation_mm, rtol=0.13)
    for errors in (result, drawn):
        np.testing.assert_allclose(
            np.sqrt(np.mean(errors.drawn_deg**2, axis=1)), budget.rotation_deg["total"], rtol=0.13
        )


def estimated(chosen, count, seed):
    """RE of OpenCV's IPPE and our unweighted LM, the better of both solutions, for errors drawn independently."""
    marker, camera, rng = chosen.marker, chosen.camera, np.random.default_rng(seed)
    rotation, translation = chosen.poses.rotation, chosen.poses.translation
    printed = marker.xyz + displacement(marker, chosen.errors, rng, prints=(count,))
    pixels = np.concatenate([camera.project(item, rotation, translation) for item in printed])
    noise = np.linalg.cholesky(image_covariance(marker, camera, chosen.poses, chosen.optics)[0])
    pixels += (noise @ rng.standard_normal((*pixels.shape, 1)))[..., 0]
    batch = Correspondences.from_distorted(marker.xyz, pixels, camera)
    return rotation_error_deg(batch.once(ESTIMATORS["lm"]).best[0], rotation[0])


@pytest.mark.parametrize(("tilt", "print_sigma"), [(0, 2e-4), (17.5, 3e-4)])
def test_where_it_does_not_hold_the_errors_are_those_of_another_estimator(make_ngon, tilt, print_sigma):
    """A small marker far away, with OpenCV and without weights: frontal and beside it, with flips."""
    marker = make_ngon(5, 0.06, 0.018)
    chosen = series(marker, at(1.5, tilt), ErrorSources(print_sigma))
    result = expect(chosen)
    assert result.sampled.all()
    other = estimated(chosen, 2000, 1)
    draws = np.concatenate([expect(chosen, seed=k).drawn_deg[0] for k in range(4)])
    # Two samples of 2000: the difference of their mean squares within four standard errors.
    error = np.hypot(*(np.std(item**2) / np.sqrt(len(item)) for item in (draws, other)))
    assert abs(np.mean(draws**2) - np.mean(other**2)) < 4 * error
    assert abs(np.mean(other**2) - result.first_order_deg[0] ** 2) > 4 * error
    assert (result.flip_rate[0] > 0) == (tilt > 0)


def test_rare_flips_are_in_the_expected_error_without_being_drawn(make_ngon):
    """Between 1e-6 and 1e-4: too rare to be sampled, and still more than the square of a thousandth of a radian."""
    marker = make_ngon(4, 0.05, 0.015)
    result = expect(series(marker, at(1.2, 17.5, 20)))
    rare = (result.flip_rate > 1e-7) & ~result.sampled
    assert rare.any()
    separation = 35.0
    added = result.rotation_deg[rare] ** 2 - result.first_order_deg[rare] ** 2
    np.testing.assert_allclose(added, result.flip_rate[rare] * separation**2, rtol=0.2)


def test_a_calibration_that_is_off_makes_more_of_other_errors(pentagon):
    """Frontally 2 px of fx and fy apart look like 5 deg of tilt: to first order they would cost nothing."""
    errors = ErrorSources(1e-4, np.diag([2.0, 2.0, 1.5, 1.5]) ** 2)
    off = series(pentagon, at(1.5, 0, 4), errors)
    result, exact = expect(off), expect(without_calibration(off))
    assert result.sampled.all()
    np.testing.assert_allclose(result.first_order_deg, exact.first_order_deg, rtol=0.01)
    assert rms(result.rotation_deg) > 1.5 * rms(exact.rotation_deg)


def test_draws_depend_on_the_seed_and_the_pose_alone(make_ngon):
    marker = make_ngon(4, 0.05, 0.015)
    chosen = series(marker, at(1.5, 0, 3))
    result, again, other = expect(chosen), expect(chosen), expect(chosen, seed=1)
    np.testing.assert_array_equal(result.drawn_deg, again.drawn_deg)
    assert (result.drawn_deg != other.drawn_deg).all()
    calls = []
    expect(chosen, progress=lambda *call: calls.append(call))
    assert calls[-1] == (3, 3)
    np.testing.assert_array_equal(expect(series(marker, at(1.5, 0, 1))).drawn_deg, result.drawn_deg[:1])


def test_through_a_lens_and_with_relief(pentagon):
    """A lens moves points without changing what they tell, where its scale is 1."""
    camera = replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.05, 0.01, 0.0, 0.0)))
    chosen = series(pentagon, at(1.2, 35, 2), camera=camera)
    np.testing.assert_allclose(
        expect(chosen, sample=True).rotation_deg, budget_of(chosen).rotation_deg["total"], rtol=0.13
    )
    raised = replace(
        pentagon,
        control_points=tuple(replace(p, z=0.02 * (i % 2)) for i, p in enumerate(pentagon.control_points)),
    )
    chosen = series(raised, at(1.2, 0, 2))
    np.testing.assert_allclose(
        expect(chosen, sample=True).rotation_deg, budget_of(chosen).rotation_deg["total"], rtol=0.13
    )
