"""The results of a validation, and their published JSON form."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.marker import Marker
from markergen.presentation.results import plain
from markergen.validation.metrics import efficiency, mean_nees_interval, statistics
from markergen.validation.trials import NEES_OF, Errors, Experiment, HomographyErrors, PoseErrors

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ValidationResult:
    """What the trials of one marker gave.

    Attributes
    ----------
    marker : Marker
    experiment : Experiment
        Camera, poses that see the marker whole, bounds, noise, runs, and seed.
    errors : mapping
        By estimator; arrays (P, runs). Empty if there were no runs.
    condition : array (P,) or None
        Condition number c(A) of every pose, in unit coordinates.
    """

    marker: Marker
    experiment: Experiment
    errors: Mapping[str, Errors]
    condition: Array | None = None

    def as_dict(
        self,
        criteria: Any = None,
        comparisons: Any = None,
        views: Any = None,
        budget: Any = None,
        labels: Any = None,
    ) -> dict[str, Any]:
        """Return the results as plain JSON values, None in place of a number that does not exist.

        Parameters
        ----------
        criteria, comparisons, views, budget, labels
            JSON values that others compute, put in their places.
        """
        experiment = self.experiment
        poses = experiment.poses
        by_polar_angle, by_distance = poses.by_polar_angle(), poses.by_distance()
        content = {
            "marker": {
                "control_points": len(self.marker),
                "boundary": self.marker.boundary.as_dict(),
                "dot_diameter": self.marker.dot_diameter,
                "spec_hash": self.marker.spec_hash,
            },
            "criteria": criteria,
            "comparisons": comparisons,
            "nees": self._nees(by_polar_angle),
            "camera": experiment.camera.as_dict(),
            "poses": {"name": poses.name, "count": len(poses), "dropped": poses.dropped},
            "noise_px": experiment.noise_px,
            "runs": experiment.runs,
            "seed": experiment.seed,
            "condition": _range(self.condition),
            "homography": {
                name: _by_group(_homography, errors, by_polar_angle)
                for name, errors in self.errors.items()
                if isinstance(errors, HomographyErrors)
            },
            "estimators": {
                name: _by_group(self._pose, errors, by_polar_angle)
                | {"by_distance": {name: self._pose(errors, mask) for name, mask in by_distance.items()}}
                for name, errors in self.errors.items()
                if isinstance(errors, PoseErrors)
            },
            "bound": self._bound(np.ones(len(poses), dtype=bool))
            | {
                "by_polar_angle": {name: self._bound(mask) for name, mask in by_polar_angle.items()},
                "by_distance": {name: self._bound(mask) for name, mask in by_distance.items()},
            },
            "labels": labels,
            "budget": budget,
            "views": views,
        }
        values: dict[str, Any] = plain(content)
        return values

    def _pose(self, errors: PoseErrors, poses: Mask) -> dict[str, Any]:
        failed, flipped = errors.failed[poses], errors.flipped[poses]
        rotation_deg, translation_pct = errors.rotation_deg[poses], errors.translation_pct[poses]
        return {
            "rotation_deg": statistics(rotation_deg[~failed]),
            "translation_pct": statistics(translation_pct[~failed]),
            "nearest_rotation_deg": statistics(errors.nearest_deg[poses][~failed]),
            "flip_rate": np.mean(flipped),
            "failure_rate": np.mean(failed),
            "efficiency": efficiency(rotation_deg, ~(failed | flipped), self.experiment.bounds.rotation_deg[poses]),
        }

    def _bound(self, poses: Mask) -> dict[str, Any]:
        bounds = self.experiment.bounds
        return {
            "rotation_deg": _rms(bounds.rotation_deg[poses]),
            "translation_pct": _rms(bounds.translation_pct[poses]),
        }

    def _nees(self, groups: Mapping[str, Mask]) -> dict[str, Any] | None:
        errors = self.errors.get(NEES_OF)
        return _by_group(_nees, errors, groups) if isinstance(errors, PoseErrors) else None


def _by_group(summarize: Any, errors: Errors, groups: Mapping[str, Mask]) -> dict[str, Any]:
    everything = np.logical_or.reduce(list(groups.values()))
    overall: dict[str, Any] = summarize(errors, everything)
    return overall | {"by_polar_angle": {angle: summarize(errors, poses) for angle, poses in groups.items()}}


def _homography(errors: HomographyErrors, poses: Mask) -> dict[str, Any]:
    failed = errors.failed[poses]
    he_px2 = errors.he_px2[poses][~failed]
    return {
        "he_px2": statistics(he_px2),
        "rms_px": statistics(np.sqrt(he_px2)),
        "failure_rate": np.mean(failed),
    }


def _nees(errors: PoseErrors, poses: Mask) -> dict[str, Any]:
    """Mean NEES, and the 99 % interval around 6 that it falls into if the bound's covariance is right."""
    values = errors.nees[poses]
    values = values[np.isfinite(values)]
    if not values.size:
        return {"count": 0, "mean": None, "interval": None}
    return {"count": values.size, "mean": np.mean(values), "interval": mean_nees_interval(values.size)}


def _range(values: Array | None) -> dict[str, Any] | None:
    return None if values is None else {"mean": np.mean(values), "min": np.min(values), "max": np.max(values)}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
