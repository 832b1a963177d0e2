"""The plate: its outlines and holes, the room on its upper face, and the parts made of it; mm, marker frame.

Its outline is the boundary's, with an edge around a disk or a rectangle, or a separate one; corners may be rounded.
Arcs are exact in the parts; distances on the face are measured from polygons within `OFF` of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from markergen.arrays import Array
from markergen.drawing.figure import size_words
from markergen.errors import InputError
from markergen.geometry.contour import (
    Contour,
    Point,
    area,
    circle,
    filleted,
    flattened,
    largest_fillet,
    offset,
    placed,
    turns_of,
)
from markergen.geometry.outlines import polygon
from markergen.geometry.region import Region, pairwise_distances
from markergen.model.boundary import Boundary, Circle
from markergen.model.marker import Marker
from markergen.model.openings import disk_radius, drawn_holes
from markergen.model.substrate import Hole, Substrate
from markergen.solid.primitives import OFF, Part, Primitive, Prism, Revolved, cylinder, mm, size_of
from markergen.units import format_length

Outline = tuple[Contour, ...]
"""Outer contour, counterclockwise, and its holes, clockwise."""

TANGENT = 5e-7
"""Maximum gap in mm between cones and planes of a chamfer at the end of an arc that is not quite tangent."""

SMOOTH = 0.35
"""Maximum angle in rad between sides that approximate a curve, so that there is no corner to round."""


@dataclass(frozen=True)
class Footprint:
    """Area on a plate taken by a feature or cut: a point or a polygon, and a margin around it; mm.

    Attributes
    ----------
    points : tuple of (x, y)
        One point, or the corners of a polygon.
    radius : float
        Margin.
    """

    name: str
    points: tuple[Point, ...]
    radius: float = 0.0


@dataclass(frozen=True)
class SolidPlate:
    """All plates of a marker: one per separate piece of the outline.

    Attributes
    ----------
    thickness, chamfer : float
        mm.
    holes : tuple of Hole
        Mounting and dowel holes, in m, as in the marker.
    """

    outlines: tuple[Outline, ...]
    thickness: float
    chamfer: float
    holes: tuple[Hole, ...] = ()

    @cached_property
    def pieces(self) -> tuple[Region, ...]:
        """Each plate in plan view, without mounting holes."""
        return tuple(Region.of_contour(outer, holes, OFF) for outer, *holes in self.outlines)

    @cached_property
    def outline(self) -> Region:
        """All plates in plan view, without mounting holes."""
        return Region.union(self.pieces)

    @cached_property
    def face(self) -> Region:
        """Upper face inside the chamfer, without mounting holes."""
        if not self.chamfer:
            return self.outline
        return Region.union(
            Region.of_contour(offset(outer, self.chamfer), holes, OFF) for outer, *holes in self.outlines
        )

    @cached_property
    def hole_footprints(self) -> tuple[Footprint, ...]:
        """Mounting and dowel holes with their countersinks."""
        return tuple(
            Footprint(str(hole).removeprefix("the "), ((hole.x * 1e3, hole.y * 1e3),), hole.radius * 1e3)
            for hole in self.holes
        )

    @property
    def size(self) -> str:
        """``304 mm across`` for a disk, else width and height: ``200 x 100 mm``."""
        if len(self.outlines) == 1 and (whole := self.outlines[0][0].as_circle):
            return f"{2 * whole[2]:.6g} mm across"
        width, height = size_of([Prism(outer, (), 0.0, 0.0) for outer, *_ in self.outlines])
        return f"{width:.6g} x {height:.6g} mm"

    def room(self, footprints: Sequence[Footprint]) -> Array:
        """Return the distances (m,) from footprints to the edge of the face; negative where they extend past it."""
        if not footprints:
            return np.zeros(0)
        return self.face.clearance([footprint.points for footprint in footprints]) - [
            footprint.radius for footprint in footprints
        ]

    def bores(self, face: float = 0.0) -> list[Revolved]:
        """Return mounting and dowel holes as bodies to cut, from a face at that height down through the plate."""
        bottom = self.bottom(face)
        return [_bore(hole, bottom, face) for hole in self.holes]

    def bottom(self, face: float = 0.0) -> float:
        """Return the height of the back of a plate whose face is at a height."""
        return mm((face - self.thickness) / 1e3)

    def parts(
        self,
        face: float = 0.0,
        cut: Sequence[Primitive] = (),
        marked: Sequence[Primitive] = (),
        add: Sequence[Primitive] = (),
    ) -> list[Part]:
        """Make the plates, each with its own bores and the bodies that are cut from, marked on or joined to it.

        Parameters
        ----------
        face : float
            Height of the upper face.
        cut, marked, add : sequence of Primitive
            As in `Part`.
        """
        bottom = self.bottom(face)
        names = ["plate"] if len(self.outlines) == 1 else [f"plate-{k}" for k in range(1, len(self.outlines) + 1)]
        bodies = [Prism(outer, tuple(holes), bottom, face, self.chamfer) for outer, *holes in self.outlines]
        cuts, marks, joined = (self._shared_out(group) for group in ((*self.bores(face), *cut), marked, add))
        return [
            Part(name, "light", (body, *joined[k]), cuts[k], marks[k])
            for k, (name, body) in enumerate(zip(names, bodies, strict=True))
        ]

    def _shared_out(self, bodies: Sequence[Primitive]) -> list[tuple[Primitive, ...]]:
        """Assign bodies to the plates that they belong to."""
        if len(self.pieces) == 1 or not bodies:
            return [tuple(bodies)] * len(self.pieces)
        points = [(body.x, body.y) if isinstance(body, Revolved) else body.outer.points[0] for body in bodies]
        # By distance rather than containment: a recess may be as large as its plate.
        nearest = np.argmin([piece.distance(points) for piece in self.pieces], axis=0)
        return [
            tuple(body for body, nearest_piece in zip(bodies, nearest, strict=True) if nearest_piece == k)
            for k in range(len(self.pieces))
        ]


def plate_of(marker: Marker) -> SolidPlate:
    """Plate of a marker, with rounded corners.

    For a disk it is a disk that contains the boundary with its edge and every dot's quiet zone, a white ring half a dot
    diameter wide. Around a rectangle the edge has mitered corners. Any other boundary is the plate's outline itself.
    If the substrate has an outline of its own, the plate has its holes and those of the boundary.

    Raises
    ------
    InputError
        If the corner radius or the chamfer does not fit the outline.
    """
    disk = 0.0
    if marker.substrate.outline is None and isinstance(marker.boundary, Circle):
        dots = [(p.x, p.y, p.feature.diameter / 2) for p in marker.control_points]
        disk = mm(disk_radius(marker.substrate, marker.boundary, dots))
    return _plate(marker.substrate, marker.boundary, disk)


def plate_size(marker: Marker) -> str:
    """Size of the plate in words: as its outline was given, or as in `SolidPlate.size`."""
    outline = marker.substrate.outline
    return plate_of(marker).size if outline is None else size_words(outline)


def gaps(footprints: Sequence[Footprint], others: Sequence[Footprint]) -> Array:
    """Gaps (m, k) in mm between footprints, negative where their margins overlap; inf between one and itself."""
    if not (footprints and others):
        return np.full((len(footprints), len(others)), np.inf)
    distances = pairwise_distances([a.points for a in footprints], [b.points for b in others])
    distances -= np.array([a.radius for a in footprints])[:, None] + [b.radius for b in others]
    distances[np.array([[a is b for b in others] for a in footprints])] = np.inf
    return distances


def grouped(contours: Sequence[Contour]) -> list[Outline]:
    """Group each outer contour with its holes; an island in a hole is a piece with holes of its own."""
    shapes = [Region.of_contour(contour, (), OFF) for contour in contours]
    pieces: dict[int, list[Contour]] = {k: [contour] for k, contour in enumerate(contours) if area(contour) > 0}
    for contour, shape in zip(contours, shapes, strict=True):
        if area(contour) < 0:
            inside = [shape.inner_point()]
            around = [k for k in pieces if shapes[k].area > shape.area and shapes[k].contains(inside)[0]]
            pieces[min(around, key=lambda k: shapes[k].area)].append(contour)
    return [tuple(piece) for piece in pieces.values()]


# Cached, since every step of making and describing a marker needs its plate.
@lru_cache(maxsize=8)
def _plate(substrate: Substrate, boundary: Boundary, disk: float) -> SolidPlate:
    """Make the plate of a substrate, a disk of that radius around the boundary's center unless it is 0."""
    chamfer = mm(substrate.chamfer)
    if disk:
        x, y = boundary.center
        outlines: list[Outline] = [(circle(disk, mm(x), mm(y)),)]
    else:
        drawn = (substrate.outline or boundary).contours()
        if substrate.outline is not None:
            drawn = (*(contour for contour in drawn if area(contour) > 0), *drawn_holes(boundary, substrate.outline))
        contours = [placed(contour, 1e3, digits=9) for contour in drawn]
        if edge := mm(substrate.edge_around(boundary)):
            contours = [placed(offset(contour, -edge), 1.0, digits=9) for contour in contours]
        corner = mm(substrate.corner_radius)
        outlines = [tuple(_rounded(contour, corner) for contour in piece) for piece in _separate(contours)]
    for outer, *holes in outlines:
        _check_chamfer(outer, holes, chamfer)
    return SolidPlate(tuple(outlines), mm(substrate.thickness), chamfer, substrate.holes)


