"""The marker: control points with their features inside a boundary, and where they came from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.model.feature import Feature, key_ring

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ControlPoint:
    """One control point: identifier, position in the marker frame in m, and its printed feature."""

    id: int
    x: float
    y: float
    z: float
    feature: Feature


@dataclass(frozen=True)
class Marker:
    """A designed marker.

    Attributes
    ----------
    control_points : tuple of ControlPoint
        Of a designed one the first is the key ring, unless the layout tells the labels.
    boundary : Boundary
    clearance : float
        Smallest gap in m between dots, and between a dot's edge and the boundary or a keep-out.
    thickness : float
        Of the substrate when it is made as a solid, m.
    provenance : mapping
        Spec, seed, versions, camera, poses and criteria, as plain JSON values.
    keep_outs : tuple of Boundary
        Where no dot may be, such as mounting holes.
    """

    control_points: tuple[ControlPoint, ...]
    boundary: Boundary
    clearance: float
    thickness: float = 0.003
    provenance: Mapping[str, Any] = field(default_factory=dict)
    keep_outs: tuple[Boundary, ...] = ()

    def __len__(self) -> int:
        return len(self.control_points)

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, marker frame."""
        return np.array([[point.x, point.y, point.z] for point in self.control_points], dtype=float).reshape(-1, 3)

    @property
    def height(self) -> float:
        """How far in m the highest control point stands above the plane; 0 if none does."""
        return max(0.0, float(self.xyz[:, 2].max()))

    @property
    def dot_diameter(self) -> float:
        """Largest diameter of a feature in m."""
        return max(point.feature.diameter for point in self.control_points)

    @property
    def spec_hash(self) -> str:
        """Eight hexadecimal digits that name the spec it was designed from, or ``unknown``."""
        return str(self.provenance.get("spec_hash", "unknown"))


def dressed(points: Array, boundary: Boundary, diameter: float, clearance: float, keyed: bool = True) -> Marker:
    """Marker with a dot at each of the points (n, 2 or 3) in m: the first is a ring if `keyed`, the others are disks.

    A diameter of 0 gives bare points.
    """
    features = [key_ring(diameter) if keyed else Feature(diameter), *[Feature(diameter)] * (len(points) - 1)]
    control_points = tuple(
        ControlPoint(i, float(x), float(y), float(z[0]) if z else 0.0, feature)
        for i, ((x, y, *z), feature) in enumerate(zip(points, features, strict=True))
    )
    return Marker(control_points, boundary, clearance)
