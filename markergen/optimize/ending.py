"""Ends searches early: after a time, or when asked to, such as by Ctrl-C.

A search looks up, a few times a second, whether the `TimeLimit` of its context is reached. Whoever has a layout by then
catches `Ended`, and returns the best.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from math import inf
from time import monotonic


class Ended(BaseException):
    """The search has to end."""


@dataclass(eq=False)
class TimeLimit:
    """When searches end: at a time of `time.monotonic`, or when `asked`; `ended` once one has."""

    at: float = inf
    asked: bool = False
    ended: bool = False


_LIMIT: ContextVar[TimeLimit | None] = ContextVar("limit", default=None)


@contextmanager
def limited(limit: TimeLimit | None) -> Iterator[None]:
    """Have searches end at a limit; None lets what has to be done take its time."""
    token = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(token)


def current_limit() -> TimeLimit:
    """Return the limit of this context, or one that is never reached."""
    return _LIMIT.get() or TimeLimit()


def is_due() -> bool:
    """Return whether searches have to end."""
    limit = _LIMIT.get()
    return limit is not None and (limit.asked or monotonic() >= limit.at)


def end_if_due(*_: object) -> None:
    """Raise `Ended` if searches have to end."""
    if is_due():
        current_limit().ended = True
        raise Ended
