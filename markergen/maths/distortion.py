"""Lens distortion of normalized image coordinates (X/z, Y/z): forward, inverse, and derivatives; batched.

Every model here is a radial scale and, for some, tangential terms, with r^2 = x^2 + y^2 and q = p2 x + p1 y:

    x' = s(r) x + 2 q x + p2 r^2,    y' = s(r) y + 2 q y + p1 r^2

=============  =========================  ==================================================================
model          coefficients               radial scale
=============  =========================  ==================================================================
none                                      s = 1
radtan         k1 k2 p1 p2 [k3]           s = 1 + k1 r^2 + k2 r^4 + k3 r^6                   (Brown-Conrady)
rational       k1 k2 p1 p2 k3 k4 k5 k6    s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
equidistant    k1 k2 k3 k4                s = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) / r,  a = atan r
=============  =========================  ==================================================================

Order and meaning of the coefficients are OpenCV's (cv2 and cv2.fisheye), ROS's and Kalibr's.

**Domain.** A fitted polynomial turns over somewhere and would map points far outside the view back into the image.
The Jacobian of each model is symmetric; its radial and tangential eigenvalues are (s r)' and s, and the tangential
terms lower them by 6 |p| r at most. A map whose Jacobian is positive definite on a convex set is one-to-one there, so
the domain is the disk up to the first r at which min((s r)', s) = 6 |p| r, and up to `LARGEST_RADIUS` in any case.
Outside it everything is nan.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Coefficients = tuple[float, ...]

NAMES: dict[str, tuple[tuple[str, ...], ...]] = {
    "none": ((),),
    "radtan": (("k1", "k2", "p1", "p2"), ("k1", "k2", "p1", "p2", "k3")),
    "rational": (("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),),
    "equidistant": (("k1", "k2", "k3", "k4"),),
}
"""Names of the coefficients by model, for each number of them that the model takes."""

LARGEST_RADIUS = 1e6
"""Largest r of any domain: 0.2 arc seconds short of a right angle to the optical axis."""

TOLERANCE = 1e-13
"""Residual of the inverse relative to 1 + r', in normalized units."""

_FEW_STEPS, _MOST_STEPS = 6, 100
"""Newton takes 2 or 3; near the rim of the domain, where the Jacobian is singular, a step only halves the error."""
_BLOCK = 8192
"""Points at a time: the two dozen intermediate arrays stay in the cache."""
_NODES = 4096
"""Of the table that Newton starts from: linear interpolation in it is good to about 1e-7."""


