"""The result of a comparison, with its tables and plot: to print, draw, save and process."""
# tests: tests/comparison/test_compare.py

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from markergen.comparison.tuning import NEARLY_ALL
from markergen.files import Written
from markergen.presentation.plots import axes_of, log_axis, new_figure
from markergen.presentation.results import SavableResult, json_bytes
from markergen.presentation.tables import Table, data_frame, number, percent
from markergen.validation.error_to_plan_with import middle
from markergen.validation.metrics import STATISTICS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

_COLORS = ("#0b5394", "#b45f06", "#38761d", "#741b47", "#674ea7", "#134f5c", "#7f6000", "#444444")
_LINES = ("-", "--", "-.", ":")
_MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
_STEPS = (1, 2, 5)
"""Mantissas of the tick labels on logarithmic axes."""
ERRORS = "RE and TE: rotation error, deg, and translation error, % of the distance."
_SHOWN = 8
"""Maximum number of contestants in a repr."""


class Comparison(SavableResult):
    """The result of `markergen.comparison`; ``print(comparison)`` shows what the command prints.

    Parameters
    ----------
    results : mapping
        Return value of `markergen.comparison.compare.compare_and_time`.
    written : sequence of Written
        Files that were written together with the results.
    cpu_s : mapping
        Processor time of one view in s by name, which is printed but not saved: it differs from run to run.

    Examples
    --------
    >>> import markergen as mg
    >>> comparison = mg.compare("ngon:5", "square", views=4, poses="cone:count=20", workers=1)
    >>> list(comparison.contestants)
    ['ngon:5', 'square']
    """

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json", ".svg": "plot", ".png": "plot"}

    def __init__(
        self, results: Mapping[str, Any], written: Sequence[Written] = (), cpu_s: Mapping[str, float] | None = None
    ) -> None:
        self._results, self.written, self.cpu_s = dict(results), tuple(written), dict(cpu_s or {})

    @property
    def results(self) -> Mapping[str, Any]:
        """All results as plain JSON values, see `markergen.comparison.compare.compare_and_time`; read-only."""
        return MappingProxyType(self._results)

    @property
    def contestants(self) -> Mapping[str, Mapping[str, Any]]:
        """Results of each contestant by name, such as ``contestants["square"]["rotation_deg"]["rms"]``."""
        return MappingProxyType({entry["name"]: entry for entry in self._results["contestants"]})

    def to_json(self) -> bytes:
        """Return the results as JSON text."""
        return json_bytes(self._results)

    def figure(self) -> "Figure":
        """See `SavableResult.figure`."""
        return comparison_figure(self._results)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with one row per contestant.

        Its columns are ``name``, ``size``, ``setting``, the share of views in which it was found (``rate``), ``wrong``,
        ``failed``, ``flips``, mean, std, rms, median, p95 and max of ``rotation_deg``, ``translation_pct`` and
        ``point_px`` (as in ``rotation_deg_rms``), the 95 % interval ``rotation_deg_low`` to ``rotation_deg_high`` of
        the RMS, the photometric bound of the pattern ``bound_deg``, ``ink_cm2``, and the ``ratio`` of its RMS rotation
        error to that of the first with the 95 % interval ``ratio_low`` to ``ratio_high``.

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
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        return draw_errors(self._results, axes_of(ax))

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results = self._results
        return [
            heading(results),
            _overview(results),
            _patterns(results, self.cpu_s),
            _common(results),
            _photometric(results),
            _settings(results),
            _split(results, "by_polar_angle", "deg", "tilt"),
            _split(results, "by_distance", "m", "distance"),
            *sentences(results),
        ]

    def __repr__(self) -> str:
        entries = self._results["contestants"]
        errors = [f"{str(entry['name'])[:80]} {number(entry['rotation_deg']['rms'])} deg" for entry in entries[:_SHOWN]]
        more = [f"and {len(entries) - _SHOWN} more"] if len(entries) > _SHOWN else []
        return f"<Comparison: {self._results['views']['count']} views; {', '.join([*errors, *more])}>"


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    row = {key: entry[key] for key in ("name", "size", "setting", "count", "rate", "wrong", "failed", "flips")}
    for key in ("rotation_deg", "translation_pct", "point_px"):
        row |= {f"{key}_{name}": entry[key][name] for name in STATISTICS}
    ratio = entry["ratio"]["rotation_deg"] or {"rms": None, "interval": None}
    row["rotation_deg_low"], row["rotation_deg_high"] = entry["interval"]["rotation_deg"] or (None, None)
    row |= {"bound_deg": entry["pattern_bound"]["rotation_deg"], "ink_cm2": entry["ink"]["cm2"]}
    low, high = ratio["interval"] or (None, None)
    return row | {"ratio": ratio["rms"], "ratio_low": low, "ratio_high": high}


