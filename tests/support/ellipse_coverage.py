"""Exact area of each pixel that an ellipse covers, in closed form: what the rasterizer of polygons is held against."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
"""Corners of a pixel, in the order in which the signed area x dy - y dx is positive."""


def ellipse_coverage(center: Array, semi: Array, angle: float, width: int, height: int) -> tuple[Array, int, int]:
    """Fraction of each pixel's area inside one ellipse, exact to rounding.

    The affine map of the ellipse to the unit disk takes pixels to parallelograms, whose common area with the disk
    has a closed form (`disk_polygon_area`), and leaves ratios of areas as they are. Only pixels on the outline need it.

    Parameters
    ----------
    center, semi : arrays (2,), px; pixel centers at integer coordinates, semi-axes above 0
    angle : float, rad, of the first semi-axis from x
    width, height : int, px

    Returns
    -------
    tile : array (h, w) in [0, 1]
        The part of the image around the ellipse; empty where the ellipse lies outside the image.
    top, left : int
        The pixel of the image that tile[0, 0] belongs to.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    half_size = np.hypot([semi[0] * cosine, semi[0] * sine], [semi[1] * sine, semi[1] * cosine])
    low = np.maximum(np.floor(center - half_size + 0.5), 0).astype(int)
    high = np.minimum(np.ceil(center + half_size - 0.5), [width - 1, height - 1]).astype(int)
    if np.any(high < low):
        return np.zeros((0, 0)), 0, 0

    to_disk = np.array([[cosine, sine], [-sine, cosine]]) / np.asarray(semi, dtype=float)[:, None]
    x = np.arange(low[0], high[0] + 1) - center[0]
    y = np.arange(low[1], high[1] + 1) - center[1]
    middles = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1) @ to_disk.T
    corners = _CORNERS @ to_disk.T
    reach = np.linalg.norm(corners, axis=-1).max()
    distance = np.hypot(middles[..., 0], middles[..., 1])
    tile = (distance < 1).astype(float)
    outline = np.abs(distance - 1) <= reach
    tile[outline] = disk_polygon_area(middles[outline][:, None] + corners) * (semi[0] * semi[1])
    # Rounding can leave an area of -1e-18 outside or 1 + 1e-16 inside.
    return np.clip(tile, 0, 1), int(low[1]), int(low[0])


def disk_polygon_area(vertices: Array) -> Array:
    """Area (...) common to the unit disk and polygons (..., m, 2), positive where they turn from x toward y.

    Green's theorem: each edge contributes the triangle that its part inside the disk spans with the origin, and the
    circular sectors under its parts outside.
    """
    p = vertices
    q = np.roll(vertices, -1, axis=-2)
    along = q - p
    square = np.sum(along**2, axis=-1)
    slope = np.sum(p * along, axis=-1)
    # |p + t along| = 1 at both ends of the part inside. A line that misses the disk gives one point twice.
    root = np.sqrt(np.maximum(slope**2 - square * (np.sum(p * p, axis=-1) - 1), 0))
    enter = p + (np.clip((-slope - root) / square, 0, 1))[..., None] * along
    leave = p + (np.clip((-slope + root) / square, 0, 1))[..., None] * along
    twice = _cross(enter, leave) + _angle(p, enter) + _angle(leave, q)
    return np.asarray(twice.sum(axis=-1) / 2)


def _cross(first: Array, second: Array) -> Array:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _angle(first: Array, second: Array) -> Array:
    return np.arctan2(_cross(first, second), np.sum(first * second, axis=-1))
