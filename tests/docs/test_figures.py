"""Figures of the book: each is made by a script, shown by a page with a text alternative, and readable in the dark."""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from docs.figures import IMAGES, drawing, lines
from docs.number_table import FIGURES, MEASURED
from docs.numbers import Block, faults

ROOT = Path(__file__).parents[2]
SHOWN = {
    path.name: re.findall(r'<img src="images/([^"]+)"[^>]*? alt="([^"]+)">', path.read_text(encoding="utf-8"))
    for path in (ROOT / "docs").glob("*.md")
}


@pytest.mark.parametrize("page", sorted(Path(file).name for file in FIGURES))
def test_pages_show_their_figures_with_text_alternatives(page):
    made = {path.name for path in IMAGES.glob(f"{page.removesuffix('.md')}-*.svg")}
    assert made
    assert made == {name for name, _ in SHOWN[page]}
    assert all(len(alt) > 60 for _, alt in SHOWN[page])
    for name in made:
        path = IMAGES / name
        assert path.stat().st_size < 50_000, name
        # Names of colors stand for one of the light and one of the dark, or a picture has its own paper.
        text = path.read_text(encoding="utf-8")
        assert "prefers-color-scheme:dark" in text or 'fill="#fff"' in text
        assert not re.search(r"""href=["']https?:|@import|<script""", text)


def test_a_figure_is_the_same_every_time():
    def draw(ax):
        lines(ax, [("first", [1, 10], [2, 3]), ("second", [1, 10], [3, 1])], ("x, m", "y, deg"))

    made = drawing(draw)
    assert made == drawing(draw)
    root = ElementTree.fromstring(made)
    assert root.find("{*}rect").get("class") == "ground"
    style = root.find("{*}style").text
    for used in set(re.findall(r"var\((--\w+)\)", made)):
        assert style.count(f"{used}:") == 2, used
    assert "light-dark" not in made
    assert {"x, m", "y, deg", "first", "second"} <= {
        item.text for item in root.iter("{http://www.w3.org/2000/svg}text")
    }


@pytest.mark.docs
def test_the_command_makes_what_a_page_shows(tmp_path):
    command = FIGURES["docs/theory.md"]
    done = subprocess.run(
        [sys.executable, *command.line.split()[1:-1], tmp_path],
        cwd=ROOT,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    entries = [entry for entry in MEASURED if isinstance(entry, Block) and entry.command == command]
    assert len(entries) == 2
    for entry in entries:
        assert not list(faults(entry, {command: done.stdout}))
    assert {path.name for path in tmp_path.iterdir()} == {name for name, _ in SHOWN["theory.md"]}