def heading(results: Mapping[str, Any]) -> str:
    """Describe the views, poses, camera and optics."""
    camera, poses, optics = results["camera"], results["poses"], results["optics"]
    return (
        f"{results['views']['count']} views of each from {poses['count']} poses ({poses['name']}), "
        f"in {'rooms of their own' if _rooms_differ(results) else 'a ' + results['room']}\n"
        f"camera {camera['width']}x{camera['height']}, focal length {camera['fx']:g} px, "
        f"blur {optics['blur_px']:g} px, noise {optics['noise_grey']:g} grey levels, "
        f"levels {optics['dark']:g} to {optics['light']:g}"
    )


def sentences(results: Mapping[str, Any]) -> list[str]:
    """State each contestant's size and detector setting, and the assumed print error."""
    lines = [f"{entry['name']}: {entry['size']}; {entry['setting']}" for entry in with_short_names(results)]
    if results["print_sigma_mm"]:
        lines.append(
            f"Print error {results['print_sigma_mm']:g} mm per axis, of every dot and of every corner of a square."
        )
    else:
        lines.append("Without print error: it hits all alike, and hides what the image would allow.")
    return lines


def _overview(results: Mapping[str, Any]) -> Table:
    rows: list[list[str]] = []
    rooms_differ = _rooms_differ(results)
    for entry in with_short_names(results):
        ratio = entry["ratio"]["rotation_deg"]
        within = f" ({_interval(ratio['interval'])})" if ratio and ratio["interval"] and rows else ""
        rows.append(
            [
                entry["name"],
                *([entry["room"]] if rooms_differ else []),
                "absent" if entry["absent"] else percent(entry["rate"]),
                number(entry["rotation_deg"]["rms"]),
                _interval(entry["interval"]["rotation_deg"]),
                *(number(entry["rotation_deg"][key]) for key in ("median", "p95")),
                (number(ratio["rms"], 2) if ratio else "-") + within,
            ]
        )
    header = ["", *(["in a"] if rooms_differ else []), "found", "RE rms", "95 %", "median", "p95", "ratio (95 %)"]
    caption = (
        "Over the views that each found; RE: rotation error, deg. "
        f"Ratio: RMS of RE over that of {rows[0][0]}, in the views that both found."
        + (" Rooms differ: a marker in a larger one has smaller errors by its size alone." if rooms_differ else "")
    )
    return Table("Found, and how accurately", header, rows, caption)


def _rooms_differ(results: Mapping[str, Any]) -> bool:
    return len({entry["room"] for entry in results["contestants"]}) > 1


def _patterns(results: Mapping[str, Any], cpu_s: Mapping[str, float]) -> Table:
    rows = []
    for entry, contestant in zip(with_short_names(results), results["contestants"], strict=True):
        error, bound = entry["rotation_deg"]["rms"], entry["bound"]["rotation_deg"]
        seconds = cpu_s.get(contestant["name"])
        rows.append(
            [
                entry["name"],
                "-" if entry["absent"] else f"{entry['ink']['cm2']:.0f} cm2",
                number(entry["pattern_bound"]["rotation_deg"]),
                number(error / bound, 2) if error and bound else "-",
                number(entry["translation_pct"]["rms"]),
                number(entry["point_px"]["rms"]),
                str(entry["wrong"]),
                *([] if not cpu_s else ["-" if seconds is None else f"{1e3 * seconds:.0f} ms"]),
            ]
        )
    header = ["", "ink", "RE bound", "RE/bound", "TE rms", "px rms", "wrong", *(["CPU"] if cpu_s else [])]
    caption = (
        "Bound: RMS over all views of what all grey levels would tell about the pose of an exact print. "
        "RE/bound: what the detector makes of its pattern, in the views that it found. "
        f"{ERRORS}" + (" CPU: median time of one view, in this run." if cpu_s else "")
    )
    return Table("Pattern and detector", header, rows, caption)


