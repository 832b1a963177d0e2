"""Lens models: a table of maps of normalized image coordinates, used by `markergen.maths.distortion`.

A model is a formula; its domain, derivatives and inverse follow by finite differences and Newton's method. The models
of this package also provide closed-form derivatives, for speed and accuracy.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from markergen.arrays import Array as Array
from markergen.registry import Registry

__all__ = [
    "LARGEST_RADIUS",
    "LENSES",
    "Coefficients",
    "LensModel",
    "RadialModel",
    "derivative",
    "first_root",
    "horner",
]

Coefficients = tuple[float, ...]
Jacobian = tuple[Array, Array, Array, Array]
"""Entries dx'/dx, dx'/dy, dy'/dx, dy'/dy."""

LARGEST_RADIUS = 1e6
"""Largest r of any domain: 0.2 arc seconds short of a right angle to the optical axis."""

_STEP, _LONG_STEP = 6e-6, 1e-4
"""Step sizes of central differences for first and second derivatives, good to about 1e-10 and 1e-8."""
_ANGLES, _DIRECTIONS = 1024, 16
"""Numbers of radii and directions sampled to find a domain without a closed form."""


class LensModel(ABC):
    """A map of normalized coordinates (X/z, Y/z) by a lens, one-to-one on a disk around the optical axis.

    Attributes
    ----------
    coefficients : tuple of tuple of str
        Names of the coefficients, one tuple for each number of coefficients that the model accepts.
    aliases : tuple of str
        Further names of the model in calibration files, in lower case.
    opencv : bool
        True if the coefficients are valid ``distCoeffs`` for OpenCV's functions, where an empty array means a pinhole
        camera.
    """

    coefficients: ClassVar[tuple[tuple[str, ...], ...]]
    aliases: ClassVar[tuple[str, ...]] = ()
    opencv: ClassVar[bool] = False

    @abstractmethod
    def map(self, x: Array, y: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """Distorted coordinates x', y', of any shape, by the formula alone; nan stays nan."""

    def domain_radius(self, coefficients: Coefficients) -> float:
        """Radius of the disk on which the map is one-to-one, `LARGEST_RADIUS` at most.

        By default, the first of a thousand radii at which the symmetric part of the Jacobian is not positive definite
        in some direction: on a convex set, a map with a positive definite Jacobian is one-to-one.
        """
        radius = np.tan(np.linspace(0, np.arctan(LARGEST_RADIUS), _ANGLES))
        around = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        x, y = radius[:, None] * np.cos(around), radius[:, None] * np.sin(around)
        xx, xy, yx, yy = self.gradient(x, y, coefficients)
        definite = (xx > 0) & (xx * yy > ((xy + yx) / 2) ** 2)
        # Far out, differences are lost in rounding: there the map itself has to grow.
        far = radius > 1e3
        grows = np.diff(np.hypot(*self.map(x, y, coefficients)), axis=0, append=np.inf) > 0
        bad = ~np.where(far[:, None], grows, definite).all(axis=-1)
        return float(radius[max(int(np.argmax(bad)) - 1, 0)]) if bad.any() else LARGEST_RADIUS

    def gradient(self, x: Array, y: Array, coefficients: Coefficients) -> Jacobian:
        """Derivatives of x', y' with respect to x, y."""
        step = _STEP * (1 + np.hypot(x, y))
        columns = [
            _difference(lambda dx, dy: self.map(x + dx, y + dy, coefficients), step, along)
            for along in ((1, 0), (0, 1))
        ]
        return columns[0][0], columns[1][0], columns[0][1], columns[1][1]

    def hessian(self, x: Array, y: Array, coefficients: Coefficients) -> Array:
        """Second derivatives (..., 2, 2, 2): [..., i, j, k] is d^2 x'_i / (dx_j dx_k)."""
        step = _LONG_STEP * (1 + np.hypot(x, y))
        by = [
            np.stack(_difference(lambda dx, dy: self.gradient(x + dx, y + dy, coefficients), step, along), axis=-1)
            for along in ((1, 0), (0, 1))
        ]
        result = np.stack(by, axis=-1).reshape(*np.shape(x), 2, 2, 2)
        return (result + result.swapaxes(-1, -2)) / 2

    def by_coefficients(self, x: Array, y: Array, coefficients: Coefficients) -> Array:
        """Derivatives (..., 2, k) of x', y' with respect to the coefficients."""
        result = np.zeros((*np.shape(x), 2, len(coefficients)))
        for i, value in enumerate(coefficients):
            step = _STEP * max(1.0, abs(value))
            ahead, behind = (
                self.map(x, y, (*coefficients[:i], value + h, *coefficients[i + 1 :])) for h in (step, -step)
            )
            for row in (0, 1):
                result[..., row, i] = (ahead[row] - behind[row]) / (2 * step)
        return result

    # The remaining methods serve Newton's method in `markergen.maths.distortion`.

    def profile(self, radius: Array, coefficients: Coefficients) -> Array:
        """Approximate distorted radii of points at these radii: the starting values for Newton's method."""
        around = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        mapped = self.map(radius[:, None] * np.cos(around), radius[:, None] * np.sin(around), coefficients)
        return np.hypot(*mapped).mean(axis=-1)

    def reach(self, radius: float, coefficients: Coefficients) -> float:
        """Bound on the amount by which a distorted radius may exceed `profile` in a domain of that radius."""
        del radius, coefficients
        return np.inf

    def place(self, x: Array, y: Array, square: Array, coefficients: Coefficients) -> tuple[Array, Array, list[Array]]:
        """Return x', y' and the intermediate results for `gradient_from`; `square` is r^2, nan outside the domain."""
        return *self.map(x + 0 * square, y, coefficients), []

    def gradient_from(self, x: Array, y: Array, intermediate: Sequence[Array], coefficients: Coefficients) -> Jacobian:
        """`gradient` at points of the domain, from the intermediate results of `place`."""
        del intermediate
        return self.gradient(x, y, coefficients)


