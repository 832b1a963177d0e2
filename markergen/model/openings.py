"""Holes through whatever is made of a marker, sheet or plate: one list for all files (docs/conventions.md)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, circle
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, filled_outline
from markergen.model.findings import listed
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
    made = (Opening(circle(hole.diameter / 2, hole.x, hole.y, hole=True), hole) for hole in marker.substrate.holes)
    return (*made, *map(Opening, drawn))


def drawn_holes(boundary: Boundary, outline: Boundary | None = None) -> tuple[Contour, ...]:
    """Return the holes of a boundary and of a plate's own outline as exact contours in m, clockwise.

    Those of a boundary that lie in a hole of the outline are left out, and vice versa, so that none counts twice.

    Raises
    ------
    InputError
        If holes of both overlap otherwise.
    """
    own, other = ([each for each in shape.contours() if area(each) < 0] if shape else [] for shape in
                  (outline, boundary))  # fmt: skip
    if not (own and other):
        return (*own, *other)
    kept = [each for each in own if not any(_within(each, wide) and area(each) > area(wide) for wide in other)]
    more = [each for each in other if not any(_within(each, wide) for wide in kept)]
    crossing = [filled_outline(each) for each in more if any(_region(each).meets(_region(hole)) for hole in kept)]
    if crossing:
        x, y = map(format_length, crossing[0].center)
        raise InputError(
            "holes of the boundary inside or outside of those of --outline",
            f"one around {x}, {y} that overlaps one",
            "draw their union in one of the drawings",
        )
    return (*kept, *more)


def holes_beyond(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes of the plate that reach beyond the boundary, where a sheet ends, if any do."""
    within = marker.boundary.region.filled()
    beyond = [str(opening) for opening in openings(marker) if not within.covers(opening.region)]
    return (f"Holes of the plate beyond the boundary are drawn, too: {listed(beyond, SHOWN)}.",) if beyond else ()


def near_holes(marker: Marker) -> tuple[str, ...]:
    """Return a sentence about all holes that reach into dots' quiet zones, if there are any."""
    designed = marker.as_designed
    dots = [(p.id, p.x, p.y, p.feature.diameter) for p in designed.control_points if p.feature.diameter]
    if not dots:
        return ()
    _, *places, across = np.array(dots).T
    found = []
    for opening in openings(designed):
        near = opening.region.distance(np.stack(places, axis=-1)) < across - 1e-9
        ids = [str(dot[0]) for dot, close in zip(dots, near, strict=True) if close]
        if ids:
            found.append(f"{opening} into that of dot{'s' * (len(ids) > 1)} {' and '.join(_some(ids))}")
    if not found:
        return ()
    return (
        "holes reach into the quiet zones of dots, where a camera sees them as dark spots: "
        f"{listed(found, SHOWN)}; move them, or use a larger --clearance, if detection suffers",
    )


def _some(ids: Sequence[str]) -> list[str]:
    return [*ids[:3], "others"] if len(ids) > 4 else list(ids)


def _within(inner: Contour, outer: Contour) -> bool:
    """True if a hole lies in another one, up to rounding of arcs."""
    return not (_region(inner) - _region(outer).offset(2 * OFF))


def _region(contour: Contour) -> Region:
    return Region.of_contour(contour, (), OFF)
