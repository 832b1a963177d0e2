import numpy as np
import pytest

from markergen.maths import information as info
from markergen.maths.projection import apply_homography, plane_homography, project
from markergen.maths.rotation import angle_between, exponential
from markergen.objectives.criteria import criteria, regular_polygon

# Regular n-gon on the rim of the paper's disk, its 400 poses, sigma = 1 px.
ROTATION_DEG = {4: 3.1023, 5: 2.7742, 6: 2.5325, 7: 2.3446, 8: 2.1932}
TRANSLATION_PCT = {4: 0.6078, 5: 0.5431, 6: 0.4958, 7: 0.4590, 8: 0.4293}
POSE_MM = {4: 9.6906, 5: 8.6638, 6: 7.9089, 7: 7.3222, 8: 6.8493}
CONDITION = {4: 3.7315, 5: 3.0232, 6: 3.008}


@pytest.mark.parametrize("n", ROTATION_DEG)
def test_reference_values_at_the_regular_polygon(setting, n):
    row = criteria(regular_polygon(n, 0.15)[None], setting)[0]
    assert round(row["rotation_deg"], 4) == ROTATION_DEG[n]
    assert round(row["translation_pct"], 4) == TRANSLATION_PCT[n]
    assert round(row["pose_m"] * 1e3, 4) == POSE_MM[n]
    if n in CONDITION:
        assert row["condition"] == pytest.approx(CONDITION[n], abs=5e-5)


def jacobian_by_differences(function, count, step=1e-6):
    columns = []
    for index in range(count):
        change = np.zeros(count)
        change[index] = step
        columns.append((function(change) - function(-change)).ravel() / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("index", [0, 150, 399])
def test_pose_jacobian_agrees_with_differences(setting, dimension, index):
    points = np.random.default_rng(index).uniform(-0.1, 0.1, (5, dimension))
    rotation, translation = setting.poses.rotation[[index]], setting.poses.translation[[index]]
    matrix = setting.camera.matrix
    numeric = jacobian_by_differences(
        lambda d: project(points, exponential(d[:3]) @ rotation, translation + d[3:], matrix), 6
    )
    exact = info.pose_jacobian(points, rotation, translation, setting.camera.focal)[0]
    np.testing.assert_allclose(exact, numeric, atol=1e-4)


@pytest.mark.parametrize("index", [0, 150, 399])
def test_homography_jacobian_agrees_with_differences(setting, index):
    points = np.random.default_rng(index).uniform(-0.1, 0.1, (5, 2))
    poses, radius = setting.poses, 0.15
    matrix = plane_homography(poses.rotation[[index]], poses.translation[[index]], setting.camera.matrix)[0]
    to_unit = np.diag([1 / radius, 1 / radius, 1])

    def moved(d):
        change = np.eye(3) + np.append(d, 0).reshape(3, 3)
        return apply_homography(matrix @ np.linalg.inv(to_unit) @ change @ to_unit, points)

    exact = info.homography_jacobian(
        points, poses.rotation[[index]], poses.translation[[index]], setting.camera.focal, radius
    )[0]
    np.testing.assert_allclose(exact, jacobian_by_differences(moved, 8), atol=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_pose_pullback_is_the_gradient(setting, dimension):
    rng = np.random.default_rng(3)
    points, along = rng.uniform(-0.1, 0.1, (2, 2, 5, dimension))
    arguments = (setting.poses.rotation, setting.poses.translation, setting.camera.focal)
    cotangent = rng.normal(size=info.pose_jacobian(points, *arguments).shape)
    step = 1e-6
    ahead, behind = (np.sum(cotangent * info.pose_jacobian(points + h * along, *arguments)) for h in (step, -step))
    gradient = info.pose_jacobian_pullback(cotangent, points, *arguments).sum(axis=1)
    assert np.sum(gradient * along) == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_homography_pullback_is_the_gradient(setting):
    rng = np.random.default_rng(4)
    points, along = rng.uniform(-0.1, 0.1, (2, 2, 5, 2))
    arguments = (setting.poses.rotation, setting.poses.translation, setting.camera.focal, 0.15)
    cotangent = rng.normal(size=info.homography_jacobian(points, *arguments).shape)
    step = 1e-6
    ahead, behind = (
        np.sum(cotangent * info.homography_jacobian(points + h * along, *arguments)) for h in (step, -step)
    )
    gradient = info.homography_jacobian_pullback(cotangent, points, *arguments).sum(axis=1)
    assert np.sum(gradient * along) == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_displacement_weight_is_the_mean_square_displacement(setting):
    rng = np.random.default_rng(5)
    rim = rng.normal(size=(40, 2)) + [0.3, -0.1]
    rotation = setting.poses.rotation[:3]
    weight = info.displacement_weight(rim, rotation)
    twist = rng.normal(size=6)
    moved = np.cross(twist[:3], np.einsum("pij,bj->pbi", rotation[:, :, :2], rim)) + twist[3:]
    expected = np.mean(np.sum(moved**2, axis=-1), axis=-1)
    np.testing.assert_allclose(np.einsum("i,pij,j->p", twist, weight, twist), expected, rtol=1e-12)


def test_what_is_singular_but_for_rounding_has_infinite_covariance():
    rows = np.random.default_rng(0).normal(size=(200, 5, 6))
    every = info.covariance(rows.swapaxes(-1, -2) @ rows)
    variances = np.diagonal(every, axis1=-2, axis2=-1)
    assert np.all(variances > 0)
    assert np.isinf(every).all(axis=(-2, -1)).sum() > 20
    # Of rounding alone, some come out negative.
    one = next(item for item in rows.swapaxes(-1, -2) @ rows if np.linalg.det(item) < 0)
    assert np.linalg.inv(one).diagonal().min() < 0
    assert np.all(np.isinf(info.covariance(one)))


def test_a_layout_that_determines_nothing_has_infinite_covariance():
    matrices = np.stack([np.eye(6), np.diag([1.0, 1, 1, 1, 1, 0]), np.full((6, 6), np.nan)])
    covariance = info.covariance(matrices)
    np.testing.assert_array_equal(covariance[0], np.eye(6))
    assert np.all(np.isinf(covariance[1:]))


def test_mirrored_pose_reflects_the_normal_about_the_line_of_sight(setting):
    poses = setting.poses
    mirrored = info.mirrored_rotation(poses.rotation, poses.translation)
    np.testing.assert_allclose(
        mirrored @ mirrored.swapaxes(-1, -2), np.broadcast_to(np.eye(3), mirrored.shape), atol=1e-12
    )
    sight = poses.translation / np.linalg.norm(poses.translation, axis=-1, keepdims=True)
    normal, image = poses.rotation[:, :, 2], mirrored[:, :, 2]
    np.testing.assert_allclose(np.sum(normal * sight, -1), np.sum(image * sight, -1), atol=1e-12)
    np.testing.assert_allclose(normal + image, 2 * sight * np.sum(normal * sight, -1)[:, None], atol=1e-12)
    # The two normals lie in one plane with the line of sight, twice the polar angle apart.
    np.testing.assert_allclose(
        np.rad2deg(angle_between(poses.rotation, mirrored)), np.minimum(2 * poses.polar_angle_deg, 180), atol=1e-5
    )


def test_smallest_rotation_takes_one_vector_to_the_other():
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=(2, 30, 3))
    a, b = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (a, b))
    rotation = info.smallest_rotation(a, b)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", rotation, a), b, atol=1e-12)
    np.testing.assert_allclose(angle_between(rotation, np.eye(3)), np.arccos(np.sum(a * b, -1)), atol=1e-7)
