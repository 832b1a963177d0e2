"""Text of JSON: numbers are finite and keys distinct, whether written or read; and findings about a file's content.

A finding is ``path: words (got ...)``: the same wording for every reader.
"""
# tests: tests/model/test_body_json.py tests/model/test_marker_file.py tests/drawing/test_sheet_layout.py

import json
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from math import isfinite
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.guard import Content, text_of
from markergen.units import with_point

if TYPE_CHECKING:
    from pydantic import ValidationError


def dumped(content: Any, indent: int | None = 2) -> str:
    """Return plain JSON values as text; raises InputError for others, and for numbers that are not finite."""
    try:
        return json.dumps(content, indent=indent, allow_nan=False, default=_plain)
    except RecursionError:
        actual = "endless nesting"
    except (TypeError, ValueError) as error:
        actual = str(error)[:80]
    raise InputError("a marker of plain JSON values and finite numbers", actual, "correct it where it was made")


def _plain(value: object) -> Any:
    """Convert NumPy numbers and arrays to Python's."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} {brief(value)}")


def json_of(content: Content) -> Any:
    """Parse a file that should be a marker.json or rig.json; raises InputError, which names another kind of file."""
    name = content.name
    kind = PurePath(name).suffix[1:].upper()
    if kind not in ("", "JSON") and not content.data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        remedy = "give the .json that was written with it"
        if kind == "CSV":
            remedy += ", or write one with markergen design --points"
        raise InputError(f"a marker.json at {name}", f"a {kind} file", remedy)
    return parsed(text_of(content), name)


def parsed(text: str, name: str) -> Any:
    """Parse JSON with distinct keys and finite numbers; `name` is the file's name in messages. Raises InputError."""
    if not text:
        raise InputError(f"JSON in {name}", "an empty file", "check the path")
    try:
        return json.loads(
            text, object_pairs_hook=distinct, parse_constant=_number, parse_float=_number, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        actual = f"line {error.lineno} column {error.colno}: {error.msg}"
    except RecursionError:
        actual = "endless nesting"
    except ValueError as error:
        actual = str(error)
    raise InputError(f"complete JSON in {name}", actual, "the file is cut off or damaged: write it again or restore it")


def parsed_toml(text: str, name: str) -> dict[str, Any]:
    """Parse TOML; `name` is the file's name in messages. Raises InputError."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        problem = str(error)
    except (ValueError, RecursionError):
        problem = "an endless number or endless nesting"
    remedy = _toml_remedy(text, problem) or "correct it there, or write it again"
    raise InputError(f"complete TOML in {name}", problem, remedy)


def _toml_remedy(text: str, problem: str) -> str:
    """What to write in the line of a problem; empty if it is none of the usual mistakes."""
    number = re.search(r"at line (\d+)", problem)
    key, _, rest = text.split("\n")[int(number[1]) - 1].partition("=") if number else ("", "", "")
    key, value = key.strip(), rest.partition("#")[0].strip()
    if "\\" in value:
        path = value.strip('"')
        return f"write / for each backslash, or put the path in single quotes: {key} = '{path}'"
    if pointed := with_point(value):
        return f'write a point: {key} = "{pointed}"'
    is_bare = re.fullmatch(r"[\w:.-]+", value) and re.search(r"[a-zA-Z]", value)
    return f'write quotes: {key} = "{value}"' if is_bare and value not in ("true", "false") else ""


def distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; raises ValueError if a key is in it twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        (key, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"the key {brief(key)} twice in one object")
    return content


def _number(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"the number {text if len(text) < 20 else text[:17] + '...'}, which is not finite")
    return value


def _integer(text: str) -> int:
    _number(text)  # Python's own message for thousands of digits is different
    return int(text)


Location = Sequence[int | str]
"""Path to a place in a file: keys and indices."""

SHOWN = 20
"""Maximum number of findings listed in a message, which then counts the others."""

UNNAMED = "="
"""Prefix of path steps that do not exist in the file itself."""

_WORDS = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    **dict.fromkeys(("model_type", "dict_type", "model_attributes_type"), "should be a table of values"),
}


def findings_of(error: "ValidationError", keys_at: Callable[[Location], Iterable[str]] = lambda _: ()) -> list[str]:
    """Return the findings of a pydantic check, each with its path, such as ``control_points[2].x``.

    `known` returns the valid keys at the place of an unknown one, to suggest the nearest.
    """
    return [
        f"{place_path(item['loc'])}: {_WORDS.get(item['type'], item['msg'].removeprefix('Value error, '))}"
        + (_nearest(item["loc"], keys_at) if item["type"] == "extra_forbidden" else "")
        # For a missing key, the input is the whole table around it; a parser's error has it already.
        + ("" if item["type"] == "missing" or refusal_in(item) else f" (got {brief(item['input'])})")
        for item in error.errors()
    ]


def refusal_in(item: Mapping[str, Any]) -> InputError | None:
    """Return the error of a parser that a finding of pydantic passes on with all its words."""
    error = item.get("ctx", {}).get("error")
    refusal = getattr(error, "__context__", None)
    return refusal if isinstance(refusal, InputError) and str(error).endswith(str(refusal)) else None


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
