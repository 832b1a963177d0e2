"""The descent of c(A) in one pose, beside autograd through the SVD on one layout at a time, the way of the paper.

Both do as many steps by the same rule from the same 200 starts; the floor is numpy's batched eigh of as many matrices.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import RADIUS, matrices
from benchmarks.peers import autograd_condition, descend_one_by_one
from markergen.arrays import Array
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import descend

STARTS, STEPS, GROUP = 200, 40, "descent of c(A), 200 starts x 40 steps, n = {}"

every_n = pytest.mark.parametrize("n", range(4, 9))


def starts_of(setting: Setting, n: int, count: int = STARTS) -> Array:
    return FeasibleRegion(setting.boundary).sample(count, n, np.random.default_rng(n))


def ours(setting: Setting, starts: Array, steps: int = STEPS) -> Array:
    objective = OBJECTIVES["condition"](setting, aggregate="mean")
    return descend(objective, FeasibleRegion(setting.boundary), starts, steps=steps, patience=steps + 1).values


@every_n
def test_ours(compare: Callable[..., Any], one_pose: Setting, n: int) -> None:
    compare(GROUP.format(n), partial(ours, one_pose, starts_of(one_pose, n)))


@every_n
def test_autograd(compare: Callable[..., Any], one_pose: Setting, n: int) -> None:
    gradient, starts = autograd_condition(one_pose), starts_of(one_pose, n)
    compare(GROUP.format(n), partial(descend_one_by_one, gradient, starts, STEPS, RADIUS), rounds=2)


@every_n
def test_floor_of_eigh(compare: Callable[..., Any], n: int) -> None:
    normal = matrices(STARTS)
    compare(GROUP.format(n), lambda: [np.linalg.eigh(normal) for _ in range(STEPS + 1)])


@every_n
def test_both_end_at_the_same_value(one_pose: Setting, n: int) -> None:
    # At kinks of c(A) rounding decides which way a single descent goes; what the paper takes is the best of them.
    starts = starts_of(one_pose, n, 40)
    best = descend_one_by_one(autograd_condition(one_pose), starts, 300, RADIUS).min()
    assert ours(one_pose, starts, 300).min() == pytest.approx(best, rel=1e-3)
