"""Errors over tilt and distance, and how they are distributed."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.presentation.plots import FAINT, INK, SERIES, legend_below, log_axis, positive
from markergen.validation.report.expected import middle
from markergen.validation.tables import TITLES
from markergen.validation.view_records import DETECTOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Statistics = Mapping[str, Any]

BEST = (DETECTOR, "lm")
"""Estimators whose quantiles are shown, in order of preference: the one a user gets, then the most accurate."""
DRAWS = 40_000
"""Errors drawn from the covariances for the distribution that the bound predicts."""
_BOUND: dict[str, Any] = {"color": INK, "linestyle": (0, (2, 1.5)), "linewidth": 1.8, "zorder": 4}
_MOST_DRAWN = 800


def name_of(estimator: str) -> str:
    """Name of an estimator for people."""
    return TITLES.get(estimator, estimator)


def series(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Look of each estimator's line, the same in every plot of a page; further ones begin again."""
    ordered = sorted(names, key=lambda name: (name not in BEST, BEST.index(name) if name in BEST else 0, name))
    return {name: dict(SERIES[i % len(SERIES)]) for i, name in enumerate(ordered)}


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
        By estimator and group (a number such as ``35``, or a bin such as ``30..40``): STATS.
    bound : mapping
        RMS of the bound by group.
    samples : arrays (k,) and (k,), or None
        Single errors to show as dots: where, and how large.
    """
    best = next((name for name in BEST if name in measured), None)
    if samples is not None and len(samples[0]):
        every = max(1, -(-len(samples[0]) // _MOST_DRAWN))
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
            [middle(group) for group in groups], [positive(bound[group]) for group in groups],
            label=bound_name, **_BOUND, **marks,
        )  # fmt: skip
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
    """Draw cumulative distributions: the share of errors that stay below a value.

    Parameters
    ----------
    predicted : array (k,) or None
        Errors that the covariance predicts.
    measured : mapping
        By estimator: errors in ascending order, and the share (0 to 1) that lies at or below each.
    marks : mapping or None
        By estimator, STATS: its median and 95th percentile are drawn as marks.
    """
    for share in (0.5, 0.95):
        ax.axhline(100 * share, color=FAINT, linewidth=0.8, zorder=0)
    looks = series([*measured, *(marks or {})])
    for name, (values, shares) in measured.items():
        kept = values > 0
        look = {key: value for key, value in looks[name].items() if key != "marker"}
        drawstyle = "steps-post" if len(values) <= _MOST_DRAWN else "default"
        ax.plot(values[kept], 100 * shares[kept], drawstyle=drawstyle, label=name_of(name), zorder=3, **look)
    for name, row in (marks or {}).items():
        at = [(row.get(key), share) for key, share in (("median", 50), ("p95", 95))]
        shown = np.array([(value, share) for value, share in at if value], dtype=float).reshape(-1, 2)
        ax.plot(
            *shown.T, linestyle="none", marker=looks[name]["marker"], color=looks[name]["color"], markersize=7,
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


def ranked(values: Array) -> tuple[Array, Array]:
    """Values in ascending order, and the share of them at or below each."""
    return np.sort(values), np.arange(1, len(values) + 1) / len(values)


def draw_errors(covariance: Array) -> Array:
    """Pose errors (k, 6) of the poses of covariances (P, 6, 6), as many of each; the same every time."""
    covariance = covariance[np.isfinite(covariance).all(axis=(1, 2))]
    if not len(covariance):
        return np.zeros((0, 6))
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    each = max(1, DRAWS // len(covariance))
    noise = np.random.default_rng(0).standard_normal((len(covariance), each, 6))
    return np.asarray(noise @ root.swapaxes(-1, -2))
