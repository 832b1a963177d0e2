"""How large to print: the extent of the dots' images over the poses, and the diameter that reaches what is wanted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.maths.projection import circle_image, plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.optimize.dot_size import CLEARANCE, PERCENTILE, PIXELS
from markergen.optimize.packing import largest_diameter
from markergen.units import format_length
from markergen.validation.report.words import at, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Extent:
    """The dots' images in one pose.

    Attributes
    ----------
    pose : int
    thinnest_px : float
        Shortest axis in px of any dot's image; 0 where a circle's image is no ellipse.
    center_px : float
        Short axis in px that a dot at the marker's origin has: what the size is chosen by when a marker is designed.
    diameter : float
        What would make the thinnest `PIXELS` px, in m and up to a whole tenth of a mm; inf where nothing does.
    """

    pose: int
    thinnest_px: float
    center_px: float
    diameter: float


@dataclass(frozen=True)
class Advice:
    """What to print for dots of `PIXELS` px in all poses, or in `PERCENTILE` % of them.

    Attributes
    ----------
    worst, most : Extent
        In the pose where the dots are thinnest, and in the one that so many others are no worse than.
    largest : float
        Largest diameter in m at which as many dots fit within the boundary, wherever they are.
    """

    worst: Extent
    most: Extent
    largest: float


def short_axes(marker: Marker, camera: Camera, poses: PoseDistribution, scale: float = 1.0) -> Array:
    """Short axes (P, n) in px of the dots' images, their diameters multiplied by `scale`.

    Exact: of the ellipse that the homography of the dot's own plane makes of its circle, without lens distortion. 0
    where the circle's image is no ellipse.
    """
    radii = scale / 2 * np.array([point.feature.diameter for point in marker.control_points])
    return _short_axes(marker.xyz, radii, camera, poses)


def advise(marker: Marker, camera: Camera, poses: PoseDistribution) -> Advice | None:
    """Advice on the size of the dots; None for bare points."""
    if not min(point.feature.diameter for point in marker.control_points):
        return None
    ranked = np.argsort(short_axes(marker, camera, poses).min(axis=1))
    # A pose that there is, not the mean of two: this many per cent of the poses are at least as good.
    typical = ranked[len(ranked) - int(np.ceil(len(ranked) * PERCENTILE / 100))]
    worst, most = (_extent(marker, camera, poses, int(pose)) for pose in (ranked[0], typical))
    return Advice(worst, most, largest_diameter(marker.boundary, len(marker)))


def sentences(advice: Advice, marker: Marker, poses: PoseDistribution) -> list[str]:
    """The advice in words."""
    now, worst, most = format_length(marker.dot_diameter), advice.worst, advice.most
    where = at(poses.distance[worst.pose], poses.polar_angle_deg[worst.pose])
    found = (
        f"{where} the dot that looks smallest, of {now}, is {number(worst.thinnest_px, 2)} px across its short axis "
        f"({number(worst.center_px, 2)} px at the marker's center)"
    )
    if worst.thinnest_px >= PIXELS:
        enough = f"{format_length(worst.diameter)} would do for the {PIXELS:g} px that detection wants"
        return [f"{found}, the least of all poses: large enough, {enough}."]
    if not np.isfinite(worst.diameter):
        return [f"{where} the image of a dot is no ellipse: no size helps, leave such poses out."]
    said = [f"{found}: use {format_length(worst.diameter)} for the {PIXELS:g} px that detection wants."]
    share = f"{PERCENTILE:g} % of the poses"
    if most.thinnest_px >= PIXELS:
        said.append(f"For {share} {now} is enough: {number(most.thinnest_px, 3)} px or more.")
    else:
        said.append(
            f"For {share} {format_length(most.diameter)} would do; now it is {number(most.thinnest_px, 2)} px there. "
            "Smaller dots are found as well, down to about 6 px, but with less margin."
        )
    room = format_length(np.floor(advice.largest * 1e4) / 1e4)
    if worst.diameter > advice.largest:
        factor = worst.diameter / marker.dot_diameter
        said.append(
            f"With a clearance of {100 * CLEARANCE:g} % of their diameter, {len(marker)} dots of up to {room} fit in "
            f"this boundary. For larger ones scale the whole marker to {100 * factor:.0f} %, come nearer, or use a "
            "longer focal length."
        )
    else:
        said.append(
            f"Up to {room} there is room for {len(marker)} dots in this boundary: design it again with "
            f"--dot {worst.diameter * 1e3:.6g}mm. Larger dots are measured better, but sit closer together."
        )
    return said


def _extent(marker: Marker, camera: Camera, poses: PoseDistribution, pose: int) -> Extent:
    one = PoseDistribution("one", poses.rotation[[pose]], poses.translation[[pose]])
    center = _short_axes(np.zeros((1, 3)), np.array([marker.dot_diameter / 2]), camera, one)
    thinnest = float(short_axes(marker, camera, one).min())
    extent, scale = thinnest, 1.0
    # The extent is nearly proportional to the diameter, so each step leaves next to nothing of the rest.
    for _ in range(4):
        if not extent:
            return Extent(pose, thinnest, float(center[0, 0]), np.inf)
        scale *= PIXELS / extent
        extent = float(short_axes(marker, camera, one, scale).min())
    diameter = float(np.ceil(scale * marker.dot_diameter * 1e4 - 1e-6) / 1e4)
    return Extent(pose, thinnest, float(center[0, 0]), diameter)


def _short_axes(points: Array, radii: Array, camera: Camera, poses: PoseDistribution) -> Array:
    # A raised dot's circle lies in a plane of its own, so much nearer along the marker's z axis.
    lifted = poses.translation[:, None] + points[:, 2, None] * poses.rotation[:, None, :, 2]
    rotation = np.broadcast_to(poses.rotation[:, None], (*lifted.shape, 3))
    _, semi, _ = circle_image(points[:, :2], radii, plane_homography(rotation, lifted, camera.ideal.matrix))
    return np.asarray(np.nan_to_num(2 * semi[..., 1]))
