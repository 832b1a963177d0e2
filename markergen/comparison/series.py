"""Views of several contestants, from the same poses with the same noise, and what was found in each."""
# tests: tests/comparison/test_compare.py tests/api/test_compare.py

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants import Contestant, Sighting
from markergen.errors import InputError
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import turn_z
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.render import DEFAULT_OPTICS, Optics
from markergen.validation.metrics import flipped, pose_failed, rotation_error_deg, translation_error_pct
from markergen.validation.views import WRONG_PX

Choice = Any
"""Settings of a contestant's detector, or None for ours."""

VIEWS, TUNING = 0, 1
"""Stages of a comparison, with different views."""


@dataclass(frozen=True, eq=False)
class Series:
    """Views of several contestants, from the same poses with the same noise.

    Attributes
    ----------
    count : int
        Number of views; one pose is drawn from each of `count` equal stretches of the distribution.
    print_sigma : float, m
        Standard deviation along each axis of the printed position of every dot or square corner, drawn anew per view.
    stage : int
        Part of the seed that gives different views for tuning and evaluation.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    contestants: tuple[Contestant, ...]
    camera: Camera
    poses: PoseDistribution
    count: int
    seed: int = 0
    optics: Optics = DEFAULT_OPTICS
    print_sigma: float = 0.0
    stage: int = VIEWS

    def __post_init__(self) -> None:
        if self.count < 1:
            raise InputError("one or more views", f"views={self.count}", "ask for a positive number of views")
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")
        if not (isfinite(self.print_sigma) and self.print_sigma >= 0):
            raise InputError(
                "a print error of 0 or more", f"print_sigma={self.print_sigma} m", "give a length such as 0.1mm"
            )

    @property
    def pose(self) -> NDArray[np.intp]:
        """Index (count,) of each view's pose in the distribution."""
        jitter = np.random.default_rng([self.stage, self.seed, self.count]).random(self.count)
        return ((np.arange(self.count) + jitter) * len(self.poses) / self.count).astype(np.intp)

    def observe(self, who: int, choices: Sequence[Choice], view: int) -> list["Observation"]:
        """Render one view of one contestant and detect it with each of the settings."""
        contestant, pose = self.contestants[who], self.pose[view]
        rotation, translation = self.poses.rotation[pose], self.poses.translation[pose]
        # All contestants share the same pixel noise; print errors have a separate random stream.
        noise, print_rng = np.random.default_rng([self.stage, self.seed, self.count, view]).spawn(2)
        moved = contestant.print_error(self.print_sigma, print_rng)
        image = contestant.render(self.camera, (rotation, translation), self.optics, noise, moved)
        observations = []
        for choice in choices:
            began = time.process_time()
            sighting = contestant.sight(image, self.camera, choice, self.print_sigma)
            seconds = time.process_time() - began
            observations.append(replace(self._judge(contestant, sighting, rotation, translation), cpu_s=seconds))
        return observations

    def _judge(self, contestant: Contestant, sighting: Sighting, rotation: Array, translation: Array) -> "Observation":
        """Compare what was found with the true pose, or, of poses that look the same, with the nearest."""
        if sighting.rotation is None or sighting.translation is None:
            return Observation(reason=sighting.reason)
        turns = [turn_z(2 * np.pi * k / contestant.turns) for k in range(contestant.turns)]
        errors = []
        for turn in turns:
            seen = to_camera(contestant.points[sighting.ids] @ turn.T, rotation[None], translation[None])
            errors.append(np.linalg.norm(sighting.pixels - self.camera.to_pixels(perspective(seen))[0], axis=-1))
        best = int(np.argmin([np.max(error) for error in errors]))
        if errors[best].max() > WRONG_PX:
            return Observation(wrong=True, reason=f"wrong: a point is {errors[best].max():.1f} px off")
        estimate = (sighting.rotation @ turns[best].T)[None], sighting.translation[None]
        te_pct = translation_error_pct(sighting.translation, translation)
        return Observation(
            rotation_deg=float(rotation_error_deg(estimate[0][0], rotation)),
            translation_pct=float(te_pct),
            point_px=errors[best],
            failed=bool(pose_failed(contestant.points, *estimate, np.array([te_pct]))[0]),
            mirrored=bool(flipped(estimate[0], rotation, translation)[0]),
        )

    def bound(self, who: int, view: int) -> tuple[float, float]:
        """Photometric bound of one contestant's exact print in one view, deg and %."""
        return self.contestants[who].bound(self.camera, self.poses.taken(self.pose[[view]], 0), self.optics)


@dataclass(frozen=True, eq=False)
class Observation:
    """Errors and CPU time of one detector in one view; nan and empty if nothing, or something wrong, was found."""

    rotation_deg: float = np.nan
    translation_pct: float = np.nan
    point_px: Array = field(default_factory=lambda: np.zeros(0))
    wrong: bool = False
    failed: bool = False
    mirrored: bool = False
    reason: str = ""
    cpu_s: float = 0.0

    @property
    def detected(self) -> bool:
        """True if the contestant was found correctly."""
        return not self.reason

    @property
    def counts(self) -> bool:
        """True if it was detected and its pose has not failed."""
        return self.detected and not self.failed
