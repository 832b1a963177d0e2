"""Rotation objective: error of the estimated orientation alone."""
# tests: tests/contracts/test_objectives.py

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import rotation_bound
from markergen.objectives.base import OBJECTIVES, Criterion
from markergen.objectives.pose import PoseCovarianceObjective


@OBJECTIVES.register("rotation")
class RotationObjective(PoseCovarianceObjective):
    """RMS rotation error in degrees for the noise of the setting (`markergen.maths.information`)."""

    unit = "deg"
    criterion = Criterion(
        "rotation_deg", "rotation deg", place=2, bound=lambda covariance, _: np.rad2deg(rotation_bound(covariance))
    )
    # Half of the starts end in local optima, with dots in pairs and triples.
    default_restarts = 32

    def _weight(self) -> Array:
        weight = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * np.rad2deg(1.0) ** 2
        return np.broadcast_to(weight, (len(self.setting.poses), 6, 6))
