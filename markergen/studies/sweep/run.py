"""Running a sweep: cells for layouts with their criteria, and for their trials at each noise; their table and page.

The table is tidy: one row for each point of the grid, polar angle, and estimator. The page shows plots of the errors
along an axis of the grid.
"""

# tests: tests/studies/sweep/test_run.py tests/studies/sweep/test_table.py tests/studies/sweep/test_report.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, MarkergenError
from markergen.files import write_all
from markergen.model.spec import Spec
from markergen.objectives import Criterion
from markergen.objectives.criteria import columns as criteria_columns
from markergen.objectives.criteria import criteria
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.design import design
from markergen.optimize.dot_size import DotSize, choose_dots
from markergen.optimize.target import settled
from markergen.presentation.pages import Section
from markergen.presentation.pages import page as page_of
from markergen.presentation.plots import SERIES, inline, log_axis, positive, svg_bytes
from markergen.presentation.tables import Table, csv_bytes
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping
from markergen.studies.cells import Cell, Result
from markergen.studies.engines import Engine
from markergen.studies.run import CellProgress, Store, compute, open_store
from markergen.studies.sweep.grid import GridPoint, Sweep, axis_text
from markergen.units import parse_length
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import rms, share_interval
from markergen.validation.trials import Experiment, HomographyErrors, PoseErrors, join, run_trials

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Row = dict[str, Any]

DESIGN_SECONDS, LAYOUT_SECONDS, TRIAL_SECONDS = 2.0, 0.4, 5e-5
"""Rough costs in s on one core of a design, another layout, and a trial of one estimator at one pose."""

TYPICAL_POSES = 400
"""Number of poses by which the duration of trials is estimated."""

DIGITS = 6
"""Significant digits of the table."""


def run_sweep(
    sweep: Sweep, folder: Path, engine: Engine, resume: bool = False, progress: CellProgress | None = None
) -> list[Path]:
    """Compute a sweep and write its table, plots and page; returns their paths, the page last.

    Raises
    ------
    InputError
        If the folder is not for this sweep (see `open_store`).
    OutputError
        If something cannot be written; finished cells are kept.
    """
    with open_store(folder, sweep.identity, resume) as store:
        table = _table(sweep, store, engine, progress)
        files = {folder / "table.csv": csv_bytes(table, table_columns(sweep), DIGITS)}
        drawn = plots(sweep, table)
        files |= {folder / f"{plot.name}.svg": plot.svg for plot in drawn}
        files[folder / "index.html"] = sweep_page(sweep, table, drawn)
        write_all(files)
    return list(files)


def _table(sweep: Sweep, store: Store, engine: Engine, progress: CellProgress | None) -> list[Row]:
    """Rows in the order of the grid."""
    first = [Cell("layout", {"spec": point.spec.as_dict(), "layout": point.layout}) for point in sweep.points]
    # The trials of a layout are known before the layout itself.
    tried = {
        (cell, point.noise_px): TRIAL_SECONDS * TYPICAL_POSES * sweep.runs * len(point.estimators)
        for cell, point in zip(first, sweep.points, strict=True)
    }
    layouts = compute(work, first, store, engine, progress, _layout_cost, later=(len(tried), sum(tried.values())))
    second: list[Cell | None] = []
    for point, cell in zip(sweep.points, first, strict=True):
        layout = layouts[cell]
        second.append(None if ERROR in layout else trials_cell(point, layout["points"], sweep.runs))
    cells = [cell for cell in second if cell is not None]
    trials = compute(work, cells, store, engine, progress, before=len(layouts))
    return [
        row
        for point, layout, cell in zip(sweep.points, first, second, strict=True)
        for row in table_rows(sweep, point, layouts[layout], trials[cell] if cell else None)
    ]


def _layout_cost(cell: Cell) -> float:
    return DESIGN_SECONDS if cell.settings["layout"] == "designed" else LAYOUT_SECONDS


def trials_cell(point: GridPoint, points: Array, runs: int) -> Cell:
    """Cell of the trials at a point of the grid, for its layout (n, 3) in m."""
    settings = {"spec": point.spec.as_dict(), "points": points.tolist(), "noise_px": point.noise_px, "runs": runs}
    return Cell("trials", {**settings, "estimators": list(point.estimators)})


