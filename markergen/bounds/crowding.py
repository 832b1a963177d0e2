"""Images of dots that run together: in which poses, and the gap between dots that prevents it."""
# tests: tests/optimize/test_dot_size.py

import numpy as np

from markergen.arrays import Array
from markergen.bounds.dot_covariances import image_jacobian, image_slopes
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.model.spec import USUAL_IMAGE, ImageNoise

CROWDED, BLOT_PX = 0.05, 1.2
"""Share of the poses in which images of dots may stand less than so many px apart.

Of 100 views each of layouts of 6 to 20 dots, all were found from 1.2 px on, 92 to 96 at 0.85 to 1.15, 65 at 0.87 px in
nearly all poses; a blur of 0.7 px is three quarters of that gap on either side."""

PAIRS = 200_000
"""Number of pairs of dots in images that are looked at at a time."""


def separating_gap(
    places: Array,
    camera: Camera,
    poses: PoseDistribution,
    image: ImageNoise = USUAL_IMAGE,
    pixels: float = BLOT_PX,
    share: float = CROWDED,
) -> float:
    """Gap in m, a whole tenth of a mm, that keeps images of dots so many px apart in all but a share of the poses.

    From one dot to another, L apart, the image moves in one direction, by s or more per meter, s being the smaller
    singular value of `image_slopes`. So images of dots of diameter d are s (L - d) or more apart. s falls with depth
    and obliqueness: it is least at one of the places (k, 2) in m around all dots.

    Raises
    ------
    InputError
        If more poses than that share see the plane edge-on.
    """
    slopes = np.nan_to_num(image_slopes(image_jacobian(places, camera, poses), poses))
    (a, b), (c, d) = np.moveaxis(slopes, (-2, -1), (0, 1))
    larger = (np.hypot(a + d, b - c) + np.hypot(a - d, b + c)) / 2
    narrow = (np.abs(a * d - b * c) / np.maximum(larger, 1e-300)).min(axis=1)
    worst = np.sort(narrow)[int(share * len(poses) + 1e-9)]
    if not worst:
        raise InputError("poses that see dots anywhere on the marker", "edge-on ones", "leave such poses out")
    return float(np.ceil(pixels * image.gap_factor / worst * 1e4 - 1e-6) / 1e4)


def crowding(
    points: Array, diameter: float, camera: Camera, poses: PoseDistribution, image: ImageNoise = USUAL_IMAGE
) -> float:
    """Share of the poses in which images of dots run into each other; 0 if 5 % or less.

    Between two dots of diameter d at a distance L, images s px apart leave a gap of s (1 - d / L).
    """
    if not diameter:
        return 0.0
    first, second = np.triu_indices(len(points), 1)
    apart = np.linalg.norm(points[first] - points[second], axis=-1)
    pixels = camera.project(points, poses.rotation, poses.translation)
    # All at once would take 100 MB for 100 dots.
    parts = np.array_split(pixels, len(pixels) * len(first) // PAIRS + 1)
    gaps = (np.linalg.norm(part[:, first] - part[:, second], axis=-1) * (1 - diameter / apart) for part in parts)
    narrow = np.concatenate([np.nan_to_num(gap).min(axis=1) for gap in gaps])
    share = float(np.mean(narrow < BLOT_PX * image.gap_factor))
    return share if share > CROWDED else 0.0


def crowded(
    points: Array, diameter: float, camera: Camera, poses: PoseDistribution, image: ImageNoise = USUAL_IMAGE
) -> list[str]:
    """Warnings about `crowding`."""
    share = crowding(points, diameter, camera, poses, image)
    if not share:
        return []
    gap = separating_gap(points[:, :2], camera, poses, image)
    remedy = f"use --gap {1e3 * gap:g}mm" if gap < diameter else "use fewer or smaller dots"
    sentence = f"dots look less than {BLOT_PX * image.gap_factor:.2g} px apart in {100 * share:.0f} % of the poses"
    return [f"{sentence}, where images run together: {remedy}"]
