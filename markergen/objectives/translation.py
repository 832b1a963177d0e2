"""Translation objective: error of the estimated position alone."""
# tests: tests/contracts/test_objectives.py

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import displacement_weight, translation_bound
from markergen.objectives.base import OBJECTIVES, Criterion
from markergen.objectives.pose import PoseCovarianceObjective


@OBJECTIVES.register("translation")
class TranslationObjective(PoseCovarianceObjective):
    """RMS translation error in percent of the distance |t|, for the noise of the setting.

    On a plate of a rig, that of the rig's origin.
    """

    unit = "%"
    criterion = Criterion(
        "translation_pct",
        "translation %",
        place=3,
        bound=lambda covariance, poses: 100 * translation_bound(covariance, poses.translation),
    )

    def _weight(self) -> Array:
        poses, carrier = self.setting.poses, self.setting.carrier
        if carrier:
            place = poses.rotation @ carrier.origin + poses.translation
            share = 100 / np.linalg.norm(place, axis=-1)
            return displacement_weight(carrier.origin[None], poses.rotation) * share[:, None, None] ** 2
        share = 100 / poses.distance
        return np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * share[:, None, None] ** 2
