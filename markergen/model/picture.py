"""Pictures of a body, none of them a sheet to print: a marker, small for notebooks or to scale; a rig from far away."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.model.boundary import Boundary
from markergen.model.occlusion import painting_levels
from markergen.presentation.plots import INK, MUTED, axes_of
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

    from markergen.model.marker import ControlPoint, Marker
    from markergen.model.rig import Rig


WIDTH = 360
"""Width of the notebook picture in CSS px."""

FAR = 1e3
"""Distance of the eye from a rig, in its radii: its lines of sight are as good as parallel."""

_AROUND = 2 * np.pi * np.arange(64) / 64
_DARK, _PAPER, _TAKEN, _BACK = "#111111", "#ffffff", "#d9d9d9", "#e4e4e4"
"""Colors of plots: dots, paper, keep-outs, and the back of a plate."""


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


def sides(rig: "Rig") -> dict[str, Array]:
    """Return directions (3,) from which to draw a rig: its front, and its back if that shows a marker."""
    normals = np.array([plate.rotation_matrix[:, 2] for plate in rig.markers])
    front = 3 * normals.mean(axis=0) + [0.6, -0.9, 0.6]
    return {"front": front, **({"back": -front} if (normals @ front < -0.1 * np.linalg.norm(front)).any() else {})}


def draw_rig(rig: "Rig", ax: "Axes | None" = None, direction: Array | None = None) -> "Axes":
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
        x, y = plate.to_body(_free_place(rig, k)) @ screen
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


def _free_place(rig: "Rig", index: int) -> Array:
    """Return the place (3,) on a plate, in its marker's frame, that is farthest from its edge and its dots."""
    marker, plate = rig.markers[index].marker, rig.plate_regions[index]
    left, low, right, high = plate.box
    x, y = np.meshgrid(np.linspace(left, right, 25), np.linspace(low, high, 25))
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    apart = np.linalg.norm(places[:, None] - marker.xyz[:, :2], axis=-1) - rig.radii[rig.owner == index]
    best = places[np.minimum(plate.depth(places), apart.min(axis=-1)).argmax()]
    return np.array([*best, 0.0])
