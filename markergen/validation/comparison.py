"""The result of a comparison: to print, plot, save and process."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from markergen.files import Written
from markergen.presentation.plots import axes_of
from markergen.presentation.results import SavableResult, StrPath, json_bytes
from markergen.presentation.tables import Table, data_frame, number
from markergen.validation import compare_report
from markergen.validation.tables import STATISTICS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

_SHOWN = 8
"""Contestants in one line."""


class Comparison(SavableResult):
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

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json", ".svg": "plot", ".png": "plot"}

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
        """Write files by suffix: .json the results, .svg or .png the errors drawn; see `SavableResult`.

        Parameters
        ----------
        json, plot : path or None
            Files for the results, under any suffix, and for the plot.
        """
        return self.write(self.targets(paths, json=json, plot=plot).checked())

    def to_json(self) -> bytes:
        """Results as JSON text."""
        return json_bytes(self._results)

    def content(self, kind: str, path: Path) -> bytes:
        """See `SavableResult.content`."""
        return self.to_json() if kind == "json" else compare_report.plot_bytes(self._results, path)

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


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    row = {key: entry[key] for key in ("name", "size", "setting", "count", "rate", "wrong", "failed", "flips")}
    for key in ("rotation_deg", "translation_pct", "point_px"):
        row |= {f"{key}_{name}": entry[key][name] for name in STATISTICS}
    ratio = entry["ratio"]["rotation_deg"] or {"rms": None, "interval": (None, None)}
    low, high = ratio["interval"]
    return row | {"ratio": ratio["rms"], "ratio_low": low, "ratio_high": high}
