"""Table of contestants for `compare`, and what each provides: a kind of marker, tag or board is a file of its own."""
# tests: tests/comparison/test_baselines.py tests/comparison/test_rig_contestants.py

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import install
from markergen.model.body import Body
from markergen.model.boundary import Boundary, Circle
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.registry import Registry
from markergen.render import Optics, Patch, expected_levels, render_patches
from markergen.render.view import at_depth, painted_body, photograph
from markergen.validation.bounds import Scene, photometric_bounds

Image = NDArray[np.uint8] | NDArray[np.uint16]
Choice = Mapping[str, str]
"""Row that is taken of each table of a contestant's settings; of those that it does not name, the first."""
Pose = tuple[Array, Array]
"""Rotation (3, 3) and translation (3,), m, of the marker in the camera frame."""

OURS = "our detector"
_INK_PX, _INK_DISTANCE = 500, 1000.0
"""Radius in px at which ink is measured, and distance of the camera in radii, which leaves a perspective of 1e-3."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """Points that a contestant's detector found in one image, and the pose that they determine.

    Attributes
    ----------
    ids : array (m,) of int
        Rows of the contestant's `points` that were found; empty if it was not found.
    pixels : array (m, 2), px
        Pixel centers are at integer coordinates.
    rotation, translation : arrays (3, 3) and (3,), m, or None
        The pose T_camera_marker; None before it is estimated.
    covariance : array (6, 6)
        Of (w, dt), rad and m in the camera frame; nan if its detector reports none.
    reason : str
        Reason why nothing was found; empty otherwise.
    """

    ids: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    pixels: Array = field(default_factory=lambda: np.zeros((0, 2)))
    rotation: Array | None = None
    translation: Array | None = None
    covariance: Array = field(default_factory=lambda: np.full((6, 6), np.nan))
    reason: str = ""


class Contestant(ABC):
    """A marker of any kind, painted on the plates of a body: how to render and detect it and to estimate its pose.

    Attributes
    ----------
    name : str
        Name given by the user.
    absent : str
        Words that say which library is missing, and how to install it; empty if nothing is.
    turns : int
        Number of rotations about z that turn the labels of its points into themselves as far as its detector can tell.
        Of so many poses that look the same to it, the nearest to the true one counts.
    detector : str
        What finds it.
    body : Body or None
        None of a single plate.
    """

    name: str
    body: Body | None
    absent: str = ""
    turns: int = 1
    detector: str = OURS

    @property
    @abstractmethod
    def points(self) -> Array:
        """Points (n, 3) in m that determine the pose, in the marker frame."""

    @property
    def variants(self) -> Sequence["Contestant"]:
        """Patterns of this name from which the best is chosen together with its detector's settings."""
        return (self,)

    @property
    def settings(self) -> Mapping[str, Mapping[str, Any]]:
        """Tables of what can be set, from which the best rows are chosen; empty for our own detector.

        A row is what is shown of a setting, and its value. First in each table is what its library does by default.
        """
        return {}

    def chosen(self, choice: Choice) -> dict[str, Any]:
        """Return the value of the row taken of each table."""
        return {name: rows[choice.get(name, next(iter(rows)))] for name, rows in self.settings.items()}

    @property
    @abstractmethod
    def size(self) -> str:
        """Size, in words."""

    def describe(self, choice: Choice) -> str:
        """Describe how it is detected: its detector with its options, and other rows that are not the first."""
        first = {name: next(iter(rows)) for name, rows in self.settings.items()}
        taken = {name: choice.get(name, row) for name, row in first.items()}
        rows = [row for name, row in taken.items() if row and (name == "detector" or row != first[name])]
        return ", ".join([self.detector, *rows])

    @abstractmethod
    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """Independent displacements (k, 2) in m in one print, of the dots or of the corners of squares."""

    @abstractmethod
    def patches(self, camera: Camera, pose: Pose, moved: Array, plate: int = 0) -> list[Patch]:
        """Patches of one plate, whose print has the errors `moved`, as seen from its pose."""

    def by_plate(self, moved: Array) -> list[Array]:
        """Split errors from `print_error` by plates."""
        return [moved]

    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """Render a print with errors `moved` from `print_error`, seen from a pose; substrate all around."""
        parts = self.by_plate(moved)
        if self.body is None:
            return render_patches(self.patches(camera, pose, moved), camera, *pose, optics, rng)

        def patches_of(plate: int, rotation: Array, translation: Array) -> list[Patch]:
            return self.patches(camera, (rotation, translation), parts[plate], plate)

        return photograph(
            painted_body(self.body, patches_of, camera, *pose), camera, at_depth(optics, camera, pose[1]), rng
        )

    def plate_scene(self, camera: Camera, plate: int = 0) -> Scene:
        """Patches of one plate of an exact print by its pose."""
        exact = self.by_plate(self.print_error(0.0, np.random.default_rng(0)))[plate]
        return lambda rotation, translation: self.patches(camera, (rotation, translation), exact, plate)

    def scene(self, camera: Camera) -> Scene | None:
        """Patches of an exact print by rotation (3, 3) and translation (3,), m; None if it is on several plates."""
        return self.plate_scene(camera) if self.body is None or len(self.body.plates) == 1 else None

    def bound(self, camera: Camera, poses: PoseDistribution, optics: Optics) -> tuple[float, float]:
        """Photometric bound of an exact print in one pose, deg and %; nan if it has no `scene`."""
        scene = self.scene(camera)
        if scene is None:
            return np.nan, np.nan
        bounds = photometric_bounds(scene, camera, poses, optics)
        return float(bounds.rotation_deg[0]), float(bounds.translation_pct[0])

    def room(self, setting: Boundary) -> Boundary:
        """Return what it was drawn in: that of the setting, unless it has its own."""
        return setting

    def area(self, radius: float) -> float:
        """Area in m^2 that it has for its ink: its circle, of this radius if it has no body; of a rig all plates."""
        if self.body is None or self.body.frame == "marker":
            return np.pi * self.room(Circle(radius)).radius ** 2
        return sum(plate.marker.boundary.region.area for plate in self.body.plates)

    def ink(self, radius: float) -> float:
        """Area in m^2 that is ink, inside circles about the plates' origins, of this radius if there is no body."""
        radii = [radius] if self.body is None else [plate.marker.boundary.radius for plate in self.body.plates]
        return sum(self._ink(radius, plate) for plate, radius in enumerate(radii))

    def _ink(self, radius: float, plate: int) -> float:
        focal = _INK_PX * _INK_DISTANCE
        camera = Camera(2 * _INK_PX + 1, 2 * _INK_PX + 1, focal, focal, _INK_PX, _INK_PX)
        pose = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, _INK_DISTANCE * radius])
        sharp = Optics(blur_px=0, noise_grey=0, dark=0, light=255)
        level = expected_levels(self.plate_scene(camera, plate)(*pose), camera, *pose, sharp)
        x, y = np.meshgrid(*[np.arange(2 * _INK_PX + 1) - _INK_PX] * 2)
        inside = x**2 + y**2 <= (_INK_PX + 0.5) ** 2
        return float(np.sum(1 - level[inside] / 255.0, dtype=float)) * (radius / _INK_PX) ** 2

    @abstractmethod
    def sight(self, image: Image, camera: Camera, choice: Choice, print_sigma: float) -> Sighting:
        """Detect it and estimate its pose."""


