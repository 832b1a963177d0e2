"""Reliability as an objective: how far off a dot may be before a test notices it (Baarda 1968, Foerstner 1987)."""
# tests: tests/bounds/test_reliability.py tests/contracts/test_objectives.py

from copy import copy

import autograd.numpy as anp
import numpy as np

from markergen.arrays import Array
from markergen.objectives.autograd import AutogradObjective, inverse
from markergen.objectives.base import OBJECTIVES, Pullback

RISK, POWER = 0.001, 0.8
"""Probabilities that the test suspects a right dot, and that it suspects a wrong one; geodesists' usual values."""


def noncentrality() -> float:
    """Square lambda of a dot's displacement, in its standard deviations, that the test notices: about 20.

    The test statistic of a dot, v' Q^-1 v of its residual v with covariance Q, has a chi-square distribution with two
    degrees of freedom, noncentral by lambda if the dot is displaced.
    """
    from scipy.special import chndtrinc

    return float(chndtrinc(-2 * np.log(RISK), 2, 1 - POWER))


def detectability(shares: Array, covariance: Array, plane: Array) -> Array:
    """K (..., n, 2, 2): a displacement g in m of a dot in the plane has the noncentrality g' K g.

    With F = J' W J the information of the dot, C = (sum F)^-1, and S = J T the derivative of its image by its place,
    the residual of the displaced dot has the noncentrality (S g)' (W - W J C J' W) (S g), so

        K = T' (F - F C F) T.

    Parameters
    ----------
    shares : array (..., n, 6, 6)
        F.
    covariance : array (..., 1, 6, 6)
        C.
    plane : array (..., 1, 6, 2)
        T, see `TraceObjective`.
    """
    middle = shares - anp.matmul(anp.matmul(shares, covariance), shares)
    return anp.matmul(anp.matmul(np.swapaxes(plane, -1, -2), middle), plane)


@OBJECTIVES.register("blunder")
class BlunderObjective(AutogradObjective):
    """Smallest displacement in m of a dot that a test notices, of the dot and direction for which it is largest.

    sqrt(lambda / the least eigenvalue of K), see `noncentrality` and `detectability`. It scales with the noise of the
    setting; as a bound it is sensible with that of images, `noise_model` image. At least four dots are needed.
    """

    unit = "m"
    nonsmooth_values = True
    _softness = 0.0

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; softened by a norm over the dots, within a factor n^softness."""
        softened = copy(self)
        softened._softness = softness
        return super(BlunderObjective, softened).linearize(points, softness)

    def values(self, points: Array) -> Array:
        """See `AutogradObjective.values`."""
        batch, n, axes = points.shape
        shares = anp.reshape(self.information(anp.reshape(points, (batch * n, 1, axes))), (batch, n, -1, 6, 6))
        shares = anp.swapaxes(shares, 1, 2)
        plane = self._pose._plane()[:, None]
        matrix = detectability(shares, inverse(anp.sum(shares, axis=2))[:, :, None], plane)
        half = (matrix[..., 0, 0] + matrix[..., 1, 1]) / 2
        spread = anp.sqrt(((matrix[..., 0, 0] - matrix[..., 1, 1]) / 2) ** 2 + matrix[..., 0, 1] ** 2)
        squares = noncentrality() / (half - spread)
        squares = anp.where(squares > 0, squares, np.inf)
        if not self._softness:
            return anp.sqrt(anp.max(squares, axis=-1))
        largest = anp.max(squares, axis=-1)
        powers = anp.sum((squares / largest[..., None]) ** (1 / (2 * self._softness)), axis=-1)
        return anp.sqrt(largest) * powers**self._softness
