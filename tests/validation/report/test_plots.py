"""The report's plots draw what the results say."""

import html
import json
import re

import numpy as np
import pytest

from markergen.model.body import Plate
from markergen.model.occlusion import eyes_of
from markergen.model.poses import paper
from markergen.validation.report import measured
from markergen.validation.report.measured import carried_over, ranked, sample_pose_errors
from markergen.validation.report.plots import (
    QUANTILE_95,
    budget_over_tilt,
    compared,
    distribution,
    dome_plots,
    ellipse,
    errors_over,
    pose_sphere,
    share_inside,
    variance_shares,
)


def test_camera_centers_are_where_the_paper_puts_them(few):
    centers = eyes_of(few.poses)
    np.testing.assert_allclose(np.linalg.norm(centers, axis=-1), few.poses.distance)
    np.testing.assert_allclose(centers[:, 2], few.poses.distance * few.poses.cos_tilt, atol=1e-12)


def test_sphere_shows_every_pose_the_worst_on_top(pentagon, few, ax):
    values = np.arange(1.0, len(few.poses) + 1)
    values[3] = np.inf
    assert pose_sphere([], eyes_of(few.poses), values, "error", ax) is ax
    points = ax.collections[0]
    assert len(points.get_offsets()) == len(few.poses) - 1
    np.testing.assert_array_equal(points.get_array(), np.sort(values)[:-1])


def test_sphere_of_equal_errors(few, ax):
    pose_sphere([], eyes_of(few.poses), np.ones(len(few.poses)), "error", ax)
    assert len(set(map(tuple, ax.collections[0].get_facecolors()))) <= 1


def test_errors_over_tilt_draws_the_statistics(results, ax):
    measured_at = {
        name: {angle: group["rotation_deg"] for angle, group in row["by_polar_angle"].items()}
        for name, row in results["estimators"].items()
    }
    limits = {angle: row["rotation_deg"] for angle, row in results["bound"]["by_polar_angle"].items()}
    assert errors_over(measured_at, limits, ax) is ax
    drawn = {line.get_label(): line for line in ax.lines}
    np.testing.assert_allclose(drawn["LM, RMS"].get_xdata(), [0, 17.5, 35, 52.5, 70])
    np.testing.assert_allclose(drawn["bound (CRLB)"].get_ydata(), list(limits.values()))
    # In black and white, lines are distinguished by dashes and marks.
    looks = {(str(line.get_linestyle()), str(line._dash_pattern), line.get_marker()) for line in ax.lines}
    assert len(looks) == len(ax.lines)
    assert len(ax.collections) == 1


def test_distribution_is_the_share_below(ax):
    values, shares = ranked(np.array([3.0, 1.0, 2.0, 4.0]))
    assert (values.tolist(), shares.tolist()) == ([1, 2, 3, 4], [0.25, 0.5, 0.75, 1])
    distribution(None, {"detect": (values, shares)}, ax)
    np.testing.assert_allclose(ax.lines[-1].get_ydata(), [25, 50, 75, 100])


def test_drawn_errors_have_their_covariance(budget):
    errors = sample_pose_errors(budget.total[:2])
    np.testing.assert_array_equal(errors, sample_pose_errors(budget.total[:2]))
    for ours, wanted in zip(errors, budget.total[:2], strict=True):
        scale = np.sqrt(np.diag(wanted))
        sampled = np.cov(ours.T) / scale / scale[:, None]
        # 20000 draws: a correlation is off by 0.007, one sigma.
        np.testing.assert_allclose(sampled, wanted / scale / scale[:, None], atol=0.04)
    assert sample_pose_errors(np.full((3, 6, 6), np.inf)).shape == (0, 6)


def test_shares_of_the_bars_fill_them(results, ax):
    assert variance_shares(results["budget"], ax) is ax
    widths = np.array([bar.get_width() for bar in ax.patches]).reshape(2, 3)
    np.testing.assert_allclose(widths.sum(axis=1), 100)
    assert len({bar.get_hatch() for bar in ax.patches}) == 3


