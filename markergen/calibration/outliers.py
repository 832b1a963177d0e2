"""Outliers of a network: dots that are not where all the others say, found and left out.

A measurement's residual r, with the covariance A that it has in the adjustment (`Adjustment.residual_covariance`), is
tested by r' A^-1 r / s^2, which has two degrees of freedom (W. Baarda's data snooping); s^2 is a robust estimate of
the variance factor, so that a marker that bends or a poor lens model does not make outliers of everything. The search
starts from an adjustment with a robust cost (Cauchy's), and ends when no measurement changes sides.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from markergen.arrays import Array, Mask
from markergen.calibration.adjustment import Adjustment, UndeterminedError, adjust
from markergen.calibration.network import LEAST_DOTS, Network, Views

FALSE_ALARM = 1e-3
"""Probability that any measurement of a network without outliers is rejected."""

CAUCHY = 2.385
"""Scale of Cauchy's cost in sigma: 95 % efficiency for Gaussian errors."""

MEDIAN = float(chi2_distribution.median(2))

LEAST_WEIGHT = 1e-6
"""Factor on weights below which the robust cost does not go, so that every dot stays determined."""

UNTESTABLE = 1e-4
"""Share of its covariance that a residual must keep along an axis; otherwise the measurement is not controlled."""

_ROBUST_ROUNDS, _ROUNDS, _SETTLED = 15, 30, 0.05
"""Maximum number of adjustments with a robust cost, and without outliers; change of weights at which the former end."""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """An adjustment without outliers: masks of views (v,) that are left, of outliers (v, n) in all views, and of dots.

    The dots (n,) that are left are those that two views or more see rightly, or one if they are held.
    """

    adjustment: Adjustment
    used: Mask
    dropped: Mask
    dots: Mask


def adjust_robustly(network: Network, views: Views) -> Cleaned:
    """Adjust a network with a robust cost, and again without its outliers.

    Raises
    ------
    UndeterminedError
        If the photographs do not determine the unknowns.
    """
    dots = views.seen.sum(axis=0) >= (2 if network.free else 1)
    return _cleaned(network, views, dots)


def _cleaned(network: Network, views: Views, dots: Mask) -> Cleaned:
    """Adjust the dots of a network that are left."""
    whole = network, views
    network, views = network.of_dots(dots), views.of_dots(dots)
    used = views.seen.sum(axis=1) >= LEAST_DOTS
    if not used.any():
        raise UndeterminedError("photographs that show four dots or more")
    limit = float(chi2_distribution.isf(FALSE_ALARM / max(1, views.seen.sum()), 2))
    adjusted = adjust(network, views.take(used))
    test = _tested(adjusted)
    if test.max(initial=0.0) > limit:
        # A robust start: one outlier hides others, and spoils the pose of its view.
        weights = np.ones(test.shape)
        for _ in range(_ROBUST_ROUNDS):
            before, weights = weights, np.maximum(1 / (1 + test / CAUCHY**2), LEAST_WEIGHT)
            if np.abs(weights - before).max() < _SETTLED:
                break
            adjusted = adjust(network, adjusted.views, weights, adjusted.places)
            test = _tested(adjusted)
    dropped = np.zeros(views.seen.shape, dtype=bool)
    states: set[bytes] = set()
    for _ in range(_ROUNDS):
        outside = np.zeros(views.seen.shape, dtype=bool)
        outside[used] = adjusted.views.seen & (test > limit)
        # What was taken until now goes the worst first, since it spoils the others of its view.
        new = (outside & dropped) | (dropped & ~used[:, None])
        new[used] |= _worst(outside[used] & ~dropped[used], test)
        left = used & ((views.seen & ~new).sum(axis=1) >= LEAST_DOTS)
        settled = np.array_equal(new, dropped) and np.array_equal(left, used)
        if settled and (adjusted.weights[adjusted.views.seen & ~dropped[used]] == 1).all():
            break
        if new.tobytes() in states:
            new |= dropped  # A measurement that changes sides again and again stays out.
        states.add(new.tobytes())
        if not left.any():
            raise UndeterminedError("photographs whose dots agree with each other")
        taken = (views.seen & ~new)[left].sum(axis=0) >= (2 if network.free else 1)
        if not taken.all():
            rest = dots.copy()
            rest[dots] = taken
            return _cleaned(*whole, rest)
        start, dropped, used = adjusted.views.take(left[used]), new, left
        adjusted = adjust(network, start, (~dropped[used]).astype(float), adjusted.places)
        test = _tested(adjusted)
    everywhere = np.zeros((len(used), len(dots)), dtype=bool)
    everywhere[:, dots] = dropped
    return Cleaned(adjusted, used, everywhere, dots)


def _tested(adjusted: Adjustment) -> Array:
    """Test statistics (v, n) in units of the robust variance factor; 0 where a dot was not seen."""
    spread, measured = adjusted.residual_covariance(), adjusted.views.covariance
    values, vectors = np.linalg.eigh(spread)
    controlled = values > UNTESTABLE * np.linalg.eigvalsh(measured)
    along = np.einsum("vnij,vni->vnj", vectors, adjusted.residual) ** 2
    test = np.where(controlled, along / np.where(controlled, values, 1.0), 0.0).sum(axis=-1)
    taken = (adjusted.weights > 0) & controlled.all(axis=-1)
    factor = float(np.median(test[taken])) / MEDIAN if taken.any() else 1.0
    return np.where(adjusted.views.seen, test / max(factor, 0.1), 0.0)


def _worst(chosen: Mask, test: Array) -> Mask:
    """Keep the worst quarter of each row's chosen entries, at least one."""
    order = np.argsort(np.argsort(np.where(chosen, -test, np.inf), axis=1), axis=1)
    return chosen & (order < np.maximum(1, chosen.sum(axis=1, keepdims=True) // 4))
