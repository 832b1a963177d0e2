"""Geometry of the dark parts of a marker, in mm: dots with their heights, and the tag's ink with rounded corners."""

from collections import Counter
from dataclasses import dataclass, replace
from math import hypot, pi, sqrt, tan

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.figure import FLAT
from markergen.errors import InputError
from markergen.geometry.contour import Contour, Point
from markergen.model.marker import Marker
from markergen.model.tag import Tag, cell_outlines, to_plane
from markergen.solid.primitives import mm
from markergen.units import format_length

QUARTER = tan(pi / 8)
"""Bulge of an arc of 90 degrees."""

NECK = 1 / (2 * (sqrt(2) - 1))
"""Corner radius per mm of wall between two adjoining corners: each arc passes its corner at sqrt(2) - 1 radii."""


@dataclass(frozen=True)
class SolidDot:
    """A dot to be made, in mm in the marker frame, at height z; a ring if it has an inner radius."""

    id: int
    x: float
    y: float
    z: float
    radius: float
    inner: float = 0.0

    @property
    def name(self) -> str:
        """``dot-<id>``."""
        return f"dot-{self.id}"

    @property
    def raised(self) -> bool:
        """True if it stands on a pillar."""
        return self.z > 0


def dots_of(marker: Marker) -> tuple[SolidDot, ...]:
    """Dots of a marker; heights within rounding become 0.

    Raises
    ------
    InputError
        If a control point has no dot (diameter 0) or lies below the plane.
    """
    for point in marker.control_points:
        if point.feature.diameter == 0:
            raise InputError(
                "a dot on every control point to make",
                f"control point {point.id} without a dot (diameter 0)",
                "design the marker again with --dot above 0",
            )
        if point.z < -FLAT:
            raise InputError(
                "control points in the plate's face or above it",
                f"control point {point.id} at z = {format_length(point.z)}",
                "move the marker up, so that its lowest control point is at z = 0",
            )
    return tuple(
        SolidDot(
            point.id,
            mm(point.x),
            mm(point.y),
            mm(point.z) if point.z > FLAT else 0.0,
            mm(point.feature.diameter) / 2,
            mm(point.feature.inner_diameter) / 2,
        )
        for point in marker.control_points
    )


@dataclass(frozen=True)
class Corner:
    """A corner of the tag's ink.

    Attributes
    ----------
    x, y : float
        mm.
    left : bool
        True if the outline turns left here, so that the corner is convex.
    shared : bool
        True if it touches a corner of other ink.
    """

    x: float
    y: float
    left: bool
    shared: bool


@dataclass(frozen=True)
class TagInk:
    """Black cells of a tag connected by their sides: an outer ring and its holes, with the ink on the left."""

    outer: tuple[Corner, ...]
    holes: tuple[tuple[Corner, ...], ...] = ()

    def contours(self, corner: float, neck: float, grow: float = 0.0) -> tuple[Contour, tuple[Contour, ...]]:
        """Return the outer contour and holes with rounded corners.

        Parameters
        ----------
        corner : float
            Radius of every corner, mm; 0 leaves them sharp.
        neck : float
            Width of the wall that remains where corners of ink meet, mm; they get a larger radius for it.
        grow : float
            Outward offset of the outline about the same arc centers, mm, for the wall of a pocket with that gap.
        """
        outer, *holes = (_rounded(ring, corner, neck, grow) for ring in (self.outer, *self.holes))
        return outer, tuple(holes)

    def corners(self) -> list[Point]:
        """Corners of the outer ring."""
        return [(corner.x, corner.y) for corner in self.outer]


