"""Views of contestants from the same poses with the same noise, and what detectors and one refiner make of them."""

# tests: tests/comparison/test_compare.py tests/comparison/test_fmac.py tests/comparison/test_photometric.py

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import isfinite
from typing import Any

import numpy as np

from markergen.arrays import Array, Indices
from markergen.comparison.contestants import Choice, Contestant, Image, Pose, Sighting
from markergen.comparison.tuning import BUDGET, POSE, ROTATION, tune
from markergen.errors import InputError
from markergen.maths.information import apply_pose_step
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import logarithm, rotation_z
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.options import Progress
from markergen.pool import map_counted, workers_for
from markergen.presentation.tables import number, percent
from markergen.render import DEFAULT_OPTICS, Optics, window_of
from markergen.render.optics import FULL_SCALE
from markergen.validation.bounds import Scene, grey_gradient
from markergen.validation.degrees import in_units
from markergen.validation.metrics import flipped, pose_failed, rotation_error_deg, statistics, translation_error_pct
from markergen.validation.views import WRONG_PX

VIEWS, TUNING = 0, 1
"""Stages of a comparison, with different views."""

WORTH_A_WORKER = 60
"""Number of images below which starting another process does not pay."""


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
        if not (isfinite(self.print_sigma) and self.print_sigma >= 0):
            raise InputError(
                "a print error of 0 or more", f"print_sigma={self.print_sigma} m", "give a length such as 0.1mm"
            )

    @property
    def pose(self) -> Indices:
        """Index (count,) of each view's pose in the distribution."""
        jitter = np.random.default_rng([self.stage, self.seed, self.count]).random(self.count)
        return ((np.arange(self.count) + jitter) * len(self.poses) / self.count).astype(np.intp)

    def photograph(self, contestant: Contestant, view: int) -> Image:
        """Render one view of one contestant."""
        # All contestants share the same pixel noise; print errors have a separate random stream.
        noise, print_rng = np.random.default_rng([self.stage, self.seed, self.count, view]).spawn(2)
        moved = contestant.print_error(self.print_sigma, print_rng)
        return contestant.render(self.camera, self._true_pose(view), self.optics, noise, moved)

    def observe(self, contestant: Contestant, choice: Choice, view: int, image: Image) -> "Observation":
        """Judge what one contestant's detector finds in its view."""
        return self._observe(contestant, choice, view, image)[0]

    def observe_and_refine(self, who: int, choice: Choice, view: int) -> tuple["Observation", "Observation"]:
        """Judge what one contestant's detector finds in its view, and the photometric fit that starts there."""
        contestant = self.contestants[who]
        image = self.photograph(contestant, view)
        observation, sighting = self._observe(contestant, choice, view, image)
        scene = contestant.scene(self.camera)
        if scene is None or sighting.rotation is None or sighting.translation is None:
            return observation, observation
        rotation, translation = photometric_fit(
            image, scene, self.camera, (sighting.rotation, sighting.translation), self.optics
        )
        points = contestant.points[sighting.ids]
        pixels = self.camera.project(points, rotation[None], translation[None])[0]
        refined = replace(sighting, pixels=pixels, rotation=rotation, translation=translation)
        return observation, self._judge(contestant, refined, *self._true_pose(view))

    def _observe(
        self, contestant: Contestant, choice: Choice, view: int, image: Image
    ) -> tuple["Observation", Sighting]:
        began = time.process_time()
        sighting = contestant.sight(image, self.camera, choice, self.print_sigma)
        seconds = time.process_time() - began
        return replace(self._judge(contestant, sighting, *self._true_pose(view)), cpu_s=seconds), sighting

    def _true_pose(self, view: int) -> Pose:
        pose = self.pose[view]
        return self.poses.rotation[pose], self.poses.translation[pose]

    def _judge(self, contestant: Contestant, sighting: Sighting, rotation: Array, translation: Array) -> "Observation":
        """Compare what was found with the true pose, or, of poses that look the same, with the nearest."""
        if sighting.rotation is None or sighting.translation is None:
            return Observation(reason=sighting.reason)
        symmetries = [rotation_z(2 * np.pi * k / contestant.turns) for k in range(contestant.turns)]
        errors = []
        for symmetry in symmetries:
            seen = to_camera(contestant.points[sighting.ids] @ symmetry.T, rotation[None], translation[None])
            errors.append(np.linalg.norm(sighting.pixels - self.camera.to_pixels(perspective(seen))[0], axis=-1))
        best = int(np.argmin([np.max(error) for error in errors]))
        if errors[best].max() > WRONG_PX:
            return Observation(wrong=True, reason=f"wrong: a point is {errors[best].max():.1f} px off")
        estimate = (sighting.rotation @ symmetries[best].T)[None], sighting.translation[None]
        off = np.concatenate([logarithm(estimate[0][0] @ rotation.T), estimate[1][0] - translation])
        te_pct = translation_error_pct(sighting.translation, translation)
        return Observation(
            rotation_deg=float(rotation_error_deg(estimate[0][0], rotation)),
            translation_pct=float(te_pct),
            point_px=errors[best],
            failed=bool(pose_failed(contestant.points, *estimate, np.array([te_pct]))[0]),
            mirrored=bool(flipped(estimate[0], rotation, translation)[0]),
            error=in_units(off[None])[0],
            sigma=in_units(np.sqrt(np.diagonal(sighting.covariance))[None])[0],
        )

    def bound(self, who: int, view: int) -> tuple[float, float]:
        """Photometric bound of one contestant's exact print in one view, deg and %."""
        return self.contestants[who].bound(self.camera, self.poses.taken(self.pose[[view]], 0), self.optics)


