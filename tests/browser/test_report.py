"""Reports in a browser: everyone can read them, in light and dark, on a phone and on paper; the dome turns."""

import numpy as np
import pytest
from pypdfium2 import PdfDocument

import markergen as mg
from markergen.maths.rotation import exponential, rotation_z
from markergen.render import Optics, render_view
from markergen.studies.sweep.grid import sweep_from_mapping
from markergen.studies.sweep.run import plots, sweep_page
from tests.support.rigs import cube

pytestmark = pytest.mark.browser

CAMERA = mg.Camera(640, 480, 800, 800, 319.5, 239.5)
KINDS = ("flat", "relief", "rig", "calibration", "study")
LEGIBLE = 4.5
"""Contrast of text that WCAG 2.2 asks for."""


def flat(folder):
    marker = mg.design(n=5, radius="150mm", restarts=2).marker
    return mg.validate(marker, runs=5, views=6, print_sigma="0.1mm").save(folder / "flat.html")


def relief(folder):
    marker = mg.design(n=6, radius="100mm", relief="30mm", restarts=1).marker
    return mg.validate(marker, runs=2, views=3).save(folder / "relief.html")


def rig(folder):
    poses = "sphere:distance=0.3..0.6m,count=40"
    return mg.validate(cube(seed=10), poses=poses, runs=3, views=3).save(folder / "rig.html")


def calibration(folder):
    marker, rng, photos = mg.design(n=6, radius="100mm", restarts=1).marker, np.random.default_rng(0), []
    for k in range(8):
        lean = np.deg2rad(20 + 3 * k) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        rotation = rotation_z(1.6 * k) @ exponential(lean) @ np.diag([1.0, -1.0, -1.0])
        photos.append(render_view(marker, CAMERA, rotation, np.array([0.01, 0, 0.5 + 0.02 * k]), Optics(), rng))
    return mg.calibrate(marker, photos, CAMERA).save(report=folder / "calibration.html")


def study(folder):
    sweep = sweep_from_mapping({"study": {"name": "two axes"}, "grid": {"n": [4, 5, 6], "noise": [0.1, 0.2]}})
    errors = ("rotation_rms_deg", "rotation_low_deg", "rotation_high_deg", "rotation_bound_deg")
    errors += ("translation_rms_pct", "translation_low_pct", "translation_high_pct", "translation_bound_pct")
    table = [
        {**{key: str(value) for key, value in point.axes.items()}, "polar_angle_deg": "all", "estimator": "lm"}
        | dict.fromkeys(errors, 1.0 + index)
        for index, point in enumerate(sweep.points)
    ]
    (folder / "study.html").write_bytes(sweep_page(sweep, table, plots(sweep, table)))


