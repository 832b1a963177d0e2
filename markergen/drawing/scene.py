"""Scene: a display list in millimeters, y up, replayed by every file format. Formats are independent of markers."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, pi, sqrt

import numpy as np

from markergen.arrays import Array
from markergen.drawing.paper import Paper
from markergen.geometry.region import Region

Point = tuple[float, float]

Segment = tuple[str, tuple[Point, ...]]
"""Segment of a path: ``M`` and ``L`` with one point, ``Q`` with two, ``C`` with three, ``Z`` with none."""

BLACK, WHITE = "#000000", "#ffffff"

GRAY, LIGHT = "#5a5a5a", "#9a9a9a"

FINE = 0.25
"""Width in mm of lines that must be visible from a distance."""

HAIRLINE = 0.15
"""Minimum line width in mm that a 600 dpi printer draws without gaps."""

LAYERS = ("ground", "dots", "tag", "cut", "marks", "text")
"""Layers of a marker's sheet, from the bottom up."""

FLATNESS = 1e-4
"""Maximum distance in mm of the outline of a clipped circle from the circle."""


@dataclass(frozen=True)
class Disk:
    """Filled circle, or annulus if it has an inner radius (even-odd: the hole is not painted); mm."""

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
    """Stroked polyline with mitered corners; points and width in mm.

    It has butt ends, or is closed if its end is its start.
    """

    points: tuple[Point, ...]
    width: float
    name: str = ""
    color: str = BLACK

    @property
    def closed(self) -> bool:
        """True if the line ends at its start."""
        return len(self.points) > 3 and self.points[0] == self.points[-1]

    @property
    def path_points(self) -> tuple[Point, ...]:
        """Corners of a box containing the stroke."""
        half = self.width / 2
        return tuple((x + sign * half, y + sign * half) for x, y in self.points for sign in (-1, 1))


@dataclass(frozen=True)
class FilledPath:
    """Filled path (nonzero winding) of line, quadratic and cubic segments, such as glyphs and arrowheads; mm."""

    segments: tuple[Segment, ...]
    name: str = ""
    color: str = BLACK

    @property
    def path_points(self) -> tuple[Point, ...]:
        """All points of the path; their convex hull contains the curves."""
        return tuple(point for _, points in self.segments for point in points)


Shape = Disk | Line | FilledPath
Box = tuple[float, float, float, float]
"""Left, bottom, right and top, mm."""


@dataclass(frozen=True)
class Layer:
    """Named group of shapes; later ones cover earlier ones."""

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
        """Shapes of the named layer; empty if there is no such layer."""
        return tuple(shape for layer in self.layers if layer.name == name for shape in layer.shapes)


@dataclass(frozen=True)
class Sheet:
    """Page ready for any printable format.

    Attributes
    ----------
    scene : Scene
        Scene in mm from the page's lower left corner; layers ``dots``, ``tag`` if there is one, ``cut``, ``marks`` and
        ``text``, and below them ``ground`` if the paper's color is printed.
    origins_mm : tuple of (x, y)
        Positions of the markers' origins on the page, one per marker; a tile's may be off the page, a plan has none.
    rulers_mm : (int, int)
        Nominal lengths of the printed rulers along x and y; 0 for none.
    title, description : str
        Metadata for the file.
    notes : tuple of str
        Sentences for the user; those about several pages are with the first page.
    trim_mm : (left, bottom, right, top)
        Part of the page that remains after cutting: all of it, except for tiles.
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
    """True if a box contains the origin."""
    left, bottom, right, top = box
    return left <= 0 <= right and bottom <= 0 <= top


def bounds(shape: Shape) -> Box:
    """Bounding box (left, bottom, right, top) in mm of a shape; ValueError for an outline without points."""
    xs, ys = zip(*shape.path_points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def union(first: Box, *others: Box) -> Box:
    """Bounding box of boxes."""
    boxes = (first, *others)
    return (
        min(box[0] for box in boxes),
        min(box[1] for box in boxes),
        max(box[2] for box in boxes),
        max(box[3] for box in boxes),
    )


def overlaps(a: Box, b: Box) -> bool:
    """True if two boxes have more than an edge in common."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


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
    """Merge the layers of several drawings into a scene; ``ground`` and ``tag`` only if they are not empty."""
    merged = {name: tuple(shape for group in layers for shape in group.get(name, ())) for name in LAYERS}
    return Scene(tuple(Layer(name, merged[name]) for name in LAYERS if merged[name] or name not in ("ground", "tag")))