def _common(results: Mapping[str, Any]) -> Table:
    rows = [
        [
            entry["name"],
            _cell(entry["common"]),
            _interval(entry["common"]["interval"]["rotation_deg"]),
            *(number(entry["common"]["rotation_deg"][key]) for key in ("median", "p95")),
            number(entry["common"]["translation_pct"]["rms"]),
            str(entry["flips"]),
        ]
        for entry in with_short_names(results)
    ]
    views = results["views"]
    header = ["", "RE rms", "95 %", "median", "p95", "TE rms", "flips"]
    title = f"Over the {views['common']} of {views['count']} views found by all that found 90 %"
    return Table(title, header, rows, f"{ERRORS} {_SHARES} Flips are counted over all views.")


def _photometric(results: Mapping[str, Any]) -> Table:
    rows = []
    for entry in with_short_names(results):
        fit = entry["photometric"]
        error, bound = fit["rotation_deg"]["rms"], fit["bound"]["rotation_deg"]
        rows.append(
            [
                entry["name"],
                number(error),
                _interval(fit["interval"]["rotation_deg"]),
                number(fit["rotation_deg"]["median"]),
                number(bound),
                number(error / bound, 2) if error and bound else "-",
            ]
        )
    header = ["", "RE rms", "95 %", "median", "RE bound", "RE/bound"]
    caption = "A fit of each known picture to all grey levels, from its detector's pose, in the views that it found."
    return Table("The same refiner for all", header, rows, caption)


def _settings(results: Mapping[str, Any]) -> Table:
    rows = []
    for entry in with_short_names(results):
        tried = entry["tuning"]
        chosen = [row for row in tried if (row["size"], row["setting"]) == (entry["size"], entry["setting"])]
        ends = [(percent(row["rate"]), number(row["rotation_deg"]["rms"])) for row in (*tried[:1], *chosen[:1])]
        cells = [cell for end in ends for cell in end] or ["-"] * 4
        rows.append([entry["name"], str(len(tried)), *cells, tried[0]["setting"] if tried else "-"])
    header = ["", "tried", "first found", "RE rms", "best found", "RE rms", "first"]
    caption = (
        f"In views apart from those above. The best is the most accurate of those that find {percent(NEARLY_ALL)} of "
        "what any of them finds; the file of results has every setting that was tried."
    )
    return Table("Settings", header, rows, caption)


def _interval(ends: Sequence[float] | None) -> str:
    return f"{number(ends[0], 2)}–{number(ends[1], 2)}" if ends else "-"


def _split(results: Mapping[str, Any], by: str, unit: str, variable: str) -> Table:
    groups = list(results["contestants"][0][by])
    rows = [[entry["name"], *(_cell(entry[by][group]) for group in groups)] for entry in with_short_names(results)]
    title = f"Rotation error, RMS in deg, by {variable}"
    caption = f"Over the views that each found. {_SHARES}"
    return Table(title, ["", *(f"{group} {unit}" for group in groups)], rows, caption)


_SHARES = "In brackets how many of these views each found, where not all."


def _cell(group: Mapping[str, Any]) -> str:
    return number(group["rotation_deg"]["rms"]) + _share(group)


def _share(group: Mapping[str, Any]) -> str:
    """Share of the views that were found, in brackets; "" if there were none, or all were found."""
    return "" if group["rate"] in (None, 1) else f" ({percent(group['rate'])})"


