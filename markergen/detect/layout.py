"""What the search for labels needs to know of a marker."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.marker import Marker

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_PAIRS = 240
"""Ordered pairs of control points from which poses are guessed; all of them for up to 16 dots."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Control points, their dots, and the pairs from which poses are guessed.

    Attributes
    ----------
    points : array (n, 3), m
    radii : array (n,), m
    rings : array (n,) of bool
    flat : bool
        All at one height.
    pairs : array (q, 2) of int
        Ordered pairs of control points.
    reach : float
        Up to how many radii of a dot another point can lie and be its own and no other's.
    """

    points: Array
    radii: Array
    rings: NDArray[np.bool_]
    flat: bool
    pairs: Indices
    reach: float

    def __len__(self) -> int:
        return len(self.points)


def layout_of(marker: Marker) -> Layout:
    """Layout of a marker.

    Raises
    ------
    InputError
        If its control points are fewer than four or on one line, or a dot has no size.
    """
    points = marker.xyz
    features = [point.feature for point in marker.control_points]
    radii = np.array([feature.diameter / 2 for feature in features])
    if len(points) < 4:
        raise InputError("4 or more control points", f"n={len(points)}", "a pose needs four")
    if radii.min() == 0:
        raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
    centered = points - points.mean(axis=0)
    scatter = np.linalg.eigvalsh(centered.T @ centered)
    if scatter[1] <= 1e-6 * scatter[2]:
        raise InputError(
            "control points that span a plane", "all of them on one line", "use a layout that spans the plane"
        )
    rings = np.array([feature.kind == "ring" for feature in features])
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    reach = min(2.0, 0.5 * float((distance.min(axis=-1) / radii).min()))
    flat = not np.ptp(points[:, 2])
    return Layout(points, radii, rings, flat, _pairs(points, rings), reach)


def _pairs(points: Array, rings: NDArray[np.bool_]) -> Indices:
    """Ordered pairs of points apart from each other, those with one ring first, up to `MAX_PAIRS`."""
    pairs = np.array(list(permutations(range(len(points)), 2)), dtype=np.intp)
    lateral = np.linalg.norm(np.diff(points[pairs, :2], axis=1)[:, 0], axis=-1)
    # Short pairs tell the turn badly. What is left of many is a fixed random choice, so that every dot has its share.
    pairs = np.random.default_rng(0).permutation(pairs[lateral > 0.25 * lateral.max()])
    one_ring = rings[pairs].sum(axis=-1) == 1
    return pairs[np.argsort(~one_ring, kind="stable")[:MAX_PAIRS]]