def work(cell: Cell) -> Result:
    """Compute a cell of either kind; a failure is also a result, with its reason as `ERROR`."""
    try:
        spec = spec_from_mapping(cell.settings["spec"], "the cell", stored=True)
        return _layout(spec, cell) if cell.kind == "layout" else _trials(spec, cell.settings, cell.seed)
    except MarkergenError as error:
        return {ERROR: np.array(str(error))}


def _layout(spec: Spec, cell: Cell) -> Result:
    """Points (n, 3) and dots in m, and each criterion for the noise of the setting, by name."""
    kind = cell.settings["layout"]
    if kind == "designed":
        finished = design(spec)
        points, dots, values = finished.marker.xyz, finished.dots, finished.criteria["design"]
    else:
        points, dots, values = _given_layout(spec, kind, cell.seed)
    return {
        "points": points,
        "dot": np.array(dots.diameter),
        "clearance": np.array(dots.clearance),
        **{f"criteria.{name}": np.array(value) for name, value in values.items()},
    }


def _given_layout(spec: Spec, kind: str, seed: int) -> tuple[Array, DotSize, Mapping[str, float]]:
    choice = settled(spec)
    spec = choice.spec if choice else spec
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera)
    dots = choose_dots(spec, poses)
    setting, region = dots.setting(spec, poses), dots.region(spec)
    layouts = comparison_layouts(region, spec.n, seed, setting).get(kind)
    if layouts is None:
        raise MarkergenError(f"expected room for the layout {kind}, found that its dots would touch")
    flat = layouts[0]
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points, dots, criteria(flat[None], setting)[0]


def _trials(spec: Spec, settings: Mapping[str, Any], seed: int) -> Result:
    """Sums over the trials of each pose, and the bounds, arrays (P,)."""
    points = np.array(settings["points"])
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    bounds = pose_bounds(points, spec.camera, poses, settings["noise_px"])
    groups = np.zeros(len(poses), dtype="U16")
    for name, mask in poses.by_polar_angle().items():
        groups[mask] = name
    result = {
        "polar_angle": groups,
        "bound.rotation_deg": bounds.rotation_deg,
        "bound.translation_pct": bounds.translation_pct,
    }
    if not settings["runs"]:
        return result
    experiment = Experiment(
        points=points,
        radius=spec.boundary.radius,
        camera=spec.camera,
        poses=poses,
        bounds=bounds,
        noise_px=settings["noise_px"],
        runs=settings["runs"],
        seed=seed,
        estimators=tuple(settings["estimators"]),
    )
    for name, errors in join(run_trials(experiment, range(len(poses))), stack=True).items():
        result |= {f"{name}.{key}": array for key, array in _sums(errors).items()}
    return result


def _sums(errors: PoseErrors | HomographyErrors) -> Result:
    """Sums for statistics over any subset of the poses: counts, squares and fourth powers."""
    kept = ~errors.failed
    sums: Result = {"kept": kept.sum(axis=1), "failed": errors.failed.sum(axis=1)}
    if isinstance(errors, HomographyErrors):
        squares = {"homography_px": errors.he_px2}
    else:
        sums["flipped"] = errors.flipped.sum(axis=1)
        squares = {"rotation_deg": errors.rotation_deg**2, "translation_pct": errors.translation_pct**2}
    for name, square in squares.items():
        square = np.where(kept, square, 0.0)
        sums[f"{name}.squares"] = square.sum(axis=1)
        sums[f"{name}.fourth_powers"] = (square**2).sum(axis=1)
    return sums


ERROR = "error"
"""Name of the only array of a cell that cannot be computed: the reason."""

ALL = "all"
"""Polar angle of the rows over all poses."""

CONFIDENCE, NORMAL_95 = 0.95, 1.959963984540054
"""Confidence level of the intervals, and the corresponding number of standard errors on each side."""

COLUMNS = (
    "layout", "control_points", "radius_mm", "dot_mm", "noise_px", "pose_count", "runs",
    "polar_angle_deg", "estimator", "trials",
    "rotation_rms_deg", "rotation_low_deg", "rotation_high_deg", "rotation_bound_deg",
    "translation_rms_pct", "translation_low_pct", "translation_high_pct", "translation_bound_pct",
    "homography_rms_px", "homography_low_px", "homography_high_px",
    "flips", "flip_rate", "flip_rate_low", "flip_rate_high",
    "failures", "failure_rate", "failure_rate_low", "failure_rate_high",
)  # fmt: skip
"""Columns after those of the axes, and before those of the criteria."""