def _bore(hole: Hole, bottom: float, top: float) -> Revolved:
    x, y, radius, sink = mm(hole.x), mm(hole.y), mm(hole.diameter) / 2, mm(hole.sink) / 2
    if sink <= radius:
        return cylinder(x, y, radius, bottom, top)
    # With a countersink of 90 degrees the depth equals the difference of the radii.
    low = top - (sink - radius)
    return Revolved(x, y, Contour(((0.0, bottom), (radius, bottom), (radius, low), (sink, top), (0.0, top))))


def _separate(contours: Sequence[Contour]) -> list[Outline]:
    """Separate pieces enclosed by contours."""
    if any(contour.has_arcs for contour in contours):
        return grouped(contours)
    pieces = Region.enclosed([contour.points for contour in contours]).oriented().pieces
    return [tuple(polygon(np.round(ring, 9)) for ring in piece.rings) for piece in pieces]


def _rounded(contour: Contour, radius: float) -> Contour:
    """Round the corners of a contour, including concave ones, which a mill leaves round."""
    if not radius:
        return contour
    rounded = filleted(contour, radius, SMOOTH)
    if rounded is None:
        room = largest_fillet(contour, SMOOTH, radius)
        raise InputError(
            f"a corner radius of at most {room:.4g} mm for this outline",
            f"corner_radius={format_length(radius / 1e3)}",
            f"use --corner-radius {np.floor(room * 100 + 1e-6) / 100:g}mm, or another outline",
        )
    return rounded


