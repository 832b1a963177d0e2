"""SQPnP (Terzakis & Lourakis 2020), OpenCV's."""

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.opencv import solve_each


class Sqpnp(PoseEstimator):
    """SQPnP as OpenCV has it: the global minimum of an algebraic error, for points in a plane or in space."""

    name = "sqpnp"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, two or more solutions each (nan where it has one), the best first."""
        return solve_each(batch, "SQPNP", solutions=2)


SQPNP = Sqpnp()
ESTIMATORS.register(SQPNP.name)(SQPNP)
