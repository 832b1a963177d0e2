"""Cramer-Rao bounds of a marker or rig over a pose distribution, from its points, its dots, or all grey levels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.bounds.dot_covariances import plate_covariances
from markergen.estimators.budget import PoseBudget, pose_budget, spatial_errors
from markergen.maths.information import (
    apply_pose_step,
    covariance,
    flip_separation,
    information,
    pose_jacobian,
    rotation_bound,
    translation_bound,
)
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.model.sight import partly_seen
from markergen.model.spec import ImageNoise, Spec
from markergen.objectives import Setting
from markergen.objectives.observation import through_lens
from markergen.optimize.dot_count import outlook
from markergen.render import Optics, Patch, expected_levels, window_of
from markergen.render.optics import FULL_SCALE, Grey, light_at
from markergen.render.view import Window
from markergen.validation.metrics import rms
from markergen.validation.views import SyntheticViews

UNSEEN_PX2 = 1e12
"""Variance in px^2 of the image of a dot that a pose does not see."""


@dataclass(frozen=True, eq=False)
class PoseBounds:
    """First-order bounds for unbiased estimators at each of P poses.

    Attributes
    ----------
    information : array (P, 6, 6)
        Fisher information of the pose: of points for noise of 1 px, or of all grey levels with their own noise.
    rotation_deg, translation_pct : arrays (P,)
        RMS of RE and TE at the bound; inf if the layout leaves the pose undetermined.
    separation : array (P,)
        Angle between pose and mirrored pose in units of the rotation bound.
    """

    information: Array
    rotation_deg: Array
    translation_pct: Array
    separation: Array

    @classmethod
    def of(cls, matrix: Array, poses: PoseDistribution, noise_px: float = 1.0) -> "PoseBounds":
        """Return the bounds for information (P, 6, 6) that is for noise of 1 px, if the noise is another."""
        unit = covariance(matrix)
        # Without noise the bound is 0, and any two poses are infinitely many bounds apart.
        separation = flip_separation(poses.rotation, poses.translation, unit) / noise_px if noise_px else np.inf
        return cls(
            information=matrix,
            rotation_deg=noise_px * np.rad2deg(rotation_bound(unit)),
            translation_pct=noise_px * 100 * translation_bound(unit, poses.translation),
            separation=np.broadcast_to(separation, len(poses)),
        )

    def summary(self, poses: Mask) -> dict[str, float]:
        """RMS of the bounds over some poses."""
        return {"rotation_deg": rms(self.rotation_deg[poses]), "translation_pct": rms(self.translation_pct[poses])}


def pose_bounds(
    points: Array, camera: Camera, poses: PoseDistribution, noise_px: float, seen: Mask | None = None
) -> PoseBounds:
    """Bounds of the pose for control points (n, 3) in m and Gaussian noise of `noise_px` on every image coordinate.

    The noise applies to distorted pixels. Of the points only those `seen` (P, n) count, if given.
    """
    ideal = pose_jacobian(points, poses.rotation, poses.translation, camera.focal)
    rows = through_lens(ideal, points, camera, poses)
    counted = rows if seen is None else np.where(np.repeat(seen, 2, axis=-1)[..., None], rows, 0.0)
    return PoseBounds.of(information(counted), poses, noise_px)


Scene = Callable[[Array, Array], Sequence[Patch]]
"""Patches that are seen from a pose: rotation (3, 3) and translation (3,), m."""

STEP_PX = 0.01
"""Movement of the pattern's rim in the image, px, for the central differences of grey levels.

