"""What is dark on a marker, as plain shapes in mm: dots with their heights, and the tag's ink with corners to make."""

from collections import Counter
from dataclasses import dataclass, replace
from math import hypot, pi, sqrt, tan

import numpy as np

from markergen.drawing.figure import FLAT
from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.model.tag import Mask, Tag, cell_outlines, to_plane
from markergen.solid.bodies import Path, Point, mm
from markergen.units import format_length

QUARTER = tan(pi / 8)
"""Bulge of an arc that turns by a right angle."""

NECK = 1 / (2 * (sqrt(2) - 1))
"""Radius that two corners which meet get for each mm of wall between them: each arc is sqrt(2) - 1 radii off."""


@dataclass(frozen=True)
class Dot:
    """A dot in mm in the marker frame, at its height z; a ring if it has an inner radius."""

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
        """Whether it stands on a pillar."""
        return self.z > 0


def dots_of(marker: Marker) -> tuple[Dot, ...]:
    """Dots of a marker, those that rounding put off the plane in it.

    Raises
    ------
    InputError
        If a control point has no dot (diameter 0), or lies below the plane.
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
        Dot(
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
        Whether the outline turns to the left here: the ink's own corner, not one that it goes around.
    shared : bool
        Whether it meets the corner of other ink.
    """

    x: float
    y: float
    left: bool
    shared: bool


@dataclass(frozen=True)
class Inlay:
    """Cells of a tag that are joined by their sides: an outer outline, and those of holes in it, ink to the left."""

    outer: tuple[Corner, ...]
    holes: tuple[tuple[Corner, ...], ...] = ()

    def paths(self, corner: float, neck: float, grow: float = 0.0) -> tuple[Path, tuple[Path, ...]]:
        """Outer path and holes with rounded corners.

        Parameters
        ----------
        corner : float
            Radius of every corner, mm; 0 leaves them sharp.
        neck : float
            Width of the wall that is left where corners of ink meet, mm; they are rounded by more for it.
        grow : float
            Moves the outline outward, around the same centers: the wall of a pocket with that much of a gap, mm.
        """
        outer, *holes = (_rounded(ring, corner, neck, grow) for ring in (self.outer, *self.holes))
        return outer, tuple(holes)

    def hull(self) -> list[Point]:
        """Corners of the outer outline."""
        return [(corner.x, corner.y) for corner in self.outer]


def inlays_of(tag: Tag | None) -> tuple[Inlay, ...]:
    """Ink of a tag in pieces, from the one at the lower left on; cells that only meet at a corner are apart."""
    if tag is None:
        return ()
    rings = cell_outlines(tag.ink)
    visits = Counter(point for ring in rings for point in map(tuple, ring.tolist()))
    pieces: dict[int, list[tuple[Corner, ...]]] = {}
    labels = _labels(tag.ink)
    for ring in rings:
        # They are walked with the ink to the right; here it is to the left.
        walk = ring[::-1]
        plane = to_plane(walk, tag.cells, tag.cells, tag.side / tag.cells) + tag.center
        arriving, leaving = plane - np.roll(plane, 1, axis=0), np.roll(plane, -1, axis=0) - plane
        turns = arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0]
        corners = tuple(
            Corner(mm(x), mm(y), bool(turn > 0), visits[tuple(cell)] > 1)
            for (x, y), turn, cell in zip(plane.tolist(), turns, walk.tolist(), strict=True)
        )
        pieces.setdefault(_beside(ring, labels), []).append(corners)
    return tuple(sorted((_joined(piece) for piece in pieces.values()), key=lambda inlay: min(inlay.hull())[::-1]))


def cell_of(tag: Tag) -> float:
    """Side of a tag's cell in mm."""
    return tag.side * 1e3 / tag.cells


def _joined(rings: list[tuple[Corner, ...]]) -> Inlay:
    def extent(ring: tuple[Corner, ...]) -> float:
        return max(corner.x for corner in ring) - min(corner.x for corner in ring)

    outer = max(rings, key=extent)
    return Inlay(outer, tuple(ring for ring in rings if ring is not outer))


def _labels(ink: Mask) -> Mask:
    from scipy.ndimage import label

    return np.asarray(label(ink)[0])


def _beside(ring: np.ndarray, labels: Mask) -> int:
    """Label of the black cells to the right of an outline's first side; rows count downward."""
    (x, y), (u, v) = ring[0], ring[1]
    length = hypot(u - x, v - y)
    dx, dy = (u - x) / length, (v - y) / length
    # Half a cell on along the side, and half a cell to the right of it.
    column, row = x + dx / 2 - dy / 2, y + dy / 2 + dx / 2
    return int(labels[int(np.floor(row)), int(np.floor(column))])


def _rounded(ring: tuple[Corner, ...], corner: float, neck: float, grow: float) -> Path:
    """Path around a ring of right-angled corners, moved outward by `grow`."""
    points: list[Point] = []
    bulges: list[float] = []

    def add(x: float, y: float, bulge: float) -> None:
        if points and hypot(points[-1][0] - x, points[-1][1] - y) < 1e-6:
            bulges[-1] = bulge
            return
        points.append((x, y))
        bulges.append(bulge)

    moved = [_outward(ring[i - 1], each, ring[(i + 1) % len(ring)], grow) for i, each in enumerate(ring)]
    for i, each in enumerate(moved):
        # The wall between what has grown on both sides is to be as wide as the neck still.
        radius = max(corner, NECK * (neck + 2 * grow)) if each.shared else corner
        if radius:
            radius = max(0.0, radius + grow if each.left else radius - grow)
        before, after = moved[i - 1], moved[(i + 1) % len(moved)]
        (ux, uy), (vx, vy) = _way(before, each), _way(each, after)
        if not radius:
            add(each.x, each.y, 0.0)
            continue
        add(each.x - radius * ux, each.y - radius * uy, QUARTER if each.left else -QUARTER)
        add(each.x + radius * vx, each.y + radius * vy, 0.0)
    if hypot(points[-1][0] - points[0][0], points[-1][1] - points[0][1]) < 1e-6:
        del points[-1], bulges[-1]
    return Path(tuple(points), tuple(bulges))


def _outward(before: Corner, corner: Corner, after: Corner, grow: float) -> Corner:
    (ux, uy), (vx, vy) = _way(before, corner), _way(corner, after)
    return replace(corner, x=corner.x + grow * (uy + vy), y=corner.y - grow * (ux + vx))


def _way(start: Corner, end: Corner) -> Point:
    length = hypot(end.x - start.x, end.y - start.y)
    return (end.x - start.x) / length, (end.y - start.y) / length
