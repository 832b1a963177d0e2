"""All criteria of a layout, and of the layouts it is compared with."""
# tests: tests/objectives/test_objectives.py tests/objectives/test_observation.py

from collections.abc import Mapping

import numpy as np

from markergen.arrays import Array
from markergen.objectives.aggregates import aggregate_of
from markergen.objectives.base import OBJECTIVES, Criterion, Setting
from markergen.objectives.pose import PoseObjective

Criteria = Mapping[str, float]

RANDOM_LAYOUTS = 25
"""Number of random layouts whose median represents "no design"; odd, so that the median is one of them."""


def columns() -> dict[str, Criterion]:
    """Criteria of all objectives by name, in printing order."""
    by_name = {name: OBJECTIVES[name].criterion for name in OBJECTIVES}
    defined = {name: criterion for name, criterion in by_name.items() if criterion}
    return dict(sorted(defined.items(), key=lambda item: (item[1].place, item[1].key)))


def criteria(points: Array, setting: Setting) -> list[dict[str, float]]:
    """Every criterion of each layout (B, n, 2 or 3), for the noise of the setting, with its default aggregate.

    Keys are those of the objectives that are criteria: ``pose_m``, ``homography_px``, ``condition`` (unit coordinates),
    those of other packages, and the RMS over the poses of the bounds ``rotation_deg`` and ``translation_pct``. Bounds
    refer to `Setting.noise_words` and scale with the noise; ``condition`` does not depend on it. Layouts with relief
    have no homography, so its two keys are omitted.
    """
    points = without_height(points)
    defined = criteria_for(points, setting.sight is None)
    by_key = {
        criterion.key: OBJECTIVES[name](setting)(points) for name, criterion in defined.items() if not criterion.bound
    }
    covariance = PoseObjective(setting).covariance(points)
    aggregated = aggregate_of("rms", setting.poses.weight)
    for criterion in defined.values():
        if criterion.bound:
            with np.errstate(invalid="ignore"):
                by_key[criterion.key] = aggregated(criterion.bound(covariance, setting.poses), 0.0)[0]
    return [{key: float(values[i]) for key, values in by_key.items()} for i in range(len(points))]


def without_height(points: Array) -> Array:
    """Drop the heights of points (..., 3) that all lie in the marker's plane; return others unchanged."""
    return points[..., :2] if points.shape[-1] == 3 and not points[..., 2].any() else points


def criteria_for(points: Array, whole: bool = True) -> dict[str, Criterion]:
    """Subset of `columns` defined for layouts (..., 2 or 3): a relief has no homography, nor has what is not whole."""
    planar = whole and points.shape[-1] == 2
    return {name: criterion for name, criterion in columns().items() if planar or not OBJECTIVES[name].planar_only}


def regular_polygon(n: int, radius: float) -> Array:
    """Regular n-gon (n, 2) on a circle of the given radius, counterclockwise from the top corner."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def median_criteria(layouts: list[dict[str, float]]) -> dict[str, float]:
    """Median of each criterion over several layouts, separately."""
    return {key: float(np.median([layout[key] for layout in layouts])) for key in layouts[0]}
