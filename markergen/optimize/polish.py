"""Constrained polish of a layout: SLSQP on the exact constraints, from where the descent left off."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.region import Region

Array = NDArray[np.float64]

SOFTNESSES = (0.1, 0.03, 0.01, 0.003, 0.001)
"""Continuation for an objective with kinks (s7 = s8): each stage starts from the one before and follows a smooth
function that lies within a factor 7^(softness/2) of c(A), or P^softness of the worst of P poses. Quasi-Newton steps on
the kink itself stall."""


def polish(objective: Objective, region: Region, start: Array, iterations: int = 60) -> tuple[Array, float]:
    """Improve one layout (n, 2) in m; return it and its value, never worse than the start and always feasible."""
    best, best_value = start, float(objective(start[None])[0])
    current = start
    for softness in SOFTNESSES if objective.kinked else (0.0,):
        current = region.project(_slsqp(objective, region, current, softness, iterations)[None])[0]
        value = float(objective(current[None])[0])
        if value < best_value and region.holds(current[None])[0]:
            best, best_value = current, value
    return best, best_value


def _slsqp(objective: Objective, region: Region, start: Array, softness: float, iterations: int) -> Array:
    from scipy.optimize import minimize

    n, scale = len(start), region.boundary.radius

    def log_value(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(x.reshape(1, n, 2) * scale, softness)
        return float(np.log(value[0])), (gradient[0] * (scale / value[0])).ravel()

    result = minimize(
        log_value,
        start.ravel() / scale,
        jac=True,
        method="SLSQP",
        constraints=_constraints(region, n, scale),
        options={"maxiter": iterations, "ftol": 1e-10},
    )
    return np.asarray(result.x).reshape(n, 2) * scale


def _constraints(region: Region, n: int, scale: float) -> list[dict[str, object]]:
    def room(x: Array) -> Array:
        return (region.boundary.depth(x.reshape(n, 2) * scale) - region.inset) / scale

    def room_gradient(x: Array) -> Array:
        gradient = np.zeros((n, n, 2))
        gradient[np.arange(n), np.arange(n)] = region.boundary.depth_gradient(x.reshape(n, 2) * scale)
        return gradient.reshape(n, -1)

    constraints: list[dict[str, object]] = [{"type": "ineq", "fun": room, "jac": room_gradient}]
    if region.spacing:
        first, second = np.triu_indices(n, 1)
        pairs = np.arange(len(first))
        least = (region.spacing / scale) ** 2

        def gaps(x: Array) -> Array:
            points = x.reshape(n, 2)
            return np.sum((points[first] - points[second]) ** 2, axis=-1) - least

        def gaps_gradient(x: Array) -> Array:
            points = x.reshape(n, 2)
            gradient = np.zeros((len(pairs), n, 2))
            gradient[pairs, first] = 2 * (points[first] - points[second])
            gradient[pairs, second] = -gradient[pairs, first]
            return gradient.reshape(len(pairs), -1)

        constraints.append({"type": "ineq", "fun": gaps, "jac": gaps_gradient})
    return constraints
