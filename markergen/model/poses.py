"""Pose distributions: from where the camera looks at the marker, and whether it then sees the marker whole."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Self

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, among, brief
from markergen.geometry.region import hull
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import turn_z
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.registry import Registry

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

RIM_POINTS = 64
"""Points of the outline that stand for it in visibility checks and in the pose objective."""

SEEN = 0
REASONS = {
    1: "behind the camera",
    2: "from the back",
    3: "beyond what the lens model covers",
    4: "outside the image",
    5: "from below the highest dot",
}
"""Why a pose does not see the marker whole, by code; of several reasons the first."""

_CORNER = 0.1
"""Turn of the outline in rad from which it counts as a corner: more than from a point of a round rim to the next."""

_AT_ONCE = 1_000_000
"""Projected points in one chunk: some 100 MB."""


@dataclass(frozen=True, eq=False)
class PoseDistribution:
    """P poses T_camera_marker: X_camera = R X_marker + t.

    Attributes
    ----------
    name : str
        The preset or file that they come from.
    rotation : array (P, 3, 3)
    translation : array (P, 3), m
    dropped : int
        Poses that were left out because the boundary was not in view.
    doubt : str
        A sentence for the user if the poses look as if they were meant otherwise; mostly empty.
    """

    name: str
    rotation: Array
    translation: Array
    dropped: int = 0
    doubt: str = ""

    def __len__(self) -> int:
        return len(self.rotation)

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
        """Masks (P,) of the poses at each polar angle; more than 12 distinct angles are put in bins of 10 degrees."""
        return _groups(np.round(self.polar_angle_deg, 2), 10.0)

    def by_distance(self) -> dict[str, NDArray[np.bool_]]:
        """Masks (P,) of the poses at each distance in m; more than 12 distinct ones are put in bins of equal width."""
        distance = np.round(self.distance, 4)
        # 1, 2 or 5 times a power of ten, and at most 12 bins.
        width = np.ptp(distance) / 11
        power = 10 ** np.floor(np.log10(width)) if width > 0 else 1.0
        return _groups(distance, next(float(step * power) for step in (1, 2, 5, 10) if step * power >= width))

    def seen_whole(self, boundary: Boundary, camera: Camera, height: float = 0.0) -> Self:
        """Keep the poses from which the whole boundary is seen from its front, in front of the camera, on the sensor.

        Lens distortion is part of it. With a height in m the boundary is seen whole at that height, too, from above it:
        so is whatever stands on it.

        Raises
        ------
        InputError
            If none is left; the message counts why.
        """
        points = raised(silhouette(boundary), height)
        codes = visibility(points, self.rotation, self.translation, camera)
        kept = np.flatnonzero(codes == SEEN)
        if not kept.size:
            counts = Counter(codes.tolist())
            reasons = ", ".join(f"{counts[code]} {words}" for code, words in REASONS.items() if counts[code])
            raise InputError(
                "a pose that sees the whole marker",
                f"none of {len(self)} ({self.name}) for {boundary}: {reasons}",
                self._doubts(points, camera, 0.0)
                or "use a smaller marker, poses farther away, or a camera with a wider view",
            )
        share = kept.size / len(self)
        doubt = self._doubts(points, camera, share) if share < 1 / 2 else self.doubt
        return replace(self.taken(kept, self.dropped + len(self) - kept.size), doubt=doubt)

    def taken(self, indices: NDArray[np.intp], dropped: int) -> Self:
        """Keep the poses with these indices; `dropped` is the count of the result."""
        rotation, translation = self.rotation[indices], self.translation[indices]
        return replace(self, rotation=rotation, translation=translation, dropped=dropped)

    def _doubts(self, points: Array, camera: Camera, share: float) -> str:
        """What may be wrong with poses of which only that share sees the points (m, 2 or 3) whole; empty if nothing."""
        del points, camera, share
        return ""


@dataclass(frozen=True)
class PoseSource:
    """A pose distribution that is asked for by a text: its name in the table, or ``name:arguments``.

    Attributes
    ----------
    make : callable
        Make the poses of the whole text, or refuse it (InputError). The name of what it makes is a text as well, which
        makes the same poses: a marker.json keeps it.
    form : str
        How the text is written, such as ``cone:tilt=A..B,count=N``; empty where the name is all of it.
    """

    make: Callable[[str], PoseDistribution]
    form: str = ""


POSES: Registry[PoseSource] = Registry(
    "pose distribution", "markergen.model.pose_sources", "markergen.poses", PoseSource
)
"""Pose distributions by the name that their text begins with."""


def paper() -> PoseDistribution:
    """The 400 poses of Acuna & Willert (2018): 4 distances x 5 polar angles x 20 azimuths, looking at the center.

    Camera center d (cos a sin p, sin a sin p, cos p); the rows of R are x, y and z = -center/d with x = z x u and
    u = (-sin a, cos a, 0). The 80 frontal poses are four distinct views turned about the optical axis.
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
    # R (-center) lies on the optical axis by construction; the product would leave rounding dust off it.
    return PoseDistribution("paper", rotation, np.stack([zero, zero, distance], axis=-1))


