import numpy as np
import pytest

from markergen.estimators import Correspondences
from markergen.estimators.base import solve_each
from markergen.estimators.ippe import IPPE
from markergen.maths.information import mirrored_rotation
from markergen.maths.projection import project
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper

ANGLES = np.pi / 2 + 2 * np.pi * np.arange(8) / 8
OCTAGON = 0.12 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)


def test_poses_that_opencv_loses_are_found_through_the_homography():
    """OpenCV gives nan for some of the noise-free poses; which ones hangs on rounding, so the loss is made here."""
    poses = paper()
    pixels = project(OCTAGON, poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    batch = Correspondences(OCTAGON, pixels, PAPER_CAMERA)
    result = batch.once(IPPE)
    assert result.rotation.shape == (400, 2, 3, 3)
    assert np.isfinite(result.rotation[:, 0]).all()


def test_a_lost_pose_gets_both_solutions(monkeypatch):
    poses = paper()
    pixels = project(OCTAGON, poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    batch = Correspondences(OCTAGON, pixels, PAPER_CAMERA)

    def losing(batch, method, solutions):
        result = solve_each(batch, method, solutions)
        result.rotation[::2], result.translation[::2] = np.nan, np.nan
        return result

    monkeypatch.setattr("markergen.estimators.ippe.solve_each", losing)
    result = batch.once(IPPE)
    # 1e-5 as for all estimators without noise.
    assert angle_between(result.rotation[:, 0], poses.rotation).max() < 1e-5
    mirrored = mirrored_rotation(poses.rotation, poses.translation)
    assert angle_between(result.rotation[::2, 1], mirrored[::2]).max() < 1e-5


def test_second_solution_is_near_the_mirrored_pose():
    """To first order of the marker's size: within 10 degrees for a marker a fifth of its distance wide."""
    poses = paper()
    steep = (poses.polar_angle_deg > 30) & (poses.translation[:, 2] > 1)
    rotation, translation = poses.rotation[steep], poses.translation[steep]
    pixels = project(OCTAGON, rotation, translation, PAPER_CAMERA.matrix)
    second = Correspondences(OCTAGON, pixels, PAPER_CAMERA).once(IPPE).rotation[:, 1]
    mirrored = mirrored_rotation(rotation, translation)
    assert np.rad2deg(angle_between(second, mirrored)).max() < 10
    assert np.rad2deg(angle_between(rotation, mirrored)).min() == pytest.approx(70, abs=1e-6)
