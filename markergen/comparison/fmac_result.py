"""The result of a protocol over six degrees of freedom: tables of bias and spread, and 36 plots of each contestant."""
# tests: tests/comparison/test_fmac_result.py

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.comparison.result import Comparison
from markergen.presentation.plots import axes_of, figure_bytes, new_figure
from markergen.presentation.tables import Table, data_frame, number, percent
from markergen.validation.degrees import ERRORS, DegreeErrors, correlation_words, draw_degrees

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

BLOCK = 6.4
"""Width in inches of the 36 plots of one contestant."""
NAMED = 6
"""Maximum number of correlations named for a contestant."""


class ProtocolComparison(Comparison):
    """The result of `markergen.compare` with a protocol; see `markergen.comparison.fmac.fmac` for its values."""

    def content(self, kind: str, path: Path) -> bytes:
        """See `SavableResult.content`."""
        return self.to_json() if kind == "json" else figure_bytes(partial(degrees_figure, self._results), path)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with a row for each contestant and error: its bias and spread."""
        return data_frame(
            [
                {"name": entry["name"], "rate": entry["rate"], "flips": entry["flips"], "error": name, **values}
                for entry in _present(self._results)
                for name, values in entry["unflipped"]["errors"].items()
            ]
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the spread of each contestant's errors, without flips.

        Parameters
        ----------
        ax : matplotlib axes or None
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        axes, entries = axes_of(ax), _present(self._results)
        for entry in entries:
            spreads = [entry["unflipped"]["errors"][name]["std"] for name in ERRORS]
            axes.plot(range(len(ERRORS)), [spread or np.nan for spread in spreads], "o-", label=_short(entry))
        axes.set_yscale("log")
        axes.set_xticks(range(len(ERRORS)), ERRORS, fontsize=7)
        axes.legend()
        return axes

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results = self._results
        tables = [
            _overview(results),
            _errors(results, "Standard deviations without flips", lambda row: number(row["std"])),
            _errors(
                results,
                "Biases without flips",
                lambda row: f"{number(row['bias'], 2)} ± {number(row['bias_sigma'], 1)}",
                "Mean error and its standard deviation.",
            ),
            _errors(results, "Standard deviations of all poses", lambda row: number(row["std"]), which=""),
            _cells(results),
        ]
        return [heading(results), *tables, *sentences(results)]

    def __repr__(self) -> str:
        names = ", ".join(entry["name"][:80] for entry in self._results["contestants"])
        return f"<Comparison by {self._results['protocol']}: {self._results['views']['count']} views; {names}>"


def _present(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [entry for entry in results["contestants"] if not entry["absent"]]


def _short(entry: Mapping[str, Any]) -> str:
    name: str = entry["name"]
    return Path(name).name if name.endswith(".json") else name


def heading(results: Mapping[str, Any]) -> str:
    """Describe views, poses, camera and optics."""
    camera, optics, poses = results["camera"], results["optics"], results["poses"]
    return (
        f"FMAC: the first {results['views']['count']} of {poses['count']} poses ({poses['name']})\n"
        f"camera {camera['width']}x{camera['height']} with distortion, focal length {camera['fx']:g} px; "
        f"a lens of {optics['aperture_mm']:g} mm focused at {optics['focus']:g} m, diffraction at "
        f"{optics['wavelength_nm']:g} nm; noise {optics['noise_grey']:g} grey levels; "
        f"print error {results['print_sigma_mm']:g} mm"
    )


def _overview(results: Mapping[str, Any]) -> Table:
    rows = [
        [_short(entry), percent(entry["rate"]), str(entry["wrong"]), str(entry["failed"]), str(entry["flips"]),
         str(entry["mirrored"])]
        if not entry["absent"]
        else [_short(entry), "absent", *"----"]
        for entry in results["contestants"]
    ]  # fmt: skip
    caption = (
        "Mirrored: poses nearer to the mirrored one than to the true one. Flips: those of them where the errors of the "
        "points distinguish the two."
    )
    return Table("Found", ["", "found", "wrong", "failed", "flips", "mirrored"], rows, caption)


def _errors(
    results: Mapping[str, Any],
    title: str,
    cell: Callable[[Mapping[str, Any]], str],
    caption: str = "",
    which: str = "unflipped",
) -> Table:
    rows = [
        [_short(entry), *(cell(row) for row in (entry[which] if which else entry)["errors"].values())]
        for entry in _present(results)
    ]
    return Table(title, ["", *ERRORS], rows, caption)


def _cells(results: Mapping[str, Any]) -> Table:
    rows = []
    for entry in _present(results):
        cells = entry["unflipped"]["cells"]
        if cells:
            values = [number(cells[key], 2) for key in ("least", "median", "greatest")]
            rows.append([_short(entry), *values, *(f"{cells[key]} of {cells['count']}" for key in ("above", "below"))])
    caption = (
        "Root mean square of error over claimed standard deviation, in eight parts of each degree of freedom, for each "
        "error. Above and below: outside the 99 % interval of a right covariance, about 1.4 of 288 on each side."
    )
    return Table(
        "Covariances held against errors", ["", "least", "median", "greatest", "above", "below"], rows, caption
    )


def sentences(results: Mapping[str, Any]) -> list[str]:
    """State each contestant's size and setting, and the correlations of errors and poses that stand out."""
    lines = []
    for entry in _present(results):
        named = entry["unflipped"]["standing_out"][:NAMED]
        stands = f"errors go with the pose: {correlation_words(named)}" if named else "no error goes with the pose"
        lines.append(f"{_short(entry)}: {entry['size']}; {entry['setting']}; {stands}.")
    return lines


def degrees_figure(results: Mapping[str, Any]) -> "Figure":
    """Draw the 36 plots of each contestant, two contestants in a row."""
    entries = [entry for entry in _present(results) if entry["found"]]
    columns = min(2, len(entries)) or 1
    rows: int = max(1, -(-len(entries) // columns))
    figure = new_figure((columns * BLOCK, rows * BLOCK))
    blocks = figure.subfigures(rows, columns, squeeze=False).ravel()
    for block, entry in zip(blocks, entries, strict=False):
        samples = (
            np.array(entry["samples"][name], dtype=float).reshape(-1, 6) for name in ("degrees", "errors", "sigma")
        )
        block.suptitle(_short(entry), fontsize=9)
        draw_degrees(block, DegreeErrors(*samples), entry["bins"])
    return figure
