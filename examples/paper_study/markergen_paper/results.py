"""Combined results of the cells, and shapes of final layouts: similarity to a square, alignment, typical layouts."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.studies.cells import Cell, Result
from markergen_paper.experiments import CONDITIONED, DESCENT, EARLY, JOINT, LIMITS, METHODS, SETTLING
from markergen_paper.options import COORDINATES, NOISE_PX, OBJECTIVE_OF, QUIET_PX, PaperOptions, poses_of

Array = NDArray[np.float64]


BINS = 60
"""Number of bins of a histogram of final layouts along each axis."""

TYPICAL_GROUPS = {4: 1, 5: 2}
"""Numbers of points whose final layouts are shown, and their numbers of typical layouts, as in the paper."""

SQUARE_LIKE = 0.15
"""Maximum RMS deviation of the corners from the nearest square, relative to its size, of a square-like layout."""

TYPICAL = 500
"""Number of layouts of a group among which the most typical one is searched."""

_INNER = 0.6
"""Share of the farthest point's distance from the center up to which a point is an inner one."""


@dataclass(frozen=True, eq=False)
class PoseLayouts:
    """Layouts of n points under P poses: the results of `conditioned` from all its cells.

    Attributes
    ----------
    poses : array (P,)
        Indices into the paper's 400.
    arrays : mapping
        Arrays (P, B, ...) by name.
    """

    poses: NDArray[np.intp]
    arrays: Mapping[str, NDArray[Any]]

    def __getitem__(self, key: str) -> NDArray[Any]:
        return self.arrays[key]

    def of(self, poses: NDArray[np.intp]) -> "PoseLayouts":
        """Return the same for some of its poses."""
        rows = np.flatnonzero(np.isin(self.poses, poses))
        return PoseLayouts(self.poses[rows], {key: array[rows] for key, array in self.arrays.items()})

    def level(self, key: str, count: int | None = None, chosen: NDArray[np.bool_] | None = None) -> Array:
        """Geometric mean (P,) over the first `count` layouts of a positive value (P, B); nan if there are no values.

        `chosen` (P, B) selects layouts.

        An arithmetic mean would be dominated by the few random layouts that are nearly collinear.
        """
        values = np.asarray(self.arrays[key][:, :count], dtype=float)
        usable = np.isfinite(values) & (values > 0)
        if chosen is not None:
            usable &= chosen
        total = np.sum(np.log(np.where(usable, values, 1.0)), axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.exp(total / usable.sum(axis=1))

    @property
    def polar_deg(self) -> Array:
        """Polar angles (P,)."""
        return np.round(poses_of(self.poses.tolist()).polar_angle_deg, 1)


@dataclass(frozen=True, eq=False)
class PaperResults:
    """All results of the study.

    Attributes
    ----------
    options : PaperOptions
    full : mapping
        By n, the comparison in the paper's own coordinates and noise.
    beside : mapping
        By noise in px and n, the smaller comparison in all coordinates and for other objectives.
    descents : mapping
        By camera, the results of `descent`.
    early : mapping
        By coordinates and n, the results of `early`.
    joint : mapping
        By layout and n, the results of `joint`.
    methods : mapping
        By noise in px and n, the errors of further estimators, of all poses.
    limits : mapping
        By n, the results of `limits`.
    settling : mapping
        By n, the results of `settling`.
    """

    options: PaperOptions
    full: Mapping[int, PoseLayouts]
    beside: Mapping[tuple[float, int], PoseLayouts]
    descents: Mapping[str, Result]
    early: Mapping[tuple[str, int], Result]
    joint: Mapping[tuple[str, int], Result]
    methods: Mapping[tuple[float, int], PoseLayouts]
    limits: Mapping[int, Result]
    settling: Mapping[int, Mapping[str, NDArray[Any]]]

    def table(self, name: str, noise_px: float, n: int) -> PoseLayouts:
        """Largest table with layouts optimized under that name."""
        return self.full[n] if (name, noise_px) == (COORDINATES[0], NOISE_PX) else self.beside[noise_px, n]

    def everywhere(self) -> Iterator[tuple[str, float, Callable[[int], PoseLayouts]]]:
        """Coordinates, noise, and the table by n of each setting."""
        for name, noise_px in self.settings:
            yield name, noise_px, partial(self.table, name, noise_px)

    @property
    def settings(self) -> list[tuple[str, float]]:
        """Coordinates and noise in which claims are judged, the paper's own first."""
        return [(name, noise_px) for noise_px in (NOISE_PX, QUIET_PX) for name in COORDINATES]


def gather(options: PaperOptions, results: Mapping[Cell, Result]) -> PaperResults:
    """Combine the results of all cells, in the order of the cells."""
    blocks: dict[tuple[str, float, int], list[tuple[list[int], Result]]] = defaultdict(list)
    others: dict[str, dict[Any, Result]] = defaultdict(dict)
    for cell, result in results.items():
        settings = cell.settings
        if cell.kind == CONDITIONED:
            extent = "beside" if len(settings["optimized"]) == len(OBJECTIVE_OF) else "full"
            blocks[extent, settings["noise_px"], settings["n"]].append((settings["poses"], result))
        elif cell.kind in (METHODS, SETTLING):
            blocks[cell.kind, settings.get("noise_px", 0.0), settings["n"]].append((settings["poses"], result))
        elif cell.kind == LIMITS:
            others[cell.kind][settings["n"]] = result
        elif cell.kind == DESCENT:
            others[cell.kind][settings["camera"]] = result
        elif cell.kind == EARLY:
            others[cell.kind][settings["coordinates"], settings["n"]] = result
        else:
            others[JOINT][settings["layout"], settings["n"]] = result
    tables = {key: _joined(parts) for key, parts in blocks.items()}

    def of(extent: str) -> dict[tuple[float, int], PoseLayouts]:
        return {(noise_px, n): table for (name, noise_px, n), table in tables.items() if name == extent}

    return PaperResults(
        options,
        {n: table for (_, n), table in of("full").items()},
        of("beside"),
        others[DESCENT],
        others[EARLY],
        others[JOINT],
        of(METHODS),
        others[LIMITS],
        {n: table.arrays for (_, n), table in of(SETTLING).items()},
    )


def _joined(parts: list[tuple[list[int], Result]]) -> PoseLayouts:
    poses = np.concatenate([indices for indices, _ in parts]).astype(np.intp)
    arrays = {key: np.concatenate([result[key] for _, result in parts]) for key in parts[0][1]}
    return PoseLayouts(poses, arrays)


def finals(study: PaperResults, n: int) -> Array:
    """Final layouts (k, n, 2) of all descents in the paper's coordinates, m."""
    return np.asarray(study.full[n][f"{COORDINATES[0]}.layouts"], dtype=float).reshape(-1, n, 2)


def histogram(study: PaperResults, n: int) -> tuple[list[NDArray[np.intp]], Array]:
    """Counts (BINS, BINS) of final points by x and y, unaligned and aligned, and the edges (BINS + 1,) in m."""
    layouts = finals(study, n)
    edges = np.linspace(-0.16, 0.16, BINS + 1)
    counts = []
    for batch in (layouts, aligned(layouts)):
        points = batch.reshape(-1, 2)
        counts.append(np.histogram2d(points[:, 0], points[:, 1], (edges, edges))[0].astype(np.intp))
    return counts, edges


def typical_of(study: PaperResults, n: int) -> list[tuple[Array, float]]:
    """Typical final layouts (n, 2) in m, aligned, and the shares of their groups."""
    return typical(aligned(finals(study, n)), TYPICAL_GROUPS[n])


def square_misfit(layouts: Array) -> Array:
    """Distance (...) of four points (..., 4, 2) from the nearest square of any pose and size, relative to size.

    RMS distance of the points divided by that from their centroid: 0 for a square, 1 for no similarity.
    """
    centered = layouts - layouts.mean(axis=-2, keepdims=True)
    z = centered[..., 0] + 1j * centered[..., 1]
    # Sorted by angle about the centroid, the corners of a square are in order.
    z = np.take_along_axis(z, np.argsort(np.angle(z), axis=-1), axis=-1)
    square = np.array([1, 1j, -1, -1j])
    size = np.sum(np.abs(z) ** 2, axis=-1)
    along = np.abs(np.sum(z * square.conj(), axis=-1)) ** 2 / 4
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(np.clip(1 - along / size, 0.0, 1.0))


def best_square_misfit(layouts: Array) -> Array:
    """Minimum `square_misfit` (...) of any four of the points (..., n, 2)."""
    fours = combinations(range(layouts.shape[-2]), 4)
    return np.min([square_misfit(layouts[..., four, :]) for four in fours], axis=0)


def mirror_misfit(layouts: Array) -> Array:
    """Distance (...) of points (..., n, 2) from their mirror image at the best axis through the centroid, over size.

    RMS distance from a mirrored point to the nearest point, divided by that of the points from their centroid: 0 for a
    layout with an axis of symmetry.
    """
    centered = layouts - layouts.mean(axis=-2, keepdims=True)
    z = centered[..., 0] + 1j * centered[..., 1]
    # An axis maps a point to itself or to another one, so it halves the angle between two of them.
    first, second = np.triu_indices(layouts.shape[-2])
    turns = np.exp(1j * (np.angle(z[..., first]) + np.angle(z[..., second])))
    mirrored = turns[..., None] * z.conj()[..., None, :]
    nearest = np.min(np.abs(mirrored[..., None] - z[..., None, None, :]), axis=-1)
    size = np.sqrt(np.mean(np.abs(z) ** 2, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.mean(nearest**2, axis=-1)).min(axis=-1) / size)


def aligned(layouts: Array) -> Array:
    """Layouts (k, n, 2) rotated so that the n-fold harmonic of their points is in phase with a regular n-gon's."""
    z = layouts[..., 0] + 1j * layouts[..., 1]
    n = layouts.shape[-2]
    size = np.abs(z).max(axis=-1, keepdims=True)
    phase = np.angle(np.sum((z / size) ** n, axis=-1)) / n
    rotated = z * np.exp(1j * (np.pi / 2 - phase))[..., None]
    if n == 4:
        rotated *= np.exp(1j * np.pi / 4)
    return np.stack([rotated.real, rotated.imag], axis=-1)


def typical(layouts: Array, groups: int) -> list[tuple[Array, float]]:
    """Most typical layouts (n, 2) of the largest groups by number of inner points, and the groups' shares.

    The typical layout of a group is the one whose sorted distances are nearest to the medians over the group.
    """
    radius = np.linalg.norm(layouts, axis=-1)
    inner = np.sum(radius < _INNER * radius.max(axis=-1, keepdims=True), axis=-1)
    kinds, counts = np.unique(inner, return_counts=True)
    typical_layouts = []
    for kind in kinds[np.argsort(-counts, kind="stable")][:groups]:
        group = layouts[inner == kind]
        group = group[:: max(1, len(group) // TYPICAL)]
        distances = np.sort(_pairs(group), axis=-1)
        nearest = np.argmin(np.sum((distances - np.median(distances, axis=0)) ** 2, axis=-1))
        typical_layouts.append((group[nearest], float(np.mean(inner == kind))))
    return typical_layouts


def least_gap(layouts: Array) -> Array:
    """Minimum distance (...) between two points of layouts (..., n, 2)."""
    return _pairs(layouts).min(axis=-1)


def _pairs(layouts: Array) -> Array:
    first, second = np.triu_indices(layouts.shape[-2], 1)
    return np.linalg.norm(layouts[..., first, :] - layouts[..., second, :], axis=-1)
