"""What the condition number shows, and where another dot would help: figures and tables of docs/theory.md."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

import markergen as mg
from docs.figures import Save, drawing, table
from markergen.objectives.criteria import criteria
from markergen.objectives.pose import PoseObjective
from markergen.optimize.problem import FeasibleRegion, room_of
from markergen.presentation.plots import INK, SERIES, log_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RANDOM = 250
L_SHAPE = {
    "type": "Polygon",
    "coordinates": [[[0, 0], [0.2, 0], [0.2, 0.08], [0.08, 0.08], [0.08, 0.2], [0, 0.2], [0, 0]]],
}


def make(save: Save) -> None:
    """Print the page's tables, and save its figures."""
    _condition(save)
    _another(save)


def _condition(save: Save) -> None:
    rows, printed = [], []
    for n in (4, 5, 8):
        design = mg.design(n=n)
        region = _region(design)
        results = criteria(region.sample(RANDOM, n, np.random.default_rng(0)), design.setting)
        best = criteria(design.marker.xyz[None, :, :2], design.setting)[0]
        c, rotation = (np.array([item[key] for item in results]) for key in ("condition", "rotation_deg"))
        rank = spearmanr(c, rotation).statistic
        values = f"{best['condition']:.3g}", f"{best['rotation_deg']:.3g}", f"{np.median(c):.3g}"
        rows.append([str(n), *values, f"{np.median(rotation):.3g}", f"{rank:.2f}"])
        printed.append((n, c, rotation, best))

    def draw(ax: "Axes") -> None:
        n, c, rotation, best = printed[1]
        ax.scatter(c, rotation, s=9, color=SERIES[0]["color"], label=f"{RANDOM} random layouts of {n} dots")
        ax.scatter(
            best["condition"], best["rotation_deg"], s=60, marker="*", color=SERIES[1]["color"], label="designed"
        )
        log_axis(ax, "x")
        log_axis(ax, "y")
        ax.set_xlabel("c(A), geometric mean over the poses")
        ax.set_ylabel("bound of the rotation, deg")
        ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)

    heads = ["dots", "designed: c", "designed: bound, deg", "random: c", "random: bound, deg", "rank correlation"]
    table("Condition", heads, rows)
    save("theory-condition", drawing(draw))


def _another(save: Save) -> None:
    from json import dumps
    from pathlib import Path
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        outline = Path(folder) / "room.geojson"
        outline.write_text(dumps(L_SHAPE))
        design = mg.design(n=5, boundary=outline, boundary_unit="m", dot="15mm")
    region, points = _region(design), design.marker.xyz[:, :2]
    objective = PoseObjective(design.setting)
    corners = np.concatenate(design.marker.boundary.outlines())
    x, y = (np.linspace(corners[:, k].min(), corners[:, k].max(), 61) for k in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = region.holds(places[:, None])
    more = np.concatenate([np.broadcast_to(points, (inside.sum(), *points.shape)), places[inside][:, None]], axis=1)
    value = float(objective(points[None])[0])
    less = np.full(len(places), np.nan)
    less[inside] = 100 * (1 - objective(more) / value)

    def draw(ax: "Axes") -> None:
        lines = ax.contour(1e3 * x, 1e3 * y, less.reshape(61, 61), levels=8, colors=SERIES[0]["color"], linewidths=1)
        ax.clabel(lines, fontsize=7.5)
        for ring in design.marker.boundary.outlines():
            ax.fill(*(1e3 * ring.T), fill=False, edgecolor=INK)
        ax.scatter(*(1e3 * points.T), s=50, color=INK)
        ax.set_aspect("equal")
        ax.set_xlabel("x, mm")
        ax.set_ylabel("y, mm")

    table(
        "Another dot",
        ["displacement with five dots, mm", "less with a sixth, at most", "at least", "certificate"],
        [
            [
                f"{1e3 * value:.2f}",
                f"{np.nanmax(less):.1f} %",
                f"{np.nanmin(less):.1f} %",
                design.certificate.sentence,
            ]
        ],
    )
    save("theory-another-dot", drawing(draw, (4.4, 3.9)))


def _region(design: mg.Design) -> FeasibleRegion:
    spec, dots = design.spec, design.dots
    return FeasibleRegion(room_of(spec), dots.diameter, dots.clearance, spec.gap)
