"""Prisms and revolutions as plain data, in mm: what parts are made of, independent of any CAD kernel.

Outlines and profiles are contours of exact lines and arcs. Volumes, boxes and heights are closed-form; the kernel's
results are checked against them, and the fabrication sheet shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, pi, sin

import numpy as np

from markergen.arrays import Array
from markergen.geometry import contour
from markergen.geometry.contour import Contour, area, circle, offset

Box = tuple[float, float, float, float]
"""Left, bottom, right and top."""

OTHER = {"light": "dark", "dark": "light"}
"""Apparent material of the floor of a mark, by the surrounding material."""

COLORS = {"light": (1.0, 1.0, 1.0), "dark": (0.05, 0.05, 0.05)}
"""Red, green and blue of a material, 0 to 1, sRGB."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Rotation of a part that is where it was made; tuples, since parts are keys of caches."""

SAME = 1e-6
"""Lengths in mm that differ by less are equal."""

OFF = 2e-3
"""Maximum deviation in mm of a polygon from its arcs: a tenth of what is visible on paper."""


@dataclass(frozen=True)
class Prism:
    """A vertical prism between two heights, with through holes.

    Attributes
    ----------
    outer : Contour
        Counterclockwise.
    holes : tuple of Contour
        Clockwise.
    chamfer : float
        Leg of a 45 degree chamfer around the upper outer edge, for which arcs of the outline must be tangent to their
        neighbors.
    """

    outer: Contour
    holes: tuple[Contour, ...]
    bottom: float
    top: float
    chamfer: float = 0.0

    @property
    def outline(self) -> Contour:
        """Outline in plan view."""
        return self.outer

    @property
    def box(self) -> Box:
        """Bounding box in plan view, exact for arcs."""
        return contour.box(self.outer)

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest z."""
        return self.bottom, self.top

    @property
    def volume(self) -> float:
        """Volume in mm^3: area times height, less the chamfer.

        Along the chamfer the area is a quadratic function of the height, for which Simpson's rule is exact.
        """
        full = area(self.outer)
        whole = (full + sum(map(area, self.holes))) * (self.top - self.bottom)
        if not self.chamfer:
            return whole
        half, top = (area(offset(self.outer, share * self.chamfer)) for share in (0.5, 1.0))
        return whole - self.chamfer * (full - (full + 4 * half + top) / 6)


@dataclass(frozen=True)
class Revolved:
    """A body of revolution about the vertical axis through (x, y).

    Attributes
    ----------
    profile : Contour
        In (radius, z), radius >= 0, counterclockwise with the radius to the right and z up. Sides may lie on the axis;
        a profile away from the axis makes a ring.
    """

    x: float
    y: float
    profile: Contour

    @property
    def radii(self) -> tuple[float, float]:
        """Smallest and largest radius."""
        inner, _, outer, _ = contour.box(self.profile)
        return inner, outer

    @property
    def outline(self) -> Contour:
        """Outline in plan view."""
        return circle(self.radii[1], self.x, self.y)

    @property
    def box(self) -> Box:
        """Bounding box in plan view."""
        _, r = self.radii
        return self.x - r, self.y - r, self.x + r, self.y + r

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest z."""
        _, low, _, high = contour.box(self.profile)
        return low, high

    @property
    def volume(self) -> float:
        """Volume in mm^3 by Pappus' theorem: 2 pi times the moment of the profile about the axis."""
        return 2 * pi * _moment(self.profile)


Primitive = Prism | Revolved


