import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.maths.dlt import condition, condition_and_gradient, dlt_matrix, estimate_homography, normal_matrix
from markergen.maths.projection import apply_homography, plane_homography, project
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper

seeds = st.integers(0, 2**32 - 1)


def sets(seed, n=6, batch=5):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (batch, n, 2)), rng.uniform(-1, 1, (batch, n, 2))


def test_rows_are_the_papers():
    row_y, row_x = dlt_matrix(np.array([[2.0, 3.0]]), np.array([[5.0, 7.0]]))
    np.testing.assert_array_equal(row_y, [0, 0, 0, -2, -3, -1, 14, 21, 7])
    np.testing.assert_array_equal(row_x, [2, 3, 1, 0, 0, 0, -10, -15, -5])


@given(seeds)
def test_true_homography_is_in_the_null_space(seed):
    rng = np.random.default_rng(seed)
    h = np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))
    points = rng.uniform(-1, 1, (5, 2))
    np.testing.assert_allclose(dlt_matrix(points, apply_homography(h, points)) @ h.ravel(), 0, atol=1e-13)


@given(seeds)
def test_condition_is_that_of_the_singular_values(seed):
    object_points, image_points = sets(seed)
    singular = np.linalg.svd(dlt_matrix(object_points, image_points), compute_uv=False)
    # A'A squares the condition number, so its rounding does too.
    tolerance = 20 * np.finfo(float).eps * (singular[:, 0] / singular[:, 7]) ** 2
    assert np.all(np.abs(condition(object_points, image_points) * singular[:, 7] / singular[:, 0] - 1) < tolerance)


@given(seeds)
def test_moments_give_the_normal_matrix(seed):
    object_points, image_points = sets(seed)
    matrix = dlt_matrix(object_points, image_points)
    lower = np.tril(np.ones((9, 9), bool))
    expected = matrix.swapaxes(-1, -2) @ matrix
    np.testing.assert_allclose(normal_matrix(object_points, image_points)[:, lower], expected[:, lower], atol=1e-12)


def test_degenerate_points_have_no_condition():
    line = np.stack([np.linspace(-1, 1, 5), np.zeros(5)], -1)
    assert condition(line, line) == np.inf
    assert condition(line[:3], line[:3]) == np.inf


@given(seeds, st.sampled_from([0.0, 0.01, 0.2]))
def test_gradient_agrees_with_differences(seed, softness):
    object_points, image_points = sets(seed)
    value, by_object, by_image = condition_and_gradient(object_points, image_points, softness)
    rng = np.random.default_rng(seed + 1)
    along_object, along_image = rng.normal(size=(2, *object_points.shape))
    step = 1e-6

    def log_at(h):
        return np.log(condition(object_points + h * along_object, image_points + h * along_image, softness))

    numeric = (log_at(step) - log_at(-step)) / (2 * step)
    exact = np.sum(by_object * along_object + by_image * along_image, axis=(1, 2))
    # Differences are good to step^2 times a third derivative, which grows with the condition number.
    usable = value < 300
    np.testing.assert_allclose(
        exact[usable], numeric[usable], rtol=2e-4, atol=2e-4 * max(1, value[usable].max(initial=1))
    )


def square(rotation=0.0):
    angle = rotation + np.pi / 2 * np.arange(4)
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def test_at_coincident_singular_values_the_gradient_is_a_subgradient():
    # A frontal unit square: s7 = s8. Locally c is a maximum of smooth functions, so along any direction d its one-sided
    # slope is at least <g, d> for every subgradient g, and -(slope along -d) is at most that.
    points = square()
    singular = np.linalg.svd(dlt_matrix(points, points), compute_uv=False)
    assert singular[6] == pytest.approx(singular[7], rel=1e-12)
    value, by_object, by_image = condition_and_gradient(points, points)
    assert np.all(np.isfinite(by_object))
    assert np.all(np.isfinite(by_image))
    rng = np.random.default_rng(0)
    nonsmooth = 0
    for _ in range(50):
        along = rng.normal(size=(2, 4, 2))
        step = 1e-6
        slopes = [
            (np.log(condition(points + h * along[0], points + h * along[1])) - np.log(value)) / step
            for h in (step, -step)
        ]
        claimed = np.sum(by_object * along[0] + by_image * along[1])
        # Second-order terms over a step of 1e-6 are below 1e-4.
        assert slopes[0] >= claimed - 1e-4
        assert slopes[1] >= -claimed - 1e-4
        nonsmooth += slopes[0] + slopes[1] > 1e-2
    assert nonsmooth > 25


def test_softened_gradient_is_exact_at_coincident_singular_values():
    points = square(0.3)
    _, by_object, by_image = condition_and_gradient(points, points, 0.05)
    along = np.random.default_rng(1).normal(size=(2, 4, 2))
    # The softened function bends within the spread of the singular values, so a small step is needed.
    step = 1e-6
    ahead, behind = (np.log(condition(points + h * along[0], points + h * along[1], 0.05)) for h in (step, -step))
    assert np.sum(by_object * along[0] + by_image * along[1]) == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)


@given(seeds)
def test_softened_value_bounds_the_true_one_from_above(seed):
    object_points, image_points = sets(seed)
    true, soft = (condition(object_points, image_points, s) for s in (0.0, 0.05))
    assert np.all(soft >= true * (1 - 1e-12))
    assert np.all(soft <= true * 8 ** (0.05 / 2) * (1 + 1e-12))


@pytest.mark.parametrize("n", [4, 5, 12])
def test_noise_free_homography_is_exact(n):
    poses = paper()
    points = np.random.default_rng(n).uniform(-0.12, 0.12, (n, 2))
    truth = plane_homography(poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    image = project(points, poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    estimate = estimate_homography(points, image)
    corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    np.testing.assert_allclose(apply_homography(estimate, corners), apply_homography(truth, corners), atol=1e-5)


def test_points_in_one_place_or_not_finite_have_no_homography_and_do_no_harm_to_others():
    object_points = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    image = np.stack([object_points, np.full((5, 2), 0.3), np.full((5, 2), np.nan)])
    with np.errstate(divide="ignore", invalid="ignore"):
        results = estimate_homography(object_points, image)
    np.testing.assert_allclose(results[0], np.eye(3), rtol=0, atol=1e-12)
    assert np.isnan(results[1:]).all()
