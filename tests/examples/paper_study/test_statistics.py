import numpy as np
import pytest
from markergen_paper.statistics import (
    NOTHING,
    above,
    below,
    falling,
    majority,
    never,
    rank_correlation,
    row_means,
    within,
)

RNG = np.random.default_rng(0)


def test_a_shift_is_found_in_its_direction_only():
    values = RNG.normal(1, 1, 200)
    result = above(values)
    assert result.holds
    assert not result.refuted
    assert result.low < result.value < result.high
    assert result.value == np.median(values)
    assert above(-values).refuted
    assert below(-values).holds
    assert above(values, 2).refuted


def test_nothing_is_found_in_nothing():
    for result in (above(np.array([])), above(np.full(9, np.nan)), above(np.zeros(50)), above(np.array([1.0]))):
        assert not result.holds
        assert not result.refuted
    assert falling(np.full((5, 3), np.nan)) == NOTHING
    assert majority(0, 0) == never(0, 0) == NOTHING


def test_chance_is_not_taken_for_more():
    """At a level of 1e-5 five hundred tests of nothing find 0.005; more than one have a chance of 1e-5."""
    rng = np.random.default_rng(3)
    assert sum(above(rng.normal(size=40)).holds for _ in range(500)) <= 1


def test_few_values_that_all_agree_are_enough():
    """Twenty of one sign have a chance of 2^-20, below the level; an approximation by a normal would say 4e-5."""
    assert above(np.linspace(1, 2, 20)).p == pytest.approx(2.0**-20)
    assert above(np.linspace(1, 2, 20)).holds
    assert not above(np.linspace(1, 2, 15)).holds


def test_means_of_rows_leave_out_what_is_not_finite():
    results = row_means(np.array([[1.0, np.nan, 3.0], [np.nan, np.inf, np.nan]]))
    assert results[0] == 2
    assert np.isnan(results[1])


def test_the_interval_of_a_median_holds_it_as_often_as_it_says():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(500):
        result = above(rng.exponential(size=61))
        inside += result.low <= np.log(2) <= result.high
    # 99 % or a little more, because ranks are whole; 484 lies five standard deviations below.
    assert inside >= 484


def test_equality_wants_both_sides():
    nearby = RNG.normal(0, 0.01, 200)
    assert within(nearby, 0.05).holds
    assert within(nearby + 0.2, 0.05).refuted
    assert within(nearby - 0.2, 0.05).refuted
    wide = within(RNG.normal(0, 1, 20), 0.05)
    assert not wide.holds
    assert not wide.refuted


def test_shares():
    assert majority(95, 100).holds
    assert majority(5, 100).refuted
    assert majority(95, 100).low < 0.95 < majority(95, 100).high
    assert not majority(52, 100).holds
    assert never(0, 100).holds
    assert never(1, 10**6).refuted


def test_a_trend_is_found_in_its_direction_only():
    rows = np.arange(5.0)[::-1] + RNG.normal(0, 0.5, (50, 5))
    assert falling(rows).holds
    assert falling(-rows).refuted
    assert falling(rows).value == np.median(rows[:, 0] - rows[:, -1])
    assert not falling(RNG.normal(size=(50, 5))).holds


def test_rank_correlation_by_rows():
    first = RNG.normal(size=(4, 30))
    second = np.stack([np.exp(first[0]), -first[1], np.full(30, 1.0), np.where(np.arange(30) < 3, first[3], np.nan)])
    results = rank_correlation(first, second)
    assert results[:2] == pytest.approx([1, -1])
    assert np.isnan(results[2:]).all()


def test_a_majority_may_be_asked_to_be_large():
    assert majority(400, 400, 0.95).holds
    assert not majority(200, 200, 0.95).holds  # 0.95**200 is 3.5e-5
    assert majority(340, 400, 0.95).refuted
    assert not majority(375, 400, 0.95).refuted
