"""The book is built without a warning, which covers its links and anchors, and loads nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.docs


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    for module in ("mkdocs", "material", "mkdocstrings"):
        pytest.importorskip(module, reason=f"no {module}: make book installs it")
    folder = tmp_path_factory.mktemp("book")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


def test_every_page_is_there(book):
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert pages | {"404"} == {path.stem for path in book.glob("*.html")}


def test_nothing_comes_from_elsewhere(book):
    for path in book.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        loaded = re.findall(r"""<(?:script|img|iframe|source)\b[^>]*?\bsrc=["']([^"']+)""", text)
        loaded += re.findall(r"""<link\b[^>]*?\bhref=["']([^"']+)""", text)
        assert loaded
        assert not [address for address in loaded if re.match(r"(https?:)?//", address)], path.name
    for path in book.rglob("*.css"):
        assert not re.search(r"url\([\"']?(https?:)?//", path.read_text(encoding="utf-8")), path.name


def test_formulas_are_drawn_without_a_script(book):
    page = (book / "theory.html").read_text(encoding="utf-8")
    assert page.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">') > 5
    assert page.count('display="inline"') > 20
    for path in book.rglob("*.html"):
        assert 'class="arithmatex"' not in path.read_text(encoding="utf-8"), path.name


def test_release_notes_are_the_changelog(book):
    page = (book / "changelog.html").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert re.findall(r"<h2 [^>]*>([^<]+)", page) == headings


def test_every_public_name_is_in_the_api(book):
    import markergen

    page = (book / "api.html").read_text(encoding="utf-8")
    shown = set(re.findall(r'<h3 id="markergen\.([\w.]+)"', page))
    assert shown >= set(markergen.__all__)


def test_getting_started_runs_as_it_stands(tmp_path):
    """Its photographs are rendered, by the example that measures a bad print."""
    commands = re.findall(r"^    (markergen .+)$", (ROOT / "docs" / "start.md").read_text(), re.MULTILINE)
    assert [line.split()[1] for line in commands] == [
        "design",
        "verify",
        "rescale",
        "calibrate",
        "detect",
        "validate",
    ]
    for line in commands:
        _, *words = line.split()
        if words[0] == "calibrate":
            example = [sys.executable, ROOT / "examples" / "measure_print.py", "marker.json", "print"]
            subprocess.run(example, cwd=tmp_path, check=True, capture_output=True)
            (tmp_path / "print" / "photos").rename(tmp_path / "photos")
        run = [sys.executable, "-m", "markergen", *words]
        done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    written = {path.name for path in tmp_path.iterdir()}
    assert written >= set(re.findall(r"\w+\.(?:pdf|json|yaml|html)", " ".join(commands))) | {"seen"}
