"""What the book makes of links out of docs/, which a repository shows and the book does not, and of formulas."""

import html
import re
from typing import Any

from docs.numbers import ROOT

HOME = "https://github.com/markergen/markergen/blob/main/"


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page whose links out of docs/ go to the repository; the release notes are CHANGELOG.md."""
    if page.file.src_uri == "changelog.md":
        text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
        text = re.sub(r"\]\((?!https?:|#|docs/)", "](../", text)
        markdown = text.replace("](docs/", "](")
    return markdown.replace("](../", f"]({HOME}")


def on_page_content(content: str, **_: Any) -> str:
    """Return a page whose formulas are MathML, which browsers draw by themselves."""
    from latex2mathml.converter import convert

    def drawn(found: re.Match[str]) -> str:
        if found[1] == "span":
            return convert(html.unescape(found[2]))
        # A phone is narrower than some formulas.
        return f'<div style="overflow-x:auto">{convert(html.unescape(found[2]), display="block")}</div>'

    return re.sub(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', drawn, content, flags=re.DOTALL)
