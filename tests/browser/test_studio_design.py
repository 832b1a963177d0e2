"""Options, the search, and what the studio gives away: files, commands, specs."""

import json
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.cli import main
from tests.support.studio import Sheet, type_in, uploads

pytestmark = pytest.mark.browser


def test_it_begins_with_a_polygon_and_its_error(studio):
    assert studio.dots() == 5
    plan = mg.design(n=5).plan
    studio.page.wait_for_selector("body[data-rested]", timeout=60_000)
    printed = [studio.page.locator(name).inner_text().splitlines()[0] for name in ("#degrees", "#millimeters")]
    assert " and ".join(printed) == plan.amounts
    assert studio.page.locator("#plan").inner_text().lower().startswith(plan.prospect)


def test_an_option_changes_the_design(studio):
    studio.page.locator("#option-n").fill("8")
    studio.page.keyboard.press("Tab")
    assert studio.dots() == 8
    assert studio.state() == {"n": "8"}


def test_a_search_is_shown_and_ends_in_the_layout_of_the_command(studio, tmp_path, monkeypatch):
    studio.page.locator("#option-n").fill("6")
    studio.page.keyboard.press("Tab")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')", timeout=60_000)
    studio.until("() => document.getElementById('said').textContent.includes('no 6 dots in this room')")
    points = mg.design(n=6).marker.xyz[:, :2]
    result = [
        [float(item.removesuffix("mm")) for item in dot.split(",")] for dot in studio.state()["points"].split("; ")
    ]
    np.testing.assert_allclose(np.array(result, dtype=float) / 1e3, points, atol=1e-10)
    assert studio.state()["sized"] == studio.state()["dot"]
    # What is downloaded is what the command makes that is offered for copying.
    monkeypatch.chdir(tmp_path)
    studio.page.select_option("#suffix", ".json")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    loading.value.save_as("loaded.json")
    studio.copy("command")
    studio.until("() => document.getElementById('said').textContent.includes('markergen design')")
    typed = shlex.split(studio.said().partition(": ")[2].replace("marker.pdf", "typed.json"))
    assert main(typed[1:]) == 0
    assert (tmp_path / "loaded.json").read_bytes() == (tmp_path / "typed.json").read_bytes()


def test_a_search_can_be_stopped(studio):
    studio.page.locator("#option-n").fill("30")
    studio.page.keyboard.press("Tab")
    before = studio.state()
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    assert studio.page.locator("#download").is_disabled()
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')")
    assert studio.said() == sentence("stopped")
    assert studio.state() == before


def test_a_polygon_that_stands_in_for_a_design_is_downloaded_as_such(studio):
    studio.settle()
    with studio.page.expect_download():
        studio.page.click("#download")
    studio.until("() => document.getElementById('said').textContent.includes('a regular polygon, as shown')")


def test_a_search_ends_when_the_design_is_changed(studio):
    number = studio.page.locator("#option-n")
    number.fill("20")
    studio.page.keyboard.press("Tab")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    number.fill("7")
    studio.page.keyboard.press("Tab")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')")
    assert studio.dots() == 7
    assert studio.state() == {"n": "7"}


def test_sixty_dots_are_searched(studio):
    studio.page.locator("#option-n").fill("60")
    studio.page.keyboard.press("Enter")
    assert studio.dots() == 60
    polygon = studio.degrees()
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#canvas .ghost", timeout=60_000, state="attached")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')", timeout=240_000)
    studio.until("() => location.hash.length > 100")
    assert studio.dots() == 60
    assert studio.page.locator("#problems li").count() == 0
    assert studio.degrees() < polygon


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("n", "bananas"),
        ("points", "bananas"),
        ("target", "bananas"),
        ("boundary", "bananas"),
        ("keep_out", "bananas"),
        ("keep_out", "-7"),
        ("camera", "bananas"),
        ("poses", "bananas"),
        ("dot", "-7"),
        ("ids", "0..3"),
        ("paper", "bananas"),
        ("colors", "bananas"),
        ("edge", "-7"),
        ("mount", "bananas"),
        ("aggregate", "bananas"),
        ("survive", "-7"),
    ],
)
def test_what_is_refused_is_marked_at_its_field_in_the_words_of_the_page(refusing, name, value):
    page = refusing.page
    page.evaluate("() => { for (const group of document.querySelectorAll('#form details')) group.open = true; }")
    page.locator(f"#option-{name}").fill(value)
    page.keyboard.press("Tab")
    page.wait_for_selector("#said.fault")
    marked = page.locator("#form [aria-invalid]").evaluate_all("(all) => all.map((each) => each.id)")
    assert marked == [*(["option-tag"] if name == "ids" else []), f"option-{name}"]
    assert not re.search(r"--[a-z]|help\(|markergen\.", refusing.said())


