"""Packings: the largest diameter of n dots, and the number of dots of one size that fit."""

import numpy as np

from markergen.arrays import Array
from markergen.maths.rotation import turn_z
from markergen.model.boundary import Boundary
from markergen.optimize.constraints import contacts
from markergen.optimize.polish import slsqp
from markergen.optimize.problem import FeasibleRegion

EXACT_UP_TO = 24
"""Number of dots above which the hexagonal lattice is used, a lower bound within a few percent."""

DENSEST = np.pi / np.sqrt(12)
"""Density of the densest packing of equal disks in the plane."""


TURNS = np.deg2rad([0.0, 15.0, 30.0, 45.0])
"""Rotations of the lattice that are tried; its period is 60 degrees."""

SAMPLES = 8
"""Number of random starts; with corners or several regions, the same number of spread-out starts is added."""

SPREAD = 500
"""Number of random positions from which a spread-out start is chosen."""

REACH, ROUNDS = 0.3, 12
"""Except in a disk, the maximum movement of a dot per round, as a fraction of the largest diameter considered, and the
number of rounds: only nearby constraints then matter."""


def largest_diameter(boundary: Boundary, n: int, clearance: float | None = None) -> float:
    """Largest diameter in m at which n dots fit with their clearance (see `pack`); 0 if nothing fits."""
    return pack(boundary, n, clearance)[1]


def pack(boundary: Boundary, n: int, clearance: float | None = None) -> tuple[Array, float]:
    """Layout (n, 2) in m with the largest dots, and their diameter in m; clearance None is a tenth of it.

    Maximizes d over (points, d) with depth >= d/2 + g and pairwise distance >= d + g by SLSQP from a few spread-out
    starts; missing the best packing makes the diameter slightly too small, never too large. 0 if nothing fits.
    """
    if n > EXACT_UP_TO:
        return _pack_on_lattice(boundary, n, clearance)
    full = np.sqrt(4 * boundary.area / (np.pi * n))
    region, rng = FeasibleRegion(boundary, 0.6 * full), np.random.default_rng(0)
    starts = list(region.sample(SAMPLES, n, rng))
    if len(region.walls) > 1:
        starts += [_spread(boundary, n, rng) for _ in range(SAMPLES)]
    points, diameter = max((_grow(region, start, full, clearance) for start in starts), key=lambda packed: packed[1])
    return points, max(0.0, diameter)


def fitting(region: FeasibleRegion, n: int) -> Array | None:
    """Find a feasible layout (n, 2) in m, such as a packing; None if none is found."""
    points, _ = pack(region.boundary, n, region.spacing - region.diameter)
    if region.holds(points[None])[0]:
        return points
    dense = lattice(region.boundary, region.diameter, region.clearance, region.gap)
    return dense[:n] if len(dense) >= n else None


def count_that_fit(boundary: Boundary, diameter: float, clearance: float, at_most: int) -> int:
    """Number of dots of that diameter that fit with that clearance, in m; the search stops at `at_most`."""
    fit = min(at_most, len(lattice(boundary, diameter, clearance)))
    area_limit = int(boundary.area * 4 / (np.pi * diameter**2)) if diameter else at_most
    while fit < min(at_most, EXACT_UP_TO, area_limit) and largest_diameter(boundary, fit + 1, clearance) >= diameter:
        fit += 1
    return fit


def _grow(region: FeasibleRegion, start: Array, most: float, clearance: float | None) -> tuple[Array, float]:
    """Grow dots at points (n, 2) from zero to at most `most` m while they push each other; see `pack`."""
    n, scale = len(start), region.boundary.radius
    # Edge and gap as linear functions of the diameter: offset + slope * d.
    offset, tenth = (0.0, 0.1) if clearance is None else (clearance / scale, 0.0)
    x = np.append(start.ravel() / scale, 0.0)
    everything = len(region.walls) == 1
    reach = np.inf if everything else REACH * most
    for _ in range(1 if everything else ROUNDS):
        before = x
        x = _run(region, x, most / scale, offset, tenth, reach / scale)
        if everything or np.abs(x - before).max() < 1e-6:
            break
    points = x[:-1].reshape(n, 2) * scale
    first, second = np.triu_indices(n, 1)
    d, gap = x[-1] * scale, (offset + tenth * x[-1]) * scale
    room = region.boundary.depth(points) - d / 2 - gap
    distance = np.linalg.norm(points[first] - points[second], axis=-1) - d - gap
    # The diameter is reduced by any remaining violation of the constraints, so that the result is feasible.
    return points, float(d - 2 * max(0.0, -room.min(), -distance.min(initial=0.0)))


