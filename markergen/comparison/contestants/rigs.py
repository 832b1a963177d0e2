"""Rigs, found by our detector, and the same bodies with a square tag on each plate, found by cv2.aruco."""
# tests: tests/comparison/test_rig_contestants.py

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants.base import Contestant, Image, Pose, Sighting
from markergen.comparison.contestants.layouts import DotMarker
from markergen.comparison.contestants.printed import Lattice
from markergen.comparison.fiducials import FiducialSettings, find_tags, tag_settings
from markergen.detect import detect
from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.estimators.budget import ErrorSources
from markergen.geometry.region import Region
from markergen.model.camera import Camera
from markergen.model.rig import Rig
from markergen.model.tag import Tag, parse_tag
from markergen.render import Optics, Patch, render_view
from markergen.render.view import painted_body, photograph
from markergen.validation.print_error import displaced

_HALVINGS = 50


@dataclass(frozen=True, eq=False)
class RigContestant(Contestant):
    """A rig of any kind; there is no photometric bound for it."""

    name: str
    rig: Rig

    def area(self, radius: float) -> float:
        """See `Contestant.area`: that of all plates."""
        del radius
        return sum(plate.marker.boundary.region.area for plate in self.rig.markers)


@dataclass(frozen=True, eq=False)
class RigOfDots(RigContestant):
    """One of our rigs, found by our detector."""

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the dots' centers."""
        return self.rig.xyz

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"{len(self.rig.markers)} plates, {len(self.rig)} dots"

    def ink(self, radius: float) -> float:
        """See `Contestant.ink`: of all plates."""
        del radius
        return sum(DotMarker("", plate.marker).ink(plate.marker.boundary.radius) for plate in self.rig.markers)

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each dot independently."""
        return np.concatenate([DotMarker("", plate.marker).print_error(sigma, rng) for plate in self.rig.markers])

    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """See `Contestant.render`."""
        parts = [moved[self.rig.owner == k] for k in range(len(self.rig.markers))]
        markers = zip(self.rig.markers, parts, strict=True)
        printed = replace(self.rig, markers=tuple(replace(m, marker=displaced(m.marker, part)) for m, part in markers))
        return render_view(printed, camera, *pose, optics, rng)

    def sight(self, image: Image, camera: Camera, setting: Any, print_sigma: float) -> Sighting:
        """See `Contestant.sight`."""
        del setting
        detection = detect(image, self.rig, camera, ErrorSources(print_sigma=print_sigma))
        if not detection.found or detection.pose is None:
            return Sighting(reason=detection.reason or "no pose")
        return Sighting(detection.ids, detection.pixels, detection.pose.rotation, detection.pose.translation)


@dataclass(frozen=True, eq=False)
class RigOfTags(RigContestant):
    """The plates of a rig with tags of one family, each as large as its plate allows; one pose from all corners."""

    tags: tuple[Tag, ...]

    @staticmethod
    def on(rig: Rig, text: str) -> "RigOfTags":
        """Put the tag of a text on the first plate of a rig, and those of the next ids on the others."""
        unit = parse_tag(text, 1.0)
        sides = [_largest_square(plate.marker.boundary.region) / unit.outer_side for plate in rig.markers]
        return RigOfTags(text, rig, tuple(replace(unit, id=unit.id + k, side=side) for k, side in enumerate(sides)))

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the corners of the black squares."""
        corners = [np.column_stack([tag.corners, np.zeros(4)]) for tag in self.tags]
        return np.concatenate([m.to_body(points) for m, points in zip(self.rig.markers, corners, strict=True)])

    @property
    def settings(self) -> Sequence[Any]:
        """See `Contestant.settings`: those that do not enlarge the image."""
        return [settings for settings in tag_settings() if settings.enlarge == 1]

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        low, high = (1e3 * pick(tag.side for tag in self.tags) for pick in (min, max))
        sides = f"{low:.4g}" if high - low < 1e-6 else f"{low:.4g} to {high:.4g}"
        return f"{len(self.tags)} tags, side {sides} mm"

    def describe(self, setting: FiducialSettings | None) -> str:
        """See `Contestant.describe`."""
        return f"cv2.aruco, {(setting or self.settings[0]).describe(self.tags[0])}"

    def ink(self, radius: float) -> float:
        """See `Contestant.ink`: of all plates."""
        del radius
        return float(sum(tag.ink.mean() * tag.side**2 for tag in self.tags))

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each corner of each square."""
        return np.concatenate([self._lattice(tag).print_error(sigma, rng) for tag in self.tags])

    def render(self, camera: Camera, pose: Pose, optics: Optics, rng: np.random.Generator, moved: Array) -> Image:
        """See `Contestant.render`."""
        parts = np.split(moved, len(self.tags))

        def patches_of(index: int, turn: Array, shift: Array) -> list[Patch]:
            del turn, shift
            ink = self._lattice(self.tags[index]).displaced(self.tags[index].outlines, parts[index])
            outlines = (self.rig.plate_regions[index].rings, ink)
            return [
                Patch(tuple(np.pad(o, ((0, 0), (0, 1))) for o in region), 1.0 - k) for k, region in enumerate(outlines)
            ]

        return photograph(painted_body(self.rig, patches_of, camera, *pose), camera, optics, rng)

    def sight(self, image: Image, camera: Camera, setting: Any, print_sigma: float) -> Sighting:
        """See `Contestant.sight`: of tags with one id, the first."""
        del print_sigma
        grey = np.ascontiguousarray(image if image.dtype == np.uint8 else image >> 8, dtype=np.uint8)
        seen = find_tags(grey, self.tags[0].family, setting or self.settings[0])
        corners_of = {number - self.tags[0].id: corners for number, corners in reversed(seen)}
        plates = sorted(k for k in corners_of if 0 <= k < len(self.tags))
        if not plates:
            return Sighting(reason="no tag of the rig")
        ids = np.concatenate([4 * k + np.arange(4) for k in plates])
        pixels = np.concatenate([corners_of[k] for k in plates])
        rotation, translation = self._pose(plates, ids, pixels, camera)
        if not np.isfinite(translation).all():
            return Sighting(reason="points that determine no pose")
        return Sighting(ids, pixels, rotation, translation)

    def _pose(self, plates: Sequence[int], ids: NDArray[np.intp], pixels: Array, camera: Camera) -> Pose:
        """Least-squares pose; in the frame of a plate, where corners of that plate alone are in its plane."""
        plate = self.rig.markers[plates[0]]
        points = plate.to_marker(self.points[ids])
        points[np.abs(points) < 1e-9 * self.rig.radius] = 0.0
        estimator = ESTIMATORS["lm"]
        assert isinstance(estimator, PoseEstimator)
        batch = Correspondences.from_distorted(points, pixels[None], camera)
        rotation, translation = (part[0] for part in batch.once(estimator).best)
        turned = rotation @ plate.rotation_matrix.T
        return turned, translation - turned @ plate.translation_vector

    def _lattice(self, tag: Tag) -> Lattice:
        return Lattice(1, 1, tag.side)


def _largest_square(region: Region) -> float:
    """Side of the largest upright square about the origin inside a region, to rounding."""
    left, low, right, high = region.box
    inside, outside = 0.0, max(right - left, high - low)
    for _ in range(_HALVINGS):
        middle = (inside + outside) / 2
        half = middle / 2 * (1 - 1e-9)
        fits = region.covers(Region.rectangle(-half, -half, half, half))
        inside, outside = (middle, outside) if fits else (inside, middle)
    return inside
