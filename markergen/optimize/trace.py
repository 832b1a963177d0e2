"""Trace of a search: the successive layouts on the way to its optimum, their values, and a plot."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from itertools import groupby
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.files import check_folder
from markergen.maths.information import rotation_bound, translation_bound
from markergen.objectives import OBJECTIVES, Objective
from markergen.objectives.pose import PoseObjective
from markergen.optimize.problem import FeasibleRegion
from markergen.options import Watch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Record = Callable[[str, Array, Array], None]
"""Callback of a search, with a stage and its layouts (B, n, .) in m before and after the step."""

FORMATS = (".csv", ".svg", ".mp4", ".png")
"""File formats of a trace: a table, two movies (see `markergen.optimize.animation`), and a plot."""

PAUSE = 0.1
"""Seconds between two layouts that a `Watcher` judges: judging every step would take as long as the search."""

_LABELED = 0.08
"""Minimum fraction of all steps for a stage to be labeled in the plot."""


class Recorder:
    """Record of the predecessor of every layout, from which the way to any of them can be retraced.

    A search calls it whenever it changes layouts, before it is known which of them will be the best.
    """

    def __init__(self) -> None:
        self._origin: dict[bytes, tuple[bytes, str]] = {}

    def __call__(self, stage: str, before: Array, after: Array) -> None:
        """Record that a step of `stage` turned the layouts `before` (B, n, .) into `after` (B, n, .), in m."""
        for old, new in zip(before, after, strict=True):
            source, target = old.tobytes(), new.tobytes()
            # A layout reached again keeps its first predecessor.
            if source != target and target not in self._origin:
                self._origin[target] = source, stage

    def way(self, layout: Array) -> list[tuple[str, Array]]:
        """Stages and layouts (n, .) from the start, whose stage is ``start``, to `layout`."""
        steps, place, seen = [], layout.tobytes(), set()
        while place in self._origin and place not in seen:
            seen.add(place)
            source, stage = self._origin[place]
            steps.append((stage, place))
            place = source
        steps.append(("start", place))
        return [(stage, np.frombuffer(data).reshape(layout.shape)) for stage, data in reversed(steps)]


class Watcher:
    """Tells, a few times a second, of the best layout that a search has come upon; the search itself is the same.

    Whether its labels are safe is not judged.

    Parameters
    ----------
    objective : Objective
        For all poses; a search ranks layouts by a subset of them.
    region : FeasibleRegion
    tell : callable
        It may raise, which ends the search.
    also : callable or None
        Called with every step, besides.
    """

    def __init__(self, objective: Objective, region: FeasibleRegion, tell: Watch, also: Record | None = None) -> None:
        self._objective, self._region, self._tell, self._also = objective, region, tell, also
        self._points, self._value, self._next = np.empty((0, 2)), np.inf, -np.inf

    def __call__(self, stage: str, before: Array, after: Array) -> None:
        """Judge the layouts `after` (B, n, .) in m of a step, unless some were judged just before."""
        if self._also:
            self._also(stage, before, after)
        if monotonic() < self._next:
            return
        if len(held := after[self._region.holds(after[..., :2])]):
            values = self._objective(held)
            if values.min() < self._value:
                self._points, self._value = held[np.argmin(values)], float(values.min())
        if len(self._points):
            self._tell(stage, self._points, self._value)
        self._next = monotonic() + PAUSE


@dataclass(frozen=True)
class Step:
    """One step from the best start.

    Attributes
    ----------
    stage : str
        Stage of the search: ``start``, ``descent``, ``polish`` and so on.
    objective : float
        Aggregated value, in the objective's unit.
    condition : float
        c(A) in unit coordinates, geometric mean over the poses; nan for a relief.
    rotation_deg, translation_pct : float
        RMS over the poses of the predicted errors, for the noise of the setting.
    points : array (n, .)
        The layout in m.
    """

    step: int
    stage: str
    objective: float
    condition: float
    rotation_deg: float
    translation_pct: float
    points: Array = field(default_factory=lambda: np.empty((0, 2)), repr=False, compare=False)


def trace_of(way: Sequence[tuple[str, Array]], objective: Objective) -> list[Step]:
    """Steps of a way (see `Recorder.way`), with the values of each layout."""
    stages, layouts = [stage for stage, _ in way], np.stack([layout for _, layout in way])
    setting = objective.setting
    condition = np.full(len(layouts), np.nan)
    if layouts.shape[-1] == 2:
        condition = OBJECTIVES["condition"](setting)(layouts)
    bound = PoseObjective(setting).covariance(layouts)
    columns = (
        objective(layouts),
        condition,
        np.rad2deg(_rms(rotation_bound(bound))),
        100 * _rms(translation_bound(bound, setting.poses.translation)),
    )
    rows = zip(stages, *(column.tolist() for column in columns), layouts, strict=True)
    return [Step(i, *row) for i, row in enumerate(rows)]


def check_trace_path(path: Path) -> None:
    """Refuse a path to which no trace can be written, before any work is done.

    Raises
    ------
    InputError
        If the suffix is not one of `FORMATS`.
    OutputError
        If the folder is missing or not writable.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"a trace in one of {', '.join(FORMATS)}", str(path), "give --trace such a name")
    check_folder(path)


