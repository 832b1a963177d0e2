"""The whole study: cells, then tables, figures, claims, and a page."""

from collections.abc import Iterator
from math import isnan
from pathlib import Path

from markergen.files import write_atomic
from markergen.pool import processor_count
from markergen.studies.engines import Engine
from markergen.studies.paper.cells import cells_of, seconds_of, work
from markergen.studies.paper.claims import CLAIMS
from markergen.studies.paper.figures import figures_of
from markergen.studies.paper.gather import Study, gather
from markergen.studies.paper.options import PaperOptions
from markergen.studies.paper.page import claim_rows, claims_page, index_page
from markergen.studies.paper.tables import csv_bytes, tables_of
from markergen.studies.run import CellProgress, run_cells
from markergen.studies.svg import svg_bytes


def run_paper(
    folder: Path,
    options: PaperOptions,
    engine: Engine,
    resume: bool = False,
    progress: CellProgress | None = None,
) -> list[Path]:
    """Compute the study in a folder, and write its tables (CSV), figures (SVG), claims, and a page to look at.

    The files depend on the options alone: not on the engine, its workers, or what was interrupted.

    Parameters
    ----------
    folder : Path
        New, empty, or with `resume` that of the same study.
    progress : callable or None
        Called first with an estimate of the time that all of it takes.

    Returns
    -------
    list of Path
        What was written, the page first.

    Raises
    ------
    InputError
        If the folder is not for this study.
    OutputError
        If a file cannot be written: what is finished remains.
    """
    cells = cells_of(options)
    told = _with_estimate(progress, estimated_seconds(options, engine.options.workers)) if progress else None
    results = run_cells(work, cells, folder, {"study": "paper", **options.as_dict()}, engine, resume, told, seconds_of)
    written = []
    for name, data in _files(gather(options, results)):
        write_atomic(folder / name, data)
        written.append(folder / name)
    return written[::-1]


def estimated_seconds(options: PaperOptions, workers: int | None = None) -> float:
    """About how long the study takes on a usual processor of this day, s; linear in poses x starts x n x runs.

    Parameters
    ----------
    workers : int or None
        Processes; None is one for each processor.
    """
    return sum(map(seconds_of, cells_of(options))) / (workers or processor_count())


def _with_estimate(progress: CellProgress, seconds: float) -> CellProgress:
    """Progress that gives an estimate of the time left until one was measured."""

    def tell(done: int, total: int, left: float) -> None:
        progress(done, total, seconds if isnan(left) else left)

    return tell


def _files(study: Study) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the files, the page last."""
    tables = tables_of(study)
    for name, rows in tables.items():
        yield f"{name}.csv", csv_bytes(rows)
    figures = figures_of(study)
    for name, (draw, size, _) in figures.items():
        yield f"{name}.svg", svg_bytes(draw, size)
    findings = [(claim, list(claim.find(study))) for claim in CLAIMS]
    yield "claims.csv", csv_bytes(claim_rows(findings))
    yield "claims.md", claims_page(findings, study).encode()
    yield "index.html", index_page(findings, figures, tables, study)
