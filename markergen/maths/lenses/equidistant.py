"""``equidistant``: the fisheye model of OpenCV and Kalibr."""
# tests: tests/contracts/test_lenses.py

from collections.abc import Sequence

import numpy as np

from markergen.arrays import Array
from markergen.maths.lenses import LARGEST_RADIUS, LENSES, Coefficients, RadialModel, derivative, first_root, horner


class Equidistant(RadialModel):
    """Kannala-Brandt: s = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) / r, with a = atan r."""

    coefficients = (("k1", "k2", "k3", "k4"),)
    aliases = ("equi", "fisheye", "kannala_brandt")

    def scale(self, square: Array, coefficients: Coefficients) -> Array:
        """See `RadialModel.scale`."""
        radius = np.sqrt(square)
        angle = np.arctan(radius)
        # Near the center, atan r / r = 1 - r^2/3; the quotient is 0/0 there.
        center = square < 1e-12
        unit = np.where(center, 1 - square / 3, angle / np.where(center, 1, radius))
        return unit * horner(angle * angle, (1.0, *coefficients))

    def scale_and_slope(self, square: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """See `RadialModel.scale_and_slope`."""
        c = coefficients
        radius = np.sqrt(square)
        angle = np.arctan(radius)
        angle2 = angle * angle
        center = square < 1e-12
        unit = np.where(center, 1 - square / 3, angle / np.where(center, 1, radius))
        scale = unit * horner(angle2, (1.0, *c))
        steepness = horner(angle2, (1.0, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3])) / (1 + square)
        return scale, np.where(center, c[0] - 1 / 3, (steepness - scale) / np.where(center, 1, 2 * square))

    def bend(self, square: Array, coefficients: Coefficients) -> Array:
        """See `RadialModel.bend`."""
        c = coefficients
        _, slope = self.scale_and_slope(square, c)
        angle = np.arctan(np.sqrt(square))
        angle2 = angle * angle
        center = square < 1e-12
        # With S = (s r)' = s + 2 r^2 s', s'' = (S' - 3 s') / (2 r^2); at the center, from the series of both.
        grown = (1.0, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3])
        unit = np.where(center, 1.0, angle / np.sqrt(np.where(center, 1.0, square)))
        change = (horner(angle2, derivative(grown)) * unit - horner(angle2, grown)) / (1 + square) ** 2
        return np.where(center, 2 * (c[1] - c[0] + 0.2), (change - 3 * slope) / np.where(center, 1.0, 2 * square))

    def scale_by_coefficients(self, square: Array, coefficients: Coefficients) -> Sequence[Array]:
        """See `RadialModel.scale_by_coefficients`."""
        del coefficients
        angle2 = np.arctan(np.sqrt(square)) ** 2
        unit = self.scale(square, (0.0,) * 4)
        return [unit * angle2**i for i in range(1, 5)]

    def domain_radius(self, coefficients: Coefficients) -> float:
        """See `LensModel.domain_radius`; exact, from the roots of a polynomial."""
        k1, k2, k3, k4 = coefficients
        angle = np.sqrt(first_root((1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4)))
        return min(float(np.tan(angle)), LARGEST_RADIUS) if angle < np.pi / 2 else LARGEST_RADIUS


LENSES.register("equidistant")(Equidistant())