@pytest.fixture(scope="session")
def addresses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for made in (flat, relief, rig, calibration, study):
        made(folder)
    return {kind: (folder / f"{kind}.html").as_uri() for kind in KINDS}


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", KINDS)
def test_axe_finds_nothing(opened, addresses, kind, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    with opened(addresses[kind], color_scheme=scheme) as page:
        results = axe.run(page).response["violations"]
    assert not [(item["id"], [node["html"][:200] for node in item["nodes"]][:3]) for item in results]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", KINDS)
def test_text_in_drawings_is_legible(opened, addresses, kind, scheme):
    """Against the page behind them; text on objects that are drawn in their own colors is not judged."""
    with opened(addresses[kind], color_scheme=scheme) as page:
        faint = page.evaluate(
            """(least) => {
              const luminance = (color) => {
                const [r, g, b] = color.match(/[\\d.]+/g).slice(0, 3).map((each) => each / 255)
                  .map((each) => (each <= 0.04045 ? each / 12.92 : ((each + 0.055) / 1.055) ** 2.4));
                return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
              };
              const behind = luminance(getComputedStyle(document.body).backgroundColor);
              return [...document.querySelectorAll("figure:not(.paper) svg text")].filter((text) => {
                const own = luminance(getComputedStyle(text).fill);
                return Math.max(own, behind) / Math.min(own, behind) < least;
              }).map((text) => [text.textContent, getComputedStyle(text).fill]);
            }""",
            LEGIBLE,
        )
        drawn = page.locator("figure svg text").count()
    assert drawn > 10 or kind == "study"
    assert not faint


@pytest.mark.parametrize("kind", KINDS)
def test_a_phone_scrolls_tables_but_not_the_page(opened, addresses, kind):
    with opened(addresses[kind], viewport={"width": 360, "height": 740}, has_touch=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        wide = page.evaluate(
            """[...document.querySelectorAll("main *")].filter((each) => !each.closest(".scroll, svg")
              && each.getBoundingClientRect().right > 360).map((each) => each.outerHTML.slice(0, 100))"""
        )
    assert not wide


@pytest.mark.parametrize("kind", KINDS)
def test_paper_is_white_and_few(opened, addresses, kind):
    """With the dome as a still picture, also for those who read in the dark."""
    with opened(addresses[kind], color_scheme="dark") as page:
        pages = PdfDocument(page.pdf(prefer_css_page_size=True))
        first = np.array(pages[0].render(scale=0.5).to_pil())
        page.emulate_media(media="print")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        for selector, printed in ((".live", False), (".still", True)):
            assert all(item.is_visible() == printed for item in page.locator(selector).all())
    assert np.median(first) == 255
    assert len(pages) <= 9


@pytest.mark.parametrize("kind", ["flat", "rig"])
def test_without_scripts_there_are_still_pictures(opened, addresses, kind):
    with opened(addresses[kind], java_script_enabled=False) as page:
        assert not page.locator(".live").first.is_visible()
        assert [item.is_visible() for item in page.locator(".still").all()] == [True, True]


@pytest.mark.parametrize("kind", KINDS)
def test_is_valid_html(addresses, kind):
    from pathlib import Path
    from urllib.request import url2pathname

    html5lib = pytest.importorskip("html5lib")
    parser = html5lib.HTMLParser(strict=True)
    parser.parse(Path(url2pathname(addresses[kind].removeprefix("file://"))).read_text("utf-8"))
    assert not parser.errors


@pytest.mark.parametrize("kind", ["flat", "rig"])
def test_dome_begins_with_the_hardest_pose_and_is_read_by_pointer_and_keys(opened, addresses, kind):
    with opened(addresses[kind], viewport={"width": 900, "height": 900}) as page:
        picture, slider = page.locator(".dome-picture"), page.get_by_role("slider")
        message = page.locator(".dome-said")
        errors = page.evaluate("JSON.parse(document.querySelector('[data-dome]').dataset.dome).poses.rotation")
        hardest = max((value, k) for k, value in enumerate(errors) if value is not None)[0]
        digits = 2 if hardest < 1 else 3
        assert f"rotation error {float(f'{hardest:.{digits}g}'):g} deg" in message.inner_text()
        assert (", the worst: " in message.inner_text()) == (None not in errors)

        slider.focus()
        page.keyboard.press("Home")
        least = min(value for value in errors if value is not None)
        easiest = message.inner_text()
        assert f"rotation error {float(f'{least:.2g}'):g}" in easiest
        assert slider.get_attribute("aria-valuetext") == easiest
        assert "the worst" not in easiest
        page.keyboard.press("ArrowRight")
        assert message.inner_text() != easiest

        before = picture.inner_html()
        picture.focus()
        page.keyboard.press("ArrowLeft")
        rotated = picture.inner_html()
        assert rotated != before
        box = picture.bounding_box()
        page.mouse.move(box["x"] + 200, box["y"] + 100)
        page.mouse.down()
        page.mouse.move(box["x"] + 260, box["y"] + 120, steps=3)
        page.mouse.up()
        assert picture.inner_html() != rotated

        phrase = message.inner_text()
        front = page.locator(".dome-picture circle:not([fill=none])").last
        spot = front.bounding_box()
        page.mouse.click(spot["x"] + spot["width"] / 2, spot["y"] + spot["height"] / 2)
        assert message.inner_text() != phrase

        page.get_by_role("combobox").select_option("translation")
        assert "translation error" in picture.get_attribute("aria-label")


def test_scripts_have_no_errors_of_syntax():
    import shutil
    import subprocess
    from importlib.resources import files

    node = shutil.which("node")
    if not node:
        pytest.skip("no node in the path")
    subprocess.run([node, "--check", str(files("markergen.presentation") / "dome.js")], check=True)
