"""Exchange of control points with positions on a grid: the moves that a descent cannot make.

A descent only goes downhill from its start: it does not leave a corner, pass a hole, or move a dot from one plate to
another. Here the dots are removed from the layout one by one and each is put back at the best of all positions, until
none has a better one (Fedorov 1972, with the objective itself in place of the determinant of the information).
"""

from abc import ABC, abstractmethod
from copy import copy
from typing import Self

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.objectives import Objective
from markergen.objectives.base import TraceObjective
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.ending import end_if_due
from markergen.optimize.problem import FeasibleRegion

Index = NDArray[np.int64]

RIM, INNER = 160, 160
"""Approximate number of positions along the edge and inside the region; more for more than 60 dots."""

BETTER = 1e-4
"""Relative gain that justifies moving a dot."""

SWEEPS, TURNS = 8, 500
"""Maximum number of rounds over all dots, and of single-dot attempts in total."""

AT_ONCE = 100
"""Number of places whose information is computed at a time; all at once would take 200 MB for 100 dots."""


def edge(region: FeasibleRegion, count: int) -> Array:
    """Positions (C, 2) in m on the edge of the region, about `count`, including its corners."""
    boundary = region.boundary
    corners = [outline for outline in boundary.outlines() if len(outline) <= count]
    return boundary.project(np.concatenate([*corners, boundary.rim(count)]), region.inset)


def places(region: FeasibleRegion, n: int) -> Array:
    """Positions (C, 2) in m for n control points: the edge of the region with its corners, and a lattice inside."""
    boundary, more = region.boundary, max(1.0, n / 60)
    rim = edge(region, int(RIM * more))
    pitch = np.sqrt(boundary.area / (INNER * more * np.sqrt(0.75)))
    reach = int(np.ceil(2 * boundary.radius / pitch)) + 1
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    lattice = np.stack([i + j / 2, j * np.sqrt(0.75)], axis=-1).reshape(-1, 2) * pitch
    lattice += (rim.min(axis=0) + rim.max(axis=0)) / 2
    # Lattice points within half a pitch of the edge would duplicate those on it.
    sites = np.concatenate([rim, lattice[boundary.depth(lattice) >= region.inset + pitch / 2]])
    sites = sites[boundary.depth(sites) >= region.inset - 1e-10]
    return np.asarray(sites[np.unique(np.round(sites / (1e-3 * boundary.radius)), axis=0, return_index=True)[1]])


class ExchangeTable(ABC):
    """Values of an objective for layouts on given positions that differ in one control point.

    Attributes
    ----------
    places : array (C, 2), m
    apart : array (C, C), m
        Distances between the places.
    """

    def __init__(self, places: Array) -> None:
        self.places, self.apart = places, distances(places)

    @abstractmethod
    def values(self, rest: Index, candidates: Index) -> Array:
        """Values (c,) of the layouts that consist of places `rest` (n - 1,) and one of `candidates` (c,)."""

    def joined(self, more: Array) -> Self:
        """Table of additional places (D, 2), which come first, and the current ones."""
        table = copy(self)
        table.places = np.concatenate([more, self.places])
        table.apart = distances(table.places)
        return table


class AnyExchangeTable(ExchangeTable):
    """Table for any objective, which is evaluated for each layout."""

    def __init__(self, objective: Objective, places: Array) -> None:
        super().__init__(places)
        self._objective = objective

    def values(self, rest: Index, candidates: Index) -> Array:
        """See `ExchangeTable`."""
        kept = np.broadcast_to(self.places[rest], (len(candidates), len(rest), 2))
        return self._objective(np.concatenate([kept, self.places[candidates][:, None]], axis=1))


