import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markergen.errors import InputError
from markergen.objectives.aggregates import AGGREGATES, aggregate_of

values = arrays(float, (3, 7), elements=st.floats(0.1, 100))
NAMES = [*AGGREGATES, "cvar:0", "cvar:0.5", "cvar:0.6", "cvar:0.99"]


@pytest.mark.parametrize("name", NAMES)
@given(values)
def test_an_aggregate_lies_between_the_extremes(name, v):
    total, _ = aggregate_of(name)(v, 0.0)
    assert np.all(total >= v.min(-1) * (1 - 1e-12))
    assert np.all(total <= v.max(-1) * (1 + 1e-12))


@pytest.mark.parametrize("softness", [0.0, 0.003, 0.1])
@pytest.mark.parametrize("name", NAMES)
def test_derivatives_agree_with_differences(name, softness):
    v = np.random.default_rng(0).uniform(1, 2, (3, 7))
    along, step = np.random.default_rng(1).normal(size=v.shape), 1e-6
    aggregate = aggregate_of(name)
    numeric = (aggregate(v + step * along, softness)[0] - aggregate(v - step * along, softness)[0]) / (2 * step)
    # At a softness of 0.003 powers of 333 bend within 1e-3 of a value: the differences are good to (1e-6/1e-3)^2.
    rtol = 1e-4 if softness == 0.003 else 1e-6
    np.testing.assert_allclose(np.sum(aggregate(v, softness)[1] * along, -1), numeric, rtol=rtol)


@given(values)
def test_the_softened_maximum_bounds_the_maximum(v):
    soft = AGGREGATES["max"](v, 0.05)[0]
    assert np.all(soft >= v.max(-1) * (1 - 1e-12))
    assert np.all(soft <= v.max(-1) * 7**0.05 * (1 + 1e-12))


@given(values, st.floats(0, 0.999))
def test_cvar_is_the_mean_of_the_worst(v, level):
    # By its other definition: the least of t + mean excess over t; it is reached at one of the values.
    worst = max((1 - level) * 7, 1)
    excess = np.maximum(v[:, None] - v[:, :, None], 0).sum(-1)
    expected = (v + excess / worst).min(-1)
    total, derivative = aggregate_of(f"cvar:{level!r}")(v, 0.0)
    np.testing.assert_allclose(total, expected, rtol=1e-12)
    np.testing.assert_allclose(derivative.sum(-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose((derivative * v).sum(-1), total, rtol=1e-12)


@given(values, st.floats(0, 0.999), st.sampled_from([0.1, 0.01, 0.001]))
def test_the_softened_cvar_bounds_cvar(v, level, softness):
    aggregate = aggregate_of(f"cvar:{level!r}")
    soft, derivative = aggregate(v, softness)
    hard = aggregate(v, 0.0)[0]
    # (v^(1/s) + t^(1/s))^s is at most 2^s times the larger of both, which is no more than the worst, and there are 7.
    assert np.all(soft >= hard * (1 - 1e-12))
    assert np.all(soft <= hard + (2**softness - 1) * 7 * v.max(-1) * (1 + 1e-9) + 1e-9)
    # It grows in proportion with the values.
    np.testing.assert_allclose(np.sum(derivative * v, -1), soft, rtol=1e-9)
    np.testing.assert_allclose(aggregate(3 * v, softness)[0], 3 * soft, rtol=1e-12)


def test_levels_of_cvar():
    v = np.arange(1.0, 11.0)[None]
    assert aggregate_of("cvar:0.8")(v, 0.0)[0][0] == pytest.approx(9.5)
    assert aggregate_of("cvar:0.75")(v, 0.0)[0][0] == pytest.approx((10 + 9 + 0.5 * 8) / 2.5)
    assert aggregate_of("cvar")(v, 0.0)[0][0] == 10
    assert aggregate_of("cvar:0")(v, 0.0)[0][0] == pytest.approx(5.5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("softness", [0.0, 0.01])
def test_what_is_determined_nowhere_is_infinite(name, softness):
    v = np.array([[1.0, 2.0, np.inf, 3.0]])
    with np.errstate(invalid="ignore"):
        assert np.isinf(aggregate_of(name)(v, softness)[0][0])


@pytest.mark.parametrize("name", ["cvar:", "cvar:1", "cvar:-0.1", "cvar:nan", "cvar:worst", "cvar:90"])
def test_a_wrong_level_is_told(name):
    with pytest.raises(InputError, match=r"to below 1, found '.*'; write cvar:0.9"):
        aggregate_of(name)


def test_unknown_aggregates_are_told():
    with pytest.raises(InputError, match="mean 'cvar'"):
        aggregate_of("cvr:0.9")
    with pytest.raises(InputError, match="only cvar has"):
        aggregate_of("max:0.9")


@pytest.mark.parametrize("softness", [0.0, 0.1])
@pytest.mark.parametrize("name", ["rms", "mean", "logmean", "cvar:0", "cvar:0.5"])
def test_a_pose_of_twice_the_weight_counts_like_two(name, softness):
    v, weight = np.random.default_rng(0).uniform(1, 2, (3, 7)), np.array([1.0, 2, 1, 1, 3, 1, 1])
    total, derivative = aggregate_of(name, weight)(v, softness)
    copies = np.repeat(np.arange(7), weight.astype(int))
    plain, item = aggregate_of(name)(v[:, copies], softness)
    np.testing.assert_allclose(total, plain, rtol=1e-12)
    together = np.stack([item[:, copies == i].sum(-1) for i in range(7)], axis=-1)
    np.testing.assert_allclose(derivative, together, rtol=1e-9)
