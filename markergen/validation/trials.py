"""Noisy trials of a marker or rig at every pose: estimates from noisy image points, their errors, and the bounds."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.defaults import NOISE_PX, RUNS
from markergen.errors import InputError
from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.maths.information import covariance, flip_separation
from markergen.maths.projection import project, to_camera
from markergen.model.body import Plate
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.model.sight import partly_seen, poses_that_serve
from markergen.objectives.homography import validation_grid
from markergen.pool import chunks_of, map_counted, workers_for
from markergen.presentation.results import plain
from markergen.validation.bounds import PoseBounds, pose_bounds
from markergen.validation.metrics import (
    FLIP_SEPARATION,
    efficiency,
    flipped,
    homography_error_px2,
    homography_failed,
    nees_statistics,
    pose_failed,
    pose_nees,
    rotation_error_deg,
    statistics,
    translation_error_pct,
)
from markergen.validation.setting import check_trials
from markergen.validation.views import SyntheticViews

BLOCK, AT_ONCE = 4096, 1024
"""Maximum number of trials of a pose that are solved at once, which bounds the memory for any number of runs; number of
trials at which those of further poses are no longer solved with them."""
NEES_OF = "lm"
"""Name of the maximum-likelihood estimator, to whose covariance the bound applies."""
LEAST_DEPTH = 0.1
"""Minimum depth of validation points, as a share of the marker's distance; nearer ones are left out of HE."""

POSES_AT_ONCE = 4
"""Number of poses per chunk of work: about a second of computing at 1000 runs."""
WORTH_A_WORKER = 10_000
"""Number of trials (poses times runs) below which starting another process does not pay."""


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of one pose estimator, arrays (T,) for one pose or (P, T) for all: RE, TE, failures and flips.

    `nearest_deg` is the RE of the solution nearest to the truth, whichever the estimator prefers: the error if another
    image resolved the ambiguity. NEES is nan where it is not defined: for failures and flips, without noise, and for
    estimators other than LM.
    """

    rotation_deg: Array
    nearest_deg: Array
    translation_pct: Array
    nees: Array
    failed: Mask
    flipped: Mask


@dataclass(frozen=True, eq=False)
class HomographyErrors:
    """Errors of one homography estimator, arrays (T,) for one pose or (P, T) for all: HE in ideal px^2, and failures.

    A homography maps to undistorted pixels.
    """

    he_px2: Array
    failed: Mask


Errors = PoseErrors | HomographyErrors


@dataclass(frozen=True, eq=False)
class Experiment:
    """Parameters of the trials; each pose has its own random stream, in any process at any time.

    Attributes
    ----------
    points : array (n, 3), m
    radius : float
        Radius of the marker in m, which scales the validation grid.
    runs : int
        Trials per pose.
    seen : array (P, n) of bool or None
        Points that each pose sees; None if all.
    frames : sequence of P Plate or None
        Of a rig: the plate in whose frame the pose is estimated and mirrored; then poses that see no point are left
        out, and noise is drawn for all points, so that experiments with other points of the rig have the same.
    """

    points: Array
    radius: float
    camera: Camera
    poses: PoseDistribution
    bounds: PoseBounds
    noise_px: float
    runs: int
    seed: int
    estimators: tuple[str, ...]
    seen: Mask | None = None
    frames: Sequence[Plate] | None = None

    def points_of(self, index: int) -> Array:
        """Points (m, 3) in m that a pose sees; of a rig, in the plate's frame."""
        points = self.points if self.seen is None else self.points[self.seen[index]]
        if self.frames is not None:
            points = self.frames[index].to_marker(points)
            if np.abs(points[:, 2]).max() < 1e-9 * self.radius:
                # Planar estimators need z = 0 to the last bit.
                points[:, 2] = 0.0
        return points


