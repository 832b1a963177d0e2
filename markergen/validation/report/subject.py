"""The subject of a report, and quantities derived from it: expected errors, their sources, and dot sizes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.bounds.dot_covariances import dot_ellipses
from markergen.estimators.budget import PoseBudget
from markergen.maths.information import covariance, rotation_bound
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.optimize.dot_size import PERCENTILE, PIXELS
from markergen.optimize.layouts import largest_diameter
from markergen.presentation import tables
from markergen.validation.bounds import pose_bounds
from markergen.validation.error_to_plan_with import cells_of
from markergen.validation.metrics import rms

Results = Mapping[str, Any]

ERRORS = (("rotation_deg", "rotation", "deg"), ("translation_pct", "translation", "%"))
"""Key in the results, name, and unit of each error."""
GROUPINGS = (("tilt", "by_polar_angle", "tilt, deg"), ("distance", "by_distance", "distance, m"))
"""Name, key in the results (and method of the poses), and axis label of each grouping of poses."""
UNIT_NOISE_PX = 1.0
"""Noise for the bounds if that of the results is 0."""
SOURCES = {"image": "image noise", "print": "print", "camera": "calibration", "total": "total"}


@dataclass(frozen=True, eq=False)
class Expected:
    """Expected errors at each of P poses.

    Attributes
    ----------
    covariance : array (P, 6, 6)
        First-order covariances of the pose (w, dt), see `maths.information`; rad and m.
    poses : PoseDistribution
    rotation_deg, translation_mm : arrays (P,)
        RMS errors: with flips, where they were computed by `expectation.expect`, or those of the covariance.
    """

    covariance: Array
    poses: PoseDistribution
    rotation_deg: Array
    translation_mm: Array

    @classmethod
    def first_order(cls, covariance: Array, poses: PoseDistribution) -> "Expected":
        """Return the errors of a covariance alone."""
        translation_mm = 1e3 * np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=-2, axis2=-1))
        return cls(covariance, poses, np.rad2deg(rotation_bound(covariance)), translation_mm)

    @property
    def translation_pct(self) -> Array:
        """RMS translation error (P,) in percent of the distance."""
        return self.translation_mm / (10 * self.poses.distance)


@dataclass(frozen=True, eq=False)
class PoseBin:
    """The poses of one distance and one tilt, and their expected RMS errors."""

    distance: str
    tilt: str
    poses: Mask
    rotation_deg: float
    translation_mm: float


@dataclass(frozen=True, eq=False)
class Subject:
    """The results that a report shows, and derived quantities that several sections use."""

    results: Results
    marker: Marker
    setting: Setting
    budget: PoseBudget

    @cached_property
    def expected(self) -> Expected:
        """Expected errors from all sources together."""
        # JSON has no infinity.
        rotation_deg, translation_mm = (
            np.array([np.inf if value is None else value for value in self.results["expected"][key]])
            for key in ("rotation_deg", "translation_mm")
        )
        return Expected(self.budget.total, self.setting.poses, rotation_deg, translation_mm)

    @property
    def views(self) -> Results:
        """Results of the views; empty if there are none."""
        return self.results["views"] or {}

    @cached_property
    def predicted(self) -> Expected | None:
        """Errors predicted for the views, if any, from their noise and any simulated print error."""
        if not self.views:
            return None
        printed = self.budget.print if self.views["print_sigma_mm"] or self.marker.places_measured else 0.0
        covariance = self.budget.image + printed
        if np.any(self.budget.camera):
            return Expected.first_order(covariance, self.setting.poses)
        return replace(self.expected, covariance=covariance)


def noise_px(results: Mapping[str, Any]) -> float:
    """Noise in px that the bounds of a report assume."""
    return float(results["noise_px"] or UNIT_NOISE_PX)


def bound(marker: Marker, setting: Setting, noise_px: float) -> Expected:
    """Cramer-Rao bound of the marker for Gaussian noise of `noise_px` on every image coordinate."""
    seen = setting.sight.seen if setting.sight else None
    matrix = pose_bounds(marker.xyz, setting.camera, setting.poses, noise_px, seen).information
    return Expected.first_order(noise_px**2 * covariance(matrix), setting.poses)


def pose_bins(expected: Expected) -> list[PoseBin]:
    """Table of distances and tilts, nearest first and then by tilt, without empty bins."""
    rotation, translation = expected.rotation_deg, expected.translation_mm
    return [
        PoseBin(distance, tilt, both, rms(rotation[both]), rms(translation[both]))
        for (distance, tilt), both in cells_of(expected.poses).items()
    ]


@dataclass(frozen=True)
class Extent:
    """The dots' images in one pose.

    Attributes
    ----------
    pose : int
    thinnest_px : float
        Shortest axis in px of any dot's image; 0 if a circle's image is not an ellipse.
    center_px : float
        Short axis in px of a dot at the marker's origin, the criterion for the size when a marker is designed.
    diameter : float
        Diameter in m, rounded up to a tenth of a mm, at which the thinnest has `PIXELS` px; inf if there is none.
    """

    pose: int
    thinnest_px: float
    center_px: float
    diameter: float


@dataclass(frozen=True)
class Advice:
    """Dot sizes to print for `PIXELS` px in all poses, or in `PERCENTILE` % of them.

    Attributes
    ----------
    worst, most : Extent
        The pose in which the dots are thinnest, and the one at the percentile.
    largest : float
        Largest diameter in m at which as many dots fit within the boundary in any arrangement.
    """

    worst: Extent
    most: Extent
    largest: float


def short_axes(marker: Marker, camera: Camera, poses: PoseDistribution, scale: float = 1.0) -> Array:
    """Short axes (P, n) in px of the dots' images, with diameters multiplied by `scale`, see `dot_ellipses`.

    Without lens distortion; 0 if the circle's image is not an ellipse.
    """
    return _axes(marker.xyz, 2 * scale * marker.radii, camera, poses)[..., 1]


def mean_diameters(marker: Marker, camera: Camera, poses: PoseDistribution) -> Array:
    """Roots (P, n) of long times short axis in px of the dots' images; see `short_axes`."""
    return np.asarray(np.sqrt(_axes(marker.xyz, 2 * marker.radii, camera, poses).prod(axis=-1)))


