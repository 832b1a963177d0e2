"""The marker, to scale."""

from typing import TYPE_CHECKING

import numpy as np

from markergen.model.boundary import Boundary
from markergen.model.marker import ControlPoint, Marker
from markergen.units import format_length
from markergen.validation.figures import axes_of
from markergen.validation.report.page import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

_DARK, _PAPER, _TAKEN = "#111111", "#ffffff", "#d9d9d9"


def draw_marker(marker: Marker, ax: "Axes | None" = None) -> "Axes":
    """Draw boundary, keep-outs, dots with their ids, frame axes, and dimensions; all in mm of the marker plane.

    Without axes those of a new figure are drawn into, which no window belongs to.
    """
    from matplotlib.patches import Circle, PathPatch

    ax = axes_of(ax, (4.8, 4.8))
    radius = 1e3 * marker.boundary.radius
    rim = 1e3 * np.concatenate(marker.boundary.outlines())
    plate = ax.add_patch(PathPatch(_path(marker.boundary), facecolor=_PAPER, edgecolor=INK, linewidth=1.0))
    for keep_out in marker.keep_outs:
        taken = PathPatch(_path(keep_out), facecolor=_TAKEN, edgecolor=MUTED, linewidth=0.7)
        ax.add_patch(taken).set_clip_path(plate)
    for point in marker.control_points:
        center = (1e3 * point.x, 1e3 * point.y)
        outer, inner = (5e2 * size for size in (point.feature.diameter, point.feature.inner_diameter))
        if outer:
            ax.add_patch(Circle(center, outer, facecolor=_DARK, edgecolor="none"))
        else:
            ax.plot(*center, marker="+", color=_DARK, markersize=7)
        if inner:
            ax.add_patch(Circle(center, inner, facecolor=_PAPER, edgecolor="none"))
        _name(point, radius, ax)
    if shows_origin(marker):
        _axes(radius, ax)
    low, high = float(rim[:, 0].min()), float(rim[:, 0].max())
    bottom, top = float(rim[:, 1].min()), float(rim[:, 1].max())
    width, height = (format_length(round(size, 6) / 1e3) for size in (high - low, top - bottom))
    text = width if width == height else f"{width} wide, {height} high"
    _dimension(low, high, bottom - 0.13 * radius, text, radius, ax)
    ax.set_xlim(low - 0.12 * radius, high + 0.12 * radius)
    ax.set_ylim(bottom - 0.32 * radius, top + 0.08 * radius)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def shows_origin(marker: Marker) -> bool:
    """Tell whether the marker frame's origin lies beside the outline or within; a kept one may be far away."""
    rim = np.concatenate(marker.boundary.outlines())
    margin = 0.1 * marker.boundary.radius
    return bool(np.all(rim.min(axis=0) - margin <= 0) and np.all(rim.max(axis=0) + margin >= 0))


def _path(boundary: Boundary) -> "Path":
    """All outlines as one path in mm; holes run against what they are cut from, so they stay open."""
    from matplotlib.path import Path

    return Path.make_compound_path(
        *(Path(1e3 * np.concatenate([ring, ring[:1]]), closed=True) for ring in boundary.outlines())
    )


def _name(point: ControlPoint, radius: float, ax: "Axes") -> None:
    """Write the id where it can be read: in the dot's middle if there is room, else beside it."""
    room = 1e3 * (point.feature.inner_diameter or point.feature.diameter)
    x, y, text = 1e3 * point.x, 1e3 * point.y, str(point.id)
    if room > 0.09 * radius * max(len(text), 1):
        color = INK if point.feature.inner_diameter else _PAPER
        ax.text(x, y, text, color=color, ha="center", va="center_baseline", fontsize=9, fontweight="bold")
    else:
        offset = 5e2 * point.feature.diameter + 0.03 * radius
        ax.text(x + offset, y, text, color=INK, ha="left", va="center_baseline", fontsize=9)
    if point.z:
        below = y - 5e2 * point.feature.diameter - 0.03 * radius
        ax.text(x, below, f"z {1e3 * point.z:.4g}", color=MUTED, ha="center", va="top", fontsize=8)


def _axes(radius: float, ax: "Axes") -> None:
    length = 0.3 * radius
    for end, name in (((length, 0), "x"), ((0, length), "y")):
        ax.annotate("", end, (0, 0), arrowprops={"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0})
        ax.text(1.16 * end[0], 1.16 * end[1], name, ha="center", va="center", style="italic")
    # The head of an arrow that comes toward the reader.
    ax.plot(0, 0, marker="o", markersize=8, markerfacecolor=_PAPER, markeredgecolor=INK)
    ax.plot(0, 0, marker="o", markersize=2.5, color=INK)
    ax.text(-0.08 * radius, -0.08 * radius, "z", ha="right", va="top", style="italic")


def _dimension(low: float, high: float, y: float, text: str, radius: float, ax: "Axes") -> None:
    ax.annotate("", (low, y), (high, y), arrowprops={"arrowstyle": "<|-|>", "color": INK, "shrinkA": 0, "shrinkB": 0})
    for x in (low, high):
        ax.plot([x, x], [y - 0.05 * radius, y + 0.13 * radius], color=MUTED, linewidth=0.7)
    ax.text((low + high) / 2, y - 0.04 * radius, text, ha="center", va="top")