def table_columns(sweep: Sweep) -> list[str]:
    """Names of the columns: the axes as written in the file, `COLUMNS`, criteria, and errors."""
    axes = (name for name in sweep.axes if name not in COLUMNS)
    return [*axes, *COLUMNS, *(f"criterion_{criterion.column}" for criterion in _criteria()), "error"]


def _criteria() -> list[Criterion]:
    """Criteria that are not among the bounds."""
    return [criterion for criterion in criteria_columns().values() if not criterion.bound]


def table_rows(sweep: Sweep, point: GridPoint, layout: Result, trials: Result | None) -> Iterator[Row]:
    """Rows of one point of the grid; missing values are omitted."""
    base: Row = {name: axis_text(value) for name, value in point.axes.items()}
    base |= {
        "layout": point.layout,
        "radius_mm": 1e3 * point.spec.boundary.radius,
        "noise_px": point.noise_px,
        "runs": sweep.runs,
    }
    error = next((str(part[ERROR]) for part in (layout, trials or {}) if ERROR in part), "")
    if error or trials is None:
        yield base | {"error": error}
        return
    base |= {"control_points": len(layout["points"]), "dot_mm": 1e3 * float(layout["dot"])}
    # Criteria are for noise of 1 px and proportional to it, except those of images, which have their own noise.
    noise = point.noise_px if point.spec.noise_model == "point" else 1.0
    for criterion in _criteria():
        if f"criteria.{criterion.key}" in layout:
            value = criterion.factor * float(layout[f"criteria.{criterion.key}"])
            base[f"criterion_{criterion.column}"] = value if criterion.noiseless else value * noise
    angles = trials["polar_angle"]
    groups = {ALL: np.ones(len(angles), dtype=bool)} | {name: angles == name for name in dict.fromkeys(angles.tolist())}
    for name, mask in groups.items():
        bounds: Row = {
            "pose_count": int(mask.sum()),
            "polar_angle_deg": name,
            "rotation_bound_deg": rms(trials["bound.rotation_deg"][mask]),
            "translation_bound_pct": rms(trials["bound.translation_pct"][mask]),
        }
        for estimator in point.estimators if sweep.runs else ("",):
            yield base | bounds | (_measured(trials, estimator, mask) if estimator else {})


def mean_square_interval(kept: Array, squares: Array, fourth_powers: Array) -> tuple[float, float, float]:
    """Mean square of the errors at some poses with the limits of its 95 % interval; nan if there is none.

    The poses are given and the noise is random: the variance of the mean follows from the sum of the variances at each
    pose, computed from sums (P,) of squares and fourth powers over the trials that were `kept`.
    """
    count = kept.sum()
    if not count:
        return (float("nan"),) * 3
    mean = squares.sum() / count
    if np.any(kept == 1):
        return float(mean), float("nan"), float("nan")
    held = kept > 1
    # The variance of a sum over m trials is m times that of one, estimated with m - 1 degrees of freedom.
    spread = fourth_powers[held] - squares[held] ** 2 / kept[held]
    error = np.sqrt(np.sum(np.maximum(spread, 0.0) * kept[held] / (kept[held] - 1))) / count
    return float(mean), float(max(mean - NORMAL_95 * error, 0.0)), float(mean + NORMAL_95 * error)


def _measured(trials: Result, estimator: str, mask: NDArray[np.bool_]) -> Row:
    part: Mapping[str, Any] = {
        key.removeprefix(f"{estimator}."): array[mask]
        for key, array in trials.items()
        if key.startswith(f"{estimator}.")
    }
    count = int(part["kept"].sum() + part["failed"].sum())
    row: Row = {"estimator": estimator, "trials": count}
    for name, unit in (("rotation", "deg"), ("translation", "pct"), ("homography", "px")):
        key = f"{name}_{unit}"
        if f"{key}.squares" in part:
            ends = mean_square_interval(part["kept"], part[f"{key}.squares"], part[f"{key}.fourth_powers"])
            row |= {
                f"{name}_{word}_{unit}": float(np.sqrt(end))
                for word, end in zip(("rms", "low", "high"), ends, strict=True)
            }
    for name, key in (("flip", "flipped"), ("failure", "failed")):
        if key in part:
            successes = int(part[key].sum())
            low, high = share_interval(successes, count, CONFIDENCE)
            row |= {f"{name}s": successes, f"{name}_rate": successes / count}
            row |= {f"{name}_rate_low": low, f"{name}_rate_high": high}
    return row


