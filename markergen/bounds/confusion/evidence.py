"""Evidence by which the detector decides between two labelings of the same images.

A labeling whose places miss the images by a sum of squares R, px^2, has the log likelihood, up to what labelings of the
same images share,

    L(R) = log sum over b of w_b s_b^(-2 (n - 3)) exp(-R/(2 s_b^2)),    s_b^2 = center^2 + print^2 + beyond_b^2,

the likelihood of 2n coordinates, integrated over the six of the pose, and averaged over the error that lens, print and
refraction may add (docs/detect.md); center is the error of a dot by its grey levels, print that of a print. Errors of
sigma px in every coordinate leave R = (2n - 6) sigma^2 of the true labeling on average, a chi-square, and D^2 more of a
rival at distance D (see `rival_fits`), with a standard deviation of 2 D sigma. The detector decides where the
difference of L is `DECIDED` or more. Outlines, which it also compares, and kinds are ignored.
"""

from functools import reduce

import numpy as np

from markergen.arrays import Array
from markergen.defaults import PRINT_SIGMA
from markergen.units import two_digits

DECIDED = 8.0
"""Difference of evidence, in nats, from which on the detector decides."""

BEYOND, SHARES, OF_EXTENT = (0.04, 0.13, 0.4, 0.3), (0.4, 0.3, 0.2, 0.1), 0.005
"""Errors in px that may be added to all places, and their probabilities; the last also grows by a share of the layout's
extent in the image. All as in detector/src/label.c, and `DECIDED` as in detect.c."""

LEAST_DOTS = 4
"""Number of dots below which any labels fit."""

EQUAL = 0.7
"""Difference in nats below which labelings are about as likely, a factor of 2."""

ENOUGH = "3000 times is enough"
"""`DECIDED` in words."""

RARELY = 1e-3
"""Share of views that may be undecided where labels count as safe."""

CENTER_PX = 0.02
"""Standard deviation in px of a coordinate by its dot's grey levels: 0.004 to 0.05 in usual images."""

NODES, TAIL = 256, 1e-7
"""Nodes of the integral over the true labeling's misfit, and the probability beyond its limits: with 2048 nodes
shares differ by 0.004 at most, and those of about 0.001 by 0.2 %."""

LARGE = 92
"""Margin in nats beyond which sentences state no more than that: a factor of 10^40."""

HALVINGS = 40
"""Bisections for the sum of squares at which labels are just decided, to 1e-12 of the range."""


def margin(distance: Array, n: int, scale: Array, size: float, sigma: float) -> Array:
    """Difference (K,) in nats of the evidence for n dots' true labels and for rivals at a distance (K,) in px.

    That of the expected misfits, up to a fifth below the expected difference of 12 dots. inf at an infinite distance; 0
    for fewer than four dots, which fit with any labels.

    Parameters
    ----------
    scale : array (K,), px per m
        Of the image.
    size : float
        Largest distance of a dot from the dots' middle, m.
    sigma : float
        Standard deviation of the errors in every coordinate, px.
    """
    if n < LEAST_DOTS:
        return np.zeros_like(distance)
    variances, left = _variances(scale, size), (2 * n - 6) * sigma**2
    return _log_likelihood(np.full_like(distance, left), n, variances) - _log_likelihood(
        left + distance**2, n, variances
    )


def undecided(distance: Array, n: int, scale: Array, size: float, sigma: float) -> Array:
    """Probability (K,) that errors of sigma px leave the labels undecided beside rivals; parameters of `margin`."""
    from scipy.special import erfc, gammaincinv, xlogy

    if n < LEAST_DOTS:
        return np.ones_like(distance)
    first, last = gammaincinv(n - 3, [TAIL, 1 - TAIL])
    nodes = np.linspace(first, last, NODES)
    density = xlogy(n - 4, nodes) - nodes
    weights = np.exp(density - density.max())
    weights[[0, -1]] /= 2
    variances = _variances(scale, size)
    left = (2 * sigma**2 * nodes)[:, None] + np.zeros_like(distance)
    least = _log_likelihood(left, n, variances) - DECIDED
    # L falls by 1/(2 s^2) or more per px^2.
    low, high = left, left + 2 * DECIDED * variances[-1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_likely = _log_likelihood(middle, n, variances) > least
        low, high = np.where(is_likely, middle, low), np.where(is_likely, high, middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = (left + distance**2 - low) / (2 * distance * sigma)
    share = 0.5 * erfc(np.where(np.isinf(distance), np.inf, excess) / np.sqrt(2))
    return np.asarray(weights @ share / weights.sum())


def odds(difference: float) -> str:
    """How many times as likely the true labels are, in words, for a difference of evidence in nats.

    >>> odds(0.3), odds(5.0), odds(12.34), odds(678.0)
    ('about as likely as', '150 times as likely as', '10^5 times as likely as', 'over 10^40 times as likely as')
    """
    if difference < EQUAL:
        return "about as likely as"
    factor = two_digits(np.exp(difference)) if difference < np.log(1e4) else f"10^{difference / np.log(10):.0f}"
    return f"{factor if difference < LARGE else 'over 10^40'} times as likely as"


def _variances(scale: Array, size: float) -> list[Array]:
    """Variances s_b^2 (K,) in px^2, from the least to the largest."""
    allowed = CENTER_PX**2 + np.square(PRINT_SIGMA * scale)
    largest = np.maximum(BEYOND[-1] + OF_EXTENT * scale * size, BEYOND[-2])
    return [allowed + np.square(beyond) for beyond in (*BEYOND[:-1], largest)]


def _log_likelihood(squares: Array, n: int, variances: list[Array]) -> Array:
    parts = [
        np.log(share) - (n - 3) * np.log(variance) - squares / (2 * variance)
        for share, variance in zip(SHARES, variances, strict=True)
    ]
    return np.asarray(reduce(np.logaddexp, parts))
