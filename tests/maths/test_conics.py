import numpy as np
import pytest

from markergen.maths.conics import _turn, outlines, pose_rows, refine_poses
from markergen.maths.information import pose_jacobian
from markergen.maths.projection import circle_image, plane_homography
from markergen.maths.rotation import angle_between, exponential
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
    np.testing.assert_allclose(_turn(vectors), exponential(vectors), rtol=0, atol=1e-14)


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
    near = translation * (1 + 0.03 * rng.normal(size=(80, 1)))
    found, place, chi2 = refine_poses(POINTS, RADII, seen, weight, start, near)
    # Steps end at 1e-10 rad.
    assert angle_between(found, rotation).max() < 1e-8
    np.testing.assert_allclose(place, translation, rtol=0, atol=1e-8)
    assert chi2.max() < 1e-10


def test_hopeless_starts_end_without_a_warning():
    rotation = np.stack([np.eye(3), POSES.rotation[0]])
    seen = np.zeros((2, 7, 2))
    weight = np.broadcast_to(np.eye(2), (2, 7, 2, 2))
    _, _, chi2 = refine_poses(POINTS, RADII, seen, weight, rotation, np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert np.isinf(chi2[0])
    assert np.isfinite(chi2[1])
