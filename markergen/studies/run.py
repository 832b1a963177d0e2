"""Running a study: finished cells are stored in its folder, one file each; missing ones are computed."""

# tests: tests/studies/test_run.py tests/studies/test_run_store.py

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from markergen.errors import InputError, MarkergenError, OutputError
from markergen.files import make_folder, write_atomic
from markergen.pool import TimeForecast
from markergen.studies.cells import Cell, Result, Work, canonical_text, versions
from markergen.studies.engines import Engine

IDENTITY, CELLS = "study.json", "cells"
"""File that identifies the study, and folder of the cells' files."""

DIGEST = 64
"""Number of hexadecimal digits of SHA-256 at the end of a cell's file, in the comment of the ZIP archive."""

LARGEST_IDENTITY = 10_000_000
"""Maximum size of the identity file, bytes."""

SECONDS = "seconds"
"""Name under which a worker adds the time that a cell took to its arrays, until they are stored."""

CellProgress = Callable[[int, int, float], None]
"""Takes the number of finished cells, the number of all cells, and the seconds left, nan while unknown."""


class Store:
    """Finished cells of one study; made by `open_store`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, cell: Cell) -> Path:
        """File of a cell."""
        return self.folder / CELLS / f"{cell.name}.npz"

    def holds(self, cell: Cell) -> bool:
        """True if a cell is finished and its file is intact."""
        try:
            return _is_whole(self.path(cell).read_bytes(), cell)
        except OSError:
            return False

    def read(self, cell: Cell) -> Result:
        """Arrays of a finished cell.

        Raises
        ------
        MarkergenError
            If there is no such file, or it is damaged.
        """
        path = self.path(cell)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise MarkergenError(f"expected a finished cell in {path}, found: {error.strerror}; use --resume") from None
        if not _is_whole(data, cell):
            raise MarkergenError(
                f"expected {path} as it was written, found it changed; use --resume to compute it again"
            )
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.endswith(".npy")]
            return {
                name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(archive.read(name))) for name in names
            }

    def write(self, cell: Cell, result: Result) -> None:
        """Store the arrays of a finished cell, either the complete file or nothing.

        Raises
        ------
        OutputError
            If it cannot be written, such as on a full disk.
        """
        path = self.path(cell)
        try:
            write_atomic(path, cell_bytes(cell, result))
        except OutputError as error:
            reason = getattr(error.__cause__, "strerror", None) or str(error)
            raise OutputError(
                f"expected to write {path}, found: {reason}; finished cells remain: make room, and use --resume"
            ) from error


class Results(Mapping[Cell, Result]):
    """Arrays of finished cells in the order of a study, read on demand."""

    def __init__(self, store: Store, cells: Sequence[Cell]) -> None:
        self._store, self._cells = store, dict.fromkeys(cells)

    def __getitem__(self, cell: Cell) -> Result:
        if cell not in self._cells:
            raise KeyError(cell)
        return self._store.read(cell)

    def __iter__(self) -> Iterator[Cell]:
        return iter(self._cells)

    def __len__(self) -> int:
        return len(self._cells)


@contextmanager
def open_store(folder: Path, identity: Mapping[str, Any], resume: bool) -> Iterator[Store]:
    """Create or open the folder of a study, with exclusive access.

    Parameters
    ----------
    identity : mapping
        Plain JSON values that identify the study. The versions of the software are added.
    resume : bool
        True if the folder may contain finished cells of this same study.

    Raises
    ------
    InputError
        If the folder contains anything else, another study, or this one without `resume`; nothing in it is changed.
    OutputError
        If the folder cannot be created or written to.
    """
    text = canonical_text({**identity, **versions()})
    _check_identity(folder, text, resume)
    make_folder(folder / CELLS)
    with _alone(folder):
        # Another run may have started, and even finished, in the meantime.
        _check_identity(folder, text, resume)
        for leftover in (folder / CELLS).glob(".*"):
            # Left by a process that was killed while writing.
            leftover.unlink(missing_ok=True)
        path = folder / IDENTITY
        if not path.exists():
            write_atomic(path, text.encode() + b"\n")
        yield Store(folder)


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
    """Compute all unfinished cells, and store each in a file of the folder as soon as it is finished.

    However the run ends, finished cells are kept and never computed again. The results depend neither on the engine nor
    on the order in which cells finish.

    Parameters
    ----------
    work : callable
        Computes the arrays of a cell; a module-level function.
    folder : Path
        Folder of the study; new, empty, or with `resume` that of the same study.
    identity : mapping
        Plain JSON values that identify the study.
    progress : callable or None
    cost : callable or None
        Cost of a cell, about its seconds on one core, to estimate the time left; equal for all if None.

    Returns
    -------
    Results
        Mapping from cells, in their order, to their arrays.

    Raises
    ------
    InputError
        If the folder is not for this study (see `open_store`).
    OutputError
        If a cell cannot be written; finished cells are kept.
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
    """Compute the missing cells of an open store, as `run_cells` does; for studies of several stages.

    Parameters
    ----------
    before : int
        Number of cells of previous stages.
    later : (int, float)
        Number of cells of later stages, and their total cost.
    """
    every = list(dict.fromkeys(cells))
    missing = [cell for cell in every if not store.holds(cell)]
    forecast = TimeForecast({cell: cost(cell) if cost else 1.0 for cell in missing}, _kind, later[1])

    def tell() -> None:
        if progress:
            left = len(forecast.left)
            seconds = forecast.seconds() if left or later[0] else 0.0
            progress(before + len(every) - left, before + len(every) + later[0], seconds)

    tell()
    if missing:
        with closing(engine.run(partial(_timed, work), _of_all_kinds(missing))) as finished:
            for cell, result in finished:
                forecast.finished(cell, float(result.pop(SECONDS)))
                store.write(cell, result)
                tell()
    return Results(store, every)


