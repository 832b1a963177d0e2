"""Layouts that need no search: regular polygons, concentric rings, lattices, and packings of the largest dots.

They are what designs are compared with and starts of the search; packings say how large dots can be, and how many fit.
"""
# tests: tests/optimize/test_packing.py tests/optimize/test_regular.py

from collections.abc import Iterator
from functools import lru_cache
from itertools import product

import numpy as np

from markergen.arrays import Array, Mask
from markergen.geometry.region import Region
from markergen.maths.rotation import rotation_z
from markergen.model.boundary import Boundary
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.constraints import contacts
from markergen.optimize.ending import limited
from markergen.optimize.polish import slsqp
from markergen.optimize.problem import FeasibleRegion

PHASES = 24
"""Number of rotations of a regular polygon within its period."""

SIZES, HALVINGS = 100, 30
"""Number of polygon sizes tried, and of bisections between the largest that fits and the next."""

RATIOS = (0.0, 0.35, 0.6, 0.8)
"""Radii of an inner ring, in those of the outer one; 0 places its dots about the center."""

MISSING, STEPS = (0, 1, 2), (1.0, 0.95, 0.9)
"""Numbers of dots that full rings have less than they hold, and distances between them, in spacings."""

PUSHED = 0.2
"""Largest overlap of dots, as a fraction of their spacing, that is pushed apart."""

PITCHES = 6
"""Number of pitches of a lattice, from dots that touch to the largest pitch with enough sites."""

EXACT_UP_TO = 24
"""Number of dots above which the hexagonal lattice is used, a lower bound within a few percent."""

DENSEST = np.pi / np.sqrt(12)
"""Density of the densest packing of equal disks in the plane."""

TURNS = np.deg2rad([0.0, 15.0, 30.0, 45.0])
"""Rotations of lattices, whose period is 60 or 90 degrees, and of rings as a whole."""

SAMPLES = 8
"""Number of random starts; with corners or several regions, the same number of spread-out starts is added."""

SPREAD = 500
"""Number of random positions from which a spread-out start is chosen."""

REACH, ROUNDS = 0.3, 12
"""Except in a disk, the maximum movement of a dot per round, as a fraction of the largest diameter considered, and the
number of rounds: only nearby constraints then matter."""


def polygons(region: FeasibleRegion, n: int) -> Array:
    """Largest regular n-gons (B, n, 2) in m at every phase, the upright one first; some may be infeasible.

    They are centered on the marker or on the largest circle in the region.
    """
    unit = regular_polygon(n, 1.0) @ _turns(2 * np.pi / n * np.arange(PHASES) / PHASES)
    return np.concatenate([_largest(region, unit, center) for center in _centers(region)])


def regular_layouts(region: FeasibleRegion, n: int) -> tuple[Array, int]:
    """Feasible regular layouts (B, n, 2) in m, and how many of them are polygons.

    Polygons come first, then two concentric rings, rings filled from the edge inward where one does not hold all dots,
    lattices, and a packing where nothing else fits.
    """
    first = polygons(region, n)
    others = np.array([*_rings(region, n), *_full_rings(region, n), *_lattices(region, n)])
    others = region.boundary.project(others, region.inset)
    # What has to be pushed far is no longer regular.
    others = region.project(others[region.violation(others) <= PUSHED * region.spacing])
    first, others = first[region.holds(first)], others[region.holds(others)]
    packed = None if len(first) + len(others) else fitting(region, n)
    return np.concatenate([first, others] if packed is None else [first, packed[None]]), len(first)


