"""The book is built without a warning, which covers its links and anchors, and loads nothing from elsewhere."""

import re
from pathlib import Path

import pytest

from markergen.options import declared
from markergen.options.compare import CompareKeywords
from markergen.options.declarations import (
    DesignKeywords,
    ExportKeywords,
    ValidateKeywords,
    VerifyKeywords,
)
from markergen.options.rig import RigKeywords
from tests.support.book import build

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.docs


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    return build(tmp_path_factory.mktemp("book"))


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
    printed = set(re.findall(r'<h3 id="markergen\.([\w.]+)"', page))
    assert printed >= set(markergen.__all__)


def test_keywords_of_functions_are_in_the_api(book):
    page = (book / "api.html").read_text(encoding="utf-8")
    for table in (DesignKeywords, ExportKeywords, ValidateKeywords, CompareKeywords, VerifyKeywords, RigKeywords):
        for name in declared(table):
            assert f"<td><code>{name}</code></td>" in page, name
