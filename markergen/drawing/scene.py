"""The scene: a display list in millimeters, y up, that every file format replays. No format knows what a marker is."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.paper import Paper
from markergen.geometry.region import Region

Array = NDArray[np.float64]

Point = tuple[float, float]

Segment = tuple[str, tuple[Point, ...]]
"""One step of a path: ``M`` and ``L`` with one point, ``Q`` with two, ``C`` with three, ``Z`` with none."""

BLACK, WHITE = "#000000", "#ffffff"

GRAY, LIGHT = "#5a5a5a", "#9a9a9a"

FINE = 0.25
"""Width in mm of the lines that are to be seen from afar."""

HAIRLINE = 0.15
"""Width in mm that a 600 dpi printer still draws whole."""

LAYERS = ("ground", "dots", "tag", "cut", "marks", "text")
"""Layers of a marker's sheet, from the bottom up."""

FLATNESS = 1e-4
"""Largest distance in mm of the outline of a clipped circle from the circle."""


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
class FilledPath:
    """A filled path (nonzero winding) of line, quadratic and cubic segments: glyphs and arrow heads; mm."""

    segments: tuple[Segment, ...]
    name: str = ""
    color: str = BLACK

    @property
    def path_points(self) -> tuple[Point, ...]:
        """All points of the path; its hull holds the curves."""
        return tuple(point for _, points in self.segments for point in points)


Shape = Disk | Line | FilledPath
Box = tuple[float, float, float, float]
"""Left, bottom, right and top, mm."""


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


@dataclass(frozen=True)
class Sheet:
    """A page ready for any printable format.

    Attributes
    ----------
    paper : Paper
    scene : Scene
        In mm from the page's lower left corner; layers ``dots``, ``tag`` if there is one, ``cut``, ``marks`` and
        ``text``, below them ``ground`` if the paper's color is printed.
    origins_mm : tuple of (x, y)
        Where the markers' origins are on the page, one per marker; a tile's may be beyond its edge, a plan has none.
    rulers_mm : (int, int)
        What the printed rulers along x and y measure; 0 without one.
    title, description : str
        For the file's metadata.
    notes : tuple of str
        Sentences for the user; those about several pages come with the first.
    trim_mm : (left, bottom, right, top)
        What is left of the page once it is cut: all of it but for tiles.
    """

    paper: Paper
    scene: Scene
    origins_mm: tuple[Point, ...]
    rulers_mm: tuple[int, int]
    title: str
    description: str
    notes: tuple[str, ...]
    trim_mm: Box


def around_origin(box: Box) -> bool:
    """Tell whether a box holds the origin."""
    left, bottom, right, top = box
    return left <= 0 <= right and bottom <= 0 <= top


