import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.maths.conic import center_offset, circle_conic, circle_image, ellipse_of_conic
from markergen.maths.projection import apply_homography, plane_homography
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper

POSES = paper()
HOMOGRAPHY = plane_homography(POSES.rotation, POSES.translation, PAPER_CAMERA.matrix)


def test_circle_is_its_own_ellipse():
    center, semi, _ = ellipse_of_conic(circle_conic(np.array([1.0, -2.0]), 3.0))
    np.testing.assert_allclose(center, [1, -2], atol=1e-14)
    np.testing.assert_allclose(semi, [3, 3], atol=1e-14)


@given(st.integers(0, 399), st.floats(-0.13, 0.13), st.floats(-0.13, 0.13), st.floats(0.002, 0.02))
def test_the_ellipse_goes_through_the_imaged_circle(index, x, y, radius):
    center, semi, angle = circle_image(np.array([x, y]), radius, HOMOGRAPHY[index])
    phase = np.linspace(0, 2 * np.pi, 24)
    rim = np.array([x, y]) + radius * np.stack([np.cos(phase), np.sin(phase)], -1)
    seen = apply_homography(HOMOGRAPHY[index], rim) - center
    along = seen @ [np.cos(angle), np.sin(angle)]
    across = seen @ [-np.sin(angle), np.cos(angle)]
    # The conic in px has entries from 1e-7 to 1; its determinant loses about as many digits.
    np.testing.assert_allclose((along / semi[0]) ** 2 + (across / semi[1]) ** 2, 1, atol=1e-6)
    assert semi[0] >= semi[1] * (1 - 1e-9)


def test_center_offset_is_the_closed_form():
    # Tilted by p at distance d and on the axis: along the tilt the rim's two extreme points are at
    # f (d cos p -+ ...): x = f r cos p / (d -+ r sin p), whose middle is f r^2 sin p cos p / (d^2 - r^2 sin^2 p).
    tilt, distance, radius = np.deg2rad(70), 0.6, 0.018
    index = np.flatnonzero((np.abs(POSES.polar_angle_deg - 70) < 1e-6) & np.isclose(POSES.translation[:, 2], 0.6))
    offset = center_offset(np.zeros(2), radius, HOMOGRAPHY[index[0]])
    expected = 800 * radius**2 * np.sin(tilt) * np.cos(tilt) / (distance**2 - (radius * np.sin(tilt)) ** 2)
    assert np.linalg.norm(offset) == pytest.approx(expected, rel=1e-5)
    # A tenth of a pixel and more at close range: what a detector that ignores this is wrong by.
    assert expected > 0.2


def test_a_circle_across_the_horizon_is_no_ellipse():
    homography = np.array([[1.0, 0, 0], [0, 1, 0], [0, 1, 1]])
    assert np.all(np.isnan(circle_image(np.array([0.0, -1.0]), 0.5, homography)[1]))
