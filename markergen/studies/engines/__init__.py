"""Engines: who computes the cells of a study. A new one is a new file."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass

from markergen.registry import Registry
from markergen.studies.cells import Cell, Result, Work

DEFAULT = "processes"


@dataclass(frozen=True)
class EngineOptions:
    """What a user may choose about engines.

    Attributes
    ----------
    workers : int or None
        Processes on this machine; None is one for each processor.
    scheduler : str or None
        Address of a running cluster, such as ``tcp://127.0.0.1:8786``.
    """

    workers: int | None = None
    scheduler: str | None = None


class Engine(ABC):
    """Computes cells in any order, each with one thread of linear algebra, so that all engines get the same bits."""

    def __init__(self, options: EngineOptions = EngineOptions()) -> None:
        self.options = options

    @abstractmethod
    def check(self) -> None:
        """Refuse, before anything else is done, to begin what could not be done; raises as `run` does."""

    @abstractmethod
    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """Yield each cell with its arrays as soon as it is finished; closing it early ends all that is under way.

        Raises
        ------
        MarkergenError
            If those who compute cannot be reached, or are lost.
        """


ENGINES: Registry[type[Engine]] = Registry("engine", "markergen.studies.engines")
"""Engines by name."""


def engine_for(workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return the engine that computes on a cluster if there is the address of one, and on this machine otherwise."""
    return ENGINES["dask" if scheduler else DEFAULT](EngineOptions(workers, scheduler))
