"""Pose distributions: camera poses relative to the marker, and which of them see the whole marker."""
# tests: tests/model/test_poses.py tests/read/test_poses.py

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.geometry.region import hull
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import rotation_z
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.registry import Registry, door

Codes = NDArray[np.int8]

RIM_POINTS = 64
"""Number of points that represent the outline in visibility checks and in the pose objective."""

# The code of a pose that sees the whole marker.
SEEN = 0
REASONS = {
    1: "behind the camera",
    2: "from the back",
    3: "beyond what the lens model covers",
    4: "outside the image",
    5: "from below the highest dot",
}
"""Reasons why a pose does not see the whole marker, by code; of several, the first applies."""

SMALLEST_WIDTH = 10.0
"""Least plausible width in px of a marker: four dots of 2.5 px, the smallest that are found, do not fit into less."""

_CORNER = 0.1
"""Minimum turn of the outline in rad at a corner: more than between neighboring points of a round rim."""

_AT_ONCE = 1_000_000
"""Number of projected points in one chunk: some 100 MB."""


class Placing(Protocol):
    """Rule for poses in the view of a camera."""

    def placed(self, camera: Camera, points: Array | None) -> tuple[Array, Array]:
        """Rotation (P, 3, 3) and translation (P, 3) of poses that see all points, or without points the origin."""

    def at_distance(self, distance: float) -> "PoseDistribution":
        """The poses from one distance in m."""


