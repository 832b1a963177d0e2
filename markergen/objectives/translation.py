"""The translation objective: the error of the estimated place alone."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives.base import OBJECTIVES
from markergen.objectives.pose import PoseCovarianceObjective

Array = NDArray[np.float64]


@OBJECTIVES.register("translation")
class TranslationObjective(PoseCovarianceObjective):
    """RMS translation error in percent of the distance |t| that the noise of the setting allows."""

    unit = "%"

    def _weight(self) -> Array:
        share = 100 / self.setting.poses.distance
        return np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * share[:, None, None] ** 2
