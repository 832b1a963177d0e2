"""One cell at a time in this process, for debugging."""

# tests: tests/studies/engines/test_engines.py

from collections.abc import Generator, Sequence

from markergen.studies.cells import Cell, Result, Work
from markergen.studies.engines import ENGINES, Engine


@ENGINES.register("serial")
class Serial(Engine):
    """Computes in this process, with as many threads of linear algebra as the process was started with."""

    def check(self) -> None:
        """Nothing to check."""

    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """See `Engine.run`."""
        for cell in cells:
            yield cell, work(cell)
