"""How reliably the search finds the best known optimum; bare points on the paper's disk, twenty seeds.

What this does not prove: that the best known optimum is the best there is.
"""

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import search

BARE = FeasibleRegion(Circle(0.15))
SEEDS = 20


def found(objective, n):
    return np.array([search(objective, BARE, n, np.random.default_rng(seed)).value for seed in range(SEEDS)])


@pytest.mark.long
@pytest.mark.parametrize("n", range(4, 13))
def test_pose(setting, n):
    objective = OBJECTIVES["pose"](setting)
    values = found(objective, n)
    assert values.max() <= 1.001 * min(values.min(), objective(regular_polygon(n, 0.15)[None])[0])


@pytest.mark.long
@pytest.mark.parametrize("n", range(4, 13))
def test_condition(setting, n):
    objective = OBJECTIVES["condition"](setting)
    values = found(objective, n)
    many = search(objective, BARE, n, np.random.default_rng(10_000), restarts=200).value
    best = min(values.min(), many, {4: 3.7315, 5: 3.0232, 6: 2.7680}.get(n, np.inf))
    assert np.sum(values <= 1.005 * best) >= 18
