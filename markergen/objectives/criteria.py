"""All criteria of a layout side by side, and those of the layouts it is compared with."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from markergen.maths.information import rotation_bound, translation_bound
from markergen.objectives.base import OBJECTIVES, Setting
from markergen.objectives.pose import PoseObjective

Array = NDArray[np.float64]
Criteria = Mapping[str, float]

NAMES = {
    "pose_m": "pose",
    "homography_px": "homography",
    "condition": "condition",
    "rotation_deg": "rotation",
    "translation_pct": "translation",
}
"""The criteria by their keys, and the objectives that they are, each with its default aggregate."""

RANDOM_LAYOUTS = 25
"""Random layouts whose median stands for "no design at all"; an odd number, so that the median is one of them."""


def criteria(points: Array, setting: Setting) -> list[dict[str, float]]:
    """Every criterion of each layout (B, n, 2 or 3), for the noise of the setting and each with its default aggregate.

    Keys: ``pose_m``, ``homography_px``, ``condition`` (unit coordinates), and the RMS over the poses of the bounds
    ``rotation_deg`` and ``translation_pct``. Bounds are for `Setting.noise_words` and scale with the noise;
    ``condition`` does not depend on it. Layouts with relief have no homography: its two keys are left out.
    """
    points = without_height(points)
    bounds = ("rotation_deg", "translation_pct")
    columns = {key: OBJECTIVES[NAMES[key]](setting)(points) for key in keys_for(points) if key not in bounds}
    poses = setting.poses
    bound = PoseObjective(setting).covariance(points)
    rotation = np.rad2deg(rotation_bound(bound))
    translation = 100 * translation_bound(bound, poses.translation)
    columns["rotation_deg"] = np.sqrt(np.mean(rotation**2, axis=-1))
    columns["translation_pct"] = np.sqrt(np.mean(translation**2, axis=-1))
    return [{key: float(values[i]) for key, values in columns.items()} for i in range(len(points))]


def without_height(points: Array) -> Array:
    """Points (..., 2) of points (..., 3) that all lie in the marker's plane; others as they are."""
    return points[..., :2] if points.shape[-1] == 3 and not points[..., 2].any() else points


def keys_for(points: Array) -> list[str]:
    """Keys of `NAMES` that layouts (..., 2 or 3) have: a relief has no homography."""
    return [key for key, name in NAMES.items() if points.shape[-1] == 2 or not OBJECTIVES[name].planar_only]


def regular_polygon(n: int, radius: float) -> Array:
    """Regular n-gon (n, 2) on the circle of that radius, one corner straight up, counterclockwise."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def median_criteria(layouts: list[dict[str, float]]) -> dict[str, float]:
    """Median of each criterion by itself over several layouts."""
    return {key: float(np.median([layout[key] for layout in layouts])) for key in layouts[0]}
