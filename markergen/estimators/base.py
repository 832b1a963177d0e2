"""Interface of estimators: batches of correspondences in, batches of estimates out."""

# tests: tests/estimators/test_base.py tests/estimators/test_opencv.py

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.maths.projection import from_pixels, perspective, rotate, rotate_each, to_pixels
from markergen.maths.rotation import exponential, rotation_z
from markergen.model.camera import NO_DISTORTION, Camera

E = TypeVar("E")

COLLINEAR = 1e-6
"""Collinearity threshold: ratio of the points' spread across their main direction to the spread along it."""


@dataclass(frozen=True)
class PoseEstimates:
    """Poses T_camera_marker of T trials, k solutions each, best first; nan where there is no solution.

    Attributes
    ----------
    rotation : array (T, k, 3, 3)
    translation : array (T, k, 3), m
    """

    rotation: Array
    translation: Array

    @property
    def best(self) -> tuple[Array, Array]:
        """Rotation (T, 3, 3) and translation (T, 3) of the solution with the least reprojection error."""
        return self.rotation[:, 0], self.translation[:, 0]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """One layout seen in T images, or T layouts with the same number of points, each seen in its own image.

    Attributes
    ----------
    object_points : array (n, 2 or 3) or (T, n, 2 or 3), m, marker frame; n is 4 or more
    image_points : array (T, n, 2), undistorted px
        Image points in `camera.ideal`, the camera without lens distortion; see `from_distorted`.

    Raises
    ------
    InputError
        If the shapes do not fit or there are fewer than four points.
    """

    object_points: Array
    image_points: Array
    camera: Camera
    _solved: dict["Estimator[Any]", Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        trials, *seen = self.image_points.shape
        *leading, n, axes = self.object_points.shape
        if n < 4 or axes not in (2, 3) or seen != [n, 2] or leading not in ([], [trials]):
            raise InputError(
                "object points (n, 2 or 3) or (T, n, 2 or 3) and image points (T, n, 2) with n >= 4",
                f"{self.object_points.shape} and {self.image_points.shape}",
                "give four or more correspondences",
            )

    @classmethod
    def from_distorted(cls, object_points: Array, pixels: Array, camera: Camera) -> "Correspondences":
        """Correspondences from distorted image points (T, n, 2) in px, as measured in the camera's images.

        Pixels that correspond to no ray make the trial unsolvable.
        """
        if camera.distortion != NO_DISTORTION:
            pixels = camera.ideal.to_pixels(camera.from_pixels(pixels))
        return cls(object_points, pixels, camera)

    def once(self, estimator: "Estimator[E]") -> E:
        """Solve with `estimator` and cache the result, so that LM and IPPE share one IPPE solution.

        Raises
        ------
        InputError
            If the points are not coplanar and the estimator requires coplanar points.
        """
        if estimator.planar_only and not self.planar:
            raise InputError(
                f"control points in the marker's plane for {estimator.name}",
                "a relief",
                "use an estimator for points in space, such as sqpnp",
            )
        if estimator not in self._solved:
            self._solved[estimator] = estimator.solve(self)
        result: E = self._solved[estimator]
        return result

    @property
    def planar(self) -> bool:
        """True if all control points lie in the marker's plane, z = 0."""
        return self.object_points.shape[-1] == 2 or not self.object_points[..., 2].any()

    @cached_property
    def xyz(self) -> Array:
        """Object points (n, 3) or (T, n, 3), m."""
        points = np.asarray(self.object_points, dtype=float)
        return np.pad(points, [(0, 0)] * (points.ndim - 1) + [(0, 3 - points.shape[-1])])

    def of(self, trials: NDArray[np.intp] | NDArray[np.bool_]) -> Array:
        """Object points (n, 3) or (t, n, 3) in m of selected trials, by indices or a mask."""
        return self.xyz if self.xyz.ndim == 2 else self.xyz[trials]

    @cached_property
    def lens(self) -> Array | None:
        """Derivative (T, n, 2, 2) of distorted with respect to undistorted image points; None without distortion."""
        if self.camera.distortion == NO_DISTORTION:
            return None
        normalized = from_pixels(self.image_points, self.camera.matrix)
        return self.camera.pixel_jacobian(normalized) / self.camera.focal

    @cached_property
    def solvable(self) -> NDArray[np.bool_]:
        """Mask (T,) of the trials whose object and image points are finite and neither coincident nor collinear."""
        finite = np.asarray(np.isfinite(self.image_points).all(axis=(-2, -1)))
        images = np.where(finite[:, None, None], self.image_points, 0.0)
        return finite & _spread(images) & _spread(self.xyz)

    def reprojection_error(self, rotation: Array, translation: Array) -> Array:
        """Mean squared distance (T,) in undistorted px^2 between image points and reprojected object points.

        inf for a pose (T, 3, 3), (T, 3) that is not finite or puts a point behind the camera.
        """
        seen = rotated(self.xyz, rotation) + translation[:, None]
        in_front = np.all(seen[..., 2] > 0, axis=-1)
        seen = np.where(in_front[:, None, None], seen, 1.0)
        residual = to_pixels(perspective(seen), self.camera.matrix) - self.image_points
        return np.where(in_front, np.mean(np.sum(residual**2, axis=-1), axis=-1), np.inf)


class Estimator(ABC, Generic[E]):
    """Entry of the table: solves a whole batch at once and never raises for points without a solution.

    Attributes
    ----------
    planar_only : bool
        True if it requires coplanar control points.
    """

    name: ClassVar[str]
    planar_only: ClassVar[bool] = False

    @abstractmethod
    def solve(self, batch: Correspondences) -> E:
        """Solve every trial of the batch, nan where there is no solution; called by `Correspondences.once`."""


class PoseEstimator(Estimator[PoseEstimates]):
    """Estimator of poses."""


class HomographyEstimator(Estimator[Array]):
    """Estimator of homographies (T, 3, 3) from marker plane (m) to image (px)."""

    planar_only = True


def rotated(points: Array, rotation: Array) -> Array:
    """Return R X (t, n, 3) for rotations (t, 3, 3) and points (n, 3), shared by all trials, or (t, n, 3)."""
    return rotate(points, rotation) if points.ndim == 2 else rotate_each(points, rotation)


def _spread(points: Array) -> NDArray[np.bool_]:
    """True where points (..., n, 2 or 3) span two directions."""
    centered = points - points.mean(axis=-2, keepdims=True)
    scatter = np.linalg.eigvalsh(centered.swapaxes(-1, -2) @ centered)
    return np.asarray(scatter[..., -2] > COLLINEAR**2 * scatter[..., -1], dtype=bool)


# --- OpenCV -----------------------------------------------------------------------------------------------------------

AWAY = np.diag([1.0, -1.0, -1.0])
"""Half turn about x: the marker's z then points away from the camera, and an upright frontal marker has R = I."""
MOST_SOLUTIONS = 18
"""Maximum number of solutions of any OpenCV method; SQPnP reserves room for this many."""


def solve_each(batch: Correspondences, method: str, solutions: int = 1) -> PoseEstimates:
    """Poses of every trial by cv2.SOLVEPNP_`method`, k = `solutions` or more, best first; nan for missing ones.

    Only the call itself is in the loop; everything before and after it is done for the whole batch.
    For methods with one solution solvePnP is called, as solvePnPGeneric also reprojects, which takes 10 % of the time.
    """
    import cv2

    flag: int = getattr(cv2, f"SOLVEPNP_{method}")
    solve: Any = cv2.solvePnP if solutions == 1 else cv2.solvePnPGeneric
    matrix = batch.camera.matrix
    objects, images, rotations = opencv_arguments(batch)
    poses = np.full((len(images), MOST_SOLUTIONS, 2, 3), np.nan)
    for trial in np.flatnonzero(batch.solvable):
        try:
            count, vectors, translations, *_ = solve(objects[trial], images[trial], matrix, None, flags=flag)
        except cv2.error:
            continue
        if not count:
            continue
        if solutions == 1:
            poses[trial, 0] = vectors[:, 0], translations[:, 0]
            continue
        solutions = max(solutions, count)
        for k in range(count):
            poses[trial, k] = vectors[k][:, 0], translations[k][:, 0]
    poses = poses[:, :solutions]
    return best_first(batch, exponential(poses[:, :, 0]) @ rotations[:, None], poses[:, :, 1])


def opencv_arguments(batch: Correspondences) -> tuple[Array, Array, Array]:
    """Object points (T, n, 3), image points (T, n, 2) and turn (T, 3, 3) for OpenCV: R_marker = R_opencv turn.

    OpenCV's IPPE is wrong, yet reports success, where the rotation is a half turn about the optical axis or the
    marker's z points toward the camera. So the object is turned such that z points away and its orientation in the
    plane matches the image (the Procrustes angle between both), and the rotation is turned back afterwards.
    """
    images = np.where(batch.solvable[:, None, None], batch.image_points, 0.0)
    away = batch.xyz @ AWAY
    rotations = rotation_z(_procrustes_angle(away[..., :2], images))
    return np.ascontiguousarray(away @ rotations.swapaxes(-1, -2)), np.ascontiguousarray(images), rotations @ AWAY


def best_first(batch: Correspondences, rotation: Array, translation: Array) -> PoseEstimates:
    """Sort the solutions (T, k, 3, 3), (T, k, 3) of every trial by reprojection error; nan for non-finite ones, last.

    OpenCV sorts the solutions of IPPE (though it does not rule out one behind the camera), but not those of SQPnP, the
    first of which is off by a radian for some layouts of four points.
    """
    finite = np.asarray(np.isfinite(rotation).all(axis=(-2, -1)) & np.isfinite(translation).all(axis=-1))
    rotation = np.where(finite[..., None, None], rotation, np.nan)
    translation = np.where(finite[..., None], translation, np.nan)
    solutions = rotation.shape[1]
    if solutions > 1:
        errors = [batch.reprojection_error(rotation[:, k], translation[:, k]) for k in range(solutions)]
        order = np.lexsort((np.stack(errors, axis=1), ~finite), axis=1)
        rotation = np.take_along_axis(rotation, order[..., None, None], axis=1)
        translation = np.take_along_axis(translation, order[..., None], axis=1)
    return PoseEstimates(rotation, translation)


def _procrustes_angle(points: Array, images: Array) -> Array:
    """Angle (T,) in rad of the rotation about the centroids that best aligns points (n, 2) or (T, n, 2) with images."""
    points = points - points.mean(axis=-2, keepdims=True)
    images = images - images.mean(axis=1, keepdims=True)
    sine = np.sum(points[..., 0] * images[..., 1] - points[..., 1] * images[..., 0], axis=-1)
    cosine = np.sum(points * images, axis=(-2, -1))
    return np.asarray(np.arctan2(sine, cosine))