def bounds(shape: Shape) -> Box:
    """Box (left, bottom, right, top) in mm that holds the shape; an outline without points has none (ValueError)."""
    xs, ys = zip(*shape.path_points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def union(first: Box, *others: Box) -> Box:
    """Box around boxes."""
    boxes = (first, *others)
    return (
        min(box[0] for box in boxes),
        min(box[1] for box in boxes),
        max(box[2] for box in boxes),
        max(box[3] for box in boxes),
    )


def overlap(a: Box, b: Box) -> Box:
    """Intersection of two boxes that overlap."""
    return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


def ink_points(shapes: Sequence[Shape]) -> Array:
    """Points (m, 2) at most 1 mm apart along lines."""
    runs = [np.array(shape.points) for shape in shapes if isinstance(shape, Line)]
    if not runs:
        return np.zeros((0, 2))
    start, way = np.concatenate([run[:-1] for run in runs]), np.concatenate([np.diff(run, axis=0) for run in runs])
    steps = np.maximum(np.ceil(np.hypot(*way.T)), 1).astype(int)
    of = np.repeat(np.arange(len(steps)), steps + 1)
    number = np.arange(len(of)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    return np.asarray(start[of] + (number / steps[of])[:, None] * way[of])


def scene_of(layers: Sequence[Mapping[str, Sequence[Shape]]]) -> Scene:
    """Scene of what several drawings have in each layer; layers ``ground`` and ``tag`` only if they hold something."""
    found = {name: tuple(shape for each in layers for shape in each.get(name, ())) for name in LAYERS}
    return Scene(tuple(Layer(name, found[name]) for name in LAYERS if found[name] or name not in ("ground", "tag")))


def moved_layers(layers: Mapping[str, Sequence[Shape]], dx: float, dy: float) -> dict[str, tuple[Shape, ...]]:
    """All shapes moved by (dx, dy) mm."""
    return {name: tuple(moved(shape, dx, dy) for shape in shapes) for name, shapes in layers.items()}


def moved(shape: Shape, dx: float, dy: float) -> Shape:
    """Shape moved by (dx, dy) mm."""
    if isinstance(shape, Disk):
        return replace(shape, x=shape.x + dx, y=shape.y + dy)
    if isinstance(shape, Line):
        return replace(shape, points=tuple((x + dx, y + dy) for x, y in shape.points))
    moved = ((command, tuple((x + dx, y + dy) for x, y in points)) for command, points in shape.segments)
    return replace(shape, segments=tuple(moved))


def turned(outline: FilledPath, x: float, y: float) -> FilledPath:
    """FilledPath turned a quarter counterclockwise about (x, y)."""
    segments = (
        (command, tuple((x - (py - y), y + (px - x)) for px, py in points)) for command, points in outline.segments
    )
    return replace(outline, segments=tuple(segments))


def renamed(shapes: Iterable[Shape], prefix: str) -> tuple[Shape, ...]:
    """Shapes with a prefix before their names."""
    return tuple(replace(shape, name=prefix + shape.name) if shape.name else shape for shape in shapes)


def rectangle(box: Box, name: str, color: str) -> FilledPath:
    """Filled box."""
    return polygon([(box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3])], name, color)


def polygon(points: Sequence[Point], name: str, color: str) -> FilledPath:
    """Filled polygon."""
    return FilledPath(_ring(points), name, color)


def clipped(shapes: Iterable[Shape], box: Box) -> Iterator[Shape]:
    """Parts of the shapes in a box; what lies whole in it stays as it is, what is outside is left out.

    A cut disk becomes an outline within `FLATNESS` of it, a cut line several, named ``<name>``, ``<name>-part-2`` and
    so on. An outline that is cut must be of straight segments, as those of tags are.
    """
    window = Region.rectangle(*box)
    for shape in shapes:
        left, bottom, right, top = bounds(shape)
        if left >= box[0] and bottom >= box[1] and right <= box[2] and top <= box[3]:
            yield shape
            continue
        if left >= box[2] or bottom >= box[3] or right <= box[0] or top <= box[1]:
            continue
        if isinstance(shape, Line):
            for number, run in enumerate(window.runs(shape.points), 1):
                suffix = f"-part-{number}" if number > 1 else ""
                yield replace(shape, points=_points(run), name=shape.name + suffix)
            continue
        rings = [_ring(_points(ring)) for ring in (_region(shape) & window).rings]
        if rings:
            yield FilledPath(tuple(segment for ring in rings for segment in ring), shape.name, shape.color)


def _region(shape: Disk | FilledPath) -> Region:
    """Region of a disk or of a path of straight segments, in which holes run against what they are cut from."""
    if isinstance(shape, Disk):
        count = max(ceil(pi * sqrt(shape.radius / (2 * FLATNESS))), 16)
        angle = 2 * pi * np.arange(count) / count
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        holes = [shape.inner_radius * unit + (shape.x, shape.y)] if shape.inner_radius else []
        return Region.polygon(shape.radius * unit + (shape.x, shape.y), holes)
    rings: list[list[Point]] = []
    for command, points in shape.segments:
        if command == "M":
            rings.append([])
        rings[-1] += points
    return Region.odd(rings)


def _points(ring: Array) -> tuple[Point, ...]:
    return tuple((x, y) for x, y in ring.tolist())


def _ring(points: Sequence[Point]) -> tuple[Segment, ...]:
    first, *others = points
    return ("M", (first,)), *(("L", (point,)) for point in others), ("Z", ())
