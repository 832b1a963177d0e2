"""Bodies of dots, found by our detector: markers and rigs from files, and common layouts."""
# tests: tests/comparison/test_baselines.py tests/comparison/test_rig_contestants.py tests/comparison/test_compare.py

from dataclasses import dataclass
from math import pi, sin

import numpy as np

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
from markergen.detect import detect
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.marker import Marker, build_marker, light_marker
from markergen.model.rig import Rig
from markergen.model.spec import Spec
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.dot_size import CLEARANCE, ROOM, choose_dots
from markergen.optimize.problem import FeasibleRegion
from markergen.render import Patch, seen_patches
from markergen.validation.print_error import displaced, displacement
from markergen.validation.validation import median_layout


@dataclass(frozen=True, eq=False)
class DotBody(Contestant):
    """One of our markers or rigs, found by our detector."""

    name: str
    body: Marker | Rig

    @property
    def points(self) -> Array:
        """See `Contestant.points`: the dots' centers."""
        return self.body.xyz

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        if self.body.frame == "rig":
            return f"{len(self.body.plates)} plates, {len(self.body)} dots"
        return f"{len(self.body)} dots of {self.body.plates[0].marker.dot_words}"

    def room(self, setting: Boundary) -> Boundary:
        """See `Contestant.room`."""
        return setting if self.body.frame == "rig" else self.body.plates[0].marker.boundary

    def print_error(self, sigma: float, rng: np.random.Generator) -> Array:
        """See `Contestant.print_error`: each dot independently, measured ones by their covariance."""
        errors, plates = ErrorSources(print_sigma=sigma), self.body.plates
        return np.concatenate([displacement(plate.marker, errors, rng, axes=2) for plate in plates])

    def by_plate(self, moved: Array) -> list[Array]:
        """See `Contestant.by_plate`."""
        return np.split(moved, self.body.first[1:])

    def patches(self, camera: Camera, pose: Pose, moved: Array, plate: int = 0) -> list[Patch]:
        """See `Contestant.patches`."""
        printed = displaced(self.body.plates[plate].marker, moved)
        return seen_patches(printed, camera, *pose, margin=float(self.body.margins[plate]))

    def sight(self, image: Image, camera: Camera, choice: Choice, print_sigma: float) -> Sighting:
        """See `Contestant.sight`."""
        del choice
        detection = detect(image, self.body, camera, ErrorSources(print_sigma=print_sigma))
        if not detection.ok or detection.pose is None:
            return Sighting(reason=detection.reason or "no pose")
        row = {number: k for k, number in enumerate(self.body.ids.tolist())}
        rows = np.array([row[int(number)] for number in detection.ids], dtype=np.intp)
        pose = detection.pose
        return Sighting(rows, detection.pixels, pose.rotation, pose.translation, pose.budget.total)


def _layout(text: str, arena: Arena) -> DotBody:
    """Make a common layout with dots of the first marker's size, and light ones if it has.

    If those do not fit, or there is no marker, they get the size that `design` would choose; if a ring of those does
    not fit, the corresponding share of the largest that do.
    """
    first, setting = arena.first, arena.setting
    kind, colon, number = text.partition(":")
    if colon and not (number.isdecimal() and kind != "square"):
        raise InputError("square" if kind == "square" else f"{kind}:N, N a whole number", repr(text), "write it so")
    n = 4 if kind == "square" else int(number) if colon else len(first) if first else Spec().n
    spec = Spec(n=n, boundary=setting.boundary, camera=setting.camera)
    name = kind if kind == "square" else f"{kind}:{n}"
    sizes = [(first.dot_diameter, first.clearance)] if first else []
    dots = choose_dots(spec, setting.poses)
    for diameter, clearance in [*sizes, (dots.diameter, dots.clearance), _on_a_ring(n, setting.boundary)]:
        region = FeasibleRegion(setting.boundary, diameter, clearance)
        layouts = comparison_layouts(region, n, arena.seed).get(kind)
        if layouts is not None:
            median = build_marker(median_layout(layouts, setting), setting.boundary, diameter, clearance)
            return DotBody(name, light_marker(median) if first and first.light else median)
    raise InputError(f"room for {name}", f"a {setting.boundary}", "use fewer dots")


def _on_a_ring(n: int, boundary: Boundary) -> tuple[float, float]:
    """Diameter and clearance in m of n dots on the inset rim, `ROOM` of the largest that keep their distance.

    Neighbors at 2 (r - d/2 - c) sin(pi/n) are d + c apart, with c the default share of d, and r the radius of the
    largest circle in the room.
    """
    center = boundary.region.largest_circle(1e-4 * boundary.radius)
    radius = float(boundary.depth(np.array(center)))
    sine = sin(pi / n)
    largest = 2 * radius * sine / (1 + CLEARANCE + (1 + 2 * CLEARANCE) * sine)
    diameter = float(np.floor(ROOM * largest * 1e4) / 1e4)
    return diameter, CLEARANCE * diameter


KINDS.register("ngon")(ContestantKind(_layout, "ngon:N", "dots on a regular polygon"))
KINDS.register("square")(ContestantKind(_layout, "square", "four dots in a square"))
KINDS.register("random")(ContestantKind(_layout, "random:N", "the median of random layouts"))
