"""The marker: control points with their features inside a boundary, and its provenance."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from os import PathLike
from typing import IO, TYPE_CHECKING, Any, ClassVar, Literal, Self, Unpack, final

import numpy as np

from markergen.arrays import Array, Indices
from markergen.errors import InputError, brief
from markergen.model.body import Body, Plate, Rows, check_covariance
from markergen.model.boundary import Boundary
from markergen.model.feature import Feature, key_ring
from markergen.model.substrate import Substrate
from markergen.model.tag import Tag
from markergen.registry import door
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.files import Written
    from markergen.options.declarations import ExportKeywords


LIGHT_DOTS = "light dots on a dark ground are printed and detected, but not yet made as a solid"
"""The limits of `Feature.polarity`, in words."""


@dataclass(frozen=True)
class MeasuredSize:
    """Size of one dot as measured on a print, in m.

    Attributes
    ----------
    diameter : float
        Outer diameter.
    diameter_sigma : float or None
        Standard deviation of the diameter; None if unknown.

    Raises
    ------
    InputError
        If the diameter is not a finite number above 0, or the standard deviation is not a finite number of 0 or more.
    """

    diameter: float
    diameter_sigma: float | None = None

    def __post_init__(self) -> None:
        sigma = 0.0 if self.diameter_sigma is None else self.diameter_sigma
        if not (isfinite(self.diameter) and self.diameter > 0 and isfinite(sigma) and sigma >= 0):
            raise InputError(
                "a measured diameter above 0, and a standard deviation of 0 or more",
                f"diameter={self.diameter}, diameter_sigma={self.diameter_sigma}",
                "give both in m",
            )


@dataclass(frozen=True)
class JointCovariance:
    """Joint covariance of several control points measured in one adjustment, in the marker frame.

    Attributes
    ----------
    order : tuple of int
        Ids of the k control points.
    axes : {"xy", "xyz"}
        Coordinates of each control point, a = 2 or 3.
    matrix : tuple of tuple of float
        a k rows of a k numbers, m^2, in the order x0 y0 [z0] x1 y1 ...; singular where the measurement fixes no frame.

    Raises
    ------
    InputError
        If an id is repeated, the matrix has the wrong size, or it is not finite, symmetric and positive semidefinite up
        to rounding (`ROUNDING`, as correlations).
    """

    order: tuple[int, ...]
    axes: Literal["xy", "xyz"]
    matrix: Rows = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", tuple(int(number) for number in self.order))
        if self.axes not in ("xy", "xyz"):
            raise InputError("the axes xy or xyz", brief(self.axes), "say which coordinates the covariance is of")
        twice = [number for number in self.order if self.order.count(number) > 1]
        if twice or not self.order:
            actual = f"id {twice[0]} twice" if twice else "none"
            raise InputError("ids of control points, each once", actual, "correct the order")
        size = len(self.axes) * len(self.order)
        shape = [len(row) for row in self.matrix]
        if shape != [size] * size:
            raise InputError(
                f"{size} x {size} numbers for {len(self.order)} control points along {self.axes}",
                f"{len(shape)} rows of {' or '.join(map(str, sorted(set(shape))[:3])) or 'none'}",
                "give x y of each control point in turn, or x y z",
            )
        object.__setattr__(self, "matrix", tuple(tuple(map(float, row)) for row in self.matrix))
        check_covariance(self.array, " m^2")

    @cached_property
    def array(self) -> Array:
        """Matrix (a k, a k) in m^2."""
        return np.array(self.matrix, dtype=float)


@dataclass(frozen=True)
class ControlPoint:
    """One control point: identifier, position in the marker frame in m, and its printed feature.

    Attributes
    ----------
    covariance : (xx, xy, yy) or None
        Covariance of a place measured on the print, m^2; None if it was not measured or its precision is unknown.
    designed : (x, y) or None
        Designed place of a dot whose place was measured, m; None: at x, y over the marker's `print_scale`.
    designed_z : float or None
        Designed height, m; None: at z.
    measured : MeasuredSize or None
        Size of the dot on the print; None if it was not measured.
    """

    id: int
    x: float
    y: float
    z: float
    feature: Feature
    covariance: tuple[float, float, float] | None = None
    designed: tuple[float, float] | None = None
    designed_z: float | None = None
    measured: MeasuredSize | None = None


@final
@dataclass(frozen=True, repr=False)
class Marker(Body):
    """A designed marker: a body of one plate.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> points = np.array([[0.1, 0], [0, 0.1], [-0.1, 0], [0, -0.1]])
    >>> marker = build_marker(points, Circle(0.15), diameter=0.036, clearance=0.0036)
    >>> marker
    Marker(4 control points in a disk of radius 150 mm, dots of 36 mm)
    >>> marker.xyz.shape
    (4, 3)

    Attributes
    ----------
    control_points : tuple of ControlPoint
        In a designed marker, the first is the key ring, unless the layout identifies the dots.
    boundary : Boundary
    clearance : float
        Minimum gap in m between dots, and between a dot's edge and the boundary or a keep-out.
    substrate : Substrate
        Plate that carries the dots when the marker is made as a solid.
    provenance : mapping
        Spec, seed, versions, camera, poses and criteria, as plain JSON values.
    keep_outs : tuple of Boundary
        Regions without dots, such as mounting holes.
    tag : Tag or None
        Tag in the middle, at z = 0; its quiet zone is also a keep-out.
    print_scale : (x, y)
        Scale factors of the printer along x and y. The control points are those of the print; boundary, keep-outs, tag
        and features are those of the design.
    joint_covariance : JointCovariance or None
        Covariance of places that were measured together; then no control point has a covariance of its own.
    rulers : (x, y) or None
        Lengths in m printed beside the sheet's rulers, None for a missing ruler; None if unknown.
    extensions : mapping
        Plain JSON values from other programs, by name.
    """

    frame: ClassVar[Literal["marker"]] = "marker"

    control_points: tuple[ControlPoint, ...]
    boundary: Boundary
    clearance: float
    substrate: Substrate = Substrate()  # noqa: RUF009  (frozen, so it can be shared)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    keep_outs: tuple[Boundary, ...] = ()
    tag: Tag | None = None
    print_scale: tuple[float, float] = (1.0, 1.0)
    joint_covariance: JointCovariance | None = None
    rulers: tuple[float | None, float | None] | None = None
    extensions: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def load(cls, source: "str | PathLike[str] | IO[str] | IO[bytes] | Mapping[str, Any]") -> "Marker":
        """Read a marker.json of any version.

        Parameters
        ----------
        source : str, path, open file or mapping
            A path, a file open for text or bytes, or its content parsed by `json.load`.

        Raises
        ------
        InputError
            If the source is none of these, cannot be read, or is not a consistent marker.json; then the message lists
            the errors with their paths, at most 20.

        Examples
        --------
        >>> import io, json
        >>> from markergen.model.boundary import Circle
        >>> from markergen.model.body_json import to_json
        >>> points = np.array([[0.1, 0], [0, 0.1], [-0.1, 0], [0, -0.1]])
        >>> text = to_json(build_marker(points, Circle(0.15), 0.036, 0.0036)).decode()
        >>> Marker.load(io.StringIO(text))
        Marker(4 control points in a disk of radius 150 mm, dots of 36 mm)
        >>> Marker.load(json.loads(text)).control_points[1].y
        0.1
        """
        return door("model.body_json.load_marker")(source)

    @classmethod
    def grid(
        cls, size: str, pitch: float | str, dot: float | str | None = None, origin_dot: float | str | None = None
    ) -> "Marker":
        """Make a grid of dots, as of OpenCV, Kalibr and ROS-Industrial; ids count rows from the top left.

        Parameters
        ----------
        size : str
            Columns x rows, such as ``7x5``; ``4x11 asymmetric``: every other row is moved right by a pitch, and dots of
            a row are two pitches apart, OpenCV's ``squareSize`` and Kalibr's ``spacingMeters``.
        pitch : length
            Distance between rows.
        dot : length, optional
            Diameter; half of the pitch by default.
        origin_dot : length, optional
            Diameter of the dot in the lower left, which then is the origin: ROS-Industrial's modified circle grid.
            Without it, the origin is in the middle.

        Raises
        ------
        InputError
            If an argument is invalid.

        Examples
        --------
        >>> Marker.grid("4x11 asymmetric", pitch="20mm")
        Marker(44 control points in a rectangle of 152 mm x 212 mm, dots of 10 mm)
        """
        return door("model.boards.grid")(size, pitch, dot, origin_dot)

    @classmethod
    def hexagonal(cls, size: str, pitch: float | str, dot: float | str | None = None) -> "Marker":
        """Make a hexagonal lattice of columns x rows, neighbors a pitch apart; otherwise as `grid`."""
        return door("model.boards.hexagonal")(size, pitch, dot)

    @classmethod
    def circles(cls, rings: Sequence[tuple[int, float | str]], dot: float | str) -> "Marker":
        """Make dots evenly on circles about the origin, the first of each straight up.

        Parameters
        ----------
        rings : sequence of (int, length)
            Number of dots of each circle, and its radius.
        dot : length
            Diameter.

        Raises
        ------
        InputError
            If an argument is invalid.
        """
        return door("model.boards.circles")(rings, dot)

    @classmethod
    def from_points(cls, points: Any, dot: float | str) -> "Marker":
        """Make dots at given points (n, 2 or 3) in m, in a rectangle around them; ids count from 0.

        Raises
        ------
        InputError
            If an argument is invalid.
        """
        return door("model.boards.from_points")(points, dot)

    def __repr__(self) -> str:
        count, size = len(self), self.dot_words if self else ""
        parts = [f"{count} control point{'s' * (count != 1)} in a {self.boundary}"]
        parts += [f"dots of {size}" if size and self.dot_diameter else "bare points"] if self else []
        parts += [f"tag {self.tag}"] if self.tag else []
        parts += [f"spec {self.spec_hash[:40]}"] if "spec_hash" in self.provenance else []
        return f"Marker({', '.join(parts)})"

    def _repr_html_(self) -> str:
        """Return a picture of the layout, for notebooks."""
        return door("model.picture.svg")(self)

    def __len__(self) -> int:
        return len(self.control_points)

    def __hash__(self) -> int:
        # Equal markers have equal hashes; provenance and extensions are dictionaries.
        return hash((self.control_points, self.clearance, self.print_scale))

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, marker frame."""
        return np.array([[point.x, point.y, point.z] for point in self.control_points], dtype=float).reshape(-1, 3)

    @cached_property
    def plates(self) -> tuple[Plate, ...]:
        """Its only plate, whose frame is the marker's."""
        return (Plate("marker", self, ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0.0, 0.0, 0.0)),)

    def with_plates(self, plates: Sequence[Plate], relation: Array | None = None) -> Self:
        """Return the marker of the only plate."""
        del relation
        (plate,) = plates
        return plate.marker

    @property
    def radius(self) -> float:
        """Size in m: radius of the boundary's smallest enclosing circle."""
        return self.boundary.radius

    @cached_property
    def ids(self) -> Indices:
        """Ids (n,) of the control points."""
        return np.array([point.id for point in self.control_points], dtype=np.intp)

    def only(self, dots: Indices) -> "Marker":
        """Return the marker with some of its dots, (m,), alone."""
        if len(dots) == len(self):
            return self
        points = tuple(self.control_points[k] for k in dots)
        joint = self.joint_covariance
        if joint is None:
            return replace(self, control_points=points)
        ids = {point.id for point in points}
        kept = [k for k, number in enumerate(joint.order) if number in ids]
        axes = len(joint.axes)
        rows = (axes * np.array(kept, dtype=np.intp)[:, None] + np.arange(axes)).ravel()
        order = tuple(joint.order[k] for k in kept)
        matrix = tuple(map(tuple, joint.array[np.ix_(rows, rows)].tolist()))
        return replace(
            self,
            control_points=points,
            joint_covariance=replace(joint, order=order, matrix=matrix) if kept else None,
        )

    @cached_property
    def place_covariance(self) -> Array | None:
        """Covariances (n, 2, 2) in m^2 of measured places, nan for other points; None if there is none."""
        covariances = [point.covariance for point in self.control_points]
        if not any(covariances):
            return None
        rows = [(c[0], c[1], c[1], c[2]) if c else (np.nan,) * 4 for c in covariances]
        return np.array(rows, dtype=float).reshape(-1, 2, 2)

    @cached_property
    def joint_places(self) -> Array | None:
        """Joint covariance (n, 3, n, 3) in m^2 of measured places, nan for other points; None if there is none."""
        if self.joint_covariance is None:
            return None
        place = {point.id: k for k, point in enumerate(self.control_points)}
        index = np.array([place[number] for number in self.joint_covariance.order], dtype=np.intp)
        axes = len(self.joint_covariance.axes)
        whole = np.full((len(self), 3, len(self), 3), np.nan)
        whole[index[:, None, None, None], np.arange(3)[:, None, None], index[:, None], np.arange(3)] = 0.0
        rows = index[:, None, None, None], np.arange(axes)[:, None, None], index[:, None], np.arange(axes)
        whole[rows] = self.joint_covariance.array.reshape(len(index), axes, len(index), axes)
        return whole

    @property
    def places_measured(self) -> bool:
        """True if the covariance of any dot's place on the print is known."""
        return self.joint_covariance is not None or any(point.covariance for point in self.control_points)

    @cached_property
    def search_xyz(self) -> Array:
        """Control points (n, 3) in m with their designed heights: a print of a flat marker is only nearly flat."""
        if all(point.designed_z is None for point in self.control_points):
            return self.xyz
        heights = [point.z if point.designed_z is None else point.designed_z for point in self.control_points]
        return np.column_stack([self.xyz[:, :2], heights])

    @cached_property
    def as_designed(self) -> Self:
        """See `Body.as_designed`."""
        measured = self.joint_covariance or any(
            p.designed or p.covariance or p.measured or p.designed_z is not None for p in self.control_points
        )
        if self.print_scale == (1.0, 1.0) and not measured:
            return self

        def back(point: ControlPoint) -> ControlPoint:
            x, y = point.designed or (point.x / self.print_scale[0], point.y / self.print_scale[1])
            # Rounded to whole picometers, which undoes multiplication and division exactly.
            z = point.z if point.designed_z is None else point.designed_z
            return ControlPoint(point.id, round(x, 12), round(y, 12), z, point.feature)

        points = tuple(back(point) for point in self.control_points)
        return replace(self, control_points=points, print_scale=(1.0, 1.0), joint_covariance=None)

    def save(self, *paths: str | PathLike[str], **options: "Unpack[ExportKeywords]") -> "list[Written]":
        """Write the marker to each path in the format of its suffix; see `markergen.export`."""
        return door("api.export.export")(self, *paths, **options)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the marker to scale, in mm, into given or new matplotlib axes, and return the axes."""
        return door("model.picture.draw_marker")(self, ax)

    @property
    def height(self) -> float:
        """Height in m of the highest control point above the plane; 0 if all are on it."""
        return max(0.0, float(self.xyz[:, 2].max()))

    @property
    def dot_diameter(self) -> float:
        """Largest diameter of a feature in m."""
        return max(point.feature.diameter for point in self.control_points)

    @property
    def dot_words(self) -> str:
        """Diameters of the dots in words, the largest first: ``100 mm, 20 mm``."""
        sizes = sorted({point.feature.diameter for point in self.control_points}, reverse=True)
        return ", ".join(dict.fromkeys(map(format_length, sizes)))

    @property
    def light(self) -> bool:
        """True if all dots are light on a dark ground."""
        return {point.feature.polarity for point in self.control_points} == {"light"}

    @property
    def blocked(self) -> tuple[Boundary, ...]:
        """All regions without dots: keep-outs, the tag with its quiet zone, holes of the plate and its outline."""
        tag = (self.tag.quiet_zone,) if self.tag else ()
        return (*self.keep_outs, *tag, *self.substrate.rims)

    @property
    def spec_hash(self) -> str:
        """Eight hexadecimal digits identifying the spec of the design, or ``unknown``."""
        return str(self.provenance.get("spec_hash", "unknown"))


def check_supported(marker: Marker, doing: str, light: bool = True) -> None:
    """Refuse a marker with features that marker.json supports and this program does not yet.

    Everything that reads, draws, makes or measures a marker calls this first, so that no light dot is made dark, no
    cube is flattened.

    Parameters
    ----------
    doing : str
        Action, for the message: ``to detect``.
    light : bool
        True if the action is possible for light dots. Light and dark dots on one marker are always refused: on no
        ground would both show.

    Raises
    ------
    InputError
    """
    remedy = "this version of markergen keeps it in marker.json and does nothing else with it"
    bright = [str(point.id) for point in marker.control_points if point.feature.polarity == "light"]
    if bright and not (light and marker.light):
        ids = ", ".join(bright[:10]) + (", ..." if len(bright) > 10 else "")
        remedy = f"{LIGHT_DOTS}; design it without --colors inverted" if marker.light else remedy
        kind = "dots all dark or all light" if light else "dark dots"
        raise InputError(f"{kind} {doing}", f"light dots: {ids}", remedy)


def light_marker(marker: Marker) -> Marker:
    """Return the marker with light dots on a dark ground."""
    points = (replace(p, feature=replace(p.feature, polarity="light")) for p in marker.control_points)
    return replace(marker, control_points=tuple(points))


def build_marker(points: Array, boundary: Boundary, diameter: float, clearance: float, keyed: bool = True) -> Marker:
    """Build a marker with a dot at each point (n, 2 or 3) in m: if `keyed`, the first is a ring; the others are disks.

    A diameter of 0 gives bare points.
    """
    features = [key_ring(diameter) if keyed else Feature(diameter), *[Feature(diameter)] * (len(points) - 1)]
    control_points = tuple(
        ControlPoint(i, float(x), float(y), float(z[0]) if z else 0.0, feature)
        for i, ((x, y, *z), feature) in enumerate(zip(points, features, strict=True))
    )
    return Marker(control_points, boundary, clearance)


def marker_name(marker: Marker) -> str:
    """Return ``markergen-<spec hash>``, safe in file headers, XML and on paper whatever the provenance contains."""
    return "markergen-" + re.sub(r"[^0-9A-Za-z_.-]", "", marker.spec_hash)[:16]
