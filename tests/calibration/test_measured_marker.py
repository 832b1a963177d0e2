"""A marker measured by photographs: its joint covariance reaches every pose and every error budget."""

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated_photos import CAMERA, hand_held, nees, scene

from markergen.api.validate import validate
from markergen.calibration.adjustment import adjust
from markergen.detect import Detector
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.estimators.weighted_pose import estimate_pose
from markergen.maths.rotation import logarithm
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.marker import Marker, build_marker
from markergen.model.rescale import MeasuredDot, Rulers, photographed, remeasure, rescale_body
from markergen.render import Optics, render_view
from markergen.validation.print_error import displaced, displacement

PAPER = ErrorSources()


@pytest.fixture(scope="module")
def measured():
    """A marker of six dots as measured by eight photographs, and its true places in the same frame."""
    made = scene(6, 8, np.random.default_rng(7), sigma=0.1)
    adjustment = adjust(made.network, made.views)
    designed = build_marker(made.network.design[:, :2], Circle(0.14), 0.03, 0.002)
    return photographed(designed, range(6), adjustment.places, adjustment.unscaled, {"photographs": 8})


def test_a_measured_marker_keeps_its_design_and_survives_a_file(measured):
    assert measured.xyz[:, 2].any()
    np.testing.assert_array_equal(measured.as_designed.xyz[:, 2], 0)
    assert Marker.load(json.loads(to_json(measured))) == measured
    assert measured.as_designed.joint_covariance is None
    assert measured.provenance["print"]["photographs"] == {"photographs": 8}


def test_dots_that_no_photograph_measured_keep_their_places(measured):
    order = (4, 1, 2)
    rows = np.add.outer(3 * np.array(order), np.arange(3)).ravel()
    joint = measured.joint_covariance.array[np.ix_(rows, rows)]
    designed = measured.as_designed
    part = photographed(designed, order, measured.xyz[list(order)], joint, {})
    np.testing.assert_array_equal(part.xyz[[0, 3, 5]], designed.xyz[[0, 3, 5]])
    blocks = PAPER.of(part).place_blocks(part.xyz, 3)
    np.testing.assert_allclose(blocks[4], joint[:3, :3])
    np.testing.assert_allclose(blocks[3], 1e-8 * np.eye(3))
    whole = PAPER.of(part, np.array([1, 3, 4])).whole(3, 3)
    np.testing.assert_allclose(whole[6:, :3], joint[:3, 3:6])
    np.testing.assert_allclose(whole[3:6], np.pad(1e-8 * np.eye(3), ((0, 0), (3, 3))))


def test_sampled_prints_have_the_joint_covariance(measured):
    """20,000 prints: a variance is known to 1 %, a correlation to 0.7 %."""
    drawn = displacement(measured, PAPER, np.random.default_rng(0), prints=(20_000,)).reshape(20_000, -1)
    joint = measured.joint_covariance.array
    scale = np.sqrt(np.diag(joint))
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(scale, scale), joint / np.outer(scale, scale), atol=0.05)


def test_the_pose_covariance_is_true(measured):
    """NEES of 100 poses of prints drawn from the joint covariance: 6 degrees each, so 1 +- 0.058 at one sigma."""
    rng, sigma, result = np.random.default_rng(1), 0.05, []
    count = 100
    prints = measured.xyz + displacement(measured, PAPER, rng, prints=(count,))
    rotation, translation = hand_held(count, rng, (20, 60))
    spread = np.broadcast_to(sigma**2 * np.eye(2), (6, 2, 2))
    for k in range(count):
        pixels = CAMERA.project(prints[k], rotation[[k]], translation[[k]])[0]
        pixels += rng.normal(0, sigma, pixels.shape)
        pose = estimate_pose(measured.xyz, pixels, spread, CAMERA, PAPER.of(measured))
        error = np.concatenate([logarithm(rotation[k] @ pose.rotation.T), translation[k] - pose.translation])
        result.append(nees(error, pose.budget.total / pose.scale))
    assert np.mean(result) == pytest.approx(1, abs=4 * np.sqrt(2 / (6 * count)) + 0.02)


def test_the_budget_is_that_of_the_pose(measured):
    rotation, translation = hand_held(1, np.random.default_rng(3))
    pixels = CAMERA.project(measured.xyz, rotation, translation)[0]
    spread = np.broadcast_to(0.01 * np.eye(2), (6, 2, 2))
    pose = estimate_pose(measured.xyz, pixels, spread, CAMERA, PAPER.of(measured))
    budget = pose_budget(measured.xyz, rotation, translation, CAMERA, 0.01 * np.eye(2), PAPER.of(measured))
    np.testing.assert_allclose(budget.print[0], pose.budget.print, rtol=1e-4)