Half as much changes the bound of dots, tags and boards by less than 1e-4 of it: for a blur of 0.7 px the differences
are off by (STEP_PX/0.75)^2/6 of the gradient, and single precision by 1e-5 of a grey level, where an edge changes by 1.
"""


def photometric_bounds(scene: Scene, camera: Camera, poses: PoseDistribution, optics: Optics) -> PoseBounds:
    """Bounds of the pose from all grey levels of an image of a known pattern through known optics.

    No detector can do better. The information is the sum over all pixels of g g'/sigma^2. The gradient g of the
    expected grey level with respect to the pose is a central difference of rendered images (see `STEP_PX`), and sigma
    the noise of a pixel at its level, rounding included. What is found point by point, such as dots or corners, leaves
    out what the size and shape of each of them tell.

    Parameters
    ----------
    scene : callable
        Patches seen from a pose, such as ``partial(seen_patches, marker, camera)``.
    poses : PoseDistribution
        Each is as much work as rendering 13 images.

    Returns
    -------
    PoseBounds
        Infinite where the image does not determine the pose.
    """
    poses_and_levels = zip(poses.rotation, poses.translation, strict=True)
    matrix = np.stack([_grey_information(scene, camera, *pose, optics) for pose in poses_and_levels])
    return PoseBounds.of(matrix, poses)


def _grey_information(scene: Scene, camera: Camera, rotation: Array, translation: Array, optics: Optics) -> Array:
    # Most of an image is empty.
    window = window_of(scene(rotation, translation), camera, rotation, translation, optics)
    _, gradient, sigma = grey_gradient(scene, camera, rotation, translation, optics, window)
    # Fisher information of independent Gaussian grey levels: the sum of g g' / sigma^2 over all pixels.
    weighted = (gradient / sigma).reshape(6, -1)
    return np.asarray(weighted @ weighted.T)


def grey_gradient(
    scene: Scene, camera: Camera, rotation: Array, translation: Array, optics: Optics, window: Window
) -> tuple[Grey, Grey, Array]:
    """Expected grey levels (h, w) of a window, their gradient (6, h, w) by the pose, and their noise (h, w)."""
    patches = scene(rotation, translation)
    reach = max(float(np.linalg.norm(outline, axis=-1).max()) for patch in patches for outline in patch.outlines)
    expected = expected_levels(patches, camera, rotation, translation, optics, window)
    distance = STEP_PX * np.linalg.norm(translation) / camera.focal.mean()
    # A rotation moves the farthest outline by as much as a translation does.
    steps = np.diag(np.repeat([distance / reach, distance], 3))
    moved = [apply_pose_step(rotation[None], translation[None], sign * steps) for sign in (1, -1)]
    gradient = np.empty((6, *expected.shape), dtype=np.float32)
    for k in range(6):
        ahead, behind = (
            expected_levels(scene(rotated[k], moved_to[k]), camera, rotated[k], moved_to[k], optics, window)
            for rotated, moved_to in moved
        )
        gradient[k] = (ahead - behind) / (2 * steps[k, k])
    return expected, gradient, optics.grey_noise(expected)


def image_covariance(
    body: Body, camera: Camera, poses: PoseDistribution, optics: Optics, bare_px: float = 0.0
) -> Array:
    """Least covariances (P, n, 2, 2) in px^2 of the dots' centers for the image noise at each pose T_camera_body.

    Contrast and noise are those at each dot's position in the image; motion counts as an isotropic blur. Bare points
    have no image and get `bare_px` on every coordinate.
    """
    if not body.radii.any():
        return np.broadcast_to(bare_px**2 * np.eye(2), (len(poses), len(body), 2, 2))

    if optics.aperture_mm:
        focused = (optics.at(float(camera.focal.mean()), depth) for depth in poses.translation[:, 2].tolist())
        return np.concatenate(
            [image_covariance(body, camera, poses.taken(np.array([k]), 0), at, bare_px) for k, at in enumerate(focused)]
        )

    def contrast_to_noise(pixels: Array) -> Array:
        factor = light_at(optics, pixels, camera.width, camera.height)
        dark, light = (np.minimum(factor * level, FULL_SCALE) for level in (optics.dark, optics.light))
        return np.asarray((light - dark) / optics.grey_noise((dark + light) / 2))

    return plate_covariances(body, camera, poses, optics.edge_blur, contrast_to_noise)


def counted_covariance(series: SyntheticViews[Any], bare_px: float = 0.0) -> Array:
    """`image_covariance` (P, n, 2, 2) at every pose of a series; of dots that do not count, `UNSEEN_PX2`."""
    image = image_covariance(series.marker, series.camera, series.poses, series.optics, bare_px)
    seen = partly_seen(series.marker, series.camera, series.poses)
    return image if seen is None else np.where(seen[..., None, None], image, UNSEEN_PX2 * np.eye(2))


def budget_of(series: SyntheticViews[Any], bare_px: float = 0.0, alone: bool = False) -> PoseBudget:
    """Error budget (P, 6, 6) for every pose of a series, with its optics, print and calibration.

    Of a rig, from all dots in view or, `alone`, from those of the plate that determine the pose best. The weights are
    those of `detect`: each dot's noise from the image, its print and the plates' relation. What the relation does to
    all dots of a plate at once is exact. Infinite where no plate shows enough dots.
    """
    body, poses, camera = series.marker, series.poses, series.camera
    if isinstance(body, Marker):
        image = counted_covariance(series, bare_px)
        return pose_budget(body.xyz, poses.rotation, poses.translation, camera, image, series.errors.of(body))
    image, in_view = image_covariance(body, camera, poses, series.optics), series.coverage
    parts = {name: np.full((len(poses), 6, 6), np.inf) for name in ("image", "print", "camera", "total")}
    for pose in map(int, np.flatnonzero(in_view.served)):
        dots = np.flatnonzero(in_view.seen[pose])
        plates = np.flatnonzero(in_view.plate_served[pose])
        choices = [dots[body.owner[dots] == k] for k in plates] if alone else [dots]
        budgets = [rig_budget(series, pose, choice, image[pose, choice]) for choice in choices]
        best = min(budgets, key=lambda budget: float(budget.rotation_deg["total"][0]))
        for name, values in parts.items():
            values[pose] = getattr(best, name)[0]
    return PoseBudget(**parts)


def rig_budget(series: SyntheticViews[Rig], pose: int, dots: Indices, image: Array) -> PoseBudget:
    """Error budget (1, 6, 6) of a rig at a pose from some dots (m,), whose centers have covariances (m, 2, 2), px^2."""
    rig, poses = series.marker, series.poses
    return pose_budget(
        rig.xyz[dots],
        poses.rotation[[pose]],
        poses.translation[[pose]],
        series.camera,
        image[None],
        spatial_errors(rig, dots, np.eye(3), series.errors),
    )


def error_budget(
    series: SyntheticViews[Any],
    bare_px: float = 0.0,
    budget: PoseBudget | None = None,
    alone: PoseBudget | None = None,
) -> dict[str, Any]:
    """Return pose errors by source, RMS over the poses: image, print, calibration, total, in degrees and percent.

    Those of a rig are over the poses at which a plate shows enough dots, also for the best plate ``alone``. Budgets
    that are at hand already need not be computed again.
    """
    body, poses = series.marker, series.poses
    is_rig = body.frame == "rig"
    counted = series.coverage.served if is_rig else np.ones(len(poses), dtype=bool)
    budget = budget or budget_of(series, bare_px)

    def parts(whole: PoseBudget) -> dict[str, Any]:
        with np.errstate(invalid="ignore"):
            pct = whole.translation_pct(poses.translation)
        return {
            "rotation_deg": {name: rms(part[counted]) for name, part in whole.rotation_deg.items()},
            "translation_pct": {name: rms(part[counted]) for name, part in pct.items()},
        }

    variance = np.trace(counted_covariance(series, bare_px)[counted], axis1=-2, axis2=-1)
    # Dots that a pose does not see have the stand-in variance, and no part in the mean.
    variance = variance[variance < UNSEEN_PX2]
    return {
        "print_sigma_mm": 1e3 * series.errors.print_sigma,
        "print_measured": any(plate.marker.places_measured for plate in body.plates),
        "camera_exact": series.errors.camera_covariance is None,
        **({} if is_rig else {"outlook": _outlook(series)}),
        "image_px": float(np.sqrt(np.mean(variance))),
        **parts(budget),
        **({"alone": parts(alone or budget_of(series, alone=True))} if is_rig else {}),
    }


def _outlook(series: SyntheticViews[Marker]) -> str | None:
    """What more dots would bring (see `outlook`); None for a relief, bare points, several sizes and measured prints."""
    marker, errors = series.marker, series.errors
    several = len(marker.constellations) > 1
    if several or marker.height or marker.places_measured or not marker.dot_diameter or not len(series.poses):
        return None
    optics = series.optics
    spec = Spec(
        boundary=marker.boundary,
        camera=series.camera,
        keep_outs=marker.blocked,
        image_noise=ImageNoise(optics.blur_px, optics.noise_grey, optics.light - optics.dark),
    )
    setting = Setting(marker.boundary, series.camera, series.poses)
    return outlook(marker.xyz[:, :2], marker.dot_diameter, spec, setting, errors)