def advise(marker: Marker, camera: Camera, poses: PoseDistribution) -> Advice | None:
    """Advice on the size of the dots; None for bare points."""
    if not marker.radii.all():
        return None
    ranked = np.argsort(short_axes(marker, camera, poses).min(axis=1))
    # An actual pose rather than an interpolation: this percentage of the poses is at least as good.
    typical = ranked[len(ranked) - int(np.ceil(len(ranked) * PERCENTILE / 100))]
    worst, most = (_extent(marker, camera, poses, int(pose)) for pose in (ranked[0], typical))
    return Advice(worst, most, largest_diameter(marker.boundary, len(marker)))


def value_text(value: float | None, digits: int = 3) -> str:
    """Format a number with that many significant digits; a missing or infinite one as words."""
    if value is None or np.isnan(value):
        return "-"
    return "unbounded" if np.isinf(value) else tables.number(float(value), digits)


def _extent(marker: Marker, camera: Camera, poses: PoseDistribution, pose: int) -> Extent:
    single_pose = PoseDistribution("one", poses.rotation[[pose]], poses.translation[[pose]])
    center = _axes(np.zeros((1, 3)), np.array([marker.dot_diameter]), camera, single_pose)[..., 1]
    thinnest = float(short_axes(marker, camera, single_pose).min())
    extent, scale = thinnest, 1.0
    # The extent is nearly proportional to the diameter, so that the iteration converges fast.
    for _ in range(4):
        if not extent:
            return Extent(pose, thinnest, float(center[0, 0]), np.inf)
        scale *= PIXELS / extent
        extent = float(short_axes(marker, camera, single_pose, scale).min())
    diameter = float(np.ceil(scale * marker.dot_diameter * 1e4 - 1e-6) / 1e4)
    return Extent(pose, thinnest, float(center[0, 0]), diameter)


def _axes(points: Array, diameters: Array, camera: Camera, poses: PoseDistribution) -> Array:
    _, semi, _ = dot_ellipses(points, camera.ideal, poses.rotation, poses.translation, diameters)
    return np.asarray(np.nan_to_num(2 * semi))
