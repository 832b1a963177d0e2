"""The studio in a browser: everything that a page can do, against the server that a user starts."""

import base64
import json
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
import tomllib
from contextlib import contextmanager
from importlib.resources import files
from io import StringIO

import numpy as np
import pytest

import markergen as mg
from markergen.cli import main

pytestmark = pytest.mark.browser

LIVE = {5: 5, 60: 9}
"""Time within which numbers follow a dot, by their number, over that of the least request to the studio and a frame."""


PASTE = """(text) => {
  const held = new DataTransfer();
  held.setData("text", text);
  document.body.dispatchEvent(new ClipboardEvent("paste", {clipboardData: held, bubbles: true, cancelable: true}));
}"""


@contextmanager
def serving(port, *files):
    """The studio at a port; yields its address."""
    command = [sys.executable, "-m", "markergen", "studio", *map(str, files), "--no-browser", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield re.search(r"http://\S+/", process.stdout.readline())[0]
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@pytest.fixture(scope="module")
def address():
    pytest.importorskip("starlette", reason="no starlette: pip install 'markergen[studio]'")
    with serving(free_port()) as found:
        yield found


class Studio:
    """A page of the studio, and what is read off it."""

    def __init__(self, page):
        self.page = page

    def settle(self):
        """Wait until what is shown is what was asked for last."""
        self.page.wait_for_selector("body[data-shown]")
        self.page.wait_for_selector("main[aria-busy=false]")

    def until(self, holds, seconds=60):
        """Wait until a function of the page holds; what a page evaluates by itself its own rules forbid."""
        end = time.monotonic() + seconds
        while not self.page.evaluate(holds):
            assert time.monotonic() < end, f"{holds}: not within {seconds} s"
            time.sleep(0.05)

    def dots(self):
        self.settle()
        return self.page.locator("#canvas .dot").count()

    def degrees(self):
        self.settle()
        return float(self.page.locator("#degrees").inner_text().split()[0])

    def said(self):
        return self.page.locator("#said").inner_text()

    def state(self):
        self.settle()
        return self.page.evaluate(
            "() => JSON.parse(atob(location.hash.slice(1).replaceAll('-', '+').replaceAll('_', '/')))"
        )

    def give(self, *files):
        self.page.set_input_files("#files", [str(file) for file in files])

    def drag(self, index, right, down, steps=10):
        box = self.page.locator("#canvas .dot").nth(index).locator(".mark").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + right, y + down, steps=steps)
        self.page.mouse.up()


@pytest.fixture
def studio(address, opened):
    with opened(address, lambda url: url.startswith((address, "blob:" + address[: address.index("/", 8)]))) as page:
        found = Studio(page)
        found.settle()
        yield found


@pytest.fixture
def refusing(address, chromium):
    """A page where requests may be refused, which browsers report as errors; nothing else may go wrong."""
    context = chromium.new_context()
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(address)
    found = Studio(page)
    found.settle()
    yield found
    context.close()
    assert not wrong


def test_it_begins_with_a_polygon_and_its_error(studio):
    assert studio.dots() == 5
    expected = mg.validate(mg.design(n=5).marker, runs=0, views=0).budget["rotation_deg"]["total"]
    assert studio.degrees() == pytest.approx(expected, rel=0.01)


def test_a_dragged_dot_changes_state_and_numbers_and_can_be_taken_back(studio):
    before = studio.degrees()
    studio.drag(1, 60, 10)
    moved = studio.degrees()
    assert moved > before
    points = studio.state()["points"]
    studio.page.click("#undo")
    assert studio.degrees() == before
    assert "points" not in studio.state()
    studio.page.keyboard.press("Control+Shift+Z")
    assert studio.degrees() == moved
    assert studio.state()["points"] == points


def test_dots_are_added_moved_and_removed_by_keyboard_and_mouse(studio):
    studio.page.click("[data-mode=add]")
    box = studio.page.locator("#canvas svg").bounding_box()
    studio.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 20)
    assert studio.dots() == 6
    last = studio.page.locator("#canvas .dot").nth(5)
    last.focus()
    before = last.get_attribute("aria-label")
    studio.page.keyboard.press("ArrowRight")
    studio.page.keyboard.press("Shift+ArrowUp")
    studio.settle()
    numbers = [
        np.array(re.findall(r"-?[\d.]+", label)[1:3], float) for label in (before, last.get_attribute("aria-label"))
    ]
    np.testing.assert_allclose(numbers[1] - numbers[0], [1, 10], atol=0.01)
    last.focus()
    studio.page.keyboard.press("Delete")
    assert studio.dots() == 5
    studio.page.click("[data-mode=remove]")
    studio.page.locator("#canvas .dot").nth(2).click()
    assert studio.dots() == 4


def test_numbers_can_be_typed(studio):
    studio.page.click("#table summary")
    studio.page.get_by_label("x of dot 0 in mm").fill("12.5")
    studio.page.keyboard.press("Tab")
    assert studio.state()["points"].startswith("12.5mm,128.4mm")


def test_an_option_changes_the_design(studio):
    studio.page.get_by_label("n", exact=True).fill("8")
    studio.page.keyboard.press("Tab")
    assert studio.dots() == 8
    assert studio.state() == {"n": "8"}


def test_a_search_is_shown_and_ends_in_the_layout_of_the_command(studio, tmp_path, monkeypatch):
    studio.page.get_by_label("n", exact=True).fill("6")
    studio.page.keyboard.press("Tab")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')", timeout=60_000)
    studio.until("() => document.getElementById('said').textContent.includes('no 6 dots in this room')")
    points = mg.design(n=6).marker.xyz[:, :2]
    found = [
        [float(each.removesuffix("mm")) for each in dot.split(",")] for dot in studio.state()["points"].split("; ")
    ]
    np.testing.assert_allclose(np.array(found, dtype=float) / 1e3, points, atol=1e-10)
    # What is downloaded is what the command makes that is offered for copying.
    monkeypatch.chdir(tmp_path)
    studio.page.select_option("#suffix", ".json")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    loading.value.save_as("loaded.json")
    studio.page.click("#command")
    studio.until("() => document.getElementById('said').textContent.includes('markergen design')")
    typed = shlex.split(studio.said().partition(": ")[2].replace("marker.pdf", "typed.json"))
    assert main(typed[1:]) == 0
    assert (tmp_path / "loaded.json").read_bytes() == (tmp_path / "typed.json").read_bytes()


def test_a_search_can_be_stopped(studio):
    studio.page.get_by_label("n", exact=True).fill("30")
    studio.page.keyboard.press("Tab")
    before = studio.state()
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')")
    assert studio.said() == "Stopped; nothing has changed."
    assert studio.state() == before


