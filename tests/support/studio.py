"""The studio in a browser: its server, its page, and what is read off it."""

import base64
import json
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

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

    def copy(self, what):
        """Copy the command, the Python, the spec or the link by their menu."""
        self.page.click("#copy")
        self.page.click(f"#{what}")

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

    def paste(self, text):
        """Paste a text anywhere on the page."""
        self.page.evaluate(PASTE, text)


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


def link_of(state, address="http://127.0.0.1:1/gone/"):
    """The address that holds a state; without one, that of a server that is gone."""
    return address + "#" + base64.urlsafe_b64encode(json.dumps(state).encode()).decode().rstrip("=")


def obstacles(page):
    """What axe finds that keeps somebody from using the page."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe: make test-browser installs it")
    results = axe.Axe().run(page).response["violations"]
    return [(item["id"], [node["html"][:120] for node in item["nodes"]]) for item in results]


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
    return [[float(item.removesuffix("mm")) for item in dot.split(",")] for dot in state["points"].split("; ")]
