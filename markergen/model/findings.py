"""Findings about a file, as ``path: words (got ...)``: the same wording for every reader."""
# tests: tests/drawing/test_sheet_layout.py tests/model/test_marker_file.py

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from markergen.errors import brief

if TYPE_CHECKING:
    from pydantic import ValidationError

Location = Sequence[int | str]
"""Path to a place in a file: keys and indices."""

SHOWN = 20
"""Maximum number of findings listed in a message, which then counts the others."""

UNNAMED = "="
"""Prefix of path steps that do not exist in the file itself."""

_WORDS = {"missing": "missing", "extra_forbidden": "unknown key"}


def findings_of(error: "ValidationError", keys_at: Callable[[Location], Iterable[str]] = lambda _: ()) -> list[str]:
    """Return the findings of a pydantic check, each with its path, such as ``control_points[2].x``.

    `known` returns the valid keys at the place of an unknown one, to suggest the nearest.
    """
    return [
        f"{place_path(item['loc'])}: {_WORDS.get(item['type'], item['msg'].removeprefix('Value error, '))}"
        + (_nearest(item["loc"], keys_at) if item["type"] == "extra_forbidden" else "")
        # For a missing key, the input is the whole table around it.
        + ("" if item["type"] == "missing" else f" (got {brief(item['input'])})")
        for item in error.errors()
    ]


def _nearest(location: Location, keys_at: Callable[[Location], Iterable[str]]) -> str:
    key = str(location[-1])
    matches = get_close_matches(key, keys_at(location), n=1) if len(key) <= 40 else []
    return f", did you mean {matches[0]!r}?" if matches else ""


def in_one_line(findings: Sequence[str], most: int = SHOWN) -> str:
    """Join findings in one line; of more than `shown`, only the first ones, and how many more there are."""
    more = len(findings) - most
    return "; ".join(findings[:most]) + (f"; and {more} more" if more > 0 else "")


def place_path(location: Location) -> str:
    """Return the path of a place: ``("control_points", 2, "x")`` is ``control_points[2].x``, the root is ``file``."""
    seen = (part for part in location if not str(part).startswith(UNNAMED))
    return "".join(_step(part) for part in seen).removeprefix(".") or "file"


def _step(part: int | str) -> str:
    plain = isinstance(part, str) and part.isidentifier() and len(part) <= 40
    return f".{part}" if plain else f"[{brief(part)}]"
