"""Pages escape what they are given, and pictures in them look as they did."""

import base64
import doctest
import json
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from html_pages import check

from markergen.errors import InputError
from markergen.presentation import pages
from markergen.presentation.pages import Section
from markergen.presentation.tables import Table

ROOT = Path(__file__).parents[2]


def test_what_a_page_is_given_stays_text_and_empty_sections_are_left_out():
    rows = Table("<i>", ["<i>"], [["<i>"]], "<i>")
    section = Section(
        ["<i>"],
        [],
        [rows],
        "<i>",
        ["<i>"],
        [("<i>", "<i>")],
        "<i>",
        [("<i>", Section())],
        [],
        book=("<i>", "validate.md"),
    )
    made = pages.page("<i>", "<i>", [("a", "<i>", section), ("b", "gone", None)], "<i>", "\ud800")
    result = check(made)
    assert not result.of("i")
    assert b"&lt;i&gt;" in made
    assert result.sections == ("a",)


def test_the_address_of_the_book_is_that_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["urls"]["Documentation"].replace("/tree/", "/blob/") + "/" == pages.BOOK


def test_a_dome_holds_numbers_and_what_is_unknown_is_null():
    centers = np.array([[0.0, 0.0, 1.0], [0.123456, 0.0, 1.0]])
    errors = {"rotation": np.array([np.inf, 0.123456])}
    square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    made = pages.dome_figure(
        centers, errors, [square], [{"x": 0, "y": 0, "diameter": 1}], "</script>'", ["</script>'", ""]
    )
    section = Section(plots=[made])
    (div,) = (
        item for item in check(pages.page("h", "t", [("a", "A", section)], "s", "n")).of("div") if "data-dome" in item
    )
    data = json.loads(div["data-dome"])
    assert data["poses"] == {
        "x": [0, 0.1235], "y": [0, 0], "z": [1, 1], "rotation": [None, 0.1235], "words": ["</script>'", ""]
    }  # fmt: skip
    assert data["room"]["outlines"] == [square.tolist()]


def test_picture_without_noise_stays_as_it_is():
    png = bytes(cv2.imencode(".png", np.full((48, 64), 200, np.uint8))[1])
    assert base64.b64decode(pages.data_uri(png).removeprefix("data:image/png;base64,")) == png


def test_noisy_picture_is_kept_as_it_looks():
    noisy = np.clip(np.random.default_rng(0).normal(200, 2, (480, 640)), 0, 255).astype(np.uint8)
    png = bytes(cv2.imencode(".png", noisy)[1])
    uri = pages.data_uri(png)
    kept = cv2.imdecode(np.frombuffer(base64.b64decode(uri.removeprefix("data:image/jpeg;base64,")), np.uint8), 0)
    # The noise has a standard deviation of 2; what compression changes is less than that.
    assert np.std(kept.astype(float) - noisy) < 2
    assert len(uri) < len(png)


def test_a_page_is_named_so_that_a_browser_opens_it():
    pages.check_page(Path("Report.HTML"))
    with pytest.raises(InputError, match=r"expected a page \.html, found .*report\.pdf"):
        pages.check_page(Path("report.pdf"))


def test_the_examples_run():
    assert doctest.testmod(pages).failed == 0
