"""How well a calibrated camera projects, over its image: what a rotation of the camera cannot make good.

A point is taken on the ray of each pixel q of a grid, infinitely far. Other values of the camera's parameters move its
image. Part of that is as if the camera had turned, which every pose estimated with the camera absorbs: it is
subtracted, at its best over the whole image. What is left is the error that a user of the camera sees, and what cameras
are compared by. Their parameters are not: f, c and p1, p2 may differ by pixels between cameras that project alike.

Source: mrcal's projection uncertainty, with the compensating motion fitted over the image rather than by the poses of
the calibration's boards.
"""

from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import pose_jacobian
from markergen.maths.projection import perspective
from markergen.maths.rotation import exponential
from markergen.model.camera import Camera
from markergen.presentation.plots import COLORS, FAINT, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes


COLUMNS = 60
"""Width of the grid; its height follows from the image's."""
_ARROWS, _LEAST, _RANGE = 15, 1e-6, 200.0
"""Number of arrows across the image, the least difference in px, and the largest ratio that a map tells apart."""


def pixel_grid(camera: Camera, columns: int = COLUMNS) -> Array:
    """Return pixels (h, w, 2) evenly over the image, its outermost included."""
    rows = max(round(columns * camera.height / camera.width), 2)
    x, y = np.linspace(0, camera.width - 1, columns), np.linspace(0, camera.height - 1, rows)
    return np.stack(np.meshgrid(x, y), axis=-1)


def projection_uncertainty(camera: Camera, covariance: Array, columns: int = COLUMNS) -> Array:
    """Standard deviation (h, w) in px of where a point projects, in the direction in which it is largest.

    With J_p and J_m the derivatives of a pixel by the camera's parameters and by a motion of the camera, to first order

        dq = (J_p - J_m (sum J_m' J_m)^-1 sum J_m' J_p) dp,

    sums over the grid; the result is the root of the larger eigenvalue of the covariance of dq.

    Parameters
    ----------
    covariance : array (k, k)
        Covariance of `Camera.parameter_names`; the sum of two for the expected `camera_difference` of two calibrations.
    columns : int
        Width w of the grid, `pixel_grid`.

    Returns
    -------
    array (h, w)
        nan where no ray reaches the pixel.
    """
    grid = pixel_grid(camera, columns)
    normalized = camera.from_pixels(grid.reshape(-1, 2))
    seen = np.isfinite(normalized[:, 0])
    by_parameters = camera.parameter_jacobian(normalized[seen])
    rows = pose_jacobian(_points(normalized[seen]), np.eye(3)[None], np.zeros((1, 3)), np.ones(2)).reshape(-1, 2, 6)
    by_motion = camera.pixel_jacobian(normalized[seen]) @ rows[..., :3]
    best = np.linalg.lstsq(_stacked(by_motion), _stacked(by_parameters), rcond=None)[0]
    left = by_parameters - by_motion @ best
    variance = np.linalg.eigvalsh(left @ covariance @ left.swapaxes(-1, -2))[..., -1]
    sigma = np.full(len(seen), np.nan)
    sigma[seen] = np.sqrt(np.maximum(variance, 0.0))
    return sigma.reshape(grid.shape[:2])


def camera_difference(first: Camera, second: Camera, columns: int = COLUMNS) -> Array:
    """Difference (h, w, 2) in px between two cameras: where the second sees what the first sees at each pixel.

    The second camera is turned so that the sum of the squared differences over the image is least. A robust cost
    would spare the middle the corners' errors, but change the differences by factors that `projection_uncertainty`,
    which says what to expect of them, does not know.

    Parameters
    ----------
    first, second : Camera
        Cameras for images of one size.
    columns : int
        As for `projection_uncertainty`.

    Returns
    -------
    array (h, w, 2)
        nan where one of them sees nothing.
    """
    from scipy.optimize import least_squares

    grid = pixel_grid(first, columns)
    pixels = grid.reshape(-1, 2)
    points = _points(first.from_pixels(pixels))

    def difference(motion: Array) -> Array:
        moved = points @ exponential(motion).T
        return second.to_pixels(np.where(moved[:, 2:] > 0, perspective(moved), np.nan)) - pixels

    seen = np.isfinite(difference(np.zeros(3))).all(axis=-1)

    def residual(motion: Array) -> Array:
        return np.nan_to_num(difference(motion)[seen]).ravel()

    best = least_squares(residual, np.zeros(3), x_scale=1e-3, ftol=1e-12, xtol=1e-12).x
    return difference(best).reshape(grid.shape)


def draw_uncertainty(sigma: Array, camera: Camera, ax: "Axes") -> "Axes":
    """Draw `projection_uncertainty` over the image as a map with labeled contours."""
    return _map(sigma, camera, ax, "standard deviation, px")


def draw_difference(difference: Array, camera: Camera, ax: "Axes") -> "Axes":
    """Draw `camera_difference` over the image as a map of its size, with arrows of one length for its direction."""
    size = np.linalg.norm(difference, axis=-1, keepdims=True)
    _map(size[..., 0], camera, ax, "difference, px")
    columns = difference.shape[1]
    step = max(columns // _ARROWS, 1)
    every_tenth = (slice(step // 2, None, step), slice(step // 2, None, step))
    at, to, size = (values[every_tenth] for values in (pixel_grid(camera, columns), difference, size))
    length = 0.6 * (camera.width - 1) * step / (columns - 1)
    to = np.divide(length * to, size, out=np.zeros_like(to), where=size > _LEAST)
    ax.quiver(*at.T, *to.T, angles="xy", scale_units="xy", scale=1, width=2.5e-3, color=INK, zorder=3)
    return ax


def _map(values: Array, camera: Camera, ax: "Axes", label: str) -> "Axes":
    from matplotlib.colors import LogNorm

    x, y = np.moveaxis(pixel_grid(camera, values.shape[1]), -1, 0)
    # In steps of 1, 2, 5: a corner may be a hundred times as bad as the middle.
    positive = np.ma.masked_invalid(np.maximum(values, _LEAST))
    largest = float(positive.max()) if positive.count() else _LEAST
    smallest = max(float(positive.min()) if positive.count() else _LEAST, largest / _RANGE)
    steps = [base * 10.0**power for power in range(-8, 7) for base in (1, 2, 5)]
    low = max((level for level in steps if level <= smallest), default=steps[0])
    high = min((level for level in steps if level > largest), default=steps[-1])
    levels = [level for level in steps if low <= level <= high]
    filled = ax.contourf(x, y, positive, levels=levels, norm=LogNorm(low, high), cmap=COLORS, extend="min")
    if smallest < largest:
        lines = ax.contour(x, y, positive, levels=levels[1:-1], colors=INK, linewidths=0.5)
        ax.clabel(lines, fontsize=7, fmt=lambda value: f"{value:g}")
    ax.figure.colorbar(filled, ax=ax, label=label, shrink=0.85, ticks=levels, format=lambda value, _: f"{value:g}")
    ax.set(facecolor=FAINT)
    return image_axes(camera, ax)


def image_axes(camera: Camera, ax: "Axes") -> "Axes":
    """Make axes those of the image."""
    ax.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5), aspect="equal")
    ax.set(xlabel="x, px", ylabel="y, px")
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
    ax.grid(visible=False)
    return ax


def _points(normalized: Array) -> Array:
    """Points (n, 3) at unit distance on the rays of normalized coordinates (n, 2)."""
    rays = np.concatenate([normalized, np.ones((len(normalized), 1))], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True), dtype=float)


def _stacked(jacobian: Array) -> Array:
    return jacobian.reshape(-1, jacobian.shape[-1])
