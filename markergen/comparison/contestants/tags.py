"""Square tags of ArUco and AprilTag, alone or on each plate of a body, found by cv2.aruco."""
# tests: tests/comparison/test_rig_contestants.py tests/comparison/test_baselines.py tests/comparison/test_compare.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants import (
    KINDS,
    Arena,
    Choice,
    Contestant,
    ContestantKind,
    Image,
    Pose,
    Sighting,
)
from markergen.comparison.contestants.printed import IMAGES, Grey, Lattice, Squares, pose_of
from markergen.comparison.fiducials import (
    TAG_SETTINGS,
    as_taken,
    detect_fiducial,
    enlarged,
    find_tags,
)
from markergen.geometry.region import Region
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.model.tag import Tag, parse_tag
from markergen.render import Patch

_HALVINGS = 50
"""Halvings of the side of the largest square: 2^-50 of a plate is about the rounding of its outline."""


@dataclass(frozen=True, eq=False)
class SquareTag(Squares):
    """A square tag with one white cell around it."""

    name: str
    tag: Tag
    radius: float
    detector = "cv2.aruco"
    detectors: ClassVar[Mapping[str, Any]] = TAG_SETTINGS

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the corners of the black square."""
        return self.tag.corners

    @property
    def lattice(self) -> Lattice:
        """See `Squares.lattice`: one."""
        return Lattice(1, 1, self.tag.side)

    @property
    def spacing(self) -> float:
        """See `Squares.spacing`: a cell."""
        return self.tag.side / self.tag.cells

    @property
    def exact_outlines(self) -> tuple[Array, ...]:
        """See `Squares.exact_outlines`."""
        return self.tag.outlines

    def find(self, image: Grey, camera: Camera, options: Any) -> Sighting:
        """See `Printed.find`."""
        return detect_fiducial(image, self.tag, options, camera)


@dataclass(frozen=True, eq=False)
class TagBody(Contestant):
    """The plates of a body with tags of one family, each as large as its plate allows; one pose from all corners."""

    name: str
    body: Body
    tags: tuple[Tag, ...]
    detector = "cv2.aruco"

    @staticmethod
    def on(body: Body, text: str) -> "TagBody":
        """Put the tag of a text on the first plate of a body, and those of the next ids on the others."""
        unit = parse_tag(text, 1.0)
        sides = [_largest_square(plate.marker.boundary.region) / unit.outer_side for plate in body.plates]
        return TagBody(text, body, tuple(replace(unit, id=unit.id + k, side=side) for k, side in enumerate(sides)))

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the corners of the black squares."""
        corners = [np.column_stack([tag.corners, np.zeros(4)]) for tag in self.tags]
        return np.concatenate([m.to_body(points) for m, points in zip(self.body.plates, corners, strict=True)])

    @property
    def settings(self) -> Mapping[str, Mapping[str, Any]]:
        """See `Contestant.settings`."""
        return {"detector": TAG_SETTINGS, "image": IMAGES}

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        low, high = (1e3 * pick(tag.side for tag in self.tags) for pick in (min, max))
        sides = f"{low:.4g}" if high - low < 1e-6 else f"{low:.4g} to {high:.4g}"
        return f"{len(self.tags)} tags, side {sides} mm"

    def ink(self, radius: float) -> float:
        """See `Contestant.ink`: of all plates."""
        del radius
        return float(sum(tag.ink.mean() * tag.side**2 for tag in self.tags))

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each corner of each square."""
        return np.concatenate([Lattice(1, 1, tag.side).print_error(sigma, rng) for tag in self.tags])

    def by_plate(self, moved: Array) -> list[Array]:
        """See `Contestant.by_plate`."""
        return np.split(moved, len(self.tags))

    def patches(self, camera: Camera, pose: Pose, moved: Array, plate: int = 0) -> list[Patch]:
        """See `Contestant.patches`."""
        del camera, pose
        tag = self.tags[plate]
        regions = self.body.plate_regions[plate].rings, Lattice(1, 1, tag.side).displaced(tag.outlines, moved)
        return [Patch(tuple(np.pad(o, ((0, 0), (0, 1))) for o in region), 1.0 - k) for k, region in enumerate(regions)]

    def sight(self, image: Image, camera: Camera, choice: Choice, print_sigma: float) -> Sighting:
        """See `Contestant.sight`: of tags with one id, the first."""
        del print_sigma
        grey = np.ascontiguousarray(image if image.dtype == np.uint8 else image >> 8, dtype=np.uint8)
        chosen = self.chosen(choice)
        seen = find_tags(enlarged(grey, chosen["image"]), self.tags[0].family, chosen["detector"])
        corners_of = {number - self.tags[0].id: corners for number, corners in reversed(seen)}
        plates = sorted(k for k in corners_of if 0 <= k < len(self.tags))
        if not plates:
            return Sighting(reason="no tag of the rig")
        ids = np.concatenate([4 * k + np.arange(4) for k in plates])
        pixels = as_taken(np.concatenate([corners_of[k] for k in plates]), chosen["image"])
        rotation, translation = self._pose(plates, ids, pixels, camera)
        if not np.isfinite(translation).all():
            return Sighting(reason="points that determine no pose")
        return Sighting(ids, pixels, rotation, translation)

    def _pose(self, plates: Sequence[int], ids: NDArray[np.intp], pixels: Array, camera: Camera) -> Pose:
        """Least-squares pose; in the frame of a plate, where corners of that plate alone are in its plane."""
        plate = self.body.plates[plates[0]]
        points = plate.to_marker(self.points[ids])
        points[np.abs(points) < 1e-9 * self.body.radius] = 0.0
        rotation, translation = pose_of(points, pixels, camera)
        rotated = rotation @ plate.rotation_matrix.T
        return rotated, translation - rotated @ plate.translation_vector


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


def tag_in(text: str, radius: float) -> Tag:
    """Tag as large as a circle of this radius allows, with one white cell around it."""
    unit = parse_tag(text, 1.0)
    return replace(unit, side=sqrt(2) * radius / unit.outer_side)


def _tag(text: str, arena: Arena) -> SquareTag:
    return SquareTag(text, tag_in(text, arena.square), arena.square)


KINDS.register("aruco")(ContestantKind(_tag, "aruco:DICT[:ID]", "ArUco tag", "OpenCV"))
KINDS.register("apriltag")(ContestantKind(_tag, "apriltag:FAMILY[:ID]", "AprilTag", "OpenCV"))
