"""The rig: markers with a known rigid relation, of which each view sees some, such as the faces of a cube."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from os import PathLike
from typing import IO, TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.geometry.region import Region
from markergen.model.marker import ROUNDING, Marker, Rows, check_covariance, check_pose
from markergen.model.spec import USUAL_PRINT
from markergen.registry import door
from markergen.units import format_length

if TYPE_CHECKING:
    from markergen.files import Written
    from markergen.options.declarations import ExportKeywords

Array = NDArray[np.float64]

MOST_MARKERS = 100
"""Maximum number of markers of a rig."""


@dataclass(frozen=True)
class RigMarker:
    """One marker of a rig, by its name, with its pose in the rig frame.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> square = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(square, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> front = RigMarker("front", marker, np.eye(3), (0, 0, 0.1))
    >>> front.to_rig(np.array([0.03, 0.03, 0]))
    array([0.03, 0.03, 0.1 ])

    Attributes
    ----------
    name : str
        Such as ``+x`` or ``row 1 column 2``; no two of a rig have the same.
    marker : Marker
        In its own frame: x right, y up, z out of the printed face.
    rotation : tuple of tuple of float
        R (3, 3) of T_rig_marker: X_rig = R X_marker + t.
    translation : tuple of float
        t (3,) of T_rig_marker, m.

    Raises
    ------
    InputError
        If the name is empty or longer than 40 characters, or the pose is not finite or its rotation is invalid: not
        orthonormal to 1e-9, or mirrored.
    """

    name: str
    marker: Marker
    rotation: Rows
    translation: tuple[float, ...]

    def __post_init__(self) -> None:
        if not (self.name.strip() and len(self.name) <= 40 and self.name.isprintable()):
            raise InputError("a name of 1 to 40 characters for a marker of a rig", brief(self.name), "name its place")
        object.__setattr__(self, "rotation", tuple(tuple(map(float, row)) for row in self.rotation))
        object.__setattr__(self, "translation", tuple(map(float, self.translation)))
        check_pose(self.rotation, self.translation, f"T_rig_marker of {self.name}")

    @property
    def turn(self) -> Array:
        """R (3, 3) of T_rig_marker."""
        return np.array(self.rotation)

    @property
    def shift(self) -> Array:
        """Translation t (3,) of T_rig_marker, m."""
        return np.array(self.translation)

    def to_rig(self, points: Array) -> Array:
        """Transform points (..., 3) in m from the marker frame to the rig frame."""
        return points @ self.turn.T + self.shift

    def to_marker(self, points: Array) -> Array:
        """Transform points (..., 3) in m from the rig frame to the marker frame."""
        return (points - self.shift) @ self.turn

    def camera_pose(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """T_camera_marker of poses T_camera_rig, rotation (..., 3, 3) and translation (..., 3) in m."""
        return rotation @ self.turn, rotation @ self.shift + translation


@dataclass(frozen=True, repr=False)
class Rig:
    """Markers with a known rigid relation; a pose T_camera_rig is estimated from all dots of all markers in view.

    The dots are numbered through the markers in their order; `owner` is the marker of each.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> points = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(points, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> side = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    >>> rig = Rig((RigMarker("front", marker, np.eye(3), [0, 0, 0.1]), RigMarker("side", marker, side, [0.1, 0, 0])))
    >>> rig
    Rig(2 markers, 8 control points within 117 mm of its origin)
    >>> rig.xyz.shape, rig.normals[4], rig.owner
    ((8, 3), array([1., 0., 0.]), array([0, 0, 0, 0, 1, 1, 1, 1]))

    Attributes
    ----------
    markers : tuple of RigMarker
    relation : tuple of tuple of float, or None
        Covariance (6 k, 6 k) of the k markers' poses T_rig_marker, of (w, dt) in rad and m, in the rig frame: R <-
        exp([w]x) R and t <- t + dt; None if they are exact.
    provenance, extensions : mapping
        Plain JSON values, as in a marker.

    Raises
    ------
    InputError
        If there are no markers or more than 100, two have the same name, or the covariance has another size or is not
        finite, symmetric and positive semidefinite.
    """

    markers: tuple[RigMarker, ...]
    relation: Rows | None = field(default=None, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    extensions: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "markers", tuple(self.markers))
        if not 1 <= len(self.markers) <= MOST_MARKERS:
            raise InputError(f"1 to {MOST_MARKERS} markers of a rig", f"{len(self.markers)}", "correct the rig")
        names = [each.name for each in self.markers]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError("markers of different names", f"{brief(twice[0])} twice", "rename one of them")
        if self.relation is not None:
            object.__setattr__(self, "relation", tuple(tuple(map(float, row)) for row in self.relation))
            _check_covariance(self.relation, 6 * len(self.markers))

    @classmethod
    def load(cls, source: "str | PathLike[str] | IO[str] | IO[bytes] | Mapping[str, Any]") -> "Rig":
        """Read a rig.json, with the marker.json files that it names, which are looked for beside it.

        Parameters
        ----------
        source : str, path, open file or mapping
            A path, a file open for text or bytes, or its content parsed by `json.load`.

        Raises
        ------
        InputError
            If the source is none of these, cannot be read, or is not a consistent rig.json; then the message lists
            the errors with their paths, at most 20.
        """
        return door("model.rig_json.load_rig")(source)

    def __repr__(self) -> str:
        count, dots = len(self.markers), len(self)
        return (
            f"Rig({count} marker{'s' * (count > 1)}, {dots} control point{'s' * (dots != 1)} "
            f"within {format_length(float(f'{self.radius:.3g}'))} of its origin)"
        )

    def __len__(self) -> int:
        return len(self.owner)

    def __hash__(self) -> int:
        return hash((self.markers, self.relation))

    @cached_property
    def owner(self) -> NDArray[np.intp]:
        """Index (n,) of the marker that each control point is on."""
        return np.repeat(np.arange(len(self.markers)), [len(each.marker) for each in self.markers])

    @cached_property
    def dots(self) -> tuple[tuple[str, int], ...]:
        """Name of the marker that each of the n control points is on, and its id there."""
        return tuple((each.name, point.id) for each in self.markers for point in each.marker.control_points)

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, rig frame."""
        return np.concatenate([each.to_rig(each.marker.xyz) for each in self.markers])

    @cached_property
    def normals(self) -> Array:
        """Normals (n, 3) of the plates that the control points are on, rig frame."""
        return np.array([each.turn[:, 2] for each in self.markers])[self.owner]

    @cached_property
    def radii(self) -> Array:
        """Radii (n,) of the dots in m."""
        return np.array([p.feature.diameter / 2 for each in self.markers for p in each.marker.control_points])

    @cached_property
    def radius(self) -> float:
        """Distance in m from the rig's origin to the farthest point of an outline."""
        return max(float(np.linalg.norm(self.outline(k), axis=-1).max()) for k in range(len(self.markers)))

    def outline(self, index: int) -> Array:
        """Points (m, 3) in m of the outlines of one marker's boundary, rig frame."""
        each = self.markers[index]
        points = np.concatenate(each.marker.boundary.outlines())
        return each.to_rig(np.column_stack([points, np.zeros(len(points))]))

    @cached_property
    def margins(self) -> Array:
        """Margins (k,) in m of the plates around the markers' boundaries, as they are drawn.

        One dot diameter, but at most half the gap to the nearest other outline, less an eighth of a dot: 0 for faces
        that meet at an edge.
        """
        diameters = np.array([each.marker.dot_diameter for each in self.markers])
        margins, rims = diameters.copy(), [_rim(each, each.marker.dot_diameter / 8) for each in self.markers]
        boxes = np.array([[rim.min(axis=0), rim.max(axis=0)] for rim in rims])
        for j, k in combinations(range(len(rims)), 2):
            apart = np.maximum(boxes[j, 0] - boxes[k, 1], boxes[k, 0] - boxes[j, 1]).max()
            thick = max(diameters[j], diameters[k])
            if apart < 2.25 * thick:
                gap = min(float(np.linalg.norm(rims[k] - point, axis=-1).min()) for point in rims[j])
                least = max(gap / 2 - thick / 8, 0.0)
                margins[[j, k]] = np.minimum(margins[[j, k]], least)
        return margins

    @cached_property
    def plates(self) -> tuple[Region, ...]:
        """Regions of the plates, in m in their markers' frames: the boundaries with their `margins`."""
        every = zip(self.markers, self.margins, strict=True)
        regions = ((each.marker.boundary.region, float(margin)) for each, margin in every)
        return tuple(region.offset(margin, segments=64) if margin else region for region, margin in regions)

    @cached_property
    def is_convex(self) -> bool:
        """True if no plate stands in front of the plane of another, as on a cube or a wall: no face hides another."""
        tolerance = ROUNDING * max(self.radius, 1.0)
        outlines = [self.outline(k) for k in range(len(self.markers))]
        return all(
            float(each.to_marker(outline)[:, 2].max()) <= tolerance for each in self.markers for outline in outlines
        )

    @cached_property
    def relation_covariance(self) -> Array | None:
        """Covariance (6 k, 6 k) of `relation`, or None."""
        return None if self.relation is None else np.array(self.relation)

    def save(self, *paths: str | PathLike[str], **options: "Unpack[ExportKeywords]") -> "list[Written]":
        """Write the rig to each path in the format of its suffix, such as .json; see `markergen.export`."""
        return door("api.export.export")(self, *paths, **options)


def _rim(each: RigMarker, spacing: float) -> Array:
    """Points (m, 3) in m, rig frame, on the outlines of a marker's boundary, at most `spacing` apart unless it is 0."""
    region = each.marker.boundary.region
    points = np.concatenate((region.mapped(lambda corners: corners, spacing) if spacing else region).rings)
    return each.to_rig(np.column_stack([points, np.zeros(len(points))]))


def _check_covariance(rows: Rows, size: int) -> None:
    """Raise InputError unless the rows are a covariance (size, size)."""
    if {len(rows), *map(len, rows)} != {size}:
        raise InputError(f"{size} x {size} numbers for a rig's relation", f"{len(rows)} rows", "give six a marker")
    try:
        check_covariance(np.array(rows))
    except InputError as error:
        expected = "a symmetric, positive semidefinite covariance of a rig's relation"
        raise InputError(expected, *error.args[1:]) from None


def planned_print(*targets: Marker | Rig) -> float:
    """Return the print error in m that markers were designed for, the largest of several; the usual one for others.

    Standard deviation of a dot's position along each axis, as in `Spec.print_sigma`.
    """
    parts = [[each.marker for each in target.markers] if isinstance(target, Rig) else [target] for target in targets]
    specs = [marker.provenance.get("spec") for markers in parts for marker in markers]
    planned = [spec.get("print_sigma") if isinstance(spec, Mapping) else None for spec in specs]
    known = [each if isinstance(each, float) and each > 0 else USUAL_PRINT for each in planned]
    return max(known, default=USUAL_PRINT)
