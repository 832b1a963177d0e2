"""Robustness of layouts against lost dots: hidden, soiled, or out of the image."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from markergen.arrays import Array
from markergen.model.spec import check_losses
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.base import OBJECTIVES, Losses, Objective, Pullback, Setting
from markergen.objectives.criteria import Criteria, criteria_for, without_height

SMALLEST_SHARE = 1e-12
"""Fraction of the total below which derivatives are neglected: most losses are far from the worst."""


class SurvivalObjective(Objective):
    """The objective after the worst loss of `lost` dots: its maximum over all sets of that size.

    Unit, aggregate and coordinates are the objective's; the values per pose are those after the worst loss.

    Parameters
    ----------
    lost : int
        1 to 3; 4 dots or more must remain, and there must be no more than 2000 sets.
    """

    def __init__(self, objective: Objective, lost: int) -> None:
        self.objective, self.lost = objective, lost
        self.setting, self.aggregate, self.aggregated = objective.setting, objective.aggregate, objective.aggregated
        self.unit, self.default_restarts = objective.unit, objective.default_restarts
        self.default_aggregate, self.coordinates = objective.default_aggregate, objective.coordinates
        self.planar_only, self.knows_noise = objective.planar_only, objective.knows_noise

    @property
    def nonsmooth(self) -> bool:
        """True for any objective: at the best layout several losses are equally bad."""
        return True

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`: values (B, P) after the loss with the worst aggregate over the poses."""
        values, pullback = self.objective.linearize_without(points, self._losses(points), softness)
        with np.errstate(invalid="ignore"):
            worst = np.argmax(self.aggregated(values, softness)[0], axis=-1)
        rows = np.arange(len(points))

        def back(weights: Array) -> Array:
            spread = np.zeros_like(values)
            spread[rows, worst] = weights
            return pullback(spread)

        return values[rows, worst], back

    def reduced(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.reduced`; with softness, the maximum over the losses is smooth as well."""
        if not softness:
            return super().reduced(points, softness)
        values, pullback = self.objective.linearize_without(points, self._losses(points), softness)
        with np.errstate(invalid="ignore"):
            totals, by_value = self.aggregated(values, softness)
            value, by_total = AGGREGATES["max"](totals, softness)
            by_total[by_total < SMALLEST_SHARE] = 0.0
            # A loss that leaves a degenerate layout has an infinite value, and no derivative.
            share = np.where(by_total[..., None] > 0, by_value * by_total[..., None], 0.0)

        def back(weights: Array) -> Array:
            with np.errstate(invalid="ignore"):
                return pullback(share * weights[:, None, None])

        return value, back

    def _losses(self, points: Array) -> Losses:
        return losses(points.shape[1], self.lost)


def losses(n: int, lost: int) -> Losses:
    """All sets of `lost` out of n dots, (S, lost), as indices in ascending order.

    Raises
    ------
    InputError
        If fewer than four dots would remain, or there are too many sets.
    """
    check_losses(n, lost)
    return np.array(list(combinations(range(n), lost)), dtype=np.intp)


@dataclass(frozen=True)
class HiddenDots:
    """Criteria with some dots hidden.

    Attributes
    ----------
    worst, mean : mapping
        Worst and mean value of each criterion separately, over all sets of `hidden` dots.
    worst_dots : tuple of int
        Dots whose loss is worst for the pose.
    """

    hidden: int
    worst: Criteria
    mean: Criteria
    worst_dots: tuple[int, ...]


def hidden_dot_errors(points: Array, setting: Setting, lost: int) -> list[HiddenDots]:
    """Criteria of a layout (n, 2 or 3) with 0, 1, .. `lost` dots hidden, see `markergen.objectives.criteria`."""
    points = without_height(points)[None]
    objectives = {criterion.key: OBJECTIVES[name](setting) for name, criterion in criteria_for(points).items()}
    result = []
    for hidden in range(lost + 1):
        sets = losses(points.shape[1], hidden)
        columns = {key: _after(objective, points, sets) for key, objective in objectives.items()}
        # The first loss that is the worst up to rounding: symmetric layouts have many.
        pose = columns["pose_m"]
        result.append(
            HiddenDots(
                hidden,
                {key: float(values.max()) for key, values in columns.items()},
                {key: float(values.mean()) for key, values in columns.items()},
                tuple(int(i) for i in sets[np.argmax(pose >= pose.max() * (1 - 1e-9))]),
            )
        )
    return result


def _after(objective: Objective, points: Array, sets: Losses) -> Array:
    """Aggregated values (S,) of one layout (1, n, .) after each of S losses."""
    with np.errstate(invalid="ignore"):
        values: Array = objective.aggregated(objective.linearize_without(points, sets)[0], 0.0)[0][0]
    return values
