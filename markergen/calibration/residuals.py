"""What the residuals of a network tell: outliers, the noise of the photographs, and what else is not as modeled.

Outliers are dots that are not where all the others say. A measurement's residual r, with the covariance A that it has
in the adjustment (`Adjustment.residual_covariance`), is tested by r' A^-1 r / s^2, which has two degrees of freedom
(W. Baarda's data snooping); s^2 is a robust estimate of the variance factor, so that a marker that bends or a poor lens
model does not make outliers of everything. The search starts from an adjustment with a robust cost (Cauchy's), and ends
when no measurement changes sides.

The covariance of a dot is that of the grey levels' noise. JPEG, sharpening, the paper's texture and reflections move
dots by more, each dot another way, while a bent print, a poor lens model or a rolling shutter move neighbors alike. So
what a smooth field over the marker leaves of the residuals of a photograph is noise: the variance t^2, px^2, which all
its dots have beyond their own s^2, makes the sum of squares what is expected of it (R. Paule and J. Mandel, 1982),

    sum |y|^2 = 2 sum rho (1 - h),    y = residuals / sqrt(s^2 + t^2) less their polynomials of degree 3 in x and y,

with rho the share of its variance that a residual keeps beside a free dot, and h the leverage in the polynomials,
which contain what poses and lens take up. The adjustment is one with free dots and as many parameters of the lens as
there are, so that neither counts as noise.
"""

# tests: tests/calibration/test_residuals.py tests/calibration/test_noise.py

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri

from markergen.arrays import Array, Indices, Mask
from markergen.calibration.adjustment import Adjustment, UndeterminedError, adjust, attempt
from markergen.calibration.camera_choice import wider_lenses
from markergen.calibration.flexing import Flex
from markergen.calibration.judging import CHANCE, NotJudged
from markergen.calibration.network import LEAST_DOTS, Network, Views
from markergen.model.rescale import POOR_FIT

FALSE_ALARM = 1e-3
"""Probability that any measurement of a network without outliers is rejected."""

MISFIT = 1e-3
"""Probability of residuals as large as they are by the image's noise alone, below which a model misses something."""

CAUCHY = 2.385
"""Scale of Cauchy's cost in sigma: 95 % efficiency for Gaussian errors."""

MEDIAN = float(chdtri(2, 0.5))

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
    limit = float(chdtri(2, FALSE_ALARM / max(1, views.seen.sum())))
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


DEGREE, DOTS_A_TERM = 3, 2
"""Largest degree of the smooth field, and fewest dots for each of its terms; else the degree is lower."""

LEAST_EXPECTED = 8.0
"""Expected sum of squares, or degrees of freedom, below which a photograph does not show its noise."""


def noise_of(adjusted: Adjustment, photo: Indices) -> Array:
    """Variances (v,) in px^2 of each axis of the dots of a view beyond their own; equal for views of one photograph.

    Parameters
    ----------
    photo : array (v,) of int
        Photograph of each view.
    """
    views_of = {number: np.flatnonzero(photo == number) for number in np.unique(photo)}
    fields = [_field(adjusted, view) for view in range(len(photo))]
    variance = np.zeros(len(photo))
    total, expected = _squares([field for field in fields if field], 0.0)
    if chdtrc(expected, total) > CHANCE:
        return variance
    for views in views_of.values():
        seen = [field for field in (fields[view] for view in views) if field]
        total, expected = _squares(seen, 0.0)
        if LEAST_EXPECTED < expected < total:
            most = 4 * max(float((residual**2).sum()) for residual, *_ in seen)
            variance[views] = brentq(lambda square, seen=seen: np.subtract(*_squares(seen, square)), 0, most, rtol=1e-3)
    return variance


_Field = tuple[Array, Array, Array, Array]
"""Residuals (m, 2), variances s^2 (m,), shares rho (m,) and polynomials (m, k) of the dots of a view."""


def _field(adjusted: Adjustment, view: int) -> _Field | None:
    """Field of a view; None if it has too few dots."""
    parts, places = adjusted.normal, adjusted.network.design
    dots = np.flatnonzero(adjusted.weights[view] > 0)
    degree = next((d for d in range(DEGREE, 0, -1) if DOTS_A_TERM * (d + 1) * (d + 2) / 2 <= len(dots)), 0)
    if not degree:
        return None
    information = parts.rest[: parts.dots, : parts.dots].reshape(len(places), 3, len(places), 3)[dots, :, dots, :]
    variance = np.trace(adjusted.views.covariance[view, dots], axis1=-2, axis2=-1) / 2
    rows = parts.rows_dot[view, dots]
    kept = 1 - np.einsum("nia,nab,nib->n", rows, np.linalg.inv(information), rows) / 2 / variance
    x, y = (places[dots, :2] - places[dots, :2].mean(axis=0)).T / np.ptp(places[dots, :2])
    terms = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    return adjusted.residual[view, dots], variance, kept, np.stack(terms, axis=-1)


def _squares(fields: Sequence[_Field], square: float) -> tuple[float, float]:
    """Sum of the squares that polynomials leave if dots have the variance `square` beyond their own, and its mean."""
    total = expected = 0.0
    for residual, variance, kept, terms in fields:
        scale = np.sqrt(variance + square)[:, None]
        smooth = np.linalg.qr(terms / scale)[0]
        rough = residual / scale
        total += float(((rough - smooth @ (smooth.T @ rough)) ** 2).sum())
        expected += 2 * float((kept * (1 - (smooth**2).sum(axis=1))).sum())
    return total, expected


ELSEWHERE = 10.0
"""chi2 per degree of freedom from which dots that were held are reported to be elsewhere."""

EXPLAINS = 0.5
"""Share of the excess of chi2 that a cause has to explain."""


def likely_cause(adjustment: Adjustment, flex: Flex | NotJudged) -> str:
    """Return what most likely is not as modeled; empty where residuals are as the noise explains.

    Larger lens models are tried in turn, the smallest one that explains the residuals is named.
    """
    factor, freedom = adjustment.variance_factor, adjustment.degrees_of_freedom
    network = adjustment.network
    if freedom <= 0 or factor < POOR_FIT:
        return ""
    if not network.free:
        return (
            f"the dots are not {'quite ' * (factor < ELSEWHERE)}where they were designed, or the photographs were "
            "processed: without --geometry nominal, calibrate says which"
        )
    if chdtrc(freedom, adjustment.chi2) > MISFIT:
        return ""
    for name, larger in wider_lenses(replace(network, cameras=adjustment.cameras)):
        fitted = attempt(larger, adjustment.views, adjustment.weights, adjustment.places)
        if fitted and factor - fitted.variance_factor > EXPLAINS * (factor - 1):
            camera = "the lens model is too small" if len(network.freedom) else "the camera is not quite the given one"
            return f"{camera}: with f, c, {name} free, chi2 falls to {fitted.variance_factor:.2g}"
    if isinstance(flex, Flex) and flex.bends:
        return "the print bends between the photographs"
    return "the photographs were processed (stabilized, rectified, sharpened) or taken in motion: no lens explains them"
