"""Picture of a rig: its plates with their dots, seen from far away; not a sheet to print."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from markergen.model.occlusion import painting_levels
from markergen.presentation.plots import INK, MUTED, axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.model.rig import Rig

Array = NDArray[np.float64]

FAR = 1e3
"""Distance of the eye, in radii of the rig: its lines of sight are as good as parallel."""

_AROUND = 2 * np.pi * np.arange(64) / 64
_DARK, _PAPER, _BACK = "#111111", "#ffffff", "#e4e4e4"


def draw_rig(rig: "Rig", direction: tuple[float, float, float] = (2.0, -3.0, 2.0), ax: "Axes | None" = None) -> "Axes":
    """Draw the plates with their names and dots, and the frame's axes, in mm, seen from far away in a direction.

    Without given axes, those of a new figure without a window.
    """
    from matplotlib.patches import Polygon

    ax = axes_of(ax, (4.8, 4.8))
    toward = np.array(direction) / np.linalg.norm(direction)
    up = np.eye(3)[1 if abs(toward[2]) > 0.9 else 2]
    right = np.cross(up, toward) / np.linalg.norm(np.cross(up, toward))
    screen = 1e3 * np.stack([right, np.cross(toward, right)], axis=1)
    for k in (k for level in painting_levels(rig, FAR * rig.radius * toward) for k in level):
        each, facing = rig.markers[k], rig.markers[k].turn[:, 2] @ toward > 0
        dark, paper = (_PAPER, _DARK) if each.marker.light else (_DARK, _PAPER)
        for ring in rig.plates[k].rings:
            face = each.to_rig(np.column_stack([ring, np.zeros(len(ring))])) @ screen
            ax.add_patch(Polygon(face, facecolor=paper if facing else _BACK, edgecolor=MUTED, linewidth=0.8))
        if not facing:
            continue
        for point, center in zip(each.marker.control_points, each.marker.xyz, strict=True):
            for diameter, color in ((point.feature.diameter, dark), (point.feature.inner_diameter, paper)):
                circle = diameter / 2 * np.stack([np.cos(_AROUND), np.sin(_AROUND), 0 * _AROUND], axis=-1)
                if diameter:
                    ax.add_patch(Polygon(each.to_rig(center + circle) @ screen, facecolor=color, edgecolor="none"))
        middle = each.to_rig(np.zeros(3)) @ screen
        box = {"facecolor": _PAPER, "edgecolor": MUTED, "linewidth": 0.5, "pad": 1.5, "alpha": 0.85}
        ax.text(*middle, each.name, color=INK, ha="center", va="center", fontsize=8, bbox=box)
    for axis, name in enumerate("xyz"):
        start, end = (length * rig.radius * np.eye(3)[axis] @ screen for length in (1.05, 1.35))
        ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0})
        ax.text(*(1.06 * end), name, ha="center", va="center", style="italic")
    reach = 1.5e3 * rig.radius
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax
