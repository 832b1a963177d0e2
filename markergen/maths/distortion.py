"""Lens distortion of normalized image coordinates (X/z, Y/z): forward, inverse, and derivatives; batched.

Models are entries of a table (`markergen.maths.lenses`). The built-in ones consist of a radial scale and, for some,
tangential terms, with r^2 = x^2 + y^2 and q = p2 x + p1 y:

    x' = s(r) x + 2 q x + p2 r^2,    y' = s(r) y + 2 q y + p1 r^2

=============  =========================  ==================================================================
model          coefficients               radial scale
=============  =========================  ==================================================================
none                                      s = 1
radtan         k1 k2 p1 p2 [k3]           s = 1 + k1 r^2 + k2 r^4 + k3 r^6                   (Brown-Conrady)
rational       k1 k2 p1 p2 k3 k4 k5 k6    s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
equidistant    k1 k2 k3 k4                s = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) / r,  a = atan r
=============  =========================  ==================================================================

The coefficients have the order and meaning of OpenCV (cv2 and cv2.fisheye), ROS and Kalibr.

**Domain.** A fitted polynomial is not monotonic forever and would map points far outside the field of view back into
the image. A map whose Jacobian is positive definite on a convex set is one-to-one there, so the domain is the disk up
to the first r at which it is not positive definite, at most `LARGEST_RADIUS`. Results are nan outside the domain.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.maths.lenses import LARGEST_RADIUS, LENSES, Coefficients

__all__ = [
    "LARGEST_RADIUS",
    "coefficient_jacobian",
    "distort",
    "distortion_hessian",
    "distortion_jacobian",
    "domain_radius",
    "undistort",
]

NONE = "none"
"""The identity model; it also passes nan and infinity through."""

TOLERANCE = 1e-13
"""Tolerance of the inverse's residual, relative to 1 + r', in normalized units."""

_FEW_STEPS, _MOST_STEPS = 6, 100
"""Newton step limits of the two passes. Most points need 2 or 3 steps; near the edge of the domain, where the Jacobian
is singular, a step only halves the error."""
_BLOCK = 8192
"""Points per block, so that the two dozen intermediate arrays stay in the cache."""
_NODES = 4096
"""Number of nodes of the table of starting values for Newton's method; linear interpolation is good to about 1e-7."""


