"""What the dots of a pose tell: least covariances of their centers, information, budget, and their reliability.

To first order, the image of a dot is the affine image A of the unit circle, and its center is known to the covariance
of `maths.dot_crlb`. A is radius times the derivative of the image by the place in the plane (`image_slopes`), or that
of the exact ellipse (`plate_covariances`). A print error of sigma along both axes of the plane adds sigma^2 S S', S
being that derivative.

How well the other dots of a flat marker control each one: with the information F of a dot at a pose and C the
covariance of the pose, the dot has the redundancy number 1 - tr(F C) / 2, the share of its error that its residual
shows; all of a pose add up to n - 3. The smallest blunder in its place that a test notices follows from
`detectability`, and moves the estimated pose by C F T g, unnoticed.
"""

# tests: tests/bounds/test_dot_covariances.py tests/bounds/test_reliability.py

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from markergen.arrays import Array, Mask
from markergen.estimators.budget import ErrorSources, PoseBudget, pose_budget
from markergen.maths.dot_crlb import center_covariance, dot_covariance
from markergen.maths.information import (
    covariance,
    moved_information,
    pose_jacobian,
    rotation_bound,
    translation_bound,
)
from markergen.maths.projection import circle_image, perspective, plane_homography, to_camera
from markergen.maths.reliability import POWER, RISK, detectability, noncentrality
from markergen.model.body import Body, enough
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.sight import Coverage
from markergen.model.spec import ImageNoise
from markergen.objectives import Setting
from markergen.objectives.observation import lens_blocks
from markergen.objectives.pose import PoseObjective
from markergen.presentation.tables import Table, number


def image_jacobian(points: Array, camera: Camera, poses: PoseDistribution) -> Array:
    """Derivatives (P, n, 2, 6) of the images in px of points (n, 2 or 3) in m by the pose (w, dt)."""
    normalized = perspective(to_camera(points, poses.rotation, poses.translation))
    ideal = pose_jacobian(points, poses.rotation, poses.translation, np.ones(2))
    return np.asarray(camera.pixel_jacobian(normalized) @ ideal.reshape(*normalized.shape[:2], 2, 6))


def image_slopes(jacobian: Array, poses: PoseDistribution) -> Array:
    """Derivatives (P, n, 2, 2), px per m, of the images of points by their place in the plane."""
    return np.asarray(jacobian[..., 3:] @ poses.rotation[:, None, :, :2])


def dot_covariances(slopes: Array, diameters: Array | float, image: ImageNoise, print_sigma: float = 0.0) -> Array:
    """Least covariances (P, n, 2, 2) in px^2 of the centers of dots, for the image noise and a print error in m.

    Parameters
    ----------
    slopes : array (P, n, 2, 2), px per m
        See `image_slopes`.
    diameters : float or array (n,), m
    """
    affine = slopes * (np.asarray(diameters) / 2)[..., None, None]
    spread = center_covariance(affine, image.edge_px, image.contrast_to_noise)
    return spread + print_sigma**2 * slopes @ slopes.swapaxes(-1, -2) if print_sigma else spread


