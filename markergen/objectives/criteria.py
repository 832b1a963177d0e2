"""All criteria of a layout side by side, and those of the layouts it is compared with."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from markergen.maths.information import rotation_bound, translation_bound
from markergen.objectives.base import OBJECTIVES, Setting
from markergen.objectives.pose import PoseObjective

Array = NDArray[np.float64]
Criteria = Mapping[str, float]

RANDOM_LAYOUTS = 25
"""Random layouts whose median stands for "no design at all"; an odd number, so that the median is one of them."""


def criteria(points: Array, setting: Setting) -> list[dict[str, float]]:
    """Every criterion of each layout (B, n, 2), for the noise of the setting and each with its default aggregate.

    Keys: ``pose_m``, ``homography_px``, ``condition`` (unit coordinates), and the RMS over the poses of the bounds
    ``rotation_deg`` and ``translation_pct``. Bounds are for `Setting.noise_words` and scale with the noise;
    ``condition`` does not depend on it.
    """
    names = {"pose": "pose_m", "homography": "homography_px", "condition": "condition"}
    columns = {key: OBJECTIVES[name](setting)(points) for name, key in names.items()}
    poses = setting.poses
    bound = PoseObjective(setting).covariance(points)
    rotation = np.rad2deg(rotation_bound(bound))
    translation = 100 * translation_bound(bound, poses.translation)
    columns["rotation_deg"] = np.sqrt(np.mean(rotation**2, axis=-1))
    columns["translation_pct"] = np.sqrt(np.mean(translation**2, axis=-1))
    return [{key: float(values[i]) for key, values in columns.items()} for i in range(len(points))]


def regular_polygon(n: int, radius: float) -> Array:
    """Regular n-gon (n, 2) on the circle of that radius, one corner straight up, counterclockwise."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def median_criteria(layouts: list[dict[str, float]]) -> dict[str, float]:
    """Median of each criterion by itself over several layouts."""
    return {key: float(np.median([layout[key] for layout in layouts])) for key in layouts[0]}
