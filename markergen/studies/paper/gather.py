"""Results of the cells, put together."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.studies.cells import Cell, Result
from markergen.studies.paper.conditioned import KIND as CONDITIONED
from markergen.studies.paper.descent import EARLY_KIND, STEPS_KIND
from markergen.studies.paper.options import COORDINATES, NOISE_PX, OBJECTIVE_OF, QUIET_PX, PaperOptions, poses_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Table:
    """Layouts of n points under P poses: what `conditioned` tells, of all its cells.

    Attributes
    ----------
    poses : array (P,)
        Indices into the paper's 400.
    arrays : mapping
        By name, arrays (P, B, ...).
    """

    poses: NDArray[np.intp]
    arrays: Mapping[str, NDArray[Any]]

    def __getitem__(self, key: str) -> NDArray[Any]:
        return self.arrays[key]

    def of(self, poses: NDArray[np.intp]) -> "Table":
        """Return the same for some of its poses."""
        rows = np.flatnonzero(np.isin(self.poses, poses))
        return Table(self.poses[rows], {key: array[rows] for key, array in self.arrays.items()})

    def level(self, key: str, count: int | None = None) -> Array:
        """Geometric mean (P,) over the first `count` layouts of a positive value (P, B); nan where it has none.

        Random layouts near a line make a plain mean that of the worst few.
        """
        values = np.asarray(self.arrays[key][:, :count], dtype=float)
        usable = np.isfinite(values) & (values > 0)
        total = np.sum(np.log(np.where(usable, values, 1.0)), axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.exp(total / usable.sum(axis=1))

    @property
    def polar_deg(self) -> Array:
        """Polar angles (P,)."""
        return np.round(poses_of(self.poses.tolist()).polar_angle_deg, 1)


@dataclass(frozen=True, eq=False)
class Study:
    """Everything that was computed.

    Attributes
    ----------
    options : PaperOptions
    full : mapping
        By n, the comparison in the paper's own coordinates and noise.
    beside : mapping
        By noise in px and n, the smaller one in all coordinates and for other objectives.
    descents : mapping
        By camera, what `descent` tells.
    early : mapping
        By coordinates and n, what `early` tells.
    joint : mapping
        By layout and n, what `joint` tells.
    """

    options: PaperOptions
    full: Mapping[int, Table]
    beside: Mapping[tuple[float, int], Table]
    descents: Mapping[str, Result]
    early: Mapping[tuple[str, int], Result]
    joint: Mapping[tuple[str, int], Result]

    def table(self, name: str, noise_px: float, n: int) -> Table:
        """Where layouts that were optimized under that name are: the largest there is."""
        return self.full[n] if (name, noise_px) == (COORDINATES[0], NOISE_PX) else self.beside[noise_px, n]

    @property
    def settings(self) -> list[tuple[str, float]]:
        """Coordinates and noise that claims are judged in, the paper's own first."""
        return [(name, noise_px) for noise_px in (NOISE_PX, QUIET_PX) for name in COORDINATES]


def gather(options: PaperOptions, results: Mapping[Cell, Result]) -> Study:
    """Put the results of all cells together, in the order of the cells."""
    blocks: dict[tuple[bool, float, int], list[tuple[list[int], Result]]] = defaultdict(list)
    others: dict[str, dict[Any, Result]] = defaultdict(dict)
    for cell, result in results.items():
        settings = cell.settings
        if cell.kind == CONDITIONED:
            everything = len(settings["optimized"]) == len(OBJECTIVE_OF)
            blocks[everything, settings["noise_px"], settings["n"]].append((settings["poses"], result))
        elif cell.kind == STEPS_KIND:
            others[cell.kind][settings["camera"]] = result
        elif cell.kind == EARLY_KIND:
            others[cell.kind][settings["coordinates"], settings["n"]] = result
        else:
            others["joint"][settings["layout"], settings["n"]] = result
    tables = {key: _joined(parts) for key, parts in blocks.items()}
    return Study(
        options,
        {n: table for (everything, _, n), table in tables.items() if not everything},
        {(noise_px, n): table for (everything, noise_px, n), table in tables.items() if everything},
        others[STEPS_KIND],
        others[EARLY_KIND],
        others["joint"],
    )


def _joined(parts: list[tuple[list[int], Result]]) -> Table:
    poses = np.concatenate([indices for indices, _ in parts]).astype(np.intp)
    arrays = {key: np.concatenate([result[key] for _, result in parts]) for key in parts[0][1]}
    return Table(poses, arrays)
