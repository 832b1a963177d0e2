"""The ellipse of one dot, fitted to the grey levels around its outline."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ITERATIONS = 8
_CONVERGED_PX = 1e-3
"""A step below this ends the iteration. The next would be under 4e-4 px, a tenth of the best standard deviation."""

_BAND_PX = 2.5
"""Half-width of the band of pixels around the outline that are fitted: beyond it the levels are flat and tell nothing,
and the next dot may begin."""

_MAX_MISFIT = 0.15
"""Largest RMS residual as a share of the contrast. Dots reach 0.02 at a noise of a hundredth of the contrast, 0.06 at a
twentieth, and 0.12 with another dot a pixel away; squares of 14 px and more are above."""

_MIN_BLUR, _MAX_BLUR = 0.25, 4.0
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class DotFit:
    """Ellipse of a dot: center (2,) and semi-axes (2,) in px, longest first; its angle in rad; bright in the middle."""

    center: Array
    semi: Array
    angle: float
    ring: bool


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns of the fit; `shape` is symmetric and takes the ellipse about its center to the unit circle."""

    center: Array
    shape: Array
    light: float
    dark: float
    blur: float
    hole_center: Array
    hole_scale: float


def fit_dot(image: Array, center: Array, covariance: Array) -> DotFit | None:
    """Least-squares fit of a blurred dark ellipse, or elliptic ring, to grey levels.

    Model: light - (light - dark) [F(-e/s) - F(-e_hole/s)], with F the normal distribution, s the blur and e the
    distance from the outline to first order, (rho - 1)/|grad rho|, rho = |M (x - c)|. Ellipse, levels and blur are
    unknown, and for a ring the hole's center and scale too: under perspective hole and outline are not concentric.
    Every pixel counts by what it tells, so the center's error is near the least that the image's noise allows.

    Parameters
    ----------
    image : array (h, w), grey levels
    center, covariance : arrays (2,) and (2, 2), px and px^2
        Mean and covariance of the dark region's area, the start.

    Returns
    -------
    DotFit or None
        None if the fit leaves the region or does not explain the grey levels: this is no dot.
    """
    # The covariance of an ellipse's area is its shape matrix over 4; a contour runs through the outermost pixels'
    # centers, half a pixel inside.
    values, vectors = np.linalg.eigh(covariance)
    semi = 2 * np.sqrt(values) + 0.5
    x, y, grey, rho, distance = _surroundings(image, center, (vectors * semi**2) @ vectors.T)
    if len(grey) < 12:
        return None
    light, dark = np.percentile(grey, 90), np.percentile(grey, 5)
    if not light > dark:
        return None
    # The middle is at least the pixel nearest the center, for dots of a few pixels.
    ring = bool(np.median(grey[rho <= max(0.2, rho.min())]) > (light + dark) / 2)
    if not ring:
        band = distance > -_BAND_PX
        x, y, grey = x[band], y[band], grey[band]
    state = _State(center, (vectors / semi) @ vectors.T, light, dark, 0.8, center, 0.5)
    fitted = _iterate(state, x, y, grey, ring)
    if fitted is None:
        return None
    values, vectors = np.linalg.eigh(fitted.shape)
    return DotFit(fitted.center, 1 / values, float(np.arctan2(vectors[1, 0], vectors[0, 0])), ring)


