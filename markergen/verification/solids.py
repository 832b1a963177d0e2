"""Find dots, colors and holes of a solid in its plan view, whatever process made it.

Plates into which the printed sheet or every printed dot is glued have recesses, and no dots of their own.
"""

# tests: tests/verification/test_solids.py tests/verification/test_solid_readers.py

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.geometry.contour import area
from markergen.geometry.region import Region
from markergen.model.body import Body
from markergen.model.boundary import Boundary, Circle
from markergen.model.substrate import Hole
from markergen.verification.matching import ALIKE, CONCENTRIC, DotSet
from markergen.verification.reading import PRINTABLE, Page, Reading, round_shape
from markergen.verification.surface import Ball, Color, LevelFace, SolidPart, Surface, edge_of, out_of_round
from markergen.verification.words import MOST_LISTED, Finding, short_length

FLUSH = 1e-3
"""Maximum difference of height between edges of one dot face, in mm."""

CONTRAST = 0.2
"""Minimum difference of lightness between a dot and the plate, where black is 0 and white is 1."""

LUMA = np.array([0.2126, 0.7152, 0.0722])

HOLE = 2.0
"""Maximum distance of a hole from its nominal position, in mm, beyond which it is another hole."""

ROOM = 1.0
"""Maximum clearance in mm between a recess and the part glued into it."""

SLACK = 0.02
"""Maximum deviation in mm of a polygon from the circle that it approximates here."""

DARK = "the dark parts alone: verify the light ones, or the file of all parts, too"
LIGHT = "the light parts alone, with pockets for the dark ones: verify these, or the file of all parts, too"
SHEET = "a plate with a recess for the printed sheet and no dots of its own: verify the sheet"


def dots_of_surface(surface: Surface, expected: DotSet) -> DotSet:
    """Find the dots of a solid, each at the height of its face or of the center of its ball.

    A dot is a separate part of about its size whose highest level face is round; or a ball; or, for pockets and
    engraving, a round edge of a level face, the highest of several around one axis.
    """
    edges = round_edges(surface)
    balls = [(k, ball) for k, part in enumerate(surface.parts) for ball in part.balls]
    radii = np.unique(expected.radii)
    places = np.concatenate([edges[:, :3], np.array([[b.x, b.y, b.radius] for _, b in balls]).reshape(-1, 3)])
    is_sized = np.abs(np.log(np.maximum(places[:, 2:], 1e-12) / radii)).min(axis=-1) < np.log(ALIKE)
    free, rows, first = is_sized.copy(), [], []
    for index in np.flatnonzero(is_sized):
        if not free[index]:
            continue
        away = np.linalg.norm(places[:, :2] - places[index, :2], axis=-1)
        mine = away <= CONCENTRIC * np.minimum(places[:, 2], places[index, 2])
        free &= ~(mine & is_sized)
        pieces = [ball for ball, is_mine in zip(balls, (mine & is_sized)[len(edges) :], strict=True) if is_mine]
        around = edges[mine[: len(edges)]]
        row, part = _of_balls(pieces, radii) if pieces else _ofround_edges(surface, around, radii)
        rows.append(row)
        first.append(part)
    table = np.array(rows, dtype=float).reshape(-1, 6)
    # Parts follow the marker's order; the edges of one part do not.
    ordered = len(set(first)) == len(first)
    table = table[np.argsort(first, kind="stable")] if ordered else table
    return DotSet(table[:, :2], table[:, 2], table[:, 3], table[:, 4], table[:, 5], ordered)


def round_edges(surface: Surface) -> Array:
    """Round edges (k, 7) of level faces: x, y, radius, z, part, face, and 1 for the outer edge of a face."""
    rows = [
        (*about, face.z, part, number, float(place == 0))
        for part, solid in enumerate(surface.parts)
        for number, face in enumerate(solid.faces)
        for place, edge in enumerate(face.edges)
        if (about := edge.as_circle)
    ]
    return np.array(rows, dtype=float).reshape(-1, 7)


def _of_balls(pieces: list[tuple[int, Ball]], radii: Array) -> tuple[tuple[float, ...], int]:
    """Row (x, y, radius, inner radius, spread, z) of a ball-shaped dot, and its part."""
    part, best = min(pieces, key=lambda piece: np.abs(np.log(piece[1].radius / radii)).min())
    inner = max(ball.hole for _, ball in pieces)
    spread = max(float(np.hypot(ball.x - best.x, ball.y - best.y)) for _, ball in pieces)
    return (best.x, best.y, best.radius, inner, spread, best.z), part


