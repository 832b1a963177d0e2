"""Pillars under raised dots: round, drafted, with a fillet at the foot, clear of features and lines of sight."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin, tan

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import Contour
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.occlusion import eyes_of, passage, pillar_radius
from markergen.model.poses import PoseDistribution
from markergen.solid.plate import Footprint, SolidPlate, gaps
from markergen.solid.primitives import Revolved
from markergen.workshop.dot_geometry import SolidDot
from markergen.workshop.manufacturability import FLATTENING, Tool, found_room, up

LEAST_FOOT = 0.05
"""Minimum radius in mm of a fillet."""

CONES = 4
"""Number of cones that represent a pillar in line-of-sight checks: one for its wall, three for its fillet."""

FORGIVEN = 1e-6
"""Maximum intrusion in mm of a pillar into a line of sight, to allow for rounding."""

PILLAR, EDGE = "the pillar of ", "the plate's edge"
"""Names of pillars and the edge in messages."""

AT_ONCE = 200_000
"""Number of lines of sight per batch."""


@dataclass(frozen=True)
class Pillar:
    """The pillar under a dot; mm.

    Attributes
    ----------
    dot : SolidDot
        The dot, centered on its top.
    radius : float
        Radius of its top.
    draft : float
        Angle in rad by which its wall slopes outward toward the plate.
    foot : float
        Radius of the fillet around its foot.
    """

    dot: SolidDot
    radius: float
    draft: float = 0.0
    foot: float = 0.0

    @property
    def base(self) -> float:
        """Radius at the plate, without the fillet."""
        return self.radius + self.dot.z * tan(self.draft)

    @property
    def reach(self) -> float:
        """Radius at the plate, with the fillet, which is tangent to plate and wall at `tangent` from their corner."""
        return self.base + self.tangent

    @property
    def tangent(self) -> float:
        """Distance from the corner of plate and wall to the fillet's start: foot / tan((90 deg + draft)/2)."""
        return self.foot / tan((pi / 2 + self.draft) / 2)

    @property
    def body(self) -> Revolved:
        """Primitive from the plate's face at z = 0 to the dot's height."""
        x, y, z = self.dot.x, self.dot.y, self.dot.z
        if not self.foot:
            profile = Contour(((0.0, 0.0), (self.base, 0.0), (self.radius, z), (0.0, z)))
            return Revolved(x, y, profile)
        side = (self.base - self.tangent * sin(self.draft), self.tangent * cos(self.draft))
        # The fillet turns right, from the plate into the wall, by 90 degrees less the draft.
        bulge = -tan((pi / 2 - self.draft) / 4)
        points = ((0.0, 0.0), (self.reach, 0.0), side, (self.radius, z), (0.0, z))
        return Revolved(x, y, Contour(points, (0.0, bulge, 0.0, 0.0, 0.0)))

    def cones(self) -> tuple[Array, Array, Array]:
        """Heights, radii and tangents (CONES,) of the tops and the sides of vertical cones that cover the pillar.

        One is the wall; the sides of the others are chords of the concave fillet.
        """
        wall = (self.dot.z, self.radius, tan(self.draft))
        if not self.foot:
            heights, radii, slopes = np.array([wall] * CONES).T
            return heights, radii, slopes
        # From the plate to the wall, around the fillet's center at (reach, foot).
        angles = np.linspace(0.0, pi / 2 - self.draft, CONES)
        radii = self.reach - self.foot * np.sin(angles)
        heights = self.foot * (1 - np.cos(angles))
        # Chords of the fillet cut into its hollow, so that the cones cover it.
        slopes = -np.diff(radii) / np.diff(heights)
        return np.append(heights[1:], wall[0]), np.append(radii[1:], wall[1]), np.append(slopes, wall[2])


