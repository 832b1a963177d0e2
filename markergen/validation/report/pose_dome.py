"""The dome of poses of a report: camera centers over a marker or around a rig, to turn, and as a still picture."""
# tests: tests/validation/report/test_plots.py tests/validation/report/test_report.py

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.model.body import Plate
from markergen.model.poses import PoseDistribution
from markergen.presentation.pages import dome_figure
from markergen.presentation.plots import FAINT, INK, Plot, color_steps, plot, ticks
from markergen.validation.report.subject import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


COLORS = "YlOrBr"
"""Colormap that is monotonic in lightness, so that it keeps its order in grayscale."""
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
            turned = circle @ plate.rotation_matrix.T
            faces.append((rings, [place + size * turned for place, size in zip(places, sizes, strict=True)]))
    centers = camera_centers(poses)
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


def camera_centers(poses: PoseDistribution) -> Array:
    """Centers (P, 3) of the cameras in the marker frame, m: -R' t."""
    return -np.einsum("pij,pi->pj", poses.rotation, poses.translation)


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
