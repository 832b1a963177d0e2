"""The layouts that a design is held against, all from the same feasible region."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives.criteria import RANDOM_LAYOUTS, regular_polygon
from markergen.optimize.region import Region

Array = NDArray[np.float64]


def comparison_layouts(region: Region, n: int, seed: int = 0) -> dict[str, Array]:
    """Layouts (B, m, 2) in m by name: ``ngon`` and ``square`` on the inset rim, and ``random`` ones of n points.

    A layout that the region does not hold (its dots would touch) is left out.
    """
    radius = region.boundary.radius - region.inset
    layouts = {"ngon": regular_polygon(n, radius)[None], "square": regular_polygon(4, radius)[None]}
    layouts["random"] = region.sample(RANDOM_LAYOUTS, n, np.random.default_rng(seed))
    # Random layouts that stayed jammed are dropped; the regular ones are kept or dropped whole.
    return {name: kept for name, batch in layouts.items() if len(kept := batch[region.holds(batch)])}