@dataclass(frozen=True, eq=False)
class TrialResults:
    """The errors of all trials of one marker, and their statistics.

    Attributes
    ----------
    experiment : Experiment
        Camera, poses that see the entire marker, bounds, noise, runs, and seed.
    errors : mapping
        Arrays (P, runs) by estimator; empty if there were no runs.
    condition : array (P,) or None
        Condition number c(A) for every pose, in unit coordinates.
    """

    marker: Marker
    experiment: Experiment
    errors: Mapping[str, Errors]
    condition: Array | None = None

    def as_dict(self, **parts: Any) -> dict[str, Any]:
        """Return the results as plain JSON values, with None for undefined numbers.

        The parts are JSON values computed elsewhere, to be included: criteria, comparisons, views, budget, labels,
        dots, headline, expected, relative_error, and coverage only if there is one.
        """
        experiment, c = self.experiment, self.condition
        poses, bounds = experiment.poses, experiment.bounds
        every, by_polar_angle = np.ones(len(poses), dtype=bool), {"by_polar_angle": poses.by_polar_angle()}
        groups, lm = by_polar_angle | {"by_distance": poses.by_distance()}, self.errors.get(NEES_OF)
        content = {
            "marker": {
                "control_points": len(self.marker),
                "boundary": self.marker.boundary.as_dict(),
                "dot_diameter": self.marker.dot_diameter,
                "spec_hash": self.marker.spec_hash,
            },
            "headline": parts.get("headline"),
            "criteria": parts.get("criteria"),
            **({} if parts.get("coverage") is None else {"coverage": parts["coverage"]}),
            "comparisons": parts.get("comparisons"),
            "nees": _by_group(lambda chosen: nees_statistics(lm.nees[chosen]), every, by_polar_angle)
            if isinstance(lm, PoseErrors)
            else None,
            "camera": experiment.camera.as_dict(),
            "poses": {"name": poses.name, "count": len(poses), "dropped": poses.dropped},
            "noise_px": experiment.noise_px,
            "runs": experiment.runs,
            "seed": experiment.seed,
            "condition": None if c is None else {"mean": np.mean(c), "min": np.min(c), "max": np.max(c)},
            "relative_error": parts.get("relative_error"),
            "homography": {
                name: _by_group(partial(_homography, errors), every, by_polar_angle)
                for name, errors in self.errors.items()
                if isinstance(errors, HomographyErrors)
            },
            "estimators": {
                name: _by_group(partial(pose_summary, bounds, errors), every, groups)
                for name, errors in self.errors.items()
                if isinstance(errors, PoseErrors)
            },
            "bound": _by_group(bounds.summary, every, groups),
            "labels": parts.get("labels"),
            "dots": parts.get("dots"),
            "budget": parts.get("budget"),
            "expected": parts.get("expected"),
            "views": parts.get("views"),
        }
        values: dict[str, Any] = plain(content)
        return values


def pose_summary(bounds: PoseBounds, errors: PoseErrors, poses: Mask) -> dict[str, Any]:
    """Return statistics of the errors at some poses, as plain values."""
    failed, flips = errors.failed[poses], errors.flipped[poses]
    rotation_deg, translation_pct = errors.rotation_deg[poses], errors.translation_pct[poses]
    return {
        "rotation_deg": statistics(rotation_deg[~failed]),
        "translation_pct": statistics(translation_pct[~failed]),
        "nearest_rotation_deg": statistics(errors.nearest_deg[poses][~failed]),
        "flip_rate": np.mean(flips),
        "failure_rate": np.mean(failed),
        "efficiency": efficiency(rotation_deg, ~(failed | flips), bounds.rotation_deg[poses]),
    }


