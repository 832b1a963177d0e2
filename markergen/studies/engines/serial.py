"""One cell after the other in this very process: for looking into what a cell does."""

from collections.abc import Generator, Sequence

from markergen.studies.cells import Cell, Result, Work
from markergen.studies.engines import ENGINES, Engine


@ENGINES.register("serial")
class Serial(Engine):
    """Computes in this process; its threads of linear algebra are as the process was started with."""

    def check(self) -> None:
        """Nothing can be missing."""

    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """See `Engine.run`."""
        for cell in cells:
            yield cell, work(cell)
