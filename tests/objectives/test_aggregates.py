import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markergen.objectives.aggregates import AGGREGATES

values = arrays(float, (3, 7), elements=st.floats(0.1, 100))


@pytest.mark.parametrize("name", list(AGGREGATES))
@given(values)
def test_an_aggregate_lies_between_the_extremes(name, v):
    total, _ = AGGREGATES[name](v, 0.0)
    assert np.all(total >= v.min(-1) * (1 - 1e-12))
    assert np.all(total <= v.max(-1) * (1 + 1e-12))


@pytest.mark.parametrize("softness", [0.0, 0.1])
@pytest.mark.parametrize("name", list(AGGREGATES))
def test_derivatives_agree_with_differences(name, softness):
    v = np.random.default_rng(0).uniform(1, 2, (3, 7))
    along, step = np.random.default_rng(1).normal(size=v.shape), 1e-6
    numeric = (AGGREGATES[name](v + step * along, softness)[0] - AGGREGATES[name](v - step * along, softness)[0]) / (
        2 * step
    )
    np.testing.assert_allclose(np.sum(AGGREGATES[name](v, softness)[1] * along, -1), numeric, rtol=1e-6)


@given(values)
def test_the_softened_maximum_bounds_the_maximum(v):
    soft = AGGREGATES["max"](v, 0.05)[0]
    assert np.all(soft >= v.max(-1) * (1 - 1e-12))
    assert np.all(soft <= v.max(-1) * 7**0.05 * (1 + 1e-12))
