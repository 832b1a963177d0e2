"""The body: plates with dots in a known rigid relation. A marker is a body of one plate, a rig one of several."""
# tests: tests/model/test_rig.py tests/model/test_rig_occlusion.py

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.errors import InputError, brief
from markergen.geometry.region import Region
from markergen.model.constellation import constellations_among
from markergen.model.rigid import Rows, check_pose
from markergen.registry import door

if TYPE_CHECKING:
    import cadquery

    from markergen.model.marker import Marker
    from markergen.options.declarations import ExportKeywords


_RENAMED = {"turn": "rotation_matrix", "shift": "translation_vector", "to_rig": "to_body"}
"""Attributes of the release before, and what they are now; they go with the next."""


@dataclass(frozen=True)
class Plate:
    """A marker with its name and its pose in a body.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> square = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(square, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> front = Plate("front", marker, np.eye(3), (0, 0, 0.1))
    >>> front.to_body(np.array([0.03, 0.03, 0]))
    array([0.03, 0.03, 0.1 ])

    Attributes
    ----------
    name : str
        Such as ``+x`` or ``row 1 column 2``; no two of a body have the same.
    marker : Marker
        In its own frame: x right, y up, z out of the printed face.
    rotation : tuple of tuple of float
        R (3, 3) of T_body_marker: X_body = R X_marker + t.
    translation : tuple of float
        t (3,) of T_body_marker, m.

    Raises
    ------
    InputError
        If the name is empty or longer than 40 characters, or the pose is not finite or its rotation is invalid: not
        orthonormal to 1e-9, or mirrored.
    """

    name: str
    marker: "Marker"
    rotation: Rows
    translation: tuple[float, ...]

    def __post_init__(self) -> None:
        if not (self.name.strip() and len(self.name) <= 40 and self.name.isprintable()):
            raise InputError("a name of 1 to 40 characters for a marker of a rig", brief(self.name), "name its place")
        object.__setattr__(self, "rotation", tuple(tuple(map(float, row)) for row in self.rotation))
        object.__setattr__(self, "translation", tuple(map(float, self.translation)))
        check_pose(self.rotation, self.translation, f"T_rig_marker of {self.name}")

    def __getattr__(self, name: str) -> Any:
        if name in _RENAMED:
            warnings.warn(f"Plate.{name} is now Plate.{_RENAMED[name]}", DeprecationWarning, stacklevel=2)
            return getattr(self, _RENAMED[name])
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @property
    def rotation_matrix(self) -> Array:
        """R (3, 3) of T_body_marker."""
        return np.array(self.rotation)

    @property
    def translation_vector(self) -> Array:
        """Translation t (3,) of T_body_marker, m."""
        return np.array(self.translation)

    def to_body(self, points: Array) -> Array:
        """Transform points (..., 3) in m from the marker frame to the body frame."""
        return points @ self.rotation_matrix.T + self.translation_vector

    def to_marker(self, points: Array) -> Array:
        """Transform points (..., 3) in m from the body frame to the marker frame."""
        return (points - self.translation_vector) @ self.rotation_matrix

    def camera_pose(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """T_camera_marker of poses T_camera_body, rotation (..., 3, 3) and translation (..., 3) in m."""
        return rotation @ self.rotation_matrix, rotation @ self.translation_vector + translation


@dataclass(frozen=True, eq=False)
class Constellation:
    """Dots that are sought together, on one plate and of about one size.

    Attributes
    ----------
    marker : Marker
        A marker of them alone, in the plate's frame.
    plate : Plate
    dots : array (m,) of int
        Their numbers in the body.
    """

    marker: "Marker"
    plate: Plate
    dots: Indices


class Body(ABC):
    """Plates with dots in a known rigid relation, whose pose T_camera_body is estimated from all dots in view.

    Dots are numbered through the plates in their order; `owner` is the plate of each.
    """

    frame: ClassVar[str]
    """Name of its frame in messages and files: ``marker`` or ``rig``."""

    @property
    @abstractmethod
    def plates(self) -> Sequence[Plate]:
        """Plates with their poses in the body."""

    @property
    @abstractmethod
    def ids(self) -> Indices:
        """Ids (n,) of the dots in results."""

    @property
    @abstractmethod
    def radius(self) -> float:
        """Distance in m from the frame's origin to the farthest point of an outline; of a marker, its size."""

    @abstractmethod
    def with_plates(self, plates: Sequence[Plate], relation: Array | None = None) -> "Body":
        """Return the body with other plates in place of its own, and the covariance (6 k, 6 k) of their poses."""

    def __len__(self) -> int:
        return len(self.owner)

    @property
    def relation_covariance(self) -> Array | None:
        """Covariance (6 k, 6 k) of the k plates' poses, (w, dt) in rad and m; None if they are exact."""
        return None

    @cached_property
    def owner(self) -> Indices:
        """Index (n,) of the plate that each control point is on."""
        return np.repeat(np.arange(len(self.plates)), [len(plate.marker) for plate in self.plates])

    @cached_property
    def first(self) -> Indices:
        """Number (k,) of the first control point of each plate."""
        return np.searchsorted(self.owner, np.arange(len(self.plates)))

    @cached_property
    def dots(self) -> tuple[tuple[str, int], ...]:
        """Name of the plate that each of the n control points is on, and its id there."""
        return tuple((plate.name, point.id) for plate in self.plates for point in plate.marker.control_points)

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, body frame."""
        return np.concatenate([plate.to_body(plate.marker.xyz) for plate in self.plates])

    @cached_property
    def normals(self) -> Array:
        """Normals (n, 3) of the plates that the control points are on, body frame."""
        return np.array([plate.rotation_matrix[:, 2] for plate in self.plates])[self.owner]

    @cached_property
    def radii(self) -> Array:
        """Radii (n,) of the dots in m."""
        return np.array([p.feature.diameter / 2 for plate in self.plates for p in plate.marker.control_points])

    @cached_property
    def is_ring(self) -> Mask:
        """True (n,) for rings."""
        return np.array([p.feature.kind == "ring" for plate in self.plates for p in plate.marker.control_points])

    @cached_property
    def least_px(self) -> Array:
        """Least diameters (n,) in px at which the dots are expected to be seen."""
        return np.array([p.feature.least_pixels for plate in self.plates for p in plate.marker.control_points])

    @cached_property
    def constellations(self) -> tuple[Constellation, ...]:
        """Dots that a pose can be estimated from by themselves, through the plates; on each the largest first."""
        return tuple(
            Constellation(plate.marker.only(dots), plate, start + dots)
            for plate, start in zip(self.plates, self.first, strict=True)
            for dots in constellations_among(plate.marker.xyz, 2 * plate.marker.radii)
        )

    def to_cadquery(self, **options: "Unpack[ExportKeywords]") -> "cadquery.Assembly":
        """Return the body as a solid to build on: a `cadquery.Assembly` of its parts, named and colored as in STEP.

        Parameters
        ----------
        **options
            About the plate and how it is made, as of `markergen.export`; those about sheets have no effect.

        Returns
        -------
        cadquery.Assembly
            In mm, in the frame of the body, with parts such as ``plate`` and ``dot-0``, of a rig ``+x/dot-0``.

        Raises
        ------
        InputError
            If the body cannot be made as requested.
        MissingLibraryError
            If cadquery is missing: it is in the extra ``solids``.
        """
        return door("api.export.to_cadquery")(self, **options)

    @property
    def is_single(self) -> bool:
        """True for a marker that is one constellation: its pose is that of its only constellation."""
        return self.frame == "marker" and len(self.constellations) == 1

    @cached_property
    def margins(self) -> Array:
        """Margins (k,) in m of the plates around the markers' boundaries, as they are drawn: one dot diameter."""
        return np.array([plate.marker.dot_diameter for plate in self.plates])

    @cached_property
    def plate_regions(self) -> tuple[Region, ...]:
        """Regions of the plates, in m in their markers' frames: the boundaries with their `margins`."""
        regions = zip((plate.marker.boundary.region for plate in self.plates), self.margins.tolist(), strict=True)
        return tuple(region.offset(margin, segments=64) if margin else region for region, margin in regions)

    @cached_property
    def is_convex(self) -> bool:
        """True if no plate stands in front of the plane of another, as on a cube or a wall: no face hides another."""
        return True

    def facing(self, rotation: Array, translation: Array) -> Array:
        """Cosine (n,) of the angle between each dot's normal and the way to the camera, for a pose T_camera_body."""
        places = self.xyz @ rotation.T + translation
        return -np.sum(places * (self.normals @ rotation.T), axis=-1) / np.linalg.norm(places, axis=-1)
