"""One tuner for every contestant: it tries the rows of their tables in turn, the better ones in more views."""
# tests: tests/comparison/test_tuning.py

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any, Protocol, TypeVar

import numpy as np

from markergen.comparison.contestants import Choice

BUDGET = 40
"""Maximum number of settings that are tried for each contestant. None of ours needs more than 36 until no row of any
table is better; all combinations of a square tag's would be 540."""
SHARES = (4, 2, 1)
"""In which part of the views each round tries settings: a fourth, the better half of them in a half, and the last in
all. If it begins with an eighth, ArUco's tag goes another way, and 30 settings are tried in place of 18."""
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


def hardest_first(column: Sequence[Judged], errors: Sequence[str] = ROTATION) -> list[int]:
    """Indices of views by the error of a setting, the greatest first; those that it missed are spread evenly.

    A few distant frontal views make up most of an RMS, so the first part of this order tells settings apart nearly as
    well as all views do; with every second, fourth and eighth view in turn, circles are tuned to the wrong threshold.
    """
    counts = np.array([observation.counts for observation in column])
    size = np.prod([[getattr(observation, name) for observation in column] for name in errors], axis=0)
    order = np.argsort(np.where(counts, -size, 0.0), kind="stable")
    # In every part of the order, the share of missed views is that of all.
    place = np.zeros(len(column))
    for group in (order[counts[order]], order[~counts[order]]):
        place[group] = (np.arange(len(group)) + 0.5) / max(len(group), 1)
    return [int(k) for k in np.argsort(place, kind="stable")]


def tune(
    tables: Mapping[str, Iterable[Any]],
    observe: Callable[[int, Choice, Sequence[int]], Sequence[J]],
    views: Sequence[int],
    budget: int,
    errors: Sequence[str] = ROTATION,
) -> tuple[Candidate, list[tuple[Candidate, Sequence[J]]]]:
    """Search tables of settings by coordinate descent from the first row of each.

    Each step tries all rows of one table beside the best rows of the others by successive halving: all in the views
    that are hardest for the first setting, the better half of them in twice as many, and so on. Of the settings that
    have been tried in all views, the best goes on. The search ends when a step with every table has changed nothing,
    or `budget` settings have been tried.

    Parameters
    ----------
    tables : mapping
        Rows by the table's name; those of the first, ``pattern``, are variants of the pattern.
    observe : callable
        Observations of a variant with a setting in some views.
    views : sequence of int
        Views to choose by.
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
    tried: dict[tuple[Any, ...], list[J]] = {}
    order, ends = list(views), [len(views)]

    def candidate(key: tuple[Any, ...]) -> Candidate:
        return key[0], dict(zip(list(tables)[1:], key[1:], strict=True))

    def attempt(keys: Iterable[tuple[Any, ...]]) -> None:
        left = []
        for key in keys:
            if key in tried or len(tried) < budget:
                tried.setdefault(key, [])
                left.append(key)
        for end in ends:
            for key in left:
                tried[key] += observe(*candidate(key), order[len(tried[key]) : end])
            best_first = ranked([tried[key][:end] for key in left], errors)
            left = [left[k] for k in best_first[: (len(left) + 1) // 2]]

    best = tuple(table[0] for table in rows)
    attempt([best])
    hardest = hardest_first(tried[best], errors)
    order, tried[best] = [order[k] for k in hardest], [tried[best][k] for k in hardest]
    ends = sorted({-(-len(order) // share) for share in SHARES})
    unchanged = 0
    for k in cycle(range(len(rows))):
        attempt((*best[:k], row, *best[k + 1 :]) for row in rows[k])
        finalists = [key for key, column in tried.items() if len(column) == len(views)]
        previous, best = best, finalists[best_of([tried[key] for key in finalists], errors)]
        unchanged = 0 if best != previous else unchanged + 1
        if unchanged == len(rows) or len(tried) == budget:
            break
    return candidate(best), [(candidate(key), column) for key, column in tried.items()]


def ranked(columns: Sequence[Sequence[Judged]], errors: Sequence[str] = ROTATION) -> list[int]:
    """Indices of settings, each the best of itself and those after it; see `best_of`."""
    left, order = list(range(len(columns))), []
    while left:
        order.append(left.pop(best_of([columns[k] for k in left], errors)))
    return order


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
