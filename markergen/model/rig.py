"""The rig: markers with a known rigid relation, of which each view sees some, such as the faces of a cube."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from os import PathLike
from typing import IO, TYPE_CHECKING, Any, ClassVar, Literal, Self, Unpack

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.defaults import PRINT_SIGMA
from markergen.errors import InputError, brief
from markergen.model.body import ROUNDING, Body, Plate, Rows, check_covariance
from markergen.model.marker import Marker
from markergen.registry import door
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.files import Written
    from markergen.options.declarations import ExportKeywords


MOST_MARKERS = 100
"""Maximum number of markers of a rig."""


@dataclass(frozen=True, repr=False)
class Rig(Body):
    """Markers with a known rigid relation, a body of several plates.

    A pose T_camera_rig is estimated from all dots of all markers in view.
    The dots are numbered through the markers in their order; `owner` is the marker of each.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> points = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(points, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> side = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    >>> rig = Rig((Plate("front", marker, np.eye(3), [0, 0, 0.1]), Plate("side", marker, side, [0.1, 0, 0])))
    >>> rig
    Rig(2 markers, 8 control points within 117 mm of its origin)
    >>> rig.xyz.shape, rig.normals[4], rig.owner
    ((8, 3), array([1., 0., 0.]), array([0, 0, 0, 0, 1, 1, 1, 1]))

    Attributes
    ----------
    markers : tuple of Plate
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

    frame: ClassVar[Literal["rig"]] = "rig"

    markers: tuple[Plate, ...]
    relation: Rows | None = field(default=None, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    extensions: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "markers", tuple(self.markers))
        if not 1 <= len(self.markers) <= MOST_MARKERS:
            raise InputError(f"1 to {MOST_MARKERS} markers of a rig", f"{len(self.markers)}", "correct the rig")
        names = [plate.name for plate in self.markers]
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
        return door("model.body_json.load_rig")(source)

    def __repr__(self) -> str:
        count, dots = len(self.markers), len(self)
        return (
            f"Rig({count} marker{'s' * (count > 1)}, {dots} control point{'s' * (dots != 1)} "
            f"within {format_length(float(f'{self.radius:.3g}'))} of its origin)"
        )

    def __hash__(self) -> int:
        return hash((self.markers, self.relation))

    @property
    def plates(self) -> tuple[Plate, ...]:
        """The markers with their poses."""
        return self.markers

    def with_plates(self, plates: Sequence[Plate], relation: Array | None = None) -> Self:
        """See `Body.with_plates`."""
        rows = None if relation is None else tuple(map(tuple, relation))
        return replace(self, markers=tuple(plates), relation=rows)

    @cached_property
    def ids(self) -> NDArray[np.intp]:
        """Numbers (n,) of the control points, through the markers."""
        return np.arange(len(self))

    @cached_property
    def radius(self) -> float:
        """Distance in m from the rig's origin to the farthest point of an outline."""
        return max(float(np.linalg.norm(self.outline(k), axis=-1).max()) for k in range(len(self.markers)))

    def outline(self, index: int) -> Array:
        """Points (m, 3) in m of the outlines of one marker's boundary, rig frame."""
        plate = self.markers[index]
        points = np.concatenate(plate.marker.boundary.outlines())
        return plate.to_body(np.column_stack([points, np.zeros(len(points))]))

    @cached_property
    def margins(self) -> Array:
        """Margins (k,) in m of the plates around the markers' boundaries, as they are drawn.

        One dot diameter, but at most half the gap to the nearest other outline, less an eighth of a dot: 0 for faces
        that meet at an edge.
        """
        diameters = np.array([plate.marker.dot_diameter for plate in self.markers])
        margins, rims = diameters.copy(), [_rim(plate, plate.marker.dot_diameter / 8) for plate in self.markers]
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
    def is_convex(self) -> bool:
        """True if no plate stands in front of the plane of another, as on a cube or a wall: no face hides another."""
        tolerance = ROUNDING * max(self.radius, 1.0)
        outlines = [self.outline(k) for k in range(len(self.markers))]
        return all(
            float(plate.to_marker(outline)[:, 2].max()) <= tolerance for plate in self.markers for outline in outlines
        )

    @cached_property
    def relation_covariance(self) -> Array | None:
        """Covariance (6 k, 6 k) of `relation`, or None."""
        return None if self.relation is None else np.array(self.relation)

    def save(self, *paths: str | PathLike[str], **options: "Unpack[ExportKeywords]") -> "list[Written]":
        """Write the rig to each path in the format of its suffix, such as .json; see `markergen.export`."""
        return door("api.export.export")(self, *paths, **options)

    def plot(self, ax: "Axes | None" = None, direction: Array | None = None) -> "Axes":
        """Draw the plates to scale, in mm, into given or new matplotlib axes, and return the axes.

        They are seen from far away in a direction (3,) of the rig's frame, by default from the front.
        """
        return door("model.picture.draw_rig")(self, ax, direction)


def _rim(plate: Plate, spacing: float) -> Array:
    """Points (m, 3) in m, rig frame, on the outlines of a marker's boundary, at most `spacing` apart unless it is 0."""
    region = plate.marker.boundary.region
    points = np.concatenate((region.mapped(lambda corners: corners, spacing) if spacing else region).rings)
    return plate.to_body(np.column_stack([points, np.zeros(len(points))]))


def _check_covariance(rows: Rows, size: int) -> None:
    """Raise InputError unless the rows are a covariance (size, size)."""
    if {len(rows), *map(len, rows)} != {size}:
        raise InputError(f"{size} x {size} numbers for a rig's relation", f"{len(rows)} rows", "give six a marker")
    try:
        check_covariance(np.array(rows))
    except InputError as error:
        expected = "a symmetric, positive semidefinite covariance of a rig's relation"
        raise InputError(expected, *error.args[1:]) from None


Target = Marker | Rig
"""What is designed, printed and detected."""


def planned_print(*bodies: Body) -> float:
    """Return the print error in m that markers were designed for, the largest of several; the usual one for others.

    Standard deviation of a dot's position along each axis, as in `Spec.print_sigma`.
    """
    specs = [plate.marker.provenance.get("spec") for body in bodies for plate in body.plates]
    planned = [spec.get("print_sigma") if isinstance(spec, Mapping) else None for spec in specs]
    sigmas = [sigma if isinstance(sigma, float) and sigma > 0 else PRINT_SIGMA for sigma in planned]
    return max(sigmas, default=PRINT_SIGMA)