def trace_bytes(trace: Sequence[Step], suffix: str, objective: str = "objective") -> bytes:
    """Contents of a .csv or .png file, always the same for the same trace.

    Parameters
    ----------
    objective : str
        Name of the objective in the plot.
    """
    if suffix.lower() == ".csv":
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        names = [column.name for column in fields(Step) if column.name != "points"]
        writer.writerow(names)
        rows = [[getattr(step, name) for name in names] for step in trace]
        writer.writerows([[f"{v:.9g}" if isinstance(v, float) else v for v in row] for row in rows])
        return text.getvalue().encode()
    import matplotlib
    from matplotlib.figure import Figure

    # Independent of the user's matplotlib settings and of the time.
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        figure = Figure(figsize=(7, 4.5), layout="constrained")
        plot_trace(trace, figure.add_subplot(), objective)
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=150, metadata={"Software": None})
        return data.getvalue()


def plot_trace(trace: Sequence[Step], ax: "Axes", objective: str = "objective") -> "Axes":
    """Plot objective, c(A) and predicted errors over the steps, each in units of its last value, and the stages."""
    steps = [step.step for step in trace]
    last = trace[-1]
    series = (
        (f"{objective}: {last.objective:.4g}", [step.objective for step in trace], "#1b1b1b", "-"),
        (f"c(A): {last.condition:.4g}", [step.condition for step in trace], "#9a6a00", "--"),
        (f"rotation: {last.rotation_deg:.4g} deg", [step.rotation_deg for step in trace], "#0b5fa5", "-"),
        (f"translation: {last.translation_pct:.4g} %", [step.translation_pct for step in trace], "#b3361b", "-."),
    )
    for label, values, color, style in series:
        if np.isnan(values[-1]):  # A relief has no c(A).
            continue
        relative = np.array(values) / values[-1]
        # Degenerate layouts have no finite value and leave a gap.
        ax.plot(steps, np.where(np.isfinite(relative), relative, np.nan), style, color=color, label=label, lw=1.5)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter("{x:g}")
    for stage, group in groupby(trace[1:], key=lambda step: step.stage):
        begin, *rest = (step.step for step in group)
        ax.axvline(begin - 0.5, color="#cccccc", lw=0.8, zorder=0)
        if len(rest) >= _LABELED * len(trace):
            ax.annotate(
                stage, (begin - 0.5, 1), (3, -3), xycoords=("data", "axes fraction"),
                textcoords="offset points", va="top", fontsize=8, color="#666666",
            )  # fmt: skip
    ax.set_xlabel("step of the best start")
    ax.set_ylabel("in units of the last value")
    ax.legend(title="at the end", frameon=False)
    return ax


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=-1)))