@dataclass(frozen=True)
class Part:
    """One part to make: bodies joined together, less bodies cut from them.

    Attributes
    ----------
    name : str
        ``plate``, or ``plate-1`` and so on for several; ``dot-<id>``, ``dot-<id>-core``, ``tag-<k>``.
    material : {"light", "dark"}
    add : tuple of Primitive
        Bodies that are joined; they do not overlap.
    cut : tuple of Primitive
        Bodies that are removed. Each lies inside the added ones or ends at their surface; they are disjoint.
    marked : tuple of Primitive
        Bodies that are also removed, leaving floors of the other color: engraved marks.
    """

    name: str
    material: str
    add: tuple[Primitive, ...]
    cut: tuple[Primitive, ...] = ()
    marked: tuple[Primitive, ...] = ()

    @property
    def pieces(self) -> "tuple[PosedPart, ...]":
        """The part where it is, as a body of one plate has it."""
        return (PosedPart(self),)

    @property
    def is_block(self) -> bool:
        """False: no faces of several plates close it."""
        return False

    @property
    def is_plate(self) -> bool:
        """True for a plate, False for a part that lies or stands in one."""
        return self.name.startswith("plate")

    @property
    def is_disk(self) -> bool:
        """True if the outline is a single circle."""
        body = self.add[0]
        return isinstance(body, Revolved) or body.outer.is_circle

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest z."""
        return span_of(self.add)

    @property
    def volume(self) -> float:
        """Volume in mm^3."""
        return sum(body.volume for body in self.add) - sum(body.volume for body in (*self.cut, *self.marked))


@dataclass(frozen=True)
class PosedPart:
    """A part in the frame of its plate, mm, with the rotation and the translation that place it in the body."""

    part: Part
    rotation: tuple[tuple[float, ...], ...] = IDENTITY
    translation: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def is_moved(self) -> bool:
        """False if the frame of the plate is that of the body."""
        return self.rotation != IDENTITY or any(self.translation)

    def to_body(self, points: Array) -> Array:
        """Transform points (..., 3) in mm to the body frame."""
        return points @ np.array(self.rotation).T + np.array(self.translation)


@dataclass(frozen=True)
class BodyPart:
    """One part of a body of several plates.

    Attributes
    ----------
    name : str
        ``+x/dot-0``: the name of the plate and that of the part; or ``body``.
    material : {"light", "dark"}
    pieces : tuple of PosedPart
        The part itself or, of a block, its faces: parts of which neither the walls nor the bottom of the first
        primitive count.
    volume : float
        mm^3.
    """

    name: str
    material: str
    pieces: tuple[PosedPart, ...]
    volume: float

    @property
    def is_block(self) -> bool:
        """True for a block that its faces close."""
        return len(self.pieces) > 1


def mm(meters: float) -> float:
    """Convert to mm, rounded to a picometer, so that 0.0036 m is 3.6 mm and not 3.5999999999999996."""
    return round(meters * 1e3, 9) + 0.0


def at_height(points: Array, z: float) -> Array:
    """Points (m, 3) of a plane (m, 2) at a height."""
    return np.column_stack([points, np.full(len(points), z)])


def cylinder(x: float, y: float, radius: float, bottom: float, top: float, inner: float = 0.0) -> Revolved:
    """Vertical cylinder; a tube if it has an inner radius."""
    return Revolved(x, y, Contour(((inner, bottom), (radius, bottom), (radius, top), (inner, top))))


def span_of(bodies: Sequence[Part | Primitive]) -> tuple[float, float]:
    """Lowest and highest z of several parts or bodies."""
    lows, highs = zip(*(body.span for body in bodies), strict=True)
    return min(lows), max(highs)


def size_of(bodies: Sequence[Primitive]) -> tuple[float, float]:
    """Width and height of bodies in plan view, exact for arcs."""
    lefts, bottoms, rights, tops = zip(*(body.box for body in bodies), strict=True)
    return max(rights) - min(lefts), max(tops) - min(bottoms)


def _moment(profile: Contour) -> float:
    """First moment of a profile's area about the axis, by Green's theorem: the integral of r^2/2 dz along it."""
    total = 0.0
    for (r, z), (u, w), bulge in profile.sides:
        total += (w - z) * (r * r + r * u + u * u) / 6
        if bulge:
            angle = 4 * atan(bulge)
            chord = ((u - r) ** 2 + (w - z) ** 2) ** 0.5
            radius = chord / (2 * abs(sin(angle / 2)))
            segment = radius**2 * (angle - sin(angle)) / 2
            # For a left turn, the centroid of the circular segment lies to the right of the chord, 4 R sin^3(a/2) /
            # (3 (a - sin a)) from the arc's center; its moment is its area times its centroid's distance from the axis.
            half = angle / 2
            normal = ((w - z) / chord, -(u - r) / chord)
            reach = 4 * radius * abs(sin(half)) ** 3 / (3 * abs(angle - sin(angle)))
            center = chord / 2 * (1 - bulge**2) / (2 * abs(bulge))
            side = 1.0 if bulge > 0 else -1.0
            centroid = (r + u) / 2 + side * normal[0] * (reach - center)
            total += segment * centroid
    return total
