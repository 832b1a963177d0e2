"""Running a study: what is missing is computed, what is finished is kept."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from time import perf_counter
from typing import Any

from markergen.studies.cells import Cell, Work
from markergen.studies.engines import Engine
from markergen.studies.store import Results, Store, open_store

CellProgress = Callable[[int, int, float], None]
"""Takes the cells that are done, all of them, and the seconds that are left, nan while nobody can tell."""


def run_cells(
    work: Work,
    cells: Sequence[Cell],
    folder: Path,
    identity: Mapping[str, Any],
    engine: Engine,
    resume: bool = False,
    progress: CellProgress | None = None,
    cost: Callable[[Cell], float] | None = None,
) -> Results:
    """Compute every cell that is not finished yet, and keep each in a file of the folder as soon as it is.

    Whatever ends this early, the finished cells remain and are never computed again. The results depend neither on the
    engine nor on the order in which cells finish.

    Parameters
    ----------
    work : callable
        Computes the arrays of a cell; a function of a module.
    cells : sequence of Cell
    folder : Path
        Of the study; new, empty, or with `resume` that of the same study.
    identity : mapping
        Plain JSON values: which study it is.
    engine : Engine
    resume : bool
    progress : callable or None
    cost : callable or None
        What a cell costs beside another, for the time left; None takes all as equal.

    Returns
    -------
    Results
        Mapping from cells, in their order, to their arrays.

    Raises
    ------
    InputError
        If the folder is not for this study (see `open_store`).
    OutputError
        If a cell cannot be written: what is finished remains.
    """
    with open_store(folder, identity, resume) as store:
        return compute(work, cells, store, engine, progress, cost)


def compute(
    work: Work,
    cells: Sequence[Cell],
    store: Store,
    engine: Engine,
    progress: CellProgress | None = None,
    cost: Callable[[Cell], float] | None = None,
    before: int = 0,
    later: tuple[int, float] = (0, 0.0),
) -> Results:
    """Compute what is missing in an open store, as `run_cells` does; for studies of several stages.

    Parameters
    ----------
    before : int
        Cells of the stages before.
    later : (int, float)
        Number of the cells of the stages to come, and what they cost together.
    """
    every = list(dict.fromkeys(cells))
    missing = [cell for cell in every if not store.holds(cell)]
    left = {cell: cost(cell) if cost else 1.0 for cell in missing}
    everything = sum(left.values())
    begin = perf_counter()

    def tell() -> None:
        if progress:
            rest = sum(left.values())
            done = everything - rest
            seconds = (perf_counter() - begin) * (rest + later[1]) / done if done else float("nan")
            if not (left or later[0]):
                seconds = 0.0
            progress(before + len(every) - len(left), before + len(every) + later[0], seconds)

    tell()
    if missing:
        with closing(engine.run(work, missing)) as finished:
            for cell, result in finished:
                store.write(cell, result)
                del left[cell]
                tell()
    return Results(store, every)
