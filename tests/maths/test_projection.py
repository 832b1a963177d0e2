import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from markergen.maths.projection import apply_homography, from_pixels, plane_homography, project, to_pixels
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll

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
