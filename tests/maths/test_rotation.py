import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from markergen.maths.rotation import angle_between, exponential, logarithm, skew, turn_z

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


def test_turn_z_turns_x_to_y():
    np.testing.assert_allclose(turn_z(np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
