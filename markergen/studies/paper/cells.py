"""The cells of the study, what each does, and what each costs."""

from collections.abc import Callable, Sequence
from typing import Any

from markergen.studies.cells import Cell, Result
from markergen.studies.paper.conditioned import KIND as CONDITIONED
from markergen.studies.paper.conditioned import conditioned
from markergen.studies.paper.descent import EARLY_KIND, STEPS_KIND, descent, early
from markergen.studies.paper.joint import KIND as JOINT
from markergen.studies.paper.joint import RANDOM, RELIEFS, joint
from markergen.studies.paper.options import (
    CAMERAS,
    COORDINATES,
    GROUPS,
    NOISE_PX,
    NUMBERS,
    OBJECTIVE_OF,
    QUIET_PX,
    RANDOM_ONLY,
    PaperOptions,
)

WORK: dict[str, Callable[[Cell], Result]] = {
    CONDITIONED: conditioned,
    STEPS_KIND: descent,
    EARLY_KIND: early,
    JOINT: joint,
}

TRIAL_S, DESCENTS_S, DESCENT_S, STEPS = 1.6e-4, 0.08, 1e-3, 70
"""Seconds of one core for a trial with all estimators, and for descents under one pose together and each; steps of the
descent that is shown."""

SEARCH_S, AUTOGRAD_S = 0.025, 13.0
"""The same for a pose of a search over many, and for one that autograd has to do, whatever the poses."""

CELL_S = 25.0
"""A cell takes about so long: short enough to lose little, long enough that starting it costs nothing."""

EARLY_NUMBERS, EARLY_STARTS = (4, 6, 8), 10
JOINT_NUMBERS, JOINT_RUNS, JOINT_RANDOM_RUNS = (4, 5, 6, 8), 50, 10
"""Numbers of points of layouts for all poses, and noisy runs of a layout under each pose."""


def work(cell: Cell) -> Result:
    """Compute a cell of any kind."""
    return WORK[cell.kind](cell)


def cells_of(options: PaperOptions) -> list[Cell]:
    """All cells of the study, in a fixed order."""
    return [
        *(
            _cell(STEPS_KIND, options, camera=camera, noise_px=NOISE_PX, runs=options.step_runs)
            for camera in CAMERAS
        ),
        *_early(options),
        *_conditioned(options, options.poses, NOISE_PX, options.starts, COORDINATES[:1]),
        *_random_only(options),
        *(
            cell
            for noise_px in (NOISE_PX, QUIET_PX)
            for cell in _conditioned(options, options.fewer_poses, noise_px, options.fewer, tuple(OBJECTIVE_OF))
        ),
        *_joint(options),
    ]  # fmt: skip


def _conditioned(
    options: PaperOptions, poses: Sequence[int], noise_px: float, starts: int, optimized: Sequence[str]
) -> list[Cell]:
    settings = {
        "runs": options.runs,
        "noise_px": noise_px,
        "starts": starts,
        "optimized": dict.fromkeys(optimized, starts),
    }
    return [cell for n in NUMBERS for cell in _in_blocks(options, poses, {**settings, "n": n})]


def _random_only(options: PaperOptions) -> list[Cell]:
    settings = {"runs": options.runs, "noise_px": NOISE_PX, "starts": options.fewer, "optimized": {}}
    return _in_blocks(options, options.poses, {**settings, "n": RANDOM_ONLY})


def _in_blocks(options: PaperOptions, poses: Sequence[int], settings: dict[str, Any]) -> list[Cell]:
    """Cells of neighboring poses, that of a whole distance and polar angle at most."""
    each = seconds_of(_cell(CONDITIONED, options, poses=[0], **settings))
    size = min(max(1, int(CELL_S / each)), -(-len(poses) // GROUPS))
    return [
        _cell(CONDITIONED, options, poses=list(poses[start : start + size]), **settings)
        for start in range(0, len(poses), size)
    ]


def seconds_of(cell: Cell) -> float:
    """About how long one core takes for a cell, s."""
    settings = cell.settings
    if cell.kind == CONDITIONED:
        optimized = settings["optimized"]
        descents = sum(optimized.values())
        trials = (settings["starts"] * 1.2 + descents) * settings["runs"]
        return len(settings["poses"]) * (trials * TRIAL_S + len(optimized) * DESCENTS_S + descents * DESCENT_S)
    if cell.kind == STEPS_KIND:
        return STEPS * settings["runs"] * TRIAL_S
    if cell.kind == EARLY_KIND:
        return len(settings["poses"]) * (DESCENTS_S + 2 * settings["starts"] * DESCENT_S)
    layouts = RANDOM if settings["layout"] == "random" else 1
    searched = SEARCH_S * len(settings["poses"]) if settings["layout"] in OBJECTIVE_OF else 0.0
    if settings["layout"] == "hartley":
        searched = AUTOGRAD_S
    return len(settings["poses"]) * layouts * settings["runs"] * TRIAL_S + searched


def _early(options: PaperOptions) -> list[Cell]:
    starts = min(EARLY_STARTS, options.starts)
    return [
        _cell(EARLY_KIND, options, coordinates=name, n=n, poses=options.fewer_poses, starts=starts)
        for name in COORDINATES
        for n in EARLY_NUMBERS
    ]


def _joint(options: PaperOptions) -> list[Cell]:
    cells = []
    for name in ("ngon", "random", *OBJECTIVE_OF, *RELIEFS):
        runs = JOINT_RANDOM_RUNS if name == "random" else JOINT_RUNS
        settings = {"layout": name, "poses": options.poses, "runs": runs, "noise_px": QUIET_PX}
        cells += [_cell(JOINT, options, n=n, **settings) for n in JOINT_NUMBERS]
    return cells


def _cell(kind: str, options: PaperOptions, **settings: Any) -> Cell:
    return Cell(kind, {**settings, "seed": options.seed})
