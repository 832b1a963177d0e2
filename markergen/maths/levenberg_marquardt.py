"""Levenberg-Marquardt for a batch of small least-squares problems that step together.

A step s of each problem solves

    (J'WJ + lambda diag J'WJ) s = J'Wr

with r the residuals (measured minus predicted), J the derivative of the predicted values, W the weights, and lambda
Marquardt's damping, which falls after a step that does not raise the cost r'Wr and grows after a step that does and is
undone. Problems leave the batch when they have converged.

A kind of problem is a subclass of `LeastSquares` that defines the residuals and their derivative, how a step is
applied, and the test of convergence.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask

Arrays = tuple[Array, ...]
"""Arrays whose first axis is the problem of the batch."""

FACTOR = 10.0
"""Factor by which lambda falls after a good step and grows after a bad one."""


@dataclass(frozen=True)
class Damping:
    """Damping schedule, and the criterion for a good step.

    Attributes
    ----------
    start, least, most : float
        Initial lambda and its bounds; a problem that would need more than `most` is abandoned where it is.
    slack : float
        Relative increase of the cost that a good step may have: at the minimum, costs differ only by rounding.
    ridge : float
        Fraction of the largest diagonal entry of J'WJ added to every diagonal entry, so that directions not
        constrained by the residuals do not move.
    """

    start: float = 1e-3
    least: float = 1e-10
    most: float = np.inf
    slack: float = 0.0
    ridge: float = 0.0


class Attempt(NamedTuple):
    """One step of k problems and its outcome.

    Attributes
    ----------
    step : array (k, p)
    tried, kept : tuple of array
        Unknowns after the step; the unknowns retained: `tried` where the step was good, the previous ones elsewhere.
    before, after, cost : arrays (k,)
        Cost before the step, cost of `tried`, and cost of `kept`.
    good : array (k,) of bool
    """

    step: Array
    tried: Arrays
    kept: Arrays
    before: Array
    after: Array
    cost: Array
    good: Mask


class LeastSquares(ABC):
    """A batch of k least-squares problems with p parameters each; the unknowns may be any arrays, such as poses."""

    @abstractmethod
    def residuals(self, unknowns: Arrays) -> Arrays:
        """Cost r'Wr (k,), inf for inadmissible unknowns; residuals; and anything else that `jacobian` needs.

        The first axis of each is the problem.
        """

    @abstractmethod
    def jacobian(self, unknowns: Arrays, results: Arrays) -> Array:
        """J (k, m, p), from the unknowns and the result of `residuals` there."""

    def normal_equations(self, jacobian: Array, residual: Array) -> tuple[Array, Array]:
        """J'WJ (k, p, p) and J'Wr (k, p) for residuals (k, m), with W = 1 unless overridden."""
        return jacobian.swapaxes(-1, -2) @ jacobian, np.einsum("kij,ki->kj", jacobian, residual)

    def damped_step(self, jacobian: Array, residual: Array, strength: Array, ridge: float) -> Array:
        """Solve for the steps (k, p) with Marquardt's damping (k,) and a ridge; see `Damping`."""
        return _damped_step(*self.normal_equations(jacobian, residual), strength, ridge)

    @abstractmethod
    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """Apply steps (k, p) to the unknowns: the retraction."""

    @abstractmethod
    def converged(self, attempt: Attempt) -> Mask:
        """Mask (k,) of the problems that need no further step."""

    @abstractmethod
    def take(self, chosen: Mask) -> Self:
        """Return the chosen problems (k,)."""

    def worth_a_step(self, cost: Array) -> Mask:
        """Mask (k,) of the problems to be solved at all, judged by their initial cost."""
        return np.ones(cost.shape, dtype=bool)


def levenberg_marquardt(problems: LeastSquares, unknowns: Arrays, damping: Damping, steps: int) -> tuple[Arrays, Array]:
    """Solve a batch of least-squares problems.

    Parameters
    ----------
    unknowns : tuple of array
        Initial values.
    steps : int
        Maximum number of steps.

    Returns
    -------
    unknowns : tuple of array
        Best values found for each problem.
    cost : array (k,)
    """
    parts = len(unknowns)
    current = (*unknowns, *problems.residuals(unknowns))
    ended, index = list(current[: parts + 1]), np.arange(len(current[0]))
    strength, going = np.full(len(index), damping.start), problems.worth_a_step(current[parts])
    for _ in range(steps):
        # Counting is the fastest test for both any and all, and small batches take only a millisecond.
        count = np.count_nonzero(going)
        if not count:
            break
        if count < len(index):
            ended = _stored(ended, index, current)
            index, strength, problems = index[going], strength[going], problems.take(going)
            current = tuple([values[going] for values in current])
        old, results = current[:parts], current[parts:]
        # Kept until the next Jacobian exists: freed earlier, its memory would go back to the system, page by page.
        jacobian = problems.jacobian(old, results)
        step = problems.damped_step(jacobian, results[1], strength, damping.ridge)
        tried = problems.moved(old, step)
        fresh = problems.residuals(tried)
        good = fresh[0] <= results[0] * (1 + damping.slack)
        weaker = np.maximum(strength / FACTOR, damping.least)
        if np.count_nonzero(good) == count:
            current, strength = (*tried, *fresh), weaker
        else:
            current = tuple([_each(good, *pair) for pair in zip((*tried, *fresh), current, strict=True)])
            strength = np.where(good, weaker, strength * FACTOR)
        going = ~problems.converged(Attempt(step, tried, current[:parts], results[0], fresh[0], current[parts], good))
        if damping.most < np.inf:
            going &= strength <= damping.most
    ended = _stored(ended, index, current)
    return tuple(ended[:parts]), ended[parts]


def _damped_step(normal: Array, gradient: Array, strength: Array, ridge: float) -> Array:
    """Solve (N + lambda diag N) s = g for s (k, p), with N (k, p, p) and g (k, p); N is overwritten."""
    count, size, _ = normal.shape
    diagonal = normal.reshape(count, size * size)[:, :: size + 1]  # a view
    if ridge:
        # The last term keeps a matrix of zeros regular.
        diagonal += diagonal * strength[:, None] + ridge * diagonal.max(axis=-1)[:, None] + 1e-300
    else:
        diagonal *= 1 + strength[:, None]
    return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0], dtype=float)


def _each(good: Mask, new: Array, old: Array) -> Array:
    """Return `new` where the step was good, else `old`."""
    while good.ndim < new.ndim:
        good = good[..., None]
    return np.where(good, new, old)


def _stored(ended: list[Array], index: NDArray[np.intp], current: Arrays) -> list[Array]:
    """Store the current values of the problems `index` in the arrays of the whole batch."""
    if len(index) == len(ended[0]):
        return [values.copy() for values in current[: len(ended)]]
    for whole, part in zip(ended, current, strict=False):
        whole[index] = part
    return ended
