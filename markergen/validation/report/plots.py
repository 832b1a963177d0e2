"""Plots of a report, drawn on matplotlib axes; and its dome of poses, to turn and as still pictures."""
# tests: tests/validation/report/test_plots.py tests/validation/report/test_report.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.arrays import Array
from markergen.estimators.budget import PoseBudget
from markergen.model.body import Plate
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.presentation.pages import dome_figure
from markergen.presentation.plots import (
    COLORS,
    FAINT,
    INK,
    SERIES,
    Plot,
    color_steps,
    legend_below,
    log_axis,
    plot,
    positive,
    ticks,
)
from markergen.presentation.tables import percent
from markergen.validation.error_to_plan_with import middle
from markergen.validation.metrics import rms
from markergen.validation.report.subject import SOURCES, value_text
from markergen.validation.sentences import shares
from markergen.validation.tables import TITLES
from markergen.validation.view_records import DETECTOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Statistics = Mapping[str, Any]

BEST = (DETECTOR, "lm")
"""Estimators whose quantiles are shown, in order of preference: the user's, then the most accurate."""
FIRST = (*BEST, "ippe", "sqpnp", "epnp")
"""Estimators whose line styles do not depend on which others are drawn."""
_BOUND: dict[str, Any] = {"color": INK, "linestyle": (0, (2, 1.5)), "linewidth": 1.8, "zorder": 4}
_MOST_ERRORS = 800
"""Maximum number of single errors drawn in a plot, at equal strides: each is a mark in the page."""
QUANTILE_95 = float(np.sqrt(-2 * np.log(0.05)))
"""Radius in standard deviations of the ellipse that contains 95 % of a bivariate Gaussian."""
_MOST_IN_ELLIPSE = 1200
"""Maximum number of measured errors drawn in an ellipse, at equal strides."""
_AROUND = np.linspace(0, 2 * np.pi, 121)
LOOKS: dict[str, dict[str, Any]] = {
    "image": {"facecolor": "#9dc3e6", "hatch": ""},
    "print": {"facecolor": "#f4b183", "hatch": "////"},
    "camera": {"facecolor": "#c5e0b4", "hatch": "\\\\\\\\"},
}
LEAST = 2000.0
"""Factor below the largest error at which smaller sources are omitted."""
_LINES: dict[str, dict[str, Any]] = {
    "image": {"color": "#0b5394", "linestyle": "--", "marker": "s"},
    "print": {"color": "#c55a11", "linestyle": "-.", "marker": "^"},
    "camera": {"color": "#5b8c2a", "linestyle": ":", "marker": "D"},
    "total": {"color": "#c4c4c4", "linestyle": "-", "marker": "", "linewidth": 7.0, "zorder": 1},
}


def name_of(estimator: str) -> str:
    """Display name of an estimator."""
    return TITLES.get(estimator, estimator)


