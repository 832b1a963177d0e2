"""The layouts that a design is held against, all from the same feasible region."""

import numpy as np
from numpy.typing import NDArray

from markergen.geometry import region as geometry
from markergen.objectives import Setting
from markergen.objectives.criteria import RANDOM_LAYOUTS, regular_polygon
from markergen.objectives.pose import PoseObjective
from markergen.optimize.region import Region

Array = NDArray[np.float64]

PHASES = 24
"""Turns of a regular polygon that are looked at."""

NOTICEABLE = 1e-3
"""Relative gain for which a polygon is turned: otherwise one of its corners stands straight up."""

SIZES, HALVINGS = 100, 30
"""Sizes of a polygon that are tried, and halvings of the interval between the largest that fits and the next."""


def comparison_layouts(region: Region, n: int, seed: int = 0, setting: Setting | None = None) -> dict[str, Array]:
    """Layouts (B, m, 2) in m by name: ``ngon`` and ``square``, regular and as large as can be, and ``random`` ones.

    Regular polygons lie about the center of the marker or of the largest circle in the region, whichever is better.
    A layout that the region does not hold (its dots would touch) is left out.

    Parameters
    ----------
    setting : Setting or None
        Where the regular ones are turned to their best side, by the pose objective; None takes the largest ones, with
        a corner straight up if that is as good.
    """
    polygons = {"ngon": _polygon(region, n, setting), "square": _polygon(region, 4, setting)}
    layouts = {**polygons, "random": region.sample(RANDOM_LAYOUTS, n, np.random.default_rng(seed))}
    # Random layouts that stayed jammed are dropped; the regular ones are kept or dropped whole.
    return {name: kept for name, batch in layouts.items() if len(kept := batch[region.holds(batch)])}


def _polygon(region: Region, n: int, setting: Setting | None) -> Array:
    """The best regular n-gon (1, n, 2) in m, or one that the region does not hold."""
    turned = 2 * np.pi / n * np.arange(PHASES) / PHASES
    cosine, sine = np.cos(turned), np.sin(turned)
    unit = regular_polygon(n, 1.0) @ np.stack([cosine, sine, -sine, cosine], axis=-1).reshape(-1, 2, 2)
    found = np.concatenate([_largest(region, unit, center) for center in _centers(region)])
    held = found[region.holds(found)]
    if not len(held):
        return found[:1]
    if setting is None:
        worth = -np.linalg.norm(held[:, 0] - held.mean(axis=1), axis=-1)
    else:
        worth = np.log(PoseObjective(setting)(held))
    # The first is upright.
    return held[:1] if worth[0] <= worth.min() + NOTICEABLE * abs(worth.min()) else held[[np.argmin(worth)]]


def _largest(region: Region, unit: Array, center: Array) -> Array:
    """Polygons (B, n, 2) with corners in directions (B, n, 2) from a center, as large as the region allows."""
    boundary = region.boundary
    if len(region.walls) == 1:
        return unit * (boundary.radius - region.inset)

    def fits(size: Array) -> NDArray[np.bool_]:
        corners = center + unit * size[..., None, None]
        return np.all(boundary.depth(corners) >= region.inset, axis=-1)

    # In a ring a large polygon may fit where a smaller one does not.
    sizes = 2 * boundary.radius * np.arange(SIZES) / SIZES
    fitting = fits(np.broadcast_to(sizes[:, None], (SIZES, len(unit))))
    low = sizes[SIZES - 1 - np.argmax(fitting[::-1], axis=0)] * fitting.any(axis=0)
    high = low + sizes[1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = fits(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.asarray(center + unit * low[:, None, None])


def _centers(region: Region) -> Array:
    """Centers (1 or 2, 2) in m: that of the marker, and that of the largest circle in the region."""
    if len(region.walls) == 1:
        return np.zeros((1, 2))
    # Inside is what an odd number of the outlines goes around.
    inside = geometry.Region.odd(region.boundary.outlines())
    return np.stack([np.zeros(2), inside.largest_circle(1e-4 * region.boundary.radius)])