def _check_chamfer(outer: Contour, holes: Sequence[Contour], chamfer: float) -> None:
    """Refuse a chamfer that consumes a side of the outline, or cuts into a hole of it."""
    if not chamfer:
        return
    sides = outer.sides
    sharp = [abs(angle) for k, angle in enumerate(turns_of(outer)) if sides[k - 1][2] or sides[k][2]]
    if max(sharp, default=0.0) * chamfer > TANGENT:
        raise InputError(
            "arcs tangent to their neighbors at both ends, for a chamfer",
            f"an outline that turns by {np.degrees(max(sharp)):.3g} degrees where an arc ends",
            "use a --corner-radius, or leave out --chamfer",
        )
    rings = (np.array(contour.points) for contour in (outer, offset(outer, chamfer)))
    steps, moved = (np.roll(ring, -1, axis=0) - ring for ring in rings)
    before = np.hypot(*steps.T)
    # Shortening of each side; a reversed side has negative length.
    lost = before - np.sum(steps * moved, axis=-1) / before
    room = float(np.min(chamfer * before[lost > 0] / lost[lost > 0], initial=np.inf))
    if chamfer >= room:
        raise InputError(
            f"a chamfer below {room:.4g} mm for this outline",
            f"chamfer={format_length(chamfer / 1e3)}",
            f"use --chamfer {np.floor(room * 99) / 100:g}mm, or a corner radius above the chamfer",
        )
    inside = [flattened(hole, OFF) for hole in holes]
    if holes and min(Region.of_contour(offset(outer, chamfer), (), OFF).clearance(inside)) < 2 * OFF:
        land = float(min(Region.of_contour(outer, (), OFF).clearance(inside)))
        # At a corner that turns right, the chamfer reaches farther in than its width.
        most = np.floor(land * np.cos(min(0.0, *turns_of(outer)) / 2) * 99) / 100
        raise InputError(
            "a chamfer that ends before the holes in the outline",
            f"chamfer={format_length(chamfer / 1e3)}, and a hole {land:.4g} mm from the edge",
            f"{f'use --chamfer {most:g}mm' if most else 'leave out --chamfer'}, or move the hole inward",
        )
