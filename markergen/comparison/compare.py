"""Compare markers, tags and boards: same poses, optics and noise, with the best settings for each."""
# tests: tests/comparison/test_compare.py tests/api/test_compare.py

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.comparison.baselines import line_up
from markergen.comparison.contestants import Choice, Contestant, Image, Pose, Sighting
from markergen.comparison.photometric import photometric_fit
from markergen.comparison.tuning import BUDGET, tune
from markergen.defaults import COMPARED_VIEWS
from markergen.errors import InputError
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import turn_z
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.objectives import Setting
from markergen.options import Progress
from markergen.pool import chunks_of, map_counted, workers_for
from markergen.render import DEFAULT_OPTICS, Optics
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    flipped,
    pose_failed,
    rms,
    rotation_error_deg,
    statistics,
    translation_error_pct,
)
from markergen.validation.views import WRONG_PX

VIEWS, TUNING = 0, 1
"""Stages of a comparison, with different views."""

TUNING_VIEWS = 60
"""Number of views for choosing each peer's settings, separate from those that are evaluated."""
AT_ONCE = 10
"""Number of views per chunk of work."""
WORTH_A_WORKER = 60
"""Number of images below which starting another process does not pay."""
ERRORS = ("rotation_deg", "translation_pct")
RESAMPLES = 2000
"""Bootstrap resamples, enough to determine the ends of the 95 % interval to a fiftieth of its length.

scipy.stats.bootstrap has the same intervals but for its draws, by which the ends of stored results would move by 0.3 %.
"""
MOST = 0.9
"""Minimum share of the views that a contestant must find for its misses to count in choosing the common views."""


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


def compare(*arguments: Any, **options: Any) -> dict[str, Any]:
    """Return the results of `compare_and_time` alone: the same for the same arguments."""
    return compare_and_time(*arguments, **options)[0]


def compare_and_time(
    texts: Sequence[str],
    views: int = COMPARED_VIEWS,
    seed: int = 0,
    poses: str | PoseDistribution | None = None,
    print_sigma: float = 0.0,
    optics: Optics = DEFAULT_OPTICS,
    workers: int | None = None,
    progress: Progress | None = None,
    given: Mapping[str, Marker | Rig] | None = None,
) -> tuple[dict[str, Any], dict[str, float]]:
    """Compare markers, tags and boards in synthetic views.

    Each is as large as the room of the first marker allows, surrounded by white. For every tag and board, `tune`
    chooses the settings with the least RMS rotation error over `TUNING_VIEWS` separate views: of its detector, of an
    enlargement of the image before it, of a refinement of the points after it, and of the pose's estimator. Only our
    detector provides a covariance for each of its points, which is used as a weight. Where the detector cannot tell a
    pattern from itself turned, the pose nearest to the true one counts.

    Parameters
    ----------
    texts : sequence of str
        See `line_up`.
    views : int
        Number of views that are evaluated, with the same poses for all.
    print_sigma : float, m
        Error of the print, see `Series`.
    workers : int or None
        Number of processes; None takes as many as the processors and the amount of work justify, 1 uses this process.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    given : mapping or None
        Markers that are not in files, see `line_up`.

    Returns
    -------
    results : dict
        Plain JSON values. Each entry of ``contestants`` has its ``name``, ``size``, area of ``ink`` inside the circle
        (``cm2`` and ``share``), the ``setting`` used to detect it and all that its ``tuning`` tried; how many views
        were ``detected`` (``rate``), ``wrong`` or ``failed`` (see `pose_failed`; these are left out of the statistics)
        and how many poses were ``flips``; statistics of ``rotation_deg``, ``translation_pct`` and ``point_px`` over its
        detected views, the 95 % ``interval`` of the RMS and the ``bound``, the RMS of the photometric bound of an exact
        print in them; the same over the ``common`` views (those that every contestant found, ignoring contestants never
        found), and ``by_polar_angle`` and ``by_distance``; the ``pattern_bound`` over all views; the ``ratio`` of its
        RMS to that of the first, over the views that both found, with the 95 % interval; its ``failures``; and the
        statistics after the same refiner for all, a ``photometric`` fit from what was found (see `photometric_fit`).
        One whose library is missing is ``absent``. Intervals are bootstraps over views. The remaining keys describe
        the conditions.
    cpu_s : dict
        Median processor time of detection and pose in one view, s, by name; it differs from run to run.

    Raises
    ------
    InputError
        If a contestant is unknown or a number out of range.
    """
    workers_for(workers, 1)
    contestants, setting = line_up(texts, poses, seed, given)
    if len(contestants) < 2:
        raise InputError("two or more contestants", f"only {contestants[0].name}", "name another to compare it with")
    present = [who for who, contestant in enumerate(contestants) if not contestant.absent]
    counting = Series(tuple(contestants), setting.camera, setting.poses, views, seed, optics, print_sigma, VIEWS)
    tuning = replace(counting, count=TUNING_VIEWS, stage=TUNING)
    to_tune = [(who, range(TUNING_VIEWS)) for who in present if contestants[who].settings]
    tuned = dict(zip(to_tune, _shared(_tune, tuning, to_tune, workers, "settings", progress), strict=True))
    choices: list[Choice] = [{} for _ in contestants]
    for (who, _), (variant, choice, _) in tuned.items():
        contestants[who], choices[who] = variant, choice
    counting = replace(counting, contestants=tuple(contestants))
    tasks = [(who, choices[who], part) for part in chunks_of(views, AT_ONCE) for who in present]
    pairs = [[(Observation(reason=c.absent),) * 2] * views if c.absent else [] for c in contestants]
    for (who, _, _), part in zip(tasks, _shared(_observe, counting, tasks, workers, "views", progress), strict=True):
        pairs[who] += part
    observations, refined = ([[pair[k] for pair in row] for row in pairs] for k in range(2))
    bounds = _bounds(counting, present, workers, progress)
    results = comparison_results(counting, setting, observations, bounds)
    everywhere = np.ones(views, dtype=bool)
    for who, entry in enumerate(results["contestants"]):
        entry["setting"] = contestants[who].describe(choices[who])
        entry["photometric"] = _summary(refined[who], bounds[who], everywhere, seed)
    for (who, _), (_, _, rows) in tuned.items():
        results["contestants"][who]["tuning"] = rows
    seconds = {who: float(np.median([observation.cpu_s for observation in observations[who]])) for who in present}
    return results, {contestants[who].name: median for who, median in seconds.items()}