def test_total_over_tilt_is_the_root_of_the_squares(budget, few, ax):
    budget_over_tilt(budget, few.poses, "rotation_deg", ax)
    drawn = {line.get_label(): np.nan_to_num(line.get_ydata()) for line in ax.lines}
    total = np.sqrt(drawn["image noise"] ** 2 + drawn["print"] ** 2 + drawn["calibration"] ** 2)
    np.testing.assert_allclose(drawn["total"], total, rtol=1e-6)


def test_ellipse_holds_95_percent():
    matrix = np.array([[4.0, 1.0], [1.0, 1.0]])
    outline = ellipse(matrix)
    squared = np.einsum("ij,ij->i", outline, np.linalg.solve(matrix, outline.T).T)
    np.testing.assert_allclose(squared, QUANTILE_95**2)
    errors = np.random.default_rng(0).multivariate_normal([0, 0], matrix, 20_000)
    # Standard deviation of the share: 0.0015.
    assert share_inside(errors, matrix) == pytest.approx(0.95, abs=0.006)


def test_errors_are_carried_over_to_one_covariance():
    rng = np.random.default_rng(0)
    roots = rng.standard_normal((20_000, 2, 2))
    ours = roots @ roots.swapaxes(-1, -2) + 0.1 * np.eye(2)
    errors = (np.linalg.cholesky(ours) @ rng.standard_normal((len(ours), 2, 1)))[..., 0]
    target = np.array([[2.0, -0.5], [-0.5, 1.0]])
    # Standard deviation of an entry: about 0.02.
    np.testing.assert_allclose(np.cov(carried_over(errors, ours, target).T), target, atol=0.1)
    assert carried_over(np.zeros((0, 2)), np.zeros((0, 2, 2)), target).shape == (0, 2)


def test_dots_of_a_perfect_detector_lie_inside_as_they_should(subject, undrawn):
    caption = next(plot.caption for plot in measured.ellipses(subject).plots if "dot centers" in plot.caption)
    inside = float(re.search(r"([\d.]+) % lie inside", caption)[1])
    # 800 dots: one sigma is 0.8 %.
    assert inside == pytest.approx(95, abs=3)


def test_bars_of_the_comparison_are_the_bounds(ax):
    assert compared({"this marker": 0.7, "random": 2.0, "none": np.inf}, {"this marker": 0.8}, ax) is ax
    assert [bar.get_width() for bar in ax.patches] == [0.7, 2.0, 0.0]
    assert [text.get_text() for text in ax.texts] == ["0.700", "2.00", "unbounded"]
    np.testing.assert_allclose(ax.lines[0].get_xdata(), [0.8])


def test_dome_of_very_many_poses_keeps_the_hardest(pentagon, monkeypatch):
    monkeypatch.setattr("markergen.validation.report.plots._MOST_TO_TURN", 40)
    poses = paper()
    errors = {"rotation": np.ones(len(poses)), "translation": np.full(len(poses), np.inf)}
    errors["rotation"][[7, 11]] = 3.0, np.inf
    errors["translation"][13] = 1.0
    alone = Plate("marker", pentagon, ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0))
    rotated, *stills = dome_plots([alone], poses, errors, "nothing", [f"pose {k}" for k in range(len(poses))])
    data = json.loads(html.unescape(rotated.markup.split("'")[1]))
    assert [set(item) for item in data["dots"]] == 5 * [{"x", "y", "z", "diameter", "normal"}]
    assert {"pose 0", "pose 7", "pose 13", "pose 390"} <= set(data["poses"]["words"])
    assert len(data["poses"]["x"]) == len(data["poses"]["translation"]) == 42
    assert data["poses"]["rotation"].count(3.0) == 1
    assert "42 of 400 poses" in rotated.caption
    assert 'larger: 1.0 to 3.0 deg."' in stills[0].markup