def distort(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Normalized coordinates (..., 2) after the lens, of those before it; nan outside the domain."""
    if model == "none":
        return normalized
    x, y = normalized[..., 0], normalized[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        scale, _ = _radial(model, _square(model, x, y, coefficients), coefficients, slope=False)
        return np.stack(_shift(x, y, scale, *_tangential(model, coefficients)), axis=-1)


def distortion_jacobian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Derivative (..., 2, 2) of `distort` by the normalized coordinates; symmetric; nan outside the domain."""
    x, y = normalized[..., 0], normalized[..., 1]
    if model == "none":
        return np.broadcast_to(np.eye(2), (*x.shape, 2, 2))
    with np.errstate(over="ignore", invalid="ignore"):
        scale, slope = _radial(model, _square(model, x, y, coefficients), coefficients)
        xx, xy, yy = _gradient(x, y, scale, slope, *_tangential(model, coefficients))
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(*x.shape, 2, 2)


def distortion_hessian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Second derivative (..., 2, 2, 2) of `distort`; nan outside the domain.

    [..., i, j, k] is that of x'_i by x_j and x_k. The Jacobian is itself the second derivative of a potential, so the
    order of all three does not matter.
    """
    x, y = normalized[..., 0], normalized[..., 1]
    if model == "none":
        return np.zeros((*x.shape, 2, 2, 2))
    p1, p2 = _tangential(model, coefficients)
    with np.errstate(over="ignore", invalid="ignore"):
        square = _square(model, x, y, coefficients)
        _, slope = _radial(model, square, coefficients)
        twice, bend = 2 * slope, 4 * _radial_bend(model, square, coefficients)
        across = twice + bend * x * x, twice + bend * y * y
        xxx, yyy = (across[0] + 2 * twice) * x + 6 * p2, (across[1] + 2 * twice) * y + 6 * p1
        xxy, xyy = across[0] * y + 2 * p1, across[1] * x + 2 * p2
    return np.stack([xxx, xxy, xxy, xyy, xxy, xyy, xyy, yyy], axis=-1).reshape(*x.shape, 2, 2, 2)


def coefficient_jacobian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Derivative (..., 2, k) of `distort` by the k coefficients; nan outside the domain."""
    result = np.zeros((*normalized.shape[:-1], 2, len(coefficients)))
    if model == "none":
        return result
    x, y = normalized[..., 0], normalized[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        square = _square(model, x, y, coefficients)
        for i, scale in enumerate(_scale_derivatives(model, square, coefficients)):
            result[..., i] = scale[..., None] * normalized
        if model != "equidistant":
            result[..., 0, 2] = result[..., 1, 3] = 2 * x * y + 0 * square
            result[..., 1, 2], result[..., 0, 3] = square + 2 * y * y, square + 2 * x * x
    return result


def undistort(model: str, distorted: Array, coefficients: Coefficients) -> Array:
    """Undo `distort` by damped Newton steps, to `TOLERANCE`; nan where no point of the domain comes to that place."""
    if model == "none":
        return distorted
    flat = np.reshape(distorted, (-1, 2))
    result = np.full(flat.shape, np.nan)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        stuck = []
        for start in range(0, len(flat), _BLOCK):
            block = slice(start, start + _BLOCK)
            stuck.append(start + _solve(model, flat[block], coefficients, result[block], _FEW_STEPS))
        # In every block of an image some points are at the rim: all together they cost little.
        rest = np.concatenate([np.zeros(0, dtype=np.intp), *stuck])
        if rest.size:
            late = np.full((len(rest), 2), np.nan)
            _solve(model, flat[rest], coefficients, late, _MOST_STEPS)
            result[rest] = late
    return result.reshape(distorted.shape)


@lru_cache(maxsize=64)
def domain_radius(model: str, coefficients: Coefficients) -> float:
    """Radius r of the disk on which the model is used: where it turns over, or `LARGEST_RADIUS`."""
    if model == "none":
        return LARGEST_RADIUS
    if model == "equidistant":
        k1, k2, k3, k4 = coefficients
        angle = np.sqrt(_first_root((1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4)))
        return min(float(np.tan(angle)), LARGEST_RADIUS) if angle < np.pi / 2 else LARGEST_RADIUS
    above, below, _, _ = _ratio(coefficients)
    # In powers of r, so that the tangential term, which is odd in r, fits in.
    numerator, denominator = np.polynomial.Polynomial(_even(above)), np.polynomial.Polynomial(_even(below))
    r = np.polynomial.Polynomial([0, 1])
    steepness = numerator * denominator + r * (numerator.deriv() * denominator - numerator * denominator.deriv())
    loss = 6 * np.hypot(*_tangential(model, coefficients)) * r
    conditions = (steepness - loss * denominator**2, numerator - loss * denominator, denominator)
    return min(LARGEST_RADIUS, *(_first_root(condition.coef) for condition in conditions))


def _first_root(ascending: ArrayLike) -> float:
    """Smallest positive root of 1 + c1 r + c2 r^2 + ..., inf if there is none."""
    # The roots of the reversed polynomial are 1/r: it is monic, so that tiny leading coefficients do no harm, and the
    # root wanted is the largest. A double root, where rounding may make two complex ones, counts.
    inverse = np.roots(ascending)
    real = inverse.real[(np.abs(inverse.imag) <= 1e-6 * np.abs(inverse)) & (inverse.real > 0)]
    return float(1 / real.max()) if real.size and real.max() > 1e-300 else np.inf


def _even(coefficients: Coefficients) -> Array:
    """Coefficients of a polynomial in r^2 as one in r."""
    result = np.zeros(2 * len(coefficients) - 1)
    result[::2] = coefficients
    return result


@lru_cache(maxsize=64)
def _ratio(c: Coefficients) -> tuple[Coefficients, Coefficients, Coefficients, Coefficients]:
    """Numerator and denominator of the radial scale in ascending powers of r^2, then the derivatives of both."""
    k1, k2, _, _, k3, k4, k5, k6 = (*c, *[0.0] * (8 - len(c)))
    above, below = _trimmed((1.0, k1, k2, k3)), _trimmed((1.0, k4, k5, k6))
    return above, below, _derivative(above), _derivative(below)


def _trimmed(ascending: Coefficients) -> Coefficients:
    return ascending if len(ascending) == 1 or ascending[-1] else _trimmed(ascending[:-1])


def _derivative(ascending: Coefficients) -> Coefficients:
    return tuple(i * c for i, c in enumerate(ascending))[1:] or (0.0,)


def _tangential(model: str, c: Coefficients) -> tuple[float, float]:
    return (0.0, 0.0) if model == "equidistant" else (c[2], c[3])


def _square(model: str, x: Array, y: Array, coefficients: Coefficients) -> Array:
    """Return r^2, nan outside the domain."""
    square = x * x + y * y
    return np.where(square < domain_radius(model, coefficients) ** 2, square, np.nan)


def _radial(model: str, square: Array, c: Coefficients, slope: bool = True) -> tuple[Array, Array]:
    """Radial scale s and, where asked for, its derivative by r^2."""
    if model == "equidistant":
        return _equidistant(square, c, slope)
    above, below, above_slope, below_slope = _ratio(c)
    scale = _polynomial(square, above)
    derivative = _polynomial(square, above_slope) if slope else scale
    if len(below) > 1:
        inverse = 1 / _polynomial(square, below)
        scale = scale * inverse
        if slope:
            derivative = (derivative - scale * _polynomial(square, below_slope)) * inverse
    return scale, derivative


def _radial_bend(model: str, square: Array, c: Coefficients) -> Array:
    """Second derivative of the radial scale by r^2."""
    scale, slope = _radial(model, square, c)
    if model == "equidistant":
        angle = np.arctan(np.sqrt(square))
        angle2 = angle * angle
        center = square < 1e-12
        # With S = (s r)' = s + 2 r^2 s', s'' = (S' - 3 s') / (2 r^2); at the center from the series of both.
        grown = (1.0, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3])
        unit = np.where(center, 1.0, angle / np.sqrt(np.where(center, 1.0, square)))
        change = (_polynomial(angle2, _derivative(grown)) * unit - _polynomial(angle2, grown)) / (1 + square) ** 2
        return np.where(center, 2 * (c[1] - c[0] + 0.2), (change - 3 * slope) / np.where(center, 1.0, 2 * square))
    _, below, above_slope, below_slope = _ratio(c)
    bend = _polynomial(square, _derivative(above_slope))
    if len(below) > 1:
        bend = (
            bend - 2 * slope * _polynomial(square, below_slope) - scale * _polynomial(square, _derivative(below_slope))
        )
        bend = bend / _polynomial(square, below)
    return bend


def _equidistant(square: Array, c: Coefficients, slope: bool) -> tuple[Array, Array]:
    radius = np.sqrt(square)
    angle = np.arctan(radius)
    angle2 = angle * angle
    # At the center, atan r / r = 1 - r^2/3: the quotients below are 0/0 there.
    center = square < 1e-12
    unit = np.where(center, 1 - square / 3, angle / np.where(center, 1, radius))
    scale = unit * _polynomial(angle2, (1.0, *c))
    if not slope:
        return scale, scale
    steepness = _polynomial(angle2, (1.0, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3])) / (1 + square)
    return scale, np.where(center, c[0] - 1 / 3, (steepness - scale) / np.where(center, 1, 2 * square))


