"""Synthetic views of a marker, detected as a photo would be and held against the truth they were made from."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.detect import Detection, detect
from markergen.detect.photometric import check_refinement, refine
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.render import DEFAULT_OPTICS, Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, hiding
from markergen.validation.misprint import misprinted

Array = NDArray[np.float64]

WRONG_PX = 5.0
"""A detection with any dot farther than this from its true place carries a wrong label."""

MOST_VIEWS = 1_000_000


@dataclass(frozen=True, eq=False)
class Shoot:
    """What decides a series of synthetic views; the same shoot gives the same images, whoever takes them and when.

    Attributes
    ----------
    marker : Marker
    camera : Camera
    poses : PoseDistribution
    count : int
        Views; one pose is drawn from each of `count` equal stretches of the distribution, so poses come again, with
        other noise, where it has fewer. 0 takes none.
    seed : int
    optics : Optics
    background : str
        ``plain``: substrate as far as the eye can see; or a name from render's table of backgrounds.
    hidden : int
        Dots that something lies on, chosen anew in every view.
    errors : ErrorSources
        `print_sigma` displaces every dot of every view's print, and a dot that was measured by what its covariance
        says instead; all are what the detection's covariance allows for.
    refine : str
        ``none`` or ``photometric``.

    Raises
    ------
    InputError
        If a number is out of range, a name unknown, or a dot has no size.
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
        """Index into the pose distribution of view k."""
        jitter = np.random.default_rng([self.seed, self.count, k, 3]).random()
        return int((k + jitter) * len(self.poses) / self.count)


@dataclass(frozen=True, eq=False)
class View:
    """One synthetic image, what was found in it, and what is true.

    Attributes
    ----------
    index, pose : int
        Of the view in its shoot, and of its pose in the distribution.
    image : array (height, width)
    detection : Detection
    truth : array (n, 2), px
        Images of the dots' centers where they were printed, the print's error included.
    hidden : array (h,) of int
        Indices of the control points that something lies on.
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
        """Indices (m,) of the control points that were found, in the order of the detection."""
        order = np.argsort(self.ids)
        return order[np.searchsorted(self.ids, self.detection.ids, sorter=order)]

    @property
    def error(self) -> Array:
        """Errors (m, 2) in px of the control points that were found; empty when none was."""
        return self.detection.pixels - self.truth[self.found]

    @property
    def uncorrected_px(self) -> Array:
        """Distances (m,) in px from the truth of the ellipses' centers, before the correction for perspective."""
        return np.linalg.norm(self.detection.ellipse_centers - self.truth[self.found], axis=-1)

    @property
    def error_px(self) -> Array:
        """Distances (m,) in px of the control points that were found from the true ones."""
        return np.linalg.norm(self.error, axis=-1)

    @property
    def wrong(self) -> bool:
        """Found, but with a wrong label."""
        return bool(np.any(self.error_px > WRONG_PX))

    @property
    def detected(self) -> bool:
        """Found, and right."""
        return self.detection.found and not self.wrong

    @property
    def failure(self) -> str:
        """Why it counts as not detected; empty if it does not."""
        if self.wrong:
            return f"wrong label: a dot is {self.error_px.max():.1f} px off"
        return self.detection.reason


def take_view(shoot: Shoot, k: int) -> View:
    """Render and detect view k (0 to count - 1) of a shoot."""
    marker, camera = shoot.marker, shoot.camera
    pose = shoot.pose_of(k)
    rotation, translation = shoot.poses.rotation[pose], shoot.poses.translation[pose]
    # Each source has its own random numbers, so that a view without print error differs by that alone.
    noise, misprint, surroundings = (np.random.default_rng([shoot.seed, shoot.count, k, part]) for part in range(3))
    printed = misprinted(marker, shoot.errors, misprint)
    hidden = np.sort(surroundings.choice(len(marker), shoot.hidden, replace=False))
    scenery = Scenery(
        background=None if shoot.background == "plain" else BACKGROUNDS[shoot.background](camera, surroundings),
        occluders=hiding(printed, hidden, camera, rotation, translation, surroundings),
    )
    image = render_view(printed, camera, rotation, translation, shoot.optics, noise, scenery)
    found = detect(image, marker, camera, shoot.errors)
    if shoot.refine == "photometric" and found.found:
        found = refine(image, marker, camera, found, shoot.errors)
    truth = camera.project(printed.xyz, rotation[None], translation[None])[0]
    ids = np.array([point.id for point in marker.control_points], dtype=np.intp)
    return View(k, pose, image, found, truth, hidden, ids)
