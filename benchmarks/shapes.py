"""Six outlines that trap a descent, as in the figures of `benchmarks.optima`."""

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary, Circle, polygon_from

Array = NDArray[np.float64]


def shapes() -> dict[str, tuple[Boundary, tuple[Boundary, ...]]]:
    """Boundaries and keep-outs by name, all about as large as the paper's disk."""
    corners = [(x, y) for x in (-0.075, 0.075) for y in (-0.075, 0.075)]
    arms = np.array([[0, 0], [0.22, 0], [0.22, 0.09], [0.09, 0.09], [0.09, 0.22], [0, 0.22]])
    return {
        "rectangle": (polygon_from([_box(0, 0, 0.134, 0.067)]), ()),
        "L": (polygon_from([arms]), ()),
        "annulus": (Circle(0.15), (Circle(0.08),)),
        "star": (polygon_from([_star(0.15, 0.067)]), ()),
        "squares": (polygon_from([_box(-0.09, 0, 0.05, 0.05), _box(0.09, 0, 0.05, 0.05)]), ()),
        "plate": (polygon_from([_box(0, 0, 0.105, 0.105)]), tuple(Circle(0.013, corner) for corner in corners)),
    }


def _box(x: float, y: float, half_width: float, half_height: float) -> Array:
    return np.array([x, y]) + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [half_width, half_height]


def _star(outer: float, inner: float) -> Array:
    angles = np.pi / 2 + np.pi * np.arange(10) / 5
    return np.where(np.arange(10) % 2, inner, outer)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
