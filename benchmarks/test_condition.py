"""Value and gradient of the condition number for 10 layouts in 400 poses, beside numpy's batched eigh, the floor."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import matrices
from markergen.objectives import OBJECTIVES, Setting

LAYOUTS, GROUP = 10, "value and gradient of c(A), 10 layouts x 400 poses, n = {}"

every_n = pytest.mark.parametrize("n", [4, 8, 12])


@every_n
def test_ours(compare: Callable[..., Any], setting: Setting, n: int) -> None:
    objective = OBJECTIVES["condition"](setting)
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (LAYOUTS, n, 2))
    compare(GROUP.format(n), lambda: objective.value_and_gradient(points), rounds=20)


@every_n
def test_floor_of_eigh(compare: Callable[..., Any], setting: Setting, n: int) -> None:
    normal = matrices(LAYOUTS * len(setting.poses))
    compare(GROUP.format(n), lambda: np.linalg.eigh(normal), rounds=20)
