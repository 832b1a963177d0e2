"""Pictures of a marker's layout: a small one for notebooks, and a plot to scale; neither is a sheet to print."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.model.boundary import Boundary
from markergen.presentation.plots import INK, MUTED, axes_of
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

    from markergen.model.marker import ControlPoint, Marker


WIDTH = 360
"""Width of the notebook picture in CSS px."""

_DARK, _PAPER, _TAKEN = "#111111", "#ffffff", "#d9d9d9"
"""Colors of the plot: dots, paper, and keep-outs."""


def svg(marker: "Marker") -> str:
    """Return an SVG of boundary, keep-outs, holes, tag, and dots with their ids, seen along -z of the marker frame."""
    outlines = marker.boundary.outlines()
    corners = np.concatenate(outlines) * 1e3
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    margin = 0.03 * float(size.max())
    # In SVG, y points down.
    box = (low[0] - margin, -(low[1] + size[1]) - margin, size[0] + 2 * margin, size[1] + 2 * margin)
    blocked = [*marker.keep_outs, *marker.substrate.rims]
    parts = [
        _path(outlines, f'fill="{"#000" if marker.light else "none"}" stroke="#888" stroke-width="{margin / 8:.4g}"'),
        _path([ring for region in blocked for ring in region.outlines()], 'fill="#ddd"') if blocked else "",
        _path(marker.tag.outlines, 'fill="#000"') if marker.tag else "",
        *(_dot(point, margin) for point in marker.control_points),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{WIDTH * box[3] / box[2]:.4g}" '
        f'viewBox="{" ".join(f"{value:.6g}" for value in box)}">{"".join(parts)}</svg>'
    )


def _path(rings: Sequence[Array], style: str) -> str:
    steps = "".join("M" + "L".join(f"{1e3 * x:.6g} {-1e3 * y:.6g}" for x, y in ring.tolist()) + "Z" for ring in rings)
    return f'<path fill-rule="evenodd" {style} d="{steps}"/>'


def _dot(point: "ControlPoint", margin: float) -> str:
    x, y = 1e3 * float(point.x), -1e3 * float(point.y)
    outer, inner = 500 * float(point.feature.diameter), 500 * float(point.feature.inner_diameter)
    ink, ground = ("#fff", "#000") if point.feature.polarity == "light" else ("#000", "#fff")
    size = max(0.6 * outer, margin / 2)
    radius = outer or margin / 4
    hole = f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{inner:.6g}" fill="{ground}"/>' if inner else ""
    return (
        f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{radius:.6g}" fill="{ink}" stroke="#000" '
        f'stroke-width="{margin / 20:.4g}"/>{hole}<text x="{x:.6g}" y="{y:.6g}" font-size="{size:.4g}" fill="#d60" '
        f'text-anchor="middle" dominant-baseline="central" font-family="sans-serif">{int(point.id)}</text>'
    )


def draw_marker(marker: "Marker", ax: "Axes | None" = None) -> "Axes":
    """Draw boundary, keep-outs, dots with their ids, frame axes, and dimensions; all in mm in the marker plane.

    Without given axes, those of a new figure without a window.
    """
    from matplotlib.patches import Circle, PathPatch

    ax = axes_of(ax, (4.8, 4.8))
    radius = 1e3 * marker.boundary.radius
    rim = 1e3 * np.concatenate(marker.boundary.outlines())
    paper, dark = (_DARK, _PAPER) if marker.light else (_PAPER, _DARK)
    plate = ax.add_patch(PathPatch(_compound_path(marker.boundary), facecolor=paper, edgecolor=INK, linewidth=1.0))
    for keep_out in marker.keep_outs:
        taken = PathPatch(_compound_path(keep_out), facecolor=_TAKEN, edgecolor=MUTED, linewidth=0.7)
        ax.add_patch(taken).set_clip_path(plate)
    for point in marker.control_points:
        center = (1e3 * point.x, 1e3 * point.y)
        outer, inner = (5e2 * size for size in (point.feature.diameter, point.feature.inner_diameter))
        if outer:
            ax.add_patch(Circle(center, outer, facecolor=dark, edgecolor="none"))
        else:
            ax.plot(*center, marker="+", color=dark, markersize=7)
        if inner:
            ax.add_patch(Circle(center, inner, facecolor=paper, edgecolor="none"))
        _write_id(point, radius, ax)
    if shows_origin(marker):
        _draw_frame(radius, ax)
    low, high = float(rim[:, 0].min()), float(rim[:, 0].max())
    bottom, top = float(rim[:, 1].min()), float(rim[:, 1].max())
    width, height = (format_length(round(size, 6) / 1e3) for size in (high - low, top - bottom))
    text = width if width == height else f"{width} wide, {height} high"
    _draw_dimension(low, high, bottom - 0.13 * radius, text, radius, ax)
    ax.set_xlim(low - 0.12 * radius, high + 0.12 * radius)
    ax.set_ylim(bottom - 0.32 * radius, top + 0.08 * radius)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def shows_origin(marker: "Marker") -> bool:
    """Return whether the marker frame's origin lies in or near the outline; a kept origin may be far away."""
    rim = np.concatenate(marker.boundary.outlines())
    margin = 0.1 * marker.boundary.radius
    return bool(np.all(rim.min(axis=0) - margin <= 0) and np.all(rim.max(axis=0) + margin >= 0))


