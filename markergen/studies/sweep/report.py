"""Presentation of a sweep: plots of the errors along an axis of the grid, and a page with them and the table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.errors import InputError
from markergen.presentation.pages import Section
from markergen.presentation.pages import page as page_of
from markergen.presentation.plots import SERIES, inline, log_axis, positive, svg_bytes
from markergen.presentation.tables import Table
from markergen.studies.sweep.grid import Sweep, axis_text
from markergen.studies.sweep.table import ALL, Row, columns
from markergen.units import parse_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LENGTHS = ("radius", "dot", "clearance", "relief", "print_sigma", "tag_side")
"""Axes that are lengths, plotted in mm."""

TITLES = {"n": "control points", "noise": "noise, px", **{name: f"{name.replace('_', ' ')}, mm" for name in LENGTHS}}

LINES, PANELS, COLUMNS = 6, 6, 3
"""Maximum number of lines per panel, of panels per plot, and of panels side by side."""

PANEL_INCHES, LEGEND_INCHES = (4.2, 3.2), 0.9

PREFERRED = "lm"
"""Estimator whose errors are plotted if the sweep includes it."""

QUANTITIES = {
    "rotation": (
        "rotation_rms_deg", "rotation_low_deg", "rotation_high_deg", "rotation_bound_deg",
        "rotation error, deg",
    ),
    "translation": (
        "translation_rms_pct", "translation_low_pct", "translation_high_pct", "translation_bound_pct",
        "translation error, %",
    ),
}  # fmt: skip
"""Columns of value, interval and bound, and the axis title."""


SHOWN = (
    "layout", "control_points", "noise_px", "estimator", "rotation_rms_deg", "rotation_bound_deg",
    "translation_rms_pct", "translation_bound_pct", "homography_rms_px", "flip_rate", "failure_rate",
    "criterion_condition",
)  # fmt: skip
"""Columns of the page, after the axes; the file has all columns."""

MOST_ROWS = 2000


@dataclass(frozen=True)
class SweepPlot:
    """Plot with its file name without suffix, its file, and its caption."""

    name: str
    svg: bytes
    caption: str


@dataclass(frozen=True)
class Roles:
    """Role of each axis of the grid in a plot; empty for none.

    Attributes
    ----------
    x, lines, panels : str
    held : mapping
        Axes without a role, with the value at which they are held: their first.
    """

    x: str
    lines: str
    panels: str
    held: Mapping[str, str]


def roles_of(sweep: Sweep) -> Roles:
    """Choose roles: x is the longest numeric axis; layouts are lines; the remaining axes become panels, or are held."""
    long = [name for name, values in sweep.axes.items() if len(values) > 1] or list(sweep.axes)[:1]
    numeric = [name for name in long if None not in [_number(name, value) for value in sweep.axes[name]]]
    x = max(numeric or long, key=lambda name: len(sweep.axes[name]))
    others = sorted((name for name in long if name != x), key=lambda name: name != "layout")
    lines = next((name for name in others if len(sweep.axes[name]) <= LINES), "")
    panels = next((name for name in others if name != lines and len(sweep.axes[name]) <= PANELS), "")
    held = {name: axis_text(values[0]) for name, values in sweep.axes.items() if name not in (x, lines, panels)}
    return Roles(x, lines, panels, held)


def plots(sweep: Sweep, table: Sequence[Row]) -> list[SweepPlot]:
    """Plots of rotation and translation errors with their bounds, and a comparison of the estimators."""
    roles = roles_of(sweep)
    overall = [
        row
        for row in table
        if row.get("polar_angle_deg") == ALL and all(row[name] == value for name, value in roles.held.items())
    ]
    names = list(dict.fromkeys(row["estimator"] for row in overall if "rotation_rms_deg" in row))
    shown = PREFERRED if PREFERRED in names else (names[0] if names else "")
    found = []
    for name, quantity in QUANTITIES.items():
        chosen = [row for row in overall if row.get("estimator", "") == shown]
        caption = f"{name.capitalize()} error of {shown}" if shown else f"{name.capitalize()} bound"
        caption += (
            f" over all poses{_held(roles)}: RMS with 95 % interval" if shown else f" over all poses{_held(roles)}"
        )
        caption += ", and its bound without marks." if shown else "."
        found.append(_plot(f"{name}-error", sweep, roles, chosen, roles.lines, quantity, caption))
    if len(names) > 1:
        first = {roles.lines: axis_text(sweep.axes[roles.lines][0])} if roles.lines else {}
        chosen = [
            row
            for row in overall
            if row.get("estimator") in names and all(row[key] == value for key, value in first.items())
        ]
        single = Roles(roles.x, "estimator", roles.panels, {**roles.held, **first})
        caption = f"Rotation error of each estimator over all poses{_held(single)}: RMS with 95 % interval."
        found.append(_plot("estimators", sweep, single, chosen, "estimator", QUANTITIES["rotation"], caption))
    return found


def _plot(
    name: str, sweep: Sweep, roles: Roles, rows: Sequence[Row], lines: str, quantity: tuple[str, ...], caption: str
) -> SweepPlot:
    panels = [axis_text(value) for value in sweep.axes[roles.panels]] if roles.panels else [""]
    across = min(len(panels), COLUMNS)
    down = ceil(len(panels) / across)

    def draw(figure: "Figure") -> None:
        grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
        axes = list(grid.flat)
        for ax, panel in zip(axes, panels, strict=False):
            part = [row for row in rows if not roles.panels or row[roles.panels] == panel]
            _draw_panel(ax, sweep, roles, part, lines, quantity)
            ax.set_title(f"{roles.panels} {panel}" if roles.panels else "", loc="left")
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        for ax in grid[:, 0]:
            ax.set_ylabel(quantity[-1])
        if any(np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any() for ax in axes for line in ax.lines):
            log_axis(axes[0], "y")
        handles = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        if len(handles) > 1:
            figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(len(handles), 4))

    size = (across * PANEL_INCHES[0], down * PANEL_INCHES[1] + LEGEND_INCHES)
    return SweepPlot(name, svg_bytes(draw, size), caption)


def _draw_panel(
    ax: "Axes", sweep: Sweep, roles: Roles, rows: Sequence[Row], lines: str, quantity: tuple[str, ...]
) -> None:
    value, low, high, bound, _ = quantity
    numbers = [_number(roles.x, each) for each in sweep.axes[roles.x]]
    texts = [axis_text(each) for each in sweep.axes[roles.x]]
    places: list[float] = list(range(len(texts))) if None in numbers else [float(each or 0) for each in numbers]
    order = np.argsort(places, kind="stable")
    labels = list(dict.fromkeys(row[lines] for row in rows)) if lines else [""]
    for index, label in enumerate(labels):
        by_x = {row[roles.x]: row for row in rows if not lines or row[lines] == label}
        columns = {
            key: np.array([positive(by_x.get(text, {}).get(key)) for text in texts])[order]
            for key in (value, low, high, bound)
        }
        x, look = np.array(places)[order], SERIES[index % len(SERIES)]
        if np.isfinite(columns[value]).any():
            spread = np.abs(np.stack([columns[low], columns[high]]) - columns[value])
            ax.errorbar(x, columns[value], np.nan_to_num(spread), label=label, capsize=2, **look)
        if lines != "estimator" or not index:
            plain = {**look, "marker": "", "linewidth": 0.9, "alpha": 0.7}
            if lines == "estimator":
                plain |= {"color": "#5a5a5a", "linestyle": ":"}
            ax.plot(x, columns[bound], label="bound" if lines == "estimator" else None, **plain)
            if lines != "estimator" and not np.isfinite(columns[value]).any():
                ax.lines[-1].set(label=label, marker=look["marker"], linewidth=1.5, alpha=1.0)
    ax.set_xlabel(TITLES.get(roles.x, roles.x))
    if None in numbers:
        ax.set_xticks(places, texts)
    elif len(places) <= 8:
        ax.set_xticks(places, [f"{place:g}" for place in places])


def _number(name: str, value: Any) -> float | None:
    """Value of an axis as a number, lengths in mm; None if it is not a number."""
    if name not in LENGTHS:
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
    try:
        return 1e3 * parse_length(value)
    except (InputError, TypeError, AttributeError):
        return None


def _held(roles: Roles) -> str:
    words = ", ".join(f"{name} {value}" for name, value in roles.held.items() if name)
    return f" ({words})" if words else ""


def page(sweep: Sweep, table: Sequence[Row], plots: Sequence[SweepPlot]) -> bytes:
    """Make the HTML page, with the same bytes for the same table; text from files is escaped."""
    rows = [row for row in table if row.get("polar_angle_deg") == ALL]
    present = {key for row in rows for key in row}
    axes = [name for name in sweep.axes if name in columns(sweep) and name not in SHOWN]
    known = {
        "noise": "noise_px",
        "n": "" if any(point.layout == "square" for point in sweep.points) else "control_points",
    }
    told = {known[name] for name in axes if name in known}
    head = [*axes, *(name for name in SHOWN if name in present - told)]
    errors = [
        (" ".join(f"{name}={row[name]}" for name in sweep.axes), row["error"]) for row in table if row.get("error")
    ]
    shown = [[_text(row.get(name, "")) for name in head] for row in rows[:MOST_ROWS]]
    more = f"The first {MOST_ROWS} rows of {len(rows)}; " if len(rows) > MOST_ROWS else ""
    kind = "wide" if roles_of(sweep).panels else ""
    drawn = [inline(each.svg, each.name, each.caption, each.caption, kind) for each in plots]
    failed = Section(tables=[Table("Points of the grid", ["point", "reason"], errors)]) if errors else None
    return page_of(
        sweep.name,
        "study",
        [
            ("errors", "Errors", Section(plots=drawn)),
            ("failed", "What could not be computed", failed),
            (
                "table",
                "Over all poses",
                Section(
                    [f"{more}table.csv has these rows for every tilt too, with 95 % intervals."],
                    tables=[Table("Errors over all poses", [name.replace("_", " ") for name in head], shown)],
                    files=["table.csv"],
                    book=("studies, and what their columns mean", "study.md"),
                ),
            ),
        ],
        _summary(sweep),
        "The same study gives the same page.",
    )


def _summary(sweep: Sweep) -> str:
    grid = "; ".join(f"{name}: {', '.join(map(axis_text, values))}" for name, values in sweep.axes.items())
    fixed = "; ".join(f"{name}: {axis_text(value)}" for name, value in sweep.fixed.items())
    words = f"{len(sweep.points)} points of a grid ({grid}), {sweep.runs} noisy trials for each pose."
    return words + (f" The same everywhere: {fixed}." if fixed else "")


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
