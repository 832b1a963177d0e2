"""``markergen.study``: the paper reproduced, or any grid of designs as one tidy table."""

import csv
import logging
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from markergen.api.arguments import as_path, files_among
from markergen.errors import InputError, among
from markergen.files import Written, check_outputs, write_all
from markergen.options import check_progress, given, read_as, takes
from markergen.options.compare import StudyKeywords
from markergen.options.kinds import File
from markergen.pool import OneBlasThread
from markergen.presentation.results import Result, files_as_json, json_bytes, plain
from markergen.presentation.tables import data_frame
from markergen.studies.engines import engine_for
from markergen.studies.named import STUDIES
from markergen.studies.run import CellProgress
from markergen.studies.sweep.grid import read_sweep, sweep_from_mapping
from markergen.studies.sweep.run import run_sweep
from markergen.units import duration

if TYPE_CHECKING:
    from pandas import DataFrame

_log = logging.getLogger(__name__)


class Study(Result):
    """A finished study: a folder of tables, figures and a page.

    Attributes
    ----------
    folder : Path
    files : tuple of Path
        Files written, besides the results as JSON.

    Examples
    --------
    >>> import markergen as mg
    >>> sweep = {"dot": "20mm", "poses": "cone:count=20", "grid": {"n": [4, 5], "layout": ["ngon"]}}
    >>> study = mg.study(sweep, "sweep", workers=1, runs=0)
    >>> study
    Study('sweep', 4 files)
    """

    def __init__(self, folder: Path, files: tuple[Path, ...]) -> None:
        self.folder, self.files = folder, files
        self.written = tuple(map(Written, files))

    def __iter__(self) -> Iterator[Path]:
        return iter(self.files)

    def __repr__(self) -> str:
        return f"Study({str(self.folder)!r}, {len(self.files)} files)"

    def parts(self) -> list[str]:
        """See `Result.parts`."""
        return list(map(str, self.written))

    def to_json(self) -> bytes:
        """Return the rows of the default table, see `to_frame`, and the files as JSON text."""
        return json_bytes(plain({"rows": self._rows(""), "files": files_as_json(self.written)}))

    def to_frame(self, table: str = "") -> "DataFrame":
        """Return a table of the study as a DataFrame; by default a sweep's only table, or the paper's claims.

        Raises
        ------
        InputError
            If there is no table of that name; the message lists them.
        MissingLibraryError
            If pandas is not installed.
        """
        return data_frame(self._rows(table))

    def _rows(self, table: str) -> list[dict[str, str | float]]:
        tables = {path.stem: path for path in sorted(self.files) if path.suffix == ".csv"}
        name = table or next((stem for stem in ("table", "claims") if stem in tables), "")
        if name not in tables:
            raise InputError("a table of the study", repr(name), among(name, tables))
        with tables[name].open(newline="") as file:
            return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


@takes(StudyKeywords)
@OneBlasThread()
def study(
    what: str | PathLike[str] | Mapping[str, Any],
    output: str | PathLike[str],
    *,
    progress: CellProgress | None = None,
    announce: Callable[[str], None] | None = None,
    json: File | None = None,
    **options: Unpack[StudyKeywords],
) -> Study:
    """Reproduce the paper, or run any grid of designs, and write a folder of tables, figures and a page.

    The results do not depend on the number of workers or on where they run.

    Parameters
    ----------
    what : str, path or dict
        ``paper``: the claims of the paper, measured. Otherwise a sweep: the name of one that is shipped, a TOML file
        with tables ``study`` and ``grid``, or the same as a dictionary.
    output : str or path
        Folder for tables, figures and finished cells.
    progress : callable, optional
        Called with the number of finished cells, their total, and the seconds left.
    announce : callable, optional
        Called once with a sentence about the expected duration, if known in advance.
    json : path, optional
        File for the rows of the default table, see `Study.to_frame`.
    **options
        As on the command line, ``markergen study --help``.

    Raises
    ------
    InputError
        If there is no such study, it specifies something impossible, or the folder belongs to another study.
    OutputError
        If a file cannot be written; finished cells are kept, and ``resume=True`` continues.

    Examples
    --------
    >>> import markergen as mg, tempfile
    >>> sweep = {"dot": "20mm", "restarts": 2, "poses": "cone:count=20", "grid": {"n": [4, 5], "layout": ["ngon"]}}
    >>> found = mg.study(sweep, tempfile.mkdtemp(), workers=1, runs=0)
    >>> [path.name for path in found if path.suffix != ".svg"]
    ['table.csv', 'index.html']
    """
    check_progress(progress)
    asked = given(options, StudyKeywords)
    folder = as_path(output, "a folder to write to")
    results = list(read_as("files", json, "json") or ())
    check_outputs(results, [] if isinstance(what, Mapping) else files_among(what))
    engine = engine_for(asked.get("workers"), asked.get("scheduler"))
    run: Callable[..., list[Path]]
    if isinstance(what, str) and what in STUDIES:
        named = STUDIES[what]
        choices = named.options(**{name: asked[name] for name in named.keywords if name in asked})
        run = partial(named.run, folder, choices)
        engine.check()
        if announce and "scheduler" not in asked:
            announce(f"the whole study: about {duration(named.seconds(choices, asked.get('workers')))}")
    elif "scale" in asked:
        raise InputError("--scale with the study paper", f"--scale with {what}", "leave it out, or give --runs")
    else:
        dictionary = isinstance(what, Mapping)
        runs = asked.get("runs")
        sweep = sweep_from_mapping(what, runs=runs) if dictionary else read_sweep(str(as_path(what, "a study")), runs)  # type: ignore[arg-type]
        run = partial(run_sweep, sweep, folder)
        engine.check()
    _log.info("studying, in %s", folder)
    files = tuple(run(engine=engine, resume=asked.get("resume", False), progress=progress))
    _log.info("studied: %d files in %s", len(files), folder)
    finished = Study(folder, files)
    write_all({path: finished.to_json() for path in results})
    finished.written += tuple(map(Written, results))
    return finished


def _value(text: str) -> str | float:
    try:
        return float(text or "nan")
    except ValueError:
        return text
