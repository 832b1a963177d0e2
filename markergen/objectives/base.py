"""Interface of objectives: values per pose with a pullback, aggregated over the poses."""
# tests: tests/optimize/test_constellations.py

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, enumerated
from markergen.maths.information import covariance, information
from markergen.model.boundary import Boundary
from markergen.model.camera import NO_DISTORTION, Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives.aggregates import NONSMOOTH, aggregate_of
from markergen.objectives.observation import DotNoise, DotWeights, in_pairs, linearize_lens
from markergen.registry import Registry

Pullback = Callable[[Array], Array]
T = TypeVar("T")
Losses = NDArray[np.intp]
"""Indices (S, k) of S sets of dots, each of which may be lost."""

POINTS_AT_ONCE = 2_000
"""Projected points in one chunk of a batch, so that intermediate arrays fit the processor's cache."""


@cache
def _threads() -> ThreadPoolExecutor:
    # numpy releases the GIL while it computes, so chunks run in parallel.
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())


@dataclass(frozen=True, eq=False)
class Sight:
    """What each of P poses sees of n dots, and what it knows without them.

    Attributes
    ----------
    seen : array (P, n) of bool
        Dots that count.
    known : array (P, 6, 6)
        Fisher information of the pose from other dots.
    """

    seen: NDArray[np.bool_]
    known: Array


@dataclass(frozen=True, eq=False)
class Carrier:
    """The body that a marker is a plate of, in the marker frame: the pose that counts is the body's.

    Attributes
    ----------
    points : array (m, 3)
        Points in m whose expected displacement the objective ``pose`` is.
    origin : array (3,)
        Origin of the body's frame in m, whose error the objective ``translation`` is.
    """

    points: Array
    origin: Array


@dataclass(frozen=True)
class Setting:
    """Boundary, camera, poses and noise for which a layout is evaluated.

    Attributes
    ----------
    poses : PoseDistribution
        Poses that see the whole boundary.
    noise : DotNoise or None
        Noise model of the dots; None is noise of 1 px on every coordinate of the distorted image.
    sight : Sight or None
        Dots that the poses see, for objectives of a pose; None if all see every dot, and nothing else.
    carrier : Carrier or None
        Body whose pose counts, for objectives of a pose; None for the marker itself.
    """

    boundary: Boundary
    camera: Camera
    poses: PoseDistribution
    noise: DotNoise | None = None
    sight: Sight | None = None
    carrier: Carrier | None = None

    @property
    def noise_words(self) -> str:
        """Noise that bounds in this setting refer to, in words."""
        return str(self.noise) if self.noise else "image noise of 1 px"


@dataclass(frozen=True)
class Criterion:
    """Column of an objective in the tables that designs and studies print.

    Attributes
    ----------
    key : str
        Key of the values in files: name and unit, such as ``pose_m``.
    title : str
        Title of the column, with the unit after applying the factor: ``pose mm``.
    factor : float
        Conversion factor from the objective's unit to the column's.
    place : int
        Sort key of the column; smaller ones are farther to the left.
    bound : callable or None
        Function from the covariance (B, P, 6, 6) of the pose (w, dt) for the noise of the setting, and the poses, to
        values (B, P). Criteria with a bound share one covariance and are computed like the bounds that estimators are
        compared with: their RMS over the poses is printed.
    noiseless : str
        What the criterion is, in words, if it is not proportional to the noise.
    """

    key: str
    title: str
    factor: float = 1.0
    place: int = 100
    bound: Callable[[Array, PoseDistribution], Array] | None = None
    noiseless: str = ""

    @property
    def column(self) -> str:
        """Name of the column in a plain-text table, such as ``pose_mm``."""
        return self.title.replace(" ", "_") if self.factor != 1 else self.key