def _bounds(series: Series, present: Sequence[int], workers: int | None, progress: Progress | None) -> Array:
    """Photometric bounds (contestants, views, 2), deg and %; nan for contestants that are absent."""
    tasks = [(who, part) for part in chunks_of(series.count, AT_ONCE) for who in present]
    bounds = np.full((len(series.contestants), series.count, 2), np.nan)
    parts = _shared(_bound_chunk, series, tasks, workers, "bounds", progress)
    for (who, part), bound in zip(tasks, parts, strict=True):
        bounds[who, part] = bound
    return bounds


def _shared(
    function: Callable[[Series, Any], Any],
    series: Series,
    tasks: Sequence[Any],
    workers: int | None,
    stage: str,
    progress: Progress | None,
) -> list[Any]:
    """Results of all tasks, whose last item is a range of views, shared out among processes."""
    report = (lambda done, total: progress(stage, done, total)) if progress else None
    images = sum(len(task[-1]) for task in tasks)
    workers = workers_for(workers, 1 + images // WORTH_A_WORKER)
    return map_counted(partial(function, series), tasks, workers, report, size=lambda task: len(task[-1]))


def _bound_chunk(series: Series, task: tuple[int, range]) -> list[tuple[float, float]]:
    who, views = task
    return [series.bound(who, view) for view in views]


def _observe(series: Series, task: tuple[int, Choice, range]) -> list[tuple[Observation, Observation]]:
    who, setting, views = task
    return [series.observe_and_refine(who, setting, view) for view in views]


def _tune(series: Series, task: tuple[int, range]) -> tuple[Contestant, Choice, list[dict[str, Any]]]:
    """Best variant and setting of a contestant, and a row for each that was tried."""
    who, views = task
    variants = series.contestants[who].variants
    images = [[series.photograph(variant, view) for view in views] for variant in variants]

    def observe(variant: int, choice: Choice) -> list[Observation]:
        return [series.observe(variants[variant], choice, view, images[variant][view]) for view in views]

    best, tried = tune({"pattern": range(len(variants)), **variants[0].settings}, observe, BUDGET)
    rows = [
        {"size": variants[variant].size, "setting": variants[variant].describe(setting), **_tuning_row(column)}
        for (variant, setting), column in tried
    ]
    return variants[best[0]], best[1], rows


def _tuning_row(column: Sequence[Observation]) -> dict[str, Any]:
    errors = statistics(np.array([observation.rotation_deg for observation in column if observation.counts]))
    return {
        "rate": sum(observation.counts for observation in column) / len(column),
        "rotation_deg": {key: errors[key] for key in ("rms", "median")},
    }


def comparison_results(
    series: Series, setting: Setting, observations: Sequence[Sequence[Observation]], bounds: Array
) -> dict[str, Any]:
    """Return the results of `compare`, without settings, from one observation per contestant and view.

    Parameters
    ----------
    bounds : array (contestants, views, 2), deg and %
    """
    pose = series.pose
    counts = np.array([[observation.counts for observation in row] for row in observations])
    # Those that miss many views would leave the others few to be compared in, and the easy ones.
    taking_part = counts.mean(axis=1) >= MOST
    common: Mask = np.asarray(counts[taking_part if taking_part.any() else counts.any(axis=1)].all(axis=0))
    common &= counts.any()
    everywhere = np.ones(series.count, dtype=bool)
    groups = {"by_polar_angle": series.poses.by_polar_angle(), "by_distance": series.poses.by_distance()}
    radius = setting.boundary.radius
    entries: list[dict[str, Any]] = []
    for contestant, row, bound in zip(series.contestants, observations, bounds, strict=True):
        ink = contestant.ink(radius)
        entries.append(
            {
                "name": contestant.name,
                "size": contestant.size,
                "absent": contestant.absent,
                "ink": {"cm2": 1e4 * ink, "share": ink / contestant.area(radius)},
                "setting": "",
                "tuning": [],
                **_summary(row, bound, everywhere, series.seed),
                "pattern_bound": {key: _finite(rms(bound[:, k])) for k, key in enumerate(ERRORS)},
                "flips": _flips(series, contestant, row),
                "common": _summary(row, bound, common, series.seed),
                "ratio": {key: _ratio(key, row, observations[0], series.seed) for key in ERRORS},
                **{
                    by: {
                        name: {
                            **_summary(row, bound, mask[pose]),
                            "common": _summary(row, bound, mask[pose] & common),
                        }
                        for name, mask in masks.items()
                        if mask[pose].any()
                    }
                    for by, masks in groups.items()
                },
                "failures": [
                    {
                        "view": k,
                        "distance": float(series.poses.distance[pose[k]]),
                        "polar_angle_deg": round(float(series.poses.polar_angle_deg[pose[k]]), 2),
                        "reason": observation.reason or "the pose has failed",
                    }
                    for k, observation in enumerate(row)
                    if not observation.counts
                ],
            }
        )
    camera = series.camera
    return {
        "camera": camera.as_dict(),
        "poses": {"name": series.poses.name, "count": len(series.poses), "dropped": series.poses.dropped},
        "radius": radius,
        "room": str(setting.boundary),
        "optics": dict(vars(series.optics)),
        "print_sigma_mm": 1e3 * series.print_sigma,
        "seed": series.seed,
        "views": {"count": series.count, "common": int(common.sum())},
        "contestants": entries,
    }


def _summary(row: Sequence[Observation], bound: Array, chosen: Mask, seed: int | None = None) -> dict[str, Any]:
    """Statistics over the chosen views, with intervals of the RMS if there is a seed for the bootstrap."""
    seen = [observation for observation, inside in zip(row, chosen, strict=True) if inside]
    counted = np.array([observation.counts for observation in row]) & chosen
    kept = [observation for observation in seen if observation.counts]
    detected = sum(observation.detected for observation in seen)
    errors = {key: np.array([getattr(observation, key) for observation in kept]) for key in ERRORS}
    intervals = {} if seed is None else {"interval": {key: rms_interval(errors[key], seed) for key in ERRORS}}
    return {
        "count": len(seen),
        "detected": detected,
        "wrong": sum(observation.wrong for observation in seen),
        "failed": sum(observation.failed for observation in seen),
        "rate": detected / len(seen) if seen else None,
        **{key: statistics(errors[key]) for key in ERRORS},
        "point_px": statistics(np.concatenate([np.zeros(0), *(observation.point_px for observation in kept)])),
        "bound": {key: _finite(rms(bound[counted, k])) if kept else None for k, key in enumerate(ERRORS)},
        **intervals,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def rms_interval(values: Array, seed: int) -> list[float] | None:
    """95 % interval of the RMS of values (n,): a bootstrap over views; None for fewer than two values."""
    if len(values) < 2:
        return None
    low, high = np.quantile(np.sqrt(_resampled(values[:, None] ** 2, seed))[:, 0], [0.025, 0.975])
    return [float(low), float(high)]


def _resampled(values: Array, seed: int) -> Array:
    """Means (RESAMPLES, k) of rows (n, k) drawn with replacement."""
    count = len(values)
    weights = np.random.default_rng([seed, count]).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return np.asarray(weights @ values / count)


def _flips(series: Series, contestant: Contestant, row: Sequence[Observation]) -> int:
    """Number of poses nearer to the mirrored one, among those where the contestant's point errors separate the two."""
    errors = np.concatenate([np.zeros(0), *(observation.point_px for observation in row if observation.counts)])
    if not len(errors):
        return 0
    sigma = float(np.sqrt(np.mean(errors**2) / 2))
    apart = pose_bounds(contestant.points, series.camera, series.poses, sigma).separation > FLIP_SEPARATION
    return sum(
        observation.counts and observation.mirrored and bool(apart[p])
        for observation, p in zip(row, series.pose, strict=True)
    )


def _ratio(key: str, row: Sequence[Observation], first: Sequence[Observation], seed: int) -> dict[str, Any] | None:
    """RMS relative to the first contestant's, over the views in which both count, with a 95 % interval.

    The interval is a bootstrap over views: pairs of errors are resampled with replacement.
    """
    pairs = [(getattr(a, key), getattr(b, key)) for a, b in zip(row, first, strict=True) if a.counts and b.counts]
    if not pairs:
        return None
    squares = np.array(pairs) ** 2
    if not squares[:, 1].any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(np.divide(*_resampled(squares, seed).T))
    low, high = np.nanquantile(ratios, [0.025, 0.975])
    square, reference = squares.mean(axis=0)
    return {"count": len(pairs), "rms": float(np.sqrt(square / reference)), "interval": [float(low), float(high)]}
