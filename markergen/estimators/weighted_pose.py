"""Pose of labeled points, with its error budget and the second pose that may also fit."""

import math
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.estimators.budget import (
    ErrorSources,
    PoseBudget,
    pose_budget,
    pose_gain,
    print_covariance,
    together_covariance,
)
from markergen.maths.conics import mirrored_poses, outlines, pose_rows, refine_poses
from markergen.maths.rotation import angle_between
from markergen.model.camera import NO_DISTORTION, Camera

CONTENDER = 1e-3
"""Minimum likelihood of a second pose relative to the best one, for it to be reported."""

TOLERANCE, COARSE = 1e-8, 1e-3
"""Tolerances of `refine_poses`: for the best pose; for the second one, until it is known to be a contender."""

_STEPS = 20
"""Maximum number of steps of a refinement."""

SEARCHED = 20.0
"""Maximum difference of half chi2 at which the second pose is refined completely."""

DISTINCT_SIGMA = 3.0
"""Poses whose rotations differ by fewer sigma are considered equal."""

DEFAULT_ERRORS = ErrorSources()
"""A tenth of a millimeter in the print, an exact calibration."""

ROUGH_SIGMA = 5.0
"""Multiple of the median point's standard deviation above which a point tells nothing of the others' errors."""

_BY_LUCK = 0.1
"""Probability of larger residuals at which covariances are still taken as they are stated."""

FLATNESS = 0.01
"""Range of heights, as a share of the extent, of points that have a mirrored pose like those of a plane."""

