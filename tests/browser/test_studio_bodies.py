"""Rigs and pads in the studio, in three dimensions."""

import json
import shlex
import tomllib

import pytest

import markergen as mg
from markergen.cli import main
from tests.support.studio import Studio, free_port, link_of, obstacles, serving, type_in

pytestmark = pytest.mark.browser


def test_a_pad_is_optimized_into_three_dimensions(studio, tmp_path):
    (tmp_path / "pad.toml").write_text(
        'n = "auto"\nradius = "400mm"\nposes = "cone:distance=0.5..10m,tilt=0..30,count=40"\n'
    )
    studio.give(tmp_path / "pad.toml")
    studio.until("() => location.hash.length > 30")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#stage canvas[data-ready]", timeout=120_000)
    assert "of several sizes" in studio.said()
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    assert loading.value.path().stat().st_size > 1000
    # A search makes it again.
    studio.copy("command")
    studio.until("() => document.getElementById('said').textContent.startsWith('Copied: ')")
    assert "markergen design --n auto --radius 400mm" in studio.said()
    assert "--points" not in studio.said()
    studio.page.click("#back")
    studio.settle()


def test_a_browser_without_webgl_says_so_and_shows_the_rest(launched, address):
    with launched("--disable-3d-apis") as browser:
        page = browser.new_page()
        page.goto(address)
        assert Studio(page).dots() == 5
        page.fill("#shape", "pair")
        page.click("#rig button")
        page.wait_for_selector("#stage p:has-text('WebGL')", timeout=120_000)
        assert "Expect " in page.locator("#body-note").inner_text()


def test_a_rig_is_designed_and_stands_in_three_dimensions(studio):
    studio.page.fill("#shape", "pair")
    studio.page.click("#rig button")
    studio.page.wait_for_selector("#stage canvas[data-ready], #stage p:has-text('WebGL')", timeout=120_000)
    assert "pair: 2 plates" in studio.said()
    studio.page.select_option("#suffix", ".json")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    rig = json.loads(loading.value.path().read_text())
    assert len(rig["markers"]) == 2
    assert studio.page.locator("#optimize").is_disabled()
    studio.page.click("#back")
    assert studio.dots() == 5
    assert studio.page.locator("#optimize").is_enabled()


def test_a_rig_has_the_options_of_rigs_which_another_shape_keeps(studio):
    studio.page.fill("#shape", "pair")
    studio.page.click("#rig button")
    studio.page.wait_for_selector("#body:not([hidden])", timeout=120_000)
    assert studio.page.locator("#option-radius").count() == 0
    type_in(studio, "n", "4")
    studio.until("() => location.hash.length > 30", 120)
    studio.page.fill("#shape", "prism:3")
    studio.page.fill("#edge", "90mm")
    studio.page.click("#rig button")
    studio.until("() => document.getElementById('said').textContent.startsWith('prism')", 120)
    assert studio.state() == {"n": "4", "shape": "prism:3", "edge": "90mm"}
    assert studio.page.locator("#option-edge").input_value() == "90mm"
    type_in(studio, "angle", "wide")
    studio.page.wait_for_selector("#option-angle[aria-invalid]")
    studio.page.click("#back")
    assert studio.dots() == 5
    assert studio.page.locator("#option-radius").count() == 1


def test_a_rig_of_a_template_is_designed_and_stands(studio):
    studio.page.select_option("#template", "cube")
    studio.page.wait_for_selector("#stage canvas[data-ready], #stage p:has-text('WebGL')", timeout=120_000)
    assert "cube: 5 plates" in studio.said()
    assert "Expect " in studio.page.locator("#body-note").inner_text()
    studio.page.click("#back")
    assert studio.dots() == 5


def test_a_rig_on_the_command_line_stands_with_its_errors(opened, tmp_path):
    mg.rig("pair", n=4, plate="100mm", restarts=1).rig.save(tmp_path / "rig.json")
    with (
        serving(free_port(), tmp_path / "rig.json") as address,
        opened(address, lambda url: url.startswith((address, "blob:")), bypass_csp=True) as page,
    ):
        page.wait_for_selector("#stage canvas[data-ready], #stage p:has-text('WebGL')")
        assert obstacles(page) == []
        assert page.locator("#body-note").inner_text().startswith("rig.json. Expect ")
        assert "rotation error" in page.locator("#dome .dome-said").inner_text()
        page.locator("#stage canvas").focus()
        before = page.locator("#stage canvas").screenshot()
        page.keyboard.press("ArrowLeft")
        assert page.locator("#stage canvas").screenshot() != before
        page.set_viewport_size({"width": 400, "height": 800})
        assert page.evaluate("() => document.documentElement.scrollWidth") <= 400


def test_a_body_is_printed_with_its_picture(studio):
    page = studio.page
    page.fill("#shape", "pair")
    page.click("#rig button")
    page.wait_for_selector("#stage canvas[data-ready], #stage p:has-text('WebGL')", timeout=120_000)
    if not page.locator("#stage canvas").count():
        pytest.skip("no WebGL")
    inked = """() => {
      const canvas = document.querySelector("#stage canvas"), copy = document.createElement("canvas").getContext("2d");
      copy.drawImage(canvas, 0, 0, 100, 100);
      return copy.getImageData(0, 0, 100, 100).data.some((value) => value);
    }"""
    # Also long after it was drawn, as paper takes it.
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.evaluate(inked)
    page.emulate_media(media="print")
    box, around = (page.locator(item).bounding_box() for item in ("#stage canvas", "#stage .space"))
    assert box["width"] <= around["width"] + 1
    assert page.locator("#body-note").is_visible()


def test_a_rig_is_a_state_with_a_link_a_command_and_a_way_back(studio, tmp_path):
    poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"
    rig = {"shape": "pair", "n": 4, "plate": "100mm", "restarts": 1, "poses": poses}
    type_in(studio, "n", "6")
    assert studio.dots() == 6
    studio.paste(link_of(rig))
    studio.until("() => document.getElementById('said').textContent === 'The design of the link.'", 120)
    assert studio.state() == rig
    assert studio.page.locator("#body").is_visible()
    studio.page.select_option("#suffix", ".json")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    loaded = json.loads(loading.value.path().read_text())
    studio.page.select_option("#suffix", ".toml")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    assert loading.value.suggested_filename == "rig.toml"
    assert tomllib.loads(loading.value.path().read_text()) == rig
    studio.copy("command")
    studio.until("() => document.getElementById('said').textContent.startsWith('Copied: markergen rig pair ')")
    typed = shlex.split(studio.said().partition(": ")[2].replace("rig.json", str(tmp_path / "rig.json")))
    assert main(typed[1:]) == 0
    # The page turns 800.0 into 800.
    assert json.loads((tmp_path / "rig.json").read_text()) == loaded
    studio.page.click("#undo")
    studio.page.wait_for_selector("#body", state="hidden")
    assert studio.dots() == 6
    studio.page.click("#redo")
    studio.page.wait_for_selector("#body:not([hidden])")
    studio.page.click("#back")
    assert studio.dots() == 6
    studio.page.click("#undo")
    studio.page.wait_for_selector("#body:not([hidden])")
    studio.page.reload()
    studio.page.wait_for_selector("#body:not([hidden])", timeout=120_000)
    assert studio.state() == rig