@dataclass(frozen=True, eq=False)
class Absent(Contestant):
    """A contestant whose library is not installed: it keeps its row, and says what to install."""

    name: str
    absent: str
    body = None

    @property
    def points(self) -> Array:
        """See `Contestant.points`: none."""
        return np.zeros((0, 3))

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return "not compared"

    def describe(self, choice: Choice) -> str:
        """See `Contestant.describe`."""
        del choice
        return self.absent

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: none."""
        del sigma, rng
        return np.zeros((0, 2))

    def patches(self, camera: Camera, pose: Pose, moved: Array, plate: int = 0) -> list[Patch]:
        """See `Contestant.patches`: none."""
        del camera, pose, moved, plate
        return []

    def sight(self, image: Image, camera: Camera, choice: Choice, print_sigma: float) -> Sighting:
        """See `Contestant.sight`: nothing."""
        del image, camera, choice, print_sigma
        return Sighting(reason=self.absent)


@dataclass(frozen=True, eq=False)
class Arena:
    """What all contestants of one comparison share.

    Attributes
    ----------
    setting : Setting
        Boundary, camera and poses.
    first : Marker or None
        The first marker, whose dots the common layouts get.
    seed : int
        Seed for the random layouts.
    """

    setting: Setting
    first: Marker | None = None
    seed: int = 0

    def scale(self, width: float, height: float, reach: float = 0.0) -> float:
        """Largest scale at which a pattern of this width and height fits in the room, wherever and however turned.

        In a disk it is limited by `reach`, the distance of its farthest point from its middle; by default, that of a
        corner.
        """
        room = self.setting.boundary
        if isinstance(room, Circle):
            return room.radius / (reach or hypot(width, height) / 2)
        return room.region.largest_rectangle(width, height)

    @property
    def square(self) -> float:
        """Radius in m of the circle around the largest square in the room."""
        return self.scale(sqrt(2), sqrt(2), 1.0)


@dataclass(frozen=True)
class ContestantKind:
    """A kind of contestant, given by text: its name in the table, or ``name:arguments``.

    Attributes
    ----------
    make : callable
        Makes a contestant from the whole text and the arena. An ImportError means that its library is not installed.
    form : str
        How to write it, such as ``aruco:DICT[:ID]``.
    summary : str
        What it is, in a few words.
    detector : str
        What it is detected by; ours come first in lists.
    requires : str
        Distribution that has its detector; empty if markergen itself requires that. Such kinds come last in lists.
    """

    make: Callable[[str, Arena], Contestant]
    form: str
    summary: str
    detector: str = OURS
    requires: str = ""

    def __call__(self, text: str, arena: Arena) -> Contestant:
        """Make the contestant; without its library an `Absent` one.

        Raises
        ------
        InputError
            If the text has not the form.
        """
        try:
            return self.make(text, arena)
        except ImportError:
            return Absent(text, f"needs {self.requires}: {install('peers')}")


KINDS: Registry[ContestantKind] = Registry("contestant", "markergen.comparison.contestants", entry=ContestantKind)
"""Kinds of contestants by the first word of their text."""


def listed() -> list[tuple[str, str]]:
    """Return the form of every kind, and what it is and how it is detected."""
    kinds = sorted((bool(kind.requires), kind.detector != OURS, name) for name, kind in KINDS.items())
    rows = [(KINDS[name].form, f"{KINDS[name].summary}, by {KINDS[name].detector}") for *_, name in kinds]
    rig = "a rig, against other rigs, and ArUco and AprilTag tags on each of its plates"
    return [("MARKER.json", f"a marker of dots, by {OURS}"), *rows, ("RIG.json", rig)]


def forms() -> str:
    """Return all forms of a contestant in one line."""
    return ", ".join(form for form, _ in listed())
