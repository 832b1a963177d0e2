"""The paper's figures, drawn from the results."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.presentation.plots import INK, MUTED, SERIES, log_axis
from markergen_paper.experiments import FRONTAL
from markergen_paper.options import BOUNDARY, CAMERAS, COORDINATES, NOISE_PX, poses_of
from markergen_paper.results import PaperResults, histogram, typical_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Draw = Callable[["Figure"], object]

METHODS = {"epnp": "EPnP", "ippe": "IPPE", "lm": "LM"}
AXES = {"rotation_deg": "rotation error RE, deg", "translation_pct": "translation error TE, %"}
ILL, WELL = SERIES[1], SERIES[0]
SQUARE_LINE: dict[str, Any] = {"color": INK, "linestyle": "-.", "linewidth": 1.2, "label": "square"}
FINAL = {"color": "#b3361b", "marker": "o", "linestyle": "none", "markersize": 6}


def descent_paths(result: Mapping[str, NDArray[Any]], camera: str) -> Draw:
    """Figure 3 of the paper: how the points move, in object and image."""

    def draw(figure: "Figure") -> None:
        objects, images = figure.subplots(1, 2)
        layouts, pose = result["layouts"], poses_of([FRONTAL])
        seen = CAMERAS[camera].project(layouts, pose.rotation, pose.translation)[:, 0]
        rim = BOUNDARY.rim(200)
        outline = CAMERAS[camera].project(rim, pose.rotation, pose.translation)[0]
        for ax, paths, edge in ((objects, 1e3 * layouts, 1e3 * rim), (images, seen, outline)):
            closed = np.concatenate([edge, edge[:1]])
            ax.plot(*closed.T, color=MUTED, linestyle=(0, (4, 3)), linewidth=1)
            for i in range(paths.shape[1]):
                look = SERIES[i]
                ax.plot(*paths[:, i].T, color=look["color"], marker=".", markersize=3, linewidth=1)
                ax.plot(*paths[0, i], color=look["color"], marker=look["marker"], markersize=6, linestyle="none")
            ax.plot(*paths[-1].T, label="end", zorder=5, **FINAL)
            ax.set_aspect("equal")
        objects.set(title="object", xlabel="x, mm", ylabel="y, mm")
        images.set(title="image", xlabel="x, px", ylabel="y, px")
        images.invert_yaxis()
        figure.legend(*objects.get_legend_handles_labels(), loc="outside lower center")

    return draw


def descent_condition(result: Mapping[str, NDArray[Any]]) -> Draw:
    """Figure 4 of the paper: c(A) and HE over the steps."""

    def draw(figure: "Figure") -> None:
        top, bottom = figure.subplots(2, 1, sharex=True)
        _steps(top, result["c.metric"], None, result["square.c.metric"][0], WELL)
        mean, std = (np.asarray(result[f"dlt.he_px2.{statistic}"], dtype=float) for statistic in ("mean", "std"))
        _steps(bottom, mean, std, result["square.dlt.he_px2.mean"][0], WELL)
        top.set_ylabel("c(A), metric")
        bottom.set(ylabel="HE, px²", xlabel="step")
        top.legend(loc="upper right")

    return draw


def descent_pose(result: Mapping[str, NDArray[Any]]) -> Draw:
    """Figures 5 and 6 of the paper: RE and TE of each method over the steps, with their standard deviation."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots(2, 3, sharex=True, sharey="row")
        for row, measure in zip(axes, AXES, strict=True):
            for ax, (method, title) in zip(row, METHODS.items(), strict=True):
                mean, std = (
                    np.asarray(result[f"{method}.{measure}.{statistic}"], dtype=float) for statistic in ("mean", "std")
                )
                _steps(ax, mean, std, result[f"square.{method}.{measure}.mean"][0], WELL)
                if measure == "rotation_deg":
                    ax.set_title(title)
                else:
                    ax.set_xlabel("step")
            row[0].set_ylabel(AXES[measure])
        axes[0][2].legend(loc="upper right")

    return draw


def conditioned_homography(study: PaperResults) -> Draw:
    """Figure 7 of the paper: c(A) and HE by the number of points."""

    def draw(figure: "Figure") -> None:
        left, right = figure.subplots(1, 2)
        metric = COORDINATES[0]
        _against(left, study, f"c.{metric}")
        _against(right, study, "dlt.he_px2.mean")
        left.set(ylabel="c(A), metric", xlabel="points")
        right.set(ylabel="HE, px²", xlabel="points")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)

    return draw


