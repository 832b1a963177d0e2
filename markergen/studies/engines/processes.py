"""Processes on this machine."""

# tests: tests/studies/engines/test_engines.py

from collections.abc import Generator, Sequence
from contextlib import closing

from markergen.pool import as_completed_chunks, workers_for
from markergen.studies.cells import Cell, Result, Work
from markergen.studies.engines import ENGINES, Engine


@ENGINES.register("processes")
class Processes(Engine):
    """Computes in new processes, even with one worker, so that the number of workers does not change a bit."""

    def check(self) -> None:
        """Reject an invalid number of workers."""
        workers_for(self.workers, 1)

    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """See `Engine.run`."""
        workers = workers_for(self.workers, len(cells))
        with closing(as_completed_chunks(work, cells, workers)) as results:
            for index, result in results:
                yield cells[index], result
