"""One tuner for every contestant: it tries the rows of their tables in turn, as many settings of each at most."""
# tests: tests/comparison/test_tuning.py

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any, Protocol, TypeVar

import numpy as np

from markergen.comparison.contestants import Choice

BUDGET = 40
"""Maximum number of settings that are tried for each contestant. None of ours needs more than 36 until no row of any
table is better; all combinations of a square tag's would be 540."""
NEARLY_ALL = 0.95
"""Minimum share of the best setting's detections for a setting to be eligible, however accurate it is."""

ROTATION, POSE = ("rotation_deg",), ("rotation_deg", "translation_pct")
"""Errors by which settings are chosen: with the first alone, AprilTag's own library is tuned to corners that are turned
right and lie 1 % too far inside, so that Z is 10 mm off at 1 m."""

Candidate = tuple[int, Choice]
"""Variant of a pattern, and a row of each other table."""


class Judged(Protocol):
    """What the tuner needs to know of one setting in one view."""

    @property
    def counts(self) -> bool:
        """True if it was detected and its pose has not failed."""

    @property
    def rotation_deg(self) -> float:
        """Rotation error, deg."""

    @property
    def translation_pct(self) -> float:
        """Translation error, %."""


J = TypeVar("J", bound=Judged)


def tune(
    tables: Mapping[str, Iterable[Any]],
    observe: Callable[[int, Choice], Sequence[J]],
    budget: int,
    errors: Sequence[str] = ROTATION,
) -> tuple[Candidate, list[tuple[Candidate, Sequence[J]]]]:
    """Search tables of settings by coordinate descent from the first row of each.

    Each round tries all rows of one table beside the best rows of the others, and takes the best setting so far. It
    ends when a round of every table has changed nothing, or `budget` settings have been tried.

    Parameters
    ----------
    tables : mapping
        Rows by the table's name; those of the first, ``pattern``, are variants of the pattern.
    observe : callable
        Observations of a variant with a setting, of the same views at each call.
    errors : sequence of str
        Errors that count, see `best_of`.

    Returns
    -------
    best : tuple
        Variant and setting.
    tried : list of tuples
        All variants and settings with their observations, in the order in which they were tried.
    """
    rows = [list(table) for table in tables.values()]
    tried: dict[tuple[Any, ...], Sequence[J]] = {}

    def candidate(key: tuple[Any, ...]) -> Candidate:
        return key[0], dict(zip(list(tables)[1:], key[1:], strict=True))

    def attempt(keys: Iterable[tuple[Any, ...]]) -> None:
        for key in keys:
            if key not in tried and len(tried) < budget:
                tried[key] = observe(*candidate(key))

    best = tuple(table[0] for table in rows)
    attempt([best])
    unchanged = 0
    for k in cycle(range(len(rows))):
        attempt((*best[:k], row, *best[k + 1 :]) for row in rows[k])
        previous, best = best, list(tried)[best_of(list(tried.values()), errors)]
        unchanged = 0 if best != previous else unchanged + 1
        if unchanged == len(rows) or len(tried) == budget:
            break
    return candidate(best), [(candidate(key), column) for key, column in tried.items()]


def best_of(columns: Sequence[Sequence[Judged]], errors: Sequence[str] = ROTATION) -> int:
    """Index of the setting with the least RMS error over the views found by all eligible settings.

    Parameters
    ----------
    columns : sequence
        Observations of each setting in the same views.
    errors : sequence of str
        Attributes of observations; of several, the product of their RMS counts, which no choice of units changes.
    """
    counts = np.array([[observation.counts for observation in column] for column in columns])
    rates = counts.mean(axis=1)
    eligible = np.flatnonzero(rates >= NEARLY_ALL * rates.max())
    common = counts[eligible].all(axis=0)
    if not common.any():
        return int(np.argmax(rates))
    score = np.ones(len(eligible))
    for name in errors:
        values = np.array([[getattr(observation, name) for observation in column] for column in columns])
        score *= np.mean(values[eligible][:, common] ** 2, axis=1)
    return int(eligible[np.argmin(score)])
