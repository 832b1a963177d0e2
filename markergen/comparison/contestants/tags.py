"""Square tags of ArUco and AprilTag, detected by cv2.aruco."""
# tests: tests/comparison/test_baselines.py tests/comparison/test_compare.py

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants.base import KINDS, Arena, Kind
from markergen.comparison.contestants.printed import Grey, Lattice, Printed
from markergen.comparison.fiducials import FiducialDetection, FiducialSettings, detect_fiducial, tag_settings
from markergen.model.camera import Camera
from markergen.model.tag import Tag, parse_tag


@dataclass(frozen=True, eq=False)
class SquareTag(Printed):
    """A square tag with one white cell around it."""

    name: str
    tag: Tag
    radius: float

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the corners of the black square."""
        return self.tag.corners

    @property
    def settings(self) -> Sequence[Any]:
        """See `Contestant.settings`."""
        return tag_settings()

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"side {1e3 * self.tag.side:.4g} mm"

    @property
    def lattice(self) -> Lattice:
        """The one square that print errors deform."""
        return Lattice(1, 1, self.tag.side)

    def describe(self, setting: FiducialSettings | None) -> str:
        """See `Contestant.describe`."""
        return f"cv2.aruco, {(setting or self.settings[0]).describe(self.tag)}"

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each corner of the square."""
        return self.lattice.print_error(sigma, rng)

    def outlines(self, moved: Array, scale_px: float) -> tuple[Array, ...]:
        """See `Printed.outlines`."""
        del scale_px
        return self.lattice.displaced(self.tag.outlines, moved)

    def find(self, image: Grey, camera: Camera, setting: Any) -> FiducialDetection:
        """See `Printed.find`."""
        return detect_fiducial(image, self.tag, setting, camera)


def tag_in(text: str, radius: float) -> Tag:
    """Tag as large as a circle of this radius allows, with one white cell around it."""
    unit = parse_tag(text, 1.0)
    return replace(unit, side=sqrt(2) * radius / unit.outer_side)


def _tag(text: str, arena: Arena) -> SquareTag:
    return SquareTag(text, tag_in(text, arena.square), arena.square)


KINDS.register("aruco")(Kind(_tag, "aruco:DICT[:ID]", "ArUco tag", "OpenCV"))
KINDS.register("apriltag")(Kind(_tag, "apriltag:FAMILY[:ID]", "AprilTag", "OpenCV"))