def test_what_takes_long_is_said_meanwhile(studio):
    printed = "() => getComputedStyle(document.querySelector('.bar'), '::after').visibility"
    assert studio.page.evaluate(printed) == "hidden"
    held = []
    studio.page.route("**/look", lambda route: held.append(route))
    studio.page.locator("#option-n").fill("7")
    studio.page.keyboard.press("Tab")
    studio.until(f"() => ({printed})() === 'visible'")
    held.pop().continue_()
    studio.until(f"() => ({printed})() === 'hidden'")
    studio.page.unroute("**/look")
    assert studio.dots() == 7


def test_a_refused_state_is_neither_downloaded_nor_copied(refusing):
    type_in(refusing, "n", "8")
    assert refusing.dots() == 8
    type_in(refusing, "radius", "wide")
    refusing.page.wait_for_selector("#option-radius[aria-invalid]")
    wrong = refusing.said()
    loaded = []
    refusing.page.on("download", lambda item: loaded.append(item))
    for button in ("download", "command", "python", "spec", "share"):
        (refusing.page.click("#download") if button == "download" else refusing.copy(button))
        refusing.until(f"() => document.getElementById('said').textContent === {json.dumps(wrong)}")
        assert refusing.page.locator("#said.fault").count() == 1
    assert not loaded


def test_what_is_typed_last_is_what_is_downloaded(studio):
    studio.page.select_option("#suffix", ".json")
    studio.page.locator("#option-n").fill("9")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    assert len(json.loads(loading.value.path().read_text())["control_points"]) == 9


@pytest.mark.parametrize("camera", [False, True])
def test_the_copied_command_makes_the_download_whatever_was_drawn(studio, tmp_path, camera):
    studio.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    if camera:
        studio.give(uploads(tmp_path, "camera.yaml", "width: 640\nheight: 480\nfx: 700\nfy: 700\ncx: 320\ncy: 240\n"))
        studio.until("() => document.getElementById('said').textContent.startsWith('camera.yaml')")
    else:
        sheet = Sheet(studio)
        studio.page.click("[data-mode=room]")
        sheet.click((-120, -90), (100, 80))
        studio.page.keyboard.press("Enter")
        studio.page.wait_for_selector("[data-mode=move][aria-pressed=true]")
        type_in(studio, "keep_out", "circle:10mm@30mm,20mm")
        assert len(studio.state()["keep_out"]) == 1
    loaded, phrase = {}, {}
    for suffix in (".json", ".toml"):
        studio.page.select_option("#suffix", suffix)
        with studio.page.expect_download() as loading:
            studio.page.click("#download")
        loaded[suffix] = loading.value.path().read_bytes()
    for button in ("command", "spec"):
        studio.copy(button)
        studio.until(f"() => document.getElementById('said').textContent.startsWith('Copied the {button}')")
        phrase[button] = studio.page.evaluate("() => navigator.clipboard.readText()")
    assert phrase["spec"].encode() == loaded[".toml"]
    empty = tmp_path / "empty"
    empty.mkdir()
    typed = phrase["command"].replace("\nmarkergen ", f"\n{shlex.quote(sys.executable)} -m markergen ")
    subprocess.run(["bash", "-e"], input=typed.encode(), cwd=empty, check=True, capture_output=True)
    assert (empty / "marker.json").read_bytes() == loaded[".json"]


def test_a_target_takes_the_place_of_a_number_of_dots(studio):
    type_in(studio, "n", "8")
    assert studio.dots() == 8
    type_in(studio, "target", "0.5deg@0.7m")
    assert studio.state() == {"target": "0.5deg@0.7m"}
    assert studio.page.locator("#said.fault").count() == 0
    type_in(studio, "n", "6")
    assert studio.state() == {"n": "6"}
