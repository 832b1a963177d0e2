"""The scene: a display list in millimeters, y up, that every file format replays. No format knows what a marker is."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from markergen.errors import InputError
from markergen.model.marker import Marker

Point = tuple[float, float]
Segment = tuple[str, tuple[Point, ...]]
"""One step of a path: ``M`` and ``L`` with one point, ``Q`` with two, ``C`` with three, ``Z`` with none."""

BLACK, WHITE = "#000000", "#ffffff"

FLAT = 1e-9
"""How far in m a control point may lie off the plane and still be flat: rounding, far below any printer."""


@dataclass(frozen=True)
class Disk:
    """A filled circle, or an annulus when it has an inner radius (even-odd: the hole is not painted); mm."""

    x: float
    y: float
    radius: float
    inner_radius: float = 0.0
    name: str = ""
    color: str = BLACK

    @property
    def path_points(self) -> tuple[Point, ...]:
        """Corners of the bounding box."""
        return (self.x - self.radius, self.y - self.radius), (self.x + self.radius, self.y + self.radius)


@dataclass(frozen=True)
class Line:
    """A stroked run of straight segments with mitered corners; points and width in mm.

    It has butt ends, or is closed if it ends where it begins.
    """

    points: tuple[Point, ...]
    width: float
    name: str = ""
    color: str = BLACK

    @property
    def closed(self) -> bool:
        """Whether it ends where it begins."""
        return len(self.points) > 3 and self.points[0] == self.points[-1]

    @property
    def path_points(self) -> tuple[Point, ...]:
        """Corners of a box that holds the stroke."""
        half = self.width / 2
        return tuple((x + sign * half, y + sign * half) for x, y in self.points for sign in (-1, 1))


@dataclass(frozen=True)
class Outline:
    """A filled path (nonzero winding) of line, quadratic and cubic segments: glyphs and arrow heads; mm."""

    segments: tuple[Segment, ...]
    name: str = ""
    color: str = BLACK

    @property
    def path_points(self) -> tuple[Point, ...]:
        """All points of the path; its hull holds the curves."""
        return tuple(point for _, points in self.segments for point in points)


Shape = Disk | Line | Outline
Box = tuple[float, float, float, float]


def around_origin(box: Box) -> bool:
    """Tell whether a box holds the origin."""
    left, bottom, right, top = box
    return left <= 0 <= right and bottom <= 0 <= top


def bounds(shape: Shape) -> Box:
    """Box (left, bottom, right, top) in mm that holds the shape; an outline without points has none (ValueError)."""
    xs, ys = zip(*shape.path_points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


@dataclass(frozen=True)
class Layer:
    """Shapes under one name; later ones cover earlier ones."""

    name: str
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Scene:
    """Layers from the bottom up."""

    layers: tuple[Layer, ...]

    def __iter__(self) -> Iterator[Shape]:
        """Iterate over all shapes in painting order."""
        return (shape for layer in self.layers for shape in layer.shapes)

    def __getitem__(self, name: str) -> tuple[Shape, ...]:
        """Shapes of the layer of that name; none if there is no such layer."""
        return tuple(shape for layer in self.layers if layer.name == name for shape in layer.shapes)


def marker_dots(marker: Marker) -> tuple[Disk, ...]:
    """Dots of the marker as disks named ``dot-<id>``, in mm, marker frame.

    Raises
    ------
    InputError
        If a control point has no dot (diameter 0), or lies off the plane: neither can be printed.
    """
    for point in marker.control_points:
        if point.feature.diameter == 0:
            raise InputError(
                "a dot on every control point to print or make",
                f"control point {point.id} without a dot (diameter 0)",
                "design the marker again with --dot above 0",
            )
        if abs(point.z) > FLAT:
            raise InputError(
                "a flat marker (z = 0)",
                f"control point {point.id} at z={point.z * 1e3:.6g} mm",
                "export it as .json, or design it without relief",
            )
    return tuple(
        Disk(
            _mm(point.x),
            _mm(point.y),
            _mm(point.feature.diameter) / 2,
            _mm(point.feature.inner_diameter) / 2,
            f"dot-{point.id}",
        )
        for point in marker.control_points
    )


def marker_tag(marker: Marker) -> tuple[Outline, ...]:
    """Ink of the marker's tag as one outline named ``tag``, in mm, marker frame; none without a tag.

    Neighboring black cells are one region, so that no seam shows; holes run against what they are cut from.
    """
    if marker.tag is None:
        return ()
    segments: list[Segment] = []
    for outline in marker.tag.outlines:
        points = [(_mm(x), _mm(y)) for x, y in outline.tolist()]
        segments += [("M", (points[0],)), *(("L", (point,)) for point in points[1:]), ("Z", ())]
    return (Outline(tuple(segments), "tag"),)


def moved(disk: Disk, dx: float, dy: float) -> Disk:
    """Disk shifted by (dx, dy) mm."""
    return replace(disk, x=disk.x + dx, y=disk.y + dy)


def _mm(meters: float) -> float:
    # Rounded to a picometer, so that 0.0036 m reads 3.6 mm and not 3.5999999999999996.
    return round(meters * 1e3, 9)
