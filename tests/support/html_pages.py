"""Checks that every page must pass: whole, loading nothing, and to be read without seeing it."""

import base64
import hashlib
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

from markergen.presentation.pages import BOOK

DOCS = Path(__file__).parents[2] / "docs"


class Page(HTMLParser):
    """Elements of a page, its tables as rows of cells, its scripts; each element must be closed in its place."""

    VOID = frozenset({"meta", "img", "br", "link", "hr"})

    def __init__(self, made):
        super().__init__()
        self.text = made.decode()
        self.elements, self.open, self.tables, self.titles, self.scripts = [], [], [], [], []
        self.feed(self.text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("th", "td"):
            self.tables[-1][-1].append("")

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        inside = next((tag for tag in reversed(self.open) if tag in ("th", "td", "caption")), "")
        if inside in ("th", "td"):
            self.tables[-1][-1][-1] += data
        elif inside == "caption":
            self.titles.append(data)
        elif self.open and self.open[-1] == "script":
            self.scripts.append(data)

    def of(self, tag):
        """Attributes of all elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]

    def table(self, title):
        """Rows of the table whose title begins so, without its header."""
        return next(rows for name, rows in zip(self.titles, self.tables, strict=True) if name.startswith(title))[1:]

    @property
    def sections(self):
        return tuple(attributes["id"] for attributes in self.of("section"))


def check(made, files=()):
    """Check a page's bytes and return its elements; `files` beside it may be linked to."""
    result = Page(made)
    assert result.text.startswith("<!DOCTYPE html>")
    assert result.of("html") == [{"lang": "en"}]
    _loads_nothing(result, files)
    _is_allowed_its_own_script(result)
    _is_read_without_seeing(result)
    return result


def _loads_nothing(result, files):
    assert not {tag for tag, _ in result.elements} & {"link", "iframe", "object", "embed", "base", "form"}
    assert not [a for a in result.of("script") if a]
    assert "@import" not in result.text
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", result.text))
    for tag, attributes in result.elements:
        assert not [name for name in attributes if name.startswith("on")]
        for name in attributes.keys() & {"src", "href", "xlink:href"}:
            target = attributes[name]
            if tag in ("img", "image"):
                assert target.startswith("data:image/")
            elif target.startswith(BOOK):
                _is_in_the_book(target.removeprefix(BOOK))
            else:
                assert target.startswith("#") or target in files


def _is_in_the_book(target):
    name, _, heading = target.partition("#")
    headings = re.findall(r"^#+ (.*)$", (DOCS / name).read_text(), flags=re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", item.lower()).replace(" ", "-") for item in headings}
    assert not heading or heading in slugs, target


def _is_allowed_its_own_script(result):
    policy = next(a["content"] for a in result.of("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:")
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in result.scripts]
    assert re.findall(r"script-src '([^']*)'", policy) == [f"sha256-{script}" for script in hashes]
    assert len(hashes) == any("data-dome" in a for a in result.of("div"))


def _is_read_without_seeing(result):
    ids = [attributes["id"] for _, attributes in result.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    referred = {
        value[1:] for _, a in result.elements for key, value in a.items() if key.endswith("href") and value[0] == "#"
    }
    referred |= {a["aria-labelledby"] for _, a in result.elements if "aria-labelledby" in a}
    referred |= set(re.findall(r"url\(#([^)]*)\)", result.text))
    assert referred <= set(ids)
    assert all(len(item["aria-label"]) > 20 and item["role"] == "img" for item in result.of("svg"))
    assert all(attributes["alt"] for attributes in result.of("img"))
    assert all(attributes.get("scope") in ("col", "row") for attributes in result.of("th"))
    levels = [int(tag[1]) for tag, _ in result.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
