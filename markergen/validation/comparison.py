"""The result of a comparison: to print, plot, save and process."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from markergen.files import Written, check_outputs, check_some, sorted_by_suffix, write_all
from markergen.options import read_as
from markergen.tables import Result, Table, data_frame, number
from markergen.validation import compare_report
from markergen.validation.compare import to_json
from markergen.validation.figures import axes_of, check_figure
from markergen.validation.tables import STATISTICS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

StrPath = str | PathLike[str]

KINDS = {".json": "json", ".svg": "plot", ".png": "plot"}
"""What a file holds by its suffix."""
_SHOWN = 8
"""Contestants in one line."""


class Comparison(Result):
    """The result of `markergen.compare`; ``print(comparison)`` shows what the command prints.

    Parameters
    ----------
    results : mapping
        Of `markergen.validation.compare.compare`.
    written : sequence of Written
        Files that were asked for together with the results.

    Examples
    --------
    >>> import markergen as mg
    >>> comparison = mg.compare("ngon:5", "square", views=4, poses="cone:count=20", workers=1)
    >>> list(comparison.contestants)
    ['ngon:5', 'square']
    """

    def __init__(self, results: Mapping[str, Any], written: Sequence[Written] = ()) -> None:
        self._results, self.written = dict(results), tuple(written)

    @property
    def results(self) -> Mapping[str, Any]:
        """Everything as plain JSON values, see `markergen.validation.compare.compare`; read-only."""
        return MappingProxyType(self._results)

    @property
    def contestants(self) -> Mapping[str, Mapping[str, Any]]:
        """Results of each contestant by its name, such as ``contestants["square"]["rotation_deg"]["rms"]``."""
        return MappingProxyType({entry["name"]: entry for entry in self._results["contestants"]})

    def save(self, *paths: StrPath, json: StrPath | None = None, plot: StrPath | None = None) -> list[Written]:
        """Write files by suffix: .json the results, .svg or .png the errors drawn; all of them or none.

        Parameters
        ----------
        json, plot : path or None
            Files for the results, under any suffix, and for the plot.

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
        targets = targets_of(paths, json, plot)
        check_some(targets)
        return self.write(targets)

    def write(self, targets: Sequence[tuple[str, Path]]) -> list[Written]:
        """Write what `targets_of` returned, see `save`."""
        write_all({path: self._content(kind, path) for kind, path in targets})
        return [Written(path) for _, path in targets]

    def to_json(self) -> bytes:
        """Results as JSON text."""
        return to_json(self._results)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with a row for each contestant.

        Its columns are ``name``, ``size``, ``setting``, the share of views in which it was found (``rate``), ``wrong``,
        ``failed``, ``flips``, mean, std, rms, median, p95 and max of ``rotation_deg``, ``translation_pct`` and
        ``point_px`` (as in ``rotation_deg_rms``), and the ``ratio`` of its RMS rotation error to that of the first with
        the 95 % interval ``ratio_low`` to ``ratio_high``.

        Raises
        ------
        MissingLibraryError
            If pandas is not installed.
        """
        return data_frame([_row(entry) for entry in self._results["contestants"]])

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw median, RMS and 95th percentile of each contestant's rotation error, in the views that all found.

        Parameters
        ----------
        ax : matplotlib axes or None
            Where to draw; None makes a figure of its own, which is ``ax.figure``.
        """
        return compare_report.draw_errors(self._results, axes_of(ax))

    def parts(self) -> list[str | Table]:
        """Sentences and tables in the order in which the command prints them."""
        results = self._results
        return [
            compare_report.heading(results), *compare_report.tables(results), *compare_report.sentences(results)
        ]  # fmt: skip

    def __repr__(self) -> str:
        entries = self._results["contestants"]
        said = [f"{str(each['name'])[:80]} {number(each['rotation_deg']['rms'])} deg" for each in entries[:_SHOWN]]
        more = [f"and {len(entries) - _SHOWN} more"] if len(entries) > _SHOWN else []
        return f"<Comparison: {self._results['views']['count']} views; {', '.join([*said, *more])}>"

    def _content(self, kind: str, path: Path) -> bytes:
        return self.to_json() if kind == "json" else compare_report.plot_bytes(self._results, path)


def targets_of(
    paths: object = (), json: object = None, plot: object = None, inputs: Sequence[Path] = ()
) -> list[tuple[str, Path]]:
    """Kinds and paths of the files to write; refuses, before any work is done, those that could not be written.

    Raises
    ------
    InputError
        If one is no path, or its suffix is unknown.
    OutputError
        If a file cannot be written, is asked for twice, or is one of the inputs.
    """
    files = [*sorted_by_suffix(read_as("files", paths, "save") or (), KINDS)]
    for kind, path in (("json", read_as("file", json, "json")), ("plot", read_as("file", plot, "plot"))):
        files += [(kind, path)] if path is not None else []
    for kind, path in files:
        if kind == "plot":
            check_figure(path)
    check_outputs([path for _, path in files], inputs)
    return files


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    row = {key: entry[key] for key in ("name", "size", "setting", "count", "rate", "wrong", "failed", "flips")}
    for key in ("rotation_deg", "translation_pct", "point_px"):
        row |= {f"{key}_{name}": entry[key][name] for name in STATISTICS}
    ratio = entry["ratio"]["rotation_deg"] or {"rms": None, "interval": (None, None)}
    low, high = ratio["interval"]
    return row | {"ratio": ratio["rms"], "ratio_low": low, "ratio_high": high}
