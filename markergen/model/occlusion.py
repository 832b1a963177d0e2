"""Occlusion between raised dots: lines of sight past the cylinders that the dots stand on.

A dot is a disk parallel to the plane z = 0, a pillar an upright cylinder of substrate from that plane to its dot.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution

Array = NDArray[np.float64]

PILLAR_RIM = 0.25
"""Excess of a pillar's radius over its dot's, as a share of the clearance: two pillars leave half the gap free."""


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
    beside = np.abs(offset[..., 0] * unit[..., 1] - offset[..., 1] * unit[..., 0])
    climb = eyes[..., 2] - dots[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.where(climb > 0, np.clip((pillars[..., 2] - dots[..., 2]) / climb, 0.0, 1.0), 1.0)
        slope = dot_radius / length
        # Where the distance grows as fast as the disk shrinks; an eye above the dot sees it best at the dot itself.
        turn = np.where(slope < 1, (along - beside * slope / np.sqrt(1 - slope**2)) / length, 0.0)
    share = np.clip(turn, 0.0, top)
    nearest = np.linalg.norm(offset - share[..., None] * way, axis=-1)
    gap = nearest - (1 - share) * dot_radius - wall_radius
    return Passage(gap, share, (turn >= top) & (top > 0) & (top < 1))


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
    found = passage(
        points[:, None], dot_radius[:, None], points[None], wall_radius[None], eyes[:, None, None]
    )  # fmt: skip
    higher = points[None, :, 2] > points[:, None, 2]
    gaps = np.where(higher & (wall_radius > 0), found.gap, np.inf)
    gaps[eyes[:, 2][:, None] <= points[:, 2]] = -np.inf
    return gaps


def hidden(marker: Marker, poses: PoseDistribution) -> NDArray[np.bool_]:
    """Return which dots (P, n) are partly or wholly hidden by another dot's pillar, or are seen from below.

    A tolerance of a nanometer allows for rounding between neighbors.
    """
    diameters = np.array([point.feature.diameter for point in marker.control_points])
    walls = np.array([pillar_radius(diameter, marker.clearance) for diameter in diameters])
    eyes = eyes_of(poses)
    return np.stack([sight_gaps(marker.xyz, diameters / 2, walls, eye[None])[0].min(axis=-1) < -1e-9 for eye in eyes])


def eyes_of(poses: PoseDistribution) -> Array:
    """Return the camera centers (P, 3) in m in the marker frame, -R't."""
    return -np.einsum("pji,pj->pi", poses.rotation, poses.translation)
