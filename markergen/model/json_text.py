"""Text of JSON: numbers are finite and keys distinct, whether written or read."""
# tests: tests/model/test_marker_json.py tests/model/test_marker_file.py

import json
from collections import Counter
from collections.abc import Mapping
from math import isfinite
from pathlib import PurePath
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.guard import Content, text_of


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
        raise InputError(f"a marker.json at {name}", f"a {kind} file", "give the .json that was written with it")
    return parsed(text_of(content), name)


def parsed(text: str, name: str) -> Any:
    """Parse JSON with distinct keys and finite numbers; `name` is the file's name in messages. Raises InputError."""
    try:
        return json.loads(
            text, object_pairs_hook=_distinct, parse_constant=_number, parse_float=_number, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        actual = f"line {error.lineno} column {error.colno}: {error.msg}"
    except RecursionError:
        actual = "endless nesting"
    except ValueError as error:
        actual = str(error)
    raise InputError(
        f"complete JSON in {name}", actual, "the file is cut off or damaged: design it again or restore it"
    )


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
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
