"""What an objective is: values per pose with a pullback, aggregated over the poses."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.maths.information import covariance, information
from markergen.model.boundary import Boundary
from markergen.model.camera import NO_DISTORTION, Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives.aggregates import NONSMOOTH, aggregate_of
from markergen.objectives.observation import DotNoise, DotWeights, in_pairs, linearize_lens
from markergen.registry import Registry

Array = NDArray[np.float64]
Pullback = Callable[[Array], Array]
T = TypeVar("T")
Losses = NDArray[np.intp]
"""S sets (S, k) of dots, by their indices, each of which may be lost."""

POINTS_AT_ONCE = 2_000
"""Projected points in one chunk of a batch: intermediate arrays then stay within the processor's cache."""


@cache
def _threads() -> ThreadPoolExecutor:
    # numpy leaves the interpreter's lock while it computes, so that chunks really run side by side.
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())


@dataclass(frozen=True)
class Setting:
    """Where a layout is judged.

    Attributes
    ----------
    boundary : Boundary
    camera : Camera
    poses : PoseDistribution
        Those that see the boundary whole.
    noise : DotNoise or None
        What the image tells about the dots; None is noise of 1 px on every coordinate of the distorted image.
    """

    boundary: Boundary
    camera: Camera
    poses: PoseDistribution
    noise: DotNoise | None = None

    @property
    def noise_words(self) -> str:
        """What bounds in this setting are for."""
        return str(self.noise) if self.noise else "image noise of 1 px"


@dataclass(frozen=True)
class Criterion:
    """How an objective appears in the tables that every design and study prints.

    Attributes
    ----------
    key : str
        Of its values in files: name and unit, such as ``pose_m``.
    title : str
        Of its column, with the unit after the factor: ``pose mm``.
    factor : float
        From the objective's unit to that of the column.
    place : int
        Smaller ones stand farther to the left.
    bound : callable or None
        Values (B, P) from the covariance (B, P, 6, 6) of the pose (w, dt) for the noise of the setting, and the poses.
        Criteria that have it share one covariance, and come out as the bounds do that estimators are held against:
        their RMS over the poses is printed.
    proportional : bool
        Whether it is proportional to the noise.
    """

    key: str
    title: str
    factor: float = 1.0
    place: int = 100
    bound: Callable[[Array, PoseDistribution], Array] | None = None
    proportional: bool = True

    @property
    def column(self) -> str:
        """Name of its column in a table of plain text: ``pose_mm``."""
        return self.title.replace(" ", "_") if self.factor != 1 else self.key


