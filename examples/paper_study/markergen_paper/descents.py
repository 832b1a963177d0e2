"""Descents under many poses, each of which has its own layouts; all of them take their steps together."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import markergen as mg
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution
from markergen.objectives import Objective
from markergen.objectives.base import Pullback
from markergen.objectives.condition import ConditionObjective
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import Descent, descend
from markergen_paper.options import REGION, objective_for

Array = NDArray[np.float64]


class PoseByPose(Objective):
    """An objective of layouts (B, n, 2), each of which is judged under one pose alone.

    Values and gradients are those of the objective for that pose, whatever else is in the batch.

    Parameters
    ----------
    name : str
        Name of the objective in `OBJECTIVE_OF`.
    poses : PoseDistribution
    rows : array (B,)
        Index of the pose of each layout.
    """

    def __init__(self, name: str, poses: PoseDistribution, rows: NDArray[np.intp], camera: mg.Camera) -> None:
        self._name, self._rows, self._camera = name, rows, camera
        self._all = objective_for(name, poses, camera)
        super().__init__(self._all.setting, self._all.aggregate)
        self._is_condition = isinstance(self._all, ConditionObjective)
        self._paired = objective_for(name, poses.taken(rows, 0), camera) if self._is_condition else self._all

    def of_layouts(self, kept: NDArray[np.bool_]) -> "PoseByPose":
        """See `Objective.of_layouts`."""
        return PoseByPose(self._name, self.setting.poses, self._rows[kept], self._camera)

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """Values (B, 1), and their pullback from weights (B, 1)."""
        if self._is_condition:
            paired, back = self._paired.linearize(points[None], softness)
            return paired.T, lambda weights: back(weights.T)[0]
        # Under all poses: of the objectives that are not c(A) there are few descents, whose steps cost little.
        values, back = self._all.linearize(points, softness)
        chosen = np.arange(len(points)), self._rows
        # What is degenerate under one pose is so under all, but for rounding.
        finite = np.isfinite(values).all(axis=1)

        def pullback(weights: Array) -> Array:
            chosen_weights = np.zeros_like(values)
            chosen_weights[chosen] = weights[:, 0]
            return back(chosen_weights)

        return np.where(finite, values[chosen], np.inf)[:, None], pullback

    def value_and_gradient(self, points: Array, softness: float = 0.0) -> tuple[Array, Array]:
        """See `Objective.value_and_gradient`; in one chunk, since rows belong to poses."""
        value, pullback = self.reduced(points, softness)
        with np.errstate(invalid="ignore"):
            gradient = pullback(np.ones_like(value))
        return value, np.where(np.isfinite(value)[:, None, None], gradient, 0.0)


def descend_by_pose(
    name: str,
    poses: PoseDistribution,
    starts: Array,
    camera: mg.Camera = PAPER_CAMERA,
    region: FeasibleRegion = REGION,
    routine: Callable[..., Descent] = descend,
    **options: Any,
) -> Descent:
    """Descend from starts (P, B, n, 2) in m, each of P poses with its B layouts; ends and values have that shape, too.

    Parameters
    ----------
    name : str
        Name of the objective in `OBJECTIVE_OF`.
    routine : callable
        ``routine(objective, region, starts, **options)`` descends from starts (B, n, 2).
    """
    count, batch = starts.shape[:2]
    objective = PoseByPose(name, poses, np.repeat(np.arange(count), batch), camera)
    ends = routine(objective, region, starts.reshape(count * batch, *starts.shape[2:]), **options)
    return Descent(ends.points.reshape(starts.shape), ends.values.reshape(count, batch), ends.steps)
