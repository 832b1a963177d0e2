import numpy as np
import pytest

from markergen.estimators import Correspondences
from markergen.estimators.base import opencv_arguments
from markergen.estimators.ippe import IPPE
from markergen.estimators.lm import LM, refine
from markergen.maths.information import information, pose_jacobian
from markergen.maths.projection import perspective, project, to_camera, to_pixels
from markergen.maths.rotation import angle_between, exponential, logarithm
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution, paper

ANGLES = np.pi / 2 + 2 * np.pi * np.arange(5) / 5
PENTAGON = 0.1284 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)


def tilted(every=1):
    poses = paper()
    kept = np.flatnonzero(poses.polar_angle_deg > 10)[::every]
    return PoseDistribution("tilted", poses.rotation[kept], poses.translation[kept])


def noisy(poses, noise_px=0.2):
    pixels = project(PENTAGON, poses.rotation, poses.translation, PAPER_CAMERA.matrix)
    pixels = pixels + noise_px * np.random.default_rng(0).normal(size=pixels.shape)
    return Correspondences(PENTAGON, pixels, PAPER_CAMERA)


def test_finds_the_poses_that_opencv_refines_to():
    """OpenCV stops at a relative change of 1e-7, which near the flat minimum of far poses is some 1e-6 rad."""
    import cv2

    batch = noisy(tilted(every=4))
    rotation, translation = batch.once(LM).best
    objects, images, R = opencv_arguments(batch)
    start_rotation, start_translation = batch.once(IPPE).best
    for k in range(len(images)):
        vector, _ = cv2.Rodrigues(start_rotation[k] @ R[k].T)
        vector, offset = cv2.solvePnPRefineLM(
            objects[k], images[k], PAPER_CAMERA.matrix, None, vector, start_translation[k][:, None]
        )
        assert angle_between(exponential(vector[:, 0]) @ R[k], rotation[k]) < 1e-5
        assert np.linalg.norm(offset[:, 0] - translation[k]) < 1e-5


def test_ends_where_the_gradient_is_zero():
    """The Gauss-Newton step that is left is at most a few times the 1e-10 at which a trial counts as converged."""
    batch = noisy(tilted())
    rotation, translation = batch.once(LM).best
    jacobian = pose_jacobian(batch.xyz, rotation, translation, PAPER_CAMERA.focal)
    seen = to_pixels(perspective(to_camera(batch.xyz, rotation, translation)), PAPER_CAMERA.matrix)
    residual = (batch.image_points - seen).reshape(len(rotation), -1, 1)
    step = np.linalg.solve(information(jacobian), jacobian.swapaxes(-1, -2) @ residual)
    assert np.abs(step).max() < 1e-9


def test_never_ends_above_its_start():
    batch = noisy(paper(), noise_px=2.0)
    start, end = batch.reprojection_error(*batch.once(IPPE).best), batch.reprojection_error(*batch.once(LM).best)
    assert np.all(end <= start * (1 + 1e-9))


def test_converges_from_a_rough_start():
    """20 degrees and a tenth of the distance away: well inside the basin of poses tilted by 17.5 degrees and more."""
    poses = tilted()
    batch = Correspondences(
        PENTAGON, project(PENTAGON, poses.rotation, poses.translation, PAPER_CAMERA.matrix), PAPER_CAMERA
    )
    off = exponential(np.deg2rad([0.0, 0.0, 20.0]))
    rotation, translation = refine(batch, off @ poses.rotation, 1.1 * poses.translation)
    assert angle_between(rotation, poses.rotation).max() < 1e-8
    assert translation == pytest.approx(poses.translation, abs=1e-8)


def test_a_start_that_is_no_pose_stays():
    batch = noisy(tilted(every=100))
    rotation, translation = (part.copy() for part in batch.once(IPPE).best)
    rotation[0] = np.nan
    translation[1] *= -1
    end_rotation, end_translation = refine(batch, rotation, translation)
    assert np.isnan(end_rotation[0]).all()
    assert np.array_equal(end_translation[1], translation[1])
    assert np.isfinite(end_rotation[2:]).all()


def test_with_a_lens_the_residuals_are_those_of_the_distorted_image():
    """The step of Gauss-Newton from the truth; at 0.01 px the second order is below 2 % of it away from the front."""
    camera = Camera(640, 480, 250.0, 250.0, 320.0, 240.0, Distortion("equidistant", (0.0035, 0.0007, -0.002, 0.0002)))
    poses = tilted(every=8)
    poses = PoseDistribution("beside", poses.rotation, 0.4 * poses.translation + [0.2, 0.1, 0])
    exact = camera.project(PENTAGON, poses.rotation, poses.translation)
    noise = 0.01 * np.random.default_rng(0).normal(size=exact.shape)
    rotation, translation = Correspondences.from_distorted(PENTAGON, exact + noise, camera).once(LM).best
    # The Gauss-Newton step of the image as taken, with the Jacobian of the projection by differences.
    step = 1e-6
    ahead, behind = (
        [
            camera.project(PENTAGON, exponential(h * e[:3]) @ poses.rotation, poses.translation + h * e[3:])
            for e in np.eye(6)
        ]
        for h in (step, -step)
    )
    jacobian = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)).reshape(len(poses), -1, 6) / (2 * step)
    expected = np.einsum("pij,pj->pi", np.linalg.pinv(jacobian), noise.reshape(len(poses), -1))
    result = np.concatenate([logarithm(rotation @ poses.rotation.swapaxes(1, 2)), translation - poses.translation], -1)
    size = np.linalg.norm(expected, axis=-1)
    assert np.max(np.linalg.norm(result - expected, axis=-1) / size) < 0.02


def test_no_trial_that_begins_anywhere_is_no_error():
    """With a lens, and not one start that is finite: what came in comes out."""
    poses = tilted(every=40)
    camera = Camera(1280, 960, 800.0, 800.0, 640.0, 480.0, Distortion("radtan", (-0.2, 0.05, 0.0, 0.0)))
    seen = to_camera(PENTAGON, poses.rotation, poses.translation)
    batch = Correspondences.from_distorted(PENTAGON, camera.to_pixels(perspective(seen)), camera)
    nothing = np.full((len(seen), 3, 3), np.nan), np.full((len(seen), 3), np.nan)
    for result in refine(batch, *nothing):
        assert np.isnan(result).all()
