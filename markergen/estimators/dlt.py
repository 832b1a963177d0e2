"""The normalized direct linear transform, the estimator of the paper."""

import numpy as np
from numpy.typing import NDArray

from markergen.estimators import ESTIMATORS, Correspondences, HomographyEstimator
from markergen.maths.dlt import condition, estimate_homography, normalization

Array = NDArray[np.float64]


class Dlt(HomographyEstimator):
    """Normalized DLT (Hartley 1997); nan where the points do not determine a homography."""

    name = "dlt"

    def solve(self, batch: Correspondences) -> Array:
        """Homographies (T, 3, 3) with H[2, 2] = 1, from marker plane (m) to image (px)."""
        homography = np.full((len(batch.image_points), 3, 3), np.nan)
        usable = batch.solvable
        points = batch.object_points[:, :2]
        if usable.any() and _four_in_general_position(points):
            homography[usable] = estimate_homography(points, batch.image_points[usable])
        return homography


def _four_in_general_position(points: Array) -> bool:
    """Tell whether four of the points (n, 2), which are not all collinear, have no three of them on a line."""
    center, scale = normalization(points)
    normalized = (points - center) * scale
    # The DLT matrix of the identity has rank 8 exactly then.
    return bool(np.isfinite(condition(normalized, normalized)))


DLT = Dlt()
ESTIMATORS.register(DLT.name)(DLT)
