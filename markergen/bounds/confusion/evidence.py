"""Evidence by which the detector decides between two labelings of the same images.

A labeling whose places miss the images by a sum of squares R, px^2, has the log likelihood, up to what labelings of the
same images share,

    L(R) = log sum over b of w_b s_b^(-2 (n - 3)) exp(-R/(2 s_b^2)),    s_b^2 = sigma^2 + beyond_b^2,

the likelihood of 2n coordinates, integrated over the six of the pose, and averaged over the error that lens, print and
refraction may add (docs/detect.md). Noise of sigma px in every coordinate leaves R = (2n - 6) sigma^2 of the true
labeling on average, a chi-square, and D^2 more of a rival at distance D (see `rival_fits`), with a standard deviation
of 2 D sigma. The detector decides where the difference of L is `DECIDED` or more. Outlines, which it also compares, and
kinds are ignored.
"""

from functools import reduce

import numpy as np

from markergen.arrays import Array

DECIDED = 8.0
"""Difference of evidence, in nats, from which on the detector decides."""

BEYOND, SHARES, OF_EXTENT = (0.04, 0.13, 0.4, 0.3), (0.4, 0.3, 0.2, 0.1), 0.005
"""Errors in px that may be added to all places, and how likely each is; the last also grows by a share of the layout's
extent in the image."""

RARELY = 1e-3
"""Share of views that may be undecided where labels count as safe."""

QUANTILES = 32
"""Quantiles of the true labeling's misfit that an undecided share is the mean of; 1000 change it by 0.0025 at most."""

LARGE = 100
"""Margin beyond which sentences state no more than that."""

HALVINGS = 40
"""Bisections for the sum of squares at which labels are just decided, to 1e-9 of the range."""


def margin(distance: Array, n: int, extent: Array, sigma: float) -> Array:
    """Expected difference (K,) in nats of the evidence for n dots' true labels and for rivals at a distance (K,) in px.

    Parameters
    ----------
    extent : array (K,), px
        Largest distance of an image from the images' middle.
    sigma : float
        Standard deviation of the noise in every coordinate, px.
    """
    left = (2 * n - 6) * sigma**2
    return _log_likelihood(np.full_like(distance, left), n, extent, sigma) - _log_likelihood(
        left + distance**2, n, extent, sigma
    )


def undecided(distance: Array, n: int, extent: Array, sigma: float) -> Array:
    """Probability (K,) that noise of sigma px leaves the labels undecided beside rivals at a distance (K,) in px."""
    from scipy.special import erfc, gammaincinv

    share = (np.arange(QUANTILES) + 0.5) / QUANTILES
    left = (2 * sigma**2 * gammaincinv(n - 3, share))[:, None] + np.zeros_like(distance)
    least = _log_likelihood(left, n, extent, sigma) - DECIDED
    low, high = left, left + 1e3 * (1 + extent) ** 2 * n
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_likely = _log_likelihood(middle, n, extent, sigma) > least
        low, high = np.where(is_likely, middle, low), np.where(is_likely, high, middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = (left + distance**2 - low) / (2 * distance * sigma)
    return np.asarray(0.5 * erfc(np.where(np.isfinite(distance), excess, np.inf) / np.sqrt(2)).mean(axis=0))


def odds(margin: float) -> str:
    """How many times as likely the true labels are, in words.

    >>> odds(12.34), odds(9.51), odds(678.0)
    ('e^12', 'e^9.5', 'over e^100')
    """
    return f"e^{two_digits(margin)}" if margin < LARGE else f"over e^{LARGE:g}"


def two_digits(value: float) -> str:
    """Write a number with two digits, without an exponent.

    >>> two_digits(0.571), two_digits(163.4)
    ('0.57', '160')
    """
    return f"{float(f'{value:.2g}'):g}"


def _log_likelihood(squares: Array, n: int, extent: Array, sigma: float) -> Array:
    largest = np.maximum(BEYOND[-1] + OF_EXTENT * extent, BEYOND[-2])
    variances = [sigma**2 + np.square(beyond) for beyond in (*BEYOND[:-1], largest)]
    parts = [
        np.log(share) - (n - 3) * np.log(variance) - squares / (2 * variance)
        for share, variance in zip(SHARES, variances, strict=True)
    ]
    return np.asarray(reduce(np.logaddexp, parts))
