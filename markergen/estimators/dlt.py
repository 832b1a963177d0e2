"""Normalized direct linear transform, the paper's estimator."""
# tests: tests/contracts/test_estimators.py

import numpy as np

from markergen.arrays import Array
from markergen.estimators import ESTIMATORS, Correspondences, HomographyEstimator
from markergen.maths.dlt import estimate_homography, four_in_general_position


class Dlt(HomographyEstimator):
    """Normalized DLT (Hartley 1997); nan where the points do not determine a homography."""

    name = "dlt"

    def solve(self, batch: Correspondences) -> Array:
        """Homographies (T, 3, 3) with H[2, 2] = 1, from marker plane (m) to image (px)."""
        homography = np.full((len(batch.image_points), 3, 3), np.nan)
        usable = batch.solvable.copy()
        if usable.any():
            usable[usable] = four_in_general_position(batch.of(usable)[..., :2])
        if usable.any():
            homography[usable] = estimate_homography(batch.of(usable)[..., :2], batch.image_points[usable])
        return homography


DLT = Dlt()
ESTIMATORS.register(DLT.name)(DLT)