def conditioned_pose(study: PaperResults) -> Draw:
    """Figure 8 of the paper: RE and TE of each method by the number of points."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots(2, 3, sharex=True, sharey="row")
        for row, measure in zip(axes, AXES, strict=True):
            for ax, (method, title) in zip(row, METHODS.items(), strict=True):
                _against(ax, study, f"{method}.{measure}.mean")
                if measure == "rotation_deg":
                    ax.set_title(title)
                else:
                    ax.set_xlabel("points")
            row[0].set_ylabel(AXES[measure])
        figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=3)

    return draw


def by_angle(study: PaperResults, n: int = 4) -> Draw:
    """Breakdown of figure 8 by polar angle, for one number of points."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots(1, 2)
        table = study.full[n]
        angles = np.unique(table.polar_deg)
        for ax, measure in zip(axes, AXES, strict=True):
            for method, look in zip(METHODS, SERIES, strict=False):
                for name, line in (("ill", ":"), (COORDINATES[0], "-")):
                    level = table.level(f"{name}.{method}.{measure}.mean")
                    values = [_middle(level[table.polar_deg == angle]) for angle in angles]
                    label = f"{METHODS[method]}, {'random' if name == 'ill' else 'optimized'}"
                    ax.plot(angles, values, line, color=look["color"], marker=look["marker"], label=label)
            ax.set(ylabel=AXES[measure], xlabel="polar angle, deg", xticks=angles)
            _log(ax)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)

    return draw


def final_layouts(study: PaperResults, n: int) -> Draw:
    """Figures 9 and 10 of the paper: distribution of the points of final layouts, and typical layouts."""

    def draw(figure: "Figure") -> None:
        counts, edges = histogram(study, n)
        typical_layouts = typical_of(study, n)
        axes = figure.subplots(1, 2 + len(typical_layouts), sharey=True)
        for ax, part, title in zip(axes, counts, ("all", "all, turned"), strict=False):
            # Rows of an image correspond to y.
            ax.pcolormesh(1e3 * edges, 1e3 * edges, np.sqrt(part.T), cmap="Greys", rasterized=True)
            ax.set_title(title)
        for ax, (layout, share) in zip(axes[2:], typical_layouts, strict=True):
            ax.plot(*(1e3 * layout).T, **FINAL)
            ax.set_title(f"typical of {share:.0%}")
        rim = 1e3 * BOUNDARY.rim(200)
        for ax in axes:
            ax.plot(*np.concatenate([rim, rim[:1]]).T, color=MUTED, linestyle=(0, (4, 3)), linewidth=1)
            ax.set(xlabel="x, mm", aspect="equal", xlim=(-160, 160), ylim=(-160, 160))
        axes[0].set_ylabel("y, mm")

    return draw


def objectives(study: PaperResults, noise_px: float) -> Draw:
    """Beyond the paper: quality of layouts optimized for other objectives, pose by pose."""
    names = {"ill": "random", "ngon": "regular n-gon", **{c: f"c(A), {c}" for c in COORDINATES}}
    names |= {"homography": "homography", "pose": "pose"}

    def draw(figure: "Figure") -> None:
        axes = figure.subplots(1, 2)
        numbers = sorted(n for noise, n in study.beside if noise == noise_px)
        for ax, (key, label) in zip(
            axes, {"dlt.he_px2.mean": "HE, px²", "lm.rotation_deg.mean": "RE of LM, deg"}.items(), strict=True
        ):
            looks = [{"color": INK, "linestyle": ":"}, {"color": INK, "linestyle": "-."}, *SERIES]
            for (name, description), look in zip(names.items(), looks, strict=True):
                tables = [study.beside[noise_px, n] for n in numbers]
                values = [_middle(table.level(f"{name}.{key}")) for table in tables]
                ax.plot(numbers, values, label=description, **look)
            ax.set(ylabel=label, xlabel="points", xticks=numbers)
            _log(ax)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return draw


def one_for_all(study: PaperResults) -> Draw:
    """Beyond the paper: one layout for all poses, flat and with relief, with bounds and errors of LM."""
    names = {
        "random": "random (median)", "metric": "c(A), metric", "unit": "c(A), unit", "pixel": "c(A), pixel",
        "homography": "homography", "ngon": "regular n-gon", "pose": "pose", "relief-20": "pose, relief 20 mm",
        "relief-50": "pose, relief 50 mm",
    }  # fmt: skip

    def draw(figure: "Figure") -> None:
        ax = figure.subplots()
        numbers = sorted({n for _, n in study.joint})
        height = 0.8 / len(numbers)
        for place, name in enumerate(names):
            for i, n in enumerate(numbers):
                bound = float(np.median(study.joint[name, n]["rotation_deg"]))
                y = place + (i - (len(numbers) - 1) / 2) * height
                label = f"{n} points" if not place else None
                ax.barh(y, bound, height * 0.9, color=SERIES[i]["color"], alpha=0.75, label=label)
                ax.annotate(f" {bound:.3g}", (bound, y), va="center", fontsize=7, color=INK)
        ax.set_yticks(range(len(names)), list(names.values()))
        ax.invert_yaxis()
        ax.set_xlabel("rotation bound over all poses at 1 px, RMS, deg")
        log_axis(ax, "x")
        ax.grid(axis="y", visible=False)
        figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=len(numbers))

    return draw


