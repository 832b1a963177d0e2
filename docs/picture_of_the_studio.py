"""Take pictures of the studio, light and dark, after a search for what a file asks for.

python -m docs.picture_of_the_studio templates/robot-flange.toml docs/images/studio.png docs/images/studio-dark.png
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from io import BytesIO
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

WIDTH, HEIGHT = 1440, 1180
COLORS = 128
"""More are not distinguished from these, and make larger files."""
PATIENCE_MS = 300_000


def pictures(address: str, chromium: str, light: Path, dark: Path) -> None:
    """Search once, and take both pictures of what is found."""
    from PIL import Image

    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        link = found(browser, address)
        for scheme, target in (("light", light), ("dark", dark)):
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme=scheme)
            page.goto(link)
            page.wait_for_selector("body[data-rested]", timeout=PATIENCE_MS)
            page.wait_for_selector("#view:not([hidden])", timeout=PATIENCE_MS)
            image = Image.open(BytesIO(page.screenshot())).convert("RGB")
            image.quantize(COLORS, dither=Image.Dither.NONE).save(target, optimize=True)
            print(f"{target}: {image.width} x {image.height} pixels, {target.stat().st_size / 1e3:.0f} kB")
        browser.close()


def found(browser: Browser, address: str) -> str:
    """Return the link of the layout that the search finds."""
    page = browser.new_page()
    page.goto(address)
    page.wait_for_selector("main[aria-busy=false]")
    page.click("#optimize")
    page.wait_for_selector("#optimize:text-is('Stop')")
    page.wait_for_selector("#optimize:text-is('Optimize')", timeout=PATIENCE_MS)
    page.wait_for_selector("#undo:enabled")
    page.wait_for_selector("main[aria-busy=false]")
    return page.url


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("light", type=Path)
    parser.add_argument("dark", type=Path)
    parser.add_argument("--chromium", default=os.environ.get("CHROMIUM") or shutil.which("chromium"))
    stated = parser.parse_args()
    command = [sys.executable, "-m", "markergen", "studio", str(stated.file), "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout
        address = re.search(r"http://\S+/", server.stdout.readline())
        if not address:
            sys.exit("expected the address of the studio, found none; see what it says above")
        pictures(address[0], stated.chromium, stated.light, stated.dark)
    finally:
        server.terminate()
        server.wait(20)


if __name__ == "__main__":
    main()
