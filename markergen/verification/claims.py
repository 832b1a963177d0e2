"""Account for everything in a solid: each body and each piece of surface belongs to something of the marker.

Bodies are claimed by the plate, a dot or the tag. Of the surface, what rises above the face belongs to the pillar or
ball of a dot, and what lies below it to the outline, a hole, a pocket, or what is engraved in the back.
"""

# tests: tests/verification/test_claims.py

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.geometry.contour import flattened
from markergen.geometry.region import Region
from markergen.model.marker import Marker
from markergen.solid.plate import plate_of
from markergen.verification.lines import CutLine, seek_among
from markergen.verification.matching import ALIKE, DotSet, expected_dots
from markergen.verification.solids import FLUSH, round_edges
from markergen.verification.surface import SolidPart, Surface
from markergen.verification.words import MOST_LISTED, Finding, short_length

ROOM = 1.2
"""Distance in mm from a line of the marker within which walls are its own: clearance, rounded corners."""

CORE = 0.4
"""Maximum gap in mm around the core of a ring: the largest of a fit or of --gap, and no more, as it shows."""

ENGRAVED = 0.8
"""Depth in mm of what may be engraved in the back."""

FOOT = 6.0
"""Width in mm of the fillet and the draft around a pillar, of a relief."""

REMOVE = "remove what is not the marker's, or export it again"

Motion = tuple[Array, Array]


def body_findings(marker: Marker, surface: Surface, motion: Motion, plate: int) -> list[Finding]:
    """Bodies that are no plate, dot, core or part of the tag, and those that are there twice; mm.

    Parameters
    ----------
    plate : int
        Index of the plate, -1 if there is none.
    """
    rotation, translation = motion
    expected = expected_dots(marker)
    places, radii = expected.centers @ rotation.T + translation, expected.radii
    square = None
    if marker.tag is not None:
        corners = 1e3 * marker.tag.corners[:, :2] @ rotation.T + translation
        square = corners.min(axis=0) - ROOM, corners.max(axis=0) + ROOM
    findings, claimed = list[Finding](), dict[tuple[object, ...], int]()
    for index, part in enumerate(surface.parts):
        low, high = np.array(part.low), np.array(part.high)
        middle = (low + high) / 2
        if part.volume < 0 and part.closed:
            findings.append(Finding("extra", f"a void in the material around {_at(middle, motion)}", REMOVE))
            continue
        if index == plate:
            continue
        role: tuple[object, ...] | None = None
        nearest = int(np.argmin(np.linalg.norm(places - middle[:2], axis=1)))
        off = np.abs(np.concatenate([low[:2], high[:2]]) - np.tile(places[nearest], 2))
        for size, most in ((radii[nearest], ROOM), (expected.inner[nearest], CORE)):
            if size and np.abs(off - size).max() <= min(most, 0.2 * size):
                role = ("dot", nearest, size)
        if role is None and square is not None and (low[:2] >= square[0]).all() and (high[:2] <= square[1]).all():
            role = ("tag", *np.round(low, 2).tolist(), *np.round(high, 2).tolist(), round(part.volume, 1))
        if role is None and _is_plate(marker, part, motion):
            role = ("plate", *np.round(low, 1).tolist(), *np.round(high, 1).tolist())
        if role is None:
            name = f"the body {part.name}" if part.name else "a body"
            size = " x ".join(f"{side:.3g}" for side in high - low)
            findings.append(
                Finding("extra", f"{name} of {size} mm around {_at(middle, motion)} is not the marker's", REMOVE)
            )
        elif role in claimed:
            findings.append(Finding("twice", f"the same body is there twice around {_at(middle, motion)}", REMOVE))
        else:
            claimed[role] = index
    return findings[:MOST_LISTED]


def _is_plate(marker: Marker, part: SolidPart, motion: Motion) -> bool:
    """Tell whether a part has the outline of one of several pieces of a plate."""
    rotation, translation = motion
    outlines = plate_of(marker).outlines
    if len(outlines) < 2:
        return False
    for outline in outlines:
        ring = np.array(flattened(outline[0], 0.01)) @ rotation.T + translation
        box = np.concatenate([ring.min(axis=0), ring.max(axis=0)])
        if np.abs(box - [*part.low[:2], *part.high[:2]]).max() < ROOM:
            return True
    return False