def _scale_derivatives(model: str, square: Array, c: Coefficients) -> list[Array]:
    """Derivatives of the radial scale by each coefficient; 0 for p1 and p2."""
    if model == "equidistant":
        angle2 = np.arctan(np.sqrt(square)) ** 2
        unit, _ = _equidistant(square, (0.0,) * 4, slope=False)
        return [unit * angle2**i for i in range(1, 5)]
    above, below, _, _ = _ratio(c)
    inverse = 1 / _polynomial(square, below)
    scale = _polynomial(square, above) * inverse
    powers = [square * inverse, square**2 * inverse, square**3 * inverse]
    none = np.zeros_like(square)
    return [powers[0], powers[1], none, none, powers[2], *(-scale * power for power in powers)][: len(c)]


def _polynomial(x: Array, ascending: Coefficients) -> Array:
    """Horner's rule; nan stays nan, for a constant, too."""
    if len(ascending) == 1:
        return x * 0 + ascending[0]
    value = x * ascending[-1]
    for coefficient in ascending[-2:0:-1]:
        value += coefficient
        value *= x
    value += ascending[0]
    return value


def _shift(x: Array, y: Array, scale: Array, p1: float, p2: float) -> tuple[Array, Array]:
    if not (p1 or p2):
        return scale * x, scale * y
    square = x * x + y * y
    common = scale + 2 * (p2 * x + p1 * y)
    return common * x + p2 * square, common * y + p1 * square


