"""``--objective volume``: the volume of the pose's error ellipsoid (D-optimality)."""

import autograd.numpy as np

from markergen.objectives import Criterion
from markergen.objectives.autograd import Array, AutogradObjective


class Volume(AutogradObjective):
    """Geometric mean of the six standard deviations of the pose, in rad and m, each m counted as one per radius."""

    default_restarts = 8
    criterion = Criterion("volume_mrad", "volume mrad", 1e3, place=50)

    def values(self, points: Array) -> Array:
        """Return det(C)^(1/12) (B, P) of the covariance C of the pose, translation in radii of the boundary."""
        _, log_determinant = np.linalg.slogdet(self.information(points))
        return np.exp(-log_determinant / 12) / self.setting.boundary.radius**0.5
