"""The body: plates with dots in a known rigid relation. A marker is a body of one plate, a rig one of several.

Dots of one plate and about one size, enough and spread enough to find a pose by themselves, are a constellation.
"""
# tests: tests/model/test_rig.py tests/model/test_rig_occlusion.py tests/model/test_sight.py tests/model/test_marker.py

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, Unpack

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.errors import InputError, brief
from markergen.geometry.region import Region
from markergen.registry import door

if TYPE_CHECKING:
    import cadquery

    from markergen.model.marker import Marker
    from markergen.options.declarations import ExportKeywords

Rows = tuple[tuple[float, ...], ...]

ROUNDING = 1e-9
"""Tolerance for a rotation's orthonormality, and for a covariance, as correlations, to be symmetric and positive."""


def check_pose(rotation: Rows, translation: tuple[float, ...], of: str = "") -> None:
    """Refuse what is no rotation (3, 3), orthonormal to 1e-9 and not mirrored, and translation (3,) with InputError."""
    if [len(row) for row in rotation] != [3] * 3 or len(translation) != 3:
        raise InputError("a pose of 3x3 and 3 numbers", f"{len(rotation)} rows", "give rotation, translation")
    matrix = np.array(rotation)
    # Written so that nan and numbers whose squares overflow do not pass.
    bounded = bool((np.abs(matrix) <= 1 + ROUNDING).all() and np.isfinite(translation).all())
    if not (
        bounded
        and np.abs(matrix @ matrix.T - np.eye(3)).max() <= ROUNDING
        and abs(np.linalg.det(matrix) - 1) <= ROUNDING
    ):
        raise InputError(
            f"a pose {of}{' ' * bool(of)}with a rotation: three orthonormal rows and determinant 1",
            "another matrix" if bounded else "numbers out of range",
            "write it with all its digits",
        )


def check_covariance(values: Array, unit: str = "") -> None:
    """Refuse a matrix that is no covariance: finite, symmetric and positive semidefinite up to `ROUNDING`.

    The last two as correlations, as variances may differ by orders of magnitude.

    Raises
    ------
    InputError
    """
    if not np.isfinite(values).all():
        raise InputError("a finite covariance", "nan or inf", "correct it")
    variances = np.diag(values)
    if variances.min() < 0:
        raise InputError("variances of 0 or more", f"{variances.min()}{unit}", "correct the covariance")
    scale = np.sqrt(variances)
    inverse = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    correlation = values * inverse[:, None] * inverse
    certain = scale == 0
    if values[certain].any() or values[:, certain].any() or np.abs(correlation).max() > 1 + ROUNDING:
        raise InputError("a covariance", "one that exceeds its variances", "are these correlations?")
    if np.abs(correlation - correlation.T).max() > ROUNDING:
        raise InputError("a symmetric covariance", "another", "write it with all its digits")
    if np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -ROUNDING * len(correlation):
        raise InputError("a positive semidefinite covariance", "a negative eigenvalue", "write all its digits")


FEWEST = 4
"""Number of dots of one diameter, not all on a line, from which a pose is found."""

SCALE_RATIO = 1.5
"""Ratio of diameters, between one dot and the next larger one, from which on they are of two scales."""

FLAT = 0.02
"""Ratio of the spreads across and along a line below which points count as on it."""


def scales_of(diameters: Array | Sequence[float]) -> tuple[Indices, ...]:
    """Indices of the dots of each scale, the largest first: diameters in m without a gap of `SCALE_RATIO`."""
    sizes = np.asarray(diameters, dtype=float)
    order = np.argsort(-sizes, kind="stable")
    ratio = sizes[order[:-1]] / np.maximum(sizes[order[1:]], np.finfo(float).tiny)
    return tuple(np.sort(scale) for scale in np.split(order, np.flatnonzero(ratio >= SCALE_RATIO) + 1))


def constellations_among(points: Array, diameters: Array) -> tuple[Indices, ...]:
    """Indices of the dots, points (n, 2 or 3) and diameters (n,) in m, that a pose can be estimated from by themselves.

    By scale, the largest first; all dots if only one scale can.
    """
    scales = [scale for scale in scales_of(diameters) if len(scale) >= FEWEST and spans(points[scale])]
    return tuple(scales) if len(scales) > 1 else (np.arange(len(points)),)


def enough(points: Array, seen: Mask) -> Mask:
    """Mask (P,) of the poses that see four points (n, 2 or 3) that are not on a line, of those seen (P, n)."""
    masks, which = np.unique(seen, axis=0, return_inverse=True)
    is_enough = [mask.sum() >= FEWEST and spans(points[mask]) for mask in masks]
    return np.array(is_enough, dtype=bool)[which.ravel()]


def spans(points: Array) -> bool:
    """Whether points (m, 2 or 3) are not on a line."""
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(size[1] > FLAT * size[0])


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
    def with_plates(self, plates: Sequence[Plate], relation: Array | None = None) -> Self:
        """Return the body with other plates in place of its own, and the covariance (6 k, 6 k) of their poses."""

    def with_markers(self, change: Callable[["Marker"], "Marker"]) -> Self:
        """Return the body with each of its markers changed."""
        plates = [replace(plate, marker=change(plate.marker)) for plate in self.plates]
        return self.with_plates(plates, self.relation_covariance)

    @cached_property
    def as_designed(self) -> Self:
        """The body as designed, which is the one to draw, whatever was measured on a print of it."""
        return self.with_markers(lambda marker: marker.as_designed)

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