def series(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Line style of each estimator, the same in every plot of a page; styles repeat if there are too few."""
    ordered = [*FIRST, *sorted({*names}.difference(FIRST))]
    return {name: dict(SERIES[ordered.index(name) % len(SERIES)]) for name in names}


def errors_over(
    measured: Mapping[str, Mapping[str, Statistics]],
    bound: Mapping[str, float],
    ax: "Axes",
    samples: tuple[Array, Array] | None = None,
    bound_name: str = "bound (CRLB)",
) -> "Axes":
    """Draw the RMS of each estimator over groups of poses, with the band from median to 95th percentile of the best.

    Parameters
    ----------
    measured : mapping
        STATS by estimator and group (a number such as ``35``, or a bin such as ``30..40``).
    bound : mapping
        RMS of the bound by group.
    samples : arrays (k,) and (k,), or None
        Single errors to show as dots: positions and values.
    """
    best = next((name for name in BEST if name in measured), None)
    if samples is not None and len(samples[0]):
        every = max(1, -(-len(samples[0]) // _MOST_ERRORS))
        kept = samples[1][::every] > 0
        ax.scatter(
            samples[0][::every][kept], samples[1][::every][kept], s=12, facecolors="none", edgecolors="#8a8a8a",
            linewidths=0.6, zorder=2, label="single views",
        )  # fmt: skip
    if best:
        groups = sorted(measured[best], key=middle)
        x = [middle(group) for group in groups]
        low, high = ([positive(measured[best][group].get(key)) for group in groups] for key in ("median", "p95"))
        ax.fill_between(
            x, low, high, facecolor="#dfe9f3", edgecolor="#9bb7d3", linewidth=0.6, hatch="////", zorder=1,
            label=f"{name_of(best)}: median to 95 %",
        )  # fmt: skip
    for name, look in series(list(measured)).items():
        groups = sorted(measured[name], key=middle)
        y = [positive(measured[name][group].get("rms")) for group in groups]
        ax.plot([middle(group) for group in groups], y, label=f"{name_of(name)}, RMS", zorder=3, **look)
    groups = sorted(bound, key=middle)
    if groups:
        marks: dict[str, Any] = {"marker": "_"} if len(groups) == 1 else {}
        ax.plot(
            [middle(group) for group in groups],
            [positive(bound[group]) for group in groups],
            label=bound_name,
            **_BOUND,
            **marks,
        )
    log_axis(ax, "y")
    legend_below(ax)
    return ax


def distribution(
    predicted: Array | None,
    measured: Mapping[str, tuple[Array, Array]],
    ax: "Axes",
    marks: Mapping[str, Statistics] | None = None,
    predicted_name: str = "bound (CRLB)",
) -> "Axes":
    """Draw cumulative distributions: the share of errors below each value.

    Parameters
    ----------
    predicted : array (k,) or None
        Errors that the covariance predicts.
    measured : mapping
        By estimator: errors in ascending order, and the share (0 to 1) at or below each.
    marks : mapping or None
        STATS by estimator, whose median and 95th percentile are marked.
    """
    for share in (0.5, 0.95):
        ax.axhline(100 * share, color=FAINT, linewidth=0.8, zorder=0)
    looks = series([*measured, *(marks or {})])
    for name, (values, below) in measured.items():
        kept = values > 0
        look = {key: value for key, value in looks[name].items() if key != "marker"}
        drawstyle = "steps-post" if len(values) <= _MOST_ERRORS else "default"
        ax.plot(values[kept], 100 * below[kept], drawstyle=drawstyle, label=name_of(name), zorder=3, **look)
    for name, row in (marks or {}).items():
        at = [(row.get(key), share) for key, share in (("median", 50), ("p95", 95))]
        points = np.array([(value, share) for value, share in at if value], dtype=float).reshape(-1, 2)
        ax.plot(
            *points.T, linestyle="none", marker=looks[name]["marker"], color=looks[name]["color"], markersize=7,
            markerfacecolor="none", markeredgewidth=1.4,
            label=f"{name_of(name)}: median, 95 %", zorder=5,
        )  # fmt: skip
    if predicted is not None and len(predicted):
        quantiles = np.linspace(0.005, 0.995, 199)
        ax.plot(np.quantile(predicted, quantiles), 100 * quantiles, label=predicted_name, **_BOUND)
    log_axis(ax, "x")
    ax.set_ylim(0, 100)
    ax.set_ylabel("share of errors below, %")
    legend_below(ax)
    return ax


@dataclass(frozen=True, eq=False)
class Ellipse:
    """A predicted covariance (2, 2) with its name, and errors (k, 2) measured under it, in the unit of the axes."""

    name: str
    covariance: Array
    errors: Array


def draw_ellipses(ellipses: list[Ellipse], ax: "Axes") -> "Axes":
    """Draw the 95 % ellipses around the truth with different dashes, and the measured errors as marks."""
    reach = np.zeros(2)
    for item, look in zip(ellipses, SERIES, strict=False):
        outline = ellipse(item.covariance)
        errors = item.errors[:: max(1, -(-len(item.errors) // _MOST_IN_ELLIPSE))]
        style: dict[str, Any] = {key: look[key] for key in ("color", "linestyle")}
        ax.plot(*outline.T, label=item.name, linewidth=1.8, zorder=3, **style)
        if len(errors):
            ax.plot(
                *errors.T, linestyle="none", marker=look["marker"], markersize=3.5, markerfacecolor="none",
                markeredgecolor=look["color"], markeredgewidth=0.7, zorder=2,
            )  # fmt: skip
        reach = np.max([reach, np.abs(outline).max(axis=0), *np.abs(errors)], axis=0)
    ax.axhline(0, color=INK, linewidth=0.5, zorder=1)
    ax.axvline(0, color=INK, linewidth=0.5, zorder=1)
    reach = np.where(reach > 0, 1.08 * reach, 1.0)
    # Equal units on both axes, unless the narrower one would degenerate to a line.
    if reach.max() < 4 * reach.min():
        reach[:] = reach.max()
        ax.set_aspect("equal")
    ax.set_xlim(-reach[0], reach[0])
    ax.set_ylim(-reach[1], reach[1])
    ax.locator_params(nbins=5)
    legend_below(ax)
    return ax


def ellipse(covariance: Array) -> Array:
    """Outline (m, 2) of the 95 % region of a covariance (2, 2)."""
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=-1)
    return np.asarray(QUANTILE_95 * circle * np.sqrt(np.maximum(values, 0)) @ vectors.T)


def share_inside(errors: Array, covariance: Array) -> float:
    """Share of errors (k, 2) inside the 95 % ellipse of a covariance (2, 2)."""
    squared = np.sum(errors * np.linalg.solve(covariance, errors.T).T, axis=-1)
    return float(np.mean(squared <= QUANTILE_95**2))


def variance_shares(budget: Mapping[str, Any], ax: "Axes") -> "Axes":
    """Draw each source's share of the variance of rotation and translation as stacked bars."""
    rows = {"rotation": shares(budget, "rotation_deg"), "translation": shares(budget, "translation_pct")}
    for y, parts in enumerate(rows.values()):
        left = 0.0
        for name, look in LOOKS.items():
            share = parts.get(name, 0.0)
            ax.barh(y, 100 * share, left=left, height=0.6, edgecolor=INK, linewidth=0.7, label=SOURCES[name], **look)
            if share >= 0.07:
                box = {"facecolor": "#ffffff", "edgecolor": "none", "pad": 1.5}
                ax.text(left + 50 * share, y, percent(share), ha="center", va="center_baseline", bbox=box)
            left += 100 * share
    ax.set_yticks(range(len(rows)), list(rows))
    ax.set_ylim(1.5, -0.5)
    ax.set_xlim(0, 100)
    ax.set_xlabel("share of the variance, %")
    ax.grid(visible=False)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[:3], labels[:3], loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return ax


def budget_over_tilt(budget: PoseBudget, poses: PoseDistribution, key: str, ax: "Axes") -> "Axes":
    """Draw the RMS of each source, and of the total, over the tilt; key as in the results."""
    parts = budget.rotation_deg if key == "rotation_deg" else budget.translation_pct(poses.translation)
    groups = poses.by_polar_angle()
    curves = {
        name: np.array([positive(rms(parts[name][mask])) for mask in groups.values()])
        for name in _LINES
        if name in parts
    }
    for name, values in curves.items():
        if not np.isnan(values).all():
            ax.plot([middle(group) for group in groups], values, label=SOURCES[name], **_LINES[name])
    # A source may vanish at some tilt and then leaves the plot at the bottom.
    every = np.concatenate(list(curves.values()))
    top = float(np.nanmax(every, initial=0.0)) or 1.0
    ax.set_ylim(float(np.min(every[every > top / LEAST], initial=top)) / 1.5, 1.5 * top)
    log_axis(ax, "y")
    legend_below(ax)
    return ax


def compared(bounds: Mapping[str, float], measured: Mapping[str, float | None], ax: "Axes") -> "Axes":
    """Draw the bound of each layout as a bar, the first one dark, with the measured value as a mark beside it."""
    finite = {name: value if np.isfinite(value) else 0.0 for name, value in bounds.items()}
    for y, (name, value) in enumerate(bounds.items()):
        look: dict[str, Any] = {"facecolor": "#d9e2ec", "hatch": "///"} if y else {"facecolor": "#0b5394", "hatch": ""}
        ax.barh(y, finite[name], height=0.6, edgecolor=INK, linewidth=0.7, **look)
        ahead = max(finite[name], measured.get(name) or 0.0)
        ax.annotate(value_text(value), (ahead, y), (8, 0), textcoords="offset points", va="center_baseline")
    marks = {y: mark for y, name in enumerate(bounds) if (mark := measured.get(name))}
    if marks:
        ax.plot(
            list(marks.values()), list(marks), linestyle="none", marker="D", markersize=7, markerfacecolor="#ffffff",
            markeredgecolor=INK, label="measured (LM)",
        )  # fmt: skip
        ax.legend(loc="lower right", bbox_to_anchor=(1, 1))
    ax.set_yticks(range(len(bounds)), list(bounds))
    ax.set_ylim(len(bounds) - 0.4, -0.6)
    ax.set_xlim(0, 1.18 * max([*finite.values(), *marks.values(), 1e-12]))
    ax.grid(visible=False, axis="y")
    return ax


UNITS = {"rotation": "deg", "translation": "mm"}
_ELEVATION, _AZIMUTH = np.deg2rad([24.0, -60.0])
"""Viewing direction of the sphere."""
_MOST_POSES, _MOST_TO_TURN = 1500, 4000
"""Maximum number of poses in a still picture and in a dome to turn, taken at equal strides."""


def dome_plots(
    markers: Sequence[Plate],
    poses: PoseDistribution,
    errors: Mapping[str, Array],
    source: str,
    descriptions: Sequence[str] = (),
) -> list[Plot]:
    """Draw the camera positions and the errors expected there: to turn, and as stills.

    Parameters
    ----------
    markers : sequence of Plate
        What the cameras look at; a single marker stands in its own frame.
    errors : mapping of str to array (P,)
        RMS ``rotation`` in deg and ``translation`` in mm; not finite where nothing is known.
    source : str
        Sources of the errors, in words.
    descriptions : sequence of str
        More about each pose.
    """
    around = 2 * np.pi * np.arange(24) / 24
    circle = np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1) / 2
    outlines, dots, faces = [], [], []
    # The farthest first; of what shows its back, only the outline, and only in the picture to turn.
    for plate in sorted(markers, key=lambda plate: _seen(plate.translation_vector)[2]):
        normal = plate.rotation_matrix[:, 2]
        rings = [plate.to_body(np.pad(ring, ((0, 0), (0, 1)))) for ring in plate.marker.boundary.outlines()]
        sizes = [point.feature.diameter for point in plate.marker.control_points]
        places = plate.to_body(plate.marker.xyz)
        outlines += rings
        dots += [
            {**dict(zip("xyz", place, strict=True)), "diameter": size, "normal": normal.round(5).tolist()}
            for place, size in zip(places.round(5).tolist(), sizes, strict=True)
        ]
        if _seen(normal)[2] > 0:
            rotated = circle @ plate.rotation_matrix.T
            faces.append((rings, [place + size * rotated for place, size in zip(places, sizes, strict=True)]))
    centers = eyes_of(poses)
    hardest = [int(np.argmax(np.nan_to_num(values, posinf=-1))) for values in errors.values()]
    every = -(-len(centers) // _MOST_TO_TURN)
    kept = np.union1d(np.arange(0, len(centers), every), hardest) if every > 1 else np.arange(len(centers))
    figures = [
        dome_figure(
            centers[kept],
            {name: values[kept] for name, values in errors.items()},
            outlines,
            dots,
            f"Each mark is a camera: {len(kept)} {f'of {len(poses)} ' if every > 1 else ''}poses, with {source}. Drag, "
            "or use the arrow keys, to turn; click a camera, or move the slider, to read its errors.",
            [descriptions[k] for k in kept.tolist()] if descriptions else (),
        )
    ]
    for name, values in errors.items():
        finite = values[np.isfinite(values)]
        low, high = (value_text(float(end), 2) for end in (finite.min(initial=np.inf), finite.max(initial=-np.inf)))
        unit = UNITS[name]
        figures.append(
            plot(
                partial(pose_sphere, faces, centers, values, f"RMS {name} error, {unit}"),
                f"sphere-{name}",
                f"Camera positions, stronger in color where the {name} error is larger: {low} to {high} {unit}.",
                f"Each mark is a camera, with {source}. The stronger its color, the larger the {name} error.",
                (4.9, 3.2),
                "still",
            )
        )
    return figures


def pose_sphere(
    faces: Sequence[tuple[list[Array], list[Array]]], centers: Array, values: Array, label: str, ax: "Axes"
) -> "Axes":
    """Draw camera centers (P, 3) around an object in an oblique view, darker and on top for larger values (P,).

    The object's faces are drawn in their order: outlines and dots, points (m, 3) each.
    """
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.patches import Polygon

    distance = np.linalg.norm(centers, axis=1)
    tilt = np.rad2deg(np.arccos(np.clip(centers[:, 2] / distance, -1, 1)))
    for circle in _sphere(float(distance.max()), max(float(tilt.max()), 10.0)):
        ax.plot(*_seen(circle)[:, :2].T, color=FAINT, linewidth=0.7, zorder=1)
    for rings, dots in faces:
        for part, color in [*((ring, "#ffffff") for ring in rings), *((dot, INK) for dot in dots)]:
            ax.add_patch(Polygon(_seen(part)[:, :2], facecolor=color, edgecolor=INK, linewidth=0.7, zorder=2))

    chosen = np.flatnonzero(np.isfinite(values))
    chosen = chosen[:: max(1, -(-len(chosen) // _MOST_POSES))]
    if len(chosen):
        spots = _seen(centers[chosen])
        errors = values[chosen]
        spread = errors.min() > 0 and errors.max() > 1.001 * errors.min()
        norm = LogNorm(errors.min(), errors.max()) if spread else Normalize(0, max(float(errors.max()), 1e-12))
        # Marks of one size are written as references to one path.
        order = np.argsort(errors, kind="stable")
        points = ax.scatter(
            spots[order, 0], spots[order, 1], c=errors[order], s=20, cmap=color_steps(COLORS), norm=norm,
            edgecolors=INK, linewidths=0.5, zorder=4,
        )  # fmt: skip
        bar = ax.figure.colorbar(points, ax=ax, shrink=0.75, pad=0.02, aspect=28)
        bar.set_label(label)
        if spread:
            labels = _plain_numbers(float(errors.min()), float(errors.max()))
            bar.set_ticks(labels, labels=[f"{tick:g}" for tick in labels])
            bar.minorticks_off()
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def _seen(points: Array) -> Array:
    """Oblique parallel projection (..., 3) of points (..., 3): right, up, and toward the viewer."""
    x, y, z = np.moveaxis(points, -1, 0)
    right = -np.sin(_AZIMUTH) * x + np.cos(_AZIMUTH) * y
    away = np.cos(_AZIMUTH) * x + np.sin(_AZIMUTH) * y
    up = np.cos(_ELEVATION) * z - np.sin(_ELEVATION) * away
    return np.stack([right, up, np.sin(_ELEVATION) * z + np.cos(_ELEVATION) * away], axis=-1)


def _sphere(distance: float, steepest_deg: float) -> list[Array]:
    """Parallels and meridians (m, 3) of the cap down to the steepest tilt."""
    around = np.linspace(0, 2 * np.pi, 121)
    down = np.deg2rad(np.linspace(0, steepest_deg, 40))
    rings = [_direction(np.full_like(around, np.deg2rad(steepest_deg * part)), around) for part in (1 / 3, 2 / 3, 1)]
    meridians = [_direction(down, np.full_like(down, angle)) for angle in 2 * np.pi * np.arange(12) / 12]
    return [distance * line for line in rings + meridians]


def _direction(polar: Array, azimuth: Array) -> Array:
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)


def _plain_numbers(low: float, high: float) -> list[float]:
    """Round numbers between two values, or the two if there are none."""
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    steps = [float(f"{step}e{power}") for power in powers for step in ticks(low, high)]
    return [tick for tick in steps if low <= tick <= high] or [float(f"{low:.2g}"), float(f"{high:.2g}")]