class Objective(ABC):
    """A criterion for layouts; smaller is better.

    Layouts are (B, n, 2) in the marker's plane or, where the objective is not `planar_only`, (B, n, 3) in space; the
    gradient has the shape of the layouts.

    Parameters
    ----------
    aggregate : str
        Name of an aggregate, such as ``rms`` or ``cvar:0.9``; empty takes the objective's own default.
    coordinates : str
        Coordinate system of the criterion, for objectives that depend on it.

    Attributes
    ----------
    unit : str
        Unit of the values; empty for a dimensionless number.
    nonsmooth : bool
        True if the gradient may be discontinuous at the optimum, which is then approached by softened versions.
    aggregated : callable
        The aggregate: takes values (..., P) and a softness, returns (...) and its derivative.
    planar_only : bool
        True if it is defined only for coplanar points, as a homography is.
    knows_noise : bool
        True if it depends on `Setting.noise`.
    criterion : Criterion or None
        Column in the tables, if any.
    """

    unit: str = ""
    default_aggregate: str = "rms"
    coordinates: tuple[str, ...] = ("unit",)
    nonsmooth_values: bool = False
    planar_only: bool = False
    knows_noise: bool = True
    default_restarts: int = 16
    criterion: ClassVar[Criterion | None] = None

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        if coordinates not in self.coordinates:
            several = ", ".join(name for name in OBJECTIVES if len(OBJECTIVES[name].coordinates) > 1)
            remedy = f"known: {', '.join(self.coordinates)}; only --objective {several} depends on them"
            raise InputError("coordinates that the objective knows", repr(coordinates), remedy)
        self.setting = setting
        self.aggregate = aggregate or self.default_aggregate
        self.aggregated = aggregate_of(self.aggregate, setting.poses.weight)

    @property
    def nonsmooth(self) -> bool:
        """See `Objective`."""
        return self.nonsmooth_values or self.aggregate.partition(":")[0] in NONSMOOTH

    @abstractmethod
    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """Values (B, P) of layouts (B, n, .), and their pullback: weights (B, P) to sum_p weights dvalue/dpoints."""

    def linearize_without(self, points: Array, losses: Losses, softness: float = 0.0) -> tuple[Array, Pullback]:
        """Values (B, S, P) with the dots of each of S losses left out, and their pullback from weights (B, S, P)."""
        kept = [np.delete(np.arange(points.shape[1]), loss) for loss in losses]
        values = np.stack([self.linearize(points[:, rest], softness)[0] for rest in kept], axis=1)

        def pullback(weights: Array) -> Array:
            gradient = np.zeros_like(points)
            # Recompute the few losses with nonzero weight: storing all of them would take too much memory.
            for loss, rest in enumerate(kept):
                rows = np.flatnonzero(weights[:, loss].any(axis=-1))
                if rows.size:
                    _, back = self.linearize(points[rows][:, rest], softness)
                    gradient[np.ix_(rows, rest)] += back(weights[rows, loss])
            return gradient

        return values, pullback

    def per_pose(self, points: Array) -> Array:
        """Values (B, P) of layouts (B, n, .) in m; inf for degenerate layouts."""
        return np.concatenate(self._in_chunks(lambda chunk: self.linearize(chunk)[0], points))

    def __call__(self, points: Array) -> Array:
        """Aggregated values (B,) of layouts (B, n, .) in m."""
        with np.errstate(invalid="ignore"):
            return self.aggregated(self.per_pose(points), 0.0)[0]

    def value_and_gradient(self, points: Array, softness: float = 0.0) -> tuple[Array, Array]:
        """Aggregated values (B,) and their gradients (B, n, .), per m, for layouts (B, n, .) in m.

        The gradient of a layout without a finite value is zero.
        """

        def both(chunk: Array) -> tuple[Array, Array]:
            value, pullback = self.reduced(chunk, softness)
            gradient = pullback(np.ones_like(value))
            return value, np.where(np.isfinite(value)[:, None, None], gradient, 0.0)

        values, gradients = zip(*self._in_chunks(both, points), strict=True)
        return np.concatenate(values), np.concatenate(gradients)

    def of_layouts(self, kept: NDArray[np.bool_]) -> "Objective":
        """Objective of those layouts of a batch that are kept: this one, unless layouts have different poses."""
        del kept
        return self

    def reduced(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """Aggregated values (B,) of layouts (B, n, .), and their pullback: weights (B,) to weights times gradients."""
        per_pose, pullback = self.linearize(points, softness)
        with np.errstate(invalid="ignore"):
            value, derivative = self.aggregated(per_pose, softness)

        def back(weights: Array) -> Array:
            with np.errstate(invalid="ignore"):
                return pullback(derivative * weights[:, None])

        return value, back

    def _in_chunks(self, function: Callable[[Array], T], points: Array) -> list[T]:
        """Apply the function to chunks of the batch in parallel; chunks do not depend on the number of cores."""
        if self.planar_only and points.shape[-1] > 2:
            raise InputError(
                "control points in the marker's plane for this objective",
                "a relief",
                f"use --objective {enumerated(name for name in OBJECTIVES if not OBJECTIVES[name].planar_only)}",
            )
        size = max(1, POINTS_AT_ONCE // (len(self.setting.poses) * points.shape[1]))
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        return list(_threads().map(function, chunks)) if len(chunks) > 1 else [function(points)]


class TraceObjective(Objective):
    """sqrt(trace(W C)), C = M^-1 the first-order covariance, M the Fisher information.

    M = J'J for image noise of 1 px; with `Setting.noise` M = sum of J_i' F_i J_i over the dots, F_i being the
    information of a dot's center (`markergen.maths.dot_crlb`), which depends on the dot's position. J and the noise are
    those of the distorted image (`markergen.objectives.observation`). The gradient has the closed form
    d trace(W M^-1) = -<S, dM> with S = M^-1 W M^-1, that is -2 <J S, dJ> for J'J.
    """

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        super().__init__(setting, aggregate, coordinates)
        self.weight = self._weight()
        self._dots: DotWeights | None = None
        if setting.noise:
            self._dots = DotWeights(setting.noise, self._plane(), self._distorted(np.zeros((1, 2)))[0])

    @abstractmethod
    def _weight(self) -> Array:
        """W (P, k, k)."""

    @abstractmethod
    def _jacobian(self, points: Array) -> Array:
        """J (B, P, 2n, k) of undistorted image points, for points (B, n, .)."""

    @abstractmethod
    def _plane(self) -> Array:
        """T (P, k, 2) with J T = d(image point)/d(X, Y): a point's motion in the plane as a change of parameters."""

    @abstractmethod
    def _jacobian_pullback(self, cotangent: Array, points: Array) -> Array:
        """Gradient (B, P, n, .) with respect to the points of sum(cotangent * J)."""

    def covariance(self, points: Array) -> Array:
        """C (B, P, k, k) for layouts (B, n, .) in m; inf for degenerate layouts."""
        matrices = covariance(self._information(self._distorted(points)[0])[0])
        return np.where(np.isnan(matrices), np.inf, matrices)

    def information(self, points: Array) -> tuple[Array, Pullback]:
        """M (B, P, k, k) of layouts (B, n, .) in m, and its pullback from a cotangent (B, P, k, k) to the points."""
        jacobian, to_points = self._distorted(points)
        matrix, through_weights = self._information(jacobian)

        def pullback(cotangent: Array) -> Array:
            # The inner pullbacks return the gradient of half of <S, dM>, for a symmetric S.
            sensitivity = cotangent + cotangent.swapaxes(-1, -2)
            return to_points(through_weights(jacobian @ sensitivity)).sum(axis=1)

        return matrix, pullback

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; smooth everywhere, so softness has no effect."""
        del softness
        jacobian, to_points = self._distorted(points)
        matrix, through_weights = self._information(jacobian)
        inverse = covariance(matrix)
        values, weighted = self._values(inverse)

        def pullback(weights: Array) -> Array:
            sensitivity = inverse @ weighted * (-weights / values)[..., None, None]
            return to_points(through_weights(jacobian @ sensitivity)).sum(axis=1)

        return values, pullback

    def linearize_without(self, points: Array, losses: Losses, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize_without`; the lost dots' information is subtracted from the total."""
        del softness
        jacobian, to_points = self._distorted(points)
        weighed, through_weights = self._weighed(jacobian)
        matrix = jacobian.swapaxes(-1, -2) @ weighed
        shares = in_pairs(jacobian).swapaxes(-1, -2) @ in_pairs(weighed)
        values = np.stack(
            [self._values(covariance(matrix - shares[:, :, loss].sum(axis=2)))[0] for loss in losses], axis=1
        )

        def pullback(weights: Array) -> Array:
            everywhere, lost = np.zeros_like(matrix), np.zeros_like(shares)
            for index, loss in enumerate(losses):
                rows = np.flatnonzero(weights[:, index].any(axis=-1))
                if rows.size:
                    inverse = covariance(matrix[rows] - shares[rows][:, :, loss].sum(axis=2))
                    factor = -weights[rows, index] / values[rows, index]
                    part = inverse @ self.weight @ inverse * factor[..., None, None]
                    everywhere[rows] += part
                    lost[rows[:, None], :, loss] += part[:, None]
            sensitivity = everywhere[:, :, None] - lost
            cotangent = (in_pairs(jacobian) @ sensitivity).reshape(jacobian.shape)
            return to_points(through_weights(cotangent)).sum(axis=1)

        return values, pullback

    def _values(self, inverse: Array) -> tuple[Array, Array]:
        """sqrt(trace(W C)), inf where undefined, and W C, for covariances C (..., P, k, k)."""
        with np.errstate(invalid="ignore"):
            weighted = self.weight @ inverse
            trace = np.trace(weighted, axis1=-2, axis2=-1)
        # A rounded inverse of a singular matrix can have a negative or undefined trace.
        return np.sqrt(np.where(trace > 0, trace, np.inf)), weighted

    def _distorted(self, points: Array) -> tuple[Array, Pullback]:
        """J of the distorted image points, and its pullback to the points (B, P, n, .)."""
        sight = self.setting.sight
        if not sight or points.shape[1] != sight.seen.shape[1]:
            return self._all_distorted(points)
        # Dots that are not seen may lie in the plane of the camera's center.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            jacobian, back = self._all_distorted(points)
        rows, dots = np.repeat(sight.seen, 2, axis=-1)[..., None], sight.seen[..., None]

        def pullback(cotangent: Array) -> Array:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                return np.where(dots, back(np.where(rows, cotangent, 0.0)), 0.0)

        return np.where(rows, jacobian, 0.0), pullback

    def _all_distorted(self, points: Array) -> tuple[Array, Pullback]:
        jacobian, camera = self._jacobian(points), self.setting.camera
        if camera.distortion == NO_DISTORTION:
            return jacobian, lambda cotangent: self._jacobian_pullback(cotangent, points)
        taken, back = linearize_lens(jacobian, points, camera, self.setting.poses)

        def pullback(cotangent: Array) -> Array:
            ideal, by_lens = back(cotangent)
            return self._jacobian_pullback(ideal, points) + by_lens

        return taken, pullback

    def _information(self, jacobian: Array) -> tuple[Array, Pullback]:
        """M (B, P, k, k), and the pullback of half of <S, dM>, given J S, to a cotangent of J."""
        sight = self.setting.sight
        if self._dots is None and sight is None:
            return information(jacobian), lambda cotangent: cotangent
        weighed, pullback = self._weighed(jacobian)
        matrix = jacobian.swapaxes(-1, -2) @ weighed
        return matrix + sight.known if sight else matrix, pullback

    def _weighed(self, jacobian: Array) -> tuple[Array, Pullback]:
        """F J, and the pullback of `_information`; S may differ between dots."""
        weighed, pullback = self._dots(jacobian) if self._dots else (jacobian, lambda cotangent: cotangent)
        if not self.setting.sight:
            return weighed, pullback
        rows = np.repeat(self.setting.sight.seen, 2, axis=-1)[..., None]
        return np.where(rows, weighed, 0.0), lambda cotangent: np.where(
            rows, pullback(np.where(rows, cotangent, 0.0)), 0.0
        )


OBJECTIVES: Registry[type[Objective]] = Registry(
    "objective", "markergen.objectives", "markergen.objectives", type[Objective]
)
"""Objectives by name; each entry is a subclass of `Objective`."""
