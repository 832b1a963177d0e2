"""Where the camera stands, and what to expect there."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.presentation.plots import FAINT, INK, MUTED, ticks
from markergen.validation.report.expected import Cell, interval, middle
from markergen.validation.report.words import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

COLORS = "YlOrBr"
"""From light to dark without a turn, so that it stays in order in shades of grey."""
_ELEVATION, _AZIMUTH = np.deg2rad([24.0, -60.0])
"""From where the sphere is looked at."""
_MOST_DRAWN = 1500
"""Poses in one drawing; of more, every so many-th."""


def camera_centers(poses: PoseDistribution) -> Array:
    """Centers (P, 3) of the cameras in the marker frame, m: -R' t."""
    return -np.einsum("pij,pi->pj", poses.rotation, poses.translation)


def pose_sphere(marker: Marker, poses: PoseDistribution, values: Array, label: str, ax: "Axes") -> "Axes":
    """Draw the camera centers around the marker in an oblique view, darker and larger as the value (P,) is larger."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.patches import Polygon

    for circle in _sphere(float(poses.distance.max()), max(float(poses.polar_angle_deg.max()), 10.0)):
        ax.plot(*_seen(circle)[:, :2].T, color=FAINT, linewidth=0.7, zorder=1)
    for ring in marker.boundary.outlines():
        outline = _seen(np.pad(ring, ((0, 0), (0, 1))))[:, :2]
        ax.add_patch(Polygon(outline, facecolor="#ffffff", edgecolor=INK, zorder=2))
    around = 2 * np.pi * np.arange(40) / 40
    for point in marker.control_points:
        dot = point.feature.diameter / 2 * np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1)
        ax.add_patch(Polygon(_seen(dot + [point.x, point.y, point.z])[:, :2], facecolor=INK, zorder=3))

    chosen = np.flatnonzero(np.isfinite(values))
    chosen = chosen[:: max(1, -(-len(chosen) // _MOST_DRAWN))]
    if len(chosen):
        spots = _seen(camera_centers(poses)[chosen])
        shown = values[chosen]
        spread = shown.min() > 0 and shown.max() > 1.001 * shown.min()
        norm = LogNorm(shown.min(), shown.max()) if spread else Normalize(0, max(float(shown.max()), 1e-12))
        order = np.argsort(spots[:, 2])
        points = ax.scatter(
            spots[order, 0], spots[order, 1], c=shown[order], s=14 + 60 * np.asarray(norm(shown[order]), dtype=float),
            cmap=COLORS, norm=norm, edgecolors=INK, linewidths=0.5, zorder=4,
        )  # fmt: skip
        bar = ax.figure.colorbar(points, ax=ax, shrink=0.75, pad=0.02, aspect=28)
        bar.set_label(label)
        if spread:
            labels = _ticks(float(shown.min()), float(shown.max()))
            bar.set_ticks(labels, labels=[f"{tick:g}" for tick in labels])
            bar.minorticks_off()
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def fan(cells: list[Cell], values: list[float], radius: float, ax: "Axes") -> "Axes":
    """Draw distance and tilt as a fan around the marker, with the value of every cell that has room for it.

    The fan is a section through the sphere: up is frontal, the distance from its tip is the camera's, in m. The marker,
    of that radius in m, is at the tip.
    """
    import matplotlib
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Wedge

    finite = [value for value in values if np.isfinite(value) and value > 0] or [1.0]
    norm = LogNorm(min(finite), 1.0001 * max(finite))
    colors = matplotlib.colormaps[COLORS]
    distances = sorted({cell.distance for cell in cells}, key=middle)
    tilts = sorted({cell.tilt for cell in cells}, key=middle)
    rays = {name: np.maximum(interval(name, distances), 0.0) for name in distances}
    angles = {name: np.deg2rad(_within(interval(name, tilts), middle(name))) for name in tilts}
    reach = max(float(far) for _, far in rays.values())
    first, last = angles[tilts[0]][0], angles[tilts[-1]][1]
    for cell, value in zip(cells, values, strict=True):
        (near, far), (low, high) = rays[cell.distance], angles[cell.tilt]
        share = float(np.clip(norm(value), 0, 1)) if np.isfinite(value) and value > 0 else 1.0
        # The lightest colors look like nothing on paper, the darkest swallow the text.
        face = colors(0.06 + 0.8 * share)
        ends = 90 - np.rad2deg([high, low])
        ax.add_patch(Wedge((0, 0), far, *ends, width=far - near, facecolor=face, edgecolor=MUTED, linewidth=0.5))
        text, angle, ray = number(value, 2), (low + high) / 2, (near + far) / 2
        if _has_room(text, angle, ray * (high - low), far - near, reach):
            dark = np.dot(face[:3], (0.299, 0.587, 0.114)) < 0.55
            _write(ax, text, ray, angle, color="#ffffff" if dark else INK, fontsize=8)
    for name in tilts:
        angle = np.deg2rad(middle(name))
        _write(ax, f"{name}°", 1.06 * reach, angle, va="center", rotation=-np.rad2deg(angle), color=MUTED, fontsize=8.5)
    for name in distances:
        place = (middle(name) * np.sin(first) - 0.03 * reach, middle(name) * np.cos(first))
        ax.text(*place, f"{name} m", ha="right", va="center", color=MUTED, fontsize=8.5)
    ax.plot([-radius, radius], [0, 0], color=INK, linewidth=3, solid_capstyle="butt")
    ax.text(radius + 0.03 * reach, 0, "marker", ha="left", va="center", color=MUTED, fontsize=8.5)
    left = min(0.0, float(reach * np.sin(first))) - 0.22 * reach
    ax.set_xlim(min(left, -1.1 * radius), reach * np.sin(last) + 0.08 * reach)
    ax.set_ylim(-0.04 * reach, 1.1 * reach)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def _within(ends: tuple[float, float], center: float) -> tuple[float, float]:
    """Tilts from 0 to 90 degrees; what is centered on 0 reaches as far to the other side."""
    return (ends[0] if center == 0 else max(ends[0], 0.0)), min(ends[1], 90.0)


def _has_room(text: str, angle: float, across: float, along: float, reach: float) -> bool:
    """Tell whether an upright text fits into a cell, which is so wide across and along the ray at that angle."""
    # In 8 points a letter is 0.018 of the reach wide, and a line 0.04 high.
    width, height = 0.018 * reach * len(text), 0.04 * reach
    cos, sin = abs(np.cos(angle)), abs(np.sin(angle))
    return bool(width * cos + height * sin < across and width * sin + height * cos < along)


def _write(ax: "Axes", text: str, ray: float, angle: float, **look: Any) -> None:
    look = {"ha": "center", "va": "center_baseline", **look}
    ax.text(float(ray * np.sin(angle)), float(ray * np.cos(angle)), text, **look)


def _seen(points: Array) -> Array:
    """Oblique parallel projection (..., 3) of points (..., 3): right, up, and toward the reader."""
    x, y, z = np.moveaxis(points, -1, 0)
    right = -np.sin(_AZIMUTH) * x + np.cos(_AZIMUTH) * y
    away = np.cos(_AZIMUTH) * x + np.sin(_AZIMUTH) * y
    up = np.cos(_ELEVATION) * z - np.sin(_ELEVATION) * away
    return np.stack([right, up, np.sin(_ELEVATION) * z + np.cos(_ELEVATION) * away], axis=-1)


def _sphere(distance: float, steepest_deg: float) -> list[Array]:
    """Circles of latitude and meridians (m, 3) of the cap that reaches down to the steepest tilt."""
    around = np.linspace(0, 2 * np.pi, 121)
    down = np.deg2rad(np.linspace(0, steepest_deg, 40))
    rings = [_direction(np.full_like(around, np.deg2rad(steepest_deg * part)), around) for part in (1 / 3, 2 / 3, 1)]
    meridians = [_direction(down, np.full_like(down, angle)) for angle in 2 * np.pi * np.arange(12) / 12]
    return [distance * line for line in rings + meridians]


def _direction(polar: Array, azimuth: Array) -> Array:
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)


def _ticks(low: float, high: float) -> list[float]:
    """Plain numbers between two values; where there are none, the two."""
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    found = [float(f"{step}e{power}") for power in powers for step in ticks(low, high)]
    return [tick for tick in found if low <= tick <= high] or [float(f"{low:.2g}"), float(f"{high:.2g}")]
