"""SuperSAB gradient descent (Tollenaere 1990; Acuna & Willert 2018, Eq. 12), all restarts as one batch.

    X(t+1) = P(X(t) - a(t) grad log f(X(t)))

with a step size a for each coordinate, which grows while the sign of that coordinate's gradient is constant and shrinks
when it changes, and P the projection onto the feasible region. The logarithm makes steps independent of the objective's
unit.
"""
# tests: tests/optimize/test_optimize.py

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array
from markergen.objectives import Objective
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.trace import Record

GROW, SHRINK = 1.2, 0.5
"""Factors of the step size. The paper's growth of 1.05 takes three times as many steps to the same optimum; 1.2 is as
reliable here."""

LONGEST = 0.15
"""Maximum step of a coordinate, in radii, so that no step jumps across the marker."""


@dataclass(frozen=True)
class Descent:
    """Best feasible layouts (B, n, 2) in m of a descent, their values (B,), and the number of steps.

    The value of a restart that was never feasible is inf.
    """

    points: Array
    values: Array
    steps: int


def descend(
    objective: Objective,
    region: FeasibleRegion,
    starts: Array,
    steps: int = 150,
    patience: int = 10,
    tolerance: float = 1e-3,
    progress: Callable[[int, int], None] | None = None,
    record: Record | None = None,
) -> Descent:
    """Run SuperSAB from all starts (B, n, 2) at once, retiring restarts that no longer improve.

    A restart is retired when its best value has fallen by less than `tolerance`, relatively, over `patience` steps.
    `record` is called with the layouts before and after each step.
    """
    scale = region.boundary.radius
    points = region.project(starts.copy())
    if record:
        record("descent", starts, points)
    value, gradient = _log_gradient(objective, points)
    layouts, values = points.copy(), np.where(region.holds(points), value, np.inf)
    # The first step moves the fastest coordinate of each layout by a twentieth of the radius.
    fastest = np.max(np.abs(gradient), axis=(1, 2), keepdims=True)
    step = np.broadcast_to(0.05 * scale / np.maximum(fastest, 1e-300), points.shape).copy()
    # From here on every array but `found` and `found_value` contains only the active layouts.
    alive = np.arange(len(points))
    best, best_value, reference = points.copy(), values.copy(), values.copy()
    taken = 0
    for taken in range(1, steps + 1):
        moved = region.project(points - np.clip(step * gradient, -LONGEST * scale, LONGEST * scale))
        held = region.holds(moved)
        # Where the projection jams, the layout stays in place and its steps shrink until they are feasible.
        jammed = ~held & np.isfinite(best_value)
        moved[jammed] = points[jammed]
        step[jammed] *= SHRINK**2
        if record:
            record("descent", points, moved)
        points = moved
        value, fresh = _log_gradient(objective, points)
        agreement = fresh * gradient
        step *= np.where(agreement > 0, GROW, np.where(agreement < 0, SHRINK, 1.0))
        gradient = fresh
        better = held & (value < best_value)
        best[better], best_value[better] = points[better], value[better]
        if taken % patience == 0:
            with np.errstate(invalid="ignore"):
                improving = ~(best_value >= reference * (1 - tolerance))
            layouts[alive], values[alive] = best, best_value
            alive, reference = alive[improving], best_value[improving]
            points, gradient, step, best, best_value = (
                array[improving] for array in (points, gradient, step, best, best_value)
            )
        if progress:
            progress(taken if len(alive) else steps, steps)
        if not len(alive):
            break
    layouts[alive], values[alive] = best, best_value
    return Descent(layouts, values, taken)


def _log_gradient(objective: Objective, points: Array) -> tuple[Array, Array]:
    value, gradient = objective.value_and_gradient(points)
    return value, gradient / value[:, None, None]
