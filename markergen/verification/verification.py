"""The result of a verification: to print, save and iterate over."""

from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, overload

from markergen.files import Written, check_outputs, check_some, sorted_by_suffix, write_all
from markergen.options import read_as
from markergen.tables import Result, Table, data_frame
from markergen.verification.check import Check, to_json
from markergen.verification.words import lines, table

if TYPE_CHECKING:
    from pandas import DataFrame

StrPath = str | PathLike[str]

_SHOWN = 8
"""Files in one line."""


class Verification(Result, Sequence[Check]):
    """The result of `markergen.verify`: a sequence with a `Check` of each file, in their order.

    ``print(verification)`` shows what the command prints. `passed` says whether all files are right; the truth value of
    the sequence does not.

    Parameters
    ----------
    checks : sequence of Check
    written : sequence of Written
        Files that were asked for together with the results.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, radius="50mm", dot="12mm", restarts=2).marker
    >>> written = marker.save("marker.svg", "marker.csv")
    >>> verification = mg.verify(marker, "marker.svg", "marker.csv")
    >>> verification.passed, [check.kind for check in verification]
    (True, ['SVG', 'CSV'])
    """

    def __init__(self, checks: Sequence[Check], written: Sequence[Written] = ()) -> None:
        self._checks, self.written = tuple(checks), tuple(written)

    @property
    def passed(self) -> bool:
        """Every file could be used, and nothing is wrong with any."""
        return all(check.passed for check in self._checks)

    @property
    def usable(self) -> bool:
        """Every file could be read; why one could not is in the `error` of its check."""
        return not any(check.error for check in self._checks)

    def __len__(self) -> int:
        return len(self._checks)

    def __iter__(self) -> Iterator[Check]:
        return iter(self._checks)

    @overload
    def __getitem__(self, index: int) -> Check: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Check, ...]: ...
    def __getitem__(self, index: int | slice) -> Check | tuple[Check, ...]:
        return self._checks[index]

    def save(self, *paths: StrPath, json: StrPath | None = None) -> list[Written]:
        """Write the results as .json, or with `json` under any name; all files or none.

        Returns
        -------
        list of Written

        Raises
        ------
        InputError
            If no file is named, or a suffix is unknown.
        OutputError
            If a file cannot be written; nothing was changed.
        """
        targets = targets_of(paths, json)
        check_some(targets)
        return self.write(targets)

    def write(self, targets: Sequence[Path]) -> list[Written]:
        """Write what `targets_of` returned, see `save`."""
        write_all(dict.fromkeys(targets, self.to_json()))
        return [Written(path) for path in targets]

    def to_json(self) -> bytes:
        """Results as JSON text: one array for all files."""
        return to_json(self._checks).encode() + b"\n"

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with a row for each file.

        Its columns are those of the JSON: ``file``, ``format``, ``passed``, ``error``, ``largest_m``, ``worst_dot``,
        ``tolerance_m``, ``scale_x``, ``scale_y``, ``dots``, ``copies``, ``findings`` and ``notes``, both as text.

        Raises
        ------
        MissingLibraryError
            If pandas is not installed.
        """
        rows = []
        for check in self._checks:
            row = check.as_dict()
            del row["pages_mm"]
            row["findings"] = "; ".join(each.sentence for each in check.findings)
            row["notes"] = "; ".join(check.notes)
            rows.append(row)
        return data_frame(rows)

    def parts(self) -> list[str | Table]:
        """Table and sentences about the files that could be used, and why the others could not."""
        errors = [f"error: {check.error}" for check in self._checks if check.error]
        return [*self.findings(), *errors]

    def findings(self) -> list[str | Table]:
        """Table and sentences about the files that could be used."""
        checks = [check for check in self._checks if not check.error]
        return [table(checks), *(line for check in checks for line in lines(check))] if checks else []

    def __repr__(self) -> str:
        said = [f"{check.path[-80:]} {_verdict(check)}" for check in self._checks[:_SHOWN]]
        more = [f"and {len(self) - _SHOWN} more"] if len(self) > _SHOWN else []
        return f"<Verification: {', '.join([*said, *more])}>"


def targets_of(paths: object = (), json: object = None, inputs: Sequence[Path] = ()) -> list[Path]:
    """Return the files to write; refuses, before any work is done, those that could not be written.

    Raises
    ------
    InputError
        If one is no path, or its suffix is unknown.
    OutputError
        If a file cannot be written, is asked for twice, or is one of the inputs.
    """
    files = [path for _, path in sorted_by_suffix(read_as("files", paths, "save") or (), {".json": "json"})]
    path = read_as("file", json, "json")
    files += [path] if path is not None else []
    check_outputs(files, inputs)
    return files


def _verdict(check: Check) -> str:
    return "unusable" if check.error else "ok" if check.passed else "WRONG"