def rig_experiments(series: SyntheticViews[Rig], noise_px: float, runs: int) -> dict[str, Experiment]:
    """Trials by LM at every pose that shows enough dots of a plate of a rig.

    Returns
    -------
    dict
        ``lm``: from all dots in view; ``lm_alone``: from those of the plate with the least bound.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    check_trials(noise_px, runs, seed := series.seed)
    rig, camera, poses, in_view = series.marker, series.camera, series.poses, series.coverage
    counted = in_view.seen & in_view.served[:, None]
    on_plate = rig.owner == np.arange(len(rig.plates))[:, None]
    bounds_alone = [pose_bounds(rig.xyz, camera, poses, 1.0, counted & dots).rotation_deg for dots in on_plate]
    best = np.where(in_view.plate_served.T, bounds_alone, np.inf).argmin(axis=0)
    most = np.stack([(counted & dots).sum(axis=1) for dots in on_plate]).argmax(axis=0)

    def experiment(seen: Mask, plates: Indices) -> Experiment:
        bounds = pose_bounds(rig.xyz, camera, poses, noise_px, seen)
        frames = [rig.plates[k] for k in plates]
        if noise_px:
            views = [
                plate.camera_pose(*pose) for plate, *pose in zip(frames, poses.rotation, poses.translation, strict=True)
            ]
            rotation, translation = (np.stack(part) for part in zip(*views, strict=True))
            separation = flip_separation(rotation, translation, covariance(bounds.information)) / noise_px
            bounds = replace(bounds, separation=separation)
        return Experiment(rig.xyz, rig.radius, camera, poses, bounds, noise_px, runs, seed, (NEES_OF,), seen, frames)

    return {"lm": experiment(counted, most), "lm_alone": experiment(counted & on_plate[best], best)}


def rig_trials(
    series: SyntheticViews[Rig],
    noise_px: float,
    runs: int,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> dict[str, Any]:
    """Return ``bound``, ``estimators`` and ``nees`` of a rig in the form described in docs/rigs.md."""
    experiments = rig_experiments(series, noise_px, runs)
    served, distances = series.coverage.served, series.poses.by_distance().items()
    groups = {
        "by_plates": series.coverage.by_plates(),
        "by_distance": {name: both for name, mask in distances if (both := mask & served).any()},
    }
    estimators, nees = dict[str, Any](), None
    for name, experiment in experiments.items() if runs else ():
        errors = all_errors(experiment, workers, progress)[NEES_OF]
        assert isinstance(errors, PoseErrors)
        estimators[name] = _by_group(partial(_rig_summary, experiment.bounds, errors), served, groups)
        nees = nees or nees_statistics(errors.nees[served])
    return {
        "bound": _by_group(experiments["lm"].bounds.summary, served, groups),
        "estimators": estimators,
        "nees": nees,
    }


def _rig_summary(bounds: PoseBounds, errors: PoseErrors, poses: Mask) -> dict[str, Any]:
    return {
        "poses": int(poses.sum()),
        "bound": bounds.summary(poses),
        **pose_summary(bounds, errors, poses),
        "nees": nees_statistics(errors.nees[poses])["mean"],
    }


def run_experiment(
    marker: Marker,
    camera: Camera,
    poses: PoseDistribution,
    noise_px: float = NOISE_PX,
    runs: int = RUNS,
    seed: int = 0,
    estimators: Sequence[str] | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    condition: Array | None = None,
) -> TrialResults:
    """Run noisy trials of a marker with each estimator at every pose that sees all of it, and compute their bounds.

    Parameters
    ----------
    noise_px : float
        Standard deviation of the Gaussian noise on every image coordinate.
    runs : int
        Trials per pose; 0 gives the bounds alone.
    seed : int
        Equal seeds give equal results, whatever the number of workers.
    estimators : sequence of str or None
        Names from `ESTIMATORS`; None takes all that support the marker (a relief excludes the planar ones).
    workers : int or None
        Number of processes; None takes as many as the processors and the amount of work justify, 1 uses this process.
    progress : callable or None
        Called with the number of poses done and the total.
    condition : array (P,) or None
        Condition numbers to report, one for every pose that sees the entire marker.

    Raises
    ------
    InputError
        If a number is out of range, an estimator is unknown or unfit for a relief, or no pose sees the entire marker.
    """
    check_trials(noise_px, runs, seed)
    poses = poses_that_serve(marker, camera, poses)
    points, seen = marker.xyz, partly_seen(marker, camera, poses)
    experiment = Experiment(
        points=points,
        radius=marker.boundary.radius,
        camera=camera,
        poses=poses,
        bounds=pose_bounds(points, camera, poses, noise_px, seen),
        noise_px=noise_px,
        runs=runs,
        seed=seed,
        estimators=tuple(
            # A homography is compared on all of the marker.
            name
            for name in _fitting(points, estimators)
            if seen is None or isinstance(ESTIMATORS[name], PoseEstimator)
        ),
        seen=seen,
    )
    if condition is not None and len(condition) != len(poses):
        raise ValueError(f"{len(condition)} condition numbers for {len(poses)} poses")
    if not runs:
        return TrialResults(marker, experiment, {}, condition)
    return TrialResults(marker, experiment, all_errors(experiment, workers, progress), condition)


def all_errors(
    experiment: Experiment, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> dict[str, Errors]:
    """Errors of every estimator, arrays (P, runs), distributed over processes."""
    count = len(experiment.poses)
    workers = workers_for(workers, 1 + count * experiment.runs // WORTH_A_WORKER)
    size = max(POSES_AT_ONCE, AT_ONCE // max(experiment.runs, 1))
    results = map_counted(partial(run_trials, experiment), chunks_of(count, size), workers, progress)
    return join([errors for chunk in results for errors in chunk], stack=True)


def run_trials(experiment: Experiment, indices: Iterable[int]) -> list[dict[str, Errors]]:
    """Errors of every estimator, arrays (runs,), for each pose with one of these indices; nan where it sees no dot."""
    parts: dict[int, list[dict[str, Errors]]] = {index: [] for index in indices}
    for _, group in groupby(_blocks(experiment, parts), itemgetter(0)):
        _, poses, layouts, images = zip(*group, strict=True)
        ends = np.cumsum([len(block) for block in images])
        # A layout for each trial would be copied by every estimator.
        points = layouts[0] if experiment.seen is None else np.repeat(layouts, np.diff(ends, prepend=0), axis=0)
        batch = Correspondences.from_distorted(points, np.concatenate(images), experiment.camera)
        for index, layout, end, block in zip(poses, layouts, ends, images, strict=True):
            solve = partial(_errors, experiment, index, layout, batch, slice(end - len(block), end))
            parts[index].append({name: solve(name) for name in experiment.estimators})
    nothing, no = np.full(experiment.runs, np.nan), np.zeros(experiment.runs, dtype=bool)
    unseen: Errors = PoseErrors(nothing, nothing, nothing, nothing, no, no)
    nowhere = [dict.fromkeys(experiment.estimators, unseen)]
    return [join(blocks or nowhere, stack=False) for blocks in parts.values()]


def _blocks(experiment: Experiment, indices: Iterable[int]) -> Iterator[tuple[tuple[int, ...], int, Array, Array]]:
    """Yield blocks of noisy images, each after what is common to those solved together, its pose, and its points."""
    trials = 0
    for index in indices:
        if experiment.seen is None or experiment.seen[index].any():
            points = experiment.points_of(index)
            for images in noisy_images(experiment, index):
                # Estimators differ for points in a plane.
                yield (len(points), int(points[:, 2].any()), trials // AT_ONCE), index, points, images
                trials += len(images)


def noisy_images(experiment: Experiment, index: int) -> Iterable[Array]:
    """Yield blocks (T, n, 2) of noisy image points of a pose, `runs` in total; the same for the same seed.

    They are distorted pixels.
    """
    # A stream for each pose, so that results do not depend on which process draws which.
    rng = np.random.default_rng(np.random.SeedSequence(experiment.seed, spawn_key=(index,)))
    rotation, translation = experiment.poses.rotation[[index]], experiment.poses.translation[[index]]
    seen = slice(None) if experiment.seen is None else experiment.seen[index]
    # Noise is drawn for all dots of a rig, so that all plates and the best alone see the same errors.
    drawn = experiment.points if experiment.frames is not None else experiment.points_of(index)
    exact = experiment.camera.project(drawn, rotation, translation)
    for start in range(0, experiment.runs, BLOCK):
        count = min(BLOCK, experiment.runs - start)
        images = exact + experiment.noise_px * rng.standard_normal((count, *exact.shape[1:]))
        yield images if experiment.frames is None else images[:, seen]


def join(parts: list[dict[str, Errors]], stack: bool) -> dict[str, Errors]:
    """Join errors by estimator: stacked along a new first axis, or concatenated."""
    together = np.stack if stack else np.concatenate
    return {
        name: type(first)(**{key: together([vars(part[name])[key] for part in parts]) for key in vars(first)})
        for name, first in parts[0].items()
    }


def _errors(
    experiment: Experiment, index: int, points: Array, batch: Correspondences, part: slice, name: str
) -> Errors:
    rotation, translation = experiment.poses.rotation[index], experiment.poses.translation[index]
    estimator = ESTIMATORS[name]
    if not isinstance(estimator, PoseEstimator):
        homography = batch.once(estimator)[part]
        grid = validation_grid(experiment.radius)
        depth = to_camera(grid, rotation[None], translation[None])[0, :, 2]
        grid = grid[depth > LEAST_DEPTH * translation[2]]
        pixels = project(grid, rotation[None], translation[None], experiment.camera.matrix)[0]
        he_px2 = homography_error_px2(homography, grid, pixels)
        return HomographyErrors(he_px2, homography_failed(points[:, :2], homography, he_px2))
    solutions = batch.once(estimator)
    rotations, place = solutions.rotation[part], solutions.translation[part, 0]
    # The pose of a rig is estimated, and mirrored, in the frame of a plate.
    in_frame, truth = (rotations[:, 0], place), (rotation, translation)
    estimate = in_frame[0]
    if experiment.frames is not None:
        frame = experiment.frames[index]
        truth = frame.camera_pose(rotation, translation)
        rotations = rotations @ frame.rotation_matrix.T
        estimate = rotations[:, 0]
        place = place - estimate @ frame.translation_vector
    te_pct = translation_error_pct(place, translation)
    failed = pose_failed(points, *in_frame, te_pct)
    can_flip = experiment.bounds.separation[index] > FLIP_SEPARATION
    flips = ~failed & flipped(in_frame[0], *truth) & can_flip
    nees = np.full(len(te_pct), np.nan)
    if estimator.name == NEES_OF and experiment.noise_px:
        kept = ~(failed | flips)
        # Bounds hold the information for noise of 1 px.
        information = experiment.bounds.information[index] / experiment.noise_px**2
        nees[kept] = pose_nees(estimate[kept], place[kept], rotation, translation, information)
    every_deg = rotation_error_deg(rotations, rotation)
    nearest_deg = np.fmin.reduce(every_deg, axis=1)
    return PoseErrors(every_deg[:, 0], nearest_deg, te_pct, nees, failed, flips)


def _fitting(points: Array, names: Sequence[str] | None) -> tuple[str, ...]:
    relief = bool(points[:, 2].any())
    if names is None:
        return tuple(name for name in ESTIMATORS if not (relief and ESTIMATORS[name].planar_only))
    for name in names:
        if relief and ESTIMATORS[name].planar_only:
            raise InputError(
                "an estimator that supports relief", repr(name), "leave it out: it requires coplanar points"
            )
    return tuple(ESTIMATORS[name].name for name in dict.fromkeys(names))


def _by_group(
    summarize: Callable[[Mask], dict[str, Any]], poses: Mask, groups: Mapping[str, Mapping[str, Mask]]
) -> dict[str, Any]:
    """Return what is made of some poses, and of those in each group by the names of the grouping and of the group."""
    by_group = {key: {name: summarize(mask) for name, mask in masks.items()} for key, masks in groups.items()}
    return summarize(poses) | by_group


def _homography(errors: HomographyErrors, poses: Mask) -> dict[str, Any]:
    failed = errors.failed[poses]
    he_px2 = errors.he_px2[poses][~failed]
    return {
        "he_px2": statistics(he_px2),
        "rms_px": statistics(np.sqrt(he_px2)),
        "failure_rate": np.mean(failed),
    }
