"""Global search: in a disk a batch of descents from random starts, then a polish of the best distinct few."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.packing import pack
from markergen.optimize.placement import place
from markergen.optimize.polish import ALL_PAIRS_UP_TO, polish
from markergen.optimize.region import Region
from markergen.optimize.supersab import descend
from markergen.optimize.trace import Record

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, what is done of it, and its total."""

POLISHED = 5
"""How many distinct descents are polished."""

DISTINCT = 2e-4
"""Descents whose values are this close, relatively, ended in the same optimum: one of them is polished."""

JITTER = 0.01
"""Starts of the polish are shaken by this many radii: a descent from a symmetric layout can end on a saddle, such as
two squares at a wrong angle to each other, which no gradient leaves."""


@dataclass(frozen=True)
class Optimum:
    """The best layout (n, 2) in m that was found, and its value."""

    points: Array
    value: float


def search(
    objective: Objective,
    region: Region,
    n: int,
    rng: np.random.Generator,
    restarts: int = 0,
    progress: Progress | None = None,
    rough: Objective | None = None,
    record: Record | None = None,
) -> Optimum:
    """Find the layout of n control points in the region that minimizes the objective.

    In a disk by descents from random layouts; where corners, holes or many dots would trap them, by exchange
    (`markergen.optimize.placement`).

    Parameters
    ----------
    restarts : int
        Random starts; 0 takes the objective's own default.
    rough : Objective or None
        The same criterion for fewer poses, which saves time in the exchange.
    record : callable or None
        Called with what each step makes of layouts (see `markergen.optimize.trace`).
    """
    if len(region.walls) > 1 or n > ALL_PAIRS_UP_TO:
        return Optimum(*place(objective, rough or objective, region, n, rng, restarts, progress, record))
    if progress:
        progress("descent", 0, 1)
    starts = region.sample(restarts or objective.default_restarts, n, rng)
    if not region.holds(starts).all():
        # Random points jam when the dots nearly fill the room; the packing itself is then the start.
        starts = np.concatenate([starts, pack(region.boundary, n, region.clearance)[0][None]])
    told = (lambda done, total: progress("descent", done, total)) if progress else None
    descent = descend(objective, region, starts, progress=told, record=record)
    order = np.argsort(descent.values, kind="stable")[: np.isfinite(descent.values).sum()]
    chosen: list[int] = []
    for index in order:
        if not chosen or descent.values[index] > descent.values[chosen[-1]] * (1 + DISTINCT):
            chosen.append(int(index))
        if len(chosen) == POLISHED:
            break
    best, best_value = descent.points[order[0]], float(descent.values[order[0]])
    shakes = rng.normal(scale=JITTER * region.boundary.radius, size=(len(chosen), n, 2))
    for done, (index, shake) in enumerate(zip(chosen, shakes, strict=True), start=1):
        shaken = region.project((descent.points[index] + shake)[None])
        if record:
            record("polish", descent.points[[index]], shaken)
        points, value = polish(objective, region, shaken[0], record=record)
        if value < best_value and region.holds(points[None])[0]:
            best, best_value = points, value
        if progress:
            progress("polish", done, len(chosen))
    return Optimum(best, best_value)
