"""Whether a layout keeps its promises, found in other ways than those of the search."""

from collections.abc import Sequence
from itertools import combinations
from math import dist, hypot

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary, Circle

Array = NDArray[np.float64]

TOLERANCE = 1e-9
"""Breach in m that is put down to rounding."""

RAYS = 360
"""Points of a dot's rim that are looked at."""


def breach(
    points: Array, boundary: Boundary, keep_outs: Sequence[Boundary], diameter: float, clearance: float
) -> float:
    """Largest breach in m of the promises that a layout (n, 2 or 3) in m makes; 0 or less if it keeps them.

    Every dot lies whole in the boundary, `clearance` or more from its outline and from the keep-outs, and as far from
    every other dot. Circles are measured by plain arithmetic, all else by GEOS from the outlines.
    """
    inset = diameter / 2 + clearance
    worst = max((diameter + clearance - dist(p[:2], q[:2]) for p, q in combinations(points.tolist(), 2)), default=0.0)
    for x, y, *_ in points.tolist():
        worst = max(worst, inset - _depth(x, y, boundary), *(inset + _depth(x, y, keep_out) for keep_out in keep_outs))
    return worst


def check(points: Array, boundary: Boundary, keep_outs: Sequence[Boundary], diameter: float, clearance: float) -> None:
    """Refuse a layout that breaks its promises (see `breach`) by more than a nanometer.

    Raises
    ------
    RuntimeError
        If it does: a search has gone wrong, which is no fault of the user's.
    """
    worst = breach(points, boundary, keep_outs, diameter, clearance)
    if not worst <= TOLERANCE:
        raise RuntimeError(f"the layout that was found breaks its constraints by {worst:.3g} m")


def relief_breach(points: Array, relief: float, diameter: float, clearance: float, eyes: Array) -> float:
    """Largest breach in m of the promises that a layout (n, 3) in m makes in height; 0 or less if it keeps them.

    Every dot stands from 0 to `relief` over the plane and below all eyes (P, 3), and each ray from an eye to its rim
    keeps the clearance from all dots that are higher, or rather from the upright cylinders below these. The rim is
    sampled, which leaves out less than a thousandth of a mm of it.
    """
    worst = max(
        float(-points[:, 2].min()), float(points[:, 2].max()) - relief, float(np.max(points[:, 2] - eyes[:, 2].min()))
    )
    if not diameter:
        return worst
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    rim = diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for low, high in combinations(points[np.argsort(points[:, 2], kind="stable")], 2):
        # Heights at which a ray is beside the cylinder; it leaves the others above or below.
        reached = (high[2] - low[2]) / (eyes[:, 2] - low[2])
        way = np.linalg.norm(eyes[:, :2] - low[:2], axis=-1)
        near = reached * way + diameter + clearance >= dist(low[:2], high[:2])
        if high[2] <= low[2] or not near.any():
            continue
        start = low[:2] + rim - high[:2]
        toward = eyes[near, None, :2] - high[:2] - start
        nearest = -np.sum(start * toward, axis=-1) / np.maximum(np.sum(toward**2, axis=-1), np.finfo(float).tiny)
        share = np.clip(nearest, 0.0, reached[near, None])
        passing = np.linalg.norm(start + share[..., None] * toward, axis=-1)
        worst = max(worst, diameter / 2 + clearance - float(passing.min()))
    return worst


def check_relief(points: Array, relief: float, diameter: float, clearance: float, eyes: Array) -> None:
    """Refuse a layout that breaks its promises in height (see `relief_breach`) by more than a nanometer.

    Raises
    ------
    RuntimeError
        If it does: a search has gone wrong, which is no fault of the user's.
    """
    worst = relief_breach(points, relief, diameter, clearance, eyes)
    if not worst <= TOLERANCE:
        raise RuntimeError(f"the relief that was found breaks its constraints by {worst:.3g} m")


def _depth(x: float, y: float, boundary: Boundary) -> float:
    """Distance in m from the outline, negative outside."""
    import shapely

    if isinstance(boundary, Circle):
        return boundary.size - hypot(x - boundary.center[0], y - boundary.center[1])
    point = shapely.Point(x, y)
    rings = [shapely.LinearRing(ring) for ring in boundary.outlines()]
    # Inside is what an odd number of the outlines goes around.
    inside = sum(shapely.Polygon(ring).contains(point) for ring in rings) % 2 == 1
    distance = min(ring.distance(point) for ring in rings)
    return distance if inside else -distance
