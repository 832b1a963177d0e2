"""What pose error to expect, pose by pose, and what it is made of."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.estimators.budget import PoseBudget
from markergen.maths.information import covariance, rotation_bound
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.validation.bounds import pose_bounds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNIT_NOISE_PX = 1.0
"""Noise that bounds are given for where the results name none, or 0."""
SOURCES = {"image": "image noise", "print": "print", "camera": "calibration", "total": "total"}


@dataclass(frozen=True, eq=False)
class Expected:
    """Errors to expect at each of P poses, to first order.

    Attributes
    ----------
    covariance : array (P, 6, 6)
        Of the pose (w, dt), see `maths.information`; rad and m.
    poses : PoseDistribution
    source : str
        What makes the errors, in words.
    """

    covariance: Array
    poses: PoseDistribution
    source: str

    @property
    def rotation_deg(self) -> Array:
        """RMS rotation error (P,) in degrees."""
        return np.rad2deg(rotation_bound(self.covariance))

    @property
    def translation_mm(self) -> Array:
        """RMS translation error (P,) in mm."""
        return 1e3 * np.sqrt(np.trace(self.covariance[:, 3:, 3:], axis1=-2, axis2=-1))

    @property
    def translation_pct(self) -> Array:
        """RMS translation error (P,) in percent of the distance."""
        return self.translation_mm / (10 * self.poses.distance)


@dataclass(frozen=True, eq=False)
class Cell:
    """The poses of one distance and one tilt, and the RMS of what to expect there."""

    distance: str
    tilt: str
    poses: Mask
    rotation_deg: float
    translation_mm: float


def noise_of(results: Mapping[str, Any]) -> float:
    """Noise in px that the bounds of a report are for."""
    return float(results.get("noise_px") or UNIT_NOISE_PX)


def expected(results: Mapping[str, Any], marker: Marker, setting: Setting, budget: PoseBudget | None) -> Expected:
    """Errors to expect of this marker: of the whole budget where there is one, else of image noise alone."""
    if budget is not None:
        parts = results.get("budget") or {}
        sigma = parts.get("print_sigma_mm")
        printed = "print errors" if sigma is None else f"a print good to {sigma:g} mm"
        calibrated = " and the camera's calibration" if np.any(budget.camera) else ""
        joint = ", " if calibrated else " and "
        return Expected(budget.total, setting.poses, f"image noise{joint}{printed}{calibrated}")
    return bound(marker, setting, noise_of(results))


def bound(marker: Marker, setting: Setting, noise_px: float) -> Expected:
    """Cramer-Rao bound of the marker for Gaussian noise of `noise_px` on every image coordinate."""
    matrix = pose_bounds(marker.xyz, setting.camera, setting.poses, noise_px).information
    return Expected(noise_px**2 * covariance(matrix), setting.poses, f"image noise of {noise_px:g} px alone")


def cells(found: Expected) -> list[Cell]:
    """Table of distance and tilt, nearest first and then by tilt; without those that no pose is in."""
    rotation, translation = found.rotation_deg, found.translation_mm
    return [
        Cell(distance, tilt, both, rms(rotation[both]), rms(translation[both]))
        for distance, near in found.poses.by_distance().items()
        for tilt, leaning in found.poses.by_polar_angle().items()
        if (both := near & leaning).any()
    ]


def rms(values: Array) -> float:
    """Root mean square; inf if one of the values is."""
    return float(np.sqrt(np.mean(np.square(values))))


def middle(group: str) -> float:
    """Number in the middle of a group's name, such as ``35`` or ``30..40``."""
    return float(np.mean([float(end) for end in group.split("..")]))


def interval(group: str, groups: list[str]) -> tuple[float, float]:
    """From where to where a group reaches: a bin as its name says, a single value halfway to its neighbors."""
    if ".." in group:
        low, high = (float(end) for end in group.split(".."))
        return low, high
    values = sorted(middle(name) for name in groups)
    i = values.index(middle(group))
    steps = np.diff(values)
    if not steps.size:
        return 0.9 * values[0], 1.1 * values[0] or 1.0
    before, after = steps[max(i - 1, 0)], steps[min(i, len(steps) - 1)]
    return float(values[i] - before / 2), float(values[i] + after / 2)
