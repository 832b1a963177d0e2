"""The rotation objective: the error of the estimated orientation alone."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives.base import OBJECTIVES
from markergen.objectives.pose import PoseCovarianceObjective

Array = NDArray[np.float64]


@OBJECTIVES.register("rotation")
class RotationObjective(PoseCovarianceObjective):
    """RMS rotation angle in degrees that the noise of the setting allows (`markergen.maths.information`)."""

    unit = "deg"
    # Dots in pairs and triples are local optima, which half of the starts end in.
    default_restarts = 32

    def _weight(self) -> Array:
        weight = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * np.rad2deg(1.0) ** 2
        return np.broadcast_to(weight, (len(self.setting.poses), 6, 6))