def distort(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Distort normalized coordinates (..., 2); nan outside the domain."""
    if model == NONE:
        return normalized
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack(LENSES[model].map(*_inside(model, normalized, coefficients), coefficients), axis=-1)


def distortion_jacobian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Derivative (..., 2, 2) of `distort` with respect to the normalized coordinates; nan outside the domain."""
    if model == NONE:
        return np.broadcast_to(np.eye(2), (*normalized.shape[:-1], 2, 2))
    with np.errstate(over="ignore", invalid="ignore"):
        entries = LENSES[model].gradient(*_inside(model, normalized, coefficients), coefficients)
    return np.stack(entries, axis=-1).reshape(*normalized.shape[:-1], 2, 2)


def distortion_hessian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Second derivative (..., 2, 2, 2) of `distort`; nan outside the domain.

    Entry [..., i, j, k] is the derivative of x'_i with respect to x_j and x_k.
    """
    if model == NONE:
        return np.zeros((*normalized.shape[:-1], 2, 2, 2))
    with np.errstate(over="ignore", invalid="ignore"):
        return LENSES[model].hessian(*_inside(model, normalized, coefficients), coefficients)


def coefficient_jacobian(model: str, normalized: Array, coefficients: Coefficients) -> Array:
    """Derivative (..., 2, k) of `distort` with respect to the k coefficients; nan outside the domain."""
    if model == NONE:
        return np.zeros((*normalized.shape[:-1], 2, len(coefficients)))
    with np.errstate(over="ignore", invalid="ignore"):
        return LENSES[model].by_coefficients(*_inside(model, normalized, coefficients), coefficients)


def undistort(model: str, distorted: Array, coefficients: Coefficients) -> Array:
    """Invert `distort` to `TOLERANCE` by damped Newton steps; nan where no point of the domain has that image."""
    if model == NONE:
        return distorted
    flat = np.reshape(distorted, (-1, 2))
    result = np.full(flat.shape, np.nan)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        stuck = []
        for start in range(0, len(flat), _BLOCK):
            block = slice(start, start + _BLOCK)
            stuck.append(start + _solve(model, flat[block], coefficients, result[block], _FEW_STEPS))
        # Every block of an image has some points near the edge of the domain: solved together they cost little.
        rest = np.concatenate([np.zeros(0, dtype=np.intp), *stuck])
        if rest.size:
            late = np.full((len(rest), 2), np.nan)
            _solve(model, flat[rest], coefficients, late, _MOST_STEPS)
            result[rest] = late
    return result.reshape(distorted.shape)


@lru_cache(maxsize=64)
def domain_radius(model: str, coefficients: Coefficients) -> float:
    """Radius r of the model's domain, at most `LARGEST_RADIUS`."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return min(float(LENSES[model].domain_radius(coefficients)), LARGEST_RADIUS)


def _inside(model: str, normalized: Array, coefficients: Coefficients) -> tuple[Array, Array]:
    """Return x and y, both nan outside the domain."""
    x, y = normalized[..., 0], normalized[..., 1]
    seen = x * x + y * y < domain_radius(model, coefficients) ** 2
    return (x, y) if seen.all() else (np.where(seen, x, np.nan), np.where(seen, y, np.nan))


@lru_cache(maxsize=64)
def _table(model: str, coefficients: Coefficients) -> tuple[Array, Array]:
    """Tabulate the distorted radius, increasing, and the undistorted angle atan r, without the tangential terms."""
    # Uniform angles sample the center finely and still reach 90 degrees.
    angle = np.linspace(0, np.arctan(domain_radius(model, coefficients)) * (1 - 1e-12), _NODES)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.maximum.accumulate(LENSES[model].profile(np.tan(angle), coefficients)), angle


def _solve(model: str, distorted: Array, coefficients: Coefficients, result: Array, steps: int) -> NDArray[np.intp]:
    """Write the points that `distort` maps to `distorted` into `result` (m, 2); return the unconverged indices."""
    lens, limit = LENSES[model], domain_radius(model, coefficients)
    after, angles = _table(model, coefficients)
    u, v = distorted[:, 0], distorted[:, 1]
    radius = np.hypot(u, v)
    # No point of the domain is mapped farther out than this.
    index = np.flatnonzero(radius <= after[-1] + lens.reach(limit, coefficients))
    u, v, radius = u[index], v[index], radius[index]
    tolerance = (TOLERANCE * (1 + radius)) ** 2
    # As good as the table for a radial model; the tangential terms are left to the steps.
    guess = np.tan(np.interp(radius, after, angles)) / np.where(radius > 0, radius, 1)
    x, y = guess * u, guess * v
    # The point accepted so far, the step from it to (x, y), and its squared residual.
    x0, y0, sx, sy, least = x, y, 0 * x, 0 * y, np.full_like(x, np.inf)
    for _ in range(steps):
        if not index.size:
            break
        square = x * x + y * y
        # nan is no improvement, so that a step out of the domain is halved like one that is too long.
        square[square >= limit**2] = np.nan
        xd, yd, intermediate = lens.place(x, y, square, coefficients)
        dx, dy = u - xd, v - yd
        error = dx * dx + dy * dy
        done = error <= tolerance
        if done.any():
            result[index[done], 0], result[index[done], 1] = x[done], y[done]
            rest = ~done
            index, u, v, tolerance, x, y = index[rest], u[rest], v[rest], tolerance[rest], x[rest], y[rest]
            x0, y0, sx, sy, least = x0[rest], y0[rest], sx[rest], sy[rest], least[rest]
            dx, dy, error, intermediate = dx[rest], dy[rest], error[rest], [values[rest] for values in intermediate]
        xx, xy, yx, yy = lens.gradient_from(x, y, intermediate, coefficients)
        determinant = xx * yy - xy * yx
        nx, ny = (yy * dx - xy * dy) / determinant, (xx * dy - yx * dx) / determinant
        worse = ~(error < least)
        if worse.any():
            # The Jacobian is positive definite, so a fraction of the step reduces the residual, which is nan outside.
            x, y, error = np.where(worse, x0, x), np.where(worse, y0, y), np.where(worse, least, error)
            nx, ny = np.where(worse, sx / 2, nx), np.where(worse, sy / 2, ny)
        x0, y0, sx, sy, least = x, y, nx, ny, error
        x, y = x0 + sx, y0 + sy
    return index
