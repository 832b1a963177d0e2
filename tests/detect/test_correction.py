import numpy as np
import pytest

from markergen.detect.correction import correct_centers
from markergen.maths.projection import apply_homography, circle_image, plane_homography, project
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll

POSES = paper_roll()
HOMOGRAPHY = plane_homography(POSES.rotation, POSES.translation, PAPER_CAMERA.matrix)


@pytest.mark.parametrize("n", [4, 5, 8])
def test_exact_over_all_poses_without_noise(ngon, n):
    marker = ngon(n)
    points, radii = marker.xyz[:, :2], np.full(n, 0.018)
    truth = project(marker.xyz, POSES.rotation, POSES.translation, PAPER_CAMERA.matrix)
    ellipses = circle_image(points, radii, HOMOGRAPHY[:, None])[0]
    corrected, homography = correct_centers(ellipses, points, radii)
    assert np.abs(ellipses - truth).max() > 0.5
    # What two rounds leave is at most 4e-5 px, a hundredth of the best center's standard deviation.
    np.testing.assert_allclose(corrected, truth, rtol=0, atol=1e-4)
    np.testing.assert_allclose(apply_homography(homography, points), truth, rtol=0, atol=1e-4)


def test_points_without_size_stay(ngon):
    marker = ngon(6)
    truth = project(marker.xyz, POSES.rotation[:5], POSES.translation[:5], PAPER_CAMERA.matrix)
    corrected, _ = correct_centers(truth, marker.xyz[:, :2], np.full(6, 1e-9))
    np.testing.assert_allclose(corrected, truth, rtol=0, atol=1e-9)


def test_three_points_on_a_line_end_without_a_warning():
    points = np.array([[0, 0], [0.1, 0], [0.2, 0], [0, 0.1]])
    correct_centers(apply_homography(HOMOGRAPHY[:1], points), points, np.full(4, 0.01))
