import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from markergen.maths.rotation import (
    angle_between,
    exponential,
    logarithm,
    rigid_motion,
    rotation_z,
    scaled_motion,
    skew,
)

vectors = arrays(float, (4, 3), elements=st.floats(-1.7, 1.7))


@given(vectors)
def test_exponential_agrees_with_scipy(v):
    np.testing.assert_allclose(exponential(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-14)


@given(vectors)
def test_logarithm_undoes_the_exponential(v):
    np.testing.assert_allclose(exponential(logarithm(exponential(v))), exponential(v), atol=1e-12)


@given(arrays(float, 3, elements=st.floats(-5, 5)), arrays(float, 3, elements=st.floats(-5, 5)))
def test_skew_is_the_cross_product(v, w):
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, np.pi - 1e-6, np.pi])
def test_angles_keep_their_digits(angle):
    axis = np.array([1.0, -2.0, 2.0]) / 3
    base = exponential(np.array([0.3, 0.2, -0.9]))
    # Near 180 degrees the arcsine's slope costs half the digits; elsewhere the error is of rounding.
    tolerance = 1e-15 if angle < 0.1 else 2e-8
    assert angle_between(base, exponential(angle * axis) @ base) == pytest.approx(angle, abs=tolerance)


def test_angles_of_nothing_are_nan():
    assert np.isnan(angle_between(np.full((3, 3), np.nan), np.eye(3)))


def test_rotation_z_takes_x_to_y():
    np.testing.assert_allclose(rotation_z(np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


RNG = np.random.default_rng(5)
POINTS = RNG.normal(size=(6, 2))


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, np.pi, -1.5])
@pytest.mark.parametrize("mirror", [False, True])
def test_motions_are_found(angle, mirror):
    rotation = turn(angle) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    result, offset = rigid_motion(POINTS, POINTS @ rotation.T + [3, -2], mirror)
    np.testing.assert_allclose(result, rotation, atol=1e-13)
    np.testing.assert_allclose(offset, [3, -2], atol=1e-13)
    result, scale, offset = scaled_motion(POINTS, POINTS * [0.99, 1.02] @ rotation.T + [3, -2], mirror)
    np.testing.assert_allclose(result, rotation, atol=1e-12)
    np.testing.assert_allclose(scale, [0.99, 1.02], atol=1e-12)
    np.testing.assert_allclose(offset, [3, -2], atol=1e-12)


def test_of_noisy_points_it_is_the_least_squares():
    target = POINTS @ turn(0.4).T + 0.1 * RNG.normal(size=POINTS.shape)
    rotation, offset = rigid_motion(POINTS, target)

    def cost(angle, x, y):
        return np.sum((POINTS @ turn(angle).T + [x, y] - target) ** 2)

    best = np.array([np.arctan2(rotation[1, 0], rotation[0, 0]), *offset])
    for step in np.concatenate([np.eye(3), -np.eye(3)]) * 1e-3:
        assert cost(*best) < cost(*(best + step))


def test_batches_are_each_by_itself():
    many = RNG.normal(size=(4, 5, 2))
    rotation, offset = rigid_motion(many, many[::-1])
    for k in range(4):
        one = rigid_motion(many[k], many[::-1][k])
        np.testing.assert_allclose(rotation[k], one[0], atol=1e-14)
        np.testing.assert_allclose(offset[k], one[1], atol=1e-14)


def test_degenerate_points():
    same = np.ones((3, 2))
    rotation, offset = rigid_motion(same, 2 * same)
    np.testing.assert_array_equal(rotation, np.eye(2))
    np.testing.assert_array_equal(offset, [1, 1])
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    assert np.isnan(scaled_motion(line, line)[1]).all()
