"""Constrained polish of a layout by SLSQP with the exact constraints, starting from the result of a descent.

`slsqp` is the only driver of SciPy's sequential quadratic programming, and `Clearances` the constraints of any layout;
both are also used for packings, reliefs and layouts without a key ring.
"""
# tests: tests/optimize/test_optimize.py tests/optimize/test_search.py

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.objectives import Objective
from markergen.optimize.constraints import contacts
from markergen.optimize.ending import end_if_due
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.trace import Record

Index = NDArray[np.int64]

SOFTNESSES = (0.1, 0.03, 0.01, 0.003, 0.001, 1e-4, 1e-5)
"""Continuation for an objective with kinks (s7 = s8): each stage starts from the result of the previous one and
minimizes a smooth function within a factor 7^(softness/2) of c(A), or P^softness of the worst of P poses. Quasi-Newton
steps stall at the kink itself. The last stages start so near the optimum that they take almost no time; without them
the value is off by a few 1e-8."""

ALL_PAIRS_UP_TO = 24
"""Number of dots in a disk up to which all pairs are constraints, and a dot may go anywhere in one polish."""

REACH, ROUNDS = 0.15, 4
"""Otherwise, the maximum movement of a dot per round, as a fraction of the radius (half the spacing for many dots), and
the number of rounds; only objects that it touches within half of that are constraints: dozens of them instead of
thousands. Twice as many, all that it can touch, take a fifth longer to the same layouts; without the limit of the
movement, layouts of 40 dots are 1 to 10 % worse."""

NEWTON_STEPS, TOUCHING, MARGIN = 4, 1e-6, 1e-10
"""Most steps by which the last violations are removed, and the slack up to which constraints take part in it, and that
they should have afterward: in radii, or squared radii."""


def slsqp(
    cost: Callable[[Array], tuple[float, Array]],
    slack: Callable[[Array], Array],
    slack_jacobian: Callable[[Array], Array],
    start: Array,
    bounds: tuple[Array, Array] | None,
    iterations: int,
    tolerance: float,
    visited: Callable[[Array], object] | None = None,
) -> Array:
    """Minimize cost(x) subject to slack(x) >= 0 and bounds.

    The exit status is not returned: callers check anyway whether the resulting layout is feasible and better.

    Parameters
    ----------
    cost : callable
        Value and gradient (m,) at x (m,).
    slack, slack_jacobian : callable
        Constraints (c,), and their derivative (c, m).
    start : array (m,)
        Initial x. All unknowns should have about the same magnitude, like coordinates in radii.
    bounds : pair of arrays (m,) or None
        Lower and upper bounds of x.
    iterations : int
        Maximum number of steps.
    tolerance : float
        Change of the cost below which the run ends.
    visited : callable or None
        Called with x after each step.

    Returns
    -------
    array (m,)
        Final x, which may be infeasible due to rounding.
    """
    from scipy.optimize import minimize

    def step(x: Array) -> None:
        end_if_due()
        if visited:
            visited(x)

    result = minimize(
        cost,
        start,
        jac=True,
        method="SLSQP",
        bounds=None if bounds is None else np.stack(bounds, axis=-1),
        constraints=[{"type": "ineq", "fun": slack, "jac": slack_jacobian}],
        options={"maxiter": iterations, "ftol": tolerance},
        callback=step,
    )
    return np.asarray(result.x)


class Clearances:
    """Clearance constraints of a layout to walls and between dots while no coordinate changes by more than `reach`.

    The slack at walls is in radii of the boundary, between dots in squared radii; derivatives are with respect to
    coordinates in radii.

    Parameters
    ----------
    start : array (n, 2), m
    reach : float
        Maximum change in m; inf includes all constraints.
    unit : float
        Unit of length of layouts (n, 2), in m.
    moving : array or None
        Indices of the dots that move; None for all.
    """

    def __init__(
        self, region: FeasibleRegion, start: Array, reach: float, unit: float, moving: Index | None = None
    ) -> None:
        # Distances between dots change by at most twice this.
        diagonal = np.sqrt(2) * reach
        to_dot = region.spacing + 2 * diagonal if region.spacing else -1.0
        within_reach = contacts(region.walls, start, region.inset, region.inset + diagonal, to_dot)
        self._near = within_reach if moving is None else within_reach.of(moving)
        self._inset, self._scale, self._unit = region.inset, region.boundary.radius, unit
        self._radius = self._scale / unit
        self._least = (region.spacing / self._scale) ** 2

    def slack(self, layout: Array) -> Array:
        """Slack (c,) of the constraints; 0 or more is feasible."""
        room = (self._near.room(layout * self._unit) - self._inset) / self._scale
        return np.concatenate([room, np.sum((self._near.apart(layout) / self._radius) ** 2, axis=-1) - self._least])

    def slack_jacobian(self, layout: Array) -> Array:
        """Derivative (c, n, 2) of `slack`."""
        pairs = self._near.apart_jacobian(layout, 2 / self._radius * self._near.apart(layout))
        return np.concatenate([self._near.room_jacobian(layout * self._unit), pairs])


