import csv
import io

import numpy as np
import pytest
from sentences import sentence

from markergen.presentation.tables import csv_bytes
from markergen.studies.cells import Cell
from markergen.studies.sweep.grid import KEYS, sweep_from_mapping
from markergen.studies.sweep.run import (
    ALL,
    COLUMNS,
    DIGITS,
    ERROR,
    mean_square_interval,
    table_columns,
    table_rows,
    trials_cell,
    work,
)
from markergen.validation.metrics import statistics
from markergen.validation.trials import PoseErrors

FEW = "cone:distance=0.6..1m,tilt=0..60,count=8,seed=1"


def table_of(sweep):
    result = []
    for point in sweep.points:
        layout = work(Cell("layout", {"spec": point.spec.as_dict(), "layout": point.layout}))
        trials = None if ERROR in layout else work(trials_cell(point, layout["points"], sweep.runs))
        result += table_rows(sweep, point, layout, trials)
    return result


def test_the_interval_holds_the_mean_square_as_often_as_it_says():
    """Of 2000 experiments at 10 poses of different noise 95 % do; the normal interval lacks about 1 % at 40 trials."""
    rng, sigma, held = np.random.default_rng(0), np.linspace(0.5, 3, 10), 0
    for _ in range(2000):
        squares = (sigma[:, None] * rng.standard_normal((10, 40))) ** 2
        _, low, high = mean_square_interval(np.full(10, 40), squares.sum(axis=1), (squares**2).sum(axis=1))
        held += low <= np.mean(sigma**2) <= high
    # The spread of such a share is 0.5 %.
    assert held / 2000 == pytest.approx(0.94, abs=0.02)


def test_the_interval_of_nothing_and_of_single_trials():
    zero = np.zeros(3)
    assert np.isnan(mean_square_interval(zero, zero, zero)).all()
    mean, low, high = mean_square_interval(np.ones(3), np.arange(3.0), np.arange(3.0) ** 2)
    assert mean == 1
    assert np.isnan([low, high]).all()


def test_sums_give_the_same_statistics_as_the_trials_themselves():
    from markergen.studies.sweep.run import _sums

    rng = np.random.default_rng(0)
    rotation, failed = rng.random((5, 9)), rng.random((5, 9)) < 0.2
    rotation[failed] = np.nan
    sums = _sums(PoseErrors(rotation, rotation, rotation, rotation, failed, ~failed & (rotation > 0.9)))
    mean, _, _ = mean_square_interval(sums["kept"], sums["rotation_deg.squares"], sums["rotation_deg.fourth_powers"])
    assert np.sqrt(mean) == pytest.approx(statistics(rotation[~failed])["rms"], rel=1e-12)
    assert sums["kept"].sum() + sums["failed"].sum() == 45


def test_there_is_a_row_for_every_point_polar_angle_and_estimator():
    sweep = sweep_from_mapping(
        {
            "dot": "30mm",
            "poses": FEW,
            "study": {"runs": 3, "estimators": ["dlt", "lm"]},
            "grid": {"n": [4, 6], "layout": ["ngon", "square"], "noise": [0.1, 0.2]},
        }
    )
    table = table_of(sweep)
    # Eight poses at as many polar angles, and all of them together.
    assert len(table) == 2 * 2 * 2 * (1 + 8) * 2
    header, *lines = csv.reader(io.StringIO(csv_bytes(table, table_columns(sweep), DIGITS).decode()))
    assert header == table_columns(sweep)
    assert len(set(header)) == len(header)
    assert all(len(line) == len(header) for line in lines)
    row = next(row for row in table if row["polar_angle_deg"] == ALL and row["estimator"] == "lm")
    assert (row["n"], row["layout"], row["control_points"], row["pose_count"], row["trials"]) == ("4", "ngon", 4, 8, 24)
    assert {row["control_points"] for row in table if row["layout"] == "square"} == {4}
    # Criteria are for the noise of the row; c(A) does not depend on it.
    first, second = (
        next(row for row in table if row["n"] == "4" and row["layout"] == "ngon" and row["noise"] == noise)
        for noise in ("0.1", "0.2")
    )
    assert second["criterion_pose_mm"] == pytest.approx(2 * first["criterion_pose_mm"], rel=1e-12)
    assert second["criterion_condition"] == first["criterion_condition"]


def test_the_maximum_likelihood_estimator_is_at_its_bound():
    values = {"dot": "30mm", "poses": FEW, "study": {"runs": 100, "estimators": ["lm"]}, "grid": {"layout": ["ngon"]}}
    row = table_of(sweep_from_mapping(values))[0]
    assert row["rotation_low_deg"] < row["rotation_rms_deg"] < row["rotation_high_deg"]
    # The RMS of 800 trials of three parameters that are about Gaussian is good to some 2 %, three times which is 6 %.
    assert row["rotation_rms_deg"] == pytest.approx(row["rotation_bound_deg"], rel=0.06)
    assert row["translation_rms_pct"] == pytest.approx(row["translation_bound_pct"], rel=0.1)
    assert row["flips"] == row["failures"] == 0


def test_no_axis_has_the_name_of_another_column():
    assert set(KEYS) & set(COLUMNS) == {"layout"}


def test_without_runs_there_are_the_bounds():
    sweep = sweep_from_mapping(
        {"dot": "30mm", "poses": FEW, "study": {"runs": 0}, "grid": {"n": [4], "layout": ["ngon"]}}
    )
    table = table_of(sweep)
    assert {row.get("estimator", "") for row in table} == {""}
    assert all(row["rotation_bound_deg"] > 0 for row in table)


def test_what_cannot_be_computed_is_a_row_that_says_why():
    """Seven dots of 95 mm fit into the disk, one in the middle, but not as a heptagon."""
    values = {"dot": "95mm", "clearance": 0, "poses": FEW, "study": {"runs": 2}, "grid": {"n": [7], "layout": ["ngon"]}}
    (row,) = table_of(sweep_from_mapping(values))
    assert row["error"] == sentence("no room for", "ngon")
    assert "rotation_rms_deg" not in row


def test_a_relief_has_no_homography():
    values = {"poses": FEW, "dot": "20mm", "restarts": 1, "study": {"runs": 3}, "grid": {"n": [6], "relief": ["20mm"]}}
    table = table_of(sweep_from_mapping(values))
    assert {row["estimator"] for row in table} == {"epnp", "lm", "sqpnp"}
    assert not any("criterion_homography_px" in row or "homography_rms_px" in row for row in table)
