"""The book is read from a folder, without a server: its search finds what is in it."""

import pytest

from tests.support.book import build

pytestmark = pytest.mark.browser


def test_search_works_from_a_folder(opened, tmp_path):
    home = build(tmp_path / "book").as_uri()
    with opened(f"{home}/start.html", allowed=lambda url: url.startswith(home)) as page:
        page.focus("input.md-search__input")
        page.keyboard.type("ambiguous labeling", delay=20)
        page.wait_for_selector(".md-search-result__link")
        links = page.eval_on_selector_all(".md-search-result__link", "links => links.map(link => link.href)")
        assert all(link.startswith(home) for link in links)
        assert any("detect.html" in link for link in links)
