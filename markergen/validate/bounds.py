"""Cramer-Rao bounds of a marker over a pose distribution."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.maths.dot_noise import dot_covariance
from markergen.maths.information import (
    covariance,
    flip_separation,
    information,
    pose_jacobian,
    rotation_bound,
    translation_bound,
)
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives.lens import lens_blocks, through_lens
from markergen.render import Optics
from markergen.render.view import dot_ellipses

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
    """Bounds of the pose for control points (n, 3) in m and Gaussian noise of `noise_px` on every image coordinate.

    The noise is that of the image as taken, through the lens.
    """
    ideal = pose_jacobian(points, poses.rotation, poses.translation, camera.focal)
    matrix = information(through_lens(ideal, points, camera, poses))
    unit = covariance(matrix)
    # Without noise there is no bound to measure by: every two poses are as far apart as can be.
    separation = flip_separation(poses.rotation, poses.translation, unit) / noise_px if noise_px else np.inf
    return PoseBounds(
        information=matrix,
        rotation_deg=noise_px * np.rad2deg(rotation_bound(unit)),
        translation_pct=noise_px * 100 * translation_bound(unit, poses.translation),
        separation=np.broadcast_to(separation, len(poses)),
    )


def image_covariance(
    marker: Marker, camera: Camera, poses: PoseDistribution, optics: Optics, bare_px: float = 0.0
) -> Array:
    """Covariances (P, n, 2, 2) in px^2 of the dots' centers that the noise of the image allows, pose by pose.

    Their px are those of the image as taken. Bare points have no image: theirs is `bare_px` on every coordinate.
    """
    if not marker.dot_diameter:
        return np.broadcast_to(bare_px**2 * np.eye(2), (len(poses), len(marker), 2, 2))
    diameters = np.array([point.feature.diameter for point in marker.control_points])
    ellipses = [
        dot_ellipses(marker, camera.ideal, *pose, diameters)
        for pose in zip(poses.rotation, poses.translation, strict=True)
    ]
    _, semi, angle = (np.stack(part) for part in zip(*ellipses, strict=True))
    noise = optics.grey_noise(optics.exposure * (optics.dark + optics.light) / 2)
    contrast = optics.exposure * (optics.light - optics.dark)
    normalized = perspective(to_camera(marker.xyz, poses.rotation, poses.translation))
    return dot_covariance(semi, angle, optics.edge_blur, contrast, float(noise), lens_blocks(camera, normalized))


def error_budget(
    marker: Marker, camera: Camera, poses: PoseDistribution, image: Array, sources: ErrorSources
) -> dict[str, Any]:
    """What limits the pose, RMS over the poses: image, print, calibration, and the total, in degrees and percent.

    Parameters
    ----------
    image : array (P, n, 2, 2), px^2
        Covariances of the dots' centers from the image's noise, see `image_covariance`.
    """
    budget = pose_budget(marker.xyz, poses.rotation, poses.translation, camera, image, sources)
    return {
        "print_sigma_mm": 1e3 * sources.print_sigma,
        "image_px": float(np.sqrt(np.mean(np.trace(image, axis1=-2, axis2=-1)))),
        "rotation_deg": {name: _rms(part) for name, part in budget.rotation_deg.items()},
        "translation_pct": {name: _rms(part) for name, part in budget.translation_pct(poses.translation).items()},
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
