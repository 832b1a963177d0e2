"""Figure: a marker as it is drawn, in mm and in its own frame, optionally pre-compensated for a printer."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from markergen.drawing.paper import MARKER_FILE
from markergen.drawing.scene import Box, Disk, FilledPath, Point, Shape, filled, mapped_path, union
from markergen.errors import InputError
from markergen.geometry.contour import box as contour_box
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker
from markergen.model.openings import openings

FLAT = 1e-9
"""Maximum height in m of a control point that counts as flat: rounding error, far below any printer's accuracy."""


@dataclass(frozen=True)
class Figure:
    """Marker as it is drawn.

    Attributes
    ----------
    factor : (x, y)
        Ratio of drawn to nominal lengths: (1, 1), or the inverse of the printer's scale.
    ink : str
        Color of dots and tag.
    beside : tuple of Shape
        Labels around the outline, mm, marker frame.
    record : str
        File name of the marker, for commands.
    """

    marker: Marker
    factor: Point = (1.0, 1.0)
    ink: str = "#000000"
    beside: tuple[Shape, ...] = ()
    record: str = MARKER_FILE

    @cached_property
    def dots(self) -> tuple[Disk, ...]:
        """Dots; circles remain circles, with radii scaled by the geometric mean of both factors."""
        fx, fy = self.factor
        mean = (fx * fy) ** 0.5
        return tuple(
            Disk(d.x * fx, d.y * fy, d.radius * mean, d.inner_radius * mean, d.name, self.ink)
            for d in marker_dots(self.marker)
        )

    @cached_property
    def tag(self) -> tuple[FilledPath, ...]:
        """Ink of the tag, if there is one."""
        fx, fy = self.factor
        outlines = (replace(outline, color=self.ink) for outline in marker_tag(self.marker))
        return tuple(mapped_path(outline, lambda x, y: (x * fx, y * fy)) for outline in outlines)

    @cached_property
    def tag_zone(self) -> Box | None:
        """Box of the tag with its quiet zone."""
        if self.marker.tag is None:
            return None
        return drawn_box(self.marker.tag.quiet_zone, self.factor)

    @cached_property
    def outline(self) -> Box:
        """Bounding box of the boundary and of holes beyond it."""
        return union(drawn_box(self.marker.boundary, self.factor), *self.hole_boxes)

    @cached_property
    def hole_boxes(self) -> tuple[Box, ...]:
        """Bounding boxes of all holes."""
        (fx, fy), boxes = self.factor, (contour_box(opening.contour) for opening in openings(self.marker))
        return tuple((1e3 * fx * a, 1e3 * fy * b, 1e3 * fx * c, 1e3 * fy * d) for a, b, c, d in boxes)

    @cached_property
    def quiet(self) -> Box:
        """Bounding box of the dots' quiet zones; the origin if there are no dots."""
        circles = [(dot.x, dot.y, quiet_radius(dot)) for dot in self.dots] or [(0.0, 0.0, 0.0)]
        return union(*((x - r, y - r, x + r, y + r) for x, y, r in circles))


def marker_dots(marker: Marker) -> tuple[Disk, ...]:
    """Dots of the marker as disks named ``dot-<id>``, in mm, marker frame.

    Raises
    ------
    InputError
        If a control point has no dot (diameter 0) or lies off the plane: neither can be printed.
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


def marker_tag(marker: Marker) -> tuple[FilledPath, ...]:
    """Ink of the marker's tag as one outline named ``tag``, in mm, marker frame; none without a tag.

    Neighboring black cells form one region, so that no seam shows; holes run opposite to the outlines around them.
    """
    if marker.tag is None:
        return ()
    return (filled([[(_mm(x), _mm(y)) for x, y in outline.tolist()] for outline in marker.tag.outlines], "tag"),)


def quiet_radius(disk: Disk) -> float:
    """Radius in mm of a dot's quiet zone: the dot, and a ring around it half its diameter wide."""
    return 2 * disk.radius


def drawn_box(boundary: Boundary, factor: Point = (1.0, 1.0)) -> Box:
    """Left, lower, right and upper end of the outline in mm, marker frame."""
    points = np.concatenate(boundary.outlines()) * 1e3 * factor
    (left, bottom), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return left, bottom, right, top


LOOSEST = 0.61
"""Share of a disk up to which dots with their clearance have room in it: five had at 0.61, six not at 0.65."""


def has_room(figure: Figure, radius: float) -> bool:
    """True where a disk of this radius in mm has room for the dots, also those that `design` makes smaller there.

    False if holes, keep-outs or a tag need some.
    """
    marker, spec = figure.marker, figure.marker.provenance.get("spec") or {}
    covered = sum((dot.radius + 1e3 * marker.clearance) ** 2 for dot in figure.dots)
    is_sized = "dot" in spec and spec["dot"] in (None, "auto")
    return (is_sized or covered <= LOOSEST * radius**2) and not (
        marker.tag or figure.hole_boxes or spec.get("keep_outs")
    )


def dot_sizes(marker: Marker) -> str:
    """Diameters of a marker's dots in words, the largest first."""
    sizes = sorted({point.feature.diameter for point in marker.control_points}, reverse=True)
    return f"{' + '.join(dict.fromkeys(f'{size * 1e3:.6g}' for size in sizes))} mm"


def size_words(boundary: Boundary) -> str:
    """Size in words: ``300 mm across`` for a disk, otherwise width and height, such as ``200 x 100 mm``."""
    width, height = size_mm(boundary)
    return f"{width:.6g} mm across" if is_disk(boundary) else f"{width:.6g} x {height:.6g} mm"


def size_mm(boundary: Boundary) -> Point:
    """Width and height of the outline, mm; for a disk exactly its diameter twice."""
    if is_disk(boundary):
        return 2e3 * boundary.radius, 2e3 * boundary.radius
    left, bottom, right, top = drawn_box(boundary)
    return right - left, top - bottom


def is_disk(boundary: Boundary) -> bool:
    """True if the outline is as wide and as high as its circumscribed circle about the origin."""
    left, bottom, right, top = drawn_box(boundary)
    across = 2e3 * boundary.radius
    return max(abs(right - left - across), abs(top - bottom - across)) < 1e-6 * across


def compensated_note(figure: Figure) -> tuple[str, ...]:
    """Sentence about a drawing that is true to size from one printer only."""
    if figure.factor == (1.0, 1.0):
        return ()
    factors = " and ".join(f"{value:.6g} along {name}" for name, value in zip("xy", figure.factor, strict=True))
    return (
        f"Everything is drawn scaled by {factors}, for the printer that was measured: from it the marker comes out as "
        "designed, so use it with the marker.json that was not rescaled.",
    )


def _mm(meters: float) -> float:
    # Rounded to a picometer, so that 0.0036 m reads 3.6 mm and not 3.5999999999999996.
    return round(meters * 1e3, 9)