class Objective(ABC):
    """A criterion of layouts, smaller is better.

    Layouts are (B, n, 2) in the marker's plane or, where the objective is not `planar_only`, (B, n, 3) in space; the
    gradient has the shape of the layouts.

    Parameters
    ----------
    setting : Setting
    aggregate : str
        Name of an aggregate, such as ``rms`` or ``cvar:0.9``; empty takes the objective's own default.
    coordinates : str
        The coordinates that the criterion is written in, for those that depend on it.

    Attributes
    ----------
    unit : str
        Of the values; empty for a bare number.
    nonsmooth : bool
        Whether the optimum may sit where the gradient jumps, so that a softened version leads there.
    aggregated : callable
        The aggregate: takes values (..., P) and a softness, returns (...) and its derivative.
    planar_only : bool
        Whether it knows only points in one plane, as a homography does.
    knows_noise : bool
        Whether it depends on `Setting.noise`.
    criterion : Criterion or None
        Its column in the tables; None where it has none.
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
        self.aggregated = aggregate_of(self.aggregate)

    @property
    def nonsmooth(self) -> bool:
        """See the class."""
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
            # Computed again where a loss counts at all, which few do: kept, they would fill the memory.
            for loss, rest in enumerate(kept):
                rows = np.flatnonzero(weights[:, loss].any(axis=-1))
                if rows.size:
                    _, back = self.linearize(points[rows][:, rest], softness)
                    gradient[np.ix_(rows, rest)] += back(weights[rows, loss])
            return gradient

        return values, pullback

    def per_pose(self, points: Array) -> Array:
        """Values (B, P) of layouts (B, n, .) in m; inf where a layout determines nothing."""
        return np.concatenate(self._in_chunks(lambda chunk: self.linearize(chunk)[0], points))

    def __call__(self, points: Array) -> Array:
        """Aggregated values (B,) of layouts (B, n, .) in m."""
        with np.errstate(invalid="ignore"):
            return self.aggregated(self.per_pose(points), 0.0)[0]

    def value_and_gradient(self, points: Array, softness: float = 0.0) -> tuple[Array, Array]:
        """Aggregated values (B,) and their gradients (B, n, .), per m, for layouts (B, n, .) in m.

        A layout without a finite value gets a gradient of zero.
        """

        def both(chunk: Array) -> tuple[Array, Array]:
            value, gradient = self._value_and_gradient(chunk, softness)
            return value, np.where(np.isfinite(value)[:, None, None], gradient, 0.0)

        values, gradients = zip(*self._in_chunks(both, points), strict=True)
        return np.concatenate(values), np.concatenate(gradients)

    def _value_and_gradient(self, points: Array, softness: float) -> tuple[Array, Array]:
        per_pose, pullback = self.linearize(points, softness)
        with np.errstate(invalid="ignore"):
            value, derivative = self.aggregated(per_pose, softness)
            return value, pullback(derivative)

    def _in_chunks(self, function: Callable[[Array], T], points: Array) -> list[T]:
        """Results on chunks of the batch, computed side by side; how many cores there are changes no chunk."""
        if self.planar_only and points.shape[-1] > 2:
            raise InputError(
                "control points in the marker's plane for this objective",
                "a relief",
                f"use --objective {either(name for name in OBJECTIVES if not OBJECTIVES[name].planar_only)}",
            )
        size = max(1, POINTS_AT_ONCE // (len(self.setting.poses) * points.shape[1]))
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        return list(_threads().map(function, chunks)) if len(chunks) > 1 else [function(points)]


class TraceObjective(Objective):
    """sqrt(trace(W C)), C = M^-1 the first-order covariance, M the Fisher information.

    M = J'J for image noise of 1 px; with `Setting.noise` M = sum of J_i' F_i J_i over the dots, F_i the information of
    a dot's center (`markergen.maths.dot_crlb`), which depends on where the dot is. J and the noise are those of the
    distorted image, through the lens (`markergen.objectives.observation`). The gradient is closed:
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
        """T (P, k, 2) with J T = d(image point)/d(X, Y): a point moved in the plane, as a change of the parameters."""

    @abstractmethod
    def _jacobian_pullback(self, cotangent: Array, points: Array) -> Array:
        """Gradient (B, P, n, .) with respect to the points of sum(cotangent * J)."""

    def covariance(self, points: Array) -> Array:
        """C (B, P, k, k) for layouts (B, n, .) in m; inf where a layout determines nothing."""
        found = covariance(self._information(self._distorted(points)[0])[0])
        return np.where(np.isnan(found), np.inf, found)

    def information(self, points: Array) -> tuple[Array, Pullback]:
        """M (B, P, k, k) of layouts (B, n, .) in m, and its pullback: a cotangent (B, P, k, k) to the points."""
        jacobian, to_points = self._distorted(points)
        matrix, through_weights = self._information(jacobian)

        def pullback(cotangent: Array) -> Array:
            # What is passed on is the gradient of half of <S, dM>, for a symmetric S.
            sensitivity = cotangent + cotangent.swapaxes(-1, -2)
            return to_points(through_weights(jacobian @ sensitivity)).sum(axis=1)

        return matrix, pullback

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; smooth everywhere, so softness changes nothing."""
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
        """See `Objective.linearize_without`; what the lost dots tell is taken off the information of all."""
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
            turned = (in_pairs(jacobian) @ sensitivity).reshape(jacobian.shape)
            return to_points(through_weights(turned)).sum(axis=1)

        return values, pullback

    def _values(self, inverse: Array) -> tuple[Array, Array]:
        """sqrt(trace(W C)), inf where that is nothing, and W C, of covariances C (..., P, k, k)."""
        with np.errstate(invalid="ignore"):
            weighted = self.weight @ inverse
            trace = np.trace(weighted, axis1=-2, axis2=-1)
        # A rounded inverse of a singular matrix can have a negative or undefined trace.
        return np.sqrt(np.where(trace > 0, trace, np.inf)), weighted

    def _distorted(self, points: Array) -> tuple[Array, Pullback]:
        """J of the distorted image points, and its pullback to the points (B, P, n, .)."""
        jacobian, camera = self._jacobian(points), self.setting.camera
        if camera.distortion == NO_DISTORTION:
            return jacobian, lambda cotangent: self._jacobian_pullback(cotangent, points)
        taken, back = linearize_lens(jacobian, points, camera, self.setting.poses)

        def pullback(cotangent: Array) -> Array:
            ideal, by_lens = back(cotangent)
            return self._jacobian_pullback(ideal, points) + by_lens

        return taken, pullback

    def _information(self, jacobian: Array) -> tuple[Array, Pullback]:
        """M (B, P, k, k), and what J S, for half of <S, dM>, is as a cotangent of J."""
        if self._dots is None:
            return information(jacobian), lambda turned: turned
        weighed, pullback = self._weighed(jacobian)
        return jacobian.swapaxes(-1, -2) @ weighed, pullback

    def _weighed(self, jacobian: Array) -> tuple[Array, Pullback]:
        """F J, and the pullback of `_information`; S may be another one for each dot."""
        return self._dots(jacobian) if self._dots else (jacobian, lambda turned: turned)


OBJECTIVES: Registry[type[Objective]] = Registry(
    "objective", "markergen.objectives", "markergen.objectives", type[Objective]
)
"""Objectives by name; an entry is a subclass of `Objective`."""


def either(names: Iterable[str]) -> str:
    """``a, b or c``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
