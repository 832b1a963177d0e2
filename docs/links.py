"""What the book makes of pages: links out of docs/, formulas drawn, and the keywords of functions."""

import html
import re
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

import markergen
from docs.numbers import ROOT
from markergen.options import GROUPS, declared
from markergen.options.kinds import KINDS

HOME = "https://github.com/markergen/markergen/blob/main/"


def keywords(function: Callable[..., Any]) -> str:
    """Return the tables of a function's keywords from where they are declared; empty if it has none of its own."""
    hints = {} if isinstance(function, type) else get_type_hints(function, include_extras=True)
    tables = [get_arg for hint in hints.values() for get_arg in get_args(hint) if hasattr(get_arg, "__required_keys__")]
    if not tables:
        return ""
    options = declared(tables[0])
    rows = [f"Keywords of `{function.__name__}`:\n", "| keyword | takes | default | |", "|---|---|---|---|"]
    for group in GROUPS:
        for name, option in options.items():
            if option.group == group:
                phrase = (f"`{KINDS[option.kind].accepted}`", _plain(option.shown), _plain(option.help))
                rows.append(f"| `{name}` | " + " | ".join(phrase) + " |")
    return "\n".join(rows) + "\n"


def _plain(text: str) -> str:
    return re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", text)


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page as the book has it; the release notes are CHANGELOG.md."""
    if page.file.src_uri == "changelog.md":
        text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
        text = re.sub(r"\]\((?!https?:|#|docs/)", "](../", text)
        markdown = text.replace("](docs/", "](")
    if page.file.src_uri == "api.md":
        markdown = re.sub(
            r"^::: markergen\.(\w+)$",
            lambda result: f"{result.group()}\n\n{keywords(getattr(markergen, result.group(1)))}",
            markdown,
            flags=re.MULTILINE,
        )
    return markdown.replace("](../", f"]({HOME}")


def on_page_content(content: str, **_: Any) -> str:
    """Return a page whose formulas are MathML, which browsers draw by themselves."""
    from latex2mathml.converter import convert

    def drawn(results: re.Match[str]) -> str:
        if results[1] == "span":
            return convert(html.unescape(results[2]))
        # A phone is narrower than some formulas.
        return f'<div style="overflow-x:auto">{convert(html.unescape(results[2]), display="block")}</div>'

    return re.sub(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', drawn, content, flags=re.DOTALL)