def pillars_of(
    marker: Marker,
    dots: Sequence[SolidDot],
    fabrication: Fabrication,
    tool: Tool,
    plate: SolidPlate,
    others: Sequence[Footprint],
    rim: float,
    poses: PoseDistribution | None,
) -> tuple[tuple[Pillar, ...], tuple[str, ...]]:
    """Make pillars under the raised dots, and sentences for the user about them.

    A fillet is smaller than requested where a neighbor, a hole, the plate's edge, the pillar's height or a line of
    sight leaves no room for it.

    Parameters
    ----------
    others : sequence of Footprint
        Features cut into the plate's face, other than holes.
    rim : float
        Minimum width in mm of the pillar's top around its dot.
    poses : PoseDistribution or None
        Poses from which no pillar may hide a dot; None if unknown.

    Raises
    ------
    InputError
        If pillars touch each other or another feature, or hide dots; the message says what would fit.
    """
    raised = [dot for dot in dots if dot.raised]
    if not raised:
        return (), ()
    clearance = marker.clearance * 1e3
    bare = [Pillar(dot, max(pillar_radius(2 * dot.radius, clearance), dot.radius + rim)) for dot in raised]
    drafted = [replace(pillar, draft=fabrication.draft) for pillar in bare]
    _check_room(marker, bare, drafted, tool, plate, others)
    _check_sight(marker, dots, bare, drafted, poses)
    asked = fabrication.foot * 1e3
    feet = _feet(drafted, tool, plate, others, asked)
    pillars = [replace(pillar, foot=foot) for pillar, foot in zip(drafted, feet, strict=True)]
    while poses is not None and any(pillar.foot for pillar in pillars) and pillar_hiding_most(dots, pillars, poses):
        pillars = [replace(pillar, foot=_floor(pillar.foot / 2)) for pillar in pillars]
    notes = []
    if poses is None:
        notes.append(
            "The marker does not say from which poses it is seen: whether a pillar hides a dot is not checked."
        )
    reduced = [pillar for pillar in pillars if pillar.foot < asked]
    if reduced:
        names = "all pillars" if len(reduced) == len(pillars) else ", ".join(f"dot-{p.dot.id}" for p in reduced)
        least = min(pillar.foot for pillar in reduced)
        size = f"{least:.6g} mm or more" if least else "left out or smaller"
        notes.append(f"The fillet around the foot is {size} instead of {asked:.6g} mm, where room is short: {names}.")
    wide = [p for p in pillars if p.radius > pillar_radius(2 * p.dot.radius, clearance) + FORGIVEN]
    if wide:
        notes.append(f"Pillars are {rim:.3g} mm wider in radius than their dots, so that these have a rim to lie in.")
    return tuple(pillars), tuple(notes)


def _check_room(
    marker: Marker,
    bare: Sequence[Pillar],
    drafted: Sequence[Pillar],
    tool: Tool,
    plate: SolidPlate,
    others: Sequence[Footprint],
) -> None:
    """Refuse pillars less than a wall's width from each other or from other features."""
    free = _room(drafted, tool, plate, others)
    worst = int(np.argmin([room for room, _ in free]))
    room, neighbor = free[worst]
    if room >= (-FLATTENING if neighbor == EDGE else -FORGIVEN):
        return
    straight, _ = _room(bare, tool, plate, others)[worst]
    pillar = drafted[worst]
    if straight >= -FORGIVEN:
        # Both pillars widen by their height times the tangent of the draft.
        heights = pillar.dot.z + next((p.dot.z for p in bare if PILLAR + p.dot.name == neighbor), 0.0)
        both = 2 if heights > pillar.dot.z else 1
        most = np.degrees(np.arctan(max(0.0, both * straight) / heights))
        least = np.floor(most * 10) / 10
        remedy = f"use --draft {least:g} or less" if least else "leave out --draft"
    elif neighbor == EDGE:
        remedy = "use a larger --edge or --outline"
    elif neighbor in {hole.name for hole in plate.hole_footprints}:
        remedy = f"move the hole by {up(-room)}"
    else:
        # A pillar's margin around its dot is a share of the clearance, so that half of it remains between two.
        remedy = f"design it with --clearance {up(marker.clearance * 1e3 - 4 * room)} or more"
    raise InputError(
        f"at least {tool.wall:.6g} mm between the pillar of {pillar.dot.name} and {neighbor}",
        # Two pillars share the missing room.
        found_room(tool.wall + (2 if neighbor.startswith(PILLAR) else 1) * room),
        remedy,
    )


