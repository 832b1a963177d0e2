"""Synthetic views of a marker, detected like photos and compared with the truth, and pictures of some of them."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect import Detection, detect
from markergen.detect.photometric import check_refinement, refine
from markergen.detect.presentation import overlay
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.render import DEFAULT_OPTICS, Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, hiding
from markergen.validation.print_error import misprinted

Array = NDArray[np.float64]

WRONG_PX = 5.0
"""Maximum distance in px of a dot from its true position; beyond it, the detection has a wrong label."""

MOST_VIEWS = 1_000_000

FAILURES, WORST, TYPICAL = 6, 3, 3
"""Maximum number of pictures of each kind."""


@dataclass(frozen=True, eq=False)
class SyntheticViews:
    """Parameters of a series of synthetic views; equal ones give the same images in any process at any time.

    Attributes
    ----------
    marker : Marker
    camera : Camera
    poses : PoseDistribution
    count : int
        Number of views; one pose is drawn from each of `count` equal stretches of the distribution, so that poses
        repeat, with other noise, if it has fewer. May be 0.
    seed : int
    optics : Optics
    background : str
        ``plain``: unbounded substrate; or a name from render's table of backgrounds.
    hidden : int
        Number of covered dots, chosen anew for every view.
    errors : ErrorSources
        `print_sigma` displaces every dot of every view's print, except measured dots, which are displaced by their
        covariance instead; the detection's covariance accounts for all of it.
    refine : str
        ``none`` or ``photometric``.

    Raises
    ------
    InputError
        If a number is out of range, a name is unknown, or a dot has no size.
    """

    marker: Marker
    camera: Camera
    poses: PoseDistribution
    count: int = 20
    seed: int = 0
    optics: Optics = DEFAULT_OPTICS
    background: str = "plain"
    hidden: int = 0
    errors: ErrorSources = field(default_factory=lambda: ErrorSources(print_sigma=0.0))
    refine: str = "none"

    def __post_init__(self) -> None:
        if not 0 <= self.count <= MOST_VIEWS:
            raise InputError(f"0 to {MOST_VIEWS} views", f"views={self.count}", "give --views a number such as 100")
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")
        if self.count and min(point.feature.diameter for point in self.marker.control_points) == 0:
            raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
        if not 0 <= self.hidden <= len(self.marker):
            raise InputError(f"0 to {len(self.marker)} hidden dots", f"hidden={self.hidden}", "hide fewer dots")
        if self.background != "plain":
            _ = BACKGROUNDS[self.background]
        check_refinement(self.refine)

    def pose_of(self, k: int) -> int:
        """Return the index into the pose distribution for view k."""
        jitter = np.random.default_rng([self.seed, self.count, k, 3]).random()
        return int((k + jitter) * len(self.poses) / self.count)


@dataclass(frozen=True, eq=False)
class View:
    """One synthetic image, the detection in it, and the truth.

    Attributes
    ----------
    index, pose : int
        Number of the view in its series, and of its pose in the distribution.
    image : array (height, width)
    detection : Detection
    truth : array (n, 2), px
        Images of the dots' centers as printed, including the print error.
    hidden : array (h,) of int
        Indices of the covered control points.
    """

    index: int
    pose: int
    image: NDArray[np.uint8] | NDArray[np.uint16]
    detection: Detection
    truth: Array
    hidden: NDArray[np.intp]
    ids: NDArray[np.intp]

    @property
    def found(self) -> NDArray[np.intp]:
        """Indices (m,) of the detected control points, in the order of the detection."""
        order = np.argsort(self.ids)
        return order[np.searchsorted(self.ids, self.detection.ids, sorter=order)]

    @property
    def error(self) -> Array:
        """Errors (m, 2) in px of the detected control points; empty if there are none."""
        return self.detection.pixels - self.truth[self.found]

    @property
    def uncorrected_px(self) -> Array:
        """Distances (m,) in px of the ellipse centers from the truth, before the correction for perspective."""
        return np.linalg.norm(self.detection.ellipse_centers - self.truth[self.found], axis=-1)

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
        return self.detection.found and not self.wrong

    @property
    def failure(self) -> str:
        """Reason why it counts as not detected; empty if it was detected."""
        if self.wrong:
            return f"wrong label: a dot is {self.error_px.max():.1f} px off"
        return self.detection.reason


def take_view(series: SyntheticViews, k: int) -> View:
    """Render and detect view k (0 to count - 1) of a series."""
    marker, camera = series.marker, series.camera
    pose = series.pose_of(k)
    rotation, translation = series.poses.rotation[pose], series.poses.translation[pose]
    # Each source has its own random stream, so that switching off the print error changes nothing else.
    noise, misprint, surroundings = (np.random.default_rng([series.seed, series.count, k, part]) for part in range(3))
    printed = misprinted(marker, series.errors, misprint)
    hidden = np.sort(surroundings.choice(len(marker), series.hidden, replace=False))
    scenery = Scenery(
        background=None if series.background == "plain" else BACKGROUNDS[series.background](camera, surroundings),
        occluders=hiding(printed, hidden, camera, rotation, translation, surroundings),
    )
    image = render_view(printed, camera, rotation, translation, series.optics, noise, scenery)
    found = detect(image, marker, camera, series.errors)
    if series.refine == "photometric" and found.found:
        found = refine(image, marker, camera, found, series.errors)
    truth = camera.project(printed.xyz, rotation[None], translation[None])[0]
    ids = np.array([point.id for point in marker.control_points], dtype=np.intp)
    return View(k, pose, image, found, truth, hidden, ids)


@dataclass(frozen=True)
class Picture:
    """A picture with its title and caption.

    Attributes
    ----------
    name : str
        Usable as a file name.
    title, caption : str
    png : bytes
    """

    name: str
    title: str
    caption: str
    png: bytes


def pictures(series: SyntheticViews, views: Mapping[str, Any]) -> Iterator[Picture]:
    """Render views worth a closer look, with the detection drawn in: failures, the worst, and typical ones.

    Parameters
    ----------
    views : mapping
        Summary of the same series by `view_records.summarize`.
    """
    failures = views["failures"]
    # Evenly spaced among all failures, since neighbors look alike.
    for each in spread(failures, FAILURES):
        yield _picture(series, each, "failure", each["reason"])
    ranked = sorted(views["samples"], key=lambda each: -(each["rotation_deg"] or 0.0))
    for each in ranked[:WORST]:
        yield _picture(series, each, "worst", _errors(each))
    for each in spread(ranked[WORST:], TYPICAL):
        yield _picture(series, each, "typical", _errors(each))


def remove_earlier(folder: Path, new: Container[str] = ()) -> None:
    """Remove an earlier run's pictures, recognized by name, from a folder; other files and the new ones stay."""
    for path in folder.iterdir():
        if path.name not in new and re.fullmatch(r"(failure|worst|typical)-\d{4,}\.png", path.name):
            path.unlink()


def spread(items: list[Any], count: int) -> list[Any]:
    """Return at most `count` of the items, evenly spaced."""
    return items if len(items) <= count else [items[(2 * i + 1) * len(items) // (2 * count)] for i in range(count)]


def _errors(each: Mapping[str, Any]) -> str:
    found = f"dots off by {each['point_px_rms']:.4f} px"
    if each["rotation_deg"] is None:
        return found
    return f"{found}, rotation by {each['rotation_deg']:.3f} deg, translation by {each['translation_pct']:.3f} %"


def _picture(series: SyntheticViews, each: Mapping[str, Any], kind: str, said: str) -> Picture:
    view = take_view(series, each["view"])
    where = f"{each['polar_angle_deg']:g} deg at {each['distance']:.3g} m"
    marks = [view.detection] if view.detection.found else []
    return Picture(
        f"{kind}-{each['view']:04d}", f"{kind.capitalize()}: {where}", f"View {each['view']}, {where}: {said}.",
        overlay(view.image, series.marker, series.camera, marks),
    )  # fmt: skip
