"""What others do: autograd through the SVD, scipy's SLSQP from random starts, and its differential evolution."""

import time
from collections.abc import Callable

import autograd.numpy as anp
import numpy as np
from autograd import value_and_grad
from scipy.optimize import Bounds, NonlinearConstraint, differential_evolution, minimize

from markergen.arrays import Array
from markergen.objectives import Objective, Setting
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import GROW, LONGEST, SHRINK

Gradient = Callable[[Array], tuple[float, Array]]

NEAR = 1e-3
"""A search is there when its value is this near, relatively, to the best known one."""


def autograd_condition(setting: Setting) -> Gradient:
    """Logarithm of c(A) and its gradient for one layout (n, 2) in one pose, through the SVD; unit coordinates."""
    rotation, translation = setting.poses.rotation[0], setting.poses.translation[0]
    radius, depth = setting.boundary.radius, translation[2]

    def log_condition(points: Array) -> float:
        camera = points @ rotation[:, :2].T + translation
        image = (camera[:, :2] / camera[:, 2:] - translation[:2] / depth) * (depth / radius)
        p = anp.concatenate([points / radius, anp.ones((len(points), 1))], axis=1)
        zero = anp.zeros(p.shape)
        above = anp.concatenate([zero, -p, image[:, 1:] * p], axis=1)
        below = anp.concatenate([p, zero, -image[:, :1] * p], axis=1)
        values = anp.linalg.svd(anp.concatenate([above, below]), compute_uv=False)
        return anp.log(values[0] / values[7])

    return value_and_grad(log_condition)


def descend_one_by_one(gradient_of: Gradient, starts: Array, steps: int, radius: float) -> Array:
    """SuperSAB in the disk from every start (B, n, 2), one after the other; the best values (B,) met."""
    best = np.empty(len(starts))
    for index, start in enumerate(starts):
        points = start.copy()
        value, gradient = gradient_of(points)
        step = np.full(points.shape, 0.05 * radius / np.abs(gradient).max())
        lowest = value
        for _ in range(steps):
            points = points - np.clip(step * gradient, -LONGEST * radius, LONGEST * radius)
            reach = np.hypot(points[:, 0], points[:, 1])
            points = points * np.minimum(1.0, radius / np.maximum(reach, 1e-300))[:, None]
            value, fresh = gradient_of(points)
            agreement = fresh * gradient
            step = step * np.where(agreement > 0, GROW, np.where(agreement < 0, SHRINK, 1.0))
            gradient, lowest = fresh, min(lowest, value)
        best[index] = np.exp(lowest)
    return best


class Watch:
    """Ends a search when it is there, or when its patience is over.

    Attributes
    ----------
    best : float
        Least value of a feasible layout so far.
    there : bool
    """

    def __init__(self, reference: float, patience: float) -> None:
        self.best, self._known, self._end = np.inf, reference, time.process_time() + patience

    @property
    def there(self) -> bool:
        """Whether the best value is near the best known one."""
        return self.best <= self._known * (1 + NEAR)

    def saw(self, values: Array) -> None:
        """Look at the values of feasible layouts; raises `StopIteration` at the end."""
        self.best = min(self.best, float(np.min(values, initial=np.inf)))
        if self.there or time.process_time() > self._end:
            raise StopIteration


def slsqp(objective: Objective, n: int, seed: int, watch: Watch) -> None:
    """SLSQP with the objective's gradient, in units of the radius, from one random layout after the other."""
    rng, region, radius = (
        np.random.default_rng(seed),
        FeasibleRegion(objective.setting.boundary),
        objective.setting.boundary.radius,
    )

    def value_and_gradient(flat: Array) -> tuple[float, Array]:
        values, gradient = objective.value_and_gradient(radius * flat.reshape(1, n, 2))
        watch.saw(values[np.linalg.norm(flat.reshape(1, n, 2), axis=-1).max(axis=-1) <= 1 + 1e-9])
        # The logarithm, as in our descent: SLSQP's tolerance is absolute, and would end a value of millimeters at once.
        return float(np.log(values[0])), radius * gradient.ravel() / float(values[0])

    room = {
        "type": "ineq",
        "fun": lambda flat: 1 - np.sum(flat.reshape(n, 2) ** 2, axis=-1),
        "jac": lambda flat: -2 * np.kron(np.eye(n), [[1.0, 1.0]]) * flat,
    }
    while True:
        start = region.sample(1, n, rng).ravel() / radius
        minimize(value_and_gradient, start, jac=True, method="SLSQP", constraints=[room], options={"maxiter": 300})


def evolution(objective: Objective, n: int, seed: int, watch: Watch) -> None:
    """Differential evolution over the square around the disk, the disk its constraint, a generation at once."""
    radius = objective.setting.boundary.radius

    def values(population: Array) -> Array:
        layouts = np.moveaxis(population.reshape(n, 2, -1), -1, 0)
        results = objective(radius * layouts)
        watch.saw(results[np.linalg.norm(layouts, axis=-1).max(axis=-1) <= 1 + 1e-9])
        return np.minimum(results, 1e6)

    room = NonlinearConstraint(lambda flat: np.sum(flat.reshape(n, 2, *flat.shape[1:]) ** 2, axis=1), -np.inf, 1.0)
    for attempt in range(1000):
        differential_evolution(
            values,
            Bounds(np.full(2 * n, -1.0), np.full(2 * n, 1.0)),
            constraints=room,
            maxiter=100_000,
            polish=False,
            vectorized=True,
            updating="deferred",
            rng=np.random.default_rng([seed, attempt]),
        )