class TraceExchangeTable(ExchangeTable):
    """Table for sqrt(trace(W M^-1)), M the sum of each control point's information: a hundred times as fast.

    A point has the information I = R'R with two rows R; with A = M^-1 of the rest,
    (M + R'R)^-1 = A - A R'(1 + R A R')^-1 R A.
    """

    def __init__(self, objective: TraceObjective, places: Array) -> None:
        super().__init__(places)
        self._objective, self._aggregate = objective, objective.aggregated
        self._information = self._added(places)
        self._products = _products(self._information)
        # A tiny fraction of the mean information of all places keeps M of three points or fewer regular.
        size = self._information.shape[-1]
        self._little = 1e-7 * np.einsum("pcii->pi", self._information)[:, None] / len(places) * np.eye(size)
        self._upper = np.triu_indices(size)

    def joined(self, more: Array) -> Self:
        """See `ExchangeTable`."""
        table, information = super().joined(more), self._added(more)
        table._information = np.concatenate([information, self._information], axis=1)
        table._products = np.concatenate([_products(information), self._products], axis=1)
        return table

    def _added(self, places: Array) -> Array:
        """I (P, C, k, k): the information that a point adds to four others that determine the pose."""
        base = regular_polygon(4, 0.7 * self._objective.setting.boundary.radius)
        layouts = np.concatenate([np.broadcast_to(base, (len(places), 4, 2)), places[:, None]], axis=1)
        alone = np.linalg.inv(self._objective.covariance(base[None]))
        parts = np.array_split(layouts, len(layouts) // AT_ONCE + 1)
        together = np.concatenate([np.linalg.inv(self._objective.covariance(part)) for part in parts])
        return np.asarray((together - alone).swapaxes(0, 1))

    def values(self, rest: Index, candidates: Index) -> Array:
        """See `ExchangeTable`."""
        inverse = np.linalg.inv(self._information[:, rest].sum(axis=1) + self._little)
        weighed = inverse @ self._objective.weight @ inverse
        i, j = self._upper
        both = np.stack([inverse[:, i, j], weighed[:, i, j]], axis=-1)[:, None]
        products = self._products if len(candidates) == len(self.places) else self._products[:, candidates]
        entries = products @ both
        (s, x), (t, y), (u, z) = (np.moveaxis(entries[:, :, i], -1, 0) for i in range(3))
        gain = ((1 + t) * x - 2 * u * z + (1 + s) * y) / ((1 + s) * (1 + t) - u * u)
        trace = np.einsum("pij,pij->p", self._objective.weight, inverse)[:, None] - gain
        return self._aggregate(np.sqrt(np.maximum(trace, 1e-300)).T, 0.0)[0]


def _products(information: Array) -> Array:
    """Rows (P, C, 3, k (k+1)/2) whose products with the upper triangle of a symmetric X are the entries of R X R'.

    R, with R'R = I, consists of two scaled eigenvectors of I (P, C, k, k), whose other eigenvalues are zero.
    """
    size, vectors = np.linalg.eigh(information)
    rows = vectors[..., -2:] * np.sqrt(np.maximum(size[..., None, -2:], 0.0))
    a, b = rows[..., 0], rows[..., 1]
    i, j = np.triu_indices(information.shape[-1])
    mixed = np.empty((*a.shape[:-1], 3, len(i)))
    for part, (left, right) in enumerate(((a, a), (b, b), (a, b))):
        mixed[..., part, :] = (left[..., i] * right[..., j] + left[..., j] * right[..., i]) * np.where(i == j, 0.5, 1.0)
    return mixed


def exchange_table(objective: Objective, places: Array) -> ExchangeTable:
    """Create the fastest table of places (C, 2) in m that the objective allows."""
    return (
        TraceExchangeTable(objective, places)
        if isinstance(objective, TraceObjective)
        else AnyExchangeTable(objective, places)
    )


def exchange(table: ExchangeTable, spacing: float, layout: Index) -> Index:
    """Move control points to their best places one by one, until none has a better one.

    Parameters
    ----------
    spacing : float
        Smallest distance in m between control points.
    layout : array (n,)
        Indices of the initial places.

    Returns
    -------
    array (n,)
        Indices of the final places.
    """
    layout, close = layout.copy(), too_close(table.apart, spacing)
    # The exchange ends once every dot in succession has failed to find a better place.
    still = step = 0
    while still < len(layout) and step < min(SWEEPS * len(layout), TURNS):
        end_if_due()
        i = step % len(layout)
        rest = np.delete(layout, i)
        free = np.flatnonzero(~close[rest].any(axis=0) | (np.arange(len(close)) == layout[i]))
        values = table.values(rest, free)
        best = int(np.argmin(values))
        moved = values[best] < values[np.searchsorted(free, layout[i])] * (1 - BETTER)
        if moved:
            layout[i] = free[best]
        still = 0 if moved else still + 1
        step += 1
    return layout


def random_layout(apart: Array, spacing: float, n: int, rng: np.random.Generator) -> Index | None:
    """Indices (n,) of random places that keep the spacing, given all distances between places; None if they jam."""
    close, free = too_close(apart, spacing), np.ones(len(apart), dtype=bool)
    layout: list[int] = []
    while len(layout) < n and free.any():
        layout.append(int(rng.choice(np.flatnonzero(free))))
        free &= ~close[layout[-1]]
    return np.array(layout) if len(layout) == n else None


def distances(places: Array) -> Array:
    """Distances (C, C) in m between places (C, 2)."""
    return np.asarray(np.linalg.norm(places[:, None] - places, axis=-1))


def too_close(apart: Array, spacing: float) -> NDArray[np.bool_]:
    """True where two places are too close for two control points; bare points must not coincide."""
    return apart < max(spacing - 1e-10, 1e-9)
