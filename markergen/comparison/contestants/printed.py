"""Flat patterns of others, black on a white disk: rendering, print errors, and poses from the points found."""
# tests: tests/comparison/test_baselines.py tests/comparison/test_rig_contestants.py

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, log2
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants import Choice, Contestant, Image, Pose, Sighting
from markergen.comparison.fiducials import as_taken, enlarged
from markergen.errors import InputError
from markergen.estimators import ESTIMATORS, Correspondences
from markergen.model.camera import Camera
from markergen.render import Patch, circle
from markergen.render.patches import circle_vertices

Grey = NDArray[np.uint8]

IMAGES = {"image as it is": 1, "image x2": 2, "image x3": 3, "image x4": 4}
"""Factors of enlargement before any detector, by cubic interpolation."""
CORNER_WINDOWS = {
    "its own corners": 0.0,
    **{f"then cornerSubPix, half window {share:g} of the spacing": share for share in (0.15, 0.3, 0.5, 0.7)},
}
"""Half windows of cv2.cornerSubPix in the image as taken, for any detector of corners, in `Squares.spacing`."""
POSES = {"pose by LM": "lm", "pose by IPPE": "ippe", "pose by SQPnP": "sqpnp"}
"""Estimators of the pose: least squares in the image as for ours, OpenCV's own for tags, and one that minimizes the
error in space, as AprilTag's own does."""
_TERMINATION = (3, 200, 1e-3)
"""Termination of cornerSubPix, by count and accuracy; its examples' 30 and 0.1 px stop as far from the minimum as the
desired error."""


class Printed(Contestant):
    """A flat pattern in black on a white disk that contains it with the white it needs.

    Attributes
    ----------
    radius : float
        Radius of the disk, m.
    detectors, refiners : mapping
        Tables of settings of its detector, and of what can be done to the points that it finds.
    """

    radius: float
    body = None
    detectors: ClassVar[Mapping[str, Any]] = {"": None}
    refiners: ClassVar[Mapping[str, Any]] = {"": None}

    @property
    def settings(self) -> Mapping[str, Mapping[str, Any]]:
        """See `Contestant.settings`."""
        return {"detector": self.detectors, "refiner": self.refiners, "image": IMAGES, "pose": POSES}

    @property
    @abstractmethod
    def plane_points(self) -> Array:
        """Points (n, 2) in m that its detector finds."""

    @property
    def points(self) -> Array:
        """See `Contestant.points`."""
        return np.pad(self.plane_points, ((0, 0), (0, 1)))

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each point."""
        return sigma * rng.standard_normal((len(self.points), 2))

    @abstractmethod
    def outlines(self, moved: Array, scale_px: float) -> tuple[Array, ...]:
        """Outlines (m, 2) in m of the ink of a print, to be filled even-odd; `scale_px` is 1 m in px of the image."""

    @abstractmethod
    def find(self, image: Grey, camera: Camera, options: Any) -> Sighting:
        """Find its points in an image, with options from `detectors`."""

    def refine(self, image: Grey, camera: Camera, detection: Sighting, refiner: Any) -> Array | None:
        """Improve the points (m, 2), px, that were found, by a value from `refiners`; None if there is nothing left."""
        del image, camera, refiner
        return detection.pixels

    def patches(self, camera: Camera, pose: Pose, moved: Array, plate: int = 0) -> list[Patch]:
        """See `Contestant.patches`."""
        del plate
        nearest = max(float(pose[1][2]) - self.radius, 0.1 * self.radius)
        # Few different scales, so that what is drawn once serves many views.
        scale_px = 2.0 ** ceil(log2(camera.focal.max() / nearest))
        return _drawn(self, moved, scale_px) if moved.any() else _exact(self, moved.shape, scale_px)

    def sight(self, image: Image, camera: Camera, choice: Choice, print_sigma: float) -> Sighting:
        """See `Contestant.sight`."""
        del print_sigma
        # Most libraries require 8 bits.
        grey = np.ascontiguousarray(image if image.dtype == np.uint8 else image >> 8, dtype=np.uint8)
        chosen = self.chosen(choice)
        factor = chosen["image"]
        detection = self.find(enlarged(grey, factor), camera.scaled(factor), chosen["detector"])
        if detection.reason:
            return detection
        detection = replace(detection, pixels=as_taken(detection.pixels, factor))
        pixels = self.refine(grey, camera, detection, chosen["refiner"])
        if pixels is None:
            return Sighting(reason="nothing to refine")
        rotation, translation = pose_of(self.points[detection.ids], pixels, camera, chosen["pose"])
        if not np.isfinite(translation).all():
            return Sighting(reason="points that determine no pose")
        return Sighting(detection.ids, pixels, rotation, translation)


def _drawn(pattern: Printed, moved: Array, scale_px: float) -> list[Patch]:
    plate = Patch((circle(np.zeros(3), pattern.radius),), 1.0)
    outlines = pattern.outlines(moved, scale_px)
    return [plate, Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in outlines), 0.0)]


@lru_cache(maxsize=64)
def _exact(pattern: Printed, shape: tuple[int, int], scale_px: float) -> list[Patch]:
    return _drawn(pattern, np.zeros(shape), scale_px)


def pose_of(points: Array, pixels: Array, camera: Camera, estimator: str = "lm") -> Pose:
    """Pose from points (m, 3) and their pixels (m, 2) by an entry of `ESTIMATORS`; nan if they determine none."""
    solver: Any = ESTIMATORS[estimator]
    rotation, translation = Correspondences.from_distorted(points, pixels[None], camera).once(solver).best
    return rotation[0], translation[0]


@dataclass(frozen=True)
class Lattice:
    """Corners of squares in rows and columns about the origin, each with its own print error.

    Attributes
    ----------
    columns, rows : int
        Number of squares.
    side : float
        Side of a square, m.
    """

    columns: int
    rows: int
    side: float

    @property
    def inner(self) -> Array:
        """Inner corners ((columns - 1)(rows - 1), 2) in m, row by row from the top left."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        place = np.stack([x.ravel(), y.ravel()], axis=-1)
        return self.side * (place - [self.columns / 2, self.rows / 2]) * [1, -1]

    @property
    def turns(self) -> int:
        """Rotations that turn the inner corners into themselves."""
        return 4 if self.columns == self.rows else 2

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """Displacements (k, 2) in m, row by row from the top left."""
        return sigma * rng.standard_normal(((self.columns + 1) * (self.rows + 1), 2))

    def displaced(self, outlines: tuple[Array, ...], moved: Array) -> tuple[Array, ...]:
        """Outlines (m, 2) of a print; the inside of a square follows its four corners bilinearly."""
        return tuple(outline + self.displacement(outline, moved) for outline in outlines) if moved.any() else outlines

    def displacement(self, points: Array, moved: Array) -> Array:
        """Displacement (m, 2) in m of points in the squares."""
        grid = moved.reshape(self.rows + 1, self.columns + 1, 2)
        place = points / self.side * [1, -1] + [self.columns / 2, self.rows / 2]
        cell = np.clip(np.floor(place), 0, [self.columns - 1, self.rows - 1]).astype(int)
        (u, v), (i, j) = (place - cell).T[..., None], cell.T
        upper = (1 - u) * grid[j, i] + u * grid[j, i + 1]
        lower = (1 - u) * grid[j + 1, i] + u * grid[j + 1, i + 1]
        return np.asarray((1 - v) * upper + v * lower)


