from dataclasses import replace

import numpy as np
import pytest
from rigs import cube

from markergen.errors import InputError
from markergen.estimators import Correspondences
from markergen.estimators.budget import ErrorSources, pose_budget, spatial_errors
from markergen.estimators.lm import LM
from markergen.maths.information import covariance, information, pose_jacobian
from markergen.maths.projection import project
from markergen.maths.rotation import exponential, logarithm, skew
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.marker import JointCovariance
from markergen.model.rig import Rig

CALIBRATION = np.array([[4.0, 3.0, 0.1, 0.0], [3.0, 4.0, 0.0, 0.1], [0.1, 0.0, 1.0, 0.0], [0.0, 0.1, 0.0, 1.0]])
EXACT = ErrorSources(print_sigma=0.0)


def point_budget(points, rotation, translation, camera, noise_px, sources):
    """Budget for image noise of standard deviation `noise_px` on every image coordinate."""
    return pose_budget(points, rotation, translation, camera, noise_px**2 * np.eye(2), sources)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def spreads(count, n, seed=0):
    """Image covariances (count, n, 2, 2) px^2 with axes from 0.003 to 0.06 px."""
    roots = np.random.default_rng(seed).normal(scale=0.03, size=(count, n, 2, 2)) + 0.01 * np.eye(2)
    return roots @ roots.swapaxes(-1, -2)


def test_a_tenth_of_a_millimeter_outweighs_a_hundredth_of_a_pixel(setting, pentagon):
    poses = setting.poses
    budget = point_budget(pentagon.xyz, poses.rotation, poses.translation, PAPER_CAMERA, 0.01, ErrorSources(1e-4))
    # The order of magnitude that the design of this tool started from: 0.22 deg against 0.035 deg.
    assert rms(budget.rotation_deg["print"]) == pytest.approx(0.22, rel=0.1)
    assert rms(budget.rotation_deg["image"]) == pytest.approx(0.035, rel=0.1)


def test_equal_image_noise_alone_is_the_bound(setting, pentagon):
    poses = setting.poses
    budget = point_budget(pentagon.xyz, poses.rotation, poses.translation, PAPER_CAMERA, 0.3, EXACT)
    bound = 0.09 * covariance(
        information(pose_jacobian(pentagon.xyz, poses.rotation, poses.translation, PAPER_CAMERA.focal))
    )
    np.testing.assert_allclose(budget.image, bound, rtol=1e-6, atol=1e-9 * bound.max())
    np.testing.assert_array_equal(budget.total, budget.image)
    assert not budget.print.any()
    assert not budget.camera.any()


def test_parts_add_up_and_the_common_weights_suit_no_part_best(setting, pentagon):
    poses = setting.poses
    budget = pose_budget(
        pentagon.xyz, poses.rotation, poses.translation, PAPER_CAMERA, spreads(400, 5), ErrorSources(1e-4, CALIBRATION)
    )
    np.testing.assert_array_equal(budget.total, budget.image + budget.print + budget.camera)
    # No smaller than for each source alone, whose weights would suit it better (to rounding, of covariances that
    # are conditioned like 1e6).
    alone = pose_budget(
        pentagon.xyz, poses.rotation, poses.translation, PAPER_CAMERA, spreads(400, 5), ErrorSources(0.0)
    )
    assert np.all(budget.rotation_deg["image"] >= alone.rotation_deg["image"] * (1 - 1e-6))


