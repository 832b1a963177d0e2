"""Reliability as an objective: how far off a dot may be before a test notices it (Baarda 1968, Foerstner 1987)."""
# tests: tests/bounds/test_reliability.py tests/contracts/test_objectives.py

from copy import copy

import autograd.numpy as anp
import numpy as np

from markergen.arrays import Array
from markergen.maths.reliability import detectability, noncentrality
from markergen.objectives.autograd import AutogradObjective, inverse
from markergen.objectives.base import OBJECTIVES, Pullback


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
