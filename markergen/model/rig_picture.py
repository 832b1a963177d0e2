"""Picture of a rig: its plates with their dots, seen from far away; not a sheet to print."""

from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.model.occlusion import painting_levels
from markergen.presentation.plots import INK, MUTED, axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.model.rig import Rig


FAR = 1e3
"""Distance of the eye, in radii of the rig: its lines of sight are as good as parallel."""

_AROUND = 2 * np.pi * np.arange(64) / 64
_DARK, _PAPER, _BACK = "#111111", "#ffffff", "#e4e4e4"


def sides(rig: "Rig") -> dict[str, Array]:
    """Return directions (3,) from which to draw a rig: its front, and its back if that shows a marker."""
    normals = np.array([plate.rotation_matrix[:, 2] for plate in rig.markers])
    front = 3 * normals.mean(axis=0) + [0.6, -0.9, 0.6]
    return {"front": front, **({"back": -front} if (normals @ front < -0.1 * np.linalg.norm(front)).any() else {})}


def draw_rig(rig: "Rig", direction: Array | None = None, ax: "Axes | None" = None) -> "Axes":
    """Draw the plates with their names and dots, and the frame's axes, in mm, seen from far away in a direction.

    Without given axes, those of a new figure without a window; without a direction, the front.
    """
    from matplotlib.patches import Polygon

    ax = axes_of(ax, (4.8, 4.8))
    direction = sides(rig)["front"] if direction is None else direction
    toward = np.array(direction) / np.linalg.norm(direction)
    up = np.eye(3)[1 if abs(toward[2]) > 0.9 else 2]
    right = np.cross(up, toward) / np.linalg.norm(np.cross(up, toward))
    screen = 1e3 * np.stack([right, np.cross(toward, right)], axis=1)
    for k in (k for level in painting_levels(rig, FAR * rig.radius * toward) for k in level):
        plate, facing = rig.markers[k], rig.markers[k].rotation_matrix[:, 2] @ toward > 0
        dark, paper = (_PAPER, _DARK) if plate.marker.light else (_DARK, _PAPER)
        for ring in rig.plate_regions[k].rings:
            face = plate.to_body(np.column_stack([ring, np.zeros(len(ring))])) @ screen
            ax.add_patch(Polygon(face, facecolor=paper if facing else _BACK, edgecolor=MUTED, linewidth=0.8))
        if not facing:
            continue
        for point, center in zip(plate.marker.control_points, plate.marker.xyz, strict=True):
            for diameter, color in ((point.feature.diameter, dark), (point.feature.inner_diameter, paper)):
                circle = diameter / 2 * np.stack([np.cos(_AROUND), np.sin(_AROUND), 0 * _AROUND], axis=-1)
                if diameter:
                    ax.add_patch(Polygon(plate.to_body(center + circle) @ screen, facecolor=color, edgecolor="none"))
        x, y = plate.to_body(_room(rig, k)) @ screen
        box = {"facecolor": _PAPER, "edgecolor": MUTED, "linewidth": 0.5, "pad": 1.5, "alpha": 0.85}
        ax.text(x, y, plate.name, color=INK, ha="center", va="center", fontsize=8, bbox=box)
    outlines = np.concatenate([rig.outline(k) for k in range(len(rig.markers))])
    for axis, name in enumerate("xyz"):
        start = max(float(outlines[:, axis].max()), 0.0) + 0.05 * rig.radius
        tail, head, text = ((start + length * rig.radius) * np.eye(3)[axis] @ screen for length in (0, 0.3, 0.36))
        # Those that point away are behind the plates.
        over = 4 if toward[axis] > 0 else 0
        arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", head, tail, arrowprops=arrow, zorder=over)
        ax.text(text[0], text[1], name, ha="center", va="center", style="italic", zorder=over)
        ax.update_datalim([text])
    ax.margins(0.05)
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def _room(rig: "Rig", index: int) -> Array:
    """Return the place (3,) on a plate, in its marker's frame, that is farthest from its edge and its dots."""
    marker, plate = rig.markers[index].marker, rig.plate_regions[index]
    left, low, right, high = plate.box
    x, y = np.meshgrid(np.linspace(left, right, 25), np.linspace(low, high, 25))
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    apart = np.linalg.norm(places[:, None] - marker.xyz[:, :2], axis=-1) - rig.radii[rig.owner == index]
    best = places[np.minimum(plate.depth(places), apart.min(axis=-1)).argmax()]
    return np.array([*best, 0.0])
