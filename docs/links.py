"""What the book makes of links out of docs/: a repository shows all folders, the book this one only."""

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