def test_a_search_ends_when_the_design_is_changed(studio):
    number = studio.page.get_by_label("n", exact=True)
    number.fill("20")
    studio.page.keyboard.press("Tab")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    number.fill("7")
    studio.page.keyboard.press("Tab")
    studio.page.wait_for_selector("#optimize:text-is('Optimize')")
    assert studio.dots() == 7
    assert studio.state() == {"n": "7"}


def test_files_are_opened(studio, tmp_path):
    mg.design(n=7, radius="80mm", restarts=2).marker.save(tmp_path / "seven.json")
    studio.give(tmp_path / "seven.json")
    studio.page.wait_for_selector("#canvas .dot:nth-child(7)")
    assert studio.dots() == 7
    (tmp_path / "spec.toml").write_text('n = 6\nradius = "90mm"\n')
    studio.give(tmp_path / "spec.toml")
    studio.page.wait_for_selector("#canvas .dot:nth-child(7)", state="detached")
    assert studio.dots() == 6
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
    (tmp_path / "plate.svg").write_text(drawing + '<path d="M20,20 h200 v160 h-200 z"/></svg>')
    studio.give(tmp_path / "plate.svg")
    studio.page.click("#drop button[value=boundary]")
    studio.page.wait_for_selector("#clear:not([hidden])")
    assert studio.state()["boundary"]["kind"] == "polygon"


def drawings():
    import ezdxf

    svg = '<svg xmlns="http://www.w3.org/2000/svg" width="{0}mm" height="{0}mm" viewBox="0 0 {0} {0}">{1}</svg>'
    yield "boundary", "plate.svg", svg.format(200, '<path d="M0,0 h200 v200 h-200 z"/>').encode()
    yield "keep_out", "hole.svg", svg.format(20, '<path d="M0,0 h20 v20 h-20 z"/>').encode()
    drawing = ezdxf.new(units=ezdxf.units.MM)
    drawing.modelspace().add_lwpolyline([(0, 0), (200, 0), (200, 160), (0, 160)], close=True)
    text = StringIO()
    drawing.write(text)
    yield "boundary", "plate.dxf", text.getvalue().encode()


@pytest.mark.parametrize(("use", "name", "data"), [*drawings()], ids=lambda each: each if isinstance(each, str) else "")
def test_drawings_are_dropped(studio, use, name, data):
    studio.page.evaluate(
        """([name, bytes]) => {
          const held = new DataTransfer();
          held.items.add(new File([new Uint8Array(bytes)], name));
          for (const name of ["dragenter", "drop"]) {
            const looks = {dataTransfer: held, bubbles: true, cancelable: true};
            document.body.dispatchEvent(new DragEvent(name, looks));
          }
        }""",
        [name, list(data)],
    )
    studio.page.click(f"#drop button[value={use}]")
    studio.until(f"() => document.getElementById('said').textContent.startsWith({name!r})")
    shape = studio.state()[use]
    assert (shape if use == "boundary" else shape[0])["kind"] == "polygon"


def test_a_drawing_whose_use_is_not_chosen_changes_nothing(studio, tmp_path):
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
    (tmp_path / "plate.svg").write_text(drawing + '<path d="M20,20 h200 v160 h-200 z"/></svg>')
    studio.give(tmp_path / "plate.svg")
    studio.page.click("#drop button[value=boundary]")
    studio.page.wait_for_selector("#clear:not([hidden])")
    studio.page.click("#undo")
    before = studio.state()
    studio.give(tmp_path / "plate.svg")
    studio.page.wait_for_selector("#drop[open]")
    studio.page.keyboard.press("Escape")
    studio.page.wait_for_selector("#drop", state="hidden")
    assert studio.state() == before


def test_regions_are_drawn(studio):
    box = studio.page.locator("#canvas svg").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    studio.page.click("[data-mode=keep]")
    for right, down in ((-20, -20), (30, 30)):
        studio.page.mouse.click(x + right, y + down, delay=20)
        time.sleep(0.5)  # two clicks are not a double click
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#canvas .out")
    assert len(studio.state()["keep_out"]) == 1
    studio.page.click("#clear")
    studio.page.wait_for_selector("#canvas .out", state="detached")


@pytest.mark.parametrize("mode", ["room", "keep"])
def test_circles_are_drawn_from_their_center(studio, mode):
    box = studio.page.locator("#canvas svg").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    studio.page.click(f"[data-mode={mode}]")
    studio.page.mouse.move(x, y)
    studio.page.mouse.down()
    studio.page.mouse.move(x + 60, y, steps=3)
    studio.page.mouse.move(x + 60, y + 80, steps=3)
    studio.page.mouse.up()
    studio.page.wait_for_selector("[data-mode=move][aria-pressed=true]")
    # 100 px of a drawing that shows 1.12 times the room, whose radius is 150 mm.
    radius = 100 * 2 * 1.12 * 0.15 / min(box["width"], box["height"])
    state = studio.state()
    if mode == "room":
        assert float(state["radius"].removesuffix("mm")) == pytest.approx(1e3 * radius, rel=0.01)
    else:
        (circle,) = state["keep_out"]
        assert circle["radius"] == pytest.approx(radius, rel=0.01)
        assert studio.page.locator("#canvas .out").count() == 1


def test_a_photograph_is_searched(studio, tmp_path):
    from PIL import Image

    studio.page.wait_for_selector("body[data-rested]", timeout=60_000)
    marker = mg.design(n=5).marker
    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    from markergen.render import Optics, render_view

    image = render_view(
        marker, setting, np.diag([1.0, -1, -1]), np.array([0, 0, 0.8]), Optics(), np.random.default_rng(1)
    )
    Image.fromarray(image).save(tmp_path / "seen.png")
    Image.fromarray(np.full_like(image, 200)).save(tmp_path / "empty.png")
    studio.give(tmp_path / "seen.png", tmp_path / "empty.png")
    studio.until("() => document.querySelectorAll('#photos figcaption').length === 2")
    studio.until("() => !document.getElementById('photos').textContent.includes('looking')")
    said = studio.page.locator("#photos").inner_text()
    assert "seen.png: found, 5 dots" in said
    assert "empty.png: not found" in said