LENGTHS = ("radius", "dot", "clearance", "relief", "print_sigma", "tag_side")
"""Axes that are lengths, plotted in mm."""

TITLES = {"n": "control points", "noise": "noise, px", **{name: f"{name.replace('_', ' ')}, mm" for name in LENGTHS}}

LINES, PANELS, PANELS_ACROSS = 6, 6, 3
"""Maximum number of lines per panel, of panels per plot, and of panels side by side."""

PANEL_INCHES, LEGEND_INCHES = (4.2, 3.2), 0.9
"""Width and height of a panel, and height of the legend below all of them."""

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
"""Maximum number of rows of the table on the page; the file has all."""


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
    estimator = PREFERRED if PREFERRED in names else (names[0] if names else "")
    drawn = []
    for name, quantity in QUANTITIES.items():
        chosen = [row for row in overall if row.get("estimator", "") == estimator]
        caption = f"{name.capitalize()} error of {estimator}" if estimator else f"{name.capitalize()} bound"
        caption += (
            f" over all poses{_held(roles)}: RMS with 95 % interval" if estimator else f" over all poses{_held(roles)}"
        )
        caption += ", and its bound without marks." if estimator else "."
        drawn.append(_plot(f"{name}-error", sweep, roles, chosen, roles.lines, quantity, caption))
    if len(names) > 1:
        first = {roles.lines: axis_text(sweep.axes[roles.lines][0])} if roles.lines else {}
        chosen = [
            row
            for row in overall
            if row.get("estimator") in names and all(row[key] == value for key, value in first.items())
        ]
        single = Roles(roles.x, "estimator", roles.panels, {**roles.held, **first})
        caption = f"Rotation error of each estimator over all poses{_held(single)}: RMS with 95 % interval."
        drawn.append(_plot("estimators", sweep, single, chosen, "estimator", QUANTITIES["rotation"], caption))
    return drawn


def _plot(
    name: str,
    sweep: Sweep,
    roles: Roles,
    rows: Sequence[Row],
    lines: str,
    quantity: tuple[str, ...],
    caption: str,
) -> SweepPlot:
    panels = [axis_text(value) for value in sweep.axes[roles.panels]] if roles.panels else [""]
    across = min(len(panels), PANELS_ACROSS)
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
    numbers = [_number(roles.x, entry) for entry in sweep.axes[roles.x]]
    texts = [axis_text(entry) for entry in sweep.axes[roles.x]]
    places: list[float] = list(range(len(texts))) if None in numbers else [float(entry or 0) for entry in numbers]
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
    text = ", ".join(f"{name} {value}" for name, value in roles.held.items() if name)
    return f" ({text})" if text else ""


def sweep_page(sweep: Sweep, table: Sequence[Row], plots: Sequence[SweepPlot]) -> bytes:
    """Make the HTML page, with the same bytes for the same table; text from files is escaped."""
    rows = [row for row in table if row.get("polar_angle_deg") == ALL]
    present = {key for row in rows for key in row}
    axes = [name for name in sweep.axes if name in table_columns(sweep) and name not in SHOWN]
    meanings = {
        "noise": "noise_px",
        "n": "" if any(point.layout == "square" for point in sweep.points) else "control_points",
    }
    explanations = {meanings[name] for name in axes if name in meanings}
    head = [*axes, *(name for name in SHOWN if name in present - explanations)]
    errors = [
        (" ".join(f"{name}={row[name]}" for name in sweep.axes), row["error"]) for row in table if row.get("error")
    ]
    cells = [[_text(row.get(name, "")) for name in head] for row in rows[:MOST_ROWS]]
    more = f"The first {MOST_ROWS} rows of {len(rows)}; " if len(rows) > MOST_ROWS else ""
    kind = "wide" if roles_of(sweep).panels else ""
    drawn = [inline(drawing.svg, drawing.name, drawing.caption, drawing.caption, kind) for drawing in plots]
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
                    tables=[Table("Errors over all poses", [name.replace("_", " ") for name in head], cells)],
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
    extent = f"{len(sweep.points)} points of a grid ({grid}), {sweep.runs} noisy trials for each pose."
    return extent + (f" The same everywhere: {fixed}." if fixed else "")


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
