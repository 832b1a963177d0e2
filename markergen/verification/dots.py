"""Dots: what is expected of a marker, and what the circles of a page may be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.model.marker import Marker
from markergen.verification.reading import Page

Array = NDArray[np.float64]

ALIKE = 1.3
"""Circles whose radius is within this factor of a dot's may be dots."""

CONCENTRIC = 0.2
"""Share of the smaller radius by which the centers of circles of one dot may differ."""


@dataclass(frozen=True, eq=False)
class Dots:
    """Dots of a marker or a page, lengths in mm.

    Attributes
    ----------
    centers : array (m, 2)
    radii : array (m,)
        nan where a format does not tell.
    inner : array (m,)
        Inner radius of a ring, 0 of a disk.
    spread : array (m,)
        How far the circles of one dot are apart, or its inner circle off its middle.
    heights : array (m,) or None
    ordered : bool
        Whether they stand in the order in which their file was written.
    """

    centers: Array
    radii: Array
    inner: Array
    spread: Array
    heights: Array | None = None
    ordered: bool = True

    def __len__(self) -> int:
        return len(self.centers)

    @property
    def rings(self) -> NDArray[np.bool_]:
        """Which of them are rings."""
        return np.asarray(self.inner > 0)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "Dots":
        """Some of them."""
        heights = None if self.heights is None else self.heights[chosen]
        return Dots(
            self.centers[chosen], self.radii[chosen], self.inner[chosen], self.spread[chosen], heights, self.ordered
        )


def expected_dots(marker: Marker) -> Dots:
    """Dots that the marker's control points have."""
    features = [point.feature for point in marker.control_points]
    return Dots(
        1e3 * marker.xyz[:, :2],
        np.array([500 * feature.diameter for feature in features]),
        np.array([500 * feature.inner_diameter for feature in features]),
        np.zeros(len(marker)),
        1e3 * marker.xyz[:, 2],
    )


def grown(dots: Dots, room: float) -> Dots:
    """Disks that are larger by `room` in radius."""
    return Dots(dots.centers, dots.radii + room, np.zeros(len(dots)), dots.spread, dots.heights, dots.ordered)


def dots_of(page: Page, expected: Dots) -> Dots:
    """Circles of a page that may be dots: concentric ones are one, and some are about as large as an expected dot."""
    circles = page.circles
    if not np.isfinite(circles[:, 2]).all() or not len(circles):
        none = np.zeros(len(circles))
        return Dots(circles[:, :2], none + np.nan, none, none, page.heights)
    radii = np.unique(expected.radii)
    near = np.abs(np.log(np.maximum(circles[:, 2:], 1e-12) / radii)).min(axis=-1) < np.log(ALIKE)
    free, rows = near.copy(), []
    for index in np.flatnonzero(near):
        if not free[index]:
            continue
        distance = np.linalg.norm(circles[:, :2] - circles[index, :2], axis=-1)
        mine = distance <= CONCENTRIC * np.minimum(circles[:, 2], circles[index, 2])
        same = mine & near
        free &= ~same
        # Of several the one that fits best is the dot, such as a ring's outer circle beside a white one around it.
        sizes = circles[same]
        fit = np.abs(np.log(sizes[:, 2:] / radii)).min(axis=-1)
        center = sizes[np.argmin(fit)]
        within = circles[mine & (circles[:, 2] < center[2] / ALIKE)]
        alike = sizes[np.abs(sizes[:, 2] / center[2] - 1) < 0.01]
        others = np.concatenate([alike, within])[:, :2] - center[:2]
        spread = float(np.linalg.norm(others, axis=-1).max(initial=0.0))
        rows.append((*center, float(within[:, 2].max(initial=0.0)), spread))
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Dots(table[:, :2], table[:, 2], table[:, 3], table[:, 4])