def test_a_common_error_is_not_averaged_away(measured):
    """Dots that all move by the same 0.1 mm move the pose by it, however many they are."""
    together = np.tile(np.diag([1e-8, 0, 0]), (6, 6)) + 1e-14 * np.eye(18)
    joined = photographed(measured.as_designed, range(6), measured.xyz, together, {})
    rotation, translation = np.diag([1.0, -1.0, -1.0])[None], np.array([[0, 0, 0.5]])
    budget = pose_budget(joined.xyz, rotation, translation, CAMERA, 1e-4 * np.eye(2), PAPER.of(joined))
    assert np.sqrt(budget.print[0, 3, 3]) == pytest.approx(1e-4, rel=1e-3)


def grown(measured, share):
    """The same measured marker, with a standard deviation of its scale."""
    away = share * (measured.xyz - measured.xyz.mean(axis=0)).ravel()
    covariance = measured.joint_covariance.array + np.outer(away, away)
    return photographed(measured.as_designed, range(6), measured.xyz, covariance, {})


def test_an_unknown_scale_makes_distances_unsure_and_changes_no_pose(measured):
    rng, unsure = np.random.default_rng(4), grown(measured, 0.01)
    rotation, translation = hand_held(1, rng, (30, 31))
    pixels = CAMERA.project(measured.xyz, rotation, translation)[0] + rng.normal(0, 0.1, (6, 2))
    stated = measured.xyz, pixels, np.broadcast_to(0.01 * np.eye(2), (6, 2, 2)), CAMERA
    sure, result = (estimate_pose(*stated, PAPER.of(item)) for item in (measured, unsure))
    apart = [logarithm(result.rotation @ sure.rotation.T), result.translation - sure.translation]
    sigma = np.sqrt(np.diag(sure.budget.total))
    assert (np.abs(np.concatenate(apart)) < 0.1 * sigma).all()
    angle, away = (np.sqrt(np.trace(result.budget.print[part, part])) for part in (slice(3), slice(3, 6)))
    assert away == pytest.approx(0.01 * np.linalg.norm(result.translation), rel=0.05)
    assert angle < 1.1 * np.sqrt(np.trace(sure.budget.print[:3, :3]))


def test_the_scale_is_no_error_of_single_dots_but_one_of_all(measured):
    sure, unsure = (PAPER.of(item) for item in (measured, grown(measured, 0.01)))
    away = (measured.xyz - measured.xyz.mean(axis=0)).ravel()
    added = unsure.whole(6, 3) - sure.whole(6, 3)
    np.testing.assert_allclose(added, 1e-4 * np.outer(away, away), atol=1e-12)
    ours, all_of_it = unsure.place_blocks(measured.xyz, 3), 1e-4 * np.mean(away**2)
    assert np.abs(ours - sure.place_blocks(measured.xyz, 3)).max() < 0.01 * all_of_it


def test_a_bent_print_is_found_as_the_flat_marker_that_it_is(measured):
    """Its labels, homography and second pose are those of a flat marker; its pose uses the heights."""
    bent = displaced(measured, np.column_stack([np.zeros((6, 2)), 1e-3 * (measured.xyz[:, 0] / 0.11) ** 2]))
    rotation, translation = hand_held(1, np.random.default_rng(12), (35, 36))
    frame = render_view(bent, CAMERA, rotation[0], translation[0] * [0.2, 0.2, 1], Optics(), np.random.default_rng(0))
    for camera in (CAMERA, None):
        (finding,) = Detector(bent, camera)(frame)
        assert finding.ok
        assert len(finding.ids) == 6
        assert finding.homography is not None
    errors = []
    for marker in (bent, bent.as_designed):
        (finding,) = Detector(marker, CAMERA)(frame)
        errors.append(np.linalg.norm(logarithm(finding.rotation @ rotation[0].T)))
    assert errors[0] < 0.2 * errors[1]


def test_what_measures_it_another_way_says_no(measured):
    dots = tuple(MeasuredDot(k, *measured.xyz[k, :2].tolist()) for k in range(6))
    with pytest.raises(InputError, match="by photographs"):
        remeasure(measured, dots)
    with pytest.raises(InputError, match="one by one"):
        rescale_body(measured, Rulers(0.2, None))


def test_a_camera_of_its_own_keeps_the_image_part(measured):
    rotation, translation = hand_held(4, np.random.default_rng(3))
    exact = pose_budget(
        measured.as_designed.xyz, rotation, translation, CAMERA, 0.01 * np.eye(2), replace(PAPER, print_sigma=0.0)
    )
    budget = pose_budget(measured.xyz, rotation, translation, CAMERA, 0.01 * np.eye(2), PAPER.of(measured))
    assert (budget.rotation_deg["image"] >= 0.99 * exact.rotation_deg["image"]).all()


def test_a_validation_says_that_the_print_was_measured(measured):
    validation = validate(measured, CAMERA, poses="cone:count=20", runs=0, views=0, workers=1)
    assert validation.budget["print_measured"]
    assert "was measured" in str(validation)
    assert "as long as markergen calibrate asks for more" in str(validation)
    assert "0.1 mm" not in str(validation)
    designed = validate(measured.as_designed, CAMERA, poses="cone:count=20", runs=0, views=0, workers=1)
    assert "good to 0.1 mm" in str(designed)
