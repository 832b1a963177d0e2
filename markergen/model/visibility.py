"""Whether a camera sees a boundary whole, and if not, why."""

from math import ceil

import numpy as np
from numpy.typing import NDArray

from markergen.maths.projection import perspective, to_camera
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera

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


def silhouette(boundary: Boundary) -> Array:
    """Points (m, 2) of an outline, all in the image if and only if the whole boundary is.

    At least 64 around its convex hull, because a lens bends what is straight, and all corners of the hull.
    """
    import shapely

    outlines = boundary.outlines()
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(np.concatenate(outlines))))[:-1]
    into, out = hull - np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0) - hull
    turn = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=-1))
    # An outline with bays is longer than its hull.
    around = np.linalg.norm(into, axis=-1).sum()
    length = sum(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=-1).sum() for ring in outlines)
    count = RIM_POINTS * max(1, ceil(length / around - 1e-6))
    return np.concatenate([boundary.rim(count), hull[np.abs(turn) > _CORNER]])


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
