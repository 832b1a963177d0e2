"""Weighted sums of objectives, and bounds on objectives, as one objective."""

from collections.abc import Sequence

import numpy as np

from markergen.arrays import Array
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.base import Objective, Pullback

STEEPNESS = 100
"""Exponent of the penalty: a bound is kept unless 1 % of it is worth more than 1 * STEEPNESS % of the objective."""


class ComposedObjective(Objective):
    """f = sum_i w_i f_i, minimized while g_j <= b_j, each of them an aggregated objective.

    The value is f prod_j (1 + h_j)^STEEPNESS with h_j = max(0, log(g_j / b_j)), an exact penalty: its minimum keeps the
    bounds, where they can be kept at a price below STEEPNESS. With softness s > 0 the kink of h becomes a parabola,
    h = x^2 / (2 s) up to x = s, and x - s / 2 above. It is one value, not one for each pose.

    Parameters
    ----------
    terms : sequence of (float, Objective)
        w_i and f_i.
    bounds : sequence of (Objective, float)
        g_j and b_j, in the unit of g_j.
    """

    def __init__(
        self, terms: Sequence[tuple[float, Objective]], bounds: Sequence[tuple[Objective, float]] = ()
    ) -> None:
        self.terms, self.bounds = tuple(terms), tuple(bounds)
        parts = [*(objective for _, objective in self.terms), *(objective for objective, _ in self.bounds)]
        self.setting, self.aggregate, self.aggregated = parts[0].setting, parts[0].aggregate, AGGREGATES["mean"]
        self.unit = parts[0].unit if len(self.terms) == 1 else ""
        self.planar_only = any(objective.planar_only for objective in parts)
        self.default_restarts = max(objective.default_restarts for _, objective in self.terms)
        self._smooth = not (self.bounds or any(objective.nonsmooth for objective in parts))

    @property
    def nonsmooth(self) -> bool:
        """True with bounds, whose penalty has a kink."""
        return not self._smooth

    def excess(self, points: Array) -> Array:
        """log(g_j / b_j) (J, B) of layouts (B, n, .) in m; 0 or less where a bound is kept."""
        return np.array([np.log(objective(points) / most) for objective, most in self.bounds]).reshape(-1, len(points))

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; the values are (B, 1)."""
        terms = [(weight, *objective.reduced(points, softness)) for weight, objective in self.terms]
        bounds = [(most, *objective.reduced(points, softness)) for objective, most in self.bounds]
        total = np.sum([weight * value for weight, value, _ in terms], axis=0)
        hinges = [_hinge(np.log(value / most), softness) for most, value, _ in bounds]
        with np.errstate(over="ignore"):
            penalty = np.prod([np.ones(len(points)), *((1 + height) ** STEEPNESS for height, _ in hinges)], axis=0)
            penalized = total * penalty

        def pullback(weights: Array) -> Array:
            gradient = np.zeros_like(points)
            with np.errstate(all="ignore"):
                for weight, _, back in terms:
                    gradient += back(weights[:, 0] * weight * penalty)
                for (_, value, back), (height, slope) in zip(bounds, hinges, strict=True):
                    if slope.any():
                        gradient += back(weights[:, 0] * penalized * STEEPNESS * slope / ((1 + height) * value))
            return gradient

        return penalized[:, None], pullback


def _hinge(x: Array, softness: float) -> tuple[Array, Array]:
    """max(0, x) and its derivative; with softness, its kink is a parabola."""
    if not softness:
        return np.maximum(x, 0.0), (x > 0).astype(float)
    clipped = np.clip(x, 0.0, softness)
    return clipped**2 / (2 * softness) + np.maximum(x - softness, 0.0), clipped / softness
