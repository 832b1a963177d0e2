"""Plots of a calibration's report: each function draws on matplotlib axes and returns them."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.calibration.judging import CrossValidation
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.presentation.plots import FAINT, INK, MUTED, SERIES, legend_below, log_axis, positive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HEIGHTS = ("#2f6db5", "#a9c8e8", "#ffffff", "#f4c08a", "#c55a11")
"""Colors from low to high: two hues that color-blind readers tell apart, white between."""
_MOST_IDS = 60
_MOST_VECTORS = 2000
_AROUND = np.linspace(0, 2 * np.pi, 49)
_RINGS = (15, 30, 45, 60, 75)


def round_factor(value: float) -> float:
    """Return the largest of 1, 1.5, 2, 3, 5, 7, 10, 15... that is no more than a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 1.5, 2, 3, 5, 7) if step * power <= value * (1 + 1e-9)))


def enlargement(points: Array, displacement: Array, covariance: Array, size: float) -> float:
    """Return the factor by which displacements (n, 2) are drawn, in the unit of the points (n, 2).

    Nine of ten arrows, with the 2-sigma regions at their tips, are at most as long as the distance to the nearest dot,
    and as a fifth of the size.
    """
    apart = np.linalg.norm(points[:, None] - points, axis=-1) + np.diag(np.full(len(points), np.inf))
    room = min(float(np.median(apart.min(axis=1))), size / 5)
    around = 2 * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
    longest = float(np.quantile(np.linalg.norm(displacement, axis=1) + around, 0.9))
    return round_factor(room / max(longest, 1e-9))


