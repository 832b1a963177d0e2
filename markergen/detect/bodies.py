"""Bodies of several constellations: markers with dots of several sizes, and rigs.

A constellation is a set of dots on one plate and of about one size, which is sought by itself, as a flat marker.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.detect.conic_projection import Outlines, outlines
from markergen.detect.pose import PoseEstimate
from markergen.model.marker import Marker
from markergen.model.rig import Rig, RigMarker
from markergen.model.sight import constellations_of

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Target = Marker | Rig


@dataclass(frozen=True, eq=False)
class Plate:
    """Dots of a body on one plate.

    Attributes
    ----------
    placed : RigMarker
        The plate's marker with its pose in the body.
    first : int
        Number of its first dot in the body.
    """

    placed: RigMarker
    first: int

    @property
    def marker(self) -> Marker:
        """Marker on the plate."""
        return self.placed.marker

    @cached_property
    def radii(self) -> Array:
        """Radii (n,) of the dots in m."""
        return np.array([point.feature.diameter / 2 for point in self.marker.control_points])

    def outlines(self, rotation: Array, translation: Array) -> Outlines:
        """Outlines of the dots for poses T_camera_body, (k, 3, 3) and (k, 3)."""
        return outlines(self.marker.xyz, self.radii, *self.placed.camera_pose(rotation, translation))


@dataclass(frozen=True, eq=False)
class Constellation:
    """Dots that are sought together: a marker of them alone, its plate, and their numbers (m,) in the body."""

    marker: Marker
    plate: Plate
    dots: Indices


@dataclass(frozen=True, eq=False)
class Body:
    """What is sought: a marker or a rig, with its plates and constellations; dots are numbered through the plates."""

    target: Target
    plates: tuple[Plate, ...]
    parts: tuple[Constellation, ...]

    @property
    def joined(self) -> bool:
        """False for a marker that is one constellation, which is detected as it is."""
        return isinstance(self.target, Rig) or len(self.parts) > 1

    @cached_property
    def ids(self) -> Indices:
        """Ids (n,) of the dots in results: those of a marker's control points, or their numbers in the rig."""
        if isinstance(self.target, Rig):
            return np.arange(len(self.target))
        return np.array([point.id for point in self.target.control_points], dtype=np.intp)

    @cached_property
    def xyz(self) -> Array:
        """Control points (n, 3) in m, frame of the body."""
        return self.target.xyz

    @cached_property
    def rings(self) -> NDArray[np.bool_]:
        """True (n,) for rings."""
        points = (point for plate in self.plates for point in plate.marker.control_points)
        return np.array([point.feature.kind == "ring" for point in points])

    @cached_property
    def least_px(self) -> Array:
        """Least diameters (n,) in px at which the dots are expected to be seen."""
        points = (point for plate in self.plates for point in plate.marker.control_points)
        return np.array([point.feature.least_pixels for point in points])

    @cached_property
    def owner(self) -> Indices:
        """Index (n,) of each dot's plate."""
        return np.repeat(np.arange(len(self.plates)), [len(plate.marker) for plate in self.plates])

    def outlines(self, pose: PoseEstimate) -> Outlines:
        """Outlines (1, n) of all dots."""
        drawn = [plate.outlines(pose.rotation[None], pose.translation[None]) for plate in self.plates]
        parts = zip(*((each.center, each.point, each.shape, each.seen) for each in drawn), strict=True)
        return Outlines(*(np.concatenate(part, axis=1) for part in parts))

    def facing(self, pose: PoseEstimate) -> Array:
        """Cosine (n,) of the angle between each dot's normal and the way to the camera."""
        place = self.xyz @ pose.rotation.T + pose.translation
        normal = np.array([plate.placed.turn[:, 2] for plate in self.plates])[self.owner] @ pose.rotation.T
        return -np.sum(place * normal, axis=-1) / np.linalg.norm(place, axis=-1)


def body_of(target: Target) -> Body:
    """Take a marker or a rig apart into constellations."""
    if isinstance(target, Marker):
        plates: tuple[Plate, ...] = (
            Plate(RigMarker("marker", target, tuple(map(tuple, np.eye(3))), (0.0, 0.0, 0.0)), 0),
        )
    else:
        first = np.cumsum([0, *(len(each.marker) for each in target.markers)])
        plates = tuple(Plate(each, int(k)) for each, k in zip(target.markers, first, strict=False))
    parts = [
        Constellation(_only(plate.marker, dots), plate, plate.first + dots)
        for plate in plates
        for dots in constellations_of(plate.marker)
    ]
    return Body(target, plates, tuple(parts))


def _only(marker: Marker, dots: Indices) -> Marker:
    """Return the marker with some of its dots alone."""
    if len(dots) == len(marker):
        return marker
    points = tuple(marker.control_points[k] for k in dots)
    joint = marker.joint_covariance
    if joint is None:
        return replace(marker, control_points=points)
    kept = [k for k, number in enumerate(joint.order) if number in {point.id for point in points}]
    axes = len(joint.axes)
    rows = (axes * np.array(kept, dtype=np.intp)[:, None] + np.arange(axes)).ravel()
    order = tuple(joint.order[k] for k in kept)
    matrix = tuple(map(tuple, joint.array[np.ix_(rows, rows)].tolist()))
    return replace(
        marker,
        control_points=points,
        joint_covariance=replace(joint, order=order, matrix=matrix) if kept else None,
    )
