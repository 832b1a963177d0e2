"""How the studio looks: for everyone, in both themes, on a phone, on paper."""

import re
import shutil
import subprocess
import sys
from importlib.resources import files

import numpy as np
import pytest
from sentences import sentence

from tests.support.studio import PLATE, Studio, link_of, obstacles, uploads

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everyone_can_use_it(address, opened, scheme):
    with opened(address, lambda url: url.startswith((address, "blob:")), color_scheme=scheme, bypass_csp=True) as page:
        page.wait_for_selector("body[data-rested]", timeout=60_000)
        page.click("#table summary")
        assert obstacles(page) == []
        page.select_option("#theme", "light" if scheme == "dark" else "dark")
        assert obstacles(page) == []
        page.set_viewport_size({"width": 400, "height": 800})
        assert obstacles(page) == []


def test_a_phone_shows_it_without_scrolling_sideways(address, opened):
    allowed = lambda url: url.startswith((address, "blob:"))  # noqa: E731
    with opened(address, allowed, viewport={"width": 400, "height": 800}, has_touch=True) as page:
        page.wait_for_selector("body[data-rested]", timeout=60_000)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= 400
        first = page.locator("#canvas svg").bounding_box()
        assert first["width"] >= 330


OVERLAPPING = "0mm,0mm; 1mm,0mm; 2mm,0mm; 3mm,0mm; 4mm,0mm; 60mm,60mm"


def test_of_many_problems_the_first_are_told_and_everyone_can_read_them(address, opened):
    state = {"points": OVERLAPPING, "dot": "20mm"}
    with opened(link_of(state, address), lambda url: url.startswith((address, "blob:")), bypass_csp=True) as page:
        Studio(page).settle()
        message = page.locator("#problems li").all_inner_texts()
        assert len(message) == 6
        assert message[0] == sentence("dots near", 0, 1, "21 mm")
        assert message[-1] == "And 5 more."
        assert obstacles(page) == []


def test_a_window_of_middle_width_shows_nothing_over_the_options(studio):
    studio.page.set_viewport_size({"width": 1100, "height": 800})
    studio.page.locator("#options").scroll_into_view_if_needed()
    facts, options = (studio.page.locator(item).bounding_box() for item in ("#facts", "#options"))
    assert facts["y"] + facts["height"] <= options["y"]
    # As long as the marker is in view, they stay beside it.
    studio.page.evaluate("() => window.scrollTo(0, 300)")
    assert 0 < studio.page.locator("#facts").bounding_box()["y"] < 200


def test_a_phone_shows_the_errors_beside_a_dot_that_is_dragged(address, opened):
    allowed = lambda url: url.startswith((address, "blob:"))  # noqa: E731
    with opened(address, allowed, viewport={"width": 400, "height": 800}, has_touch=True) as page:
        studio = Studio(page)
        studio.settle()
        box = page.locator("#canvas svg").bounding_box()
        page.evaluate("(top) => window.scrollTo(0, top)", box["y"] - 40)
        before = studio.degrees()
        dot = page.locator("#canvas .dot").nth(1).locator(".mark").bounding_box()
        page.mouse.move(dot["x"] + dot["width"] / 2, dot["y"] + dot["height"] / 2)
        page.mouse.down()
        page.mouse.move(dot["x"] + dot["width"] / 2 + 40, dot["y"] + dot["height"] / 2 + 20, steps=5)
        assert studio.degrees() > before
        brief = page.locator("#brief")
        assert 0 <= brief.bounding_box()["y"] < 40
        assert brief.inner_text().startswith(f"Plan with {studio.degrees():.2g} deg")
        page.mouse.up()


@pytest.mark.parametrize("theme", ["", "dark"])
def test_it_prints_on_white_with_the_options_of_the_design(studio, theme):
    from pypdfium2 import PdfDocument

    page = studio.page
    page.locator("#option-radius").fill("123mm")
    page.keyboard.press("Tab")
    page.wait_for_selector("body[data-rested]", timeout=60_000)
    studio.settle()
    page.select_option("#theme", theme)
    pages = PdfDocument(page.pdf(format="A4", print_background=True))
    text = pages[0].get_textpage().get_text_range()
    assert re.search(r"radius of the room\s+123mm", text)
    assert re.search(r"places of dots\s+0.0mm,", text)
    assert "What to expect" in text
    picture = pages[0].render().to_numpy()
    assert np.median(picture) == 255
    page.emulate_media(media="print")
    exact = "() => getComputedStyle(document.querySelector('.shares i')).printColorAdjust"
    assert page.evaluate(exact) == "exact"


def test_its_scripts_are_well_formed():
    node = shutil.which("node")
    if not node:
        pytest.skip("no node in the path")
    scripts = [item for item in (files("markergen.studio") / "static").iterdir() if item.name.endswith(".js")]
    assert scripts
    for script in scripts:
        subprocess.run([node, "--input-type=module", "--check"], input=script.read_bytes(), check=True)


def test_its_pictures_are_taken_by_a_script(launched, tmp_path):
    from PIL import Image

    (tmp_path / "four.toml").write_text('n = 4\nradius = "60mm"\nrestarts = 1\n')
    light, dark = tmp_path / "light.png", tmp_path / "dark.png"
    script = [sys.executable, "-m", "docs.picture_of_the_studio", str(tmp_path / "four.toml"), str(light), str(dark)]
    subprocess.run(script, check=True, timeout=300)
    shades = [np.asarray(Image.open(item).convert("L")).mean() for item in (light, dark)]
    assert shades[0] > 200 > 100 > shades[1]


def test_everyone_can_use_regions_and_the_question_about_a_drawing(address, opened, tmp_path):
    state = {"points": "0mm,90mm; 90mm,0mm; -60mm,0mm; 0mm,-90mm", "dot": "20mm", "keep_out": ["circle:5mm@30mm,20mm"]}
    with opened(link_of(state, address), lambda url: url.startswith((address, "blob:")), bypass_csp=True) as page:
        studio = Studio(page)
        studio.settle()
        page.click("[data-mode=keep]")
        assert page.locator("#canvas .out").count() == 1
        assert obstacles(page) == []
        studio.give(uploads(tmp_path, "bare.svg", PLATE.replace('width="300mm" height="300mm" ', "")))
        page.wait_for_selector("#drop-said.fault")
        assert obstacles(page) == []
