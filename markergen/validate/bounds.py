"""Cramer-Rao bounds of a marker over a pose distribution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.maths.information import (
    covariance,
    flip_separation,
    information,
    pose_jacobian,
    rotation_bound,
    translation_bound,
)
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseBounds:
    """What no unbiased estimator can beat, to first order, for each of P poses.

    Attributes
    ----------
    information : array (P, 6, 6)
        Fisher information of the pose for noise of 1 px.
    rotation_deg, translation_pct : arrays (P,)
        RMS of RE and TE that the noise allows; inf where the layout leaves the pose undetermined.
    separation : array (P,)
        Angle between pose and mirrored pose in units of the rotation bound.
    """

    information: Array
    rotation_deg: Array
    translation_pct: Array
    separation: Array


def pose_bounds(points: Array, camera: Camera, poses: PoseDistribution, noise_px: float) -> PoseBounds:
    """Bounds of the pose for control points (n, 3) in m and Gaussian noise of `noise_px` on every image coordinate."""
    matrix = information(pose_jacobian(points, poses.rotation, poses.translation, camera.focal))
    unit = covariance(matrix)
    # Without noise there is no bound to measure by: every two poses are as far apart as can be.
    separation = flip_separation(poses.rotation, poses.translation, unit) / noise_px if noise_px else np.inf
    return PoseBounds(
        information=matrix,
        rotation_deg=noise_px * np.rad2deg(rotation_bound(unit)),
        translation_pct=noise_px * 100 * translation_bound(unit, poses.translation),
        separation=np.broadcast_to(separation, len(poses)),
    )
