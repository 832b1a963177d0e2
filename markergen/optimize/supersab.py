"""SuperSAB gradient descent (Tollenaere 1990; Acuna & Willert 2018, Eq. 12), all restarts as one batch.

    X(t+1) = P(X(t) - a(t) grad log f(X(t)))

with a step size a for each coordinate, which grows while the sign of that coordinate's gradient stays and shrinks when
it changes, and P the projection on the feasible region. The logarithm makes the step free of the objective's unit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.trace import Record

Array = NDArray[np.float64]

GROW, SHRINK = 1.2, 0.5
"""The paper's 1.05 takes three times as many steps to the same optimum; 1.2 is as reliable here."""

LONGEST = 0.15
"""Longest step of a coordinate, in radii: no step may jump across the marker."""


@dataclass(frozen=True)
class Descent:
    """Best feasible layouts (B, n, 2) in m that a descent met, their values (B,), and the number of steps it took.

    A restart that never was feasible has the value inf.
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
    """Run SuperSAB from every start (B, n, 2) at once; what no longer improves is retired from the batch.

    A restart is retired when its best value has fallen by less than `tolerance`, relatively, over `patience` steps.
    `record` is called with what each step made of the layouts.
    """
    scale = region.boundary.radius
    points = region.project(starts.copy())
    if record:
        record("descent", starts, points)
    value, gradient = _log_gradient(objective, points)
    found, found_value = points.copy(), np.where(region.holds(points), value, np.inf)
    # The first step moves the fastest coordinate of each layout by a twentieth of the radius.
    fastest = np.max(np.abs(gradient), axis=(1, 2), keepdims=True)
    step = np.broadcast_to(0.05 * scale / np.maximum(fastest, 1e-300), points.shape).copy()
    # From here on every array but `found` and `found_value` has the layouts that are still descended, and no others.
    alive = np.arange(len(points))
    best, best_value, reference = points.copy(), found_value.copy(), found_value.copy()
    taken = 0
    for taken in range(1, steps + 1):
        moved = region.project(points - np.clip(step * gradient, -LONGEST * scale, LONGEST * scale))
        held = region.holds(moved)
        # Where the projection jams, the layout stays and its steps shrink until they fit.
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
            found[alive], found_value[alive] = best, best_value
            alive, reference = alive[improving], best_value[improving]
            points, gradient, step, best, best_value = (
                array[improving] for array in (points, gradient, step, best, best_value)
            )
        if progress:
            progress(taken if len(alive) else steps, steps)
        if not len(alive):
            break
    found[alive], found_value[alive] = best, best_value
    return Descent(found, found_value, taken)


def _log_gradient(objective: Objective, points: Array) -> tuple[Array, Array]:
    value, gradient = objective.value_and_gradient(points)
    return value, gradient / value[:, None, None]