def _ofround_edges(surface: Surface, around: Array, radii: Array) -> tuple[tuple[float, ...], int]:
    """Row of a dot made of edges around one axis, and its part."""
    misfit = np.abs(np.log(around[:, 2:3] / radii)).min(axis=-1)
    is_sized = misfit < np.log(ALIKE)
    parts = surface.parts
    is_part = is_sized & (around[:, 6] == 1)
    is_part[is_part] = [is_dot(parts[int(part)], *row) for *row, part in around[is_part][:, [0, 1, 2, 4]]]
    chosen = is_part if is_part.any() else is_sized
    top = around[chosen, 3].max()
    level = np.abs(around[:, 3] - top) <= FLUSH
    candidates = np.flatnonzero(chosen & level)
    best = around[candidates[np.argmin(misfit[candidates])]]
    within = level & (around[:, 2] < best[2] / ALIKE)
    if is_part.any():
        # A core inside a ring has an edge of its own, separated by the ring's gap.
        within &= (around[:, 4] == best[4]) & (around[:, 5] == best[5])
    inner = around[within]
    alike = around[is_sized & level & (np.abs(around[:, 2] / best[2] - 1) < 0.05)]
    others = np.concatenate([alike, inner])[:, :2] - best[:2]
    spread = float(np.linalg.norm(others, axis=-1).max(initial=0.0))
    return (best[0], best[1], best[2], float(inner[:, 2].max(initial=0.0)), spread, top), int(best[4])


def is_dot(part: SolidPart, x: float, y: float, radius: float) -> bool:
    """True if a part, in plan view, is no larger than a dot with this edge may be."""
    reach = ALIKE * radius
    return x - part.low[0] < reach > part.high[0] - x and y - part.low[1] < reach > part.high[1] - y


def plate_index(surface: Surface) -> int:
    """Index of the part that is largest in plan view."""
    return int(np.argmax([(p.high[0] - p.low[0]) * (p.high[1] - p.low[1]) for p in surface.parts]))


def differ(color: Color | None, plate: Color | None) -> bool | None:
    """True if two colors distinguish a dot from the plate; None if either is unknown."""
    if color is None or plate is None:
        return None
    return bool(abs(LUMA @ (np.array(color) - plate)) >= CONTRAST)


def is_ink(surface: Surface, places: Array) -> NDArray[np.bool_]:
    """Tell which points (m, 2) are inked: not of the plate's color or, without colors, on another part or recessed."""
    plate = -1 if surface.loose else plate_index(surface)
    part, z, colors = surface.look(places)
    if surface.loose:
        return part >= 0
    plate_color = surface.parts[plate].color
    face = np.median(z[part == plate]) if (part == plate).any() else 0.0
    contrasts = [differ(color, plate_color) for color in colors]
    is_apart = (part != plate) | (z < face - FLUSH)
    return np.array([bool(is_apart[k]) if contrasts[k] is None else contrasts[k] for k in range(len(places))])


def straight_edges(surface: Surface, plate: bool) -> tuple[Array, Array]:
    """Start and end points (k, 2) of the straight edges of level faces, of the plate or of all other parts."""
    main = -1 if surface.loose else plate_index(surface)
    parts = [part for index, part in enumerate(surface.parts) if (index == main) == plate]
    edges = [edge for part in parts for face in part.faces for edge in face.edges if not edge.is_circle]
    starts, ends = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for edge in edges:
        points = np.array(edge.points)
        before, after = (points - np.roll(points, k, axis=0) for k in (1, -1))
        # Collinear points are not corners.
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        length = np.linalg.norm(before, axis=-1) * np.linalg.norm(after, axis=-1)
        corners = points[np.abs(cross) > 1e-6 * length]
        starts.append(corners)
        ends.append(np.roll(corners, -1, axis=0))
    return np.concatenate(starts), np.concatenate(ends)


def hole_findings(
    surface: Surface, holes: tuple[Hole, ...], motion: tuple[Array, Array], tolerance: float
) -> list[Finding]:
    """Holes of the plate that are missing, misplaced or of the wrong size; tolerance in mm."""
    rotation, translation = motion
    edges = round_edges(surface)
    findings = []
    for hole in holes:
        called = f"the hole {hole.name}".rstrip() + f" at x {1e3 * hole.x:.6g}, y {1e3 * hole.y:.6g} mm"
        radius = 500 * (hole.sink or hole.diameter)
        offset = (edges[:, :2] - translation) @ rotation - 1e3 * np.array([hole.x, hole.y])
        away = np.linalg.norm(offset, axis=-1)
        there = (away < HOLE) & (np.abs(np.log(np.maximum(edges[:, 2], 1e-12) / radius)) < np.log(ALIKE))
        if not there.any():
            findings.append(Finding("hole", f"{called} is missing"))
            continue
        best = np.flatnonzero(there)[np.argmin((away + np.abs(edges[:, 2] - radius))[there])]
        if away[best] > tolerance:
            findings.append(Finding("hole", f"{called} is {short_length(away[best])} off"))
        if abs(edges[best, 2] - radius) > tolerance:
            sentence = f"has a diameter of {2 * edges[best, 2]:.6g} mm, not {2 * radius:.6g} mm"
            findings.append(Finding("hole", f"{called} {sentence}"))
    return findings


def flaws_of(surface: Surface) -> tuple[str, ...]:
    """Defects of the solids themselves."""
    flaws = []
    for number, part in enumerate(surface.parts, 1):
        name = f"the part {part.name}" if part.name else f"part {number}"
        if not part.closed:
            flaws.append(f"{name} has open edges: it encloses no volume")
        elif not part.valid:
            flaws.append(f"{name} is not a valid solid: it is inside out or intersects itself")
    return tuple(flaws[:MOST_LISTED])


