"""The marker: control points with their features inside a boundary, and where they came from."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.model.feature import Feature, key_ring
from markergen.model.substrate import Substrate
from markergen.model.tag import Tag

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ControlPoint:
    """One control point: identifier, position in the marker frame in m, and its printed feature.

    Attributes
    ----------
    covariance : (xx, xy, yy) or None
        Of a place that was measured on the print, m^2; None: not measured, or nobody said how well.
    designed : (x, y) or None
        Where a dot was to be whose place was measured, m; None: at x, y over the marker's `print_scale`.
    """

    id: int
    x: float
    y: float
    z: float
    feature: Feature
    covariance: tuple[float, float, float] | None = None
    designed: tuple[float, float] | None = None


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
    substrate : Substrate
        The plate that carries the dots when it is made as a solid.
    provenance : mapping
        Spec, seed, versions, camera, poses and criteria, as plain JSON values.
    keep_outs : tuple of Boundary
        Where no dot may be, such as mounting holes.
    tag : Tag or None
        In the middle, at z = 0; its quiet zone is a keep-out as well.
    print_scale : (x, y)
        What the printer made of 1 along x and y. The control points are where they are in the print; boundary,
        keep-outs, tag and features are those that were designed.
    """

    control_points: tuple[ControlPoint, ...]
    boundary: Boundary
    clearance: float
    substrate: Substrate = Substrate()  # noqa: RUF009  (frozen, so it can be shared)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    keep_outs: tuple[Boundary, ...] = ()
    tag: Tag | None = None
    print_scale: tuple[float, float] = (1.0, 1.0)

    def __len__(self) -> int:
        return len(self.control_points)

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, marker frame."""
        return np.array([[point.x, point.y, point.z] for point in self.control_points], dtype=float).reshape(-1, 3)

    @cached_property
    def place_covariance(self) -> Array | None:
        """Covariances (n, 2, 2) in m^2 of the places that were measured, nan for others; None if none was."""
        given = [point.covariance for point in self.control_points]
        if not any(given):
            return None
        rows = [(c[0], c[1], c[1], c[2]) if c else (np.nan,) * 4 for c in given]
        return np.array(rows, dtype=float).reshape(-1, 2, 2)

    @cached_property
    def as_designed(self) -> "Marker":
        """The marker that was designed and is to be drawn, whatever was measured on a print of it."""
        if self.print_scale == (1.0, 1.0) and not any(p.designed or p.covariance for p in self.control_points):
            return self

        def back(point: ControlPoint) -> ControlPoint:
            x, y = point.designed or (point.x / self.print_scale[0], point.y / self.print_scale[1])
            # Whole picometers: what was multiplied and divided is what it was.
            return replace(point, x=round(x, 12), y=round(y, 12), covariance=None, designed=None)

        points = tuple(back(point) for point in self.control_points)
        return replace(self, control_points=points, print_scale=(1.0, 1.0))

    @property
    def height(self) -> float:
        """How far in m the highest control point stands above the plane; 0 if none does."""
        return max(0.0, float(self.xyz[:, 2].max()))

    @property
    def dot_diameter(self) -> float:
        """Largest diameter of a feature in m."""
        return max(point.feature.diameter for point in self.control_points)

    @property
    def blocked(self) -> tuple[Boundary, ...]:
        """All places where no dot may be: the keep-outs, the tag with its quiet zone, and the plate's holes."""
        tag = (self.tag.quiet_zone,) if self.tag else ()
        return (*self.keep_outs, *tag, *self.substrate.rims)

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


def marker_name(marker: Marker) -> str:
    """``markergen-<spec hash>``, safe in file headers, XML and on paper whatever the provenance holds."""
    return "markergen-" + re.sub(r"[^0-9A-Za-z_.-]", "", marker.spec_hash)[:16]