@dataclass(frozen=True, eq=False, repr=False)
class Poses:
    """P poses T_camera_marker: X_camera = R X_marker + t.

    Examples
    --------
    >>> import markergen as mg
    >>> poses = mg.Poses.load("cone:tilt=0..60,distance=0.4..1m,count=50")
    >>> len(poses), poses.rotation.shape, poses.translation.shape
    (50, (50, 3, 3), (50, 3))

    Attributes
    ----------
    name : str
        Preset or file that they come from.
    rotation : array (P, 3, 3)
    translation : array (P, 3), m
    dropped : int
        Number of poses left out because the boundary was not in view.
    doubt : str
        Sentence for the user if the poses seem to follow another convention or unit; usually empty.
    weight : array (P,) or None
        How much each pose counts in an aggregate, above 0; None if all count the same.
    placing : Placing or None
        Places poses anywhere in the view of a camera, once it is known; these then look straight at the origin.
    """

    name: str
    rotation: Array
    translation: Array
    dropped: int = 0
    doubt: str = ""
    weight: Array | None = None
    placing: "Placing | None" = None

    @classmethod
    def load(cls, source: Any, **reading: Any) -> "Poses":
        """Make poses from all that the option ``poses`` takes.

        Parameters
        ----------
        source : str, path, array, sequence, DataFrame, callable or Poses
            A text such as ``cone:tilt=0..60``; a file; matrices (k, 4, 4) of T_camera_marker; k pairs of rotation
            vector and translation in m, as ``zip(rvecs, tvecs)`` of OpenCV; a table with the columns of a file; or a
            function that makes one of these from a `numpy.random.Generator`, which is always seeded the same.
        **reading : str or path
            What is known of a file: poses_frame, poses_axes, poses_unit or camera_in_body, as of `markergen.design`.

        Raises
        ------
        InputError
            If it is none of these, or a pose is invalid.
        """
        return door("read.poses.poses_from")(source, **reading)

    def __len__(self) -> int:
        return len(self.rotation)

    def __repr__(self) -> str:
        near, far = (self.distance.min(), self.distance.max()) if len(self) else (0.0, 0.0)
        return f"<Poses: {len(self)} of {self.name}, {near:.3g} to {far:.3g} m away>"

    @property
    def cos_tilt(self) -> Array:
        """Cosine (P,) of the angle between the marker's normal and the direction to the camera."""
        toward = -self.translation / np.linalg.norm(self.translation, axis=-1, keepdims=True)
        return np.sum(self.rotation[:, :, 2] * toward, axis=-1)

    @property
    def polar_angle_deg(self) -> Array:
        """Polar angle (P,) in degrees: 0 is frontal."""
        return np.rad2deg(np.arccos(np.clip(self.cos_tilt, -1.0, 1.0)))

    @property
    def distance(self) -> Array:
        """Distance (P,) in m from the camera to the marker's origin."""
        return np.linalg.norm(self.translation, axis=-1)

    def by_polar_angle(self) -> dict[str, NDArray[np.bool_]]:
        """Return masks (P,) of the poses at each polar angle; if more than 12 are distinct, in bins of 10 degrees.

        Poses from all around, which only a rig has, come in bins of 30 degrees.
        """
        angle = np.round(self.polar_angle_deg, 2)
        return _groups(angle, 10.0 if angle.max(initial=0.0) <= 90 else 30.0)

    def by_distance(self) -> dict[str, NDArray[np.bool_]]:
        """Return masks (P,) of the poses at each distance in m; if more than 12 are distinct, in equal bins.

        The first and the last are named by where distances begin and end, to a tenth of a bin.
        """
        distance = np.round(self.distance, 4)
        # 1, 2 or 5 times a power of ten, and at most 12 bins.
        width = np.ptp(distance) / 11
        power = 10 ** np.floor(np.log10(width)) if width > 0 else 1.0
        rounded = next(float(step * power) for step in (1, 2, 5, 10) if step * power >= width)
        tenth, nearest, farthest = rounded / 10, float(distance.min()), float(distance.max())
        ends = floor(nearest / tenth + 1e-9) * tenth, ceil(farthest / tenth - 1e-9) * tenth
        return _groups(distance, rounded, ends)

    def seen_whole(self, boundary: Boundary, camera: Camera, height: float = 0.0) -> Self:
        """Keep the poses that see the whole boundary from its front, in front of the camera, on the sensor.

        Lens distortion is included. With a height in m, the whole boundary must also be visible at that height, from
        above it, and with it everything that stands on the marker.

        Raises
        ------
        InputError
            If none is left; the message counts the reasons.
        """
        points = raised(silhouette(boundary), height)
        if self.placing is not None:
            return self.placed(camera, points).seen_whole(boundary, camera, height)
        codes = visibility(points, self.rotation, self.translation, camera)
        kept = np.flatnonzero(codes == SEEN)
        if not kept.size:
            counts = Counter(codes.tolist())
            # A bare number is in meters.
            huge = bool((np.linalg.norm(points, axis=-1).max() > 2 * self.distance).all()) and len(self) > 0
            smaller = "give lengths with their unit, such as 80mm, or use" if huge else "use"
            reasons = ", ".join(f"{counts[code]} {reason}" for code, reason in REASONS.items() if counts[code])
            raise InputError(
                "a pose that sees the whole marker",
                f"none of {len(self)} ({self.name}) for {boundary}: {reasons}",
                self._doubts(points, camera, 0.0)
                or f"{smaller} a smaller marker, poses farther away, or a camera with a wider view",
            )
        share = kept.size / len(self)
        doubt = self._doubts(points, camera, share) if share < 1 / 2 else self.doubt
        doubt = f"most poses do not see the whole marker; {doubt}" if doubt and share < 1 / 2 else doubt
        width = 2 * float(np.linalg.norm(points, axis=-1).max() * camera.focal.max() / np.median(self.distance[kept]))
        if width < SMALLEST_WIDTH and not doubt:
            away = f"{np.median(self.distance[kept]):.4g} m"
            doubt = (
                f"from half of the poses, {away} away, the marker is at most {width:.2g} px wide: is the unit another?"
            )
        return replace(self.taken(kept, self.dropped + len(self) - kept.size), doubt=doubt)

    def placed(self, camera: Camera, points: Array | None = None) -> Self:
        """Place poses whose text asks for it anywhere in a camera's view; others are returned unchanged.

        All points (m, 2 or 3) are then in view, or without points the origin.
        """
        if self.placing is None:
            return self
        rotation, translation = self.placing.placed(camera, points)
        return replace(self, rotation=rotation, translation=translation, placing=None)

    def taken(self, indices: NDArray[np.intp], dropped: int) -> Self:
        """Keep the poses with these indices; `dropped` is the count for the result."""
        weight = None if self.weight is None else self.weight[indices]
        rotation, translation = self.rotation[indices], self.translation[indices]
        return replace(self, rotation=rotation, translation=translation, dropped=dropped, weight=weight)

    def _doubts(self, points: Array, camera: Camera, share: float) -> str:
        """Return a possible mistake in poses of which only `share` see all points (m, 2 or 3), or an empty string."""
        del points, camera, share
        return ""


