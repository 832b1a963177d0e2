"""Distance of rival labelings of the dots from fitting their images, each at its best pose.

For a pose T and a permutation s of the dots, the rival labeling takes the image of dot s(j) for that
of dot j. Its distance from fitting is

    D(T, s) = min over T' of sqrt(sum over j of |m_T(X_s(j)) - m_T'(X_j)|^2),

with m_T the projection in px and T' any pose that has all dots in front of the camera and shows their printed side, not
edge-on; this excludes mirror images. If the total displacement of the images, root of the sum of squares over the dots,
is less than D/2, the true labeling fits better than s: the residual is less than D/2 at the true pose, and more at
every pose of the rival.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices, Mask
from markergen.bounds.confusion.evidence import margin, undecided
from markergen.maths.batched import Batched
from markergen.maths.information import apply_pose_step, pose_jacobian
from markergen.maths.levenberg_marquardt import Arrays, Attempt, Damping, LeastSquares, levenberg_marquardt
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution

STEPS, TOLERANCE, NOTHING = 40, 1e-9, 1e-14
"""Maximum number of steps of a fit; relative decrease of the sum of squares, and the sum in px^2, at which it ends."""

ROUGH_STEPS, ROUGH_TOLERANCE = 10, 1e-3
"""The same for fits that are only compared."""

DAMPING = Damping(start=1e-3, least=1e-9, most=1e8)

EDGE_ON, WALL_PX = float(np.cos(np.deg2rad(80.0))), 300.0
"""Minimum cosine of a rival's tilt, and penalty residual at cosine 0: at larger tilts dots appear as lines and are not
mistaken for those seen. The minimum is lowered to half the smallest cosine of the poses if that is less."""

_AT_ONCE = 40_000
"""Projected points in one batch, which limits the Jacobian and derived arrays to about 10 MB."""


@dataclass(frozen=True, eq=False)
class Rivals(Batched):
    """K wrong labelings, each for one pose of a distribution.

    Attributes
    ----------
    labeling : array (K, n) of int
        Index of the dot whose image is taken for that of dot j.
    pose : array (K,) of int
        Index of the true pose T.
    rotation, translation : arrays (K, 3, 3) and (K, 3) in m
        The rival's pose T'.
    distance : array (K,), px
        D, the root of the sum over the dots; inf where no pose shows the dots.
    """

    labeling: Indices
    pose: Indices
    rotation: Array
    translation: Array
    distance: Array

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Mask (K, n) of the dots that are taken for others."""
        return self.labeling != np.arange(self.labeling.shape[1])

    @property
    def px(self) -> Array:
        """Safety (K,) in px: RMS displacement of the dots, D/(2 sqrt(n)), below which the true labeling fits better."""
        return self.distance / (2 * np.sqrt(self.labeling.shape[1]))

    def best_per_dot(self, count: int = 1) -> Indices:
        """Indices of up to `count` nearest rivals of each dot, without repeats."""
        away = np.where(self.moved, self.distance[:, None], np.inf)
        order = np.argsort(away, axis=0, kind="stable")[:count]
        return np.unique(order[np.isfinite(np.take_along_axis(away, order, axis=0))])

    def nearest_labelings(self, count: int, per_dot: int) -> Indices:
        """Labelings (K, n) ranked by their nearest pose: the nearest `count`, and the `per_dot` that move each dot."""
        order = np.argsort(self.distance, kind="stable")
        order = order[np.isfinite(self.distance[order])]
        _, first = np.unique(self.labeling[order], axis=0, return_index=True)
        nearest = self.take(order[np.sort(first)])
        chosen = np.union1d(np.arange(min(count, len(nearest))), nearest.best_per_dot(per_dot))
        return nearest.labeling[chosen]