def print_map(
    marker: Marker, ids: list[str], points: Array, displacement: Array, covariance: Array, factor: float, ax: "Axes"
) -> "Axes":
    """Draw displacements on the marker, `factor` times as long as they are, with their 2-sigma ellipses.

    Parameters
    ----------
    points : array (n, 2), mm
        Where the dots were designed.
    displacement : array (n, 3), um
    covariance : array (n, 3, 3), um^2
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.patches import Polygon

    for ring in marker.boundary.outlines():
        ax.add_patch(Polygon(1e3 * ring, facecolor="#fbfbfb", edgecolor=MUTED, linewidth=0.9, zorder=1))
    # Heights that are no larger than their errors stay pale.
    reach = max(float(np.abs(displacement[:, 2]).max()), 3 * float(np.sqrt(covariance[:, 2, 2].max())), 1e-3)
    colors = LinearSegmentedColormap.from_list("heights", _HEIGHTS, N=41)
    norm = Normalize(-reach, reach)
    diameter = {str(point.id): 1e3 * point.feature.diameter for point in marker.control_points}
    rim = 1e3 * np.concatenate(marker.boundary.outlines())
    low, high = rim.min(axis=0), rim.max(axis=0)
    size = float((high - low).max())
    ends = points + 1e-3 * factor * displacement[:, :2]
    # The smallest dots would not show their color.
    radii = np.array([max(diameter[name.rpartition(":")[2]] / 2, size / 120) for name in ids])
    look: dict[str, Any] = {"units": "xy", "offset_transform": ax.transData, "edgecolors": INK, "linewidths": 0.7}
    ax.add_collection(
        EllipseCollection(
            2 * radii,
            2 * radii,
            0 * radii,
            offsets=points,
            facecolors=colors(norm(displacement[:, 2])),
            zorder=2,
            **look,
        )
    )
    if len(ids) <= _MOST_IDS:
        for name, point, radius, moved in zip(ids, points, radii, displacement, strict=True):
            away = -np.sign(moved[1]) or 1.0
            ax.annotate(
                name, point + [0, away * radius], (0, 7 * away), textcoords="offset points", ha="center", va="center",
                fontsize=8, color=MUTED, zorder=6,
            )  # fmt: skip
    values, vectors = np.linalg.eigh(covariance[:, :2, :2])
    axes = 4e-3 * factor * np.sqrt(np.maximum(values, 0.0))
    turned = np.rad2deg(np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]))
    regions = {"widths": axes[:, 0], "heights": axes[:, 1], "angles": turned, "offsets": ends}
    ax.add_collection(EllipseCollection(**regions, facecolors=(1, 1, 1, 0.6), zorder=3, **look))
    steps = ends - points
    ax.quiver(
        *points.T, *steps.T, angles="xy", scale_units="xy", scale=1, width=6e-3 if len(ids) <= _MOST_IDS else 2.5e-3,
        color=INK, edgecolor="#ffffff", linewidth=0.4, zorder=4,
    )  # fmt: skip
    margin = 0.04 * size
    # A length in the drawing to compare with.
    told = round_factor(0.2 * size / (1e-3 * factor))
    written = f"{told:g} um" if told < 1000 else f"{told / 1000:g} mm"
    bar = np.array([low[0], low[1] - 2.2 * margin])
    ax.plot([bar[0], bar[0] + 1e-3 * factor * told], [bar[1]] * 2, color=INK, linewidth=2.5, solid_capstyle="butt")
    ax.text(
        bar[0] + 1e-3 * factor * told + margin / 2, bar[1], f"{written}, drawn {factor:g} times as long",
        va="center_baseline", fontsize=9,
    )  # fmt: skip
    reached = np.concatenate([rim, ends, bar[None] - margin])
    ax.set(
        xlim=(reached[:, 0].min() - margin, reached[:, 0].max() + margin),
        ylim=(reached[:, 1].min(), reached[:, 1].max() + margin),
        aspect="equal",
    )
    ax.axis("off")
    bar_axes = ax.figure.colorbar(ScalarMappable(norm, colors), ax=ax, shrink=0.7, pad=0.02, aspect=26)
    bar_axes.set_label("height z over the design, um")
    return ax


def residual_factor(residual: Array, width: int) -> float:
    """Return the factor by which residuals (k, 2) in px are drawn over an image of this width."""
    return round_factor(width / 30 / max(float(np.quantile(np.linalg.norm(residual, axis=1), 0.9)), 1e-9))


def residual_vectors(
    pixels: Array, residual: Array, rejected: tuple[Array, Array], factor: float, camera: Camera, ax: "Axes"
) -> "Axes":
    """Draw residuals (k, 2) as strokes from where the dots were seen, `factor` times as long; rejected ones crossed.

    Of very many only every second, third... is drawn.
    """
    every = max(1, -(-len(pixels) // _MOST_VECTORS))
    start, step = pixels[::every], residual[::every]
    ax.plot(*_strokes(start, start + factor * step), color=SERIES[0]["color"], linewidth=0.9, zorder=2)
    ax.plot(*start.T, linestyle="none", marker="o", markersize=1.8, color=SERIES[0]["color"], label="dot", zorder=2)
    start, step = rejected
    if len(start):
        # Far-off dots would leave the picture.
        length = np.linalg.norm(factor * step, axis=1, keepdims=True)
        step = factor * step * np.minimum(1.0, camera.width / 8 / np.maximum(length, 1e-9))
        ax.plot(*_strokes(start, start + step), color=SERIES[1]["color"], linewidth=1.1, zorder=3)
        ax.plot(
            *start.T, linestyle="none", marker="x", markersize=6, color=SERIES[1]["color"], label="rejected", zorder=3
        )
        legend_below(ax)
    return _image_axes(camera, ax)


def image_coverage(pixels: list[Array], camera: Camera, ax: "Axes") -> "Axes":
    """Draw the outline of the dots (k, 2) of each view over the image."""
    import cv2
    from matplotlib.patches import Polygon

    for each in pixels:
        hull = cv2.convexHull(each.astype(np.float32))[:, 0]
        ax.add_patch(Polygon(hull, facecolor=SERIES[0]["color"], alpha=min(0.15, 2 / len(pixels)), linewidth=0))
        ax.add_patch(Polygon(hull, fill=False, edgecolor=SERIES[0]["color"], linewidth=0.6))
    return _image_axes(camera, ax)


def directions(rotation: Array, tilt_deg: Array, ax: "Axes") -> "Axes":
    """Draw from which side each photograph was taken: tilt as the distance from the middle, a hand for the turn.

    The side is that of the camera as seen from the front of the marker, its x to the right and y up; the hand points to
    where the upper edge of the image is in this view.

    Parameters
    ----------
    rotation : array (v, 3, 3)
    tilt_deg : array (v,)
    """
    spots = tilt_deg[:, None] * _unit(-rotation[:, 2, :2])
    outermost = next((ring for ring in _RINGS if ring >= tilt_deg.max()), 90)
    for ring in (*(each for each in _RINGS if each < outermost), outermost):
        ax.plot(ring * np.cos(_AROUND), ring * np.sin(_AROUND), color=FAINT, linewidth=0.8, zorder=1)
        ax.text(0, ring, f"{ring}°", ha="center", va="bottom", fontsize=8, color=MUTED, zorder=1)
    for angle in np.arange(4) * np.pi / 4:
        along = outermost * np.array([np.cos(angle), np.sin(angle)])
        ax.plot([-along[0], along[0]], [-along[1], along[1]], color=FAINT, linewidth=0.8, zorder=1)
    hands = spots + 0.13 * outermost * _unit(-rotation[:, 1, :2])
    ax.plot(*_strokes(spots, hands), color=SERIES[0]["color"], linewidth=1.5, zorder=3)
    ax.plot(*spots.T, linestyle="none", marker="o", markersize=5, color=SERIES[0]["color"], zorder=3)
    ax.text(1.04 * outermost, 0, "x", ha="left", va="center", style="italic", color=MUTED)
    ax.text(0, -1.04 * outermost, "tilt", ha="center", va="top", fontsize=8.5, color=MUTED)
    reach = 1.18 * outermost
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.axis("off")
    return ax


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def left_out(cross: CrossValidation, ax: "Axes") -> "Axes":
    """Draw the RMS residual of each left-out photograph, with the design and, if it was measured, with the print."""
    from matplotlib.ticker import MaxNLocator

    numbers = cross.photos + 1
    shown = [("as designed", cross.best_nominal, SERIES[1]), ("as measured", cross.measured, SERIES[0])]
    for name, each, look in shown[: 1 if cross.gain is None else 2]:
        values = [positive(value) for value in each.rms_each]
        marks: dict[str, Any] = {**look, "linestyle": "none", "markersize": 6}
        ax.plot(numbers, values, label=f"print {name}", **marks)
        ax.axhline(each.rms, color=look["color"], linestyle=look["linestyle"], linewidth=1.0, zorder=1)
    log_axis(ax, "y")
    ax.set(xlabel="number of the photograph", ylabel="RMS residual when left out, px")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(ax)
    return ax


def _strokes(start: Array, end: Array) -> tuple[Array, Array]:
    """Coordinates of separate strokes as one line with gaps."""
    line = np.stack([start, end, np.full_like(start, np.nan)], axis=1).reshape(-1, 2)
    return line[:, 0], line[:, 1]


def _image_axes(camera: Camera, ax: "Axes") -> "Axes":
    ax.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5), aspect="equal")
    ax.set(xlabel="x, px", ylabel="y, px")
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
    ax.grid(visible=False)
    return ax