@pytest.mark.parametrize(("index", "relief"), [(3, 0.0), (170, 0.02), (399, 0.0)])
def test_sampled_estimates_scatter_as_predicted(setting, pentagon, index, relief):
    points = pentagon.xyz + relief * np.array([[0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0.5]])
    R, t = setting.poses.rotation[[index]], setting.poses.translation[[index]]
    spread = spreads(1, 5, seed=index)
    budget = pose_budget(points, R, t, PAPER_CAMERA, spread, ErrorSources(1e-4, CALIBRATION * 1e-2))
    rng, trials = np.random.default_rng(index), 1000
    roots = np.linalg.cholesky(spread[0])
    axes = np.array([1, 1, 1 if relief else 0])
    errors = np.empty((trials, 6))
    weight = _weights(points, R, t, spread, 1e-4 * axes)
    for trial in range(trials):
        true = PAPER_CAMERA.matrix
        fx, fy, cx, cy = rng.multivariate_normal(true[[0, 1, 0, 1], [0, 1, 2, 2]], CALIBRATION * 1e-2)
        printed = points + 1e-4 * axes * rng.normal(size=points.shape)
        seen = project(printed, R, t, Camera(640, 480, fx, fy, cx, cy).matrix)[0]
        seen = seen + (roots @ rng.normal(size=(5, 2, 1)))[..., 0]
        rotation, translation = _weighted_pose(points, seen, R, t, weight)
        errors[trial, :3] = logarithm(rotation @ R[0].T)
        errors[trial, 3:] = translation - t[0]
    # In coordinates in which the prediction is the unit matrix; 1000 draws know a variance to 4.5 %, five sigma.
    whitened = np.linalg.solve(np.linalg.cholesky(budget.total[0]), errors.T)
    np.testing.assert_allclose(whitened @ whitened.T / trials, np.eye(6), atol=0.22)


def _weights(points, R, t, spread, sigma):
    """Inverse of image and print covariance (10, 10), by differences of the projection."""
    total = np.zeros((10, 10))
    for i in range(5):
        block = spread[0, i].copy()
        for axis in range(3):
            moved = points.copy()
            moved[i, axis] += 1e-6
            change = (project(moved, R, t, PAPER_CAMERA.matrix) - project(points, R, t, PAPER_CAMERA.matrix))[0, i]
            block += np.outer(change, change) * (sigma[axis] / 1e-6) ** 2
        total[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    return np.linalg.inv(total)


def _weighted_pose(points, seen, R, t, weight):
    """Gauss-Newton from the true pose; two steps are enough for errors of a thousandth."""
    rotation, translation = R, t
    for _ in range(2):
        jacobian = pose_jacobian(points, rotation, translation, PAPER_CAMERA.focal)[0]
        residual = (seen - project(points, rotation, translation, PAPER_CAMERA.matrix)[0]).ravel()
        step = np.linalg.solve(jacobian.T @ weight @ jacobian, jacobian.T @ weight @ residual)
        rotation, translation = exponential(step[:3]) @ rotation, translation + step[3:]
    return rotation[0], translation[0]


def test_a_wrong_focal_length_is_a_wrong_distance(setting, pentagon):
    # Frontal and centered, f off by 1 % moves the marker off by 1 % and turns nothing.
    sources = ErrorSources(0.0, np.diag([1.0, 1.0, 0.0, 0.0]) @ np.ones((4, 4)) @ np.diag([8.0, 8.0, 0.0, 0.0]) * 8.0)
    R, t = setting.poses.rotation[:1], setting.poses.translation[:1]
    budget = point_budget(pentagon.xyz, R, t, PAPER_CAMERA, 0.01, sources)
    assert budget.translation_pct(t)["camera"][0] == pytest.approx(1.0, rel=1e-9)
    assert budget.translation["camera"][0] == pytest.approx(0.01 * t[0, 2], rel=1e-9)
    assert budget.rotation_deg["camera"][0] < 1e-6


def test_without_any_error_the_budget_is_zero(setting, pentagon):
    budget = point_budget(
        pentagon.xyz, setting.poses.rotation, setting.poses.translation, PAPER_CAMERA, 0.0, ErrorSources(0.0)
    )
    assert not budget.total.any()


def test_flat_points_may_come_without_height(setting, pentagon):
    flat, spatial = (
        point_budget(points, setting.poses.rotation, setting.poses.translation, PAPER_CAMERA, 0.1, ErrorSources(1e-4))
        for points in (pentagon.xyz[:, :2], pentagon.xyz)
    )
    # The same numbers in another order of summation.
    np.testing.assert_allclose(flat.total, spatial.total, rtol=1e-6, atol=1e-9 * flat.total.max())


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"print_sigma": -1e-4}, "a print error of 0 to 1 m"),
        ({"print_sigma": float("nan")}, "a print error of 0 to 1 m"),
        ({"camera_covariance": np.ones(4)}, "shape"),
        ({"camera_covariance": np.full((4, 4), np.inf)}, "not finite"),
        ({"camera_covariance": np.array([[1.0, 0.5], [0.1, 1.0]])}, "not symmetric"),
        ({"camera_covariance": np.array([[1.0, 2.0], [2.0, 1.0]])}, "negative variance"),
        ({"camera_covariance": np.diag([1.0, -1.0])}, "negative variance"),
    ],
)
def test_unfit_sources_are_refused(values, phrase):
    with pytest.raises(InputError, match=phrase):
        ErrorSources(**values)


