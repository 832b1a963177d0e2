"""Who takes part in a comparison: our markers, and the tags and boards of others, each with its own detector."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.detect import detect
from markergen.detect.fiducials import Fiducial, FiducialSettings, board_settings, detect_fiducial, tag_settings
from markergen.estimators import Correspondences
from markergen.estimators.budget import ErrorSources
from markergen.estimators.lm import LM
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.tag import Tag
from markergen.render import Optics, Patch, circle, render_patches, render_view
from markergen.validation.misprint import displaced, displacement

Array = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Sighting:
    """What a contestant's detector made of one image.

    Attributes
    ----------
    ids : array (m,) of int
        Rows of the contestant's `points` that were found; empty when not found.
    pixels : array (m, 2), px
    rotation, translation : arrays (3, 3) and (3,), m, or None
        The pose T_camera_marker.
    reason : str
        Why nothing was found; empty otherwise.
    """

    ids: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    pixels: Array = field(default_factory=lambda: np.zeros((0, 2)))
    rotation: Array | None = None
    translation: Array | None = None
    reason: str = ""


class Contestant(ABC):
    """A marker of any kind: how it is rendered, found, and turned into a pose.

    Attributes
    ----------
    name : str
        As the user calls it.
    """

    name: str

    @property
    @abstractmethod
    def points(self) -> Array:
        """Points (n, 3) in m that the pose is estimated from, in the marker frame."""

    @property
    def settings(self) -> Sequence[FiducialSettings]:
        """Settings of the detector to choose from by their results; none for our own."""
        return ()

    @property
    @abstractmethod
    def size(self) -> str:
        """How large it is, in words."""

    def describe(self, setting: FiducialSettings | None) -> str:
        """Say in words how it is looked for."""
        del setting
        return "our detector"

    @abstractmethod
    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """Displacements (k, 2) in m of what is displaced by itself in one print: dots, or corners of squares."""

    @abstractmethod
    def render(
        self,
        camera: Camera,
        rotation: Array,
        translation: Array,
        optics: Optics,
        rng: np.random.Generator,
        moved: Array,
    ) -> Image:
        """Image of a print with the errors `moved` from `print_error`, substrate all around."""

    @abstractmethod
    def sight(self, image: Image, camera: Camera, setting: FiducialSettings | None, print_sigma: float) -> Sighting:
        """Find it and estimate its pose."""


@dataclass(frozen=True, eq=False)
class DotMarker(Contestant):
    """One of our markers, found by our detector."""

    name: str
    marker: Marker

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the dots' centers."""
        return self.marker.xyz

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"{len(self.marker)} dots of {1e3 * self.marker.dot_diameter:g} mm"

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: every dot by itself, those that were measured by their covariance."""
        return displacement(self.marker, ErrorSources(print_sigma=sigma), rng, axes=2)

    def render(
        self,
        camera: Camera,
        rotation: Array,
        translation: Array,
        optics: Optics,
        rng: np.random.Generator,
        moved: Array,
    ) -> Image:
        """See `Contestant.render`."""
        return render_view(displaced(self.marker, moved), camera, rotation, translation, optics, rng)

    def sight(self, image: Image, camera: Camera, setting: FiducialSettings | None, print_sigma: float) -> Sighting:
        """See `Contestant.sight`."""
        del setting
        found = detect(image, self.marker, camera, ErrorSources(print_sigma=print_sigma))
        if not found.found or found.pose is None:
            return Sighting(reason=found.reason or "no pose")
        index = {point.id: i for i, point in enumerate(self.marker.control_points)}
        ids = np.array([index[int(i)] for i in found.ids], dtype=np.intp)
        return Sighting(ids, found.pixels, found.pose.rotation, found.pose.translation)


@dataclass(frozen=True, eq=False)
class Peer(Contestant):
    """A tag or board of others, found by cv2.aruco, in a white disk that holds it with its quiet zone."""

    name: str
    fiducial: Fiducial
    radius: float

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the corners of the tag, or the inner ones of the board."""
        return np.pad(self.fiducial.corners, ((0, 0), (0, 1)))

    @property
    def settings(self) -> Sequence[FiducialSettings]:
        """See `Contestant.settings`."""
        return tag_settings() if isinstance(self.fiducial, Tag) else board_settings()

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        if isinstance(self.fiducial, Tag):
            return f"side {1e3 * self.fiducial.side:.4g} mm"
        return f"{len(self.points)} inner corners, squares of {1e3 * self.fiducial.square:.4g} mm"

    def describe(self, setting: FiducialSettings | None) -> str:
        """See `Contestant.describe`."""
        return f"cv2.aruco, {(setting or self.settings[0]).describe(self.fiducial)}"

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: every corner of a square by itself, row by row from the top left."""
        columns, rows, _ = self._squares
        return sigma * rng.standard_normal(((columns + 1) * (rows + 1), 2))

    def render(
        self,
        camera: Camera,
        rotation: Array,
        translation: Array,
        optics: Optics,
        rng: np.random.Generator,
        moved: Array,
    ) -> Image:
        """See `Contestant.render`. What lies within a square follows its four corners bilinearly."""
        outlines = self.fiducial.outlines
        if moved.any():
            outlines = tuple(outline + self._displacement(outline, moved) for outline in outlines)
        plate = Patch((circle(np.zeros(3), self.radius),), 1.0)
        ink = Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in outlines), 0.0)
        return render_patches([plate, ink], camera, rotation, translation, optics, rng)

    def sight(self, image: Image, camera: Camera, setting: FiducialSettings | None, print_sigma: float) -> Sighting:
        """See `Contestant.sight`. The pose is that of Levenberg-Marquardt over all corners found, as ours is."""
        del print_sigma
        # cv2.aruco works on 8 bits.
        grey = image if image.dtype == np.uint8 else image >> 8
        found = detect_fiducial(grey.astype(np.uint8, copy=False), self.fiducial, setting or self.settings[0], camera)
        if not found.found:
            return Sighting(reason=found.reason)
        batch = Correspondences.from_distorted(self.points[found.ids], found.pixels[None], camera)
        rotation, translation = batch.once(LM).best
        if not np.isfinite(translation).all():
            return Sighting(reason="corners that determine no pose")
        return Sighting(found.ids, found.pixels, rotation[0], translation[0])

    @property
    def _squares(self) -> tuple[int, int, float]:
        """Columns and rows of squares, and the side of one in m."""
        if isinstance(self.fiducial, Tag):
            return 1, 1, self.fiducial.side
        return self.fiducial.columns, self.fiducial.rows, self.fiducial.square

    def _displacement(self, points: Array, moved: Array) -> Array:
        columns, rows, side = self._squares
        grid = moved.reshape(rows + 1, columns + 1, 2)
        place = points / side * [1, -1] + [columns / 2, rows / 2]
        cell = np.clip(np.floor(place), 0, [columns - 1, rows - 1]).astype(int)
        (u, v), (i, j) = (place - cell).T[..., None], cell.T
        upper = (1 - u) * grid[j, i] + u * grid[j, i + 1]
        lower = (1 - u) * grid[j + 1, i] + u * grid[j + 1, i + 1]
        return np.asarray((1 - v) * upper + v * lower)
