"""Models of how a marker is seen: poses of a calibrated camera, and homographies where there is no calibration."""
# tests: tests/detect/test_fiducials_as_labels.py tests/detect/test_labeling_hypotheses.py

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array, Indices
from markergen.detect.blobs import Ellipses
from markergen.detect.conic_projection import (
    Outlines,
    correct_centers,
    mirrored_poses,
    outlines,
    plane_outlines,
    refine_poses,
)
from markergen.detect.pose_hypotheses import DotLayout
from markergen.maths.batched import Batched
from markergen.maths.projection import apply_homography, perspective

FIT_TOLERANCE = 1e-3
"""Relative change of the misfit at which a fit stops: enough to tell labelings apart."""


class Model(Batched, ABC):
    """K hypotheses of the mapping from marker to image."""

    @abstractmethod
    def outlines(self, layout: DotLayout) -> Outlines:
        """Predict the outlines of all dots."""

    @abstractmethod
    def project(self, points: Array) -> Array:
        """Return the images (K, m, 2), in normalized coordinates, of points (m, 3) in m on the marker's plane."""

    @abstractmethod
    def mirrored(self, layout: DotLayout) -> "Model | None":
        """Return the model with nearly the same image that leads to another minimum; None if there is none."""

    @abstractmethod
    def turned(self, angle: Array, origin: Array, target: Array) -> "Model":
        """Return models (K) that show the marker turned by angles (K,) in its plane, a point (K, 2) at another one."""

    @abstractmethod
    def fitted(self, blobs: Indices, ellipses: Ellipses, layout: DotLayout, px: float) -> "Model":
        """Fit to labelings (K, n) by least squares."""


@dataclass(frozen=True, eq=False)
class Poses(Model):
    """Calibrated: rotation (K, 3, 3), translation (K, 3) in m."""

    rotation: Array
    translation: Array

    def outlines(self, layout: DotLayout) -> Outlines:
        """Predict the outlines of all dots."""
        return outlines(layout.points, layout.radii, self.rotation, self.translation)

    def project(self, points: Array) -> Array:
        """Return the images (K, m, 2) of points (m, 3) in m; nan for those behind the camera."""
        seen = points @ self.rotation.swapaxes(-1, -2) + self.translation[:, None]
        return np.where(seen[..., 2:] > 0, perspective(np.where(seen[..., 2:] > 0, seen, 1.0)), np.nan)

    def mirrored(self, layout: DotLayout) -> "Poses | None":
        """Return the mirrored poses of a flat marker."""
        return Poses(*mirrored_poses(layout.points, self.rotation, self.translation)) if layout.flat else None

    def turned(self, angle: Array, origin: Array, target: Array) -> "Poses":
        """Return the first pose with the marker turned in its plane."""
        turn = _turns(angle, origin, target)
        shift = np.column_stack([turn[:, :2, 2], np.zeros(len(turn))])
        turn[:, :2, 2] = 0
        return Poses(self.rotation[0] @ turn, self.translation[0] + shift @ self.rotation[0].T)

    def fitted(self, blobs: Indices, ellipses: Ellipses, layout: DotLayout, px: float) -> "Poses":
        """Fit to labelings (K, n) by least squares."""
        weight = (blobs >= 0)[..., None, None] * (px**2 * np.eye(2))
        rotation, translation, _ = refine_poses(
            layout.points,
            layout.radii,
            ellipses.center[blobs],
            weight,
            self.rotation,
            self.translation,
            8,
            FIT_TOLERANCE,
        )
        return Poses(rotation, translation)


@dataclass(frozen=True, eq=False)
class Planes(Model):
    """Uncalibrated: homographies (K, 3, 3) from the marker plane in m."""

    homography: Array

    def outlines(self, layout: DotLayout) -> Outlines:
        """Predict the outlines of all dots."""
        return plane_outlines(layout.points[:, :2], layout.radii, self.homography)

    def project(self, points: Array) -> Array:
        """Return the images (K, m, 2) of points (m, 3) in m on the marker's plane."""
        return apply_homography(self.homography, points[:, :2])

    def mirrored(self, layout: DotLayout) -> None:
        """Return None: the homography is unique."""

    def turned(self, angle: Array, origin: Array, target: Array) -> "Planes":
        """Return the first homography with the marker turned in its plane."""
        return Planes(self.homography[0] @ _turns(angle, origin, target))

    def fitted(self, blobs: Indices, ellipses: Ellipses, layout: DotLayout, px: float) -> "Planes":  # noqa: ARG002
        """Fit each labeling (K, n) by DLT, corrected for the offset between centers of ellipses and of dots."""
        homography = self.homography.copy()
        patterns, group = np.unique(blobs >= 0, axis=0, return_inverse=True)
        for k, used in enumerate(patterns):
            rows = np.flatnonzero(group.ravel() == k)
            _, fit = correct_centers(ellipses.center[blobs[rows][:, used]], layout.points[used, :2], layout.radii[used])
            finite = np.isfinite(fit).all(axis=(-2, -1))
            homography[rows[finite]] = fit[finite]
        return Planes(homography)


def _turns(angle: Array, origin: Array, target: Array) -> Array:
    """Return rotations (K, 3, 3) of the plane, homogeneous, that take a point (K, 2) to another one."""
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    turn[:, :2, 2] = target - (turn[:, :2, :2] @ origin[..., None])[..., 0]
    turn[:, 2, 2] = 1
    return turn
