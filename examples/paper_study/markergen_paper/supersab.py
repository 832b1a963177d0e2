"""The paper's descent, Eq. 12 with the step sizes of SuperSAB, as both are published."""
# tests: tests/examples/paper_study/test_supersab.py

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import Descent

Array = NDArray[np.float64]

GROW, SHRINK = 1.05, 0.5
"""Factors of a step size, as usual with SuperSAB; the paper gives none. With a growth of 1.2, of 240 descents 24 %
instead of 29 % end near the best after 150 steps of eight points, and 52 % instead of 23 % of four."""

FIRST = 0.05
"""First step of a layout's fastest coordinate, in radii; the paper gives none."""


def supersab(objective: Objective, region: FeasibleRegion, starts: Array, steps: int) -> Descent:
    """Descend from all starts (B, n, 2) in m for a fixed number of steps.

        X(t+1) = P(X(t) - a(t) grad c(A(X(t))))

    without momentum, with P the projection onto the region. A coordinate's step size a grows while its component of the
    gradient keeps its sign. Where the sign changes, a shrinks, the coordinate's last step is undone, and the next one
    is taken with the smaller size (T. Tollenaere, "SuperSAB", Neural Networks 3, 1990).

    Returns
    -------
    Descent
        Of each descent the layout with the least value on its way.
    """
    points = region.project(starts.copy())
    values, gradient = objective.value_and_gradient(points)
    best = points.copy()
    fastest = np.max(np.abs(gradient), axis=(1, 2), keepdims=True)
    step = np.broadcast_to(FIRST * region.boundary.radius / np.maximum(fastest, 1e-300), points.shape).copy()
    previous, last = points, np.zeros_like(gradient)
    for _ in range(steps):
        agreement = gradient * last
        step *= np.where(agreement > 0, GROW, np.where(agreement < 0, SHRINK, 1.0))
        undone = agreement < 0
        moved = region.project(np.where(undone, previous, points - step * gradient))
        # After an undone step there is no sign to compare the next with.
        last = np.where(undone, 0.0, gradient)
        previous, points = points, moved
        value, gradient = objective.value_and_gradient(points)
        better = value < values
        best[better], values = points[better], np.where(better, value, values)
    return Descent(best, values, steps)