class RadialModel(LensModel):
    """A model with a radial scale s(r^2) and, for some, tangential terms, with q = p2 x + p1 y:

    x' = s x + 2 q x + p2 r^2,    y' = s y + 2 q y + p1 r^2

    A model only needs to define `scale`. The Jacobian is symmetric, and so are all second derivatives.
    """

    @abstractmethod
    def scale(self, square: Array, coefficients: Coefficients) -> Array:
        """Radial scale s at r^2, with its limit at 0; nan stays nan."""

    def scale_and_slope(self, square: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """Radial scale s and its derivative with respect to r^2."""
        return self.scale(square, coefficients), _forward(lambda at: self.scale(at, coefficients), square, _STEP)

    def bend(self, square: Array, coefficients: Coefficients) -> Array:
        """Second derivative of s with respect to r^2."""
        return _forward(lambda at: self.scale_and_slope(at, coefficients)[1], square, _LONG_STEP)

    def scale_by_coefficients(self, square: Array, coefficients: Coefficients) -> Sequence[Array]:
        """Derivatives of s with respect to each coefficient; 0 for p1 and p2."""
        derivatives = []
        for i, value in enumerate(coefficients):
            step = _STEP * max(1.0, abs(value))
            ahead, behind = (
                self.scale(square, (*coefficients[:i], value + h, *coefficients[i + 1 :])) for h in (step, -step)
            )
            derivatives.append((ahead - behind) / (2 * step))
        return derivatives

    def tangential(self, coefficients: Coefficients) -> tuple[float, float]:
        """p1 and p2, which are coefficients 2 and 3 of the models that have them."""
        del coefficients
        return 0.0, 0.0

    def map(self, x: Array, y: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """See `LensModel.map`."""
        return _displaced(x, y, self.scale(x * x + y * y, coefficients), *self.tangential(coefficients))

    def gradient(self, x: Array, y: Array, coefficients: Coefficients) -> Jacobian:
        """See `LensModel.gradient`."""
        return self.gradient_from(x, y, self.scale_and_slope(x * x + y * y, coefficients), coefficients)

    def hessian(self, x: Array, y: Array, coefficients: Coefficients) -> Array:
        """See `LensModel.hessian`."""
        p1, p2 = self.tangential(coefficients)
        square = x * x + y * y
        _, slope = self.scale_and_slope(square, coefficients)
        twice, bend = 2 * slope, 4 * self.bend(square, coefficients)
        across = twice + bend * x * x, twice + bend * y * y
        xxx, yyy = (across[0] + 2 * twice) * x + 6 * p2, (across[1] + 2 * twice) * y + 6 * p1
        xxy, xyy = across[0] * y + 2 * p1, across[1] * x + 2 * p2
        return np.stack([xxx, xxy, xxy, xyy, xxy, xyy, xyy, yyy], axis=-1).reshape(*x.shape, 2, 2, 2)

    def by_coefficients(self, x: Array, y: Array, coefficients: Coefficients) -> Array:
        """See `LensModel.by_coefficients`."""
        result = np.zeros((*x.shape, 2, len(coefficients)))
        square = x * x + y * y
        for i, scale in enumerate(self.scale_by_coefficients(square, coefficients)):
            result[..., 0, i], result[..., 1, i] = scale * x, scale * y
        if type(self).tangential is not RadialModel.tangential:
            result[..., 0, 2] = result[..., 1, 3] = 2 * x * y + 0 * square
            result[..., 1, 2], result[..., 0, 3] = square + 2 * y * y, square + 2 * x * x
        return result

    def profile(self, radius: Array, coefficients: Coefficients) -> Array:
        """See `LensModel.profile`: without tangential terms, distortion acts along the line through the center."""
        return self.scale(radius**2, coefficients) * radius

    def reach(self, radius: float, coefficients: Coefficients) -> float:
        """See `LensModel.reach`."""
        return float(3 * np.hypot(*self.tangential(coefficients)) * radius**2)

    def place(self, x: Array, y: Array, square: Array, coefficients: Coefficients) -> tuple[Array, Array, list[Array]]:
        """See `LensModel.place`."""
        scale, slope = self.scale_and_slope(square, coefficients)
        return *_displaced(x, y, scale, *self.tangential(coefficients)), [scale, slope]

    def gradient_from(self, x: Array, y: Array, intermediate: Sequence[Array], coefficients: Coefficients) -> Jacobian:
        """See `LensModel.gradient_from`."""
        (scale, slope), (p1, p2) = intermediate, self.tangential(coefficients)
        twice = 2 * slope
        tx, ty = twice * x, twice * y
        if not (p1 or p2):
            cross = tx * y
            return scale + tx * x, cross, cross, scale + ty * y
        px, py, mixed = p2 * x, p1 * y, 2 * (p1 * x + p2 * y)
        cross = tx * y + mixed
        return scale + tx * x + (6 * px + 2 * py), cross, cross, scale + ty * y + (6 * py + 2 * px)


LENSES: Registry[LensModel] = Registry("distortion model", __name__, "markergen.camera_models", LensModel)
"""Lens models by name; each entry is an instance."""


def horner(x: Array, ascending: Coefficients) -> Array:
    """Evaluate a polynomial by Horner's rule; nan stays nan, even for a constant."""
    if len(ascending) == 1:
        return x * 0 + ascending[0]
    value = x * ascending[-1]
    for coefficient in ascending[-2:0:-1]:
        value += coefficient
        value *= x
    value += ascending[0]
    return value


def derivative(ascending: Coefficients) -> Coefficients:
    """Coefficients of a polynomial's derivative."""
    return tuple(i * c for i, c in enumerate(ascending))[1:] or (0.0,)


def first_root(ascending: ArrayLike) -> float:
    """Smallest positive root of 1 + c1 r + c2 r^2 + ..., inf if there is none."""
    # The roots of the reversed polynomial are 1/r. It is monic, so that tiny leading coefficients do no harm, and the
    # desired root is its largest. Double roots, which rounding may split into two complex ones, count.
    inverse = np.roots(ascending)
    real = inverse.real[(np.abs(inverse.imag) <= 1e-6 * np.abs(inverse)) & (inverse.real > 0)]
    return float(1 / real.max()) if real.size and real.max() > 1e-300 else np.inf


def _displaced(x: Array, y: Array, scale: Array, p1: float, p2: float) -> tuple[Array, Array]:
    if not (p1 or p2):
        return scale * x, scale * y
    square = x * x + y * y
    common = scale + 2 * (p2 * x + p1 * y)
    return common * x + p2 * square, common * y + p1 * square


def _difference(
    function: Callable[[Array, Array], Sequence[Array]], step: Array, along: tuple[int, int]
) -> list[Array]:
    """Central differences of several functions of x and y."""
    ahead, behind = (function(h * along[0], h * along[1]) for h in (step, -step))
    return [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]


def _forward(function: Callable[[Array], Array], square: Array, step: float) -> Array:
    """Derivative with respect to r^2 by a three-point forward difference, since r^2 cannot be negative."""
    h = step * (1 + square)
    return (4 * function(square + h) - 3 * function(square) - function(square + 2 * h)) / (2 * h)
