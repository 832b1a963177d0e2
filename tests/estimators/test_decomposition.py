import numpy as np

from markergen.estimators.decomposition import decompose_homography
from markergen.maths.projection import plane_homography
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll


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
