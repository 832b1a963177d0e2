"""Bodies as plain data, in mm in the marker frame: what a solid is made of before any CAD kernel sees it.

Paths are contours in mm. Volumes are closed forms, so that what the kernel makes of a body can be held against them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, pi, sin
from typing import Any

from markergen.geometry import contour
from markergen.geometry.contour import Contour, Point, Side, area, center_of, circle, inset

__all__ = [
    "OFF", "OTHER", "Body", "Part", "Path", "Point", "Prism", "Revolved", "Side", "area", "center_of", "circle",
    "cylinder", "flattened", "inset", "mm", "part_volume", "polygon_of", "span", "volume",
]  # fmt: skip

Path = Contour

OFF = 2e-3
"""mm that a polygon may be off the arcs that it stands for: a tenth of what is seen on paper."""

OTHER = {"light": "dark", "dark": "light"}
"""Material that marked floors look like."""


@dataclass(frozen=True)
class Prism:
    """An upright prism between two heights: an outer path, and holes in it.

    Attributes
    ----------
    chamfer : float
        Of the edge of the outer path at the top, 45 degrees. The path's arcs then go on smoothly at both ends.
    """

    outer: Path
    holes: tuple[Path, ...]
    bottom: float
    top: float
    chamfer: float = 0.0


@dataclass(frozen=True)
class Revolved:
    """A body of revolution about the upright axis through (x, y).

    Attributes
    ----------
    profile : Path
        In (radius, z), radius >= 0, counterclockwise with the radius to the right and z up. Sides on the axis are
        allowed; a profile that keeps off it makes a ring.
    """

    x: float
    y: float
    profile: Path


Body = Prism | Revolved


@dataclass(frozen=True)
class Part:
    """One part to make: bodies that are joined, less bodies that are cut from them.

    Attributes
    ----------
    name : str
        ``plate``, or ``plate-1`` and so on where there are several; ``dot-<id>``, ``dot-<id>-core``, ``tag-<k>``.
    material : {"light", "dark"}
    add, cut : tuple of Body
        What is cut lies inside of what is added, or ends at its surface.
    marked : tuple of Body
        Cut as well, and their floors are of the other color: engraved.
    """

    name: str
    material: str
    add: tuple[Body, ...]
    cut: tuple[Body, ...] = ()
    marked: tuple[Body, ...] = ()

    @property
    def is_plate(self) -> bool:
        """Whether it is a plate, and not what stands or lies in one."""
        return self.name.startswith("plate")

    @property
    def is_disk(self) -> bool:
        """Whether its outline is one circle."""
        body = self.add[0]
        return isinstance(body, Revolved) or body.outer.is_circle


def mm(meters: float) -> float:
    """Length in mm, rounded to a picometer, so that 0.0036 m reads 3.6 mm and not 3.5999999999999996."""
    return round(meters * 1e3, 9) + 0.0


def volume(body: Body) -> float:
    """Volume of a body in mm^3: area times height, or Pappus' rule by the moment of the profile about the axis.

    A chamfer's sections are a polynomial of the second degree in the height, for which Simpson's rule is exact.
    """
    if isinstance(body, Prism):
        full = area(body.outer)
        section = full + sum(area(hole) for hole in body.holes)
        whole = section * (body.top - body.bottom)
        if not body.chamfer:
            return whole
        half, top = (area(inset(body.outer, share * body.chamfer)) for share in (0.5, 1.0))
        return whole - body.chamfer * (full - (full + 4 * half + top) / 6)
    return 2 * pi * _moment(body.profile)


def part_volume(part: Part) -> float:
    """Volume of a part whose added bodies do not overlap and whose cuts lie inside of them and apart."""
    return sum(map(volume, part.add)) - sum(map(volume, (*part.cut, *part.marked)))


def span(body: Body) -> tuple[float, float]:
    """Lowest and highest z of a body in mm; an arc's to a tenth of a micrometer."""
    if isinstance(body, Prism):
        return body.bottom, body.top
    heights = [z for _, z in flattened(body.profile, 1e-4)]
    return min(heights), max(heights)


def cylinder(x: float, y: float, radius: float, bottom: float, top: float, inner: float = 0.0) -> Revolved:
    """Upright cylinder, or tube if it has an inner radius."""
    return Revolved(x, y, Path(((inner, bottom), (radius, bottom), (radius, top), (inner, top))))


def flattened(path: Path, off: float = OFF) -> list[Point]:
    """Corners of a polygon for the path, from which its arcs are no farther than `off` mm."""
    return contour.flattened(path, off)


def polygon_of(outer: Path, holes: Sequence[Path] = ()) -> Any:
    """Shapely polygon of paths."""
    import shapely

    return shapely.Polygon(flattened(outer), [flattened(hole) for hole in holes])


def _moment(profile: Path) -> float:
    """Integral of the radius over the inside of a profile, by Green's theorem: that of r^2/2 dz along it."""
    total = 0.0
    for (r, z), (u, w), bulge in profile.sides:
        total += (w - z) * (r * r + r * u + u * u) / 6
        if bulge:
            angle = 4 * atan(bulge)
            chord = ((u - r) ** 2 + (w - z) ** 2) ** 0.5
            radius = chord / (2 * abs(sin(angle / 2)))
            segment = radius**2 * (angle - sin(angle)) / 2
            # The segment's middle lies to the right of the chord for a turn to the left, at 4 R sin^3(a/2) / (3 (a -
            # sin a)) from the arc's center; its moment is area times the middle's distance from the axis.
            half = angle / 2
            normal = ((w - z) / chord, -(u - r) / chord)
            offset = 4 * radius * abs(sin(half)) ** 3 / (3 * abs(angle - sin(angle)))
            center = chord / 2 * (1 - bulge**2) / (2 * abs(bulge))
            side = 1.0 if bulge > 0 else -1.0
            middle = (r + u) / 2 + side * normal[0] * (offset - center)
            total += segment * middle
    return total
