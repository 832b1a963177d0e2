"""Constrained polish of a layout: SLSQP on the exact constraints, from where the descent left off."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.contacts import contacts
from markergen.optimize.region import Region
from markergen.optimize.trace import Record

Array = NDArray[np.float64]

SOFTNESSES = (0.1, 0.03, 0.01, 0.003, 0.001, 1e-4, 1e-5)
"""Continuation for an objective with kinks (s7 = s8): each stage starts from the one before and follows a smooth
function that lies within a factor 7^(softness/2) of c(A), or P^softness of the worst of P poses. Quasi-Newton steps on
the kink itself stall. The last stages start so near the optimum that they take next to no time; without them the value
is off by a few 1e-8."""

ALL_PAIRS_UP_TO = 24
"""Up to so many dots in a disk everything can touch everything, and a dot may go anywhere in one polish."""

REACH, ROUNDS = 0.15, 4
"""Otherwise no dot moves farther than this share of the radius, or for many dots half the spacing, in each of so many
rounds, and only what it can come to touch is a constraint: dozens of them instead of thousands."""


def polish(
    objective: Objective, region: Region, start: Array, iterations: int = 60, record: Record | None = None
) -> tuple[Array, float]:
    """Improve one layout (n, 2) in m; return it and its value, never worse than the start if that is feasible.

    From a start that is not the result is feasible or, where that fails, the start with the value inf. `record` is
    called with what each step made of the layout.
    """
    best, best_value = start, float(objective(start[None])[0]) if region.holds(start[None])[0] else np.inf
    current = start
    for softness in SOFTNESSES if objective.kinked else (0.0,):
        current = _rounds(objective, region, current, softness, iterations, record)
        value = float(objective(current[None])[0])
        if value < best_value and region.holds(current[None])[0]:
            best, best_value = current, value
    return best, best_value


def _rounds(
    objective: Objective, region: Region, start: Array, softness: float, iterations: int, record: Record | None
) -> Array:
    reach = np.inf
    if len(region.walls) > 1 or len(start) > ALL_PAIRS_UP_TO:
        reach = REACH * region.boundary.radius
        if len(start) > ALL_PAIRS_UP_TO and region.spacing:
            reach = min(reach, region.spacing / 2)
    for _ in range(ROUNDS):
        way = [start]
        end = _slsqp(objective, region, start, softness, iterations, reach, way)
        moved = np.abs(end - start).max()
        start = region.project(end[None])[0]
        if record:
            record("polish", np.stack(way), np.stack([*way[1:], start]))
        if moved < 0.99 * reach:
            break
    return start


def _slsqp(
    objective: Objective,
    region: Region,
    start: Array,
    softness: float,
    iterations: int,
    reach: float,
    way: list[Array],
) -> Array:
    """One run of SLSQP from a layout (n, 2); its steps are added to `way`."""
    from scipy.optimize import minimize

    n, scale = len(start), region.boundary.radius
    # No coordinate changes by more than the reach, no distance between two dots by more than twice its diagonal.
    diagonal = np.sqrt(2) * reach
    to_dot = region.spacing + 2 * diagonal if region.spacing else -1.0
    near = contacts(region.walls, start, region.inset, region.inset + diagonal, to_dot)
    least = (region.spacing / scale) ** 2

    def log_value(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(x.reshape(1, n, 2) * scale, softness)
        return float(np.log(value[0])), (gradient[0] * (scale / value[0])).ravel()

    def slack(x: Array) -> Array:
        points = x.reshape(n, 2)
        room = (near.room(points * scale) - region.inset) / scale
        return np.concatenate([room, np.sum(near.apart(points) ** 2, axis=-1) - least])

    def slack_jacobian(x: Array) -> Array:
        points = x.reshape(n, 2)
        pairs = near.apart_jacobian(points, 2 * near.apart(points))
        return np.concatenate([near.room_jacobian(points * scale), pairs]).reshape(-1, 2 * n)

    x = start.ravel() / scale
    result = minimize(
        log_value,
        x,
        jac=True,
        method="SLSQP",
        bounds=None if np.isinf(reach) else np.stack([x - reach / scale, x + reach / scale], axis=-1),
        constraints=[{"type": "ineq", "fun": slack, "jac": slack_jacobian}],
        options={"maxiter": iterations, "ftol": 1e-10},
        callback=lambda x: way.append(x.reshape(n, 2) * scale),
    )
    return np.asarray(result.x).reshape(n, 2) * scale
