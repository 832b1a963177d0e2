"""Dots of a rig that each pose shows, and the pose's first-order errors from all of them or from one plate."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.detect.joining import spatial_errors
from markergen.estimators.budget import PoseBudget, pose_budget
from markergen.model.constellation import enough
from markergen.model.sight import dots_in_view
from markergen.validation.bounds import image_covariance
from markergen.validation.rigs.views import RigViews

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Visibility:
    """What P poses of a rig show.

    Attributes
    ----------
    seen : array (P, n) of bool
        See `dots_in_view`.
    """

    series: RigViews
    seen: Mask

    @cached_property
    def of_plates(self) -> Indices:
        """Number (P, k) of dots seen on each plate."""
        owner, count = self.series.rig.owner, len(self.series.rig.markers)
        return np.stack([self.seen[:, owner == k].sum(axis=1) for k in range(count)], axis=1)

    @property
    def plates(self) -> Indices:
        """Number (P,) of plates of which dots are seen."""
        return np.count_nonzero(self.of_plates, axis=1)

    @cached_property
    def found(self) -> Mask:
        """True (P, k) where a plate shows as many dots as it takes to find it alone, not all in a line."""
        rig = self.series.rig
        parts = (enough(each.marker.xyz, self.seen[:, rig.owner == k]) for k, each in enumerate(rig.markers))
        return np.stack(list(parts), axis=1)

    @property
    def served(self) -> Mask:
        """True (P,) where at least one plate can be found alone."""
        return np.asarray(self.found.any(axis=1))

    def groups(self) -> dict[str, Mask]:
        """Masks (P,) of the served poses by the number of plates of which dots are seen."""
        return {str(k): mask for k in np.unique(self.plates) if (mask := self.served & (self.plates == k)).any()}

    def enough(self, pose: int) -> list[int]:
        """Indices of the plates that a pose shows well enough to find them alone."""
        return [int(k) for k in np.flatnonzero(self.found[pose])]

    def dots(self, pose: int, plate: int | None = None) -> Indices:
        """Numbers of the dots that a pose shows, of all plates or of one."""
        seen = self.seen[pose] if plate is None else self.seen[pose] & (self.series.rig.owner == plate)
        return np.flatnonzero(seen)


def visibility(series: RigViews) -> Visibility:
    """Compute which dots each pose of a series shows."""
    return Visibility(series, dots_in_view(series.rig, series.camera, series.poses))


def dot_noise(series: RigViews) -> Array:
    """Least covariances (P, n, 2, 2) in px^2 of the dots' centers for the image noise; see `image_covariance`."""
    return image_covariance(series.rig, series.camera, series.poses, series.optics)


def budget_of(shown: Visibility, alone: bool = False) -> PoseBudget:
    """Error budget (P, 6, 6) of T_camera_rig: from all dots seen, or from the plate whose own dots tell it best.

    The weights are those of `detect`: each dot's own noise, from the image, its print and the plates' relation. What
    the plates' relation does to all dots of a plate at once is exact. Infinite where no plate shows enough dots.
    """
    noise, poses = dot_noise(shown.series), shown.series.poses
    parts = {name: np.full((len(poses), 6, 6), np.inf) for name in ("image", "print", "camera", "total")}
    for pose in map(int, np.flatnonzero(shown.served)):
        choices = [shown.dots(pose, k) for k in shown.enough(pose)] if alone else [shown.dots(pose)]
        found = [_budget_at(shown.series, pose, dots, noise[pose, dots]) for dots in choices]
        best = min(found, key=lambda each: float(each.rotation_deg["total"][0]))
        for name, values in parts.items():
            values[pose] = getattr(best, name)[0]
    return PoseBudget(**parts)


def _budget_at(series: RigViews, pose: int, dots: Indices, noise: Array) -> PoseBudget:
    rig, poses = series.rig, series.poses
    return pose_budget(
        rig.xyz[dots], poses.rotation[[pose]], poses.translation[[pose]], series.camera, noise[None],
        spatial_errors(series.rig, dots, np.eye(3), series.errors),
    )  # fmt: skip