def figures_of(study: PaperResults) -> dict[str, tuple[Draw, tuple[float, float], str]]:
    """All figures by file name: how to draw each, its size in inches, and its caption."""
    figures: dict[str, tuple[Draw, tuple[float, float], str]] = {}
    for camera, result in study.descents.items():
        camera_name = "the paper's camera" if camera == "paper" else "the camera of the paper's experiment, 1288 x 964"
        runs = f"noise of {NOISE_PX:g} px, {study.options.step_runs} runs per step"
        figures |= {
            f"descent-{camera}-paths": (
                descent_paths(result, camera), (8, 4.6),
                f"Fronto-parallel descent of four points, {camera_name}: from the large marks to the red dots.",
            ),
            f"descent-{camera}-condition": (
                descent_condition(result), (6, 5),
                f"c(A) and the homography's error on the way, mean and deviation; {camera_name}, {runs}.",
            ),
            f"descent-{camera}-pose": (
                descent_pose(result), (9, 5.6),
                f"Errors of the pose on the way, mean and deviation; {camera_name}, {runs}.",
            ),
        }  # fmt: skip
    spread = f"Medians over poses and bars from quartile to quartile; noise of {NOISE_PX:g} px"
    figures |= {
        "conditioned-homography": (
            conditioned_homography(study), (8, 4.4), f"Random against optimized layouts: c(A) and HE. {spread}.",
        ),
        "conditioned-pose": (
            conditioned_pose(study), (9, 6), f"Random against optimized layouts: RE and TE. {spread}.",
        ),
        "conditioned-angle": (
            by_angle(study), (8, 4.6), f"Four points, by polar angle: medians over poses; noise of {NOISE_PX:g} px.",
        ),
        "final-4": (
            final_layouts(study, 4), (9, 3.5),
            "Final layouts of four points under all poses: all points, the darker the more, the same turned to lie "
            "on each other, and a typical layout.",
        ),
        "final-5": (
            final_layouts(study, 5), (10, 3.1),
            "Final layouts of five points under all poses, as those of four, with the two most common kinds.",
        ),
        "one-for-all": (
            one_for_all(study), (8, 7),
            "Beyond the paper: one layout for all poses. c(A) in Hartley's coordinates is left out: its optimum is "
            "degenerate (see joint.csv).",
        ),
    }  # fmt: skip
    for noise_px in sorted({noise for noise, _ in study.beside}):
        figures[f"objectives-{noise_px:g}px"] = (
            objectives(study, noise_px), (9, 5),
            f"Layouts optimized for each pose in other coordinates of A or by other objectives; noise {noise_px:g} px.",
        )  # fmt: skip
    return figures


def _steps(ax: "Axes", mean: Array, std: Array | None, square: float, look: Mapping[str, Any]) -> None:
    steps = np.arange(len(mean))
    ax.plot(steps, mean, color=look["color"], label="mean")
    if std is not None:
        # On a logarithmic axis a band needs a positive lower limit.
        low = np.maximum(mean - std, 0.05 * mean)
        ax.fill_between(steps, low, mean + std, color=look["color"], alpha=0.2, linewidth=0, label="deviation")
    ax.axhline(square, **SQUARE_LINE)
    _log(ax)


def _against(ax: "Axes", study: PaperResults, key: str) -> None:
    """Random versus optimized layouts over n, and the square."""
    metric = COORDINATES[0]
    for name, look, label, offset in (("ill", ILL, "random", -0.08), (metric, WELL, "optimized", 0.08)):
        tables = {n: table for n, table in study.full.items() if f"{name}.{key}" in table.arrays}
        levels = {n: _kept(table.level(f"{name}.{key}")) for n, table in tables.items()}
        levels = {n: level for n, level in levels.items() if len(level)}
        low, middle, high = np.array([np.quantile(level, [0.25, 0.5, 0.75]) for level in levels.values()]).T
        x = np.array(list(levels)) + offset
        ax.errorbar(x, middle, [middle - low, high - middle], capsize=3, label=label, **look)
    ax.axhline(_middle(study.full[4].level(f"ngon.{key}")), **SQUARE_LINE)
    ax.set_xticks(sorted(study.full))
    _log(ax)


def _log(ax: "Axes") -> None:
    ax.set_yscale("log")
    ax.autoscale_view()
    log_axis(ax, "y")


def _kept(values: Array) -> Array:
    return values[np.isfinite(values)]


def _middle(values: Array) -> float:
    kept = _kept(values)
    return float(np.median(kept)) if len(kept) else float("nan")
