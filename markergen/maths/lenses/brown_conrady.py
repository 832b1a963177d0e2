"""``radtan`` and ``rational``: OpenCV's calibration models, a polynomial in r^2 or a quotient of two."""
# tests: tests/contracts/test_lenses.py

from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar

import numpy as np

from markergen.arrays import Array
from markergen.maths.lenses import LARGEST_RADIUS, LENSES, Coefficients, RadialModel, derivative, first_root, horner


class RadialTangential(RadialModel):
    """Brown-Conrady: s = 1 + k1 r^2 + k2 r^4 + k3 r^6, and the tangential terms p1, p2.

    **Domain.** The radial and tangential eigenvalues of the Jacobian are (s r)' and s. The tangential terms lower them
    by at most 6 |p| r, so the domain ends at the first r at which min((s r)', s) = 6 |p| r.
    """

    coefficients: ClassVar[tuple[tuple[str, ...], ...]] = (("k1", "k2", "p1", "p2"), ("k1", "k2", "p1", "p2", "k3"))
    aliases: ClassVar[tuple[str, ...]] = ("plumb_bob",)
    opencv = True

    def scale(self, square: Array, coefficients: Coefficients) -> Array:
        """See `RadialModel.scale`."""
        above, below, _, _ = _ratio(coefficients)
        scale = horner(square, above)
        return scale * (1 / horner(square, below)) if len(below) > 1 else scale

    def scale_and_slope(self, square: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """See `RadialModel.scale_and_slope`."""
        above, below, above_slope, below_slope = _ratio(coefficients)
        scale, slope = horner(square, above), horner(square, above_slope)
        if len(below) > 1:
            inverse = 1 / horner(square, below)
            scale = scale * inverse
            slope = (slope - scale * horner(square, below_slope)) * inverse
        return scale, slope

    def bend(self, square: Array, coefficients: Coefficients) -> Array:
        """See `RadialModel.bend`."""
        scale, slope = self.scale_and_slope(square, coefficients)
        _, below, above_slope, below_slope = _ratio(coefficients)
        bend = horner(square, derivative(above_slope))
        if len(below) > 1:
            bend = bend - 2 * slope * horner(square, below_slope) - scale * horner(square, derivative(below_slope))
            bend = bend / horner(square, below)
        return bend

    def scale_by_coefficients(self, square: Array, coefficients: Coefficients) -> Sequence[Array]:
        """See `RadialModel.scale_by_coefficients`."""
        above, below, _, _ = _ratio(coefficients)
        inverse = 1 / horner(square, below)
        scale = horner(square, above) * inverse
        powers = [square * inverse, square**2 * inverse, square**3 * inverse]
        none = np.zeros_like(square)
        by = [powers[0], powers[1], none, none, powers[2], *(-scale * power for power in powers)]
        return by[: len(coefficients)]

    def tangential(self, coefficients: Coefficients) -> tuple[float, float]:
        """See `RadialModel.tangential`."""
        return coefficients[2], coefficients[3]

    def domain_radius(self, coefficients: Coefficients) -> float:
        """See `LensModel.domain_radius`; exact, from the roots of polynomials."""
        above, below, _, _ = _ratio(coefficients)
        # Polynomials in r, because the tangential term is odd in r; plain arrays, since adjustments try thousands.
        numerator, denominator = _even(above), _even(below)
        by_r, by_r_below = (np.arange(len(part)) * part for part in (numerator, denominator))  # times r / dr
        steepness = np.convolve(numerator + by_r, denominator) - np.convolve(numerator, by_r_below)
        loss = np.array([0.0, 6 * np.hypot(*self.tangential(coefficients))])
        lost = np.convolve(loss, denominator)
        less = np.polynomial.polynomial.polysub
        conditions = less(steepness, np.convolve(lost, denominator)), less(numerator, lost), denominator
        return min(LARGEST_RADIUS, *map(first_root, conditions))


class Rational(RadialTangential):
    """s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), and the tangential terms p1, p2."""

    coefficients = (("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),)
    aliases = ("rational_polynomial",)


LENSES.register("radtan")(RadialTangential())
LENSES.register("rational")(Rational())


def _even(coefficients: Coefficients) -> Array:
    """Convert the coefficients of a polynomial in r^2 to those of a polynomial in r."""
    result = np.zeros(2 * len(coefficients) - 1)
    result[::2] = coefficients
    return result


@lru_cache(maxsize=64)
def _ratio(c: Coefficients) -> tuple[Coefficients, Coefficients, Coefficients, Coefficients]:
    """Numerator and denominator of the radial scale in ascending powers of r^2, then the derivatives of both."""
    k1, k2, _, _, k3, k4, k5, k6 = (*c, *[0.0] * (8 - len(c)))
    above, below = _trimmed((1.0, k1, k2, k3)), _trimmed((1.0, k4, k5, k6))
    return above, below, derivative(above), derivative(below)


def _trimmed(ascending: Coefficients) -> Coefficients:
    return ascending if len(ascending) == 1 or ascending[-1] else _trimmed(ascending[:-1])
