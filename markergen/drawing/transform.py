"""Shapes moved, turned and clipped: what lays a drawing out on pages."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import ceil, pi, sqrt

import numpy as np

from markergen.drawing.scene import Box, Disk, Line, Outline, Point, Segment, Shape, bounds

FLATNESS = 1e-4
"""How far in mm the outline of a clipped circle may lie off it."""


def shifted(shape: Shape, dx: float, dy: float) -> Shape:
    """Shape moved by (dx, dy) mm."""
    if isinstance(shape, Disk):
        return replace(shape, x=shape.x + dx, y=shape.y + dy)
    if isinstance(shape, Line):
        return replace(shape, points=tuple((x + dx, y + dy) for x, y in shape.points))
    moved = ((command, tuple((x + dx, y + dy) for x, y in points)) for command, points in shape.segments)
    return replace(shape, segments=tuple(moved))


def turned(outline: Outline, x: float, y: float) -> Outline:
    """Outline turned a quarter counterclockwise about (x, y)."""
    segments = (
        (command, tuple((x - (py - y), y + (px - x)) for px, py in points)) for command, points in outline.segments
    )
    return replace(outline, segments=tuple(segments))


def renamed(shapes: Iterable[Shape], prefix: str) -> tuple[Shape, ...]:
    """Shapes with a prefix before their names."""
    return tuple(replace(shape, name=prefix + shape.name) if shape.name else shape for shape in shapes)


def rectangle(box: Box, name: str, color: str) -> Outline:
    """Filled box."""
    return polygon([(box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3])], name, color)


def polygon(points: Sequence[Point], name: str, color: str) -> Outline:
    """Filled polygon."""
    return Outline(_ring(points), name, color)


def clipped(shapes: Iterable[Shape], box: Box) -> Iterator[Shape]:
    """Parts of the shapes in a box; what lies whole in it stays as it is, what is outside is left out.

    A cut disk becomes an outline within `FLATNESS` of it, a cut line several, named ``<name>``, ``<name>-part-2`` and
    so on. An outline that is cut must be of straight segments, as those of tags are.
    """
    import shapely

    window = shapely.box(*box)
    for shape in shapes:
        left, bottom, right, top = bounds(shape)
        if left >= box[0] and bottom >= box[1] and right <= box[2] and top <= box[3]:
            yield shape
            continue
        if left >= box[2] or bottom >= box[3] or right <= box[0] or top <= box[1]:
            continue
        if isinstance(shape, Line):
            parts = shapely.get_parts(
                shapely.line_merge(shapely.intersection(shapely.LineString(shape.points), window))
            )
            runs = [part for part in parts if part.geom_type == "LineString" and part.length > 0]
            for number, run in enumerate(runs, 1):
                suffix = f"-part-{number}" if number > 1 else ""
                points = tuple((float(x), float(y)) for x, y in run.coords)
                yield replace(shape, points=points, name=shape.name + suffix)
            continue
        region = _region(shape)
        inside = shapely.intersection(region, window)
        rings: list[Segment] = []
        for part in shapely.get_parts(inside):
            if part.geom_type == "Polygon" and not part.is_empty:
                for ring in (part.exterior, *part.interiors):
                    rings += _ring([(float(x), float(y)) for x, y in ring.coords[:-1]])
        if rings:
            yield Outline(tuple(rings), shape.name, shape.color)


def _region(shape: Disk | Outline):  # type: ignore[no-untyped-def]  # shapely is imported where it is used
    """Shapely region of a disk or of an outline of straight segments; holes run against what they are cut from."""
    import shapely

    if isinstance(shape, Disk):
        count = max(ceil(pi * sqrt(shape.radius / (2 * FLATNESS))), 16)
        angle = 2 * pi * np.arange(count) / count
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        holes = [shape.inner_radius * unit + (shape.x, shape.y)] if shape.inner_radius else []
        region = shapely.Polygon(shape.radius * unit + (shape.x, shape.y), holes)
    else:
        rings: list[list[Point]] = []
        for command, points in shape.segments:
            if command == "M":
                rings.append([])
            rings[-1] += points
        # Even-odd: a ring in another is its hole.
        region = shapely.Polygon()
        for ring in sorted((shapely.Polygon(ring) for ring in rings), key=lambda ring: -ring.area):
            region = shapely.symmetric_difference(region, ring)
    return region


def _ring(points: Sequence[Point]) -> tuple[Segment, ...]:
    first, *others = points
    return ("M", (first,)), *(("L", (point,)) for point in others), ("Z", ())