def _gradient(x: Array, y: Array, scale: Array, slope: Array, p1: float, p2: float) -> tuple[Array, Array, Array]:
    """Entries xx, xy, yy of the Jacobian."""
    twice = 2 * slope
    tx, ty = twice * x, twice * y
    if not (p1 or p2):
        return scale + tx * x, tx * y, scale + ty * y
    px, py, cross = p2 * x, p1 * y, 2 * (p1 * x + p2 * y)
    return scale + tx * x + (6 * px + 2 * py), tx * y + cross, scale + ty * y + (6 * py + 2 * px)


@lru_cache(maxsize=64)
def _table(model: str, coefficients: Coefficients) -> tuple[Array, Array]:
    """Radius after the lens, increasing, and the angle atan r before it, without the tangential terms."""
    # Even steps of the angle are fine in the middle and still reach to a right angle.
    angle = np.linspace(0, np.arctan(domain_radius(model, coefficients)) * (1 - 1e-12), _NODES)
    radius = np.tan(angle)
    with np.errstate(over="ignore", invalid="ignore"):
        scale, _ = _radial(model, radius**2, coefficients, slope=False)
        return np.maximum.accumulate(scale * radius), angle


def _solve(model: str, distorted: Array, coefficients: Coefficients, result: Array, steps: int) -> NDArray[np.intp]:
    """Write into `result` (m, 2) the points that `distort` takes to `distorted`; return the indices still open."""
    p1, p2 = _tangential(model, coefficients)
    limit = domain_radius(model, coefficients)
    after, angles = _table(model, coefficients)
    u, v = distorted[:, 0], distorted[:, 1]
    radius = np.hypot(u, v)
    # No point of the domain gets farther out than this.
    index = np.flatnonzero(radius <= after[-1] + 3 * np.hypot(p1, p2) * limit**2)
    u, v, radius = u[index], v[index], radius[index]
    tolerance = (TOLERANCE * (1 + radius)) ** 2
    # Without the tangential terms, the answer lies on the line through the center.
    guess = np.tan(np.interp(radius, after, angles)) / np.where(radius > 0, radius, 1)
    x, y = guess * u, guess * v
    # The point accepted so far, the step from it to (x, y), and its squared residual.
    x0, y0, sx, sy, least = x, y, 0 * x, 0 * y, np.full_like(x, np.inf)
    for _ in range(steps):
        if not index.size:
            break
        square = x * x + y * y
        square[square >= limit**2] = np.nan
        scale, slope = _radial(model, square, coefficients)
        xd, yd = _shift(x, y, scale, p1, p2)
        dx, dy = u - xd, v - yd
        error = dx * dx + dy * dy
        done = error <= tolerance
        if done.any():
            result[index[done], 0], result[index[done], 1] = x[done], y[done]
            rest = ~done
            index, u, v, tolerance, x, y = index[rest], u[rest], v[rest], tolerance[rest], x[rest], y[rest]
            x0, y0, sx, sy, least = x0[rest], y0[rest], sx[rest], sy[rest], least[rest]
            scale, slope, dx, dy, error = scale[rest], slope[rest], dx[rest], dy[rest], error[rest]
        xx, xy, yy = _gradient(x, y, scale, slope, p1, p2)
        determinant = xx * yy - xy * xy
        nx, ny = (yy * dx - xy * dy) / determinant, (xx * dy - xy * dx) / determinant
        worse = ~(error < least)
        if worse.any():
            # The Jacobian is positive definite, so a part of the step makes the residual smaller; outside it is nan.
            x, y, error = np.where(worse, x0, x), np.where(worse, y0, y), np.where(worse, least, error)
            nx, ny = np.where(worse, sx / 2, nx), np.where(worse, sy / 2, ny)
        x0, y0, sx, sy, least = x, y, nx, ny, error
        x, y = x0 + sx, y0 + sy
    return index