def paper_roll() -> PoseDistribution:
    """The poses of `paper`, each with the camera rolled about its optical axis by a uniform angle, always the same."""
    plain = paper()
    roll = turn_z(np.random.default_rng(0).uniform(0, 2 * np.pi, len(plain)))
    return PoseDistribution("paper-roll", roll @ plain.rotation, plain.translation)


def named_poses(text: str) -> PoseDistribution:
    """Poses of a text for one of `POSES`.

    Raises
    ------
    InputError
        If there is none of that name, or its arguments are unfit.
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
    """Tell whether a text is meant for `named_poses`: it begins with a name of `POSES`."""
    return text.partition(":")[0].strip() in POSES


def pose_forms() -> list[str]:
    """How the text of each of `POSES` is written, those that are a mere name first."""
    forms = {name: POSES[name].form for name in POSES}
    return [*(name for name, form in forms.items() if not form), *filter(None, forms.values())]


def pose_arguments(text: str, known: Sequence[str], form: str) -> dict[str, str]:
    """Arguments of a text ``name:key=value,key=value``, by their keys.

    Raises
    ------
    InputError
        If a key is not one of the `known`, or stands there twice; the message has the `form` to write.
    """
    name, _, rest = text.partition(":")
    given: dict[str, str] = {}
    for item in rest.split(",") if rest.strip() else []:
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or key not in known:
            raise InputError(f"a key of {name.strip()}: {', '.join(known)}", brief(item), f"write {form}")
        if key in given:
            raise InputError(f"{key} once in a {name.strip()}", f"{key} twice", "leave one out")
        given[key] = value
    return given


def _groups(values: Array, width: float) -> dict[str, NDArray[np.bool_]]:
    """Masks of equal values by their text; of bins of that width where more than 12 values are distinct."""
    distinct = np.unique(values)
    if len(distinct) <= 12:
        return {f"{value:g}": values == value for value in distinct}
    bins = np.floor(values / width + 1e-9).astype(int)
    return {f"{i * width:g}..{(i + 1) * width:g}": bins == i for i in np.unique(bins)}


def silhouette(boundary: Boundary) -> Array:
    """Points (m, 2) of an outline, all in the image if and only if the whole boundary is.

    At least 64 around its convex hull, because a lens bends what is straight, and all corners of the hull.
    """
    outlines = boundary.outlines()
    around = hull(np.concatenate(outlines))
    into, out = around - np.roll(around, 1, axis=0), np.roll(around, -1, axis=0) - around
    turn = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=-1))
    # An outline with bays is longer than its hull.
    tight = np.linalg.norm(into, axis=-1).sum()
    length = sum(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=-1).sum() for ring in outlines)
    count = RIM_POINTS * max(1, ceil(length / tight - 1e-6))
    return np.concatenate([boundary.rim(count), around[np.abs(turn) > _CORNER]])


def raised(points: Array, height: float) -> Array:
    """Points (m, 2) in the plane and again at a height in m, (2 m, 3); without a height as they are."""
    if not height:
        return points
    return np.concatenate([np.column_stack([points, np.full(len(points), z)]) for z in (0.0, height)])


def visibility(points: Array, rotation: Array, translation: Array, camera: Camera) -> Codes:
    """Codes (P,) of `REASONS`, or `SEEN` where all points (m, 2 or 3) are in front of the camera and on the sensor.

    From the back is seen what has the camera on the side of the marker's plane to which its normal does not point, and
    a raised dot shows its face to no camera below it.
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
