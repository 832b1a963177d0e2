"""Contestants to compare a marker with: other markers, common layouts, tags and boards, all of one size.

`line_up` makes contestants from user input. Each contestant is rendered, detected by its own detector, and its pose
estimated.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, pi, sin, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.detect import detect
from markergen.detect.fiducials import Fiducial, FiducialSettings, board_settings, detect_fiducial, tag_settings
from markergen.errors import InputError
from markergen.estimators import Correspondences
from markergen.estimators.budget import ErrorSources
from markergen.estimators.lm import LM
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.marker import Marker, build_marker, check_supported, light_marker
from markergen.model.marker_json import read_marker
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.model.tag import Board, Tag, parse_tag
from markergen.objectives import Setting
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.dot_size import CLEARANCE, ROOM, choose_dots
from markergen.optimize.problem import FeasibleRegion
from markergen.read.poses import poses_from
from markergen.render import Optics, Patch, circle, render_patches, render_view
from markergen.units import format_length
from markergen.validation.print_error import displaced, displacement
from markergen.validation.validation import median_layout, setting_of

Array = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]
Pose = tuple[Array, Array]
"""Rotation (3, 3) and translation (3,), m, of the marker in the camera frame."""

LAYOUTS = ("ngon", "square", "random")
TAGS = ("aruco", "apriltag", "charuco")
FORMS = "MARKER.json, ngon:N, square, random:N, aruco:DICT[:ID], apriltag:FAMILY[:ID], charuco:CxR[:DICT]"
PEERS = ("aruco:DICT_4X4_50", "apriltag:36h11", "charuco:5x5")
DEFAULTS = (*LAYOUTS, *PEERS)
"""Default opponents of a single contestant."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """Points and pose that a contestant's detector found in one image.

    Attributes
    ----------
    ids : array (m,) of int
        Rows of the contestant's `points` that were found; empty if it was not found.
    pixels : array (m, 2), px
    rotation, translation : arrays (3, 3) and (3,), m, or None
        The pose T_camera_marker.
    reason : str
        Reason why nothing was found; empty otherwise.
    """

    ids: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    pixels: Array = field(default_factory=lambda: np.zeros((0, 2)))
    rotation: Array | None = None
    translation: Array | None = None
    reason: str = ""


class Contestant(ABC):
    """A marker of any kind: how to render and detect it and to estimate its pose.

    Attributes
    ----------
    name : str
        Name given by the user.
    """

    name: str

    @property
    @abstractmethod
    def points(self) -> Array:
        """Points (n, 3) in m that determine the pose, in the marker frame."""

    @property
    def settings(self) -> Sequence[FiducialSettings]:
        """Candidate detector settings, of which the best is chosen; empty for our own detector."""
        return ()

    @property
    @abstractmethod
    def size(self) -> str:
        """Size, in words."""

    def describe(self, setting: FiducialSettings | None) -> str:
        """Describe how it is detected."""
        del setting
        return "our detector"

    @abstractmethod
    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """Independent displacements (k, 2) in m in one print, of the dots or of the corners of squares."""

    @abstractmethod
    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """Render a print with errors `moved` from `print_error`, seen from a pose; substrate all around."""

    @abstractmethod
    def sight(self, image: Image, camera: Camera, setting: FiducialSettings | None, print_sigma: float) -> Sighting:
        """Detect it and estimate its pose."""


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
        """See `Contestant.print_error`: each dot independently, measured ones by their covariance."""
        return displacement(self.marker, ErrorSources(print_sigma=sigma), rng, axes=2)

    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """See `Contestant.render`."""
        return render_view(displaced(self.marker, moved), camera, *pose, optics, rng)

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
    """A fiducial tag or board detected by cv2.aruco, in a white disk that contains it with its quiet zone."""

    name: str
    fiducial: Fiducial
    radius: float

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the corners of the tag, or the inner corners of the board."""
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
        """See `Contestant.print_error`: each square corner independently, row by row from the top left."""
        columns, rows, _ = self._squares
        return sigma * rng.standard_normal(((columns + 1) * (rows + 1), 2))

    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """See `Contestant.render`. The inside of a square follows its four corners bilinearly."""
        outlines = self.fiducial.outlines
        if moved.any():
            outlines = tuple(outline + self._displacement(outline, moved) for outline in outlines)
        plate = Patch((circle(np.zeros(3), self.radius),), 1.0)
        ink = Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in outlines), 0.0)
        return render_patches([plate, ink], camera, *pose, optics, rng)

    def sight(self, image: Image, camera: Camera, setting: FiducialSettings | None, print_sigma: float) -> Sighting:
        """See `Contestant.sight`. The pose is from Levenberg-Marquardt over all corners found, like ours."""
        del print_sigma
        # cv2.aruco requires 8 bits.
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
        """Columns and rows of squares, and the side of a square in m."""
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


