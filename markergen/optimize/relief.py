"""Search for a layout in space: many starts with random heights, each polished under what hides what."""

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Objective
from markergen.optimize.contacts import contacts
from markergen.optimize.multistart import DISTINCT, Optimum
from markergen.optimize.polish import ALL_PAIRS_UP_TO, REACH, SOFTNESSES
from markergen.optimize.relief_room import ReliefRoom, Sights
from markergen.optimize.trace import Record
from markergen.options import Progress

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STARTS, AS_MANY_UP_TO = 24, 8
"""Layouts of up to 8 dots that are started from; of more dots there are fewer, in proportion."""

KEPT = 3
"""How many distinct ones are polished for all poses."""

ITERATIONS, ROUNDS = 60, 8
"""Most iterations of a polish, and most polishes one after the other, each under the lines of sight that all before it
came to touch."""

QUICK, QUICK_ROUNDS = 30, 3
"""The same where it only tells good from bad."""

TIGHTEST = 3
"""Of each dot and pillar so many poses come into the constraints at once."""

NEAR = 0.25
"""Share of the spacing up to which lines of sight come into the constraints before they are crossed."""

CLEAR = 1e-7
"""A layout in which no pillar stands deeper than this many m in a line of sight loses nothing where that is mended."""

BLOCK = 20
"""Of more dots than `ALL_PAIRS_UP_TO` so many move at once: the time of a step grows with the cube of their number."""

GAIN, STALE = 1e-5, 2
"""Rounds that gain no more than this share, so many of them one after the other, are the last."""

RESTED = 1e-6
"""A layout that moves by less than this many radii, with nothing hidden, is done."""


