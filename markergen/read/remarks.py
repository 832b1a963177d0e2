"""What readers report besides their result: what they did not use of a file, and what they doubt."""

# tests: tests/read/test_remarks.py

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from markergen.errors import brief

LOG = logging.getLogger("markergen")
MOST_LISTED = 12
"""Maximum number of names in one remark."""

_COLLECTED: ContextVar[list[str] | None] = ContextVar("remarks", default=None)


def remark(line: str) -> None:
    """Add a line to the remarks that are collected, or else log it as a warning."""
    lines = _COLLECTED.get()
    if lines is None:
        LOG.warning("%s", line)
    elif line not in lines:
        lines.append(line)


def remark_unused(file: str, names: Iterable[str]) -> None:
    """Report in one line which parts of a file were not used, if any."""
    listed = list(dict.fromkeys(names))
    more = f" and {len(listed) - MOST_LISTED} more" if len(listed) > MOST_LISTED else ""
    if listed:
        parts = ", ".join(
            name if name.isprintable() and len(name) <= 60 else brief(name) for name in listed[:MOST_LISTED]
        )
        remark(f"not used of {file}: {parts}{more}")


@contextmanager
def collected_remarks() -> Iterator[list[str]]:
    """Collect the remarks made inside, instead of logging them."""
    lines: list[str] = []
    token = _COLLECTED.set(lines)
    try:
        yield lines
    finally:
        _COLLECTED.reset(token)
