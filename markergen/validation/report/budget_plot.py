"""What the error is made of."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.estimators.budget import PoseBudget
from markergen.model.poses import PoseDistribution
from markergen.presentation.plots import INK, legend_below, log_axis, positive
from markergen.presentation.tables import percent
from markergen.validation.report.expected import SOURCES, middle, rms
from markergen.validation.report.words import shares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOKS: dict[str, dict[str, Any]] = {
    "image": {"facecolor": "#9dc3e6", "hatch": ""},
    "print": {"facecolor": "#f4b183", "hatch": "////"},
    "camera": {"facecolor": "#c5e0b4", "hatch": "...."},
}
LEAST = 2000.0
"""Sources smaller than the largest error by more than this factor are of no interest."""
_LINES: dict[str, dict[str, Any]] = {
    "image": {"color": "#0b5394", "linestyle": "--", "marker": "s"},
    "print": {"color": "#c55a11", "linestyle": "-.", "marker": "^"},
    "camera": {"color": "#5b8c2a", "linestyle": ":", "marker": "D"},
    "total": {"color": "#c4c4c4", "linestyle": "-", "marker": "", "linewidth": 7.0, "zorder": 1},
}


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
    """Draw the RMS of each source, and of all together, over the tilt; key as in the results."""
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
    # A source may come to nothing at some tilt; it then leaves the plot below.
    every = np.concatenate(list(curves.values()))
    top = float(np.nanmax(every, initial=0.0)) or 1.0
    ax.set_ylim(float(np.min(every[every > top / LEAST], initial=top)) / 1.5, 1.5 * top)
    log_axis(ax, "y")
    legend_below(ax)
    return ax
