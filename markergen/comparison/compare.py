"""Compare markers, tags and boards: same poses, optics and noise, with the best settings for each."""
# tests: tests/comparison/test_compare.py tests/api/test_compare.py

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.comparison.baselines import line_up
from markergen.comparison.contestants import Choice, Contestant
from markergen.comparison.series import TUNING, VIEWS, Observation, Series, announcing, shared, tune_chunk
from markergen.comparison.tuning import BUDGET
from markergen.defaults import COMPARED_VIEWS
from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.objectives import Setting
from markergen.options import Progress
from markergen.pool import TimeForecast, chunks_of, workers_for
from markergen.presentation.results import plain
from markergen.render import DEFAULT_OPTICS, Optics
from markergen.units import duration
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    resampled_means,
    rms,
    rms_interval,
    statistics,
)

TUNING_VIEWS = 60
"""Number of views for choosing each peer's settings, separate from those that are evaluated."""
TRIED, SEEN = 1.5, 0.3
"""For a forecast: settings that are tried over rows of all tables, and what one costs over all views of a mean one."""
AT_ONCE = 10
"""Number of views per chunk of work."""
ERRORS = ("rotation_deg", "translation_pct")
MOST = 0.9
"""Minimum share of the views that a contestant must find for its misses to count in choosing the common views."""


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
    announce: Callable[[str], None] | None = None,
) -> tuple[dict[str, Any], dict[str, float]]:
    """Compare markers, tags and boards in synthetic views.

    Markers keep their size; all else is as large as the room of the first marker allows, surrounded by white. For every
    tag and board, `tune` chooses the settings with the least RMS rotation error over `TUNING_VIEWS` separate views: of
    its detector, of an enlargement of the image before it, of a refinement of the points after it, and of the pose's
    estimator. Only our detector provides a covariance for each of its points, which is used as a weight. Where the
    detector cannot tell a pattern from itself turned, the pose nearest to the true one counts.

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
    announce : callable or None
        Called with a sentence about the expected duration after the first views, and one about each contestant.

    Returns
    -------
    results : dict
        Plain JSON values. Each entry of ``contestants`` has its ``name``, ``size``, ``room``, area of ``ink`` inside
        its circle (``cm2`` and ``share``), the ``setting`` used to detect it and all that its ``tuning`` tried; how
        many views were ``detected`` (``rate``), ``wrong`` or ``failed`` (see `pose_failed`; these are left out of the
        statistics) and how many poses were ``flips``; statistics of ``rotation_deg``, ``translation_pct`` and
        ``point_px`` over its detected views, the 95 % ``interval`` of the RMS and the ``bound``, the RMS of the
        photometric bound of an exact print in them; the same over the ``common`` views (those that every contestant
        found, ignoring contestants never found), and ``by_polar_angle`` and ``by_distance``; the ``pattern_bound`` over
        all views; the ``ratio`` of its RMS to that of the first, over the views that both found, with the 95 %
        interval; its ``failures``; and the statistics after the same refiner for all, a ``photometric`` fit from what
        was found (see `photometric_fit`). One whose library is missing is ``absent``. Intervals are bootstraps over
        views. The remaining keys describe the conditions.
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
    if announce:
        stages = {"views": _observe, "bounds": lambda series, task: _bound_chunk(series, task[::2])}
        seconds = forecast(counting, tuning, present, workers, stages)
        announce(f"the whole comparison: about {duration(seconds)}")
    tuned = dict(zip(to_tune, shared(tune_chunk, tuning, to_tune, workers, "settings", progress), strict=True))
    choices: list[Choice] = [{} for _ in contestants]
    for (who, _), (variant, choice, _) in tuned.items():
        contestants[who], choices[who] = variant, choice
    counting = replace(counting, contestants=tuple(contestants))
    tasks = [(who, choices[who], part) for who in present for part in chunks_of(views, AT_ONCE)]
    pairs = [[(Observation(reason=c.absent),) * 2] * views if c.absent else [] for c in contestants]
    whose = [who for who, _, _ in tasks]
    tell = announcing(counting, whose, announce or (lambda _: None), lambda part: [first for first, _ in part])
    for who, part in zip(whose, shared(_observe, counting, tasks, workers, "views", progress, tell), strict=True):
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
    medians = {who: float(np.median([observation.cpu_s for observation in observations[who]])) for who in present}
    return results, {contestants[who].name: median for who, median in medians.items()}


def forecast(
    counting: Series,
    tuning: Series,
    present: Sequence[int],
    workers: int | None,
    stages: Mapping[str, Callable[[Series, tuple[int, Choice, range]], Any]],
) -> float:
    """Seconds that a comparison takes, from what tuning and the stages take for the first view of each contestant."""
    costs: dict[tuple[str, int, str], float] = {}
    trials: dict[tuple[str, int, str], Callable[[], Any]] = {}
    for who in present:
        contestant = counting.contestants[who]
        tables = contestant.settings
        images = [{"image": row} for row in tables.get("image", ())] or [{}]
        if tables:
            rows = len(contestant.variants) - 1 + sum(len(table) - 1 for table in tables.values()) + 1
            costs["settings", who, "all"] = tuning.count * SEEN * min(BUDGET, TRIED * rows)
            costs["settings", who, "first"] = len(images)
            trials["settings", who, "first"] = partial(_try, tuning, who, images)
        for stage, work in stages.items():
            costs |= {(stage, who, "all"): counting.count, (stage, who, "first"): 1}
            trials[stage, who, "first"] = partial(work, counting, (who, images[-1], range(1)))
    for trial in trials.values():
        trial()  # Loads libraries, and what contestants keep.
    expected = TimeForecast(costs, lambda task: task[:2], prior=0)
    for task, trial in trials.items():
        began = perf_counter()
        trial()
        expected.finished(task, perf_counter() - began)
    return expected.seconds() / workers_for(workers, len(present))


def _try(series: Series, who: int, choices: Sequence[Choice]) -> None:
    contestant = series.contestants[who]
    image = series.photograph(contestant, 0)
    for choice in choices:
        series.observe(contestant, choice, 0, image)


def _bounds(series: Series, present: Sequence[int], workers: int | None, progress: Progress | None) -> Array:
    """Photometric bounds (contestants, views, 2), deg and %; nan for contestants that are absent."""
    tasks = [(who, part) for part in chunks_of(series.count, AT_ONCE) for who in present]
    bounds = np.full((len(series.contestants), series.count, 2), np.nan)
    parts = shared(_bound_chunk, series, tasks, workers, "bounds", progress)
    for (who, part), bound in zip(tasks, parts, strict=True):
        bounds[who, part] = bound
    return bounds


def _bound_chunk(series: Series, task: tuple[int, range]) -> list[tuple[float, float]]:
    who, views = task
    return [series.bound(who, view) for view in views]


def _observe(series: Series, task: tuple[int, Choice, range]) -> list[tuple[Observation, Observation]]:
    who, setting, views = task
    return [series.observe_and_refine(who, setting, view) for view in views]


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
                "room": str(contestant.room(setting.boundary)),
                "absent": contestant.absent,
                "ink": {"cm2": 1e4 * ink, "share": ink / contestant.area(radius)},
                "setting": "",
                "tuning": [],
                **_summary(row, bound, everywhere, series.seed),
                "pattern_bound": {key: plain(rms(bound[:, k])) for k, key in enumerate(ERRORS)},
                "flips": flips(series, contestant, row),
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
        "bound": {key: plain(rms(bound[counted, k])) if kept else None for k, key in enumerate(ERRORS)},
        **intervals,
    }


def flips(series: Series, contestant: Contestant, row: Sequence[Observation]) -> int:
    """Number of poses nearer to the mirrored one, among those where the contestant's point errors separate the two."""
    errors = np.concatenate([np.zeros(0), *(observation.point_px for observation in row if observation.counts)])
    if not len(errors):
        return 0
    sigma = float(np.sqrt(np.mean(errors**2) / 2))
    apart = pose_bounds(contestant.points, series.camera, series.poses, sigma).separation > FLIP_SEPARATION
    return sum(
        observation.counts and observation.mirrored and bool(apart[p])
        for observation, p in zip(row, series.pose[: len(row)], strict=True)
    )


def _ratio(key: str, row: Sequence[Observation], first: Sequence[Observation], seed: int) -> dict[str, Any] | None:
    """RMS relative to the first contestant's, over the views in which both count, with a 95 % interval.

    The interval is a bootstrap over views: pairs of errors are resampled with replacement; None of fewer than two.
    """
    pairs = [(getattr(a, key), getattr(b, key)) for a, b in zip(row, first, strict=True) if a.counts and b.counts]
    if not pairs:
        return None
    squares = np.array(pairs) ** 2
    if not squares[:, 1].any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(np.divide(*resampled_means(squares, seed).T))
    interval = np.nanquantile(ratios, [0.025, 0.975]).tolist() if len(pairs) > 1 else None
    square, reference = squares.mean(axis=0)
    return {"count": len(pairs), "rms": float(np.sqrt(square / reference)), "interval": interval}
