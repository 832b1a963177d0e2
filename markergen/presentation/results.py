"""Common base of the results of the library's functions: display, and export to files."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from markergen.errors import InputError
from markergen.files import Written, check_outputs, make_folder, sorted_by_suffix, write_all
from markergen.options import read_as
from markergen.presentation.pages import check_page
from markergen.presentation.plots import check_figure, figure_bytes
from markergen.presentation.tables import Table, parts_as_html

if TYPE_CHECKING:
    from matplotlib.figure import Figure

StrPath = str | PathLike[str]

_CHECKS = {"plot": check_figure, "report": check_page}
"""Checks of file names by the kind of content; files of results may have any suffix."""


class Result(ABC):
    """Result of a function of the library: sentences and tables, and the same for programs as JSON.

    ``str()`` gives the output of the command of the same name, ``repr()`` a line or two; a notebook shows tables.

    Attributes
    ----------
    written : tuple of Written
        Files that were requested together with the result.
    """

    written: tuple[Written, ...] = ()

    @abstractmethod
    def parts(self) -> Sequence[str | Table]:
        """Return sentences and tables in display order."""

    def brief(self) -> Sequence[str | Table]:
        """Return what a command prints without ``--details``: by default, all parts."""
        return self.parts()

    @abstractmethod
    def to_json(self) -> bytes:
        """Return the results as JSON text."""

    def __str__(self) -> str:
        return "\n".join(part if isinstance(part, str) else part.text().removesuffix("\n") for part in self.parts())

    def _repr_html_(self) -> str:
        return parts_as_html(self.parts())


@dataclass(frozen=True)
class Targets:
    """Files to write, and a folder for pictures.

    Attributes
    ----------
    files : tuple of (str, Path)
        Content of each file (``json``, ``plot``, ``report``), and its path.
    pictures : Path or None
    """

    files: tuple[tuple[str, Path], ...]
    pictures: Path | None = None

    def check(self, inputs: Sequence[Path] = ()) -> None:
        """Reject files that could not be written, before any work is done, and create the folder for pictures.

        Raises
        ------
        OutputError
            If a file cannot be written, is named twice, or is one of the inputs.
        """
        check_outputs([path for _, path in self.files], inputs)
        if self.pictures is not None:
            make_folder(self.pictures)

    def checked(self) -> "Targets":
        """Return self if there are targets and all can be written; otherwise raise InputError or OutputError."""
        if not self.files and self.pictures is None:
            raise InputError("a path to write to", "none", "give one or more")
        self.check()
        return self


class SavableResult(Result):
    """Result that can be written to files, either all of them or none.

    Attributes
    ----------
    KINDS : mapping
        Kind of content by suffix.
    """

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json"}

    @classmethod
    def targets(cls, paths: object = (), pictures: object = None, **named: object) -> Targets:
        """Sort paths by suffix, and add those whose keyword is their kind; see `Targets.check` for further checks.

        Raises
        ------
        InputError
            If one is not a path, or its suffix is unknown.
        """
        files = sorted_by_suffix(read_as("files", paths, "save") or (), cls.KINDS)
        for kind, value in named.items():
            path = read_as("file", value, kind)
            if path is not None and kind in _CHECKS:
                _CHECKS[kind](path)
            files += [(kind, path)] if path is not None else []
        return Targets(tuple(files), read_as("file", pictures, "pictures"))

    def save(self, *paths: StrPath, **named: Any) -> list[Written]:
        """Write files by suffix, and by kind of content, such as ``json="results.txt"`` or ``plot="errors.svg"``.

        Raises
        ------
        InputError
            If no file is named, or a suffix is unknown.
        OutputError
            If a file cannot be written; then nothing is changed.
        """
        return self.write(self.targets(paths, **named).checked())

    def write(self, targets: Targets) -> list[Written]:
        """Write targets that were sorted and checked before."""
        contents = {path: self.content(kind, path) for kind, path in targets.files}
        write_all(contents)
        return [Written(path) for path in contents]

    def saved(self, targets: Targets) -> Self:
        """Write targets that were checked before, and return the result, a dataclass, with what was written."""
        return replace(self, written=tuple(self.write(targets)))  # type: ignore[type-var]

    def content(self, kind: str, path: Path) -> bytes:
        """Return the content of a file of the given kind and name."""
        if kind == "json":
            return self.to_json()
        if kind != "plot" or not hasattr(self, "plot"):
            raise ValueError(f"no result is written as {kind}")
        return figure_bytes(self.figure, path)

    def figure(self) -> "Figure":
        """Return the figure of a file of the kind ``plot``: by default, what ``plot()`` draws."""
        figure: Figure = self.plot().figure  # type: ignore[attr-defined]  # Results without one have no such files.
        return figure


class Files(Result):
    """Files that were written, and nothing else to say."""

    def __init__(self, written: Sequence[Written]) -> None:
        self.written = tuple(written)

    def parts(self) -> list[str]:
        """See `Result.parts`."""
        return []

    def to_json(self) -> bytes:
        """Return the files as `files_as_json` has them."""
        return json_bytes(files_as_json(self.written))


def files_as_json(written: Sequence[Written]) -> list[dict[str, Any]]:
    """Return files with their notes as JSON values.

    >>> files_as_json([Written(Path("marker.pdf"), ("print at 100 %",))])
    [{'path': 'marker.pdf', 'notes': ['print at 100 %']}]
    """
    return [{"path": str(file.path), "notes": list(file.notes)} for file in written]


def json_bytes(value: Any) -> bytes:
    """Return indented JSON text with a final newline; raises ValueError for nan and inf, see `plain`."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def plain(value: Any) -> Any:
    """Convert dictionaries, sequences and numpy scalars to JSON values; nan and inf, which JSON lacks, become None.

    >>> plain({4: (1.5, float("nan"))})
    {'4': [1.5, None]}
    """
    import numpy as np

    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
