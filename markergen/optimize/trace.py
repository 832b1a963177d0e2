"""Trace of a search: the successive layouts on the way to its optimum, their values, a plot, and a movie.

Its dots move in the marker and in the image, with value and errors, as SVG or MP4.
"""

# tests: tests/optimize/test_trace.py tests/optimize/test_animation.py

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from itertools import groupby
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.files import check_folder
from markergen.maths.information import rotation_bound, translation_bound
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.pose import PoseObjective
from markergen.optimize.problem import FeasibleRegion
from markergen.options import Watch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Record = Callable[[str, Array, Array], None]
"""Callback of a search, with a stage and its layouts (B, n, .) in m before and after the step."""

FORMATS = (".csv", ".svg", ".mp4", ".png")
"""File formats of a trace: a table, two movies (see `Movie`), and a plot."""

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


# --- The search as a movie --------------------------------------------------------------------------------------------

FRAMES, SECONDS, HELD = 90, 9.0, 1.5
"""Largest number of steps that are shown, and duration in s of the way and of its end."""

WIDTH, HEIGHT, PANEL, MARGIN, CURVE = 960, 560, 440, 20, 50
"""Size in px of the picture, of each of its two panels, of the space around them, and of the curve below."""

CORNERS = 16
"""Corners of the polygon that a dot is drawn as."""

RATE = 20
"""Frames per second of a video."""

DARK, LIGHT, BLUE = "#1b1b1b", "#9a9a9a", "#0b5fa5"

MOVIES = (".svg", ".mp4")
"""File formats of movies."""


