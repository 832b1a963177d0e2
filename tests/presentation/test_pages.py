"""Pages escape what they are given, and pictures in them look as they did."""

import base64
import doctest
from pathlib import Path

import cv2
import jinja2
import numpy as np
import pytest

from markergen.errors import InputError
from markergen.presentation import pages


def test_values_are_escaped_and_none_is_forgotten():
    assert pages.page_bytes("{% if a %}\n<p>{{ a }}</p>\n{% endif %}\n", {"a": "<b>\ud800"}) == b"<p>&lt;b&gt;?</p>\n"
    with pytest.raises(jinja2.UndefinedError):
        pages.page_bytes("{{ missing }}", {})


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