def tag_pieces(tag: Tag | None) -> tuple[TagInk, ...]:
    """Pieces of a tag's ink, the lower left one first; cells that touch only at a corner are separate."""
    import cv2

    if tag is None:
        return ()
    rings = cell_outlines(tag.ink)
    visits = Counter(point for ring in rings for point in map(tuple, ring.tolist()))
    pieces: dict[int, list[tuple[Corner, ...]]] = {}
    # scipy.ndimage takes longer to import than a small solid to build.
    labels = cv2.connectedComponents(tag.ink.astype(np.uint8), connectivity=4)[1]
    for ring in rings:
        # Cell outlines have the ink on their right.
        walk = ring[::-1]
        plane = to_plane(walk, tag.cells, tag.cells, tag.side / tag.cells) + tag.center
        arriving, leaving = plane - np.roll(plane, 1, axis=0), np.roll(plane, -1, axis=0) - plane
        crosses = arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0]
        corners = tuple(
            Corner(mm(x), mm(y), bool(cross > 0), visits[tuple(cell)] > 1)
            for (x, y), cross, cell in zip(plane.tolist(), crosses, walk.tolist(), strict=True)
        )
        pieces.setdefault(_beside(ring, labels), []).append(corners)
    return tuple(sorted(map(_piece, pieces.values()), key=lambda ink: min(ink.corners())[::-1]))


def cell_of(tag: Tag) -> float:
    """Side of a tag's cell in mm."""
    return tag.side * 1e3 / tag.cells


def _piece(rings: list[tuple[Corner, ...]]) -> TagInk:
    outer = max(rings, key=lambda ring: max(corner.x for corner in ring) - min(corner.x for corner in ring))
    return TagInk(outer, tuple(ring for ring in rings if ring is not outer))


def _beside(ring: Array, labels: NDArray[np.int32]) -> int:
    """Label of the black cells to the right of an outline's first side; rows count downward."""
    (x, y), (u, v) = ring[0], ring[1]
    length = hypot(u - x, v - y)
    dx, dy = (u - x) / length, (v - y) / length
    # Half a cell along the side, and half a cell to its right.
    column, row = x + dx / 2 - dy / 2, y + dy / 2 + dx / 2
    return int(labels[int(np.floor(row)), int(np.floor(column))])


def _rounded(ring: tuple[Corner, ...], corner: float, neck: float, grow: float) -> Contour:
    """Offset a ring of right-angled corners outward by `grow` and round it."""
    points: list[Point] = []
    bulges: list[float] = []

    def add(x: float, y: float, bulge: float) -> None:
        if points and hypot(points[-1][0] - x, points[-1][1] - y) < 1e-6:
            bulges[-1] = bulge
            return
        points.append((x, y))
        bulges.append(bulge)

    moved = [_outward(ring[i - 1], vertex, ring[(i + 1) % len(ring)], grow) for i, vertex in enumerate(ring)]
    for i, vertex in enumerate(moved):
        # The wall must be as wide as the neck even with both sides offset.
        radius = max(corner, NECK * (neck + 2 * grow)) if vertex.shared else corner
        if radius:
            radius = max(0.0, radius + grow if vertex.left else radius - grow)
        before, after = moved[i - 1], moved[(i + 1) % len(moved)]
        (ux, uy), (vx, vy) = _way(before, vertex), _way(vertex, after)
        if not radius:
            add(vertex.x, vertex.y, 0.0)
            continue
        add(vertex.x - radius * ux, vertex.y - radius * uy, QUARTER if vertex.left else -QUARTER)
        add(vertex.x + radius * vx, vertex.y + radius * vy, 0.0)
    if hypot(points[-1][0] - points[0][0], points[-1][1] - points[0][1]) < 1e-6:
        del points[-1], bulges[-1]
    return Contour(tuple(points), tuple(bulges))


def _outward(before: Corner, corner: Corner, after: Corner, grow: float) -> Corner:
    (ux, uy), (vx, vy) = _way(before, corner), _way(corner, after)
    return replace(corner, x=corner.x + grow * (uy + vy), y=corner.y - grow * (ux + vx))


def _way(start: Corner, end: Corner) -> Point:
    length = hypot(end.x - start.x, end.y - start.y)
    return (end.x - start.x) / length, (end.y - start.y) / length
