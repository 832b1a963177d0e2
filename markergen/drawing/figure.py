"""The figure: a marker as it is drawn, in mm and its own frame, pre-compensated for a printer if asked."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.numbers import quiet_radius
from markergen.drawing.scene import Box, Disk, Outline, Point, marker_dots, marker_tag
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Figure:
    """What is drawn of one marker.

    Attributes
    ----------
    marker : Marker
    factor : (x, y)
        Lengths drawn over lengths meant: (1, 1), or the inverse of what a printer makes of 1.
    ink : str
        Color of dots and tag.
    """

    marker: Marker
    factor: Point = (1.0, 1.0)
    ink: str = "#000000"

    @cached_property
    def dots(self) -> tuple[Disk, ...]:
        """Dots; a circle stays one, its radius scaled by the geometric mean of both factors."""
        fx, fy = self.factor
        mean = (fx * fy) ** 0.5
        return tuple(
            Disk(d.x * fx, d.y * fy, d.radius * mean, d.inner_radius * mean, d.name, self.ink)
            for d in marker_dots(self.marker)
        )

    @cached_property
    def tag(self) -> tuple[Outline, ...]:
        """Ink of the tag, if there is one."""
        fx, fy = self.factor
        outlines = []
        for outline in marker_tag(self.marker):
            segments = ((command, tuple((x * fx, y * fy) for x, y in points)) for command, points in outline.segments)
            outlines.append(replace(outline, segments=tuple(segments), color=self.ink))
        return tuple(outlines)

    @cached_property
    def tag_zone(self) -> Box | None:
        """The tag with its quiet zone."""
        if self.marker.tag is None:
            return None
        return drawn_box(self.marker.tag.quiet_zone, self.factor)

    @cached_property
    def outline(self) -> Box:
        """Box around the boundary."""
        return drawn_box(self.marker.boundary, self.factor)

    @cached_property
    def quiet(self) -> Box:
        """Box around all quiet zones of dots."""
        return quiet_box(self.dots)


def drawn_box(boundary: Boundary, factor: Point = (1.0, 1.0)) -> Box:
    """Left, lower, right and upper end of the outline in mm, marker frame."""
    points = np.concatenate(boundary.outlines()) * 1e3 * factor
    (left, bottom), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return left, bottom, right, top


def quiet_box(dots: tuple[Disk, ...]) -> Box:
    """Box around the dots' quiet zones; a point at the origin without dots."""
    return (
        min((dot.x - quiet_radius(dot) for dot in dots), default=0.0),
        min((dot.y - quiet_radius(dot) for dot in dots), default=0.0),
        max((dot.x + quiet_radius(dot) for dot in dots), default=0.0),
        max((dot.y + quiet_radius(dot) for dot in dots), default=0.0),
    )


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
    """What two boxes that overlap have in common."""
    return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


def size_words(boundary: Boundary) -> str:
    """``300 mm across`` for a disk, else width and height as in ``200 x 100 mm``."""
    width, height = size_mm(boundary)
    return f"{width:.6g} mm across" if is_disk(boundary) else f"{width:.6g} x {height:.6g} mm"


def size_mm(boundary: Boundary) -> Point:
    """Width and height of the outline, mm; of a disk twice its diameter to the last digit."""
    if is_disk(boundary):
        return 2e3 * boundary.radius, 2e3 * boundary.radius
    left, bottom, right, top = drawn_box(boundary)
    return right - left, top - bottom


def is_disk(boundary: Boundary) -> bool:
    """Whether the outline is as wide and as high as the circle around it."""
    left, bottom, right, top = drawn_box(boundary)
    across = 2e3 * boundary.radius
    return max(abs(right - left - across), abs(top - bottom - across)) < 1e-6 * across