def _room(
    pillars: Sequence[Pillar], tool: Tool, plate: SolidPlate, others: Sequence[Footprint]
) -> list[tuple[float, str]]:
    """Room in mm for each pillar to widen, less a wall, and the feature that limits it; pillars share their gap."""
    feet = [Footprint(PILLAR + p.dot.name, ((p.dot.x, p.dot.y),), p.base) for p in pillars]
    beside = [*plate.hole_footprints, *others]
    nearest = []
    between, aside, edge = gaps(feet, feet), gaps(feet, beside), plate.room(feet)
    for i in range(len(feet)):
        rooms = [(edge[i] - tool.wall, EDGE)]
        rooms += [
            ((gap - tool.wall) / 2, foot.name) for gap, foot in zip(between[i], feet, strict=True) if np.isfinite(gap)
        ]
        rooms += [(gap - tool.wall, footprint.name) for gap, footprint in zip(aside[i], beside, strict=True)]
        nearest.append(min(rooms))
    return [(float(room), name) for room, name in nearest]


def _feet(
    pillars: Sequence[Pillar], tool: Tool, plate: SolidPlate, others: Sequence[Footprint], asked: float
) -> list[float]:
    feet = []
    for pillar, (room, _) in zip(pillars, _room(pillars, tool, plate, others), strict=True):
        # The fillet must end below the pillar's top.
        tangent = min(room, 0.8 * pillar.dot.z / cos(pillar.draft))
        # `tangent` of the pillar, solved for its foot.
        most = tangent * tan((pi / 2 + pillar.draft) / 2)
        feet.append(asked if asked <= most else _floor(most))
    return feet


def _floor(foot: float) -> float:
    foot = float(np.floor(foot * 100 + FORGIVEN) / 100)
    return foot if foot >= LEAST_FOOT else 0.0


def _check_sight(
    marker: Marker,
    dots: Sequence[SolidDot],
    bare: Sequence[Pillar],
    drafted: Sequence[Pillar],
    poses: PoseDistribution | None,
) -> None:
    """Refuse pillars that hide dots."""
    if poses is None or not (hidden := pillar_hiding_most(dots, drafted, poses)):
        return
    pillar, dot, count = hidden
    remedy = "design it again with --relief, or choose poses with less tilt"
    if not pillar_hiding_most(dots, bare, poses):
        low, high = 0.0, drafted[0].draft
        # Eight halvings of at most 45 degrees give 0.2, and the message has tenths.
        for _ in range(8):
            middle = (low + high) / 2
            hides = pillar_hiding_most(dots, [replace(bare_pillar, draft=middle) for bare_pillar in bare], poses)
            low, high = (low, middle) if hides else (middle, high)
        remedy = f"use --draft {np.floor(np.degrees(low) * 10) / 10:g} or less"
    elif not pillar_hiding_most(
        dots, [replace(p, radius=pillar_radius(2 * p.dot.radius, marker.clearance * 1e3)) for p in bare], poses
    ):
        remedy = "use a smaller --tool or --gap, or design it with a larger --clearance"
    raise InputError(
        "pillars that hide no dot",
        f"the pillar of {pillar} hiding some of {dot} in {count} of {len(poses)} poses",
        remedy,
    )


