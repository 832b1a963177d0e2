"""Holes through whatever is made of a marker, sheet or plate: one list for all files (docs/conventions.md)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markergen.geometry.contour import Contour, area, backward, placed
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary
from markergen.model.findings import listed
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.units import format_length

OFF = 1e-6
"""Maximum distance in m of a polygon from the arcs it approximates, to compare holes and measure gaps."""


@dataclass(frozen=True)
class Opening:
    """A hole through whatever is made.

    Attributes
    ----------
    contour : Contour
        Outline of the bore, counterclockwise, m, marker frame.
    hole : Hole or None
        Mounting or dowel hole that it is; None for a hole of a drawing.
    """

    contour: Contour
    hole: Hole | None = None

    @property
    def region(self) -> Region:
        """Opening in the printed face, with the countersink."""
        return self.hole.rim.region if self.hole else Region.of_contour(self.contour, (), OFF)

    def __str__(self) -> str:
        if self.hole:
            return str(self.hole)
        left, bottom, right, top = self.region.box
        place = (format_length(float(f"{middle:.3g}")) for middle in ((left + right) / 2, (bottom + top) / 2))
        return f"the drawn hole around {', '.join(place)}"


def openings(marker: Marker) -> tuple[Opening, ...]:
    """Return all holes: mounting and dowel holes in the order of marker.json, then those of the drawings."""
    drawn = drawn_holes(marker.boundary, marker.substrate.outline)
    made = (Opening(placed(hole.bore.contours()[0], 1.0, digits=12), hole) for hole in marker.substrate.holes)
    return (*made, *(Opening(backward(contour)) for contour in drawn))


def drawn_holes(boundary: Boundary, outline: Boundary | None = None) -> tuple[Contour, ...]:
    """Return the holes of a boundary and of a plate's own outline as exact contours in m, clockwise.

    Those of a boundary that lie in a hole of the outline are left out, and vice versa, so that none counts twice.
    """
    own, other = ([each for each in shape.contours() if area(each) < 0] if shape else [] for shape in
                  (outline, boundary))  # fmt: skip
    kept = [each for each in own if not any(_within(each, wide) and area(each) > area(wide) for wide in other)]
    return (*kept, *(each for each in other if not any(_within(each, wide) for wide in kept)))


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
        "Holes reach into the quiet zones of dots, where a camera sees them as dark spots: "
        f"{listed(found, 4)}; where the pose must be exact, move them, or use a larger clearance.",
    )


def _some(ids: Sequence[str]) -> list[str]:
    return [*ids[:3], "others"] if len(ids) > 4 else list(ids)


def _within(inner: Contour, outer: Contour) -> bool:
    """True if a hole lies in another one, up to rounding of arcs."""
    small, large = (Region.of_contour(backward(each), (), OFF) for each in (inner, outer))
    return not (small - large.offset(2 * OFF))