def line_up(
    texts: Sequence[str],
    poses: str | PoseDistribution | None = None,
    seed: int = 0,
    given: Mapping[str, Marker] | None = None,
) -> tuple[list[Contestant], Setting]:
    """Make contestants from their texts, with the camera and poses that the first marker file was designed for.

    Layouts get dots of the first marker's size, and light ones if it has. If those do not fit, or there is no marker
    file, they get the size that `design` would choose; if a ring of those does not fit, the corresponding share of the
    largest that do. Tags and boards are as large as the same circle allows, a tag with one white cell around it; a
    board needs no white beyond its squares.

    Parameters
    ----------
    texts : sequence of str
        Contestants in the forms of `FORMS`; a single one is compared with `DEFAULTS`.
    poses : str, PoseDistribution or None
        Poses to use instead, in any form that `poses_from` accepts.
    seed : int
        Seed for the random layouts.
    given : mapping or None
        Markers that are not in files, by the texts that stand for them.

    Raises
    ------
    InputError
        If a text has none of the forms, a file is not a marker, the markers differ in size, or a tag does not exist.
    """
    if seed < 0:
        raise InputError("a seed of 0 or more", f"seed={seed}", "give a non-negative whole number")
    if not texts:
        raise InputError("contestants to compare", "none", f"name some: {FORMS}")
    wanted = list(dict.fromkeys([*texts, *DEFAULTS] if len(texts) == 1 else texts))
    known = given or {}
    markers = {
        text: _visible(text, known[text]) if text in known else _read(text)
        for text in wanted
        if text in known or text.split(":")[0] not in (*LAYOUTS, *TAGS)
    }
    first = next(iter(markers.values()), None)
    judged = setting_of(first, poses) if first else _default_setting(poses)
    radius = judged.boundary.radius
    for text, marker in markers.items():
        if abs(marker.boundary.radius - radius) > 1e-9 * radius:
            raise InputError(
                f"markers in circles of one size, here of radius {format_length(radius)}",
                f"{text} with {format_length(marker.boundary.radius)}",
                "design it again with the same --radius",
            )
    # All are judged where the whole circle is visible, whatever their outlines, so that all have the same poses.
    disk = Circle(radius)
    height = max((marker.height for marker in markers.values()), default=0.0)
    setting = Setting(judged.boundary, judged.camera, judged.poses.seen_whole(disk, judged.camera, height))
    found: dict[str, Contestant] = {}
    for text in wanted:
        if text in markers:
            entry: Contestant = DotMarker(text, markers[text])
        elif text.split(":")[0] in LAYOUTS:
            entry = _layout(text, first, setting, seed)
        else:
            entry = Peer(text, _fiducial(text, radius), radius)
        found.setdefault(entry.name, entry)
    return list(found.values()), setting


def _read(text: str) -> Marker:
    path = Path(text)
    if path.suffix.lower() != ".json" and not path.exists():
        raise InputError("a known contestant", repr(text), f"known: {FORMS}")
    return _visible(text, read_marker(path))


def _visible(text: str, marker: Marker) -> Marker:
    check_supported(marker, "to compare")
    if min(point.feature.diameter for point in marker.control_points) == 0:
        raise InputError("dots that can be seen", f"a dot of diameter 0 in {text}", "design it with --dot above 0")
    return marker


def _default_setting(poses: str | PoseDistribution | None) -> Setting:
    spec = Spec()
    seen = poses_from(spec.poses if poses is None else poses).seen_whole(spec.boundary, spec.camera)
    return Setting(spec.boundary, spec.camera, seen)


def _layout(text: str, first: Marker | None, setting: Setting, seed: int) -> DotMarker:
    kind, colon, number = text.partition(":")
    if colon and not (number.isdecimal() and kind != "square"):
        form = "square" if kind == "square" else f"{kind}:N, N a whole number"
        raise InputError(form, repr(text), f"known: {FORMS}")
    n = 4 if kind == "square" else int(number) if colon else len(first) if first else Spec().n
    spec = Spec(n=n, boundary=setting.boundary, camera=setting.camera)
    name = kind if kind == "square" else f"{kind}:{n}"
    sizes = [(first.dot_diameter, first.clearance)] if first else []
    dots = choose_dots(spec, setting.poses)
    for diameter, clearance in [*sizes, (dots.diameter, dots.clearance), _on_a_ring(n, setting.boundary.radius)]:
        region = FeasibleRegion(setting.boundary, diameter, clearance)
        layouts = comparison_layouts(region, n, seed).get(kind)
        if layouts is not None:
            made = build_marker(median_layout(layouts, setting), setting.boundary, diameter, clearance)
            return DotMarker(name, light_marker(made) if first and first.light else made)
    raise InputError(f"room for {name}", f"a {setting.boundary}", "use fewer dots")


def _on_a_ring(n: int, radius: float) -> tuple[float, float]:
    """Diameter and clearance in m of n dots on the inset rim, `ROOM` of the largest that keep their distance.

    Neighbors at 2 (r - d/2 - c) sin(pi/n) are d + c apart, with c the default share of d.
    """
    sine = sin(pi / n)
    largest = 2 * radius * sine / (1 + CLEARANCE + (1 + 2 * CLEARANCE) * sine)
    diameter = float(np.floor(ROOM * largest * 1e4) / 1e4)
    return diameter, CLEARANCE * diameter


def _fiducial(text: str, radius: float) -> Tag | Board:
    if not text.startswith("charuco"):
        unit = parse_tag(text, 1.0)
        return replace(unit, side=sqrt(2) * radius / unit.outer_side)
    _, _, rest = text.partition(":")
    size, _, dictionary = rest.partition(":")
    columns, cross, rows = size.partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise InputError("charuco:COLUMNSxROWS[:DICT]", repr(text), "write for example charuco:5x5:DICT_4X4_50")
    family = f"aruco:{dictionary or 'DICT_4X4_50'}"
    return Board(family, int(columns), int(rows), 2 * radius / hypot(int(columns), int(rows)))
