import numpy as np
import pytest
from scipy.optimize import least_squares

from markergen.maths.conics import _rotation, fitted_centers, outlines, pose_rows, refine_poses
from markergen.maths.distortion import distortion_hessian
from markergen.maths.information import pose_jacobian
from markergen.maths.projection import circle_image, plane_homography
from markergen.maths.rotation import angle_between, exponential
from markergen.model.camera import Camera, Distortion
from markergen.model.poses import paper_roll

POSES = paper_roll()
POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (7, 3)) * [1, 1, 0.3]
RADII = np.linspace(0, 0.02, 7)


@pytest.mark.parametrize("index", range(1, 7))
def test_outlines_are_images_of_the_circles_at_their_height(index):
    drawn = outlines(POINTS, RADII, POSES.rotation, POSES.translation)
    origin = POSES.translation + POINTS[index, 2] * POSES.rotation[:, :, 2]
    homography = plane_homography(POSES.rotation, origin, np.eye(3))
    center, semi, _ = circle_image(POINTS[index, :2], RADII[index], homography)
    np.testing.assert_allclose(drawn.center[:, index], center, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(drawn.shape[:, index])[:, ::-1], semi**2, rtol=1e-6, atol=1e-14)
    assert drawn.seen.all()


def test_bare_points_have_no_offset():
    drawn = outlines(POINTS, RADII, POSES.rotation, POSES.translation)
    np.testing.assert_allclose(drawn.center[:, 0], drawn.point[:, 0], rtol=0, atol=1e-15)
    assert (np.linalg.norm(drawn.center - drawn.point, axis=-1)[:, 1:] > 0).any(axis=0).all()


LENSES = [
    ("radtan", (-0.35, 0.12, 1e-3, 0.0)),
    ("rational", (0.3, 0.1, 0.0, 0.0, 0.02, 0.6, 0.2, 0.03)),
    ("equidistant", (0.02, -0.01, 0.0, 0.0)),
]


@pytest.mark.parametrize("lens", LENSES)
def test_the_fitted_center_is_that_of_the_nearest_ellipse(lens):
    """By all five parameters, and 400 points at distances along the normal, weighted by their arc length."""
    camera = Camera(960, 720, 600.0, 603.0, 475.0, 362.0, Distortion(*lens))
    around = 2 * np.pi * np.arange(400) / 400
    circle = np.stack([np.cos(around), np.sin(around)], axis=-1)
    for center, axes in (([0.4, 0.2], [[0.08, 0.0], [0.02, 0.05]]), ([-0.3, 0.5], [[0.03, 0.01], [-0.04, 0.05]])):
        image = camera.to_pixels(center + circle @ np.transpose(axes))
        arc = np.linalg.norm(np.roll(image, -1, axis=0) - np.roll(image, 1, axis=0), axis=-1)

        def distances(state, image=image, arc=arc):
            mapped = (image - state[:2]) @ [[state[2], state[3]], [state[3], state[4]]]
            rho = np.linalg.norm(mapped, axis=-1)
            gradient = mapped / rho[:, None] @ [[state[2], state[3]], [state[3], state[4]]]
            return (rho - 1) / np.linalg.norm(gradient, axis=-1) * np.sqrt(arc)

        start = [*image.mean(axis=0), 0.03, 0.0, 0.03]
        fitted = least_squares(distances, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x[:2]
        center, shape = np.array(center), np.array(axes) @ np.transpose(axes)
        assert np.linalg.norm(fitted - camera.to_pixels(center)) > 0.1
        np.testing.assert_allclose(camera.dot_centers(center, shape), fitted, rtol=0, atol=1e-3)


def test_the_fitted_center_of_a_small_circle_and_of_a_point():
    camera = Camera(960, 720, 600.0, 600.0, 475.0, 362.0, Distortion("radtan", (-0.35, 0.12, 0.0, 0.0)))
    center, radius = np.array([0.3, -0.2]), 0.005
    hessian = 600 * distortion_hessian("radtan", center, camera.distortion.coefficients)
    offset = 3 / 8 * radius**2 * np.trace(hessian, axis1=-2, axis2=-1)
    # The lens stretches the circle by a few percent.
    moved = camera.dot_centers(center, radius**2 * np.eye(2)) - camera.to_pixels(center)
    np.testing.assert_allclose(moved, offset, rtol=0.03)
    np.testing.assert_allclose(camera.dot_centers(center, np.zeros((2, 2))), camera.to_pixels(center), atol=1e-9)
    np.testing.assert_allclose(fitted_centers(center, radius**2 * np.eye(2), lambda x: 7 * x), 7 * center, atol=1e-12)


def test_what_turns_away_or_is_behind_is_not_seen():
    rotation, translation = POSES.rotation[:1], POSES.translation[:1]
    assert not outlines(POINTS, RADII, rotation @ np.diag([1, -1, -1.0]), translation).seen.any()
    assert not outlines(POINTS, RADII, rotation, -translation).seen.any()
    # A rim that reaches the plane of the camera's center has no ellipse.
    edge_on = exponential(np.array([[np.pi / 2 + 0.01, 0, 0]]))
    assert not outlines(np.zeros((1, 3)), np.array([0.5]), edge_on, np.array([[0, 0, 0.4]])).seen.any()


def test_rows_are_the_jacobian_of_the_pose():
    rows = pose_rows(POINTS, POSES.rotation, POSES.translation)
    expected = pose_jacobian(POINTS, POSES.rotation, POSES.translation, np.ones(2))
    np.testing.assert_allclose(rows.reshape(expected.shape), expected, rtol=0, atol=1e-12)


def test_turn_is_the_exponential():
    vectors = np.concatenate([np.random.default_rng(1).normal(size=(20, 3)), np.zeros((1, 3)), [[1e-9, 0, 0]]])
    np.testing.assert_allclose(_rotation(vectors), exponential(vectors), rtol=0, atol=1e-14)


def test_refinement_comes_back_from_a_few_degrees_and_percent():
    rng = np.random.default_rng(2)
    rotation, translation = POSES.rotation[::5], POSES.translation[::5]
    seen = outlines(POINTS, RADII, rotation, translation).center
    weight = np.broadcast_to(1e8 * np.eye(2), (*seen.shape, 2)).copy()
    # Two dots that are not there do not count, whatever stands in their place.
    weight[:, 2:4] = 0
    seen = seen.copy()
    seen[:, 2:4] = 7.0
    start = exponential(0.05 * rng.normal(size=(80, 3))) @ rotation
    nearby = translation * (1 + 0.03 * rng.normal(size=(80, 1)))
    result, place, chi2 = refine_poses(POINTS, RADII, seen, weight, start, nearby)
    # Steps end at 1e-10 rad.
    assert angle_between(result, rotation).max() < 1e-8
    np.testing.assert_allclose(place, translation, rtol=0, atol=1e-8)
    assert chi2.max() < 1e-10


def test_hopeless_starts_end_without_a_warning():
    rotation = np.stack([np.eye(3), POSES.rotation[0]])
    seen = np.zeros((2, 7, 2))
    weight = np.broadcast_to(np.eye(2), (2, 7, 2, 2))
    _, _, chi2 = refine_poses(POINTS, RADII, seen, weight, rotation, np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert np.isinf(chi2[0])
    assert np.isfinite(chi2[1])