def _rings(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """Rings of n - k and k dots, aligned and staggered, on circles of several ratios."""
    radius = region.boundary.radius - region.inset
    center, least = _centers(region)[-1], (1 - PUSHED) * region.spacing
    for inner in range(max(1, n - _most_around(radius, least)), n // 2 + 1):
        for ratio in RATIOS[: 1 if inner == 1 else None]:
            if ratio and inner > _most_around(ratio * radius, least):
                continue
            outside, within = regular_polygon(n - inner, radius), regular_polygon(inner, max(ratio, 0.01) * radius)
            for offset in (0.0, np.pi / (n - inner)):
                for rotation in _turns(TURNS):
                    yield center + np.concatenate([outside, within @ _turns(np.array([offset]))[0]]) @ rotation


def _full_rings(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """Rings filled from the edge inward, the innermost with what is left, aligned and turned by half a step."""
    spacing, radius = region.spacing, region.boundary.radius - region.inset
    if not 0 < spacing <= radius or n <= _most_around(radius, spacing):
        return
    center = _centers(region)[-1]
    for missing, step in product(MISSING, STEPS):
        for fraction in (0.0, 0.5):
            rings, size, left = list[Array](), radius, n
            while left and size > 0:
                count = min(left, max(1, _most_around(size, spacing) - missing))
                rotation = _turns(np.array([fraction * len(rings) * 2 * np.pi / count]))[0]
                rings.append(regular_polygon(count, size) @ rotation)
                size, left = size - step * spacing, left - count
            if not left:
                yield center + np.concatenate(rings)


def _most_around(radius: float, spacing: float) -> int:
    """Number of dots that fit around a circle; of points without spacing, more than there are."""
    half = max(spacing, 1e-6 * abs(radius)) / 2 / max(radius, 1e-12)
    return int(np.pi / np.arcsin(half) + 1e-9) if half < 1 else 1


def _lattices(region: FeasibleRegion, n: int) -> Iterator[Array]:
    """The n outermost sites of hexagonal and square lattices with different pitches, shifts and rotations."""
    boundary = region.boundary
    most = np.sqrt(2 * boundary.area / n)
    pitches = np.geomspace(most, max(region.spacing, most / 4), 4 * PITCHES)[:, None, None]
    reach = int(np.ceil(np.sqrt(8 * n))) + 2
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    for sites in (np.stack([i + j / 2, j * np.sqrt(0.75)], axis=-1), np.stack([i, j], axis=-1)):
        for origin in (np.zeros(2), np.array([0.5, 0.0]), (sites[i + j == 1][:1] + [[1.0, 0.0]])[0] / 3):
            for rotation in _turns(TURNS):
                placed = boundary.center + (sites + origin) @ rotation * pitches
                held = boundary.depth(placed.reshape(-1, 2)).reshape(placed.shape[:2]) >= region.inset
                for k in np.flatnonzero(held.sum(axis=1) >= n)[:PITCHES]:
                    inside = placed[k, held[k]]
                    yield inside[np.argsort(-np.linalg.norm(inside - inside.mean(axis=0), axis=-1))[:n]]


def _turns(angles: Array) -> Array:
    """Matrices (..., 2, 2) that turn rows of points."""
    return rotation_z(angles)[..., :2, :2].swapaxes(-1, -2)


def _largest(region: FeasibleRegion, unit: Array, center: Array) -> Array:
    """Largest feasible polygons (B, n, 2) with corners in directions (B, n, 2) from a center."""
    boundary = region.boundary
    if len(region.walls) == 1:
        return unit * (boundary.radius - region.inset)

    def fits(size: Array) -> Mask:
        corners = center + unit * size[..., None, None]
        return np.all(boundary.depth(corners) >= region.inset, axis=-1)

    # In an annulus a large polygon may fit where a smaller one does not.
    sizes = 2 * boundary.radius * np.arange(SIZES) / SIZES
    fitting = fits(np.broadcast_to(sizes[:, None], (SIZES, len(unit))))
    low = sizes[SIZES - 1 - np.argmax(fitting[::-1], axis=0)] * fitting.any(axis=0)
    high = low + sizes[1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = fits(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.asarray(center + unit * low[:, None, None])


def _centers(region: FeasibleRegion) -> Array:
    """Centers (1 or 2, 2) in m: that of the marker, and that of the largest circle in the region."""
    if len(region.walls) == 1:
        return np.zeros((1, 2))
    return np.stack([np.zeros(2), _widest(region.boundary)])


@lru_cache(maxsize=8)
def _widest(boundary: Boundary) -> tuple[float, float]:
    """Center in m of the largest circle in a boundary, which takes half a second for outlines of hundreds of lines."""
    # A point is inside if an odd number of outlines enclose it.
    return Region.odd(boundary.outlines()).largest_circle(1e-4 * boundary.radius)


def largest_diameter(
    boundary: Boundary, n: int, clearance: float | None = None, gap: float = 0.0, enough: float = np.inf
) -> float:
    """Largest diameter in m at which n dots fit with their clearance and gap (see `pack`); 0 if nothing fits."""
    return pack(boundary, n, clearance, gap, enough)[1]


def pack(
    boundary: Boundary, n: int, clearance: float | None = None, gap: float = 0.0, enough: float = np.inf
) -> tuple[Array, float]:
    """Layout (n, 2) in m with the largest dots, and their diameter in m; clearance None is a tenth of it.

    Maximizes d over (points, d) with depth >= d/2 + c and pairwise distance >= d + max(c, gap), c the clearance, by
    SLSQP from a few spread-out starts; missing the best packing makes the diameter slightly too small, never too large.
    0 if nothing fits. A diameter that is `enough` is not exceeded by trying more starts.
    """
    if n > EXACT_UP_TO:
        return _pack_on_lattice(boundary, n, clearance, gap)
    full = np.sqrt(4 * boundary.area / (np.pi * n))
    region, rng = FeasibleRegion(boundary, 0.6 * full), np.random.default_rng(0)
    starts = list(region.sample(SAMPLES, n, rng))
    if len(region.walls) > 1:
        starts += [_spread(boundary, n, rng) for _ in range(SAMPLES)]
    points, diameter = starts[0], 0.0
    with limited(None):
        for start in starts:
            grown, size = _grow(region, start, full, clearance, gap)
            if size > diameter:
                points, diameter = grown, size
            if diameter >= enough:
                break
    return points, diameter


def fitting(region: FeasibleRegion, n: int) -> Array | None:
    """Find a feasible layout (n, 2) in m, such as a packing; None if none is found."""
    points, _ = pack(region.boundary, n, region.clearance, region.gap)
    if region.holds(points[None])[0]:
        return points
    dense = lattice(region.boundary, region.diameter, region.clearance, region.gap)
    return dense[:n] if len(dense) >= n else None


def count_that_fit(boundary: Boundary, diameter: float, clearance: float, at_most: int, gap: float = 0.0) -> int:
    """Number of dots of that diameter that fit with that clearance and gap, in m; the search stops at `at_most`."""
    fit = min(at_most, len(lattice(boundary, diameter, clearance, gap)))
    area_limit = int(boundary.area * 4 / (np.pi * diameter**2)) if diameter else at_most
    most = min(at_most, EXACT_UP_TO, area_limit)
    while fit < most and largest_diameter(boundary, fit + 1, clearance, gap) >= diameter:
        fit += 1
    return fit


def _grow(
    region: FeasibleRegion, start: Array, most: float, clearance: float | None, gap: float
) -> tuple[Array, float]:
    """Grow dots at points (n, 2) from zero to at most `most` m while they push each other; see `pack`."""
    n, scale = len(start), region.boundary.radius
    # The clearance as a linear function of the diameter: offset + tenth * d.
    offset, tenth = (0.0, 0.1) if clearance is None else (clearance / scale, 0.0)
    x = np.append(start.ravel() / scale, 0.0)
    everything = len(region.walls) == 1
    reach = np.inf if everything else REACH * most
    for _ in range(1 if everything else ROUNDS):
        before = x
        x = _run(region, x, most / scale, offset, tenth, gap / scale, reach / scale)
        if everything or np.abs(x - before).max() < 1e-6:
            break
    points = x[:-1].reshape(n, 2) * scale
    first, second = np.triu_indices(n, 1)
    d, clear = x[-1] * scale, (offset + tenth * x[-1]) * scale
    room = region.boundary.depth(points) - d / 2 - clear
    distance = np.linalg.norm(points[first] - points[second], axis=-1) - d - max(clear, gap)
    # The diameter is reduced by any remaining violation of the constraints, so that the result is feasible.
    return points, float(d - 2 * max(0.0, -room.min(), -distance.min(initial=0.0)))


def _run(region: FeasibleRegion, x: Array, most: float, offset: float, tenth: float, gap: float, reach: float) -> Array:
    """One round of `_grow`, in units of the radius; no coordinate changes by more than `reach`."""
    n, scale = (len(x) - 1) // 2, region.boundary.radius
    points, d, diagonal = x[:-1].reshape(n, 2) * scale, x[-1], np.sqrt(2) * reach
    most_clear = offset + tenth * most
    touching = contacts(
        region.walls,
        points,
        min((d / 2 + offset + tenth * d) * scale, float(region.boundary.depth(points).min())),
        (most / 2 + most_clear + diagonal) * scale,
        (most + max(most_clear, gap) + 2 * diagonal) * scale,
    )

    def slack(x: Array) -> Array:
        points, d = x[:-1].reshape(n, 2), x[-1]
        clear = offset + tenth * d
        distance = np.linalg.norm(touching.apart(points), axis=-1)
        return np.concatenate([touching.room(points * scale) / scale - d / 2 - clear, distance - d - max(clear, gap)])

    def slack_jacobian(x: Array) -> Array:
        points = x[:-1].reshape(n, 2)
        apart = touching.apart(points)
        unit = apart / np.maximum(np.linalg.norm(apart, axis=-1, keepdims=True), 1e-12)
        by_points = np.concatenate([touching.room_jacobian(points * scale), touching.apart_jacobian(points, unit)])
        walls, pairs = len(touching.dot), len(touching.first)
        growing = tenth if offset + tenth * x[-1] > gap else 0.0
        by_diameter = np.concatenate([np.full(walls, -0.5 - tenth), np.full(pairs, -1.0 - growing)])
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
    rotations = [rotation_z(angle)[:2, :2].T for angle in (TURNS[:1] if boundary.is_round else TURNS)]
    placed = np.concatenate([(sites + shifts) @ rotation for rotation in rotations])
    # A billionth of the pitch is a tolerance for rounding in dots that touch the outline.
    inset = diameter / 2 + clearance - 1e-9 * pitch
    # The circumscribed circle excludes most sites quickly.
    inside = np.linalg.norm(placed - boundary.center, axis=-1) <= boundary.radius - inset
    inside[inside] = boundary.depth(placed[inside]) >= inset
    best = int(np.argmax(inside.sum(axis=1)))
    return np.asarray(placed[best][inside[best]])


def _pack_on_lattice(boundary: Boundary, n: int, clearance: float | None, gap: float) -> tuple[Array, float]:
    # Upper bound from the densest packing, so this diameter is never reached.
    low, high = 0.0, float(np.sqrt(4 * DENSEST * boundary.area / (np.pi * n)) * 2)
    points = np.zeros((n, 2))
    for _ in range(30):
        middle = (low + high) / 2
        sites = lattice(boundary, middle, middle / 10 if clearance is None else clearance, gap)
        if len(sites) >= n:
            low, points = middle, sites[:n]
        else:
            high = middle
    return points, low