def search_relief(
    objective: Objective,
    room: ReliefRoom,
    flat: Array,
    rng: np.random.Generator,
    starts: int = 0,
    progress: Progress | None = None,
    rough: Objective | None = None,
    record: Record | None = None,
) -> Optimum:
    """Find the layout (n, 3) in the room that minimizes the objective; it is never worse than the flat one.

    Parameters
    ----------
    flat : array (n, 2), m
        A good flat layout: half of the starts have its places, the others random ones; each dot starts from the plane
        or from the top, in the first one every second dot around.
    starts : int
        0 takes a number that suits n.
    progress : callable or None
        Called with the stage, what is done of it, and its total.
    rough : Objective or None
        The same criterion for fewer poses, which saves time in telling good starts from bad ones.
    record : callable or None
        Called with what each step makes of layouts (see `markergen.optimize.trace`).
    """
    n = len(flat)
    starts = starts or max(2, STARTS * AS_MANY_UP_TO // max(n, AS_MANY_UP_TO))
    found = []
    for done in range(starts):
        if progress:
            progress("relief", done, starts)
        plane = room.region.sample(1, n, rng)[0] if done % 2 else flat
        up = rng.integers(0, 2, n) if done else _every_second(flat)
        start = np.column_stack([plane, room.height * up])
        found.append(polish_relief(rough or objective, room, start, QUICK, QUICK_ROUNDS, record))
    best = _flat(objective, flat)
    kept = _distinct(found)[: KEPT if n <= ALL_PAIRS_UP_TO else 1]
    for done, (points, _) in enumerate(kept):
        if progress:
            progress("polish", done, len(kept))
        much = (ITERATIONS, ROUNDS) if n <= ALL_PAIRS_UP_TO else (QUICK, QUICK_ROUNDS)
        end = polish_relief(objective, room, points, *much, record=record)
        best = min(best, end, key=lambda pair: pair[1])
    if progress:
        progress("polish", len(kept), len(kept))
    return Optimum(*best)


def polish_relief(
    objective: Objective,
    room: ReliefRoom,
    start: Array,
    iterations: int = ITERATIONS,
    rounds: int = ROUNDS,
    record: Record | None = None,
) -> tuple[Array, float]:
    """Improve one layout (n, 3) in m; return what is feasible and best on the way, and its value, inf if nothing is."""
    region = room.region
    wide = len(region.walls) == 1 and len(start) <= ALL_PAIRS_UP_TO
    reach = np.inf if wide else REACH * region.boundary.radius
    rested = RESTED * region.boundary.radius if wide else 0.99 * reach
    best, best_value = start, float(objective(start[None])[0]) if room.holds(start) else np.inf
    current, sights = start, Sights(room)
    for softness in SOFTNESSES if objective.kinked else (0.0,):
        stale = 0
        for number in range(rounds):
            sights = sights.joined(room.tightest(current, NEAR * region.spacing, TIGHTEST))
            way, end = [current], current
            for moving in _blocks(current, number):
                end = _slsqp(objective, room, sights, end, moving, softness, iterations, reach, way)
            moved = float(np.abs(end - current).max())
            mended = room.within(end)
            if record:
                steps = np.stack([*way, end, mended])
                record("relief", steps[:-1], steps[1:])
            value = float(objective(mended[None])[0])
            stale = 0 if value < best_value * (1 - GAIN) else stale + 1
            if value < best_value and room.holds(mended):
                best, best_value = mended, value
            # What is hidden may stay so for now: the next round knows of it.
            clear = room.hides(end) <= CLEAR
            current = mended if clear else end
            if (clear and moved < rested) or stale == STALE:
                break
    return best, best_value


def _slsqp(
    objective: Objective,
    room: ReliefRoom,
    sights: Sights,
    start: Array,
    moving: Index,
    softness: float,
    iterations: int,
    reach: float,
    way: list[Array],
) -> Array:
    """One run of SLSQP from a layout (n, 3), of which some dots move; its steps are added to `way`."""
    from scipy.optimize import minimize

    region, scale = room.region, room.region.boundary.radius
    diagonal = np.sqrt(2) * reach
    to_dot = region.spacing + 2 * diagonal if region.spacing else -1.0
    near = contacts(region.walls, start[:, :2], region.inset, region.inset + diagonal, to_dot).of(moving)
    sights = sights.of(moving)
    least = (region.spacing / scale) ** 2

    def laid(x: Array) -> Array:
        points = start.copy()
        points[moving] = x.reshape(-1, 3) * scale
        return points

    def log_value(x: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(laid(x)[None], softness)
        return float(np.log(value[0])), (gradient[0, moving] * (scale / value[0])).ravel()

    def slack(x: Array) -> Array:
        points = laid(x)
        wall = (near.room(points[:, :2]) - region.inset) / scale
        apart = np.sum((near.apart(points[:, :2]) / scale) ** 2, axis=-1) - least
        return np.concatenate([wall, apart, sights.gap(points) / scale])

    def slack_jacobian(x: Array) -> Array:
        points = laid(x)
        pairs = near.apart_jacobian(points[:, :2], 2 / scale * near.apart(points[:, :2]))
        plane = np.concatenate([near.room_jacobian(points[:, :2]), pairs])
        level = np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=-1)
        return np.concatenate([level, sights.gap_jacobian(points)])[:, moving].reshape(-1, 3 * len(moving))

    low, high = (start[moving] - reach) / scale, (start[moving] + reach) / scale
    low[:, 2], high[:, 2] = 0.0, room.height / scale
    result = minimize(
        log_value,
        np.clip(start[moving] / scale, low, high).ravel(),
        jac=True,
        method="SLSQP",
        bounds=np.stack([low.ravel(), high.ravel()], axis=-1),
        constraints=[{"type": "ineq", "fun": slack, "jac": slack_jacobian}],
        options={"maxiter": iterations, "ftol": 1e-9},
        callback=lambda x: way.append(laid(x)),
    )
    return laid(result.x)


def _blocks(points: Array, number: int) -> list[Index]:
    """Dots that move together: of many, strips of some 20 side by side, across another direction each time."""
    n = len(points)
    if n <= ALL_PAIRS_UP_TO:
        return [np.arange(n)]
    angle = number * np.pi * (3 - np.sqrt(5))
    order = np.argsort(points[:, 0] * np.cos(angle) + points[:, 1] * np.sin(angle), kind="stable")
    return [np.sort(block) for block in np.array_split(order, -(-n // BLOCK))]


def _every_second(flat: Array) -> Index:
    """1 for every second dot around the center, 0 for the others: in a ring it is what hides least and tells most."""
    around = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]), kind="stable")
    up = np.empty(len(flat), dtype=np.int64)
    up[around] = np.arange(len(flat)) % 2
    return up


def _flat(objective: Objective, flat: Array) -> tuple[Array, float]:
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points, float(objective(points[None])[0])


def _distinct(found: list[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Those of layouts with their values that are distinct by value, the best first."""
    kept: list[tuple[Array, float]] = []
    for points, value in sorted(found, key=lambda pair: pair[1]):
        if not kept or value > kept[-1][1] * (1 + DISTINCT):
            kept.append((points, value))
    return kept
