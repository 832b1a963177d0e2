"""How large n dots can be, and how many dots of one size fit."""

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.optimize.region import Region

Array = NDArray[np.float64]

EXACT_UP_TO = 24
"""Beyond this many dots the hexagonal lattice is used, a lower bound within a few per cent."""

DENSEST = np.pi / np.sqrt(12)
"""Share of the plane that the densest packing of equal disks covers."""


def largest_diameter(boundary: Boundary, n: int, clearance: float | None = None) -> float:
    """Largest diameter in m at which n dots fit with their clearance (see `pack`); 0 when nothing fits."""
    return pack(boundary, n, clearance)[1]


def pack(boundary: Boundary, n: int, clearance: float | None = None) -> tuple[Array, float]:
    """Layout (n, 2) in m that holds the largest dots, and their diameter in m; clearance None is a tenth of it.

    Maximizes d over (points, d) with depth >= d/2 + g and pairwise distance >= d + g by SLSQP from a few spread-out
    starts; a packing that it misses makes the diameter slightly too small, never too large. 0 when nothing fits.
    """
    if n > EXACT_UP_TO:
        return _pack_on_lattice(boundary, n, clearance)
    guess = 0.6 * np.sqrt(4 * boundary.area / (np.pi * n))
    starts = Region(boundary, guess).sample(8, n, np.random.default_rng(0))
    points, diameter = max((_grow(boundary, start, clearance) for start in starts), key=lambda packed: packed[1])
    return points, max(0.0, diameter)


def count_that_fit(boundary: Boundary, diameter: float, clearance: float, at_most: int) -> int:
    """How many dots of that diameter fit, with that clearance in m; the search stops at `at_most`."""
    fit = min(at_most, len(_lattice(boundary, diameter, clearance)))
    area_limit = int(boundary.area * 4 / (np.pi * diameter**2)) if diameter else at_most
    while fit < min(at_most, EXACT_UP_TO, area_limit) and largest_diameter(boundary, fit + 1, clearance) >= diameter:
        fit += 1
    return fit


def _grow(boundary: Boundary, start: Array, clearance: float | None) -> tuple[Array, float]:
    from scipy.optimize import minimize

    n, scale = len(start), boundary.radius
    first, second = np.triu_indices(n, 1)
    # Edge and gap as linear functions of the diameter: offset + slope * d.
    offset, tenth = (0.0, 0.1) if clearance is None else (clearance / scale, 0.0)
    pairs = np.arange(len(first))

    def slack(x: Array) -> Array:
        points, d = x[:-1].reshape(n, 2), x[-1]
        gap = offset + tenth * d
        distance = np.linalg.norm(points[first] - points[second], axis=-1)
        return np.concatenate([boundary.depth(points * scale) / scale - d / 2 - gap, distance - d - gap])

    def slack_gradient(x: Array) -> Array:
        points = x[:-1].reshape(n, 2)
        gradient = np.zeros((n + len(first), n, 2))
        gradient[np.arange(n), np.arange(n)] = boundary.depth_gradient(points * scale)
        difference = points[first] - points[second]
        unit = difference / np.maximum(np.linalg.norm(difference, axis=-1, keepdims=True), 1e-12)
        gradient[n + pairs, first], gradient[n + pairs, second] = unit, -unit
        by_diameter = np.concatenate([np.full(n, -0.5 - tenth), np.full(len(first), -1.0 - tenth)])
        return np.concatenate([gradient.reshape(n + len(first), -1), by_diameter[:, None]], axis=1)

    direction = np.zeros(2 * n + 1)
    direction[-1] = -1.0
    x = np.append(start.ravel() / scale, 0.0)
    result = minimize(
        lambda x: -x[-1],
        x,
        jac=lambda _: direction,
        method="SLSQP",
        constraints=[{"type": "ineq", "fun": slack, "jac": slack_gradient}],
        options={"maxiter": 200, "ftol": 1e-9},
    )
    # What is left of the constraints' violation is paid for with the diameter, so the answer really fits.
    diameter = (result.x[-1] - 2 * max(0.0, -slack(result.x).min())) * scale
    return result.x[:-1].reshape(n, 2) * scale, float(diameter)


def _lattice(boundary: Boundary, diameter: float, clearance: float) -> Array:
    """Points (k, 2) of the best shift of a hexagonal lattice on which dots of that diameter fit."""
    pitch = diameter + clearance
    reach = int(np.ceil(2 * boundary.radius / pitch)) + 1
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    lattice = np.stack([i + j / 2, j * np.sqrt(0.75)], axis=-1).reshape(-1, 2) * pitch
    shifts = np.stack(np.meshgrid(np.arange(4) / 4, np.arange(4) / 4), axis=-1).reshape(-1, 1, 2) * pitch
    # A billionth of the pitch is what a dot that touches the outline may be short of by rounding.
    inside = boundary.depth(lattice + shifts) >= diameter / 2 + clearance - 1e-9 * pitch
    best = int(np.argmax(inside.sum(axis=1)))
    return (lattice + shifts[best])[inside[best]]


def _pack_on_lattice(boundary: Boundary, n: int, clearance: float | None) -> tuple[Array, float]:
    # No packing covers more than the densest one, so this diameter is never reached.
    low, high = 0.0, float(np.sqrt(4 * DENSEST * boundary.area / (np.pi * n)) * 2)
    points = np.zeros((n, 2))
    for _ in range(30):
        middle = (low + high) / 2
        found = _lattice(boundary, middle, middle / 10 if clearance is None else clearance)
        if len(found) >= n:
            low, points = middle, found[:n]
        else:
            high = middle
    return points, low
