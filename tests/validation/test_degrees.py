import numpy as np
import pytest

from markergen.maths.rotation import exponential, rotation_z
from markergen.validation.degrees import (
    BINS,
    DEGREES,
    DegreeErrors,
    draw_degrees,
    in_units,
    pose_degrees,
    rank_correlations,
    standing_out,
)

RNG = np.random.default_rng(0)
FACING = np.diag([1.0, -1.0, -1.0])


def test_degrees_of_freedom_give_the_pose_back():
    tilt = np.deg2rad(RNG.uniform(-50, 50, (40, 2)))
    roll = RNG.uniform(-np.pi, np.pi, 40)
    place = RNG.normal(size=(40, 3))
    rotation = exponential(np.pad(tilt, ((0, 0), (0, 1)))) @ rotation_z(roll) @ FACING
    np.testing.assert_allclose(
        pose_degrees(rotation, place), np.column_stack([1e3 * place, np.rad2deg(tilt), np.rad2deg(roll)]), atol=1e-9
    )


def made(count, bias=0.0, scale=1.0):
    degrees = RNG.uniform(-1, 1, (count, 6))
    sigma = RNG.uniform(0.5, 2, (count, 6))
    return DegreeErrors(degrees, bias * degrees[:, [2]] + scale * sigma * RNG.standard_normal((count, 6)), sigma)


def test_right_covariances_leave_cells_at_one():
    summary = made(4000).summary()
    cells = summary["cells"]
    assert cells["count"] == 36 * BINS
    # 1/sqrt(2 n) is 0.032 for 500 views; 99 % of all cells are within their interval.
    assert 0.85 < cells["least"] < 1 < cells["greatest"] < 1.15
    assert cells["above"] + cells["below"] <= 12
    assert summary["standing_out"] == summary["chi_standing_out"] == []
    errors = summary["errors"]["Z, mm"]
    assert abs(errors["bias"]) < 4 * errors["bias_sigma"]
    assert errors["std"] == pytest.approx(errors["expected"], rel=0.05)


def test_covariances_that_claim_too_little_show_in_the_cells():
    cells = made(4000, scale=1.5).summary()["cells"]
    assert cells["above"] == cells["count"]


def test_a_bias_that_depends_on_the_pose_is_named():
    pairs = made(2000, bias=1.0).summary()["standing_out"]
    assert {pair["pose"] for pair in pairs} == {DEGREES[2]}
    assert len(pairs) == 6


def test_correlations_are_of_ranks_and_none_is_made_up():
    x = RNG.uniform(size=(500, 6))
    x[:, 3] = 7.0
    correlations = rank_correlations(x, np.exp(x))
    assert correlations[0, 0] == pytest.approx(1)
    assert not correlations[:, 3].any()
    assert not correlations[3].any()
    assert not standing_out(rank_correlations(x[:4], x[:4]), 4)
    # 200 series of 36 pairs that have nothing to do with each other: at 1 % of series, two.
    alarms = sum(bool(made(100).summary()["standing_out"]) for _ in range(200))
    assert alarms <= 8


def test_units_are_those_of_the_names():
    np.testing.assert_allclose(in_units(np.array([[0.01, 0, 0, 0.002, 0, 0]])), [[2, 0, 0, np.rad2deg(0.01), 0, 0]])


def test_plots_are_36_and_without_covariance_too():
    from matplotlib.figure import Figure

    for entry in (made(50), DegreeErrors(*(made(50).degrees,) * 2, np.full((50, 6), np.nan))):
        figure = Figure(figsize=(6, 6))
        draw_degrees(figure, entry)
        assert len(figure.axes) == 36