def test_a_camera_file_gives_photographs_their_pose_and_the_calibration_its_share(studio, tmp_path):
    from PIL import Image

    from markergen.render import Optics, render_view

    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    assert "calibration 0 %" in studio.page.locator("#limits").inner_text()
    (tmp_path / "camera.yaml").write_text(
        "width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n"
        "camera_parameters: [fx, fy, cx, cy]\n"
        "camera_covariance: [[4, 0, 0, 0], [0, 4, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]]\n"
    )
    turned, place = np.diag([1.0, -1, -1]), np.array([0, 0, 0.8])
    image = render_view(mg.design(n=5).marker, setting, turned, place, Optics(), np.random.default_rng(1))
    Image.fromarray(image).save(tmp_path / "seen.png")
    studio.give(tmp_path / "camera.yaml", tmp_path / "seen.png")
    studio.until("() => /found, 5 dots. 0.8\\d* m away/.test(document.getElementById('photos').textContent)")
    assert studio.state()["camera_covariance"][2] == [0, 0, 2, 0]
    assert "calibration 0 %" not in studio.page.locator("#limits").inner_text()
    studio.page.reload()
    assert "calibration 0 %" not in studio.page.locator("#limits").inner_text()


def test_a_pad_is_optimized_into_three_dimensions(studio, tmp_path):
    (tmp_path / "pad.toml").write_text(
        'n = "auto"\nradius = "400mm"\nposes = "cone:distance=0.5..10m,tilt=0..30,count=40"\n'
    )
    studio.give(tmp_path / "pad.toml")
    studio.until("() => document.getElementById('said').textContent.length > 0")
    studio.page.click("#optimize")
    studio.page.wait_for_selector("#stage canvas[data-ready]", timeout=120_000)
    assert "Dots of several sizes" in studio.said()
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    assert loading.value.path().stat().st_size > 1000
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


def test_a_link_of_a_server_that_is_gone_is_pasted(studio):
    studio.drag(2, -30, -20)
    moved, link = studio.state(), studio.page.evaluate("() => location.href")
    studio.page.click("#undo")
    studio.settle()
    studio.page.evaluate(
        PASTE,
        re.sub("//[^#]*", "//127.0.0.1:1/gone/", link),
    )
    studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
    assert studio.state() == moved


def test_a_finger_moves_dots_and_scrolls_the_page(address, opened):
    allowed = lambda url: url.startswith((address, "blob:"))  # noqa: E731
    with opened(address, allowed, viewport={"width": 400, "height": 800}, has_touch=True, is_mobile=True) as page:
        studio, wire = Studio(page), page.context.new_cdp_session(page)
        studio.settle()

        def swipe(x, y, right, down):
            wire.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
            for k in range(1, 11):
                at = {"x": x + k * right / 10, "y": y + k * down / 10}
                wire.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [at]})
            wire.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

        box = page.locator("#canvas svg").bounding_box()
        swipe(box["x"] + box["width"] / 2, box["y"] + 0.6 * box["height"], 0, -200)
        studio.until("() => window.scrollY > 100")
        assert "points" not in studio.state()
        time.sleep(1)  # until the page has come to rest
        page.evaluate("() => window.scrollTo(0, 0)")
        box = page.locator("#canvas .dot").nth(1).locator(".mark").bounding_box()
        swipe(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, 30, 30)
        studio.until("() => document.querySelector('#undo').disabled === false")
        assert "points" in studio.state()
        assert page.evaluate("() => window.scrollY") == 0


def test_bad_files_and_values_are_refused_in_a_line_and_change_nothing(refusing, tmp_path):
    before = refusing.state()
    for name, data, said in (
        ("bad.json", b'{"a": 1}', "bad.json"),
        ("bad.toml", b"n = [", "bad.toml"),
        ("bad.svg", b"<svg", "bad.svg"),
        ("cut.json", json.dumps({"schema": "markergen/2"}).encode()[:-3], "cut.json"),
    ):
        (tmp_path / name).write_bytes(data)
        refusing.give(tmp_path / name)
        refusing.page.wait_for_selector(f"#said.fault:has-text('{said}')")
        assert refusing.state() == before
    refusing.page.get_by_label("radius", exact=True).fill("wide")
    refusing.page.keyboard.press("Tab")
    refusing.page.wait_for_selector("#option-radius[aria-invalid]")
    refusing.page.click("#undo")
    assert refusing.dots() == 5


def test_two_tabs_are_independent_and_the_address_holds_the_design(studio, address, opened):
    studio.drag(2, -30, -20)
    link, moved = studio.page.evaluate("() => location.href"), studio.degrees()
    with opened(link, lambda url: url.startswith((address, "blob:"))) as page:
        other = Studio(page)
        assert other.degrees() == moved
        other.drag(2, 10, -30)
        assert other.degrees() != moved
    studio.page.reload()
    assert studio.degrees() == moved


def test_a_server_that_goes_leaves_the_design(chromium):
    port = free_port()
    context = chromium.new_context()
    page = context.new_page()
    studio = Studio(page)
    with serving(port) as address:
        page.goto(address)
        studio.settle()
    page.locator("#canvas .dot").nth(1).focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#gone:not([hidden])")
    assert studio.state()["points"]
    context.close()


def test_the_design_is_taken_from_one_server_to_the_next(opened):
    """A server that starts anew has another token: its page takes the address of the old one."""
    port = free_port()
    with serving(port) as address, opened(address, lambda url: url.startswith((address, "blob:"))) as page:
        studio = Studio(page)
        studio.drag(2, -30, -20)
        moved, link, error = studio.state(), page.evaluate("() => location.href"), studio.degrees()
    with serving(port) as again, opened(again, lambda url: url.startswith((again, "blob:"))) as page:
        assert again != address
        studio = Studio(page)
        studio.settle()
        page.evaluate(PASTE, link)
        studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
        assert (studio.state(), studio.degrees()) == (moved, error)


def test_sixty_dots_are_searched(studio):
    studio.page.get_by_label("n", exact=True).fill("60")
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


def test_a_server_that_is_out_of_reach_for_a_while_is_found_again(refusing):
    before = refusing.degrees()
    refusing.page.context.set_offline(True)
    refusing.page.locator("#canvas .dot").nth(1).focus()
    refusing.page.keyboard.press("Shift+ArrowDown")
    refusing.page.wait_for_selector("#gone:not([hidden])")
    assert refusing.degrees() == before
    refusing.page.context.set_offline(False)
    refusing.page.wait_for_selector("#gone", state="hidden")
    refusing.until("() => document.getElementById('plan') && document.querySelector('main').ariaBusy === 'false'")
    assert refusing.degrees() != before
    assert "points" in refusing.state()