@dataclass(frozen=True, eq=False)
class Observation:
    """Errors and CPU time of one detector in one view; nan and empty if nothing, or something wrong, was found.

    Attributes
    ----------
    error, sigma : arrays (6,)
        Errors by degree of freedom, and the standard deviations that its covariance claims; see `in_units`.
    """

    rotation_deg: float = np.nan
    translation_pct: float = np.nan
    point_px: Array = field(default_factory=lambda: np.zeros(0))
    wrong: bool = False
    failed: bool = False
    mirrored: bool = False
    reason: str = ""
    cpu_s: float = 0.0
    error: Array = field(default_factory=lambda: np.full(6, np.nan))
    sigma: Array = field(default_factory=lambda: np.full(6, np.nan))

    @property
    def detected(self) -> bool:
        """True if the contestant was found correctly."""
        return not self.reason

    @property
    def counts(self) -> bool:
        """True if it was detected and its pose has not failed."""
        return self.detected and not self.failed


def shared(
    function: Callable[[Series, Any], Any],
    series: Series,
    tasks: Sequence[Any],
    workers: int | None,
    stage: str,
    progress: Progress | None,
    finished: Callable[[int, Any], object] = lambda *_: None,
) -> list[Any]:
    """Results of all tasks, whose last item is a range of views, shared out among processes; see `map_counted`."""
    report = (lambda done, total: progress(stage, done, total)) if progress else None
    images = sum(len(task[-1]) for task in tasks)
    workers = workers_for(workers, 1 + images // WORTH_A_WORKER)
    return map_counted(partial(function, series), tasks, workers, report, lambda task: len(task[-1]), finished)


def announcing(
    series: Series,
    contestants: Sequence[int],
    announce: Callable[[str], None],
    read: Callable[[Any], Sequence[Observation]],
) -> Callable[[int, Any], None]:
    """Take finished parts by their index, each of one of the `contestants`, and announce whose are all there."""
    left, observations = Counter(contestants), defaultdict[int, list[Observation]](list)

    def finished(index: int, part: Any) -> None:
        who = contestants[index]
        observations[who] += read(part)
        left[who] -= 1
        if not left[who]:
            rows = observations[who]
            rotation, translation = (
                statistics(np.array([getattr(row, key) for row in rows if row.counts]))["rms"]
                for key in ("rotation_deg", "translation_pct")
            )
            share = percent(sum(row.detected for row in rows) / len(rows))
            announce(
                f"{series.contestants[who].name}: found in {share} of {len(rows)} views, RE {number(rotation)} deg, TE "
                f"{number(translation)} % RMS ({sum(not more for more in left.values())} of {len(left)})"
            )

    return finished


def observe_chunk(series: Series, task: tuple[int, Choice, range]) -> list[Observation]:
    """What one contestant's detector finds in some views."""
    who, choice, views = task
    contestant = series.contestants[who]
    return [series.observe(contestant, choice, view, series.photograph(contestant, view)) for view in views]


def tune_chunk(
    series: Series, task: tuple[int, range], errors: Sequence[str] = ROTATION
) -> tuple[Contestant, Choice, list[dict[str, Any]]]:
    """Best variant and setting of a contestant, and a row for each that was tried."""
    who, views = task
    variants = series.contestants[who].variants
    photograph = cache(lambda variant, view: series.photograph(variants[variant], view))

    def observe(variant: int, choice: Choice, part: Sequence[int]) -> list[Observation]:
        seen = [series.observe(variants[variant], choice, view, photograph(variant, view)) for view in part]
        if errors == ROTATION:
            return seen
        # Where each error counts, flips are misses: one outweighs all that a setting does to the others.
        return [replace(observation, failed=observation.failed or observation.mirrored) for observation in seen]

    tables = {"pattern": range(len(variants)), **variants[0].settings}
    best, tried = tune(tables, observe, views, BUDGET, errors)
    rows = [
        {"size": variants[variant].size, "setting": variants[variant].describe(setting), **_tuning_row(column)}
        for (variant, setting), column in tried
    ]
    return variants[best[0]], best[1], rows


def _tuning_row(column: Sequence[Observation]) -> dict[str, Any]:
    counted = [observation for observation in column if observation.counts]
    errors = {name: statistics(np.array([getattr(observation, name) for observation in counted])) for name in POSE}
    return {
        "views": len(column),
        "rate": len(counted) / len(column),
        **{name: {key: values[key] for key in ("rms", "median")} for name, values in errors.items()},
    }


FIT_STEPS = 6
"""Maximum number of Gauss-Newton steps."""
FIT_CONVERGED = 0.1
"""Step that ends the fit, in standard deviations of the pose: the next would be some hundredths of that."""


def photometric_fit(image: Image, scene: Scene, camera: Camera, pose: Pose, optics: Optics) -> Pose:
    """Pose that fits the expected grey levels of a known pattern to an image best, near a given one.

    Gauss-Newton on sum (I - E(pose))^2 / sigma^2 over the pixels around the pattern, with optics and noise known: what
    `photometric_bounds` bounds. Where it does not converge, the best pose on the way is returned, which is the
    given one if no step improves it.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    pose : (rotation (3, 3), translation (3,) in m)
        T_camera_marker within 2 px or so of the true one.
    """
    levels = image * np.float32(
        FULL_SCALE / np.iinfo(image.dtype).max if optics.bits == 8 else FULL_SCALE / (2**optics.bits - 1)
    )
    best, least = pose, np.inf
    for _ in range(FIT_STEPS):
        (left, top), (width, height) = window = window_of(scene(*pose), camera, *pose, optics)
        if min(width, height) < 1:
            break
        expected, gradient, sigma = grey_gradient(scene, camera, *pose, optics, window)
        residual = (levels[top : top + height, left : left + width] - expected) / sigma
        # Windows of different sizes: of each only what exceeds the noise counts.
        excess = float(np.sum(residual**2, dtype=float) - residual.size)
        if not excess < least:
            break
        best, least = pose, excess
        weighted = (gradient / sigma).reshape(6, -1).astype(float)
        information = weighted @ weighted.T
        step = np.linalg.lstsq(information, weighted @ residual.ravel(), rcond=None)[0]
        rotation, translation = apply_pose_step(pose[0][None], pose[1][None], step[None])
        pose = rotation[0], translation[0]
        if step @ information @ step < FIT_CONVERGED**2:
            return pose
    return best