def _surroundings(image: Array, center: Array, spread: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Pixels in and around an ellipse: x, y, grey level, rho (1 on the outline), distance outward along the ray."""
    half = np.sqrt(np.diag(spread)) + _BAND_PX
    left, top = np.maximum(np.floor(center - half), 0).astype(int)
    right, bottom = np.minimum(np.ceil(center + half), np.array(image.shape[::-1]) - 1).astype(int)
    x, y = np.meshgrid(np.arange(left, right + 1, dtype=float), np.arange(top, bottom + 1, dtype=float))
    offset = np.stack([x, y], axis=-1) - center
    rho = np.sqrt(np.einsum("...i,ij,...j->...", offset, np.linalg.inv(spread), offset))
    distance = (rho - 1) * np.hypot(offset[..., 0], offset[..., 1]) / np.maximum(rho, _TINY)
    near = distance < _BAND_PX
    return x[near], y[near], image[top : bottom + 1, left : right + 1][near], rho[near], distance[near]


def _iterate(state: _State, x: Array, y: Array, grey: Array, ring: bool) -> _State | None:
    """Gauss-Newton steps until the ellipse stands still."""
    start = state
    size = 1 / np.linalg.eigvalsh(state.shape)
    for _ in range(_ITERATIONS):
        model, jacobian = _model(state, x, y, ring)
        residual = grey - model
        # A neighbor's edge in the band, or a speck, says nothing about this dot.
        kept = np.abs(residual) < 0.5 * (state.light - state.dark)
        j, r = jacobian[kept], residual[kept]
        try:
            step = np.asarray(np.linalg.solve(j.T @ j, j.T @ r), dtype=float)
        except np.linalg.LinAlgError:
            return None
        state = _moved(state, step, ring)
        inside = np.linalg.norm(state.center - start.center) < size[-1]
        if not (np.isfinite(step).all() and inside and np.linalg.eigvalsh(state.shape)[0] > 0.1 / size[0]):
            return None
        if np.abs(step[:2]).max() < _CONVERGED_PX:
            break
    residual = grey - _model(state, x, y, ring)[0]
    contrast = state.light - state.dark
    # Pixels that had no say count here, but by no more than half the contrast: a few may be a neighbor's.
    bounded = np.clip(residual, -0.5 * contrast, 0.5 * contrast)
    good = contrast > 0 and np.sqrt(np.mean(bounded**2)) < _MAX_MISFIT * contrast
    return state if good else None


def _moved(state: _State, step: Array, ring: bool) -> _State:
    change = np.array([[step[2], step[3]], [step[3], step[4]]])
    return _State(
        center=state.center + step[:2],
        shape=state.shape + change,
        light=state.light + step[5],
        dark=state.dark + step[6],
        blur=float(np.clip(state.blur + step[7], _MIN_BLUR, _MAX_BLUR)),
        hole_center=state.hole_center + step[8:10] if ring else state.hole_center,
        hole_scale=float(np.clip(state.hole_scale + step[10], 0.1, 0.9)) if ring else state.hole_scale,
    )


def _model(state: _State, x: Array, y: Array, ring: bool) -> tuple[Array, Array]:
    """Grey levels (m,) and their derivatives (m, 8 or 11) in the order of `_moved`."""
    contrast = state.light - state.dark
    ink, by_center, by_shape, by_blur, _ = _disk(x, y, state.center, state.shape, state.blur)
    if not ring:
        columns = [*by_center, *by_shape]
    else:
        scale = 1 / state.hole_scale
        hole, by_hole_center, by_hole_shape, by_hole_blur, by_hole_size = _disk(
            x, y, state.hole_center, state.shape * scale, state.blur
        )
        ink, by_blur = ink - hole, by_blur - by_hole_blur
        columns = [*by_center, *(d - scale * h for d, h in zip(by_shape, by_hole_shape, strict=True))]
    columns = [-contrast * column for column in columns]
    columns += [1 - ink, ink, -contrast * by_blur]
    if ring:
        columns += [contrast * column for column in by_hole_center]
        # d rho/d scale = -rho/hole_scale.
        columns += [-contrast * by_hole_size / state.hole_scale]
    return state.light - contrast * ink, np.stack(columns, axis=-1)


def _disk(
    x: Array, y: Array, center: Array, shape: Array, blur: float
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array, Array], Array, Array]:
    """Share of ink (m,) of a blurred ellipse; derivatives by center, shape (m11, m12, m22), blur, and d/d log rho."""
    from scipy.special import ndtr

    dx, dy = x - center[0], y - center[1]
    u = shape[0, 0] * dx + shape[0, 1] * dy
    v = shape[0, 1] * dx + shape[1, 1] * dy
    rho = np.maximum(np.hypot(u, v), _TINY)
    u, v = u / rho, v / rho
    gradient_x, gradient_y = shape[0, 0] * u + shape[0, 1] * v, shape[0, 1] * u + shape[1, 1] * v
    # At the center itself rho has no direction; |grad rho| is nowhere below the least eigenvalue >= det/trace.
    least = (shape[0, 0] * shape[1, 1] - shape[0, 1] ** 2) / (shape[0, 0] + shape[1, 1])
    steepness = np.maximum(np.hypot(gradient_x, gradient_y), least)
    depth = (1 - rho) / (steepness * blur)
    density = np.exp(-0.5 * depth**2) / np.sqrt(2 * np.pi)
    # |grad rho| is held fixed in the derivatives: its own change is of second order at the outline, and only the
    # path to the solution depends on it.
    by_rho = -density / (steepness * blur)
    by_center = (-by_rho * gradient_x, -by_rho * gradient_y)
    by_shape = (by_rho * u * dx, by_rho * (u * dy + v * dx), by_rho * v * dy)
    return ndtr(depth), by_center, by_shape, -density * depth / blur, by_rho * rho