PoseDistribution = Poses
"""The name inside markergen."""


@dataclass(frozen=True)
class PoseSource:
    """A pose distribution specified by text: its name in the table, or ``name:arguments``.

    Attributes
    ----------
    make : callable
        Function that makes the poses for the whole text, or raises InputError. The name of its result is also a text
        that makes the same poses, and is stored in marker.json.
    form : str
        Form of the text, such as ``cone:tilt=A..B,count=N``; empty if it is only the name.
    """

    make: Callable[[str], PoseDistribution]
    form: str = ""


POSES: Registry[PoseSource] = Registry(
    "pose distribution", "markergen.model.pose_sources", "markergen.poses", PoseSource
)
"""Pose distributions by the name at the beginning of their text."""


def paper() -> PoseDistribution:
    """Return the 400 poses of Acuna & Willert (2018): 4 distances x 5 polar angles x 20 azimuths, aimed at the center.

    Camera center d (cos a sin p, sin a sin p, cos p); the rows of R are x, y and z = -center/d with x = z x u and
    u = (-sin a, cos a, 0). The 80 frontal poses are four distinct views rotated about the optical axis.
    """
    distance, polar, azimuth = (
        grid.ravel()
        for grid in np.meshgrid(
            [0.6, 0.9, 1.2, 1.5],
            np.deg2rad([0, 17.5, 35, 52.5, 70]),
            2 * np.pi * np.arange(20) / 20,
            indexing="ij",
        )
    )
    zero = np.zeros_like(azimuth)
    direction = np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=-1)
    z = -direction
    x = np.cross(z, np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=-1))
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    rotation = np.stack([x, np.cross(z, x), z], axis=-2)
    # R (-center) lies on the optical axis by construction; the product would add rounding errors.
    return PoseDistribution("paper", rotation, np.stack([zero, zero, distance], axis=-1))


def paper_roll() -> PoseDistribution:
    """Return the poses of `paper`, each with a random roll about the optical axis, uniform and always the same."""
    plain = paper()
    roll = rotation_z(np.random.default_rng(0).uniform(0, 2 * np.pi, len(plain)))
    return PoseDistribution("paper-roll", roll @ plain.rotation, plain.translation)


def named_poses(text: str) -> PoseDistribution:
    """Make the poses that a text specifies by a name of `POSES`.

    Raises
    ------
    InputError
        If there is no such name, or its arguments are invalid.
    """
    name, colon, _ = text.partition(":")
    name = name.strip()
    if name not in POSES:
        raise InputError("a known pose distribution", brief(text), among(name, POSES, pose_forms()))
    source = POSES[name]
    if colon and not source.form:
        raise InputError(f"nothing behind {name}", brief(text), f"write {name}")
    return source.make(text)


def is_named(text: str) -> bool:
    """Return whether a text is for `named_poses`: it begins with a name of `POSES`."""
    return text.partition(":")[0].strip() in POSES


def pose_forms() -> list[str]:
    """Return the forms of the texts of all `POSES`, those that are only a name first."""
    forms = {name: POSES[name].form for name in POSES}
    return [*(name for name, form in forms.items() if not form), *filter(None, forms.values())]


