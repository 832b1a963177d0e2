"""Noise of the dots of real photographs, estimated from the photographs.

The covariance of a dot is that of the grey levels' noise. JPEG, sharpening, the paper's texture and reflections move
dots by more, each dot another way, while a bent print, a poor lens model or a rolling shutter move neighbors alike. So
what a smooth field over the marker leaves of the residuals of a photograph is noise: the variance t^2, px^2, which all
its dots have beyond their own s^2, makes the sum of squares what is expected of it (R. Paule and J. Mandel, 1982),

    sum |y|^2 = 2 sum rho (1 - h),    y = residuals / sqrt(s^2 + t^2) less their polynomials of degree 3 in x and y,

with rho the share of its variance that a residual keeps beside a free dot, and h the leverage in the polynomials,
which contain what poses and lens take up. The adjustment is one with free dots and as many parameters of the lens as
there are, so that neither counts as noise.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2 as chi2_distribution

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment

DEGREE, DOTS_A_TERM = 3, 2
"""Largest degree of the smooth field, and fewest dots for each of its terms; else the degree is lower."""

LEAST_EXPECTED = 8.0
"""Expected sum of squares, or degrees of freedom, below which a photograph does not show its noise."""

BY_LUCK = 0.01
"""Probability of a sum of squares of all photographs as large by their own noise alone, above which it is all."""


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
    if chi2_distribution.sf(total, expected) > BY_LUCK:
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
