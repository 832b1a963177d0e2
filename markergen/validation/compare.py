"""Compare markers, tags and boards: same poses, optics and noise, with the best settings for each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect.fiducials import FiducialSettings
from markergen.errors import InputError
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.options import Progress
from markergen.pool import map_counted, ranges, workers_for
from markergen.render import DEFAULT_OPTICS, Optics
from markergen.validation.baselines import Contestant, line_up
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    flipped,
    pose_failed,
    rotation_error_deg,
    statistics,
    translation_error_pct,
)
from markergen.validation.views import WRONG_PX

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Choice = FiducialSettings | None

TUNING_VIEWS = 60
"""Number of views for choosing each peer's settings, separate from those that are evaluated."""
NEARLY_ALL = 0.95
"""Minimum share of the best setting's detections for a setting to be eligible, however accurate it is."""
RESAMPLES = 2000
"""Bootstrap resamples, enough to determine the ends of the 95 % interval to a fiftieth of its length."""
AT_ONCE = 10
"""Number of views per chunk of work."""
WORTH_A_WORKER = 60
"""Number of images below which starting another process does not pay."""

_TUNING, _VIEWS = 1, 0


@dataclass(frozen=True, eq=False)
class Series:
    """Views of several contestants, from the same poses with the same noise.

    Attributes
    ----------
    contestants : tuple of Contestant
    camera : Camera
    poses : PoseDistribution
    count : int
        Number of views; one pose is drawn from each of `count` equal stretches of the distribution.
    seed : int
    optics : Optics
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
    stage: int = _VIEWS

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
        found = []
        for choice in choices:
            sighting = contestant.sight(image, self.camera, choice, self.print_sigma)
            if sighting.rotation is None or sighting.translation is None:
                found.append(Observation(reason=sighting.reason))
                continue
            truth = self.camera.to_pixels(perspective(to_camera(contestant.points, rotation[None], translation[None])))
            error_px = np.linalg.norm(sighting.pixels - truth[0, sighting.ids], axis=-1)
            if error_px.max() > WRONG_PX:
                found.append(Observation(wrong=True, reason=f"wrong: a point is {error_px.max():.1f} px off"))
                continue
            te_pct = translation_error_pct(sighting.translation, translation)
            estimate = sighting.rotation[None], sighting.translation[None]
            found.append(
                Observation(
                    rotation_deg=float(rotation_error_deg(sighting.rotation, rotation)),
                    translation_pct=float(te_pct),
                    point_px=error_px,
                    failed=bool(pose_failed(contestant.points, *estimate, np.array([te_pct]))[0]),
                    mirrored=bool(flipped(estimate[0], rotation, translation)[0]),
                )
            )
        return found


@dataclass(frozen=True, eq=False)
class Observation:
    """Errors of one detector in one view; nan and empty if nothing, or something wrong, was found."""

    rotation_deg: float = np.nan
    translation_pct: float = np.nan
    point_px: Array = field(default_factory=lambda: np.zeros(0))
    wrong: bool = False
    failed: bool = False
    mirrored: bool = False
    reason: str = ""

    @property
    def detected(self) -> bool:
        """True if the contestant was found correctly."""
        return not self.reason

    @property
    def counts(self) -> bool:
        """True if it was detected and its pose has not failed."""
        return self.detected and not self.failed


def compare(
    texts: Sequence[str],
    views: int = 200,
    seed: int = 0,
    poses: str | PoseDistribution | None = None,
    print_sigma: float = 0.0,
    optics: Optics = DEFAULT_OPTICS,
    workers: int | None = None,
    progress: Progress | None = None,
    given: Mapping[str, Marker] | None = None,
) -> dict[str, Any]:
    """Compare markers, tags and boards in synthetic views.

    Each is as large as the same circle allows, surrounded by white. For every tag and board, the settings of cv2.aruco
    with the least RMS rotation error over `TUNING_VIEWS` separate views are chosen. All poses come from the same
    Levenberg-Marquardt solver over the points that a detector found; only our detector provides a covariance for each
    of its points, which is used as a weight.

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
    dict
        Plain JSON values. Each entry of ``contestants`` has its ``name``, ``size``, the ``setting`` used to detect it
        and the candidates of its ``tuning``; how many views were ``detected`` (``rate``), ``wrong`` or ``failed`` (see
        `pose_failed`; these are left out of the statistics) and how many poses were ``flips``; statistics of
        ``rotation_deg``, ``translation_pct`` and ``point_px`` over its detected views; the same over the ``common``
        views (those that every contestant found, ignoring contestants never found), and ``by_polar_angle`` and
        ``by_distance``; the ``ratio`` of its RMS to that of the first, over the views that both found, with the
        bootstrap's 95 % interval; and its ``failures``. The remaining keys describe the conditions.

    Raises
    ------
    InputError
        If a contestant is unknown or a number out of range.
    """
    workers_for(workers, 1)
    contestants, setting = line_up(texts, poses, seed, given)
    if len(contestants) < 2:
        raise InputError("two or more contestants", f"only {contestants[0].name}", "name another to compare it with")

    def series(count: int, stage: int) -> Series:
        return Series(tuple(contestants), setting.camera, setting.poses, count, seed, optics, print_sigma, stage)

    counting = series(views, _VIEWS)
    to_tune = {who: tuple(each.settings) for who, each in enumerate(contestants) if each.settings}
    tuned = _observe(series(TUNING_VIEWS, _TUNING), to_tune, workers, "settings", progress)
    chosen = {who: _best(tuned[who]) for who in to_tune}
    choices: dict[int, tuple[Choice, ...]] = {
        who: (to_tune[who][chosen[who]] if who in chosen else None,) for who in range(len(contestants))
    }
    found = _observe(counting, choices, workers, "views", progress)
    observations = [[each[0] for each in found[who]] for who in range(len(contestants))]
    results = _results(counting, setting, observations)
    for who, entry in enumerate(results["contestants"]):
        entry["setting"] = contestants[who].describe(choices[who][0])
        entry["tuning"] = [
            {"setting": contestants[who].describe(to_tune[who][k]), **row}
            for k, row in enumerate(_tuning_rows(tuned.get(who, [])))
        ]
    return results


def _observe(
    series: Series,
    choices: Mapping[int, tuple[Choice, ...]],
    workers: int | None,
    stage: str,
    progress: Progress | None,
) -> dict[int, list[list[Observation]]]:
    """Observations of each contestant, by view and setting."""
    tasks = [(who, settings, part) for part in ranges(series.count, AT_ONCE) for who, settings in choices.items()]
    told = (lambda done, total: progress(stage, done, total)) if progress else None
    workers = workers_for(workers, 1 + series.count * len(choices) // WORTH_A_WORKER)
    parts = map_counted(partial(_observe_chunk, series), tasks, workers, told, size=lambda task: len(task[2]))
    found: dict[int, list[list[Observation]]] = {who: [] for who in choices}
    for (who, _, _), part in zip(tasks, parts, strict=True):
        found[who] += part
    return found


def _observe_chunk(series: Series, task: tuple[int, tuple[Choice, ...], range]) -> list[list[Observation]]:
    who, choices, views = task
    return [series.observe(who, choices, view) for view in views]


def _best(tuned: Sequence[Sequence[Observation]]) -> int:
    """Index of the setting with the least RMS rotation error over the views found by all eligible settings."""
    counts = np.array([[each.counts for each in view] for view in tuned])
    rates = counts.mean(axis=0)
    eligible = np.flatnonzero(rates >= NEARLY_ALL * rates.max())
    common = counts[:, eligible].all(axis=1)
    if not common.any():
        return int(np.argmax(rates))
    rotation = np.array([[each.rotation_deg for each in view] for view in tuned])[common][:, eligible]
    return int(eligible[np.argmin(np.mean(rotation**2, axis=0))])


def _tuning_rows(tuned: Sequence[Sequence[Observation]]) -> list[dict[str, Any]]:
    rows = []
    for k in range(len(tuned[0]) if tuned else 0):
        kept = [view[k] for view in tuned if view[k].counts]
        errors = statistics(np.array([each.rotation_deg for each in kept]))
        rows.append({"rate": len(kept) / len(tuned), "rotation_deg": {key: errors[key] for key in ("rms", "median")}})
    return rows


def _results(series: Series, setting: Setting, observations: Sequence[Sequence[Observation]]) -> dict[str, Any]:
    pose = series.pose
    counts = np.array([[each.counts for each in row] for row in observations])
    taking_part = counts.any(axis=1)
    common: Mask = np.asarray(counts[taking_part].all(axis=0) & taking_part.any())
    groups = {"by_polar_angle": series.poses.by_polar_angle(), "by_distance": series.poses.by_distance()}
    entries: list[dict[str, Any]] = []
    for who, contestant in enumerate(series.contestants):
        row = observations[who]
        everywhere = np.ones(series.count, dtype=bool)
        entries.append(
            {
                "name": contestant.name,
                "size": contestant.size,
                "setting": "",
                "tuning": [],
                **_summary(row, everywhere),
                "flips": _flips(series, contestant, row),
                "common": _summary(row, common),
                "ratio": {
                    key: _ratio(key, row, observations[0], series.seed) for key in ("rotation_deg", "translation_pct")
                },
                **{
                    by: {
                        name: {**_summary(row, mask[pose]), "common": _summary(row, mask[pose] & common)}
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
                        "reason": each.reason or "the pose has failed",
                    }
                    for k, each in enumerate(row)
                    if not each.counts
                ],
            }
        )
    camera = series.camera
    return {
        "camera": camera.as_dict(),
        "poses": {"name": series.poses.name, "count": len(series.poses), "dropped": series.poses.dropped},
        "radius": setting.boundary.radius,
        "optics": dict(vars(series.optics)),
        "print_sigma_mm": 1e3 * series.print_sigma,
        "seed": series.seed,
        "views": {"count": series.count, "common": int(common.sum())},
        "contestants": entries,
    }


def _summary(row: Sequence[Observation], chosen: Mask) -> dict[str, Any]:
    seen = [each for each, inside in zip(row, chosen, strict=True) if inside]
    kept = [each for each in seen if each.counts]
    detected = sum(each.detected for each in seen)
    return {
        "count": len(seen),
        "detected": detected,
        "wrong": sum(each.wrong for each in seen),
        "failed": sum(each.failed for each in seen),
        "rate": detected / len(seen) if seen else None,
        "rotation_deg": statistics(np.array([each.rotation_deg for each in kept])),
        "translation_pct": statistics(np.array([each.translation_pct for each in kept])),
        "point_px": statistics(np.concatenate([np.zeros(0), *(each.point_px for each in kept)])),
    }


def _flips(series: Series, contestant: Contestant, row: Sequence[Observation]) -> int:
    """Number of poses nearer to the mirrored one, among those where the contestant's point errors separate the two."""
    errors = np.concatenate([np.zeros(0), *(each.point_px for each in row if each.counts)])
    if not len(errors):
        return 0
    sigma = float(np.sqrt(np.mean(errors**2) / 2))
    apart = pose_bounds(contestant.points, series.camera, series.poses, sigma).separation > FLIP_SEPARATION
    return sum(each.counts and each.mirrored and bool(apart[p]) for each, p in zip(row, series.pose, strict=True))


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
    weights = np.random.default_rng([seed, len(pairs)]).multinomial(
        len(pairs), np.full(len(pairs), 1 / len(pairs)), size=RESAMPLES
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(np.divide(*(weights @ squares).T))
    low, high = np.nanquantile(ratios, [0.025, 0.975])
    own, reference = squares.mean(axis=0)
    return {"count": len(pairs), "rms": float(np.sqrt(own / reference)), "interval": [float(low), float(high)]}