def reading_of(kind: str, views: Sequence[Surface], body: Body) -> Reading:
    """Reading of a solid in mm, seen from above or, for a body of several plates, from all sides."""
    pages = tuple(Page(np.zeros((0, 3)), surface=classified(surface, body)) for surface in views)
    return Reading(kind, pages, PRINTABLE, tagged=True, flaws=flaws_of(views[0]) if views else ())


def classified(surface: Surface, body: Body) -> Surface:
    """Surface that knows whether there is a plate around the body's dots."""
    return replace(surface, loose=_is_loose(surface, 1e3 * float(body.radii.max(initial=0.0))))


def _is_loose(surface: Surface, radius: float) -> bool:
    """Tell whether there are parts of dots, of at most that radius, and none of them has a plate around it."""
    boxes = np.array([part.box for part in surface.parts]).reshape(-1, 4)
    dot_parts = [
        k
        for k, part in enumerate(surface.parts)
        if (part.balls or any(face.edges[0].as_circle for face in part.faces))
        and max(boxes[k, 2] - boxes[k, 0], boxes[k, 3] - boxes[k, 1]) < 2 * ALIKE * radius
    ]
    # A ring lies around its core.
    around = np.delete(boxes, dot_parts, axis=0)
    inside = [
        np.sum((around[:, :2] < boxes[k, :2]).all(axis=1) & (around[:, 2:] > boxes[k, 2:]).all(axis=1))
        for k in dot_parts
    ]
    return bool(dot_parts) and not any(inside)


def level_face(
    z: float, outlines: Sequence[tuple[Array, tuple[float, float, float] | None, bool]], color: Color | None
) -> LevelFace:
    """Make a level face of outlines: points (k, 2), the circle on which they lie if known, whether sides are straight.

    Other programs write circles as splines or polygons; how far these are off is kept.
    """
    edges = []
    for points, circle, straight in outlines:
        about = circle or round_shape(points)
        rough = out_of_round(points, about, straight) if about and not circle else 0.0
        edges.append((edge_of(points, about), rough))
    edges.sort(key=lambda edge: -abs(area(edge[0])))
    contours, rough_ones = zip(*edges, strict=True)
    return LevelFace(z, contours, color, rough_ones)


def holds_sheet(surface: Surface, boundary: Boundary) -> bool:
    """Tell whether a plate without dots has a recess that matches the boundary with a little clearance.

    The recess must lie at the boundary's nominal position, since there is nothing to align the plate by.
    """
    if len({part.color for part in surface.parts}) > 1:
        return False
    top = max((face.z for part in surface.parts for face in part.faces), default=0.0)
    if isinstance(boundary, Circle):
        x, y = 1e3 * np.asarray(boundary.center)
        wanted = Region.disk(x, y, 1e3 * boundary.size)
    else:
        wanted = Region.enclosed([1e3 * ring for ring in boundary.outlines()])
    # Islands around screws are part of the recess, so holes in its floor are ignored.
    floors = [face.outline for part in surface.parts for face in part.faces if face.z < top - FLUSH]
    recess = Region.union([floor for floor in floors if floor.meets(wanted)])
    solid = wanted.filled()
    return recess.offset(SLACK).covers(solid) and solid.offset(ROOM + SLACK, corners="miter").covers(recess)


def recess_clearance(surface: Surface, dots: DotSet, expected: DotSet) -> float:
    """Clearance in mm around what goes into recesses, if the apparent dots are recesses; 0 if they are dots.

    Recesses lie below the plate's surface, have its color, and are larger than dots by the same amount. Those for
    printed dots are never rings; those for inlays may have the light core of a ring in them.
    """
    if surface.loose or not len(dots) or not (np.isfinite(dots.radii)).all():
        return 0.0
    plate = plate_index(surface)
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    middles = dots.centers[:, None] + ((dots.radii + dots.inner) / 2 * dots.rings)[:, None, None] * directions
    part, z, colors = surface.look(middles.reshape(-1, 2))
    heights = np.repeat(dots.heights if dots.heights is not None else np.zeros(len(dots)), len(directions))
    if (part != plate).any() or (z > heights - FLUSH).any():
        return 0.0
    contrasts = [differ(color, surface.parts[plate].color) for color in colors]
    # Without colors, pockets without any ring are recesses if the marker has a ring.
    if True in contrasts or (None in contrasts and not dots.rings.any() and not expected.rings.any()):
        return 0.0
    sizes = np.unique(expected.radii)
    room = dots.radii - sizes[np.argmin(np.abs(dots.radii[:, None] - sizes), axis=1)]
    return float(np.median(room)) if room.min() > FLUSH and room.max() < ROOM and np.ptp(room) < FLUSH else 0.0


def recesses(dots: DotSet, room: float, rings: bool) -> DotSet:
    """Recesses for dots, with room around them; `rings` tells whether rings keep their cores."""
    inner = np.where(dots.rings, dots.inner - room, 0.0) if rings else np.zeros(len(dots))
    return DotSet(dots.centers, dots.radii + room, inner, dots.spread, dots.heights, dots.ordered)
