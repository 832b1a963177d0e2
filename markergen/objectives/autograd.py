"""Objectives without a closed-form gradient, differentiated by autograd, and those that callers pass as functions."""

# tests: tests/objectives/test_autograd.py tests/objectives/test_callers.py

import inspect
import re
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from autograd.core import make_vjp
from autograd.extend import defvjp, primitive

from markergen.arrays import Array as Array
from markergen.errors import InputError, brief
from markergen.maths.information import covariance
from markergen.maths.projection import perspective, to_camera
from markergen.objectives.base import OBJECTIVES, Objective, Pullback, Setting
from markergen.objectives.pose import PoseObjective


class AutogradObjective(Objective):
    """An objective written as one function, `values`, with ``autograd.numpy`` in place of numpy.

    It is usually a function of `covariance`, `information` or `pixels`, which are differentiable and batched, and
    account for lens, relief and the noise of the setting. An objective that uses only `pixels` does not depend on the
    noise and sets ``knows_noise = False``.

    Examples
    --------
    The volume of the pose's error ellipsoid (D-optimality), as the geometric mean of its six axes:

    >>> import autograd.numpy as anp
    >>> class Volume(AutogradObjective):
    ...     def values(self, points):
    ...         return anp.exp(-anp.linalg.slogdet(self.information(points))[1] / 12)
    """

    def __init__(self, setting: Setting, aggregate: str = "", coordinates: str = "unit") -> None:
        super().__init__(setting, aggregate, coordinates)
        self._pose = PoseObjective(setting)

    @abstractmethod
    def values(self, points: Array) -> Array:
        """Values (B, P), above 0, of layouts (B, n, 2 or 3) in m at the P poses; nan or inf where undefined."""

    def information(self, points: Array) -> Array:
        """Fisher information M (B, P, 6, 6) of the pose (w, dt), w in rad and dt in m, for the noise of the setting."""
        information: Array = _information(points, self._pose)
        return information

    def covariance(self, points: Array) -> Array:
        """CRLB (B, P, 6, 6) of the pose, the inverse of `information`; inf for degenerate layouts."""
        covariance: Array = inverse(self.information(points))
        return covariance

    def pixels(self, points: Array) -> Array:
        """Distorted image points (B, P, n, 2) in px; nan outside the domain of the lens model."""
        pixels: Array = _pixels(points, self.setting)
        return pixels

    def linearize(self, points: Array, softness: float = 0.0) -> tuple[Array, Pullback]:
        """See `Objective.linearize`."""
        with np.errstate(all="ignore"):
            try:
                pullback, values = make_vjp(self.values, points)
            except np.linalg.LinAlgError:
                if len(points) > 1:
                    return self._one_by_one(points, softness)
                # A degenerate layout.
                return np.full((1, len(self.setting.poses)), np.inf), lambda _: np.zeros_like(points)

        layouts_and_poses = len(points), len(self.setting.poses)
        if np.shape(values) != layouts_and_poses:
            raise InputError(
                f"values of {type(self).__name__} of shape {layouts_and_poses}, for every layout and pose",
                f"shape {np.shape(values)}",
                "return a value for each layout and pose; the aggregate sums those of the poses up",
            )

        def back(weights: Array) -> Array:
            with np.errstate(all="ignore"):
                try:
                    gradient: Array = pullback(weights)
                except np.linalg.LinAlgError:
                    return self._one_by_one(points, softness)[1](weights) if len(points) > 1 else np.zeros_like(points)
            return gradient

        return np.where(np.isnan(values), np.inf, values), back

    def _one_by_one(self, points: Array, softness: float) -> tuple[Array, Pullback]:
        """Linearize each layout separately, so that a degenerate one does not affect the others."""
        values, pullbacks = zip(*(self.linearize(layout[None], softness) for layout in points), strict=True)

        def back(weights: Array) -> Array:
            return np.concatenate([pullback(row[None]) for pullback, row in zip(pullbacks, weights, strict=True)])

        return np.concatenate(values), back


def _pixels_vjp(value: Array, points: Array, setting: Setting) -> Pullback:
    del value
    seen = to_camera(points, setting.poses.rotation, setting.poses.translation)
    normalized = perspective(seen)
    blocks = setting.camera.pixel_jacobian(normalized)

    def vjp(cotangent: Array) -> Array:
        lateral = np.einsum("...ij,...i->...j", blocks, cotangent) / seen[..., 2:]
        axial = -np.sum(lateral * normalized, axis=-1, keepdims=True)
        by_pose = np.concatenate([lateral, axial], axis=-1) @ setting.poses.rotation[:, :, : points.shape[-1]]
        return by_pose.sum(axis=1)

    return vjp


_information = primitive(lambda points, pose: pose.information(points)[0])
_pixels = primitive(lambda points, view: view.camera.project(points, view.poses.rotation, view.poses.translation))
inverse = primitive(covariance)
defvjp(inverse, lambda value, _: lambda cotangent: -value @ cotangent @ value)
defvjp(_information, lambda _, points, pose: lambda cotangent: pose.information(points)[1](cotangent), argnums=(0,))
defvjp(_pixels, _pixels_vjp, argnums=(0,))


class FunctionObjective(AutogradObjective):
    """An objective whose values a function computes from the points and the objective itself, as `view`."""

    function: Callable[[Array, AutogradObjective], Array]

    def values(self, points: Array) -> Array:
        """See `AutogradObjective.values`."""
        try:
            values = type(self).function(points, self)
        except (TypeError, AttributeError) as error:
            remedy = "compute with autograd.numpy, of view.covariance(points), .information(points) and .pixels(points)"
            raise InputError("an objective that autograd differentiates", str(error), remedy) from error
        if getattr(values, "ndim", 0) != 2:
            returned = f"shape {values.shape}" if hasattr(values, "shape") else brief(values)
            remedy = f"return a value for each layout and pose, here ({len(points)}, {len(self.setting.poses)})"
            raise InputError("values (B, P) of the objective", returned, remedy)
        return values


def _check_arguments(function: Callable[..., Any], name: str) -> None:
    try:
        form = inspect.signature(function)
    except ValueError:  # Compiled functions may have none.
        return
    try:
        form.bind("points", "view")
    except TypeError:
        remedy = "points are (B, n, 2 or 3) in m; see help(markergen.Objective)"
        raise InputError("a function of points and view", f"{name}{form}", remedy) from None


def objective_name(objective: Any) -> str:
    """Return the name of an objective in the table, where one that is no text is entered under its own name.

    A function takes points (B, n, 2 or 3) in m and a `view`, an `AutogradObjective` with the differentiable
    ``view.covariance(points)``, ``view.information(points)`` and ``view.pixels(points)``, and returns values (B, P)
    above 0, computed with ``autograd.numpy``. A class is a subclass of `Objective`.

    Raises
    ------
    InputError
        If it is none of these, or markergen has an objective of that name.
    """
    if isinstance(objective, str):
        return objective
    name = getattr(objective, "__name__", type(objective).__name__)
    if not callable(objective):
        remedy = "give a name, a function of points and view, or a subclass of Objective"
        raise InputError("an objective", f"objective of type {name}", remedy)
    if not isinstance(objective, type):
        _check_arguments(objective, name)
    # A lambda's is <lambda>.
    name = re.sub(r"\W", "", name).lower()
    entry = objective if isinstance(objective, type) else type(name, (FunctionObjective,), {"function": objective})
    OBJECTIVES.take(name, entry)
    return name
