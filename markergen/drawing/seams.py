"""Where a drawing that is larger than the paper is cut into tiles: along lines that no dot is on, if there are any."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, inf

import numpy as np

KERF = 0.5
"""Nearest in mm that a seam may come to a dot's edge: what scissors miss a line by."""

STEP, MOST_PLACES = 0.5, 1000
"""Between places that are tried for a seam, mm, and how many at most."""

SHORTEST = 25.0
"""Of a tile, mm."""

CUT, EVEN = 1e3, 1e-3
"""What a cut dot and an uneven tile weigh, against 1 for a seam that grazes a dot."""


@dataclass(frozen=True)
class Item:
    """What should not be cut, along one axis: its middle, its half width without and with a quiet zone; mm.

    A half width of -`KERF` is for what may be cut, but should not be near a seam.
    """

    middle: float
    half: float
    quiet: float


@dataclass(frozen=True)
class Cuts:
    """Seams along one axis from low to high, mm, and how many items lie on one."""

    places: tuple[float, ...]
    cut: int

    @property
    def tiles(self) -> int:
        """Number of tiles along the axis."""
        return len(self.places) + 1


def find_seams(low: float, high: float, room: float, overlap: float, items: Sequence[Item]) -> Cuts:
    """Seams for a drawing from `low` to `high` on pages with `room` for it; mm.

    A tile needs half the overlap on each side that has a neighbor. As few tiles as can be, but one more if that saves
    an item from being cut. Among all places for the seams those are taken that cut the fewest items, then keep the
    farthest out of quiet zones, then make the tiles the most alike: found exactly, on a grid of places, by dynamic
    programming.
    """
    extent = high - low
    if extent <= room:
        return Cuts((), 0)
    # Two outer tiles of room - overlap / 2, and room - overlap for each between them.
    least = 2 + max(ceil((extent - (2 * room - overlap)) / (room - overlap) - 1e-9), 0)
    found = [_places(low, high, room, overlap, items, count) for count in (least, least + 1)]
    return min(found, key=lambda cuts: cuts.cut)


def _places(low: float, high: float, room: float, overlap: float, items: Sequence[Item], count: int) -> Cuts:
    outer, inner = room - overlap / 2, room - overlap
    step = max(STEP, (high - low) / MOST_PLACES)
    grid = np.arange(low, high + step / 2, step)
    middle, half, quiet = np.array([(item.middle, item.half, item.quiet) for item in items]).reshape(-1, 3).T
    away = np.abs(grid[:, None] - middle)
    hit = away < half + KERF
    graze = np.clip((quiet - away) / np.maximum(quiet - half, 1e-9), 0, 1) ** 2
    cost = CUT * hit.sum(axis=1) + np.where(hit, 0.0, graze).sum(axis=1)
    best = np.where((grid <= low + outer) & (grid >= low + SHORTEST), cost, inf)
    best += EVEN * ((grid - _even(low, high, 1, count)) / inner) ** 2
    came: list[np.ndarray] = []
    reach, gap = int(inner / step), ceil(SHORTEST / step)
    for number in range(2, count):
        back = np.zeros(len(grid), dtype=int)
        here = np.full(len(grid), inf)
        for place in range(gap, len(grid)):
            first = max(place - reach, 0)
            window = best[first : place - gap + 1]
            if len(window):
                back[place] = first + int(np.argmin(window))
                here[place] = best[back[place]]
        here += cost + EVEN * ((grid - _even(low, high, number, count)) / inner) ** 2
        best = here
        came.append(back)
    best = np.where((grid >= high - outer) & (grid <= high - SHORTEST), best, inf)
    place = int(np.argmin(best))
    if not np.isfinite(best[place]):
        # One tile more than needed may be too many for tiles of a sensible size.
        return Cuts((), len(items) + 1)
    chain = [place]
    for back in reversed(came):
        chain.append(int(back[chain[-1]]))
    return Cuts(tuple(float(grid[index]) for index in reversed(chain)), int(hit[chain].sum()))


def _even(low: float, high: float, number: int, count: int) -> float:
    return low + number * (high - low) / count
