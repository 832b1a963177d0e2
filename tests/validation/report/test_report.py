"""The report holds all that it shows, says so where parts are missing, and lets nobody's text become its own."""

import json
from dataclasses import replace

import numpy as np
import pytest
from html_pages import check

from markergen.estimators.budget import ErrorSources
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import budget_of
from markergen.validation.report import html_report
from markergen.validation.validation import run_validation
from markergen.validation.views import SyntheticViews


def test_is_one_whole_page_that_loads_nothing_and_says_in_words_what_it_shows(html):
    result = check(html)
    assert len(result.of("svg")) >= 18
    assert len(result.scripts) == 1


def test_dome_has_every_pose_with_its_errors(html, results, few):
    (div,) = (attributes for attributes in check(html).of("div") if "data-dome" in attributes)
    poses = json.loads(div["data-dome"])["poses"]
    centers = np.column_stack([poses[axis] for axis in "xyz"])
    np.testing.assert_allclose(centers, eyes_of(few.poses), rtol=1e-3, atol=1e-4)
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


def test_without_trials_and_views_there_is_still_a_marker_and_what_to_run(results, pentagon, few, budget):
    content = {**results, "runs": 0, "estimators": {}, "homography": {}, "nees": None, "views": None}
    text = html_report(content, pentagon, few, (), budget).decode()
    for option in ("--runs 1000", "--views 100"):
        assert option in text
    assert "good to 0.1 mm" in text


PARTS = {"comparisons": {}, "labels": None, "relative_error": None, "homography": {}, "noise_px": 0.0, "nees": None}
"""What a run may leave out, such as that of a relief, of bare points or without noise."""


@pytest.mark.parametrize("part", PARTS)
def test_parts_that_a_run_leaves_out_may_be_missing(part, results, pentagon, few, budget, undrawn):
    assert b"What to expect" in html_report({**results, part: PARTS[part]}, pentagon, few, (), budget)


def test_views_of_which_none_was_detected(results, pentagon, few, budget, undrawn):
    nothing = {"count": 0, **dict.fromkeys(["mean", "std", "rms", "median", "p95", "max"])}
    views = {
        **results["views"], "detected": 0, "rate": 0.0, "point_px": nothing, "uncorrected_px": nothing, "samples": [],
        "image_bound_px": None, "homography_px": nothing, "estimators": {}, "by_polar_angle": {}, "by_distance": {},
        "nees": {"count": 0, "mean": None, "interval": None, "coverage": None, "coverage_interval": None},
    }  # fmt: skip
    text = html_report({**results, "views": views}, pentagon, few, (), budget).decode()
    assert f"0 of {views['count']} rendered views detected" in text


def test_bare_points_have_no_size_to_print(results, make_ngon, few, budget, undrawn):
    points = make_ngon(5, 0.15, 0.0)
    text = html_report({**results, "views": None}, points, few, (), budget).decode()
    assert "size to print" in text


def test_one_pose_is_enough(pentagon, few, undrawn):
    one = replace(few, poses=PoseDistribution("one", few.poses.rotation[[30]], few.poses.translation[[30]]))
    series = SyntheticViews(pentagon, one.camera, one.poses, 0, errors=ErrorSources())
    results = run_validation(series, runs=0, workers=1)
    assert "RMS over 1 poses" in html_report(results, pentagon, one, (), budget_of(series)).decode()
