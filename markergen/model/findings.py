"""What is wrong with a file, as ``path: words (got ...)``: the same wording for every reader."""

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from markergen.errors import brief

if TYPE_CHECKING:
    from pydantic import ValidationError

Location = Sequence[int | str]
"""Steps to a place in a file: keys and indices."""

SHOWN = 20
"""How many findings a message lists; it then says how many more there are."""

UNNAMED = "="
"""Begins those steps of a path that the reader of a file does not see there."""

_WORDS = {"missing": "missing", "extra_forbidden": "unknown key"}


def findings_of(error: "ValidationError", known: Callable[[Location], Iterable[str]] = lambda _: ()) -> list[str]:
    """Findings of a pydantic check, each with its path, such as ``control_points[2].x``.

    `known` tells which keys there may be beside an unknown one, for what is nearly one of them.
    """
    return [
        f"{path_of(item['loc'])}: {_WORDS.get(item['type'], item['msg'].removeprefix('Value error, '))}"
        + (_nearest(item["loc"], known) if item["type"] == "extra_forbidden" else "")
        # What a missing key got is the whole table around it.
        + ("" if item["type"] == "missing" else f" (got {brief(item['input'])})")
        for item in error.errors()
    ]


def _nearest(location: Location, known: Callable[[Location], Iterable[str]]) -> str:
    key = str(location[-1])
    near = get_close_matches(key, known(location), n=1) if len(key) <= 40 else []
    return f", did you mean {near[0]!r}?" if near else ""


def listed(findings: Sequence[str], shown: int = SHOWN) -> str:
    """All findings in one line; of more than 20, or another number, the first ones, and how many more there are."""
    more = len(findings) - shown
    return "; ".join(findings[:shown]) + (f"; and {more} more" if more > 0 else "")


def path_of(location: Location) -> str:
    """Path of a place in a file: ``("control_points", 2, "x")`` is ``control_points[2].x``, the whole is ``file``."""
    seen = (part for part in location if not str(part).startswith(UNNAMED))
    return "".join(_step(part) for part in seen).removeprefix(".") or "file"


def _step(part: int | str) -> str:
    plain = isinstance(part, str) and part.isidentifier() and len(part) <= 40
    return f".{part}" if plain else f"[{brief(part)}]"
