"""The report holds all that it shows, says so where parts are missing, and lets nobody's text become its own."""

import json
from dataclasses import replace

import numpy as np
import pytest
from html_pages import check

from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import rms
from markergen.validation.report import html_report
from markergen.validation.report.plots import camera_centers
from markergen.validation.report.subject import value_text


def test_is_one_whole_page_that_loads_nothing_and_says_in_words_what_it_shows(html):
    found = check(html)
    assert len(found.of("svg")) >= 18
    assert len(found.scripts) == 1


def test_dome_has_every_pose_with_its_errors(html, results, few):
    (div,) = (attributes for attributes in check(html).of("div") if "data-dome" in attributes)
    poses = json.loads(div["data-dome"])["poses"]
    centers = np.column_stack([poses[axis] for axis in "xyz"])
    np.testing.assert_allclose(centers, camera_centers(few.poses), rtol=1e-3, atol=1e-4)
    for name, unit in (("rotation", "deg"), ("translation", "mm")):
        np.testing.assert_allclose(poses[name], results["expected"][f"{name}_{unit}"], rtol=1e-3)


def test_is_small_with_a_dozen_pictures(html):
    assert html.count(b"<img") == 12
    assert len(html) < 3_000_000


def test_foreign_text_stays_text(html):
    text = html.decode()
    assert text.count("<script") == 1
    assert "<img src=x" not in text
    # In the table of failures, the facts about the marker, and a picture's title.
    assert text.count("&lt;script&gt;alert(&#34;x&#34;)") >= 4


def test_same_results_give_the_same_words(results, hostile, few, pictures, budget, undrawn):
    page = html_report(results, hostile, few, pictures, budget)
    assert html_report(results, hostile, few, pictures, budget) == page


# Of a single plot, tests/presentation/test_plots.py proves the same.
@pytest.mark.long
def test_same_results_give_the_same_page_whatever_the_settings_of_matplotlib(
    html, results, hostile, few, pictures, budget
):
    import matplotlib

    with matplotlib.rc_context({"font.size": 20, "svg.hashsalt": "other", "axes.grid": False, "text.parse_math": True}):
        before = dict(matplotlib.rcParams)
        assert html_report(results, hostile, few, pictures, budget) == html
        assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("content", [{}, {"views": None, "budget": None, "estimators": {}, "comparisons": None}])
def test_without_results_there_is_still_a_marker_and_what_to_run(content, pentagon, few):
    text = html_report(content, pentagon, few).decode()
    for option in ("--runs 1000", "--views 100", "--print-sigma"):
        assert option in text
    noise = rms(pose_bounds(pentagon.xyz, few.camera, few.poses, 1.0).rotation_deg)
    assert f"{value_text(noise, 2)} deg" in text
    assert "of 1 px alone" in text


PARTS = (
    "criteria",
    "comparisons",
    "nees",
    "noise_px",
    "runs",
    "homography",
    "estimators",
    "bound",
    "budget",
    "views",
    "headline",
    "expected",
)


@pytest.mark.parametrize("part", PARTS)
def test_any_part_may_be_missing_or_null(part, results, pentagon, few, undrawn):
    without = {key: value for key, value in results.items() if key != part}
    page = html_report(without, pentagon, few)
    assert b"What to expect" in page
    assert html_report({**without, part: None}, pentagon, few) == page


def test_views_of_which_none_was_detected(results, pentagon, few, budget, undrawn):
    nothing = {"count": 0, **dict.fromkeys(["mean", "std", "rms", "median", "p95", "max"])}
    views = {
        **results["views"], "detected": 0, "rate": 0.0, "point_px": nothing, "uncorrected_px": nothing, "samples": [],
        "image_bound_px": None, "homography_px": nothing, "estimators": {}, "by_polar_angle": {}, "by_distance": {},
        "nees": {"count": 0, "mean": None, "interval": None, "coverage": None, "coverage_interval": None},
    }  # fmt: skip
    text = html_report({**results, "views": views}, pentagon, few, budget=budget).decode()
    assert f"0 of {views['count']} rendered views detected" in text


def test_bare_points_have_no_size_to_print(results, make_ngon, few, undrawn):
    points = make_ngon(5, 0.15, 0.0)
    text = html_report({**results, "views": None}, points, few).decode()
    assert "size to print" in text


def test_one_pose_is_enough(results, pentagon, few, undrawn):
    one = replace(few, poses=PoseDistribution("one", few.poses.rotation[[30]], few.poses.translation[[30]]))
    without = {**results, "views": None, "headline": None, "expected": None}
    assert "RMS over 1 poses" in html_report(without, pentagon, one).decode()