def comparison_figure(results: Mapping[str, Any]) -> "Figure":
    """Plot rotation errors of all contestants and their RMS by tilt, over the views that all found; deg, log scale."""
    figure = new_figure((12, 1.9 + 0.42 * len(results["contestants"])))
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1])
    draw_errors(results, left)
    draw_by_tilt(results, right)
    views = results["views"]
    title = f"Rotation error over the {views['common']} of {views['count']} views found by all that found 90 %"
    figure.suptitle(title, fontsize=11)
    return figure


def draw_errors(results: Mapping[str, Any], ax: "Axes") -> "Axes":
    """Draw median, RMS with its interval, 95th percentile and bound of each rotation error, in one row each."""
    entries = with_short_names(results)
    looks: dict[str, dict[str, Any]] = {
        "median": {"marker": "o", "markerfacecolor": "white"},
        "rms": {"marker": "D", "markerfacecolor": "#222222"},
        "p95": {"marker": "|", "markersize": 11},
        "bound": {"marker": "x", "markersize": 5},
    }
    for y, entry in enumerate(entries):
        errors = entry["common"]["rotation_deg"]
        if not errors["count"]:
            missing = "not installed" if entry["absent"] else "not found"
            ax.annotate(missing, (0.5, y), xycoords=("axes fraction", "data"), ha="center", va="center")
            continue
        ax.plot([errors["median"], errors["p95"]], [y, y], color=_COLORS[y % len(_COLORS)], linewidth=2, zorder=1)
        values = errors | {"bound": entry["common"]["bound"]["rotation_deg"]}
        legend = {"p95": "95th percentile", "bound": "bound of the pattern"}
        interval = entry["common"]["interval"]["rotation_deg"]
        if interval:
            ax.plot(interval, [y + 0.22, y + 0.22], color="#222222", linewidth=1, label="rms, 95 % interval")
        for key, look in looks.items():
            ax.plot(values[key], y, linestyle="none", color="#222222", zorder=2, label=legend.get(key, key), **look)
        ax.annotate(number(errors["rms"], 2), (errors["rms"], y), (0, 6), textcoords="offset points", ha="center",
                    fontsize=8)  # fmt: skip
    ax.set_yticks(range(len(entries)), [entry["name"] + _share(entry["common"]) for entry in entries])
    ax.set_ylim(len(entries) - 0.4, -0.7)
    low, high = ax.get_xlim()
    log_axis(ax, "x", _STEPS if high < 50 * max(low, 1e-9) else (1,))
    ax.set_xlabel("RE, deg")
    ax.grid(axis="x", color="#dddddd")
    handles, labels = ax.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    ax.legend(unique.values(), unique.keys(), fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=3)
    return ax


def draw_by_tilt(results: Mapping[str, Any], ax: "Axes") -> "Axes":
    """Draw the RMS of each contestant's rotation error over the polar angle."""
    entries = with_short_names(results)
    groups = list(entries[0]["by_polar_angle"])
    angles = [middle(group) for group in groups]
    for k, entry in enumerate(entries):
        values = [entry["by_polar_angle"][group]["common"]["rotation_deg"]["rms"] for group in groups]
        ax.plot(
            angles, [value or np.nan for value in values], label=entry["name"], color=_COLORS[k % len(_COLORS)],
            linestyle=_LINES[(k + k // len(_COLORS)) % len(_LINES)], markersize=5,
            marker=_MARKS[(k + 3 * (k // len(_COLORS))) % len(_MARKS)],
        )  # fmt: skip
    log_axis(ax, "y", _STEPS)
    ax.set_xticks(angles, groups)
    ax.set_xlabel("tilt, deg")
    ax.set_ylabel("RE rms, deg")
    ax.grid(color="#dddddd")
    ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return ax


def with_short_names(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Contestants with names that fit a column: files without their folders, unless two would be the same."""
    names = [entry["name"] for entry in results["contestants"]]
    short = [Path(name).name if name.endswith(".json") else name for name in names]
    chosen = short if len(set(short)) == len(short) else names
    return [entry | {"name": name} for name, entry in zip(chosen, results["contestants"], strict=True)]