def _at(place: Array, motion: Motion) -> str:
    x, y = (place[:2] - motion[1]) @ motion[0]
    return f"x {_short(x)}, y {_short(y)}, z {_short(place[2])} mm"


def _short(value: float) -> str:
    return f"{round(value, 3) + 0.0:.5g}"


def core_findings(surface: Surface, dots: DotSet, names: tuple[int, ...], tolerance: float) -> list[Finding]:
    """Rings whose middle is a pit or a bump instead of level with them, or has a core of another size; mm."""
    findings = list[Finding]()
    if surface.loose or dots.heights is None:
        return findings
    edges = round_edges(surface)
    balls = np.array([[b.x, b.y] for part in surface.parts for b in part.balls]).reshape(-1, 2)
    for k in np.flatnonzero(dots.rings).tolist():
        center, inner, top = dots.centers[k], float(dots.inner[k]), float(dots.heights[k])
        if len(balls) and np.linalg.norm(balls - center, axis=1).min() < dots.radii[k]:
            continue
        angle = np.arange(6) * np.pi / 3
        rim = 0.7 * inner * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        around = np.concatenate([np.zeros((1, 2)), rim])
        part, level, _ = surface.look(center + around)
        off = level - top
        off[part < 0] = -np.inf
        if np.abs(off).max() > max(tolerance, FLUSH):
            worst = float(off[np.argmax(np.abs(off))])
            how = "open" if worst == -np.inf else f"{short_length(abs(worst))} {'high' if worst > 0 else 'deep'}"
            findings.append(Finding("kind", f"the middle of ring {names[k]} is {how}: its core is missing", REMOVE))
            continue
        mine = edges[
            (np.linalg.norm(edges[:, :2] - center, axis=1) < 0.2 * inner)
            & (np.abs(edges[:, 3] - top) < max(tolerance, FLUSH))
            & (edges[:, 6] == 1)
            & (np.abs(edges[:, 2] / inner - 1) < ALIKE - 1)
        ]
        for row in mine:
            if row[2] > inner + tolerance or np.linalg.norm(row[:2] - center) > tolerance:
                off_center = float(np.linalg.norm(row[:2] - center))
                flaw = f"has a diameter of {2 * row[2]:.5g} mm, in a hole of {2 * inner:.5g} mm"
                if off_center > tolerance:
                    flaw = f"is {short_length(off_center)} off"
                findings.append(Finding("diameter", f"the core of ring {names[k]} {flaw}", REMOVE))
    return findings[:MOST_LISTED]


def surface_findings(
    marker: Marker, surface: Surface, motion: Motion, wanted: Sequence[CutLine], levels: tuple[float, float], tol: float
) -> list[Finding]:
    """Pieces of the surface that belong to nothing of the marker; mm.

    Parameters
    ----------
    wanted : sequence of CutLine
        Outline and holes of the plate, marker frame.
    levels : (face, back)
        Heights of the plate's face and back.
    """
    if surface.triangles is None or not len(surface.triangles):
        return []
    rotation, translation = motion
    corners = surface.triangles
    points = np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])
    xy, z = (points[:, :2] - translation) @ rotation, points[:, 2]
    face, back = levels
    high = z > face + tol + FLUSH
    low = z < back - tol - FLUSH
    inside = ~high & ~low & (z < face - tol - FLUSH) & (z > back + ENGRAVED)
    extra = (high & ~_over_dots(marker, xy, z, face, tol, surface.round_dots)) | low
    index = np.flatnonzero(inside & ~_near_dots(marker, xy))
    if len(index):
        index = index[~_near_lines(marker, wanted, xy[index])]
        extra[index] = True
    if not extra.any():
        return []
    groups = list[Finding]()
    for mask, what in (
        (extra & high, "above the face"),
        (extra & ~high & ~low, "inside of the plate"),
        (low, "below it"),
    ):
        if mask.any():
            (x0, y0), (x1, y1) = xy[mask].min(axis=0), xy[mask].max(axis=0)
            place = f"x {x0:.4g} to {x1:.4g}, y {y0:.4g} to {y1:.4g}, z {z[mask].min():.4g} to {z[mask].max():.4g} mm"
            groups.append(Finding("extra", f"there is something {what} that is not the marker's: {place}", REMOVE))
    return groups


