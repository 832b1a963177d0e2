"""The marker as parts to machine or print: a plate, and one inlay per dot that fills its pocket flush."""

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.figure import size_words
from markergen.drawing.scene import Disk, marker_dots
from markergen.errors import MissingLibraryError
from markergen.model.interior import regions_of
from markergen.model.marker import Marker

Array = NDArray[np.float64]

POCKET = 0.6
"""Depth of the pockets in mm: three layers of 0.2 mm of a printer, one pass of a small mill."""

EDGE = 2.0
"""Least width in mm of the plate's edge around the boundary."""

PLATE_COLOR, DOT_COLOR = (1.0, 1.0, 1.0), (0.05, 0.05, 0.05)
"""Red, green, blue from 0 to 1, sRGB."""


@dataclass(frozen=True)
class NamedSolid:
    """One part.

    Attributes
    ----------
    name : str
        ``plate``, or ``plate-1`` and so on where the boundary has several regions, or ``dot-<id>``.
    color : (red, green, blue)
    shape : cadquery.Solid
        In mm, marker frame: the printed face is z = 0, the plate is below.
    """

    name: str
    color: tuple[float, float, float]
    shape: Any


def marker_solids(marker: Marker) -> list[NamedSolid]:
    """Make the plate and the inlays of a marker, which touch but do not overlap.

    The plate of a disk is a disk of `marker.thickness` that holds the boundary and every dot's quiet zone (a white ring
    half a dot diameter wide). Any other boundary is the plate's outline, holes and all; each of its regions is a plate.
    Pockets are `POCKET` deep, or half the plate if that is less.

    Raises
    ------
    InputError
        If a control point has no dot or lies off the plane.
    MissingLibraryError
        If cadquery or a system library it needs is missing.
    """
    dots = marker_dots(marker)
    thickness = round(marker.thickness * 1e3, 9)
    depth = min(POCKET, thickness / 2)
    cadquery = import_cadquery()
    inlays = [_inlay(cadquery, dot, depth) for dot in dots]
    plates = [plate.cut(*inlays).Solids()[0] for plate in _plates(cadquery, marker, thickness)]
    names = ["plate"] if len(plates) == 1 else [f"plate-{number}" for number in range(1, len(plates) + 1)]
    return [
        *(NamedSolid(name, PLATE_COLOR, plate) for name, plate in zip(names, plates, strict=True)),
        *(NamedSolid(dot.name, DOT_COLOR, inlay) for dot, inlay in zip(dots, inlays, strict=True)),
    ]


def plate_size(marker: Marker) -> str:
    """Size of the plate: ``304 mm across`` for a disk, else width and height as in ``200 x 100 mm``."""
    if marker.boundary.curves()[0]:
        return size_words(marker.boundary)
    return f"{2 * plate_radius_mm(marker):.6g} mm across"


def plate_radius_mm(marker: Marker) -> float:
    """Radius of a disk's plate in mm: the boundary and an edge, or what the quiet zones need if that is more."""
    reach = max((dot.x**2 + dot.y**2) ** 0.5 + 2 * dot.radius for dot in marker_dots(marker))
    return max(marker.boundary.radius * 1e3 + EDGE, reach)


def import_cadquery() -> ModuleType:
    """Import cadquery, or say in one line what is missing and how to install it (MissingLibraryError)."""
    try:
        import cadquery
    except ImportError as error:
        found = " ".join(str(error).split())
        raise MissingLibraryError(
            f"solids need the library cadquery with the system's libGL and libX11, found: {found}; "
            "install them with: pip install cadquery && apt-get install libgl1 libx11-6"
        ) from None
    return cadquery


def _plates(cadquery: ModuleType, marker: Marker, thickness: float) -> list[Any]:
    rings, _ = marker.boundary.curves()
    if not rings:
        return [_cylinder(cadquery, 0.0, 0.0, plate_radius_mm(marker), thickness)]

    def wire(ring: Array) -> Any:
        # Rounded to a picometer as the dots are.
        corners = [cadquery.Vector(x, y, -thickness) for x, y in np.round(ring * 1e3, 9).tolist()]
        return cadquery.Wire.makePolygon(corners, close=True)

    up = cadquery.Vector(0, 0, thickness)
    return [
        cadquery.Solid.extrudeLinear(wire(outer), [wire(hole) for hole in holes], up)
        for outer, *holes in regions_of(rings)
    ]


def _inlay(cadquery: ModuleType, dot: Disk, depth: float) -> Any:
    outer = _cylinder(cadquery, dot.x, dot.y, dot.radius, depth)
    if not dot.inner_radius:
        return outer
    return outer.cut(_cylinder(cadquery, dot.x, dot.y, dot.inner_radius, depth)).Solids()[0]


def _cylinder(cadquery: ModuleType, x: float, y: float, radius: float, height: float) -> Any:
    return cadquery.Solid.makeCylinder(radius, height, cadquery.Vector(x, y, -height))