@dataclass(frozen=True, eq=False)
class SeenLayout:
    """Dots and their images from each pose.

    Attributes
    ----------
    points : array (n, 3), m
    kinds : array (n,) of int
        Dots of different kinds differ in appearance; dots of the same kind differ only in position.
    poses : PoseDistribution
        P poses.
    rays : array (P, n, 2)
        Images in normalized coordinates.
    images : array (P, n, 2), px
        Images in distorted px.
    """

    points: Array
    kinds: Indices
    camera: Camera
    poses: PoseDistribution
    rays: Array
    images: Array

    @cached_property
    def edge_on(self) -> float:
        """Minimum cosine of a rival's tilt."""
        return float(min(EDGE_ON, 0.5 * self.poses.cos_tilt.min()))

    def judged(self, distance: Array, pose: Indices, noise_px: float) -> tuple[Array, Array]:
        """`margin` and `undecided` (K,) of rivals at a distance (K,) in px at poses (K,), see `evidence`."""
        middle = self.points.mean(axis=0)
        size = float(np.linalg.norm(self.points - middle, axis=-1).max())
        depth = to_camera(middle[None], self.poses.rotation[pose], self.poses.translation[pose])[:, 0, 2]
        seen = distance, len(self.points), self.camera.fx / depth, size, noise_px
        return margin(*seen), undecided(*seen)

    @property
    def truth(self) -> Indices:
        """The true labeling (n,)."""
        return np.arange(len(self.points))

    def fit(self, labeling: Indices, pose: Indices, rough: bool = False) -> Rivals:
        """Fit labelings (K, n) at poses (K,), from both poses whose affine map is nearest to the images."""
        size = max(1, _AT_ONCE // (4 * len(self.points)))
        parts = [slice(start, start + size) for start in range(0, max(1, len(labeling)), size)]
        fits = [self._fit(labeling[part], pose[part], rough) for part in parts]
        return Rivals(*(np.concatenate([getattr(part, field.name) for part in fits]) for field in fields(Rivals)))

    def refit(self, rivals: Rivals) -> Rivals:
        """Fit rivals, which may come from another layout, starting from their current poses."""
        return self._fitted(rivals.labeling, rivals.pose, rivals.rotation, rivals.translation, rough=False)

    def _fit(self, labeling: Indices, pose: Indices, rough: bool) -> Rivals:
        rays = np.take_along_axis(self.rays[pose], labeling[..., None], axis=1)
        starts, back = _starts(self.points, rays, self.edge_on)
        every, backs = np.arange(len(pose)), np.flatnonzero(back)
        rows = [every, every, backs, backs]
        rotation, translation = (
            np.concatenate([start[part][chosen] for start, chosen in zip(starts, rows, strict=True)]) for part in (0, 1)
        )
        source = np.concatenate(rows)
        fitted = self._fitted(labeling[source], pose[source], rotation, translation, rough)
        order = np.lexsort((fitted.distance, source))
        return fitted.take(order[np.unique(source[order], return_index=True)[1]])

    def _fitted(self, labeling: Indices, pose: Indices, rotation: Array, translation: Array, rough: bool) -> Rivals:
        images = np.take_along_axis(self.images[pose], labeling[..., None], axis=1)
        fitted = fit_poses(self.points, images, self.camera, rotation, translation, self.edge_on, rough)
        return Rivals(labeling, pose, *fitted)


def seen_layout(points: Array, kinds: Indices, camera: Camera, poses: PoseDistribution) -> SeenLayout:
    """Create the `SeenLayout` of points (n, 2) or (n, 3) in m."""
    points = np.pad(np.asarray(points, dtype=float), ((0, 0), (0, 3 - points.shape[1])))
    rays = perspective(to_camera(points, poses.rotation, poses.translation))
    return SeenLayout(points, kinds, camera, poses, rays, camera.to_pixels(rays))


def fit_poses(
    points: Array,
    images: Array,
    camera: Camera,
    rotation: Array,
    translation: Array,
    edge_on: float = EDGE_ON,
    rough: bool = False,
) -> tuple[Array, Array, Array]:
    """Poses (K, 3, 3), (K, 3) that bring points (n, 3) nearest to images (K, n, 2) in px, and their distances D (K,).

    Levenberg-Marquardt on the sum of squares for all poses at once, including lens distortion. An additional residual
    keeps the cosine of the tilt above `edge_on`; D includes it, and so never exceeds its value at the limit. D is inf
    where the start does not have all points in front of the camera with their printed side toward it; steps that would
    leave this domain are rejected.
    """
    fit = RivalFit(points, images, camera, edge_on, ROUGH_TOLERANCE if rough else TOLERANCE)
    steps = ROUGH_STEPS if rough else STEPS
    (rotation, translation), cost = levenberg_marquardt(fit, (rotation, translation), DAMPING, steps)
    return rotation, translation, np.sqrt(cost)


@dataclass(frozen=True, eq=False)
class RivalFit(LeastSquares):
    """Residuals of K poses, all in px: those of n images (K, n, 2), then that of the tilt."""

    points: Array
    images: Array
    camera: Camera
    edge_on: float
    tolerance: float = TOLERANCE

    def residuals(self, unknowns: Arrays) -> Arrays:
        """Sum of squares (K,), image minus projection (K, 2n + 1), and normalized projections (K, n, 2)."""
        rotation, translation = unknowns
        seen = to_camera(self.points, rotation, translation)
        cosine = _cos_tilt(rotation, translation)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            normalized = perspective(seen)
            offset = (self.images - self.camera.to_pixels(normalized)).reshape(len(seen), 2 * len(self.points))
            # The target of this residual is the limit, its prediction the tilt.
            tilt = WALL_PX * np.maximum(1 - cosine / self.edge_on, 0.0)
            residual = np.concatenate([offset, tilt[:, None]], axis=-1)
            cost = np.sum(residual**2, axis=-1)
        # There is no image outside the domain of the lens model.
        is_visible = (seen[..., 2] > 0).all(axis=-1) & (cosine > 0) & np.isfinite(cost)
        return np.where(is_visible, cost, np.inf), residual, normalized

    def worth_a_step(self, cost: Array) -> Mask:
        """Mask of the problems that start in front of the camera and do not fit already."""
        return np.asarray(np.isfinite(cost) & (cost > NOTHING))

    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """See `LeastSquares.moved`."""
        return apply_pose_step(unknowns[0], unknowns[1], step)

    def converged(self, attempt: Attempt) -> Mask:
        """Mask of the problems that no longer improve, or that fit."""
        settled = attempt.good & (attempt.after >= attempt.before * (1 - self.tolerance))
        return np.asarray(settled | (attempt.cost <= NOTHING))

    def take(self, chosen: Mask) -> "RivalFit":
        """See `LeastSquares.take`."""
        return replace(self, images=self.images[chosen])

    def jacobian(self, unknowns: Arrays, results: Arrays) -> Array:
        """Derivative (K, 2n + 1, 6) of the projections by the pose (w, dt)."""
        (rotation, translation), (*_, normalized) = unknowns, results
        rows = self.image_rows(rotation, translation, normalized).reshape(len(rotation), 2 * len(self.points), 6)
        axis, distance = rotation[:, :, 2], np.linalg.norm(translation, axis=-1)[:, None]
        cosine = _cos_tilt(rotation, translation)[:, None]
        toward = -translation / distance
        by_translation = (cosine * toward - axis) / distance
        by_pose = np.concatenate([np.cross(axis, toward), by_translation], axis=-1)
        wall = np.where(cosine < self.edge_on, WALL_PX / self.edge_on * by_pose, 0.0)
        return np.concatenate([rows, wall[:, None]], axis=1)

    def image_rows(self, rotation: Array, translation: Array, normalized: Array) -> Array:
        """Derivative (K, n, 2, 6) of the images in px by the pose (w, dt)."""
        rows = pose_jacobian(self.points, rotation, translation, np.ones(2)).reshape(*normalized.shape, 6)
        return self.camera.pixel_jacobian(normalized) @ rows


def _cos_tilt(rotation: Array, translation: Array) -> Array:
    return -np.sum(rotation[:, :, 2] * translation, axis=-1) / np.linalg.norm(translation, axis=-1)


def _starts(points: Array, rays: Array, edge_on: float) -> tuple[list[tuple[Array, Array]], NDArray[np.bool_]]:
    """Poses whose affine maps are near the one that brings points (n, 3) nearest to rays (K, n, 2).

    Seen along the ray of their mean, points near a plane map by A = s M, with M the upper left block of R. As the
    columns of R are unit vectors, A'A = s^2 (I - v v') with v = (R31, R32): s is the larger singular value of A, v has
    the direction of the smaller one, and its sign is free, which gives two poses. Where A shows the back, the mask (K,)
    is true: the nearest poses that do not are edge-on, and two more with the other axis of A may be nearer still.
    """
    mean = rays.mean(axis=1)
    forward = np.concatenate([mean, np.ones((len(mean), 1))], axis=-1)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    side = np.cross(np.array([0.0, 1.0, 0.0]), forward)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    view = np.stack([side, np.cross(forward, side), forward], axis=1)
    rotated = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ view.swapaxes(-1, -2)
    flat = rotated[..., :2] / rotated[..., 2:]
    middle = points.mean(axis=0)
    affine = np.linalg.pinv(points[:, :2] - middle[:2]) @ (flat - flat.mean(axis=1, keepdims=True))
    left, values, right = np.linalg.svd(affine.swapaxes(-1, -2))
    # Seen from the front, image and marker have opposite orientations, as the image's y axis points down.
    back = np.linalg.det(left) * np.linalg.det(right) > 0
    starts = []
    for major in (0, 1):
        minor = 1 - major
        scale = np.maximum(values[:, major], 1e-12)
        foreshortening = np.where(back, 0.0, values[:, 1] / scale)
        cosine = np.clip(foreshortening, edge_on, 1.0)[:, None]
        across = left[..., minor] * np.where(back, -1.0, 1.0)[:, None]
        block = (
            left[..., major, None] * right[:, major, None, :] + (cosine * across)[..., None] * right[:, minor, None, :]
        )
        for sign in (1.0, -1.0):
            last = sign * np.sqrt(1 - cosine**2) * right[:, minor]
            columns = np.concatenate([block, last[:, None]], axis=1)
            rotation = np.concatenate([columns, np.cross(columns[..., 0], columns[..., 1])[..., None]], axis=-1)
            rotation = view.swapaxes(-1, -2) @ rotation
            place = np.concatenate([flat.mean(axis=1), np.ones((len(flat), 1))], axis=-1) / scale[:, None]
            starts.append((rotation, np.einsum("kji,kj->ki", view, place) - rotation @ middle))
    return starts, back