def _run(region: FeasibleRegion, x: Array, most: float, offset: float, tenth: float, reach: float) -> Array:
    """One round of `_grow`, in units of the radius; no coordinate changes by more than `reach`."""
    n, scale = (len(x) - 1) // 2, region.boundary.radius
    points, d, diagonal = x[:-1].reshape(n, 2) * scale, x[-1], np.sqrt(2) * reach
    gap, most_gap = offset + tenth * d, offset + tenth * most
    touching = contacts(
        region.walls,
        points,
        min((d / 2 + gap) * scale, float(region.boundary.depth(points).min())),
        (most / 2 + most_gap + diagonal) * scale,
        (most + most_gap + 2 * diagonal) * scale,
    )

    def slack(x: Array) -> Array:
        points, d = x[:-1].reshape(n, 2), x[-1]
        gap = offset + tenth * d
        distance = np.linalg.norm(touching.apart(points), axis=-1)
        return np.concatenate([touching.room(points * scale) / scale - d / 2 - gap, distance - d - gap])

    def slack_jacobian(x: Array) -> Array:
        points = x[:-1].reshape(n, 2)
        apart = touching.apart(points)
        unit = apart / np.maximum(np.linalg.norm(apart, axis=-1, keepdims=True), 1e-12)
        by_points = np.concatenate([touching.room_jacobian(points * scale), touching.apart_jacobian(points, unit)])
        walls, pairs = len(touching.dot), len(touching.first)
        by_diameter = np.concatenate([np.full(walls, -0.5 - tenth), np.full(pairs, -1.0 - tenth)])
        return np.concatenate([by_points.reshape(walls + pairs, -1), by_diameter[:, None]], axis=1)

    direction = np.zeros(2 * n + 1)
    direction[-1] = -1.0
    bounds = None
    if np.isfinite(reach):
        bounds = x - reach, x + reach
        bounds[0][-1], bounds[1][-1] = 0.0, most
    return slsqp(lambda x: (-x[-1], direction), slack, slack_jacobian, x, bounds, 200, 1e-9)


def _spread(boundary: Boundary, n: int, rng: np.random.Generator) -> Array:
    """Layout (n, 2) in m in which every point is as far as possible from the previous ones and from the outline."""
    places = boundary.sample(SPREAD, 0.0, rng)
    room = 2 * boundary.depth(places)
    chosen = np.empty((n, 2))
    for i in range(n):
        chosen[i] = places[int(np.argmax(room)) if i else int(rng.integers(SPREAD))]
        room = np.minimum(room, np.linalg.norm(places - chosen[i], axis=-1))
    return chosen


def lattice(boundary: Boundary, diameter: float, clearance: float, gap: float = 0.0) -> Array:
    """Points (k, 2) of a hexagonal lattice, with the best shift and rotation, at which dots of that diameter fit."""
    pitch = diameter + max(clearance, gap)
    reach = int(np.ceil(2 * boundary.radius / pitch)) + 1
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    sites = np.stack([i + j / 2, j * np.sqrt(0.75)], axis=-1).reshape(-1, 2) * pitch
    shifts = np.stack(np.meshgrid(np.arange(4) / 4, np.arange(4) / 4), axis=-1).reshape(-1, 1, 2) * pitch
    # A disk is invariant under rotation.
    rotations = [turn_z(angle)[:2, :2].T for angle in (TURNS[:1] if boundary.is_round else TURNS)]
    placed = np.concatenate([(sites + shifts) @ rotation for rotation in rotations])
    # A billionth of the pitch is a tolerance for rounding in dots that touch the outline.
    inset = diameter / 2 + clearance - 1e-9 * pitch
    # The circumscribed circle excludes most sites quickly.
    inside = np.linalg.norm(placed - boundary.center, axis=-1) <= boundary.radius - inset
    inside[inside] = boundary.depth(placed[inside]) >= inset
    best = int(np.argmax(inside.sum(axis=1)))
    return np.asarray(placed[best][inside[best]])


def _pack_on_lattice(boundary: Boundary, n: int, clearance: float | None) -> tuple[Array, float]:
    # Upper bound from the densest packing, so this diameter is never reached.
    low, high = 0.0, float(np.sqrt(4 * DENSEST * boundary.area / (np.pi * n)) * 2)
    points = np.zeros((n, 2))
    for _ in range(30):
        middle = (low + high) / 2
        sites = lattice(boundary, middle, middle / 10 if clearance is None else clearance)
        if len(sites) >= n:
            low, points = middle, sites[:n]
        else:
            high = middle
    return points, low
