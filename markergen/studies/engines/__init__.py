"""Engines that compute the cells of a study. A new engine is a new file."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence

from markergen.registry import Registry
from markergen.studies.cells import Cell, Result, Work

DEFAULT = "processes"


class Engine(ABC):
    """Computes cells in any order, each with one thread of linear algebra, so that all engines give the same bits.

    Parameters
    ----------
    workers : int or None
        Number of processes on this machine; one per processor for None.
    scheduler : str or None
        Address of a running cluster, such as ``tcp://127.0.0.1:8786``.
    """

    def __init__(self, workers: int | None = None, scheduler: str | None = None) -> None:
        self.workers, self.scheduler = workers, scheduler

    @abstractmethod
    def check(self) -> None:
        """Reject an engine that cannot work, before anything else is done; raises as `run` does."""

    @abstractmethod
    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """Yield each cell with its arrays as soon as it is finished; closing it early stops all work in progress.

        Raises
        ------
        MarkergenError
            If the workers cannot be reached, or are lost.
        """


ENGINES: Registry[type[Engine]] = Registry("engine", "markergen.studies.engines")
"""Engines by name."""


def engine_for(workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return the engine for a cluster if the address of one is given, otherwise for this machine."""
    return ENGINES["dask" if scheduler else DEFAULT](workers, scheduler)
