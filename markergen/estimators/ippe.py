"""OpenCV's IPPE (Collins & Bartoli 2014): both poses that agree with a plane's homography to first order."""

import numpy as np

from markergen.estimators import ESTIMATORS, Correspondences, HomographyEstimator, PoseEstimates, PoseEstimator
from markergen.estimators.base import best_first, solve_each
from markergen.maths.information import mirrored_rotation
from markergen.maths.projection import decompose_homography


class Ippe(PoseEstimator):
    """OpenCV's IPPE with both solutions; where it gives nan, the pose decomposed from the homography, and its mirror.

    OpenCV divides 0 by 0 where the two solutions coincide, as they do in a frontal view.
    """

    name = "ippe"
    planar_only = True

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, two solutions each, the better first."""
        poses = solve_each(batch, "IPPE", solutions=2)
        lost = np.isnan(poses.translation[:, 0, 0])
        if not lost.any():
            return poses
        dlt = ESTIMATORS["dlt"]
        assert isinstance(dlt, HomographyEstimator)
        rotation, translation = decompose_homography(batch.once(dlt)[lost], batch.camera.matrix)
        poses.rotation[lost] = np.stack([rotation, mirrored_rotation(rotation, translation)], axis=1)
        poses.translation[lost] = translation[:, None]
        return best_first(batch, poses.rotation, poses.translation)


IPPE = Ippe()
ESTIMATORS.register(IPPE.name)(IPPE)