def dot_information(coverage: Coverage, camera: Camera, image: ImageNoise, print_sigma: float = 0.0) -> Array:
    """Fisher information (P, n, 6, 6) of the pose from each dot, 0 if it is not seen."""
    poses, seen = coverage.poses, coverage.seen[..., None, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        jacobian = np.where(seen, image_jacobian(coverage.points, camera, poses), 0.0)
    # Any image will do for dots that do not count.
    slopes = np.where(seen, image_slopes(jacobian, poses), np.eye(2))
    spread = dot_covariances(slopes, coverage.diameters, image, print_sigma)
    return jacobian.swapaxes(-1, -2) @ np.linalg.solve(spread, jacobian)


def marker_budget(
    points: Array, diameter: float, setting: Setting, image: ImageNoise, sources: ErrorSources
) -> PoseBudget:
    """Error budget of dots of one diameter in m at points (n, 2 or 3) in m, for all poses of a setting."""
    camera, poses = setting.camera, setting.poses
    spread = dot_covariances(image_slopes(image_jacobian(points, camera, poses), poses), diameter, image)
    return pose_budget(points, poses.rotation, poses.translation, camera, spread, sources)


def body_bounds(
    body: Body, seen: Mask, camera: Camera, poses: PoseDistribution, image: ImageNoise, print_sigma: float
) -> tuple[Array, Array]:
    """Errors (2, P) of T_camera_body from the dots that are seen, and from those of the best plate of each pose.

    Rotation in degrees, and translation of the body's origin in m; inf where no plate shows four dots, not on a line.

    Parameters
    ----------
    seen : array (P, n) of bool
        See `dots_in_view`.
    """
    information, is_enough = [], []
    for k, plate in enumerate(body.plates):
        rotation, translation = plate.camera_pose(poses.rotation, poses.translation)
        views, in_view = PoseDistribution("", rotation, translation), seen[:, body.owner == k]
        covered = Coverage(plate.marker.xyz, 2 * plate.marker.radii, views, in_view)
        by_plate = dot_information(covered, camera, image, print_sigma).sum(axis=1)
        information.append(moved_information(by_plate, -(poses.rotation @ plate.translation_vector)))
        is_enough.append(enough(plate.marker.xyz, in_view))

    def errors(matrix: Array, is_served: Mask) -> Array:
        bounds = np.full((2, *is_served.shape), np.inf)
        spread = covariance(matrix[is_served])
        place = np.broadcast_to(poses.translation, (*is_served.shape, 3))[is_served]
        bounds[0][is_served] = np.rad2deg(rotation_bound(spread))
        bounds[1][is_served] = translation_bound(spread, place) * np.linalg.norm(place, axis=-1)
        return bounds

    every, alone = np.stack(information), np.stack(is_enough)
    return errors(every.sum(axis=0), np.logical_or.reduce(alone, axis=0)), errors(every, alone).min(axis=1)


def plate_covariances(
    body: Body, camera: Camera, poses: PoseDistribution, edge_px: float, contrast_to_noise: Callable[[Array], Array]
) -> Array:
    """Least covariances (P, n, 2, 2) in px^2 of the dots' centers in a body's poses, from their exact ellipses.

    Parameters
    ----------
    edge_px : float
        Standard deviation of an edge's blur, see `center_information`.
    contrast_to_noise : callable
        From places (P, k, 2) in px in the image to the contrast over the noise (P, k) there.
    """
    return np.concatenate(
        [
            _ellipse_covariances(
                plate.marker,
                camera,
                PoseDistribution("", *plate.camera_pose(poses.rotation, poses.translation)),
                edge_px,
                contrast_to_noise,
            )
            for plate in body.plates
        ],
        axis=1,
    )


def _ellipse_covariances(
    marker: Marker,
    camera: Camera,
    poses: PoseDistribution,
    edge_px: float,
    contrast_to_noise: Callable[[Array], Array],
) -> Array:
    _, semi, angle = dot_ellipses(marker.xyz, camera.ideal, poses.rotation, poses.translation, 2 * marker.radii)
    # Plates that turn their back have places that are none.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        normalized = perspective(to_camera(marker.xyz, poses.rotation, poses.translation))
        ideal = dot_covariance(semi, angle, edge_px, 1.0, 1.0, lens_blocks(camera, normalized))
        # Information is proportional to the square of contrast over noise, which varies from dot to dot.
        quality = contrast_to_noise(camera.to_pixels(normalized))
        return np.asarray(ideal / np.maximum(quality, 1e-9)[..., None, None] ** 2)


def dot_ellipses(
    points: Array, camera: Camera, rotation: Array, translation: Array, diameters: Array
) -> tuple[Array, Array, Array]:
    """Undistorted image ellipses of circles about points (n, 3) in m, each in the plane of its own height.

    Parameters
    ----------
    rotation, translation : arrays (..., 3, 3) and (..., 3), m
    diameters : array (n,), m

    Returns
    -------
    center (..., n, 2), semi (..., n, 2), angle (..., n)
        See `ellipse_of_conic`; nan for circles of diameter 0, seen from behind, or not entirely in front of the camera.
    """
    normal = rotation[..., None, :, 2]
    centers = points @ rotation.swapaxes(-1, -2) + translation[..., None, :]
    leaning = np.hypot(rotation[..., 2, 0], rotation[..., 2, 1])[..., None]
    seen = (diameters > 0) & (centers[..., 2] > diameters / 2 * leaning) & (np.sum(centers * normal, axis=-1) < 0)
    center, semi, angle = (np.full((*seen.shape, *of), np.nan) for of in ((2,), (2,), ()))
    if seen.any():
        planes = np.broadcast_to(rotation[..., None, :, :], (*seen.shape, 3, 3))[seen]
        places, dots = (translation[..., None, :] + points[:, 2:] * normal)[seen], np.nonzero(seen)[-1]
        homography = plane_homography(planes, places, camera.matrix)
        center[seen], semi[seen], angle[seen] = circle_image(points[dots, :2], diameters[dots] / 2, homography)
    return center, semi, angle


ROUNDING = 1e-9
"""Share of a dot's information that is rounding, not control by other dots."""


@dataclass(frozen=True)
class DotReliability:
    """Reliability of a dot, over the poses.

    Attributes
    ----------
    redundancy : float
        Mean redundancy number, from 0, not controlled, to 1.
    blunder_m : float
        RMS of the smallest displacement in m that a test notices, in the direction where that is largest.
    rotation_deg, translation_m : float
        RMS of the largest errors of the pose by displacements that are just not noticed.
    """

    id: int
    redundancy: float
    blunder_m: float
    rotation_deg: float
    translation_m: float


def reliability(points: Array, setting: Setting, ids: Sequence[int] = ()) -> list[DotReliability]:
    """Reliability of dots at points (n, 2) in m, for the noise of a setting; inf where nothing is noticed."""
    objective = PoseObjective(setting)
    shares = objective.information(points[:, None, :2])[0].swapaxes(0, 1)
    spread = covariance(shares.sum(axis=1))[:, None]
    plane = objective._plane()[:, None]
    matrix = detectability(shares, spread, plane)
    redundancy = 1 - np.trace(shares @ spread, axis1=-2, axis2=-1) / 2
    effect = spread @ shares @ plane
    with np.errstate(all="ignore"):
        least = np.linalg.eigvalsh(np.nan_to_num(matrix))[..., 0]
        noticed = least > ROUNDING * np.trace(plane.swapaxes(-1, -2) @ shares @ plane, axis1=-2, axis2=-1)
        inverse = np.linalg.inv(np.where(noticed[..., None, None], matrix, np.eye(2)))
        rows = [effect[..., :3, :], effect[..., 3:, :]]
        squares = [1 / least, *(np.linalg.eigvalsh(row @ inverse @ row.swapaxes(-1, -2))[..., -1] for row in rows)]
        blunder, rotation, translation = (
            np.sqrt(noncentrality() * np.mean(np.where(noticed, square, np.inf), axis=0)) for square in squares
        )
    return [
        DotReliability(*row)
        for row in zip(
            ids or range(len(points)), redundancy.mean(axis=0).tolist(), blunder.tolist(),
            np.rad2deg(rotation).tolist(), translation.tolist(), strict=True,
        )
    ]  # fmt: skip


def reliability_json(dots: Sequence[DotReliability], noise: str) -> dict[str, object]:
    """Return plain JSON values of a marker's reliability."""
    return {"noise": noise, "risk": RISK, "power": POWER, "dots": [asdict(dot) for dot in dots]}


def reliability_table(dots: Sequence[DotReliability], noise: str) -> Table:
    """Table of a marker's reliability."""
    rows = [
        [str(dot.id), f"{dot.redundancy:.2f}"]
        + [number(value, 3) for value in (1e3 * dot.blunder_m, dot.rotation_deg, 1e3 * dot.translation_m)]
        for dot in dots
    ]
    return Table(
        f"What a wrong dot does before a test notices it, for {noise}",
        ["dot", "redundancy", "noticed from mm", "rotation deg", "translation mm"],
        rows,
        f"A test that suspects a right dot with {100 * RISK:g} % notices that displacement with {100 * POWER:g} %; "
        "below it, the pose is off by as much. RMS over the poses, of the worst direction.",
    )