def test_a_covariance_of_other_parameters_is_refused(setting, pentagon):
    with pytest.raises(InputError, match="4 parameters, found 5 rows"):
        point_budget(
            pentagon.xyz, setting.poses.rotation[:1], setting.poses.translation[:1], PAPER_CAMERA, 0.1,
            ErrorSources(1e-4, np.eye(5)),
        )  # fmt: skip


def test_a_wrong_scale_moves_the_pose_as_estimates_from_scaled_points_say(setting, pentagon):
    chosen = setting.poses.taken(np.array([30, 170, 399]), 0)
    sigma, xy = 1e-3, pentagon.xyz[:, :2]
    budget, exact = (
        point_budget(xy, chosen.rotation, chosen.translation, PAPER_CAMERA, 0.1, ErrorSources(0.0, scale_sigma=scale))
        for scale in (sigma, 0.0)
    )
    expected = np.zeros((3, 6, 6))
    for scaled in ([1 + 1e-5, 1], [1, 1 + 1e-5]):
        images = project(xy * scaled, chosen.rotation, chosen.translation, PAPER_CAMERA.matrix)
        rotation, translation = LM.solve(Correspondences(xy, images, PAPER_CAMERA)).best
        rotated = logarithm(rotation @ chosen.rotation.swapaxes(-1, -2))
        step = np.concatenate([rotated, translation - chosen.translation], axis=-1) / 1e-5
        expected += sigma**2 * step[:, :, None] * step[:, None, :]
    # Differences of 1e-5 are good to 1e-4 of the largest entry.
    np.testing.assert_allclose(budget.print, expected, atol=1e-3 * np.abs(expected).max())
    np.testing.assert_allclose(budget.total - exact.total, budget.print, atol=1e-9 * np.abs(expected).max())
    # A scale along both axes by s is a distance that is off by s: half of the variance of either.
    assert np.all(budget.translation["print"] >= sigma / np.sqrt(2) * chosen.distance * 0.999)
    with pytest.raises(InputError, match=r"0\.001 is 0\.1 %"):
        ErrorSources(scale_sigma=0.5)


def test_errors_of_places_and_of_the_relation_are_those_of_samples():
    rng, body = np.random.default_rng(6), cube()
    matrix = 1e-10 * np.eye(12) + 4e-11
    joint = JointCovariance(tuple(range(6)), "xy", tuple(map(tuple, matrix)))
    measured = replace(body.markers[2], marker=replace(body.markers[2].marker, joint_covariance=joint))
    root = np.kron(np.eye(6), np.diag([1e-3] * 3 + [1e-4] * 3)) @ rng.standard_normal((36, 36))
    rig = Rig((*body.markers[:2], measured, *body.markers[3:]), tuple(map(tuple, root @ root.T)))
    dots, facing = np.array([0, 3, 12, 13, 17]), rig.plates[2]
    sources = spatial_errors(rig, dots, facing.rotation_matrix, ErrorSources(print_sigma=5e-5))
    samples = []
    for _ in range(5_000):
        step, printed = root @ rng.standard_normal(36), np.linalg.cholesky(matrix) @ rng.standard_normal(12)
        moved = []
        for dot in dots:
            owner = rig.owner[dot]
            plate, number = rig.plates[owner], dot - rig.first[owner]
            place, motion = plate.marker.xyz[number].copy(), step[6 * owner : 6 * owner + 6]
            place[:2] += printed[2 * number : 2 * number + 2] if owner == 2 else 5e-5 * rng.standard_normal(2)
            rotated = (np.eye(3) + skew(motion[:3])) @ plate.rotation_matrix @ place
            moved.append(facing.to_marker(rotated + plate.translation_vector + motion[3:]))
        samples.append(np.ravel(moved))
    expected = sources.whole(len(dots), 3)
    sigma = np.sqrt(np.diag(expected))
    # A correlation of 5,000 samples has a standard deviation of at most 0.014, and a variance of 0.02.
    assert np.cov(np.array(samples).T) / np.outer(sigma, sigma) == pytest.approx(
        expected / np.outer(sigma, sigma), abs=0.08
    )
