"""EPnP (Lepetit, Moreno-Noguer & Fua 2009), OpenCV's."""

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.opencv import solve_each


class Epnp(PoseEstimator):
    """EPnP as OpenCV has it.

    On points of one plane it is degrees off without any noise in many poses, more or fewer by roll, and most often
    flipped where the marker is steep. That is a property of this implementation, neither of the layout nor of the
    turn before the call (without it the share of bad poses is the same, and a little more fail).
    """

    name = "epnp"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        return solve_each(batch, "EPNP")


EPNP = Epnp()
ESTIMATORS.register(EPNP.name)(EPNP)
