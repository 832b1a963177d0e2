"""Levenberg-Marquardt for a batch of small least-squares problems, all of which step together.

A step s of each problem solves

    (J'WJ + lambda diag J'WJ) s = J'Wr

with r the residuals, J their derivative (of what is predicted, so that s lessens r), W their weights, and lambda
Marquardt's damping, which falls after a step that does not raise the cost r'Wr and grows after one that does and is
taken back. Problems leave the batch when they have converged.

A kind of problem is a subclass of `LeastSquares`: what it leaves over, with its derivative, how a step is
applied, and when it has converged.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Arrays = tuple[Array, ...]
"""Arrays whose first axis counts the problems of a batch."""

FACTOR = 10.0
"""What lambda is divided by after a good step and multiplied by after a bad one."""


@dataclass(frozen=True)
class Damping:
    """Marquardt's lambda and when a step counts as good.

    Attributes
    ----------
    start, least, most : float
        lambda to begin with and its bounds; a problem that would need more than `most` is given up as it stands.
    slack : float
        Share by which a good step may raise the cost: at the minimum two costs are equal but for rounding.
    ridge : float
        Share of the largest diagonal entry of J'WJ that is added to every one, so that directions which the residuals
        leave free stay where they are.
    """

    start: float = 1e-3
    least: float = 1e-10
    most: float = np.inf
    slack: float = 0.0
    ridge: float = 0.0


class Attempt(NamedTuple):
    """A step of k problems and what became of it.

    Attributes
    ----------
    step : array (k, p)
    tried, kept : tuple of array
        Unknowns after the step, and those after it where it was good, before it elsewhere.
    before, after, cost : arrays (k,)
        Cost before the step, of what was tried, and of what was kept.
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
    """A batch of k least-squares problems in p unknowns each, which may be any arrays, such as poses."""

    @abstractmethod
    def residuals(self, unknowns: Arrays) -> Arrays:
        """Cost r'Wr (k,), inf where the unknowns are not allowed; residuals; and whatever else `jacobian` uses.

        All have the problems as their first axis.
        """

    @abstractmethod
    def jacobian(self, unknowns: Arrays, found: Arrays) -> Array:
        """J (k, m, p), from the unknowns and what `residuals` found there."""

    def normal_equations(self, jacobian: Array, residual: Array) -> tuple[Array, Array]:
        """J'WJ (k, p, p) and J'Wr (k, p); all residuals (k, m) weigh the same unless a problem knows better."""
        return jacobian.swapaxes(-1, -2) @ jacobian, np.einsum("kij,ki->kj", jacobian, residual)

    @abstractmethod
    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """Unknowns after steps (k, p): the retraction."""

    @abstractmethod
    def converged(self, attempt: Attempt) -> Mask:
        """Tell which problems (k,) need no further step."""

    @abstractmethod
    def take(self, chosen: Mask) -> Self:
        """Return the chosen problems (k,)."""

    def worth_a_step(self, cost: Array) -> Mask:
        """Tell which problems (k,) are to be solved at all, by their cost at the start."""
        return np.ones(cost.shape, dtype=bool)


def levenberg_marquardt(problems: LeastSquares, unknowns: Arrays, damping: Damping, steps: int) -> tuple[Arrays, Array]:
    """Solve a batch of least-squares problems.

    Parameters
    ----------
    problems : LeastSquares
    unknowns : tuple of array
        Where to start.
    damping : Damping
    steps : int
        Most steps that any problem takes.

    Returns
    -------
    unknowns : tuple of array
        The best that each problem met.
    cost : array (k,)
    """
    parts = len(unknowns)
    current = (*unknowns, *problems.residuals(unknowns))
    ended, index = list(current[: parts + 1]), np.arange(len(current[0]))
    strength, going = np.full(len(index), damping.start), problems.worth_a_step(current[parts])
    for _ in range(steps):
        # Counted, which is the fastest way to ask for any and all: a few problems are solved within a millisecond.
        count = np.count_nonzero(going)
        if not count:
            break
        if count < len(index):
            ended = _stored(ended, index, current)
            index, strength, problems = index[going], strength[going], problems.take(going)
            current = tuple([each[going] for each in current])
        old, found = current[:parts], current[parts:]
        # Held until the next one is there: what is freed at once the system takes back, and gives again page by page.
        jacobian = problems.jacobian(old, found)
        step = _damped_step(*problems.normal_equations(jacobian, found[1]), strength, damping.ridge)
        tried = problems.moved(old, step)
        fresh = problems.residuals(tried)
        good = fresh[0] <= found[0] * (1 + damping.slack)
        weaker = np.maximum(strength / FACTOR, damping.least)
        if np.count_nonzero(good) == count:
            current, strength = (*tried, *fresh), weaker
        else:
            current = tuple([_each(good, *pair) for pair in zip((*tried, *fresh), current, strict=True)])
            strength = np.where(good, weaker, strength * FACTOR)
        going = ~problems.converged(Attempt(step, tried, current[:parts], found[0], fresh[0], current[parts], good))
        if damping.most < np.inf:
            going &= strength <= damping.most
    ended = _stored(ended, index, current)
    return tuple(ended[:parts]), ended[parts]


def _damped_step(normal: Array, gradient: Array, strength: Array, ridge: float) -> Array:
    """Solve (N + lambda diag N) s = g for s (k, p), with N (k, p, p) and g (k, p); N is overwritten."""
    count, size, _ = normal.shape
    diagonal = normal.reshape(count, size * size)[:, :: size + 1]  # a view
    if ridge:
        # The last term is for problems of which nothing at all is known.
        diagonal += diagonal * strength[:, None] + ridge * diagonal.max(axis=-1)[:, None] + 1e-300
    else:
        diagonal *= 1 + strength[:, None]
    return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0], dtype=float)


def _each(good: Mask, new: Array, old: Array) -> Array:
    """Take what is new where the step was good, else what is old."""
    while good.ndim < new.ndim:
        good = good[..., None]
    return np.where(good, new, old)


def _stored(ended: list[Array], index: NDArray[np.intp], current: Arrays) -> list[Array]:
    """Bring the problems `index` up to date in the arrays of all."""
    if len(index) == len(ended[0]):
        return [each.copy() for each in current[: len(ended)]]
    for whole, part in zip(ended, current, strict=False):
        whole[index] = part
    return ended
