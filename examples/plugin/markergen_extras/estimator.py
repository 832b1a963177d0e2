"""``refined``: the pose from the homography, refined by OpenCV's virtual visual servoing."""

import cv2
import numpy as np

from markergen.estimators import Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.dlt import DLT
from markergen.maths.projection import decompose_homography


class Refined(PoseEstimator):
    """DLT and decomposition, then `cv2.solvePnPRefineVVS`; for points in a plane."""

    name = "refined"
    planar_only = True

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Estimate the poses of the batch, one solution each; nan if there is no homography."""
        rotation, translation = decompose_homography(batch.once(DLT), batch.camera.matrix)
        for i in np.flatnonzero(np.isfinite(translation).all(axis=-1)):
            start = cv2.Rodrigues(rotation[i])[0], translation[i][:, None]
            pixels = batch.image_points[i].reshape(-1, 1, 2)
            points = batch.of(np.array([i])).reshape(-1, 1, 3)
            vector, offset = cv2.solvePnPRefineVVS(points, pixels, batch.camera.matrix, np.zeros(4), *start)
            rotation[i], translation[i] = cv2.Rodrigues(vector)[0], offset[:, 0]
        return PoseEstimates(rotation[:, None], translation[:, None])


REFINED = Refined()
