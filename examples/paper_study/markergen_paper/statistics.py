"""Statistical tests of the claims; each takes one value per pose.

The poses are given. Random are the layouts and their noise, which are drawn anew for each pose: the values of a test
are independent of one another, while runs and layouts of the same pose, which are not, are combined into one value.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from markergen.validation.metrics import share_interval

Array = NDArray[np.float64]

LEVEL = 5e-6
"""Significance level of a test. With about 3,000 two-sided tests, the probability of any false positive is below 3 %,
however they depend on one another.
"""

CONFIDENCE = 0.99


@dataclass(frozen=True)
class Judged:
    """Value, and the p-values of the tests for and against a claim about it.

    Attributes
    ----------
    value, low, high : float
        Value and its 99 % interval.
    p, p_against : float
        p-values of the test for the claim, and of that for the opposite; both are large if there are too few values.
    count : int
        Number of underlying values.
    """

    value: float
    low: float
    high: float
    p: float
    p_against: float
    count: int

    @property
    def holds(self) -> bool:
        """True if the claim was confirmed."""
        return self.p < LEVEL

    @property
    def refuted(self) -> bool:
        """True if the opposite was confirmed."""
        return self.p_against < LEVEL


NOTHING = Judged(np.nan, np.nan, np.nan, 1.0, 1.0, 0)
"""Result for no values."""


NO_A = "none"
"""Coordinates of a test in which A does not occur."""


@dataclass(frozen=True)
class ClaimTest:
    """Test of a claim.

    Attributes
    ----------
    coordinates : str
        Coordinates in which A is written, or `NO_A`.
    noise_px : float or None
        None if no noise is drawn.
    measure : str
        Compared quantity, in a few words.
    judged : Judged
    note : str
        Remark.
    """

    coordinates: str
    noise_px: float | None
    measure: str
    judged: Judged
    note: str = ""


def above(values: Array, threshold: float = 0.0) -> Judged:
    """Median of values (k,) and Wilcoxon signed-rank test that they lie above a threshold; nan is ignored."""
    kept = values[np.isfinite(values)] - threshold
    value, low, high = _median(kept) + threshold
    return Judged(value, low, high, *_signed_rank(kept), len(kept))


def below(values: Array, threshold: float = 0.0) -> Judged:
    """Median of values (k,) and Wilcoxon signed-rank test that they lie below a threshold; nan is ignored."""
    exceeding = above(values, threshold)
    return replace(exceeding, p=exceeding.p_against, p_against=exceeding.p)


def as_factor(judged: Judged) -> Judged:
    """Convert the logarithms of a result to factors."""
    value, low, high = np.exp([judged.value, judged.low, judged.high])
    return replace(judged, value=float(value), low=float(low), high=float(high))


def within(values: Array, margin: float) -> Judged:
    """Median of values (k,), and two one-sided signed-rank tests that they lie above -margin and below margin."""
    low, high = above(values, -margin), above(values, margin)
    return replace(low, p=max(low.p, high.p_against), p_against=min(low.p_against, high.p))


def majority(successes: int, count: int, share: float = 0.5) -> Judged:
    """Share of successes, and the binomial test that it exceeds a share."""
    from scipy.stats import binomtest

    if not count:
        return NOTHING
    low, high = share_interval(successes, count, CONFIDENCE)
    p, against = (binomtest(successes, count, share, alternative=side).pvalue for side in ("greater", "less"))
    return Judged(successes / count, low, high, float(p), float(against), count)


def never(successes: int, count: int) -> Judged:
    """Share of successes, of which there must be none: not a statistical test, so p is 0 or 1."""
    if not count:
        return NOTHING
    low, high = share_interval(successes, count, CONFIDENCE)
    return Judged(successes / count, low, high, float(successes > 0), float(successes == 0), count)


def falling(rows: Array) -> Judged:
    """Page's trend test that values fall along rows (k, m); the value is the median of first minus last."""
    from scipy.stats import page_trend_test

    kept = rows[np.isfinite(rows).all(axis=1)]
    if len(kept) < 2:
        return NOTHING
    p, against = (page_trend_test(side, method="asymptotic").pvalue for side in (-kept, kept))
    value, low, high = _median(kept[:, 0] - kept[:, -1])
    return Judged(value, low, high, float(p), float(against), len(kept))


def rank_correlation(first: Array, second: Array) -> Array:
    """Spearman's correlation (P,) of rows (P, B), over their finite pairs; nan for fewer than four."""
    from scipy.stats import rankdata

    result = np.full(len(first), np.nan)
    for row, (a, b) in enumerate(zip(first, second, strict=True)):
        kept = np.isfinite(a) & np.isfinite(b)
        if kept.sum() >= 4 and np.ptp(a[kept]) > 0 and np.ptp(b[kept]) > 0:
            result[row] = np.corrcoef(rankdata(a[kept]), rankdata(b[kept]))[0, 1]
    return result


def row_means(rows: Array) -> Array:
    """Means (P,) of the finite values of rows (P, B); nan if there are none."""
    finite = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(finite, rows, 0.0).sum(axis=1) / finite.sum(axis=1))


def _signed_rank(values: Array) -> tuple[float, float]:
    """p-values of the Wilcoxon test that values lie above 0, and that they lie below."""
    from scipy.stats import wilcoxon

    if len(values) < 2 or not values.any():
        return 1.0, 1.0
    # Of few values with ties scipy tries all signs, for a second, to find a p that is above LEVEL in any case.
    method = "auto" if len(np.unique(np.abs(values))) == len(values) and values.all() else "asymptotic"
    # Zeros count half for either side: if ignored, a claim without any difference would look certain.
    # That values lie below 0 is that their negatives lie above: both at once, as a call takes a millisecond.
    both = np.stack([values, -values])
    p, against = wilcoxon(both, alternative="greater", zero_method="zsplit", method=method, axis=1).pvalue
    return float(p), float(against)


def _median(values: Array) -> Array:
    """Median and its distribution-free interval from order statistics."""
    if not len(values):
        return np.full(3, np.nan)
    ordered, rank = np.sort(values), _rank(len(values))
    return np.array([np.median(ordered), ordered[rank - 1], ordered[-rank]])


@cache
def _rank(count: int) -> int:
    """Rank from either end of the order statistics that enclose the median with `CONFIDENCE`."""
    from scipy.stats import binom

    return max(int(binom.ppf((1 - CONFIDENCE) / 2, count, 0.5)), 1)
