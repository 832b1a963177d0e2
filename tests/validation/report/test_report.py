"""The report holds all that it shows, says so where parts are missing, and lets nobody's text become its own."""

import importlib.resources
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import rms
from markergen.validation.report import TEMPLATE, html_report
from markergen.validation.report.subject import number


class Page(HTMLParser):
    """Elements of a page, and whether each was closed where it should be."""

    VOID = frozenset({"meta", "img", "br", "link", "hr"})

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.texts = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_is_one_whole_page_that_loads_nothing(html):
    text = html.decode()
    found = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert not found.open
    assert ("html", {"lang": "en"}) in found.elements
    tags = {tag for tag, _ in found.elements}
    assert not tags & {"script", "link", "iframe", "object", "embed", "base", "form"}
    for tag, attributes in found.elements:
        assert not [name for name in attributes if name.startswith("on")]
        for name in ("src", "href", "xlink:href"):
            if name in attributes:
                assert attributes[name].startswith("data:image/" if tag in ("img", "image") else "#")
    assert "@import" not in text
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_ids_are_unique_and_what_is_referred_to_is_there(html):
    elements = Page(html.decode()).elements
    ids = [attributes["id"] for _, attributes in elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    referred = {value[1:] for _, a in elements for key, value in a.items() if key.endswith("href") and value[0] == "#"}
    referred |= {a["aria-labelledby"] for _, a in elements if "aria-labelledby" in a}
    referred |= set(re.findall(r"url\(#([^)]*)\)", html.decode()))
    assert referred <= set(ids)


def test_says_in_words_what_it_shows(html):
    elements = Page(html.decode()).elements
    drawings = [attributes for tag, attributes in elements if tag == "svg"]
    assert len(drawings) >= 20
    assert all(len(each["aria-label"]) > 20 and each["role"] == "img" for each in drawings)
    assert all(attributes["alt"] for tag, attributes in elements if tag == "img")
    assert all(attributes.get("scope") in ("col", "row") for tag, attributes in elements if tag == "th")


def test_is_small_with_a_dozen_pictures(html):
    assert html.count(b"<img") == 12
    assert len(html) < 3_000_000


def test_foreign_text_stays_text(html):
    text = html.decode()
    assert "<script" not in text
    assert "<img src=x" not in text
    # In the table of failures, the facts about the marker, and a picture's title.
    assert text.count("&lt;script&gt;alert(&#34;x&#34;)") >= 4


def test_same_results_give_the_same_page_whatever_the_settings_of_matplotlib(
    html, results, hostile, few, pictures, budget
):
    import matplotlib

    with matplotlib.rc_context({"font.size": 20, "svg.hashsalt": "other", "axes.grid": False, "text.parse_math": True}):
        before = dict(matplotlib.rcParams)
        assert html_report(results, hostile, few, pictures, budget) == html
        assert dict(matplotlib.rcParams) == before


def test_template_is_part_of_the_package():
    assert (importlib.resources.files("markergen.validation.report") / TEMPLATE).is_file()


@pytest.mark.parametrize("content", [{}, {"views": None, "budget": None, "estimators": {}, "comparisons": None}])
def test_without_results_there_is_still_a_marker_and_what_to_run(content, pentagon, few):
    text = html_report(content, pentagon, few).decode()
    for option in ("--runs 1000", "--views 100", "--print-sigma"):
        assert option in text
    noise = rms(pose_bounds(pentagon.xyz, few.camera, few.poses, 1.0).rotation_deg)
    assert f"{number(noise, 2)} deg" in text
    assert "image noise of 1 px alone" in text


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
def test_any_part_may_be_missing_or_null(part, results, pentagon, few, quick):
    without = {key: value for key, value in results.items() if key != part}
    page = html_report(without, pentagon, few)
    assert b"What to expect" in page
    assert html_report({**without, part: None}, pentagon, few) == page


def test_views_of_which_none_was_detected(results, pentagon, few, budget, quick):
    nothing = {"count": 0, **dict.fromkeys(["mean", "std", "rms", "median", "p95", "max"])}
    views = {
        **results["views"], "detected": 0, "rate": 0.0, "point_px": nothing, "uncorrected_px": nothing, "samples": [],
        "image_bound_px": None, "homography_px": nothing, "estimators": {}, "by_polar_angle": {}, "by_distance": {},
        "nees": {"count": 0, "mean": None, "interval": None, "coverage": None, "coverage_interval": None},
    }  # fmt: skip
    text = html_report({**results, "views": views}, pentagon, few, budget=budget).decode()
    assert f"0 of {views['count']} rendered views detected" in text


def test_bare_points_have_no_size_to_print(results, make_ngon, few, quick):
    points = make_ngon(5, 0.15, 0.0)
    text = html_report({**results, "views": None}, points, few).decode()
    assert "no size to print" in text


def test_one_pose_is_enough(results, pentagon, few, quick):
    one = replace(few, poses=PoseDistribution("one", few.poses.rotation[[30]], few.poses.translation[[30]]))
    without = {**results, "views": None, "headline": None, "expected": None}
    assert "Over all 1 poses" in html_report(without, pentagon, one).decode()
