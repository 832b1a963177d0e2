"""The same refiner for all patterns: a fit of the known picture to all grey levels, from any detector's pose."""
# tests: tests/comparison/test_photometric.py

import numpy as np

from markergen.comparison.contestants import Image, Pose
from markergen.maths.information import apply_pose_step
from markergen.model.camera import Camera
from markergen.render import Optics, window_of
from markergen.render.optics import FULL_SCALE
from markergen.validation.bounds import Scene, grey_gradient

STEPS = 6
"""Maximum number of Gauss-Newton steps."""
CONVERGED = 0.1
"""Step that ends the fit, in standard deviations of the pose: the next would be some hundredths of that."""


def photometric_fit(image: Image, scene: Scene, camera: Camera, pose: Pose, optics: Optics) -> Pose:
    """Pose that fits the expected grey levels of a known pattern to an image best, near a given one.

    Gauss-Newton on sum (I - E(pose))^2 / sigma^2 over the pixels around the pattern, with optics and noise known: what
    `photometric_bounds` bounds. Where it does not converge, the best pose on the way is returned, which is the
    given one if no step improves it.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    pose : (rotation (3, 3), translation (3,) in m)
        T_camera_marker within 2 px or so of the true one.
    """
    levels = image * np.float32(
        FULL_SCALE / np.iinfo(image.dtype).max if optics.bits == 8 else FULL_SCALE / (2**optics.bits - 1)
    )
    best, least = pose, np.inf
    for _ in range(STEPS):
        (left, top), (width, height) = window = window_of(scene(*pose), camera, *pose, optics)
        if min(width, height) < 1:
            break
        expected, gradient, sigma = grey_gradient(scene, camera, *pose, optics, window)
        residual = (levels[top : top + height, left : left + width] - expected) / sigma
        # Windows of different sizes: of each only what exceeds the noise counts.
        excess = float(np.sum(residual**2, dtype=float) - residual.size)
        if not excess < least:
            break
        best, least = pose, excess
        weighted = (gradient / sigma).reshape(6, -1).astype(float)
        information = weighted @ weighted.T
        step = np.linalg.lstsq(information, weighted @ residual.ravel(), rcond=None)[0]
        rotation, translation = apply_pose_step(pose[0][None], pose[1][None], step[None])
        pose = rotation[0], translation[0]
        if step @ information @ step < CONVERGED**2:
            return pose
    return best