_LEAST_PX = 1e-6
"""Lower limit for a point's standard deviation, so that its weight stays finite without any error source."""


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose T_camera_marker with its uncertainty.

    Attributes
    ----------
    rotation, translation : arrays (3, 3) and (3,), m
    budget : PoseBudget
        Covariances (6, 6) of (w, dt): from the image, the print, the camera's calibration, and their sum.
    chi2 : float
        Sum of the residuals weighted by the inverse of their covariance from image and print.
    degrees_of_freedom : int
        Expected value of chi2, if the covariances are right: twice the number of points, less 6.
    scale : float
        Factor on the covariances from image and print, already in `budget`; see `residual_scale`.
    alternative : (rotation, translation) or None
        Other pose from which a flat marker looks much the same, if it is a contender.
    likelihood_ratio : float
        Likelihood of the alternative relative to this pose: exp(-(chi2 of the alternative - chi2)/(2 scale)); 0 without
        one.
    """

    rotation: Array
    translation: Array
    budget: PoseBudget
    chi2: float
    degrees_of_freedom: int
    scale: float
    alternative: tuple[Array, Array] | None = None
    likelihood_ratio: float = 0.0


def estimate_pose(
    points: Array,
    pixels: Array,
    covariance: Array,
    camera: Camera,
    errors: ErrorSources = DEFAULT_ERRORS,
) -> PoseEstimate | None:
    """Estimate the most likely pose of labeled points, weighted by the inverse of their image and print covariance.

    Levenberg-Marquardt from both of IPPE's poses, or from SQPnP's for points that are not coplanar.

    Parameters
    ----------
    points : array (m, 3), m, m >= 4
        Points in the marker frame.
    pixels : array (m, 2), px
        Images of the points as the camera takes them, including lens distortion.
    covariance : array (m, 2, 2), px^2
        Covariance of `pixels`, from the image's noise.

    Returns
    -------
    PoseEstimate or None
        None if the points do not determine a pose that sees them from the front.

    Raises
    ------
    InputError
        If there are fewer than four points.
    """
    normalized = camera.from_pixels(pixels)
    return fit_pose(points, np.zeros(len(points)), normalized, covariance, camera, errors)


def fit_pose(
    points: Array,
    radii: Array,
    seen: Array,
    covariance: Array,
    camera: Camera,
    errors: ErrorSources,
    start: tuple[Array, Array] | None = None,
) -> PoseEstimate | None:
    """Estimate the pose, as `estimate_pose` does, from the centers of image ellipses of disks with radii (m,) in m.

    Parameters
    ----------
    seen : array (m, 2)
        Centers of the ellipses in normalized coordinates.
    covariance : array (m, 2, 2), px^2
        Covariance of the centers in the image as the camera takes it.
    start : tuple of arrays (3, 3) and (3,), or None
        Approximate pose.
    """
    if len(points) < 4:
        raise InputError("four points or more", f"{len(points)}", "a pose of fewer is not unique")
    if not np.isfinite(seen).all():
        return None
    rotation, translation = _starts(points, seen, camera) if start is None else (start[0][None], start[1][None])
    if not len(rotation):
        return None
    image = normalized_covariance(seen, covariance, camera)
    dots = points, radii, seen, image
    rotations, translations, chi2, spread, scale = _estimated(dots, rotation, translation, errors)
    if not len(chi2):
        return None
    rotation, translation = rotations[0], translations[0]
    image_part, print_part = scale * spread
    camera_part = np.zeros((6, 6))
    if errors.camera_covariance is not None:
        camera_part = pose_budget(points, rotations[:1], translations[:1], camera, covariance, errors).camera[0]
    budget = PoseBudget(image_part, print_part, camera_part, image_part + print_part + camera_part)
    alternative, ratio = None, 0.0
    if len(chi2) > 1:
        likelihood = math.exp(float(chi2[0] - chi2[1]) / (2 * scale))
        sigma = math.sqrt(budget.total.trace() - budget.total[3:, 3:].trace())
        if likelihood > CONTENDER and angle_between(rotations[1], rotation) > DISTINCT_SIGMA * sigma:
            alternative, ratio = (rotations[1], translations[1]), likelihood
    freedom = 2 * len(points) - 6
    return PoseEstimate(rotation, translation, budget, float(chi2[0]), freedom, scale, alternative, ratio)


def _estimated(
    dots: tuple[Array, Array, Array, Array], rotation: Array, translation: Array, errors: ErrorSources
) -> tuple[Array, Array, Array, Array, float]:
    """Return the best pose and the mirrored one of a flat marker, the better first, with the covariance of the first.

    Parameters
    ----------
    dots : tuple
        Points (m, 3), radii (m,), centers seen (m, 2), and their covariance (m, 2, 2) in normalized coordinates.
    rotation, translation : arrays (k, 3, 3) and (k, 3)
        Starts.

    Returns
    -------
    rotation (0 to 2, 3, 3), translation, chi2; covariances (2, 6, 6) from image and print, without the scale; the scale
    """
    points, radii, seen, image = dots
    flat = nearly_flat(points)

    def refined(rotation: Array, translation: Array, tolerance: float = TOLERANCE) -> tuple[Array, Array, Array]:
        return refine_weighted(points, radii, seen[None], image, rotation, translation, errors, tolerance)

    fitted = refined(rotation, translation)
    best = int(np.argmin(fitted[2]))
    fitted = fitted[0][[best]], fitted[1][[best]], fitted[2][[best]]
    if not np.isfinite(fitted[2][0]):
        return fitted[0][:0], fitted[1][:0], fitted[2][:0], np.zeros((2, 6, 6)), 1.0
    if flat:
        other = refined(*mirrored_poses(points, *fitted[:2]), COARSE)
        if other[2][0] - fitted[2][0] < 2 * SEARCHED * max(1.0, fitted[2][0] / (2 * len(points) - 6)):
            other = refined(*other[:2])
        order = [1, 0] if other[2][0] < fitted[2][0] else [0, 1]
        rotations, translations, chi2 = (np.concatenate(pair)[order] for pair in zip(fitted, other, strict=True))
        fitted = rotations, translations, chi2
    best_rotation, best_translation = fitted[0][:1], fitted[1][:1]
    rows = pose_rows(points, best_rotation, best_translation)
    printed = print_covariance(rows, points, best_rotation, errors)
    residual = seen - outlines(points, radii, best_rotation, best_translation).center[0]
    gain = pose_gain(rows, image + printed)[0]
    covariance = np.stack([np.einsum("mia,mij,mjb->ab", gain, part, gain) for part in (image, printed[0])])
    if errors.joint_places is not None:
        covariance[1] = together_covariance(gain[None], rows, best_rotation, errors)[0]
    return *fitted, covariance, residual_scale(residual, image + printed[0])


def refine_weighted(
    points: Array,
    radii: Array,
    seen: Array,
    image: Array,
    rotation: Array,
    translation: Array,
    errors: ErrorSources,
    tolerance: float = TOLERANCE,
) -> tuple[Array, Array, Array]:
    """Refine poses (k, 3, 3), (k, 3) with points weighted by the inverse of their image and print covariance.

    Parameters
    ----------
    seen, image : arrays broadcastable to (k, n, 2) and (k, n, 2, 2)
        Centers of the ellipses, and their covariance from the image, in normalized coordinates.

    Returns
    -------
    rotation (k, 3, 3), translation (k, 3), chi2 (k,)
        See `maths.conics.refine_poses`.
    """
    # The print's share of the weights depends smoothly on the pose: from a start that is right to a percent, they
    # are right to a percent, and the estimate then to second order.
    spread = image + print_covariance(pose_rows(points, rotation, translation), points, rotation, errors)
    weight = np.asarray(np.linalg.inv(spread), dtype=float)
    measured = np.broadcast_to(seen, (len(rotation), len(points), 2))
    return refine_poses(points, radii, measured, weight, rotation, translation, _STEPS, tolerance)


def residual_scale(residual: Array, spread: Array) -> float:
    """Return the factor, 1 or more, by which residuals show the covariances of image and print to be too small.

    chi2/d, the estimate of a factor common to all points by d = 2 m - 6 degrees of freedom, where chi2 exceeds its 90 %
    point (the global test of an adjustment; C. F. Gauss). Reflections, shadows and compression move dots by more than
    the noise of the grey levels says. Points far less precise than the others, such as rough ellipses, whose covariance
    is a guess, do not take part: they hardly affect the pose, so each has two degrees of freedom.

    Parameters
    ----------
    residual : array (m, 2)
        Measured less predicted points.
    spread : array (m, 2, 2)
        Covariance of the points from image and print.
    """
    from scipy.special import chdtri

    chi2 = np.einsum("mi,mij,mj->m", residual, np.linalg.inv(spread), residual)
    variance = np.trace(spread, axis1=-2, axis2=-1)
    precise = variance <= ROUGH_SIGMA**2 * np.median(variance)
    freedom = 2 * int(precise.sum()) - 6
    total = float(chi2[precise].sum())
    return total / freedom if freedom > 0 and total > chdtri(freedom, _BY_LUCK) else 1.0


def nearly_flat(points: Array) -> bool:
    """Return whether points (m, 3) are on a plane z = const, up to the bending of a print."""
    return bool(np.ptp(points[:, 2]) <= FLATNESS * np.ptp(points[:, :2]))


def _starts(points: Array, seen: Array, camera: Camera) -> tuple[Array, Array]:
    """Return finite initial poses (k, 3, 3), (k, 3)."""
    height = points[:, 2].mean()
    flat = nearly_flat(points)
    # A flat marker is solved in the plane z = 0, wherever its plane is.
    moved = points * [1, 1, 0] if flat else points
    solver = ESTIMATORS["ippe" if flat else "sqpnp"]
    assert isinstance(solver, PoseEstimator)
    start = Correspondences(moved, camera.ideal.to_pixels(seen)[None], camera.ideal).once(solver)
    usable = np.isfinite(start.translation[0]).all(axis=-1)
    rotation, translation = start.rotation[0, usable], start.translation[0, usable]
    return rotation, translation - (height * rotation[:, :, 2] if flat else 0.0)


def normalized_covariance(seen: Array, covariance: Array, camera: Camera) -> Array:
    """Return the covariance (..., m, 2, 2) of normalized coordinates (..., m, 2) from that of px."""
    covariance = covariance + _LEAST_PX**2 * np.eye(2)
    if camera.distortion == NO_DISTORTION:
        scaled = covariance / np.multiply.outer(camera.focal, camera.focal)
        return np.broadcast_to(scaled, (*seen.shape[:-1], 2, 2))
    lens = np.linalg.inv(camera.pixel_jacobian(seen))
    return lens @ covariance @ lens.swapaxes(-1, -2)