def pillar_hiding_most(
    dots: Sequence[SolidDot], pillars: Sequence[Pillar], poses: PoseDistribution
) -> tuple[str, str, int] | None:
    """Return the pillar and dot with most poses in which the one hides the other, and their number; None if none does.

    Seen from the eye, a cone whose radius falls by k per height hides the same of a dot as a vertical cylinder smaller
    by k times the eye's height above the cone's top does of a dot larger by k times the eye's height above the dot.
    """
    if not pillars or not len(poses):
        return None
    eyes = eyes_of(poses) * 1e3
    places = np.array([[dot.x, dot.y, dot.z] for dot in dots])
    radii = np.array([dot.radius for dot in dots])
    heights, walls, slopes = (np.array(values) for values in zip(*(p.cones() for p in pillars), strict=True))
    middles = np.array([[pillar.dot.x, pillar.dot.y] for pillar in pillars])
    is_same_dot = np.array([[dot.id == pillar.dot.id for pillar in pillars] for dot in dots])
    # Only a pillar higher than a dot can hide it, and only one near the line from the dot to the lowest eye.
    above = heights[None] - places[:, None, None, 2]
    climb = max(float(eyes[:, 2].min()) - places[:, 2].max(), FORGIVEN)
    reach = above / climb * (np.hypot(*eyes.T[:2]).max() + np.hypot(*places.T[:2]).max())
    apart = np.linalg.norm(middles[None] - places[:, None, :2], axis=-1)[:, :, None]
    widest = walls + slopes * heights
    is_reached = apart - widest[None] - radii[:, None, None] <= reach
    dot, pillar, cone = np.nonzero((above > FORGIVEN) & is_reached & ~is_same_dot[:, :, None])
    counts = np.zeros(is_same_dot.shape, dtype=int)
    for chunk in np.array_split(np.arange(len(dot)), max(1, len(dot) * len(eyes) // AT_ONCE)):
        d, p, k = dot[chunk], pillar[chunk], cone[chunk]
        slope, top = slopes[p, k][:, None], np.column_stack([middles[p], heights[p, k]])[:, None]
        size = radii[d, None] + slope * (eyes[None, :, 2] - places[d, None, 2])
        wall = walls[p, k][:, None] + slope * (top[..., 2] - eyes[None, :, 2])
        sight = passage(places[d, None], size, top, wall, eyes[None])
        np.maximum.at(counts, (d, p), np.sum(sight.gap < -FORGIVEN, axis=1))
    if not counts.any():
        return None
    worst = divmod(int(np.argmax(counts)), len(pillars))
    return pillars[worst[1]].dot.name, dots[worst[0]].name, int(counts[worst])


def designed_poses(marker: Marker) -> PoseDistribution | None:
    """Poses that a marker was designed for and that see all of it; None if its file has none."""
    from markergen.read.poses import poses_from
    from markergen.read.spec_file import spec_of

    spec = spec_of(marker)
    return None if spec is None else poses_from(spec.poses).seen_whole(marker.boundary, spec.camera, marker.height)


def balls_hide(dots: Sequence[SolidDot], poses: PoseDistribution) -> int:
    """Number of poses in which a ball of the size of some dot, centered on it, hides a part of another.

    Two balls overlap in the image if the angle between their centers is below the sum of their angular radii.
    """
    places = np.array([[dot.x, dot.y, dot.z] for dot in dots])
    radii = np.array([dot.radius for dot in dots])
    hidden = 0
    for eye in eyes_of(poses) * 1e3:
        way = places - eye
        far = np.linalg.norm(way, axis=-1)
        # A ball is seen as a cone of half-angle asin(r / d).
        half = np.arcsin(np.clip(radii / far, 0.0, 1.0))
        unit = way / far[:, None]
        # From the chord, since arccos of a dot product loses half the digits at small angles.
        angle = 2 * np.arcsin(np.clip(np.linalg.norm(unit[:, None] - unit[None], axis=-1) / 2, 0.0, 1.0))
        overlap = angle < half[:, None] + half[None]
        np.fill_diagonal(overlap, False)
        hidden += bool(overlap.any())
    return hidden