def polish(
    objective: Objective, region: FeasibleRegion, start: Array, iterations: int = 60, record: Record | None = None
) -> tuple[Array, float]:
    """Improve one layout (n, 2) in m; return it and its value, never worse than a feasible start.

    From an infeasible start, the result is feasible or, if that fails, the start with the value inf. `record` is called
    with the layouts before and after each step.
    """
    best, best_value = start, float(objective(start[None])[0]) if region.holds(start[None])[0] else np.inf
    current = start
    for softness in SOFTNESSES if objective.nonsmooth else (0.0,):
        rounds = _rounds(objective, region, current, softness, iterations, record)
        for current in rounds:
            value = float(objective(current[None])[0])
            if value < best_value and region.holds(current[None])[0]:
                best, best_value = current, value
    return best, best_value


def _rounds(
    objective: Objective, region: FeasibleRegion, start: Array, softness: float, iterations: int, record: Record | None
) -> Iterator[Array]:
    """Layouts (n, 2) in m after each round, feasible or not."""
    reach = np.inf
    if len(region.walls) > 1 or len(start) > ALL_PAIRS_UP_TO:
        reach = REACH * region.boundary.radius
        if len(start) > ALL_PAIRS_UP_TO and region.spacing:
            reach = min(reach, region.spacing / 2)
    for _ in range(ROUNDS):
        way = [start]
        end = _run(objective, region, start, softness, iterations, reach, way)
        freed = _freed(region, region.project(end[None])[0])
        if record:
            record("polish", np.stack(way), np.stack([*way[1:], freed]))
        yield freed
        if np.isfinite(reach) and region.holds(start[None])[0] and not region.holds(freed[None])[0]:
            # Dots ran into others that were too far to be constraints.
            reach /= 2
            continue
        start, moved = freed, np.abs(end - start).max()
        if moved < 0.99 * reach:
            break


def _freed(region: FeasibleRegion, layout: Array) -> Array:
    """Layout (n, 2) in m with its last violations removed by Newton's method; itself if it is feasible.

    Dots of a jammed layout that are pushed apart one after the other violate a constraint by less and less, but for
    long by more than the tolerance: 8 of 20 polishes of 28 to 85 dots in a disk were lost by that.
    """
    for _ in range(NEWTON_STEPS):
        if region.holds(layout[None])[0]:
            break
        scale = region.boundary.radius
        clear, x = Clearances(region, layout, TOUCHING * scale, scale), layout / scale
        slack = clear.slack(x)
        touching = slack < TOUCHING
        jacobian = clear.slack_jacobian(x)[touching].reshape(-1, layout.size)
        # The least movement after which touching constraints hold, to first order.
        move = np.linalg.lstsq(jacobian, np.maximum(MARGIN - slack[touching], 0.0), rcond=None)[0]
        layout = layout + scale * move.reshape(layout.shape)
    return layout


def _run(
    objective: Objective,
    region: FeasibleRegion,
    start: Array,
    softness: float,
    iterations: int,
    reach: float,
    way: list[Array],
) -> Array:
    """Run SLSQP once from a layout (n, 2), appending its steps to `way`."""
    n, scale = len(start), region.boundary.radius
    clear = Clearances(region, start, reach / 2, scale)

    def log_value(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(x.reshape(1, n, 2) * scale, softness)
        return float(np.log(value[0])), (gradient[0] * (scale / value[0])).ravel()

    x = start.ravel() / scale
    end = slsqp(
        log_value,
        lambda x: clear.slack(x.reshape(n, 2)),
        lambda x: clear.slack_jacobian(x.reshape(n, 2)).reshape(-1, 2 * n),
        x,
        None if np.isinf(reach) else (x - reach / scale, x + reach / scale),
        iterations,
        1e-10,
        lambda x: way.append(x.reshape(n, 2) * scale),
    )
    return end.reshape(n, 2) * scale
