"""A sweep from its spec to its folder."""

from pathlib import Path

from markergen.files import write_all
from markergen.studies.cells import Cell
from markergen.studies.engines import Engine
from markergen.studies.run import CellProgress, compute
from markergen.studies.store import Store, open_store
from markergen.studies.sweep.grid import GridPoint, Sweep
from markergen.studies.sweep.page import page
from markergen.studies.sweep.plots import plots
from markergen.studies.sweep.table import Row, csv_bytes, rows
from markergen.studies.sweep.work import ERROR, layout_cell, trials_cell, work

DESIGN_SECONDS, LAYOUT_SECONDS, TRIAL_SECONDS = 2.0, 0.4, 5e-5
"""Roughly, on one core: a design, another layout, and a trial of one estimator at one pose; for the time left alone."""

TYPICAL_POSES = 400


def run_sweep(
    sweep: Sweep, folder: Path, engine: Engine, resume: bool = False, progress: CellProgress | None = None
) -> list[Path]:
    """Compute a sweep and write its table, plots and page; returns their paths, the page last.

    Raises
    ------
    InputError
        If the folder is not for this sweep (see `open_store`).
    OutputError
        If something cannot be written; what is finished remains.
    """
    with open_store(folder, sweep.identity, resume) as store:
        table = _table(sweep, store, engine, progress)
        files = {folder / "table.csv": csv_bytes(sweep, table)}
        drawn = plots(sweep, table)
        files |= {folder / f"{plot.name}.svg": plot.svg for plot in drawn}
        files[folder / "index.html"] = page(sweep, table, drawn)
        write_all(files)
    return list(files)


def _table(sweep: Sweep, store: Store, engine: Engine, progress: CellProgress | None) -> list[Row]:
    """Rows in the order of the grid."""
    first = [layout_cell(point) for point in sweep.points]
    # What a layout is tried with is known before the layout is.
    tried = {
        (cell, point.noise_px): _trials_cost(point, sweep.runs) for cell, point in zip(first, sweep.points, strict=True)
    }
    layouts = compute(
        work, first, store, engine, progress, _layout_cost, later=(len(tried), sum(tried.values()))
    )  # fmt: skip
    second: list[Cell | None] = []
    for point, cell in zip(sweep.points, first, strict=True):
        layout = layouts[cell]
        second.append(None if ERROR in layout else trials_cell(point, layout["points"], sweep.runs))
    cells = [cell for cell in second if cell is not None]
    trials = compute(work, cells, store, engine, progress, before=len(layouts))
    return [
        row
        for point, layout, cell in zip(sweep.points, first, second, strict=True)
        for row in rows(sweep, point, layouts[layout], trials[cell] if cell else None)
    ]


def _layout_cost(cell: Cell) -> float:
    return DESIGN_SECONDS if cell.settings["layout"] == "designed" else LAYOUT_SECONDS


def _trials_cost(point: GridPoint, runs: int) -> float:
    return TRIAL_SECONDS * TYPICAL_POSES * runs * len(point.estimators)
