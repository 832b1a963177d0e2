"""What hides what: pillars of raised dots on a marker, and plates of a rig.

A dot is a disk parallel to its marker's plane z = 0, a pillar an upright cylinder of substrate from that plane to its
dot. A plate is flat and opaque, and its back is plain.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.region import Region
from markergen.model.body import Body
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution

PILLAR_RIM = 0.25
"""Excess of a pillar's radius over its dot's, as a share of the clearance: two pillars leave half the gap free."""

_TOUCHING = 1e-9
"""Height of one plate above another, m for a rig within 1 m, and share of its area that count as none."""


def pillar_radius(diameter: float, clearance: float) -> float:
    """Return the radius in m of the pillar under a raised dot; bare points (diameter 0) have none."""
    return diameter / 2 + PILLAR_RIM * clearance if diameter else 0.0


@dataclass(frozen=True)
class Passage:
    """Passage of lines of sight by pillars; all arrays of one shape (...).

    Attributes
    ----------
    gap : array, m
        Horizontal distance between the wall of the pillar and the nearest of the lines of sight to a point of the dot,
        where these are lower than the pillar. Negative: part of the dot is hidden, or inside the pillar.
    share : array
        Position of that place on the line from the dot (0) to the eye (1).
    topped : array of bool
        True if it is at the height of the pillar's top, so that the gap depends on the heights.
    """

    gap: Array
    share: Array
    topped: NDArray[np.bool_]


def passage(dots: Array, dot_radius: Array, pillars: Array, wall_radius: Array, eyes: Array) -> Passage:
    """Compute how closely the lines of sight from eyes to whole dots pass pillars, in closed form.

    At the share s of the way from a dot (p, z, r) to an eye (q, h), the lines of sight fill a disk about p + s (q - p)
    of radius (1 - s) r. They are lower than a pillar (a, t, R) up to s = (t - z)/(h - z). The gap is the minimum over
    these s of |a - p - s (q - p)| - (1 - s) r - R, which is convex in s. Pillars not higher than the dot are passed at
    s = 0.

    Parameters
    ----------
    dots, pillars, eyes : arrays (..., 3), m
        Marker frame; a pillar is given by the center of its top.
    dot_radius, wall_radius : arrays (...), m
    """
    way, offset = eyes[..., :2] - dots[..., :2], pillars[..., :2] - dots[..., :2]
    length = np.linalg.norm(way, axis=-1)
    unit = way / np.maximum(length, np.finfo(float).tiny)[..., None]
    along = np.sum(offset * unit, axis=-1)
    # Cross product: distance of the pillar's axis from the vertical plane of the line.
    beside = np.abs(offset[..., 0] * unit[..., 1] - offset[..., 1] * unit[..., 0])
    climb = eyes[..., 2] - dots[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.where(climb > 0, np.clip((pillars[..., 2] - dots[..., 2]) / climb, 0.0, 1.0), 1.0)
        slope = np.minimum(dot_radius / length, 1.0)
        # Where the distance grows as fast as the disk shrinks; an eye above the dot sees it best at the dot itself.
        bend = np.where(slope < 1, (along - beside * slope / np.sqrt(1 - slope**2)) / length, 0.0)
    share = np.clip(bend, 0.0, top)
    nearest = np.linalg.norm(offset - share[..., None] * way, axis=-1)
    gap = nearest - (1 - share) * dot_radius - wall_radius
    return Passage(gap, share, (bend >= top) & (top > 0) & (top < 1))


def sight_gaps(points: Array, dot_radius: Array, wall_radius: Array, eyes: Array) -> Array:
    """Return the gaps between each dot's lines of sight and each pillar: see `Passage.gap`.

    Returns
    -------
    array (P, n, n), m
        By eye, dot and pillar; inf for a dot's own pillar and those that are not higher, which do not hide it. A dot at
        or above the height of the eye is not visible at all: -inf.

    Parameters
    ----------
    points : array (n, 3), m
    dot_radius, wall_radius : arrays (n,) or (), m
    eyes : array (P, 3), m
        Camera centers in the marker frame, -R't (see `eyes_of`).
    """
    n = len(points)
    dot_radius, wall_radius = (np.broadcast_to(radius, n) for radius in (dot_radius, wall_radius))
    passages = passage(points[:, None], dot_radius[:, None], points[None], wall_radius[None], eyes[:, None, None])
    higher = points[None, :, 2] > points[:, None, 2]
    gaps = np.where(higher & (wall_radius > 0), passages.gap, np.inf)
    gaps[eyes[:, 2][:, None] <= points[:, 2]] = -np.inf
    return gaps


def hidden(body: Body, poses: PoseDistribution) -> NDArray[np.bool_]:
    """Return which dots (P, n) are partly or wholly hidden at poses T_camera_body.

    A dot is hidden by another dot's pillar on its own plate, by another plate (see `Body.plate_regions`), or by its own
    plate: if it is seen from below. A tolerance of a nanometer allows for rounding between neighbors. Pillars of other
    plates hide nothing.
    """
    eyes = eyes_of(poses)
    parts = [_hidden_by_pillars(plate.marker, plate.to_marker(eyes)) for plate in body.plates]
    if not body.is_convex:
        parts = [part | _hidden_by_plates(body, k, eyes) for k, part in enumerate(parts)]
    return np.concatenate(parts, axis=1)


def painting_levels(body: Body, eye: Array) -> list[list[int]]:
    """Return the plates to paint as seen from an eye (3,) in m, body frame, the farthest level first.

    No plate hides another of its own level or of a later one. Of a convex body, only plates that face the eye are
    painted: they hide the backs of the others.

    Raises
    ------
    InputError
        If plates hide one another in a circle, or pierce one another.
    """
    height = np.array([plate.to_marker(eye)[2] for plate in body.plates])
    if body.is_convex:
        return [[int(k) for k in np.flatnonzero(height > _TOUCHING)]]
    left = [int(k) for k in np.flatnonzero(np.abs(height) > _TOUCHING)]
    hides = {(j, k) for j in left for k in left if j != k and _plate_hides(body, j, k, eye)}
    levels = []
    while left:
        level = [j for j in left if not any((j, k) in hides for k in left)]
        if not level:
            names = ", ".join(body.plates[k].name for k in left[:5])
            raise InputError("plates of which each hides only those behind it", f"{names} in a circle", "move them")
        levels.append(level)
        left = [k for k in left if k not in level]
    return levels


def _plate_hides(body: Body, j: int, k: int, eye: Array) -> bool:
    """True if plate j hides part of plate k, which may be seen from its back."""
    shadow, plate = _shadow(body, j, k, body.plates[k].to_marker(eye)), body.plate_regions[k]
    return shadow is not None and (shadow & plate).area > _TOUCHING * plate.area


def _hidden_by_plates(body: Body, k: int, eyes: Array) -> NDArray[np.bool_]:
    """Return which dots (P, n) of marker k are partly or wholly hidden by other plates."""
    plate = body.plates[k]
    xyz, radii = plate.marker.xyz, plate.marker.radii
    hidden = np.zeros((len(eyes), len(xyz)), dtype=bool)
    for height in np.unique(xyz[:, 2]):
        level = xyz[:, 2] == height
        for pose, eye in enumerate(plate.to_marker(eyes)):
            shadows = (_shadow(body, j, k, eye, height) for j in range(len(body.plates)) if j != k)
            for shadow in filter(None, shadows):
                reach = np.maximum(radii[level] - 1e-9, np.finfo(float).tiny)
                hidden[pose, level] |= shadow.distance(xyz[level, :2]) < reach
    return hidden


def _shadow(body: Body, j: int, k: int, eye: Array, height: float = 0.0) -> Region | None:
    """Return the shadow that plate j casts from an eye (3,) on the plane at a height in m above plate k, in k's frame.

    It is the part of that plane that plate j hides: its part q between plane and eye e, mapped to e + (q - e) e_z/(e_z
    - q_z). None if no part of it lies there.
    """
    caster, screen = body.plates[j], body.plates[k]
    # From below, the plane's other side counts.
    side = np.array([1.0, 1.0, -1.0 if eye[2] < height else 1.0])
    rotation = side[:, None] * (screen.rotation_matrix.T @ caster.rotation_matrix)[:, :2]
    translation = side * (screen.to_marker(caster.translation_vector) - [0, 0, height])
    eye = side * (eye - [0, 0, height])
    # A plate is cut where it comes to the screen's plane, below which it casts nothing, and to the eye's height, where
    # the shadow becomes infinite.
    low, high = _TOUCHING * max(body.radius, 1.0), (1 - 1e-6) * eye[2]
    plate = body.plate_regions[j]
    corners = np.concatenate(plate.rings)
    heights = corners @ rotation[2] + translation[2]
    if heights.max() <= low or heights.min() >= high:
        return None
    if heights.min() < low or heights.max() > high:
        slope = float(np.linalg.norm(rotation[2]))
        along, reach = rotation[2] / slope, 2 * float(np.linalg.norm(corners, axis=-1).max())
        ends = np.clip((np.array([low, high]) - translation[2]) / slope, -reach, reach)
        across = reach * np.array([-along[1], along[0]])
        start, end = ends[:, None] * along
        plate = plate & Region.polygon([start - across, end - across, end + across, start + across])

    def cast(points: Array) -> Array:
        at = points @ rotation.T + translation
        # Similar triangles: the ray from the eye at height h through a point at height z meets the plane h / (h - z)
        # times as far.
        return np.asarray(eye[:2] + (at[:, :2] - eye[:2]) * (eye[2] / (eye[2] - at[:, 2]))[:, None])

    return plate.mapped(cast) if plate else None


def _hidden_by_pillars(marker: Marker, eyes: Array) -> NDArray[np.bool_]:
    heights = marker.xyz[:, 2]
    if np.all(heights == heights[0]):
        return eyes[:, 2:] <= heights
    diameters = np.array([point.feature.diameter for point in marker.control_points])
    walls = np.array([pillar_radius(diameter, marker.clearance) for diameter in diameters])
    return np.stack([sight_gaps(marker.xyz, diameters / 2, walls, eye[None])[0].min(axis=-1) < -1e-9 for eye in eyes])


def eyes_of(poses: PoseDistribution) -> Array:
    """Return the camera centers (P, 3) in m in the marker frame, -R't."""
    return -np.einsum("pji,pj->pi", poses.rotation, poses.translation)
