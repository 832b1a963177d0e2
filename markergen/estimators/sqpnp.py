"""OpenCV's SQPnP (Terzakis & Lourakis 2020)."""
# tests: tests/contracts/test_estimators.py

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.base import solve_each


class Sqpnp(PoseEstimator):
    """OpenCV's SQPnP: the global minimum of an algebraic error, for coplanar or non-coplanar points."""

    name = "sqpnp"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, two or more solutions each (nan for missing ones), best first."""
        return solve_each(batch, "SQPNP", solutions=2)


SQPNP = Sqpnp()
ESTIMATORS.register(SQPNP.name)(SQPNP)