def _compound_path(boundary: Boundary) -> "Path":
    """Return all outlines as one path in mm; holes run in the opposite direction, so they stay open."""
    from matplotlib.path import Path

    return Path.make_compound_path(
        *(Path(1e3 * np.concatenate([ring, ring[:1]]), closed=True) for ring in boundary.outlines())
    )


def _write_id(point: "ControlPoint", radius: float, ax: "Axes") -> None:
    """Write the id where it is legible: in the dot's middle if there is room, else beside it."""
    room = 1e3 * (point.feature.inner_diameter or point.feature.diameter)
    x, y, text = 1e3 * point.x, 1e3 * point.y, str(point.id)
    if room > 0.09 * radius * max(len(text), 1):
        color = INK if point.feature.inner_diameter else _PAPER
        ax.text(x, y, text, color=color, ha="center", va="center_baseline", fontsize=9, fontweight="bold")
    else:
        offset = 5e2 * point.feature.diameter + 0.03 * radius
        ax.text(x + offset, y, text, color=INK, ha="left", va="center_baseline", fontsize=9)
    # A print of a flat marker is only nearly flat.
    if point.z if point.designed_z is None else point.designed_z:
        below = y - 5e2 * point.feature.diameter - 0.03 * radius
        ax.text(x, below, f"z {1e3 * point.z:.4g}", color=MUTED, ha="center", va="top", fontsize=8)


def _draw_frame(radius: float, ax: "Axes") -> None:
    length = 0.3 * radius
    for end, name in (((length, 0), "x"), ((0, length), "y")):
        ax.annotate("", end, (0, 0), arrowprops={"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0})
        ax.text(1.16 * end[0], 1.16 * end[1], name, ha="center", va="center", style="italic")
    # The head of an arrow that points toward the reader.
    ax.plot(0, 0, marker="o", markersize=8, markerfacecolor=_PAPER, markeredgecolor=INK)
    ax.plot(0, 0, marker="o", markersize=2.5, color=INK)
    ax.text(-0.08 * radius, -0.08 * radius, "z", ha="right", va="top", style="italic")


def _draw_dimension(low: float, high: float, y: float, text: str, radius: float, ax: "Axes") -> None:
    ax.annotate("", (low, y), (high, y), arrowprops={"arrowstyle": "<|-|>", "color": INK, "shrinkA": 0, "shrinkB": 0})
    for x in (low, high):
        ax.plot([x, x], [y - 0.05 * radius, y + 0.13 * radius], color=MUTED, linewidth=0.7)
    ax.text((low + high) / 2, y - 0.04 * radius, text, ha="center", va="top")
