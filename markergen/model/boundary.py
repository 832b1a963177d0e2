"""The region that the dots must lie in whole. A new shape is a new subclass; nothing else asks what it is."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.units import format_length

Array = NDArray[np.float64]


class Boundary(ABC):
    """A closed region of the marker plane; the marker frame's origin is the center of its smallest enclosing circle."""

    @property
    @abstractmethod
    def radius(self) -> float:
        """Radius r of the smallest enclosing circle in m: the marker's size."""

    @property
    @abstractmethod
    def area(self) -> float:
        """Area in m^2."""

    @abstractmethod
    def depth(self, points: Array) -> Array:
        """Signed distance (...) in m from points (..., 2) to the outline: positive inside, negative outside."""

    @abstractmethod
    def depth_gradient(self, points: Array) -> Array:
        """Gradient (..., 2) of `depth`: the unit vector straight into the region; where there is none, zero."""

    @abstractmethod
    def project(self, points: Array, inset: float) -> Array:
        """Nearest points (..., 2) at least `inset` m inside the outline; points that are so already stay."""

    @abstractmethod
    def sample(self, count: int, inset: float, rng: np.random.Generator) -> Array:
        """Draw (count, 2) points uniformly from the region inset by `inset` m."""

    @abstractmethod
    def rim(self, count: int) -> Array:
        """Points (count, 2) spread evenly along the outline."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values with the shape's ``kind`` and its measures in m."""


@dataclass(frozen=True)
class Circle(Boundary):
    """A disk around the origin.

    Raises
    ------
    InputError
        If the radius is not a finite number above 0.
    """

    size: float

    def __post_init__(self) -> None:
        if not (isfinite(self.size) and self.size > 0):
            raise InputError(
                "a radius above 0", f"radius={self.size} m", "give a positive length such as 0.15 or 150mm"
            )

    @property
    def radius(self) -> float:
        """See `Boundary.radius`."""
        return self.size

    @property
    def area(self) -> float:
        """See `Boundary.area`."""
        return pi * self.size**2

    def depth(self, points: Array) -> Array:
        """See `Boundary.depth`."""
        return self.size - np.hypot(points[..., 0], points[..., 1])

    def depth_gradient(self, points: Array) -> Array:
        """See `Boundary.depth_gradient`."""
        distance = np.hypot(points[..., 0], points[..., 1])[..., None]
        return -points / np.maximum(distance, np.finfo(float).tiny)

    def project(self, points: Array, inset: float) -> Array:
        """See `Boundary.project`; an inset beyond the radius leaves the center alone."""
        limit = max(self.size - inset, 0.0)
        distance = np.hypot(points[..., 0], points[..., 1])[..., None]
        return np.where(distance > limit, points * (limit / np.maximum(distance, np.finfo(float).tiny)), points)

    def sample(self, count: int, inset: float, rng: np.random.Generator) -> Array:
        """See `Boundary.sample`."""
        distance = max(self.size - inset, 0.0) * np.sqrt(rng.random(count))
        return distance[:, None] * _directions(2 * pi * rng.random(count))

    def rim(self, count: int) -> Array:
        """See `Boundary.rim`."""
        return self.size * _directions(2 * pi * np.arange(count) / count)

    def as_dict(self) -> dict[str, Any]:
        """See `Boundary.as_dict`."""
        return {"kind": "circle", "radius": self.size}

    def __str__(self) -> str:
        return f"disk of radius {format_length(self.size)}"


def _directions(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)
