"""Holes through whatever is made of a marker, sheet or plate: one list for all files (docs/conventions.md)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, box, circle
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, filled_outline
from markergen.model.findings import in_one_line
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.units import format_length

OFF = 1e-6
"""Maximum distance in m of a polygon from the arcs it approximates, to compare holes and measure gaps."""

SHOWN = 4
"""Maximum number of holes in a sentence."""


@dataclass(frozen=True)
class Opening:
    """A hole through whatever is made.

    Attributes
    ----------
    contour : Contour
        Outline of the bore, clockwise as around a hole, m, marker frame.
    hole : Hole or None
        Mounting or dowel hole that it is; None for a hole of a drawing.
    """

    contour: Contour
    hole: Hole | None = None

    @property
    def region(self) -> Region:
        """Opening in the printed face, with the countersink."""
        return self.hole.rim.region if self.hole else _region(self.contour)

    def __str__(self) -> str:
        if self.hole:
            return str(self.hole)
        left, bottom, right, top = self.region.box
        place = (format_length(float(f"{middle:.3g}")) for middle in ((left + right) / 2, (bottom + top) / 2))
        return f"the drawn hole around {', '.join(place)}"


def openings(marker: Marker) -> tuple[Opening, ...]:
    """Return all holes: mounting and dowel holes in the order of marker.json, then those of the drawings."""
    drawn = drawn_holes(marker.boundary, marker.substrate.outline)
    holes = (Opening(circle(hole.diameter / 2, hole.x, hole.y, hole=True), hole) for hole in marker.substrate.holes)
    return (*holes, *map(Opening, drawn))


def drawn_holes(boundary: Boundary, outline: Boundary | None = None) -> tuple[Contour, ...]:
    """Return the holes of a boundary and of a plate's own outline as exact contours in m, clockwise.

    Those of a boundary that lie in a hole of the outline are left out, and vice versa, so that none counts twice.

    Raises
    ------
    InputError
        If holes of both overlap otherwise.
    """
    return _drawn_holes(boundary, outline)


# Cached, since every file of a marker needs them.
@lru_cache(maxsize=8)
def _drawn_holes(boundary: Boundary, outline: Boundary | None) -> tuple[Contour, ...]:
    outline_holes, boundary_holes = (
        [contour for contour in shape.contours() if area(contour) < 0] if shape else [] for shape in (outline, boundary)
    )
    if not (outline_holes and boundary_holes):
        return (*outline_holes, *boundary_holes)
    within: tuple[set[int], set[int]] = set(), set()
    for i, k in np.argwhere(_boxes_meet(outline_holes, boundary_holes)).tolist():
        ours, theirs = _region(outline_holes[i]), _region(boundary_holes[k])
        if not theirs - ours.offset(2 * OFF):
            within[1].add(k)
        elif not ours - theirs.offset(2 * OFF):
            within[0].add(i)
        elif ours.meets(theirs):
            x, y = map(format_length, filled_outline(boundary_holes[k]).center)
            raise InputError(
                "holes of the boundary inside or outside of those of --outline",
                f"one around {x}, {y} that overlaps one",
                "draw their union in one of the drawings",
            )
    return tuple(
        hole
        for holes, drop in zip((outline_holes, boundary_holes), within, strict=True)
        for k, hole in enumerate(holes)
        if k not in drop
    )


def _boxes_meet(ones: Sequence[Contour], others: Sequence[Contour]) -> NDArray[np.bool_]:
    """True (m, k) where the bounding boxes of two contours meet."""
    boxes, other_boxes = (np.array([box(contour) for contour in contours]) for contours in (ones, others))
    low, high = (
        boxes[:, None, :2] <= other_boxes[None, :, 2:] + OFF,
        other_boxes[None, :, :2] <= boxes[:, None, 2:] + OFF,
    )
    return np.asarray((low & high).all(axis=-1))


def holes_beyond(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes of the plate that reach beyond the boundary, where a sheet ends, if any do."""
    within = marker.boundary.region.filled()
    beyond = [str(opening) for opening in openings(marker) if not within.covers(opening.region)]
    return (f"Holes of the plate beyond the boundary are drawn, too: {in_one_line(beyond, SHOWN)}.",) if beyond else ()


def near_holes(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes that reach into dots' quiet zones, if there are any."""
    designed = marker.as_designed
    dots = [(p.id, p.x, p.y, p.feature.diameter) for p in designed.control_points if p.feature.diameter]
    if not dots:
        return ()
    _, *places, across = np.array(dots).T
    reaches = []
    for opening in openings(designed):
        is_near = opening.region.distance(np.stack(places, axis=-1)) < across - 1e-9
        ids = [str(dot[0]) for dot, close in zip(dots, is_near, strict=True) if close]
        if ids:
            reaches.append(f"{opening} into that of dot{'s' * (len(ids) > 1)} {' and '.join(_some(ids))}")
    if not reaches:
        return ()
    return (
        "holes reach into the quiet zones of dots, where a camera sees them as dark spots: "
        f"{in_one_line(reaches, SHOWN)}; move them, or use a larger --clearance, if detection suffers",
    )


def _some(ids: Sequence[str]) -> list[str]:
    return [*ids[:3], "others"] if len(ids) > 4 else list(ids)


def _region(contour: Contour) -> Region:
    return Region.of_contour(contour, (), OFF)
