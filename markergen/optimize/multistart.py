"""Global search: in a disk a batch of descents from random starts, then a polish of the best distinct few."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.objectives import Objective
from markergen.optimize.packing import fitting
from markergen.optimize.placement import place
from markergen.optimize.polish import ALL_PAIRS_UP_TO, polish
from markergen.optimize.region import Region
from markergen.optimize.supersab import descend
from markergen.optimize.trace import Record
from markergen.options import Progress
from markergen.units import format_length

Array = NDArray[np.float64]

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

    Raises
    ------
    InputError
        If no layout is found that the region holds and that determines what the objective asks for.
    """
    if len(region.walls) > 1 or n > ALL_PAIRS_UP_TO:
        found = Optimum(*place(objective, rough or objective, region, n, rng, restarts, progress, record))
    else:
        found = _descended(objective, region, n, rng, restarts or objective.default_restarts, progress, record)
    if not np.isfinite(found.value):
        raise InputError(
            f"a {region.boundary} with room for {n} control points that are not in one line",
            f"dots of {format_length(region.diameter)} with {format_length(region.clearance)} clearance",
            "use a larger marker, a smaller --dot or a smaller --n",
        )
    return found


def _descended(
    objective: Objective,
    region: Region,
    n: int,
    rng: np.random.Generator,
    restarts: int,
    progress: Progress | None,
    record: Record | None,
) -> Optimum:
    """The best of descents from random layouts; inf if none ends in a layout that is feasible."""
    if progress:
        progress("descent", 0, 1)
    starts = region.sample(restarts, n, rng)
    if not region.holds(starts).all():
        # Random points jam when the dots nearly fill the room; one layout that fits is then a start as well.
        packed = fitting(region, n)
        starts = starts if packed is None else np.concatenate([starts, packed[None]])
    told = (lambda done, total: progress("descent", done, total)) if progress else None
    descent = descend(objective, region, starts, progress=told, record=record)
    order = np.argsort(descent.values, kind="stable")
    best, best_value = descent.points[order[0]], float(descent.values[order[0]])
    chosen: list[int] = []
    for index in order[: np.isfinite(descent.values).sum()]:
        if not chosen or descent.values[index] > descent.values[chosen[-1]] * (1 + DISTINCT):
            chosen.append(int(index))
        if len(chosen) == POLISHED:
            break
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
