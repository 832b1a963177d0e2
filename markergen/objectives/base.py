"""What an objective is: values per pose with a pullback, aggregated over the poses."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.maths.information import covariance, information
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.weights import DotNoise, DotWeights
from markergen.registry import Registry

Array = NDArray[np.float64]
Pullback = Callable[[Array], Array]
T = TypeVar("T")

POINTS_AT_ONCE = 10_000
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
        What the image tells about the dots; None is noise of 1 px on every coordinate.
    """

    boundary: Boundary
    camera: Camera
    poses: PoseDistribution
    noise: DotNoise | None = None

    @property
    def noise_words(self) -> str:
        """What bounds in this setting are for."""
        return str(self.noise) if self.noise else "image noise of 1 px"


class Objective(ABC):
    """A criterion of layouts, smaller is better.

    Parameters
    ----------
    setting : Setting
    aggregate : str
        Name of an aggregate; empty takes the objective's own default.
    coordinates : str
        The coordinates that the criterion is written in, for those that depend on it.

    Attributes
    ----------
    unit : str
        Of the values; empty for a bare number.
    kinked : bool
        Whether the optimum may sit where the gradient jumps, so that a softened version leads there.
    """

    unit: ClassVar[str]
    default_aggregate: ClassVar[str] = "rms"
    coordinates: ClassVar[tuple[str, ...]] = ("unit",)
    has_kinks: ClassVar[bool] = False
    default_restarts: ClassVar[int]

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        if coordinates not in self.coordinates:
            remedy = f"known: {', '.join(self.coordinates)}; only --objective condition depends on them"
            raise InputError("coordinates that the objective knows", repr(coordinates), remedy)
        self.setting = setting
        self.aggregate = aggregate or self.default_aggregate
        self._aggregate = AGGREGATES[self.aggregate]

    @property
    def kinked(self) -> bool:
        """See the class."""
        return self.has_kinks or self.aggregate == "max"

    @abstractmethod
    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """Values (B, P) of layouts (B, n, 2), and their pullback: weights (B, P) to sum_p weights dvalue/dpoints."""

    def per_pose(self, points: Array) -> Array:
        """Values (B, P) of layouts (B, n, 2) in m; inf where a layout determines nothing."""
        return np.concatenate(self._in_chunks(lambda chunk: self.linearize(chunk)[0], points))

    def __call__(self, points: Array) -> Array:
        """Aggregated values (B,) of layouts (B, n, 2) in m."""
        with np.errstate(invalid="ignore"):
            return self._aggregate(self.per_pose(points), 0.0)[0]

    def value_and_gradient(self, points: Array, softness: float = 0.0) -> tuple[Array, Array]:
        """Aggregated values (B,) and their gradients (B, n, 2), per m, for layouts (B, n, 2) in m.

        A layout without a finite value gets a gradient of zero.
        """

        def both(chunk: Array) -> tuple[Array, Array]:
            per_pose, pullback = self.linearize(chunk, softness)
            with np.errstate(invalid="ignore"):
                value, derivative = self._aggregate(per_pose, softness)
                gradient = pullback(derivative)
            return value, np.where(np.isfinite(value)[:, None, None], gradient, 0.0)

        values, gradients = zip(*self._in_chunks(both, points), strict=True)
        return np.concatenate(values), np.concatenate(gradients)

    def _in_chunks(self, function: Callable[[Array], T], points: Array) -> list[T]:
        """Results on chunks of the batch, computed side by side; how many cores there are changes no chunk."""
        size = max(1, POINTS_AT_ONCE // (len(self.setting.poses) * points.shape[1]))
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        return list(_threads().map(function, chunks)) if len(chunks) > 1 else [function(points)]


class TraceObjective(Objective):
    """sqrt(trace(W C)), C = M^-1 the first-order covariance, M the Fisher information.

    M = J'J for image noise of 1 px; with `Setting.noise` M = sum of J_i' F_i J_i over the dots, F_i the information of
    a dot's center (`markergen.maths.dot_noise`), which depends on where the dot is. The gradient is closed:
    d trace(W M^-1) = -<S, dM> with S = M^-1 W M^-1, that is -2 <J S, dJ> for J'J.
    """

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        super().__init__(setting, aggregate, coordinates)
        self.weight = self._weight()
        self._dots: DotWeights | None = None
        if setting.noise:
            self._dots = DotWeights(setting.noise, self._plane(), self._jacobian(np.zeros((1, 2))))

    @abstractmethod
    def _weight(self) -> Array:
        """W (P, k, k)."""

    @abstractmethod
    def _jacobian(self, points: Array) -> Array:
        """J (B, P, 2n, k) for points (B, n, 2)."""

    @abstractmethod
    def _plane(self) -> Array:
        """T (P, k, 2) with J T = d(image point)/d(X, Y): a point moved in the plane, as a change of the parameters."""

    @abstractmethod
    def _jacobian_pullback(self, cotangent: Array, points: Array) -> Array:
        """Gradient (B, P, n, 2) with respect to the points of sum(cotangent * J)."""

    def covariance(self, points: Array) -> Array:
        """C (B, P, k, k) for layouts (B, n, 2) in m; inf where a layout determines nothing."""
        return covariance(self._information(self._jacobian(points))[0])

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`; smooth everywhere, so softness changes nothing."""
        del softness
        jacobian = self._jacobian(points)
        matrix, through_weights = self._information(jacobian)
        inverse = covariance(matrix)
        with np.errstate(invalid="ignore"):
            weighted = self.weight @ inverse
            trace = np.trace(weighted, axis1=-2, axis2=-1)
        # A rounded inverse of a singular matrix can have a negative or undefined trace.
        values = np.sqrt(np.where(trace > 0, trace, np.inf))

        def pullback(weights: Array) -> Array:
            sensitivity = inverse @ weighted * (-weights / values)[..., None, None]
            return self._jacobian_pullback(through_weights(jacobian @ sensitivity), points).sum(axis=1)

        return values, pullback

    def _information(self, jacobian: Array) -> tuple[Array, Pullback]:
        """M (B, P, k, k), and what J S, for half of <S, dM>, is as a cotangent of J."""
        if self._dots is None:
            return information(jacobian), lambda turned: turned
        weighed, pullback = self._dots(jacobian)
        return jacobian.swapaxes(-1, -2) @ weighed, pullback


OBJECTIVES: Registry[type[Objective]] = Registry("objective", "markergen.objectives")
"""Objectives by name."""
