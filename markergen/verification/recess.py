"""Plates that the printed sheet, or every printed dot, is glued into: they have recesses, and no dots of their own."""

from typing import Any

import numpy as np

from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Circle
from markergen.solid.surface import Loop, Surface
from markergen.verification.dots import Dots
from markergen.verification.solids import FLUSH, differ, plate_of

ROOM = 1.0
"""Most room in mm that a recess may have around what is glued into it."""

ROUND = 0.02
"""How far in mm the polygons may be off the circles that they stand for here."""

SHEET = "a plate with a recess for the printed sheet and no dots of its own: verify the sheet"


def holds_sheet(surface: Surface, boundary: Boundary) -> bool:
    """Tell whether a plate without dots has a recess where the boundary is, of its outline and a little larger.

    Where the plate is in its file is where it is looked for: nothing else tells.
    """
    import shapely

    if len({part.color for part in surface.parts}) > 1:
        return False
    top = max((face.z for part in surface.parts for face in part.faces), default=0.0)
    floors = [
        _polygon(face.loops[0])
        for part in surface.parts
        for face in part.faces
        if face.z < top - FLUSH and face.loops[0].area > 0
    ]
    wanted = _outline(boundary)
    # Land around screws stays in it: holes of the floor do not count.
    recess = shapely.union_all([floor for floor in floors if floor is not None and floor.intersects(wanted)])
    solid = shapely.union_all([shapely.Polygon(ring.exterior) for ring in shapely.get_parts(wanted)])
    grown = solid.buffer(ROOM + ROUND, join_style="mitre")
    return bool(recess.buffer(ROUND).covers(solid) and grown.covers(recess))


def _polygon(loop: Loop) -> Any:
    import shapely

    if loop.circle:
        x, y, radius = loop.circle
        return shapely.Point(x, y).buffer(radius, quad_segs=512)
    return shapely.Polygon(loop.points).buffer(0) if len(loop.points) > 2 else None


def _outline(boundary: Boundary) -> Any:
    import shapely

    if isinstance(boundary, Circle):
        x, y = 1e3 * np.asarray(boundary.center)
        return shapely.Point(x, y).buffer(1e3 * boundary.size, quad_segs=512)
    return Region.enclosed([1e3 * ring for ring in boundary.outlines()])._shape


def room_of(surface: Surface, found: Dots, expected: Dots) -> float:
    """Room in mm around the dots where what looks like them are recesses for printed ones; 0 where they are dots.

    Such recesses are all deeper than the plate and of its color, larger than dots by one and the same, and none is a
    ring.
    """
    if not len(found) or not (np.isfinite(found.radii)).all() or found.rings.any():
        return 0.0
    plate = plate_of(surface)
    part, z, colors = surface.look(found.centers)
    if (part != plate).any() or (z > (found.heights if found.heights is not None else 0.0) - FLUSH).any():
        return 0.0
    told = [differ(color, surface.parts[plate].color) for color in colors]
    # Without colors, pockets without rings for a marker that has one are recesses, too.
    if True in told or (None in told and not expected.rings.any()):
        return 0.0
    sizes = np.unique(expected.radii)
    room = found.radii - sizes[np.argmin(np.abs(found.radii[:, None] - sizes), axis=1)]
    return float(np.median(room)) if room.min() > FLUSH and room.max() < ROOM and np.ptp(room) < FLUSH else 0.0