def _timed(work: Work, cell: Cell) -> Result:
    begin = perf_counter()
    result = work(cell)
    return {**result, SECONDS: np.array(perf_counter() - begin)}


def _kind(cell: Cell) -> str:
    """Cells whose costs are wrong by about the same factor: of one kind, with the same words in their settings."""
    return canonical_text([cell.kind, *(value for value in cell.settings.values() if isinstance(value, str))])


def _of_all_kinds(cells: Sequence[Cell]) -> list[Cell]:
    """Cells in an order in which every kind comes first once, so that the time of each is soon measured."""
    first = {_kind(cell): cell for cell in reversed(cells)}
    ahead = set(first.values())
    return [cell for cell in cells if cell in ahead] + [cell for cell in cells if cell not in ahead]


def cell_bytes(cell: Cell, result: Result) -> bytes:
    """File of a cell: an .npz archive with the cell's key and its arrays, the same bytes for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        _add(archive, "cell.json", cell.key.encode())
        for name, array in result.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
            _add(archive, f"{name}.npy", member.getvalue())
        archive.comment = b"0" * DIGEST
    data = buffer.getvalue()[:-DIGEST]
    return data + hashlib.sha256(data).hexdigest().encode()


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    # The default date of a member is the ZIP epoch, which gives the same bytes every time.
    info = zipfile.ZipInfo(name)
    info.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(info, data)


def _is_whole(data: bytes, cell: Cell) -> bool:
    body, digest = data[:-DIGEST], data[-DIGEST:]
    if hashlib.sha256(body).hexdigest().encode() != digest:
        return False
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.read("cell.json") == cell.key.encode()


def _check_identity(folder: Path, text: str, resume: bool) -> None:
    try:
        entries = {path.name for path in folder.iterdir()}
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(f"expected a folder at {folder}, found: {error.strerror}; choose another path") from None
    # A run stopped at its start leaves only an empty folder for its cells.
    if IDENTITY not in entries:
        if entries <= {CELLS} and not any((folder / CELLS).glob("*.npz")):
            return
        raise InputError(
            "a new or empty folder, or one of this study", f"other files in {folder}", "choose another with -o"
        )
    try:
        with (folder / IDENTITY).open("rb") as file:
            there = json.loads(file.read(LARGEST_IDENTITY))
    except (OSError, ValueError, RecursionError):
        there = None
    here = json.loads(text)
    if not isinstance(there, dict):
        raise InputError(f"a readable {IDENTITY}", f"{folder / IDENTITY} damaged", "choose another folder with -o")
    if there != here:
        raise InputError(
            "a new or empty folder, or one of this study", _difference(folder, there, here), "choose another with -o"
        )
    if not resume:
        raise InputError("a new or empty folder", f"this study, started in {folder}", "continue it with --resume")


def _difference(folder: Path, there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    keys = [key for key in {**here, **there} if there.get(key) != here.get(key)]
    differences = [f"{key} {_short(there.get(key))} there, {_short(here.get(key))} here" for key in keys[:3]]
    return f"another study in {folder}: " + "; ".join(differences) + (" and more" if len(keys) > 3 else "")


def _short(value: Any) -> str:
    text = "none" if value is None else canonical_text(value)
    return text if len(text) <= 40 else text[:37] + "..."


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which the system releases however the process ends."""
    try:
        import fcntl
    except ImportError:  # Windows: no lock, but two runs of one study write the same files, each atomically.
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                "one run of a study at a time", f"another in {folder}", "wait for it, or choose another folder"
            ) from None
        except OSError:
            # Some network file systems have no locks.
            pass
        yield
    finally:
        with suppress(OSError):
            os.close(handle)