def test_numbers_follow_a_dragged_dot_at_once(studio, record_property):
    for count, ratio in LIVE.items():
        studio.page.get_by_label("n", exact=True).fill(str(count))
        studio.page.get_by_label("dot", exact=True).fill("10mm")
        studio.page.keyboard.press("Tab")
        studio.settle()
        took = studio.page.evaluate(
            """async () => {
              const took = [], least = [], group = document.querySelectorAll('#canvas .dot')[1], body = document.body;
              const box = group.querySelector('.mark').getBoundingClientRect();
              const x = box.x + box.width / 2, y = box.y + box.height / 2;
              const at = (dx) => ({bubbles: true, pointerId: 1, button: 0, clientX: x + dx, clientY: y});
              const send = (name, on, dx) => on.dispatchEvent(new PointerEvent(name, at(dx)));
              const svg = document.querySelector('#canvas svg');
              svg.setPointerCapture = () => {};
              send('pointerdown', group, 0);
              for (let k = 1; k <= 30; k++) {
                const before = body.dataset.shown, start = performance.now();
                send('pointermove', svg, -k);
                while (body.dataset.shown === before) await new Promise((done) => requestAnimationFrame(done));
                took.push(performance.now() - start);
                const then = performance.now();
                await (await fetch('options')).json();
                await new Promise((done) => requestAnimationFrame(done));
                least.push(performance.now() - then);
              }
              send('pointerup', svg, -30);
              return [took, least];
            }"""
        )
        (median, most), floor = np.percentile(took[0], [50, 95]), np.median(took[1])
        record_property(f"median_ms_{count}", round(median))
        print(f"\n{count} dots: median {median:.0f} ms, 95 % {most:.0f} ms; the least request {floor:.0f} ms")
        assert median < ratio * floor


