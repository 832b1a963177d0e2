import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.maths.projection import (
    apply_homography,
    center_offset,
    circle_conic,
    circle_image,
    decompose_homography,
    ellipse_of_conic,
    from_pixels,
    plane_homography,
    project,
    to_pixels,
)
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper, paper_roll

POSES = paper_roll()
K = PAPER_CAMERA.matrix


@given(st.integers(0, 399), st.integers(0, 2**32 - 1))
def test_projection_is_opencvs(index, seed):
    points = np.random.default_rng(seed).uniform(-0.15, 0.15, (6, 3))
    ours = project(points, POSES.rotation, POSES.translation, K)[index]
    vector = cv2.Rodrigues(POSES.rotation[index])[0]
    theirs = cv2.projectPoints(points, vector, POSES.translation[index], K, None)[0][:, 0]
    # Rodrigues' vector and back costs OpenCV some digits near half turns.
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_plane_points_need_no_z_and_batches_broadcast():
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (3, 5, 2))
    flat = project(points, POSES.rotation, POSES.translation, K)
    assert flat.shape == (3, 400, 5, 2)
    with_z = project(np.concatenate([points, np.zeros((3, 5, 1))], -1), POSES.rotation, POSES.translation, K)
    np.testing.assert_allclose(flat, with_z, atol=1e-10)
    homography = plane_homography(POSES.rotation, POSES.translation, K)
    np.testing.assert_allclose(apply_homography(homography, points[0]), flat[0], atol=1e-9)


def test_pixels_and_back():
    normalized = np.array([[0.0, 0.0], [0.1, -0.2]])
    np.testing.assert_array_equal(to_pixels(normalized, K)[0], [320, 240])
    np.testing.assert_allclose(from_pixels(to_pixels(normalized, K), K), normalized, atol=1e-15)


PAPER_POSES = paper()
HOMOGRAPHY = plane_homography(PAPER_POSES.rotation, PAPER_POSES.translation, PAPER_CAMERA.matrix)


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
    index = np.flatnonzero(
        (np.abs(PAPER_POSES.polar_angle_deg - 70) < 1e-6) & np.isclose(PAPER_POSES.translation[:, 2], 0.6)
    )
    offset = center_offset(np.zeros(2), radius, HOMOGRAPHY[index[0]])
    expected = 800 * radius**2 * np.sin(tilt) * np.cos(tilt) / (distance**2 - (radius * np.sin(tilt)) ** 2)
    assert np.linalg.norm(offset) == pytest.approx(expected, rel=1e-5)
    # A tenth of a pixel and more at close range: what a detector that ignores this is wrong by.
    assert expected > 0.2


def test_a_circle_across_the_horizon_is_no_ellipse():
    homography = np.array([[1.0, 0, 0], [0, 1, 0], [0, 1, 1]])
    assert np.all(np.isnan(circle_image(np.array([0.0, -1.0]), 0.5, homography)[1]))


def test_inverts_the_homography_of_a_pose_at_any_scale_and_sign():
    poses = paper_roll()
    scale = np.random.default_rng(0).normal(size=(400, 1, 1))
    homography = scale * plane_homography(poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    rotation, translation = decompose_homography(homography, PAPER_CAMERA.matrix)
    # Rounding only: no step of it is worse conditioned than the camera matrix, 1e3.
    assert angle_between(rotation, poses.rotation).max() < 1e-11
    assert np.abs(translation - poses.translation).max() < 1e-11


def test_gives_a_rotation_for_any_homography():
    homography = np.random.default_rng(1).normal(size=(100, 3, 3))
    rotation, translation = decompose_homography(homography, PAPER_CAMERA.matrix)
    assert np.allclose(rotation @ rotation.swapaxes(-1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(rotation), 1)
    assert np.all(translation[:, 2] > 0)


def test_nan_stays_where_it_is():
    poses = paper_roll()
    homography = plane_homography(poses.rotation[:3], poses.translation[:3], PAPER_CAMERA.matrix)
    homography[1, 0, 0] = np.nan
    rotation, translation = decompose_homography(homography, PAPER_CAMERA.matrix)
    assert np.isnan(rotation[1]).all()
    assert np.isnan(translation[1]).all()
    assert np.isfinite(rotation[[0, 2]]).all()