def several_findings(
    plates: Sequence[tuple[Marker, Array, Array]], corners: Array, balls: bool, tol: float
) -> list[Finding]:
    """Corners of triangles (m, 3, 3) of a solid that belong to none of several plates; mm, file frame.

    Parameters
    ----------
    plates : sequence of (marker, rotation (3, 3), translation (3,))
        Pose of each plate in the file.
    balls : bool
        True if dots may be balls.
    """
    from scipy.spatial import cKDTree

    points = np.unique(corners.reshape(-1, 3), axis=0)
    claimed = np.zeros(len(points), dtype=bool)
    for marker, rotation, translation in plates:
        local = (points - translation) @ rotation
        xy, z = local[:, :2], local[:, 2]
        outlines = [np.array(flattened(outline[0], 0.01)) for outline in plate_of(marker).outlines]
        # The faces of a block are the boundaries; plates by themselves are wider.
        edge = np.column_stack([np.concatenate(outlines), np.zeros(sum(map(len, outlines)))]) @ rotation.T + translation
        if np.median(cKDTree(points).query(edge)[0]) > ROOM / 2:
            outlines = [1e3 * ring for ring in marker.boundary.outlines()]
        here = Region.union([Region.polygon(ring) for ring in outlines]).offset(ROOM).contains(xy)
        for hole in marker.substrate.holes:
            # In a block its hole is as deep as the block.
            wide = 500 * max(hole.diameter, hole.sink or 0.0) + ROOM
            claimed |= (np.linalg.norm(xy - [1e3 * hole.x, 1e3 * hole.y], axis=1) < wide) & (z <= tol + FLUSH)
        deep = 1e3 * marker.substrate.thickness + ROOM
        claimed |= here & (((z <= tol + FLUSH) & (z >= -deep)) | _over_dots(marker, xy, z, 0.0, tol, balls))
    if claimed.all():
        return []
    low, high = points[~claimed].min(axis=0), points[~claimed].max(axis=0)
    place = ", ".join(f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True))
    return [Finding("extra", f"there is something that belongs to no plate: {place} mm", REMOVE)]


def _over_dots(marker: Marker, xy: Array, z: Array, face: float, tol: float, balls: bool) -> NDArray[np.bool_]:
    """Tell which points above the face are of the pillar or ball of a dot."""
    claimed = np.zeros(len(xy), dtype=bool)
    index = np.flatnonzero(z > face + tol)
    for point in marker.control_points:
        radius, top = 500 * point.feature.diameter, 1e3 * point.z
        away = np.linalg.norm(xy[index] - [1e3 * point.x, 1e3 * point.y], axis=1)
        relief = top > face + FLUSH
        wide = radius + ROOM + (FOOT if relief else 0.0)
        claimed[index] |= (away <= wide) & (z[index] <= top + tol + FLUSH)
        # A ball rises by its radius above its center.
        if balls:
            claimed[index] |= np.hypot(away, z[index] - top) <= radius + max(tol, 0.02)
    return claimed


def _near_dots(marker: Marker, xy: Array) -> NDArray[np.bool_]:
    """Tell which points are in or around a dot's pocket, or the tag's."""
    claimed = np.zeros(len(xy), dtype=bool)
    for point in marker.control_points:
        away = np.linalg.norm(xy - [1e3 * point.x, 1e3 * point.y], axis=1)
        claimed |= away <= 500 * point.feature.diameter + ROOM
    if marker.tag is not None:
        corners, room = 1e3 * marker.tag.corners[:, :2], ROOM + 1e3 * marker.tag.quiet
        claimed |= ((xy >= corners.min(axis=0) - room) & (xy <= corners.max(axis=0) + room)).all(axis=1)
    return claimed


def _near_lines(marker: Marker, wanted: Sequence[CutLine], xy: Array) -> NDArray[np.bool_]:
    """Tell which points are near the outline, the boundary or a hole, whose sink and chamfer are theirs."""
    contours = [line.contour for line in wanted]
    rings = [np.array(flattened(contour, 0.01)) for contour in contours]
    rings += [1e3 * ring for ring in marker.boundary.outlines()]
    pieces = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    reach = ROOM + 1e3 * marker.substrate.chamfer
    near = np.linalg.norm(seek_among(pieces)(xy, xy) - xy, axis=1) <= reach
    for hole in marker.substrate.holes:
        away = np.linalg.norm(xy - [1e3 * hole.x, 1e3 * hole.y], axis=1)
        near |= away <= 500 * max(hole.sink or 0.0, hole.diameter) + ROOM
    return np.asarray(near)