def obstacles(page):
    """What axe finds that keeps somebody from using the page."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe: make test-browser installs it")
    found = axe.Axe().run(page).response["violations"]
    return [(each["id"], [node["html"][:120] for node in each["nodes"]]) for each in found]


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


def linked(address, state):
    """The address that holds a state."""
    return address + "#" + base64.urlsafe_b64encode(json.dumps(state).encode()).decode().rstrip("=")


def test_of_many_problems_the_first_are_told_and_everyone_can_read_them(address, opened):
    state = {"points": OVERLAPPING, "dot": "20mm"}
    with opened(linked(address, state), lambda url: url.startswith((address, "blob:")), bypass_csp=True) as page:
        Studio(page).settle()
        said = page.locator("#problems li").all_inner_texts()
        assert len(said) == 6
        assert said[0] == "Dots 0 and 1 are 21 mm too near to each other."
        assert said[-1] == "And 5 more."
        assert obstacles(page) == []


def test_a_window_of_middle_width_shows_nothing_over_the_options(studio):
    studio.page.set_viewport_size({"width": 1100, "height": 800})
    studio.page.locator("#options").scroll_into_view_if_needed()
    facts, options = (studio.page.locator(each).bounding_box() for each in ("#facts", "#options"))
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
        assert float(brief.inner_text().split()[0]) == studio.degrees()
        page.mouse.up()


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
        ("noise_model", "bananas"),
        ("dot", "-7"),
        ("ids", "0..3"),
        ("paper", "bananas"),
        ("colors", "bananas"),
        ("process", "bananas"),
        ("edge", "-7"),
        ("mount", "bananas"),
        ("aggregate", "bananas"),
        ("coordinates", "bananas"),
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
    shown = "() => getComputedStyle(document.querySelector('.bar'), '::after').visibility"
    assert studio.page.evaluate(shown) == "hidden"
    held = []
    studio.page.route("**/look", lambda route: held.append(route))
    studio.page.get_by_label("n", exact=True).fill("7")
    studio.page.keyboard.press("Tab")
    studio.until(f"() => ({shown})() === 'visible'")
    held.pop().continue_()
    studio.until(f"() => ({shown})() === 'hidden'")
    studio.page.unroute("**/look")
    assert studio.dots() == 7


def test_the_focus_and_what_is_typed_stay_in_the_table_of_dots(studio):
    page = studio.page
    page.click("#table summary")
    page.get_by_label("x of dot 0 in mm").fill("12.5")
    page.keyboard.press("Tab")
    page.keyboard.type("77")  # into y, while the answer is on its way
    studio.settle()
    y = page.get_by_label("y of dot 0 in mm")
    assert page.evaluate("() => document.activeElement.ariaLabel") == "y of dot 0 in mm"
    assert y.input_value() == "77"
    page.keyboard.press("Tab")
    studio.settle()
    assert studio.state()["points"].startswith("12.5mm,77mm")
    page.get_by_label("Remove dot 4").focus()
    page.keyboard.press("Enter")
    assert studio.dots() == 4
    assert page.evaluate("() => document.activeElement.ariaLabel") == "Remove dot 3"


def test_the_dots_of_a_relief_have_heights_to_type(studio):
    studio.page.get_by_label("relief", exact=True).fill("20mm")
    studio.page.keyboard.press("Tab")
    studio.settle()
    studio.page.click("#table summary")
    studio.page.get_by_label("z of dot 1 in mm").fill("8")
    studio.page.keyboard.press("Tab")
    assert studio.state()["points"].split("; ")[1].endswith(",8mm")


def test_photographs_are_told_and_taken_away(studio, tmp_path):
    from PIL import Image

    Image.new("L", (320, 240), 200).save(tmp_path / "empty.png")
    # It stands above the photographs, and moves them down when it comes.
    studio.page.wait_for_selector("#view", state="visible")
    studio.give(tmp_path / "empty.png")
    studio.until("() => document.getElementById('said').textContent.startsWith('empty.png: not found')")
    studio.page.wait_for_selector("#photos img", state="visible")
    at = "document.querySelector('#photos figcaption').getBoundingClientRect()"
    studio.until(f"() => {at}.top > 0 && {at}.bottom < innerHeight")
    studio.page.get_by_role("button", name="Remove photographs").click()
    assert studio.page.locator("#photos figure").count() == 0
    assert studio.page.locator("#photos-away").is_hidden()


def test_whoever_waits_for_a_server_that_is_gone_is_told(refusing, tmp_path):
    from PIL import Image

    Image.new("L", (320, 240), 200).save(tmp_path / "empty.png")
    refusing.page.context.set_offline(True)
    refusing.page.click("#download")
    refusing.page.wait_for_selector("#gone:not([hidden])")
    assert refusing.said() == "The studio does not answer."
    refusing.give(tmp_path / "empty.png")
    refusing.page.wait_for_selector("figcaption:has-text('empty.png: not looked at')")
    refusing.page.evaluate("() => window.scrollTo(0, document.body.scrollHeight)")
    banner = refusing.page.locator("#gone").bounding_box()
    assert 0 <= banner["y"] <= 720 - banner["height"]
    refusing.page.context.set_offline(False)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("plate.svg", '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
         '<path d="M20,20 h200 v160 h-200 z"/></svg>', "plate.svg: polygon of 200 mm x 160 mm"),
        ("cam.yaml", "width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n", "cam.yaml: a camera"),
    ],
)  # fmt: skip
def test_what_was_opened_is_told(studio, tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    studio.give(tmp_path / name)
    if name.endswith(".svg"):
        studio.page.click("#drop button[value=boundary]")
    studio.until(f"() => document.getElementById('said').textContent === {said!r}")


def test_corners_are_drawn_in_round_numbers_and_without_a_ring_around_all(studio):
    box = studio.page.locator("#canvas svg").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    studio.page.click("[data-mode=keep]")
    for right, down in ((-23, -17), (31, -29), (11, 37)):
        studio.page.mouse.click(x + right, y + down, delay=20)
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#canvas .out")
    ((corners,),) = (each["outlines"] for each in studio.state()["keep_out"])
    assert all(len(repr(value).partition(".")[2]) <= 5 for corner in corners for value in corner)
    assert studio.page.evaluate("() => getComputedStyle(document.getElementById('marker')).outlineStyle") == "none"


@pytest.mark.parametrize("theme", ["", "dark"])
def test_it_prints_on_white_with_the_options_of_the_design(studio, theme):
    from pypdfium2 import PdfDocument

    page = studio.page
    page.get_by_label("radius", exact=True).fill("123mm")
    page.keyboard.press("Tab")
    page.wait_for_selector("body[data-rested]", timeout=60_000)
    studio.settle()
    page.select_option("#theme", theme)
    pages = PdfDocument(page.pdf(format="A4", print_background=True))
    text = pages[0].get_textpage().get_text_range()
    assert re.search(r"radius\s+123mm", text)
    assert re.search(r"points\s+0.0mm,", text)
    assert "What to expect" in text
    picture = pages[0].render().to_numpy()
    assert np.median(picture) == 255
    page.emulate_media(media="print")
    exact = "() => getComputedStyle(document.querySelector('.shares i')).printColorAdjust"
    assert page.evaluate(exact) == "exact"


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
    box, around = (page.locator(each).bounding_box() for each in ("#stage canvas", "#stage .space"))
    assert box["width"] <= around["width"] + 1
    assert page.locator("#body-note").is_visible()


def test_its_scripts_are_well_formed():
    node = shutil.which("node")
    if not node:
        pytest.skip("no node in the path")
    scripts = [each for each in (files("markergen.studio") / "static").iterdir() if each.name.endswith(".js")]
    assert scripts
    for script in scripts:
        subprocess.run([node, "--input-type=module", "--check"], input=script.read_bytes(), check=True)


def test_the_keyboard_alone_is_enough(studio):
    reached = []
    for _ in range(40):
        studio.page.keyboard.press("Tab")
        name = studio.page.evaluate(
            "() => (({ id, dataset, ariaLabel }) => id || dataset.mode || ariaLabel)(document.activeElement)"
        )
        reached.append(name)
        if name == "optimize":
            break
    assert reached[-1] == "optimize"
    number = studio.page.get_by_label("n", exact=True)
    number.focus()
    studio.page.keyboard.type("6")
    studio.page.keyboard.press("Enter")
    assert studio.dots() == 6
    # The drawing comes after its tools; Tab goes through its dots one by one.
    studio.page.locator("[data-mode=keep]").focus()
    studio.page.keyboard.press("Tab")
    for index in range(6):
        label = studio.page.evaluate("() => document.activeElement.getAttribute('aria-label')")
        assert label.startswith(f"dot {index}")
        if index < 5:
            studio.page.keyboard.press("Tab")
    studio.page.keyboard.press("Delete")
    assert studio.dots() == 5
    studio.page.keyboard.press("Control+z")
    assert studio.dots() == 6


def test_its_pictures_are_taken_by_a_script(launched, tmp_path):
    from PIL import Image

    (tmp_path / "four.toml").write_text('n = 4\nradius = "60mm"\nrestarts = 1\n')
    light, dark = tmp_path / "light.png", tmp_path / "dark.png"
    script = [sys.executable, "-m", "docs.picture_of_the_studio", str(tmp_path / "four.toml"), str(light), str(dark)]
    subprocess.run(script, check=True, timeout=300)
    shades = [np.asarray(Image.open(each).convert("L")).mean() for each in (light, dark)]
    assert shades[0] > 200 > 100 > shades[1]


def uploads(tmp_path, name, text):
    """A file that the browser sends with the type that it knows for its name."""
    (tmp_path / name).write_text(text)
    return tmp_path / name


SHEET = '<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="300mm" viewBox="0 0 300 300">{}</svg>'
PLATE = SHEET.format('<path d="M20,20 h200 v160 h-200 z"/>')


def type_in(studio, name, text):
    field = studio.page.locator(f"#option-{name}")
    field.evaluate("each => { each.closest('details').open = true; }")
    field.fill(text)
    studio.page.keyboard.press("Tab")


def numbers_of(state):
    return [[float(each.removesuffix("mm")) for each in dot.split(",")] for dot in state["points"].split("; ")]


def test_a_refused_state_is_neither_downloaded_nor_copied(refusing):
    type_in(refusing, "n", "8")
    assert refusing.dots() == 8
    type_in(refusing, "radius", "wide")
    refusing.page.wait_for_selector("#option-radius[aria-invalid]")
    wrong = refusing.said()
    loaded = []
    refusing.page.on("download", lambda each: loaded.append(each))
    for button in ("download", "command", "python", "spec", "share"):
        refusing.page.click(f"#{button}")
        refusing.until(f"() => document.getElementById('said').textContent === {json.dumps(wrong)}")
        assert refusing.page.locator("#said.fault").count() == 1
    assert not loaded


def test_what_is_typed_last_is_what_is_downloaded(studio):
    studio.page.select_option("#suffix", ".json")
    studio.page.get_by_label("n", exact=True).fill("9")
    with studio.page.expect_download() as loading:
        studio.page.click("#download")
    assert len(json.loads(loading.value.path().read_text())["control_points"]) == 9


def test_a_dxf_is_a_drawing_whatever_type_the_browser_gives_it(studio, tmp_path):
    [_, _, (_, name, data)] = drawings()
    (tmp_path / name).write_bytes(data)
    studio.give(tmp_path / name)
    studio.page.click("#drop-room")
    studio.until(
        "() => document.getElementById('said').textContent.startsWith('plate.dxf: polygon of 200 mm x 160 mm')"
    )
    assert studio.state()["boundary"]["kind"] == "polygon"
    assert studio.page.locator("#photos figure").count() == 0


@pytest.mark.parametrize(
    ("name", "text", "option"),
    [
        ("plate.svg", PLATE, "boundary"),
        ("camera.yaml", "width: 640\nheight: 480\nfx: 700\nfy: 700\ncx: 320\ncy: 240\n", "camera"),
        ("poses.csv", "tx,ty,tz,rx,ry,rz\n0,0,1,3.14159,0,0\n0,0,1.2,3.14159,0.3,0\n", "poses"),
        ("dots.csv", "x_mm,y_mm\n0,90\n80,0\n-80,0\n0,-85\n", "points"),
    ],
)
def test_it_begins_with_any_file_that_can_be_opened(opened, tmp_path, name, text, option):
    with (
        serving(free_port(), uploads(tmp_path, name, text)) as address,
        opened(address, lambda url: url.startswith((address, "blob:"))) as page,
    ):
        studio = Studio(page)
        if option == "boundary":
            page.click("#drop-room")
        studio.until(f"() => document.getElementById('said').textContent.startsWith('{name}: ')")
        assert studio.state()[option]


def test_keep_outs_of_the_sheet_of_the_room_lie_where_they_are_drawn(studio, tmp_path):
    holes = uploads(tmp_path, "holes.svg", SHEET.format('<circle cx="50" cy="50" r="10"/>'))
    plate = uploads(tmp_path, "plate.svg", PLATE)
    studio.give(plate)
    studio.page.click("#drop-room")
    studio.page.wait_for_selector("#clear:not([hidden])")
    studio.settle()
    studio.page.reload()
    studio.settle()
    studio.give(holes)
    studio.page.click("#drop-keep")
    studio.page.wait_for_selector("#canvas .out")
    [own] = mg.design(
        **{name: each for name, each in studio.state().items() if name != "drawing_center"}
    ).spec.keep_outs
    [same] = mg.design(n=5, boundary=plate, keep_out=[holes]).spec.keep_outs
    assert own == same
    assert own.center == pytest.approx((-0.07, 0.05))


def test_the_skip_link_keeps_the_design(studio):
    type_in(studio, "n", "7")
    before = studio.state()
    studio.page.locator("#skip").focus()
    studio.page.keyboard.press("Enter")
    assert studio.page.evaluate("() => document.activeElement.id") == "marker"
    assert studio.state() == before
    studio.page.reload()
    assert studio.dots() == 7


def test_no_fast_edit_is_lost(studio):
    dot = studio.page.locator("#canvas .dot").nth(1)
    before = numbers_of(
        {"points": re.sub(r"[^\d.,-]", "", re.search("at (.*) mm", dot.get_attribute("aria-label"))[1])}
    )
    dot.focus()
    for _ in range(40):
        studio.page.keyboard.press("ArrowRight", delay=10)
    assert numbers_of(studio.state())[1][0] - before[0][0] == pytest.approx(40, abs=0.01)
    studio.page.click("[data-mode=add]")
    box = studio.page.locator("#canvas svg").bounding_box()
    for k in range(30):
        studio.page.mouse.click(box["x"] + box["width"] / 2 + 4 * k - 60, box["y"] + box["height"] / 2 + 5)
    assert studio.dots() == 35


def test_a_link_that_is_no_design_is_told_and_shown_in_the_form(refusing):
    refusing.page.evaluate(PASTE, link_of({"n": 3}))
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert "found n=3" in refusing.said()
    assert refusing.page.locator("#option-n").input_value() == "3"
    refusing.page.click("#undo")
    assert refusing.dots() == 5
    assert refusing.page.locator("#option-n").input_value() == ""
    refusing.page.click("#redo")
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert refusing.page.locator("#option-n").input_value() == "3"
    # A page that begins with it has nothing to copy.
    refusing.page.reload()
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert refusing.page.locator("#option-n").input_value() == "3"
    refusing.page.click("#command")
    refusing.until("() => document.getElementById('said').textContent.includes('found n=3')")


def link_of(state):
    import base64

    return "http://127.0.0.1:1/gone/#" + base64.urlsafe_b64encode(json.dumps(state).encode()).decode().rstrip("=")


def test_a_drawing_that_is_no_room_does_not_look_like_one(refusing, tmp_path):
    type_in(refusing, "dot", "30mm")
    refusing.give(uploads(tmp_path, "tiny.svg", PLATE.replace("300mm", "3mm")))
    refusing.page.click("#drop-room")
    refusing.page.wait_for_selector("#said.fault")
    assert not refusing.said().startswith("tiny.svg: ")


def test_photographs_are_taken_with_the_camera_of_the_state(studio, tmp_path):
    from PIL import Image

    from markergen.render import Optics, render_view

    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    turned, place = np.diag([1.0, -1, -1]), np.array([0, 0, 0.8])
    image = render_view(mg.design(n=5).marker, setting, turned, place, Optics(), np.random.default_rng(1))
    Image.fromarray(image).save(tmp_path / "seen.png")
    studio.give(uploads(tmp_path, "camera.yaml", "width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n"))
    studio.until("() => document.getElementById('said').textContent.startsWith('camera.yaml')")
    studio.page.reload()
    studio.settle()
    assert studio.state()["camera"]["fx"] == 800
    studio.give(tmp_path / "seen.png")
    studio.until("() => /found, 5 dots. 0.8\\d* m away/.test(document.getElementById('photos').textContent)")
    type_in(studio, "n", "5")
    studio.page.evaluate(PASTE, link_of({"n": 5}))
    studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
    studio.give(tmp_path / "seen.png")
    studio.until("() => /Give a camera file/.test(document.querySelector('#photos figure').textContent)")


class Sheet:
    """Millimeters of the drawing, as long as it does not change."""

    def __init__(self, studio):
        studio.settle()
        self._page = studio.page
        self._width = 1e3 * float(studio.page.locator("#canvas svg").get_attribute("viewBox").split()[2])

    def at(self, x, y):
        box = self._page.locator("#canvas svg").bounding_box()
        scale = min(box["width"], box["height"]) / self._width
        return box["x"] + box["width"] / 2 + x * scale, box["y"] + box["height"] / 2 - y * scale

    def click(self, *places):
        for place in places:
            self._page.mouse.click(*self.at(*place), delay=20)

    def drag(self, start, end, keep=False):
        self._page.mouse.move(*self.at(*start))
        self._page.mouse.down()
        self._page.mouse.move(*self.at(*end), steps=4)
        if not keep:
            self._page.mouse.up()


@pytest.mark.parametrize("kind", ["circle", "rectangle"])
def test_a_room_that_is_drawn_off_center_takes_its_center_and_all_that_is_there_along(studio, kind):
    type_in(studio, "keep_out", "circle:10mm@40mm,-40mm")
    dots = studio.page.locator("#canvas .dot")
    dots.nth(1).focus()
    studio.page.keyboard.press("ArrowRight")
    before = numbers_of(studio.state())
    sheet = Sheet(studio)
    studio.page.click("[data-mode=room]")
    if kind == "circle":
        sheet.drag((40, -40), (40, 20))
    else:
        sheet.click((0, -90), (80, 10))
        studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("[data-mode=move][aria-pressed=true]")
    state = studio.state()
    [keep] = state["keep_out"]
    x, y = (float(each.removesuffix("mm")) for each in keep.partition("@")[2].split(","))
    room = mg.design(**{**state, "points": None, "n": 5, "dot": None, "restarts": 1}).spec.boundary
    np.testing.assert_allclose(room.center, 0, atol=1e-6)
    assert room.radius == pytest.approx(0.06 if kind == "circle" else np.hypot(0.04, 0.05), rel=0.02)
    np.testing.assert_allclose((x, y), 0, atol=1.2)
    # Dots that were placed by hand stay where they are, beside the keep-out.
    moved = np.array(numbers_of(state)) - before
    np.testing.assert_allclose(moved, np.tile([x - 40, y + 40], (5, 1)), atol=1e-6)


def test_an_outline_that_crosses_itself_stays_a_draft(refusing):
    before = refusing.state()
    sheet = Sheet(refusing)
    refusing.page.click("[data-mode=room]")
    for place in ((-60, -60), (60, 60), (60, -60), (-60, 40)):
        sheet.click(place)
    refusing.page.keyboard.press("Enter")
    refusing.page.wait_for_selector("#said.fault:has-text('outlines that do not cross')")
    assert "[[" not in refusing.said()
    assert refusing.state() == before
    # Its corners are taken back, one by one, and drawn anew.
    assert refusing.page.locator("#canvas .draft").count() == 1
    refusing.page.keyboard.press("Control+z")
    refusing.page.keyboard.press("Control+z")
    sheet.click((-60, 60), (-90, 0))
    refusing.page.keyboard.press("Enter")
    refusing.page.wait_for_selector("[data-mode=move][aria-pressed=true]")
    [outline] = refusing.state()["boundary"]["outlines"]
    assert len(outline) == 4
    assert all(value == round(value, 6) for corner in outline for value in corner)


def test_undo_takes_back_a_corner_before_the_design(studio):
    type_in(studio, "n", "6")
    assert studio.dots() == 6
    sheet = Sheet(studio)
    studio.page.click("[data-mode=keep]")
    sheet.click((-30, -30), (30, 30))
    studio.page.keyboard.press("Control+z")
    studio.page.keyboard.press("Control+z")
    assert studio.page.locator("#canvas .draft").count() == 0
    assert studio.dots() == 6
    studio.page.keyboard.press("Control+z")
    assert studio.dots() == 5


def test_typing_numbers_keeps_the_focus(studio):
    type_in(studio, "relief", "10mm")
    studio.settle()
    studio.page.click("#table summary")
    studio.page.get_by_label("x of dot 0 in mm").fill("12.5")
    studio.page.keyboard.press("Tab")
    assert studio.state()["points"].startswith("12.5mm")
    assert studio.page.evaluate("() => document.activeElement.ariaLabel") == "y of dot 0 in mm"
    assert studio.page.get_by_label("z of dot 0 in mm").input_value() == "0.00"
    studio.page.get_by_label("Remove dot 1").click()
    assert studio.dots() == 4
    assert studio.page.evaluate("() => document.activeElement.ariaLabel") == "Remove dot 1"


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
    loaded, words = {}, {}
    for suffix in (".json", ".toml"):
        studio.page.select_option("#suffix", suffix)
        with studio.page.expect_download() as loading:
            studio.page.click("#download")
        loaded[suffix] = loading.value.path().read_bytes()
    for button in ("command", "spec"):
        studio.page.click(f"#{button}")
        studio.until(f"() => document.getElementById('said').textContent.startsWith('Copied the {button}')")
        words[button] = studio.page.evaluate("() => navigator.clipboard.readText()")
    assert words["spec"].encode() == loaded[".toml"]
    empty = tmp_path / "empty"
    empty.mkdir()
    typed = words["command"].replace("\nmarkergen ", f"\n{shlex.quote(sys.executable)} -m markergen ")
    subprocess.run(["bash", "-e"], input=typed.encode(), cwd=empty, check=True, capture_output=True)
    assert (empty / "marker.json").read_bytes() == loaded[".json"]


def test_a_drawing_is_asked_for_its_unit_and_layer(studio, tmp_path):
    import ezdxf

    bare = PLATE.replace('width="300mm" height="300mm" ', "")
    studio.give(uploads(tmp_path, "bare.svg", bare))
    studio.page.wait_for_selector("#drop-said.fault:has-text('a unit of length')")
    assert studio.page.locator("#drop-room").is_disabled()
    studio.page.select_option("#drop-unit", "cm")
    studio.page.wait_for_selector("#drop-said:has-text('polygon of 2 m x 1.6 m')")
    studio.page.select_option("#drop-unit", "mm")
    studio.page.wait_for_selector("#drop-said:has-text('polygon of 200 mm x 160 mm')")
    studio.page.click("#drop-room")
    studio.until("() => document.getElementById('said').textContent.startsWith('bare.svg: polygon of 200 mm')")
    drawing = ezdxf.new(units=ezdxf.units.MM)
    for name, size in (("PLATE", 120), ("FRAME", 300)):
        points = [(0, 0), (size, 0), (size, size), (0, size)]
        drawing.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": name})
    drawing.saveas(tmp_path / "layers.dxf")
    studio.give(tmp_path / "layers.dxf")
    studio.page.fill("#drop-layer", "PLAT")
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#drop-said.fault:has-text(\"'PLATE'\")")
    studio.page.fill("#drop-layer", "FRAME")
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#drop-said:has-text('polygon of 300 mm x 300 mm')")
    studio.page.fill("#drop-layer", "PLATE")
    studio.page.click("#drop-room")
    studio.until("() => document.getElementById('said').textContent.startsWith('layers.dxf')")
    assert studio.state()["boundary"]["outlines"] == [[[-0.06, -0.06], [0.06, -0.06], [0.06, 0.06], [-0.06, 0.06]]]
    # Fields that the page has no drawing for are not there.
    for name in ("boundary_unit", "layer", "origin"):
        assert studio.page.locator(f"#option-{name}").count() == 0


def test_dots_and_regions_are_drawn_by_keyboard(studio):
    press = studio.page.keyboard.press
    studio.page.locator("[data-mode=add]").focus()
    press("Enter")
    for _ in range(3):
        press("Tab")
    assert studio.page.evaluate("() => document.activeElement.dataset.mode") == "keep"
    press("Tab")
    assert studio.page.evaluate("() => document.activeElement.tagName") == "svg"
    press("Shift+ArrowRight")
    press("ArrowUp")
    assert studio.said() == "The cross is at 10.00, 1.00 mm."
    press("Space")
    assert studio.dots() == 6
    assert numbers_of(studio.state())[5] == [10, 1]
    studio.page.locator("[data-mode=keep]").focus()
    press("Enter")
    press("Tab")
    press("Shift+ArrowDown")
    press("Space")
    for key in ("Shift+ArrowLeft", "Shift+ArrowDown"):
        press(key)
    press("Space")
    press("Enter")
    studio.page.wait_for_selector("#canvas .out")
    assert studio.page.evaluate("() => document.activeElement.dataset.mode") == "move"
    [keep] = studio.state()["keep_out"]
    assert sorted(map(tuple, keep["outlines"][0])) == [(0.0, -0.019), (0.0, -0.009), (0.01, -0.019), (0.01, -0.009)]
    studio.page.locator("[data-mode=room]").focus()
    press("Enter")
    for _ in range(3):
        press("Tab")
    assert studio.page.evaluate("() => document.activeElement.tagName") == "svg"


def test_a_dot_that_leaves_the_view_can_be_reached(studio):
    sheet = Sheet(studio)
    dot = studio.page.locator("#canvas .dot").nth(0).locator(".mark").bounding_box()
    studio.page.mouse.move(dot["x"] + dot["width"] / 2, dot["y"] + dot["height"] / 2)
    studio.page.mouse.down()
    studio.page.mouse.move(*sheet.at(0, 320), steps=5)
    studio.page.mouse.up()
    studio.settle()
    assert numbers_of(studio.state())[0][1] == pytest.approx(320, abs=3)
    box, drawn = (
        studio.page.locator("#canvas svg").bounding_box(),
        studio.page.locator("#canvas .dot").nth(0).bounding_box(),
    )
    assert drawn["y"] > box["y"]
    studio.page.click("#undo")
    studio.settle()


def test_escape_ends_dragging_where_it_began(studio):
    before = studio.state()
    box = studio.page.locator("#canvas .dot").nth(1).locator(".mark").bounding_box()
    place = studio.page.locator("#canvas .dot").nth(1).get_attribute("transform")
    studio.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    studio.page.mouse.down()
    studio.page.mouse.move(box["x"] + 60, box["y"] + 60, steps=5)
    assert studio.page.locator("#canvas .dot").nth(1).get_attribute("transform") != place
    studio.page.keyboard.press("Escape")
    studio.page.mouse.move(box["x"] + 90, box["y"] + 60, steps=2)
    studio.page.mouse.up()
    assert studio.state() == before
    assert studio.page.locator("#canvas .dot").nth(1).get_attribute("transform") == place
    assert studio.page.locator("#undo").is_disabled()


def test_keep_outs_are_moved_and_removed_one_by_one(studio):
    type_in(studio, "keep_out", "circle:10mm@40mm,-40mm | rect:10mmx20mm")
    studio.page.wait_for_selector("#canvas .out")
    sheet = Sheet(studio)
    studio.page.click("[data-mode=keep]")
    sheet.drag((-50, 50), (-50, 65))
    studio.page.wait_for_selector("#canvas .out:nth-child(3)")
    # What is typed stays in its field.
    assert studio.page.locator("#option-keep_out").input_value() == "circle:10mm@40mm,-40mm | rect:10mmx20mm"
    assert "1 drawn" in studio.page.locator("label[for=option-keep_out]").inner_text()
    sheet = Sheet(studio)
    sheet.drag((-50, 50), (-20, 50))
    studio.until("() => /at -20/.test(document.querySelectorAll('#canvas .out')[2].ariaLabel)")
    outs = studio.page.locator("#canvas .out")
    outs.nth(1).focus()
    for _ in range(3):
        studio.page.keyboard.press("ArrowRight")
    studio.until("() => / 3.00, 0.00 mm/.test(document.querySelectorAll('#canvas .out')[1].ariaLabel)")
    state = studio.state()["keep_out"]
    assert state[1] == "rect:10mmx20mm@3.0mm,0.0mm"
    assert state[2]["center"] == pytest.approx([-0.02, 0.05], abs=1e-3)
    outs.nth(0).focus()
    studio.page.keyboard.press("Delete")
    studio.page.wait_for_selector("#canvas .out:nth-child(3)", state="detached")
    assert studio.state()["keep_out"] == state[1:]
    studio.page.click("#clear")
    studio.page.wait_for_selector("#canvas .out:nth-child(2)", state="detached")
    assert studio.state()["keep_out"] == state[1:2]
    assert studio.page.locator("#clear").is_hidden()


def test_a_target_takes_the_place_of_a_number_of_dots(studio):
    type_in(studio, "n", "8")
    assert studio.dots() == 8
    type_in(studio, "target", "0.5deg@0.7m")
    assert studio.state() == {"target": "0.5deg@0.7m"}
    assert studio.page.locator("#said.fault").count() == 0
    type_in(studio, "n", "6")
    assert studio.state() == {"n": "6"}


def test_a_rig_is_a_state_with_a_link_a_command_and_a_way_back(studio, tmp_path):
    poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"
    rig = {"shape": "pair", "n": 4, "plate": "100mm", "restarts": 1, "poses": poses}
    type_in(studio, "n", "6")
    assert studio.dots() == 6
    studio.page.evaluate(PASTE, link_of(rig))
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
    studio.page.click("#command")
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


def test_everyone_can_use_regions_and_the_question_about_a_drawing(address, opened, tmp_path):
    state = {"points": "0mm,90mm; 90mm,0mm; -60mm,0mm; 0mm,-90mm", "dot": "20mm", "keep_out": ["circle:5mm@30mm,20mm"]}
    link = address + "#" + link_of(state).partition("#")[2]
    with opened(link, lambda url: url.startswith((address, "blob:")), bypass_csp=True) as page:
        studio = Studio(page)
        studio.settle()
        page.click("[data-mode=keep]")
        assert page.locator("#canvas .out").count() == 1
        assert obstacles(page) == []
        studio.give(uploads(tmp_path, "bare.svg", PLATE.replace('width="300mm" height="300mm" ', "")))
        page.wait_for_selector("#drop-said.fault")
        assert obstacles(page) == []
