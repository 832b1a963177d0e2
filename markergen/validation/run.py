"""Validate a marker: trials at every pose, spread over processes, against the bounds."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.estimators import ESTIMATORS
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.pool import map_chunks, workers_for
from markergen.validation.bounds import pose_bounds
from markergen.validation.result import ValidationResult
from markergen.validation.trials import Experiment, join, run_trials

Array = NDArray[np.float64]

MOST_RUNS = 1_000_000
POSES_AT_ONCE = 4
"""Poses in one chunk of work: about a second of computing at 1000 runs."""
MOST_NOISE_PX = 1000.0
"""Beyond any image; no estimate means anything long before."""
WORTH_A_WORKER = 10_000
"""Trials (poses times runs) below which starting another process takes longer than it saves."""


def validate(
    marker: Marker,
    camera: Camera,
    poses: PoseDistribution,
    noise_px: float = 0.2,
    runs: int = 1000,
    seed: int = 0,
    estimators: Sequence[str] | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    condition: Array | None = None,
) -> ValidationResult:
    """Run noisy trials of a marker at every pose that sees it whole, with each estimator, and bound them.

    Parameters
    ----------
    marker : Marker
    camera : Camera
    poses : PoseDistribution
    noise_px : float
        Standard deviation of the Gaussian noise on every image coordinate.
    runs : int
        Trials per pose; 0 gives the bounds alone.
    seed : int
        Equal seeds give equal results, whatever the number of workers.
    estimators : sequence of str or None
        Names from `ESTIMATORS`; None takes all that can do with the marker (a relief rules the planar ones out).
    workers : int or None
        Processes; None takes as many as there are processors and as the work is worth, 1 computes in this process.
    progress : callable or None
        Called with the number of poses done and the number of all.
    condition : array (P,) or None
        Condition numbers to report, one for every pose that sees the marker whole.

    Raises
    ------
    InputError
        If a number is out of range, an estimator unknown or not fit for a relief, or no pose sees the marker whole.
    """
    _check(noise_px, runs, seed)
    poses = poses.seen_whole(marker.boundary, camera, marker.height)
    points = marker.xyz
    experiment = Experiment(
        points=points,
        radius=marker.boundary.radius,
        camera=camera,
        poses=poses,
        bounds=pose_bounds(points, camera, poses, noise_px),
        noise_px=noise_px,
        runs=runs,
        seed=seed,
        estimators=_fitting(points, estimators),
    )
    if condition is not None and len(condition) != len(poses):
        raise ValueError(f"{len(condition)} condition numbers for {len(poses)} poses")
    if not runs:
        return ValidationResult(marker, experiment, {}, condition)
    worth = 1 + len(poses) * runs // WORTH_A_WORKER
    chunks = [range(start, min(start + POSES_AT_ONCE, len(poses))) for start in range(0, len(poses), POSES_AT_ONCE)]
    done = 0
    if progress is not None:
        progress(0, len(poses))

    def finished(index: int) -> None:
        nonlocal done
        done += len(chunks[index])
        if progress is not None:
            progress(done, len(poses))

    workers = workers_for(workers, worth)
    results = map_chunks(partial(run_trials, experiment), chunks, min(workers, len(chunks)), finished)
    errors = join([errors for chunk in results for errors in chunk], stack=True)
    return ValidationResult(marker, experiment, errors, condition)


def _fitting(points: Array, names: Sequence[str] | None) -> tuple[str, ...]:
    relief = bool(points[:, 2].any())
    if names is None:
        return tuple(name for name in ESTIMATORS if not (relief and ESTIMATORS[name].planar_only))
    for name in names:
        if relief and ESTIMATORS[name].planar_only:
            raise InputError(
                "an estimator that can do with a relief", repr(name), "leave it out: it is for points in one plane"
            )
    return tuple(ESTIMATORS[name].name for name in dict.fromkeys(names))


def _check(noise_px: float, runs: int, seed: int) -> None:
    if not 0 <= noise_px <= MOST_NOISE_PX:
        expected = f"a noise from 0 to {MOST_NOISE_PX:g} px"
        raise InputError(expected, f"noise={noise_px}", "give --noise a number such as 0.2")
    if not 0 <= runs <= MOST_RUNS:
        raise InputError(f"0 to {MOST_RUNS} runs", f"runs={runs}", "give --runs a whole number such as 1000")
    if seed < 0:
        raise InputError("a seed of 0 or more", f"seed={seed}", "give a non-negative whole number")