def pose_arguments(text: str, keys: Sequence[str], form: str) -> dict[str, str]:
    """Parse the arguments of a text ``name:key=value,key=value``.

    Raises
    ------
    InputError
        If a key is not one of the `known`, or is repeated; the message shows the valid `form`.
    """
    name, _, rest = text.partition(":")
    arguments: dict[str, str] = {}
    for item in rest.split(",") if rest.strip() else []:
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or key not in keys:
            raise InputError(f"a key of {name.strip()}: {', '.join(keys)}", brief(item), f"write {form}")
        if key in arguments:
            raise InputError(f"{key} once in a {name.strip()}", f"{key} twice", "leave one out")
        arguments[key] = value
    return arguments


def _groups(values: Array, width: float, ends: tuple[float, float] = (-np.inf, np.inf)) -> dict[str, NDArray[np.bool_]]:
    """Return masks of equal values by their text; if more than 12 are distinct, of bins of a width, within the ends."""
    distinct = np.unique(values)
    if len(distinct) <= 12:
        return {f"{value:g}": values == value for value in distinct}
    bins = np.floor(values / width + 1e-9).astype(int)
    names = {i: f"{max(i * width, ends[0]):g}..{min((i + 1) * width, ends[1]):g}" for i in np.unique(bins)}
    return {name: bins == i for i, name in names.items()}


def silhouette(boundary: Boundary) -> Array:
    """Return points (m, 2) of an outline that are all in the image if and only if the whole boundary is.

    At least 64 around its convex hull, because a lens bends straight lines, and all corners of the hull.
    """
    outlines = boundary.outlines()
    around = hull(np.concatenate(outlines))
    into, out = around - np.roll(around, 1, axis=0), np.roll(around, -1, axis=0) - around
    angle = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=-1))
    # An outline with bays is longer than its hull.
    tight = np.linalg.norm(into, axis=-1).sum()
    length = sum(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=-1).sum() for ring in outlines)
    count = RIM_POINTS * max(1, ceil(length / tight - 1e-6))
    return np.concatenate([boundary.rim(count), around[np.abs(angle) > _CORNER]])


def raised(points: Array, height: float) -> Array:
    """Return points (m, 2) both in the plane and at a height in m, (2 m, 3); without a height, unchanged."""
    if not height:
        return points
    return np.concatenate([np.column_stack([points, np.full(len(points), z)]) for z in (0.0, height)])


def left_out(count: int, dropped: int) -> str:
    """Say how many poses do not see the whole marker, where most of them do not, and what helps; else empty."""
    remedy = "use a smaller marker, poses farther away, or a camera with a wider view"
    missed = f"{dropped} of {count + dropped} poses do not see the whole marker and are left out: {remedy}"
    return missed if dropped > count else ""


def visibility(points: Array, rotation: Array, translation: Array, camera: Camera) -> Codes:
    """Return codes (P,) of `REASONS`, or `SEEN` if all points (m, 2 or 3) are in front of the camera and on the sensor.

    The marker is seen from the back if its normal points away from the camera's side of its plane; a raised dot does
    not show its face to a camera below it.
    """
    size = max(1, _AT_ONCE // len(points))
    chunks = [slice(start, start + size) for start in range(0, len(rotation), size)]
    return np.concatenate(
        [np.zeros(0, dtype=np.int8)]
        + [_visibility(points, rotation[chunk], translation[chunk], camera) for chunk in chunks]
    )


def _visibility(points: Array, rotation: Array, translation: Array, camera: Camera) -> Codes:
    seen = to_camera(points, rotation, translation)
    behind = np.any(seen[..., 2] <= 0, axis=-1)
    # The camera's height above the marker's plane is -R3 . t.
    height = -np.sum(rotation[:, :, 2] * translation, axis=-1)
    back = height <= 0
    below = height <= (points[:, 2].max() if points.shape[-1] == 3 else 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pixels = camera.to_pixels(perspective(seen))
        beyond = np.isnan(pixels).any(axis=(-2, -1))
        outside = ~np.all(camera.sees(pixels), axis=-1)
    return np.select([behind, back, below, beyond, outside], [1, 2, 5, 3, 4], SEEN).astype(np.int8)