def moved_layers(layers: Mapping[str, Sequence[Shape]], dx: float, dy: float) -> dict[str, tuple[Shape, ...]]:
    """Layers with all shapes moved by (dx, dy) mm."""
    return {name: tuple(moved(shape, dx, dy) for shape in shapes) for name, shapes in layers.items()}


def moved(shape: Shape, dx: float, dy: float) -> Shape:
    """Shape moved by (dx, dy) mm."""
    return mapped(shape, lambda x, y: (x + dx, y + dy))


def rotated(outline: FilledPath, x: float, y: float) -> FilledPath:
    """Path rotated a quarter turn counterclockwise about (x, y)."""
    return mapped_path(outline, lambda px, py: (x - (py - y), y + (px - x)))


def mapped(shape: Shape, to: Callable[[float, float], Point]) -> Shape:
    """Shape whose points are moved by a function; radii and widths stay."""
    if isinstance(shape, Disk):
        x, y = to(shape.x, shape.y)
        return replace(shape, x=x, y=y)
    if isinstance(shape, Line):
        return replace(shape, points=tuple([to(x, y) for x, y in shape.points]))
    return mapped_path(shape, to)


def mapped_path(path: FilledPath, to: Callable[[float, float], Point]) -> FilledPath:
    """Path whose points are moved by a function."""
    segments = [(command, tuple([to(x, y) for x, y in points])) for command, points in path.segments]
    return replace(path, segments=tuple(segments))


def renamed(shapes: Iterable[Shape], prefix: str) -> tuple[Shape, ...]:
    """Shapes whose names get a prefix."""
    return tuple(replace(shape, name=prefix + shape.name) if shape.name else shape for shape in shapes)


def corners(box: Box) -> tuple[Point, Point, Point, Point]:
    """Corners of a box, counterclockwise from the lower left."""
    left, bottom, right, top = box
    return (left, bottom), (right, bottom), (right, top), (left, top)


def rectangle(box: Box, name: str, color: str) -> FilledPath:
    """Filled box."""
    return polygon(corners(box), name, color)


def frame_lines(box: Box, width: float, name: str = "", color: str = BLACK) -> Line:
    """Closed line around a box."""
    return closed_line(corners(box), width, name, color)


def closed_line(points: Sequence[Point], width: float, name: str = "", color: str = BLACK) -> Line:
    """Line through points and back to the first."""
    return Line((*points, points[0]), width, name, color)


def polygon(points: Sequence[Point], name: str, color: str) -> FilledPath:
    """Filled polygon."""
    return filled([points], name, color)


def filled(rings: Iterable[Sequence[Point]], name: str, color: str = BLACK) -> FilledPath:
    """Filled path of polygons, whose holes run opposite to the outlines around them."""
    segments: list[Segment] = []
    for first, *others in rings:
        segments += [("M", (first,)), *(("L", (point,)) for point in others), ("Z", ())]
    return FilledPath(tuple(segments), name, color)


def clipped(shapes: Iterable[Shape], box: Box) -> Iterator[Shape]:
    """Clip shapes to a box; shapes entirely inside are unchanged, shapes outside are omitted.

    A clipped disk becomes an outline within `FLATNESS` of it. A clipped line may become several, named ``<name>``,
    ``<name>-part-2`` and so on. Clipped paths must have only straight segments, as those of tags do.
    """
    window = Region.rectangle(*box)
    for shape in shapes:
        left, bottom, right, top = bounds(shape)
        if left >= box[0] and bottom >= box[1] and right <= box[2] and top <= box[3]:
            yield shape
            continue
        if not overlaps((left, bottom, right, top), box):
            continue
        if isinstance(shape, Line):
            for number, run in enumerate(window.runs(shape.points), 1):
                suffix = f"-part-{number}" if number > 1 else ""
                yield replace(shape, points=points_of(run), name=shape.name + suffix)
            continue
        if rings := (_region(shape) & window).rings:
            yield filled(map(points_of, rings), shape.name, shape.color)


def _region(shape: Disk | FilledPath) -> Region:
    """Region of a disk or of a path of straight segments whose holes run opposite to the outlines around them."""
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


def points_of(ring: Array) -> tuple[Point, ...]:
    """Corners (m, 2) as those of a shape."""
    return tuple((x, y) for x, y in ring.tolist())
