"""Synthetic views of markers and rigs, detected like photos and compared with the truth; pictures of some of them."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect import Found, detect
from markergen.detect.presentation import overlay
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.model.sight import Coverage, coverage
from markergen.render import DEFAULT_OPTICS, Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, hiding
from markergen.validation.print_error import misprinted

WRONG_PX = 5.0
"""Maximum distance in px of a dot from its true position; beyond it, the detection has a wrong label."""

MOST_VIEWS = 1_000_000
"""Maximum number of views; more are a slip."""

FAILURES, WORST, TYPICAL = 6, 3, 3
"""Maximum number of pictures of each kind."""

LABELS_PX = 60
"""Room in px for the numbers and axes that are drawn beside the dots of a picture."""

B = TypeVar("B", Marker, Rig)


@dataclass(frozen=True, eq=False)
class SyntheticViews(Generic[B]):
    """Parameters of a series of synthetic views; equal ones give the same images in any process at any time.

    Attributes
    ----------
    marker : Marker or Rig
    poses : PoseDistribution
        T_camera_marker or T_camera_rig.
    count : int
        Number of views; one pose is drawn from each of `count` equal stretches of the distribution, so that poses
        repeat, with other noise, if it has fewer. May be 0.
    background : str
        ``plain``: unbounded substrate; or a name from render's table of backgrounds.
    errors : ErrorSources
        `print_sigma` displaces every dot of every view's print, except measured dots, which are displaced by their
        covariance instead, and the plates of a rig by that of their relation; the detection's covariance accounts for
        all of it.
    hidden : int
        Number of covered dots, chosen anew for every view; on a rig, of those in view.

    Raises
    ------
    InputError
        If a number is out of range, a name is unknown, or a dot has no size.
    """

    marker: B
    camera: Camera
    poses: PoseDistribution
    count: int = 20
    seed: int = 0
    optics: Optics = DEFAULT_OPTICS
    background: str = "plain"
    errors: ErrorSources = field(default_factory=lambda: ErrorSources(print_sigma=0.0))
    hidden: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.count <= MOST_VIEWS:
            raise InputError(f"0 to {MOST_VIEWS} views", f"views={self.count}", "give --views a number such as 100")
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")
        if self.background != "plain":
            _ = BACKGROUNDS[self.background]
        if self.count and not self.marker.radii.all():
            raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
        if not 0 <= self.hidden <= len(self.marker):
            raise InputError(f"0 to {len(self.marker)} hidden dots", f"hidden={self.hidden}", "hide fewer dots")

    @cached_property
    def coverage(self) -> Coverage:
        """What each pose shows."""
        return coverage(self.marker, self.camera, self.poses)

    def pose_of(self, k: int) -> int:
        """Return the index into the pose distribution for view k."""
        jitter = np.random.default_rng([self.seed, self.count, k, 3]).random()
        return int((k + jitter) * len(self.poses) / self.count)

    def take(self, k: int) -> "View":
        """Render and detect view k (0 to count - 1).

        Noise, print error and surroundings have their own random streams, so that switching off the print error changes
        nothing else.
        """
        body, camera, pose = self.marker, self.camera, self.pose_of(k)
        rotation, translation = self.poses.rotation[pose], self.poses.translation[pose]
        noise, misprint, surroundings = (np.random.default_rng([self.seed, self.count, k, part]) for part in range(3))
        printed = misprinted(body, self.errors, misprint)
        dots = np.flatnonzero(self.coverage.seen[pose]) if self.hidden and body.frame == "rig" else np.arange(len(body))
        hidden = np.sort(surroundings.choice(dots, min(self.hidden, len(dots)), replace=False))
        behind = None if self.background == "plain" else BACKGROUNDS[self.background](camera, surroundings)
        scenery = Scenery(behind, hiding(printed, hidden, camera, rotation, translation, surroundings))
        image = render_view(printed, camera, rotation, translation, self.optics, noise, scenery)
        detection = detect(image, body, camera, self.errors)
        truth = camera.project(printed.xyz, rotation[None], translation[None])[0]
        return View(k, pose, image, detection, truth, body.ids, hidden)


@dataclass(frozen=True, eq=False)
class View:
    """One synthetic image, the detection in it, and the truth.

    Attributes
    ----------
    index, pose : int
        Number of the view in its series, and of its pose in the distribution.
    image : array (height, width)
    truth : array (n, 2), px
        Images of the dots' centers as printed, including the print error.
    ids : array (n,) of int
        Ids of the dots.
    hidden : array (h,) of int
        Indices of the covered control points.
    """

    index: int
    pose: int
    image: NDArray[np.uint8] | NDArray[np.uint16]
    detection: Found
    truth: Array
    ids: NDArray[np.intp]
    hidden: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    @property
    def found(self) -> NDArray[np.intp]:
        """Indices (m,) of the detected control points, in the order of the detection."""
        order = np.argsort(self.ids)
        return order[np.searchsorted(self.ids, self.detection.ids, sorter=order)]

    @property
    def error(self) -> Array:
        """Errors (m, 2) in px of the detected control points; empty if there are none."""
        return self.detection.pixels[: len(self.found)] - self.truth[self.found]

    @property
    def uncorrected_px(self) -> Array:
        """Distances (m,) in px of the ellipse centers from the truth, before the correction for perspective."""
        return np.linalg.norm(self.detection.ellipse_centers[: len(self.found)] - self.truth[self.found], axis=-1)

    @property
    def error_px(self) -> Array:
        """Distances (m,) in px of the detected control points from the truth."""
        return np.linalg.norm(self.error, axis=-1)

    @property
    def wrong(self) -> bool:
        """True if it was detected with a wrong label."""
        return bool(np.any(self.error_px > WRONG_PX))

    @property
    def detected(self) -> bool:
        """True if it was detected correctly."""
        return self.detection.ok and not self.wrong

    @property
    def failure(self) -> str:
        """Reason why it counts as not detected; empty if it was detected."""
        if self.wrong:
            return f"wrong label: a dot is {self.error_px.max():.1f} px off"
        return self.detection.reason


@dataclass(frozen=True)
class Picture:
    """A picture with its title and caption.

    Attributes
    ----------
    name : str
        Usable as a file name.
    box : tuple of int
        Left, upper, right and lower limit of the part around the marker, in px; None is all.
    """

    name: str
    title: str
    caption: str
    png: bytes
    box: tuple[int, int, int, int] | None = None


def captions(sample: Mapping[str, Any]) -> tuple[str, str]:
    """Where a view of a summary was taken, and how far off it is if it was detected, in words."""
    if "plates" in sample:
        where = f"{sample['plates']} plate{'s' * (sample['plates'] != 1)} in view at {sample['distance']:.3g} m"
    else:
        where = f"tilted by {sample['polar_angle_deg']:.3g} deg at {sample['distance']:.3g} m"
    if "reason" in sample:
        return where, sample["reason"]
    if "plates" in sample:
        off = f"rotation off by {sample['rotation_deg']:.3f} deg, translation by {sample['translation_mm']:.3f} mm"
        return where, f"{len(sample['dots'])} dots, {off}"
    dots = f"dots off by {sample['point_px_rms']:.4f} px"
    if sample["rotation_deg"] is None:
        return where, dots
    rotation_deg, translation_pct = sample["rotation_deg"], sample["translation_pct"]
    return where, f"{dots}, rotation by {rotation_deg:.3f} deg, translation by {translation_pct:.3f} %"


def pictures(series: SyntheticViews[Any], views: Mapping[str, Any]) -> Iterator[Picture]:
    """Render views worth a closer look, with the detection drawn in: failures, the worst, and typical ones.

    Parameters
    ----------
    views : mapping
        Summary of the same series.
    """
    ranked = sorted(views["samples"], key=lambda sample: -(sample["rotation_deg"] or 0.0))
    # Evenly spaced among all failures, since neighbors look alike.
    kinds = {"failure": spread(views["failures"], FAILURES)}
    kinds |= {"worst": ranked[:WORST], "typical": spread(ranked[WORST:], TYPICAL)}
    for kind, samples in kinds.items():
        for sample in samples:
            view, (where, caption) = series.take(sample["view"]), captions(sample)
            marks = [view.detection] if view.detection.ok else []
            yield Picture(
                f"{kind}-{sample['view']:04d}",
                f"{kind.capitalize()}: {where}",
                f"View {sample['view']}, {where}: {caption}.",
                overlay(view.image, marks),
                _around(view.truth, *view.image.shape[1::-1]),
            )


def _around(dots: Array, width: int, height: int) -> tuple[int, int, int, int]:
    """The part of an image, of its own proportions, that dots (n, 2) fill to two thirds; all of it where they do."""
    inside = dots[np.isfinite(dots).all(axis=1)]
    if not len(inside):
        return 0, 0, width, height
    low, high = inside.min(axis=0), inside.max(axis=0)
    share = min(1.0, 1.5 * float(((high - low) / [width, height]).max()) + LABELS_PX / width)
    size = np.ceil(share * np.array([width, height])).astype(int)
    left, upper = map(int, np.clip(np.rint((low + high - size) / 2), 0, [width, height] - size))
    return left, upper, left + int(size[0]), upper + int(size[1])


def remove_earlier(folder: Path, new: Container[str] = ()) -> None:
    """Remove an earlier run's pictures, recognized by name, from a folder; other files and the new ones stay."""
    for path in folder.iterdir():
        if path.name not in new and re.fullmatch(r"(failure|worst|typical)-\d{4,}\.png", path.name):
            path.unlink()


def spread(items: list[Any], count: int) -> list[Any]:
    """Return at most `count` of the items, evenly spaced."""
    return items if len(items) <= count else [items[(2 * i + 1) * len(items) // (2 * count)] for i in range(count)]