class Squares(Printed):
    """A pattern of squares that print errors deform, corner by corner."""

    @property
    @abstractmethod
    def lattice(self) -> Lattice:
        """The squares."""

    refiners: ClassVar[Mapping[str, Any]] = CORNER_WINDOWS

    @property
    @abstractmethod
    def exact_outlines(self) -> tuple[Array, ...]:
        """Outlines (m, 2) in m of the ink of an exact print."""

    @property
    def spacing(self) -> float:
        """Distance in m from a corner to the next along an edge, or to the end of the white beside it."""
        return self.lattice.side

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"side {1e3 * self.lattice.side:.4g} mm"

    def refine(self, image: Grey, camera: Camera, detection: Sighting, refiner: Any) -> Array | None:
        """See `Printed.refine`: by cornerSubPix with a window of each corner's own, a share of its spacing."""
        if not refiner:
            return detection.pixels
        import cv2

        points = self.points[detection.ids]
        rotation, translation = pose_of(points, detection.pixels, camera)
        if not np.isfinite(translation).all():
            return detection.pixels
        across = [points + self.spacing * np.array(step) for step in ((1, 0, 0), (0, 1, 0))]
        ends = [camera.project(end, rotation[None], translation[None])[0] for end in (points, *across)]
        shortest = np.min([np.linalg.norm(end - ends[0], axis=-1) for end in ends[1:]], axis=0)
        # cornerSubPix needs an image that is larger than its window by 5 px.
        windows = np.clip(np.rint(refiner * shortest), 1, (min(image.shape) - 5) // 2).astype(int)
        refined = detection.pixels.astype(np.float32)
        for window in np.unique(windows).tolist():
            rows = windows == window
            corners = refined[rows].reshape(-1, 1, 2)
            refined[rows] = cv2.cornerSubPix(image, corners, (window, window), (-1, -1), _TERMINATION)[:, 0]
        return refined.astype(float)

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each corner of a square."""
        return self.lattice.print_error(sigma, rng)

    def outlines(self, moved: Array, scale_px: float) -> tuple[Array, ...]:
        """See `Printed.outlines`."""
        del scale_px
        return self.lattice.displaced(self.exact_outlines, moved)


def disk_outlines(centers: Array, radius: float, scale_px: float) -> tuple[Array, ...]:
    """Outlines (m, 2) of disks about centers (n, 2), m, as fine as their image needs at `scale_px` px per m."""
    rim = circle(np.zeros(3), radius, circle_vertices(radius * scale_px))[:, :2]
    return tuple(center + rim for center in centers)


def grid_size(text: str, form: str, example: str) -> tuple[int, int, str]:
    """Parse ``KIND:COLUMNSxROWS[:REST]``; returns columns, rows and the rest.

    Raises
    ------
    InputError
        If it is not written so.
    """
    size, _, rest = text.partition(":")[2].partition(":")
    columns, cross, rows = size.partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal() and len(columns) < 4 and len(rows) < 4):
        raise InputError(form, repr(text), f"write for example {example}")
    return int(columns), int(rows), rest


def share_of(text: str, what: str, default: float, low: float, high: float) -> float:
    """Parse a share between two limits, or return the default for empty text.

    Raises
    ------
    InputError
        If it is not a number between them.
    """
    if not text:
        return default
    try:
        share = float(text)
    except ValueError:
        share = float("nan")
    if not low <= share <= high:
        raise InputError(f"{what} of {low:g} to {high:g}", repr(text), f"write for example {default:g}")
    return share