@dataclass(frozen=True, eq=False)
class Movie:
    """A way to a layout, in pictures.

    Attributes
    ----------
    trace : sequence of Step
    setting : Setting
        Its pose of median tilt is the one of the image.
    diameter : float
        Of the dots, m; 0 draws small ones.
    title : str
        Name of the objective.
    """

    trace: Sequence[Step]
    setting: Setting
    diameter: float
    title: str

    @property
    def steps(self) -> list[Step]:
        """Steps that are shown, the first and the last among them."""
        places = np.linspace(0, len(self.trace) - 1, min(FRAMES, len(self.trace)))
        return [self.trace[place] for place in np.round(places).astype(int).tolist()]

    def polygons(self, step: Step) -> Array:
        """Dots (2 n, CORNERS, 2) in px of the picture: in the marker, then in the image."""
        points = np.pad(step.points, ((0, 0), (0, 3 - step.points.shape[1])))
        angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
        radius = (self.diameter or 0.03 * self.setting.boundary.radius) / 2
        rims = points[:, None] + radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
        return np.concatenate([self._in_marker(rims[..., :2]), self._in_image(rims)])

    def outlines(self) -> list[Array]:
        """Lines in px of the picture that do not move: the boundary in both panels, and the edge of the image."""
        camera = self.setting.camera
        rings = [np.concatenate([ring, ring[:1]]) for ring in self.setting.boundary.outlines()]
        width, height = camera.width - 0.5, camera.height - 0.5
        frame = np.array([[-0.5, -0.5], [width, -0.5], [width, height], [-0.5, height], [-0.5, -0.5]])
        flat = [self._in_image(np.pad(ring, ((0, 0), (0, 1)))[None])[0] for ring in rings]
        return [*(self._in_marker(ring) for ring in rings), *flat, self._of_image(frame)]

    def curve(self) -> Array:
        """Logarithm of the value (k, 2) over the steps shown, in px of the picture; the last height where infinite."""
        values = np.log([step.objective for step in self.steps])
        values = np.where(np.isfinite(values), values, values[-1])
        x = np.linspace(MARGIN, WIDTH - MARGIN, len(values))
        span = max(float(np.ptp(values)), 1e-9)
        return np.stack([x, HEIGHT - MARGIN - CURVE * (values - values.min()) / span], axis=-1)

    def caption(self, step: Step) -> str:
        """Stage, value and errors of a step, in words."""
        errors = f"rotation {step.rotation_deg:.3g} deg, translation {step.translation_pct:.3g} %"
        return f"{step.step}  {step.stage}: {self.title} {step.objective:.4g}, {errors}"

    def svg(self) -> bytes:
        """Animated SVG, which browsers play without end."""
        steps = self.steps
        # The end is shown for a while.
        ends = [*np.linspace(0, SECONDS / (SECONDS + HELD), len(steps)).round(4).tolist(), 1.0]
        times = f'dur="{SECONDS + HELD:g}s" repeatCount="indefinite" keyTimes="{_joined(ends, ";", 4)}"'
        frames = np.stack([self.polygons(step) for step in [*steps, steps[-1]]])
        curve = self.curve()
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
            f'font-family="sans-serif" font-size="15"><title>The way to the layout</title>'
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
            *(_polyline(line, LIGHT) for line in self.outlines()),
            _polyline(curve, BLUE),
        ]
        for dot in frames.swapaxes(0, 1):
            ways = ";".join(_text_of(corners) for corners in dot)
            parts.append(
                f'<polygon fill="{DARK}" points="{_text_of(dot[-1])}">'
                f'<animate attributeName="points" {times} values="{ways}"/></polygon>'
            )
        moves = "".join(
            f'<animate attributeName="c{axis}" {times} values="{_joined([*values, values[-1]], ";")}"/>'
            for axis, values in zip("xy", curve.T.tolist(), strict=True)
        )
        parts.append(f'<circle r="5" fill="{BLUE}" cx="{curve[-1, 0]:.1f}" cy="{curve[-1, 1]:.1f}">{moves}</circle>')
        for place, step in enumerate(steps):
            opacities = ";".join("1" if min(k, len(steps) - 1) == place else "0" for k in range(len(ends)))
            parts.append(
                f'<text x="{MARGIN}" y="{HEIGHT - CURVE - 1.6 * MARGIN:g}" opacity="{int(place == len(steps) - 1)}">'
                f'{escape(self.caption(step))}<animate attributeName="opacity" calcMode="discrete" {times} '
                f'values="{opacities}"/></text>'
            )
        return "\n".join([*parts, "</svg>\n"]).encode()

    def mp4(self) -> bytes:
        """Video, for players; browsers do not know its codec."""
        import tempfile
        from pathlib import Path

        import cv2

        steps, curve = self.steps, self.curve()
        lines = [np.round(16 * line).astype(np.int32) for line in [*self.outlines(), curve]]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "way.mp4"
            video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE, (WIDTH, HEIGHT))
            places = np.round(np.linspace(0, len(steps) - 1, round(RATE * SECONDS))).astype(int).tolist()
            for place in [*places, *[len(steps) - 1] * round(RATE * HELD)]:
                picture = np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)
                cv2.polylines(picture, lines, False, (154, 154, 154), 1, cv2.LINE_AA, 4)
                polygons = np.round(16 * self.polygons(steps[place])).astype(np.int32)
                for polygon in polygons:
                    cv2.fillPoly(picture, [polygon], (27, 27, 27), cv2.LINE_AA, 4)
                center = np.round(curve[place]).astype(int).tolist()
                cv2.circle(picture, center, 5, (165, 95, 11), -1, cv2.LINE_AA)
                at = MARGIN, round(HEIGHT - CURVE - 1.6 * MARGIN)
                text, font = self.caption(steps[place]), cv2.FONT_HERSHEY_SIMPLEX
                cv2.putText(picture, text, at, font, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
                video.write(picture)
            video.release()
            return path.read_bytes()

    def _in_marker(self, points: Array) -> Array:
        boundary = self.setting.boundary
        scale = PANEL / 2 / boundary.radius
        return MARGIN + PANEL / 2 + (points - boundary.center) * [scale, -scale]

    def _in_image(self, points: Array) -> Array:
        """Places in the picture of the images of points (m, k, 3) in m."""
        poses = self.setting.poses
        pose = np.argsort(poses.polar_angle_deg, kind="stable")[len(poses) // 2 : len(poses) // 2 + 1]
        flat = points.reshape(-1, 3)
        pixels = self.setting.camera.project(flat, poses.rotation[pose], poses.translation[pose])[0]
        return self._of_image(pixels.reshape(*points.shape[:-1], 2))

    def _of_image(self, pixels: Array) -> Array:
        camera = self.setting.camera
        scale = PANEL / max(camera.width, camera.height)
        return (pixels + 0.5) * scale + [WIDTH - MARGIN - PANEL, MARGIN + (PANEL - scale * camera.height) / 2]


def _joined(numbers: Sequence[float], by: str, digits: int = 1) -> str:
    return by.join(f"{value:.{digits}f}".rstrip("0").rstrip(".") for value in numbers)


def _text_of(points: Array) -> str:
    return _joined(points.ravel().tolist(), " ")


def _polyline(points: Array, color: str) -> str:
    return f'<polyline fill="none" stroke="{color}" points="{_text_of(points)}"/>'
