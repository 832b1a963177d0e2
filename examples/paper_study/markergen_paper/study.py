"""The entire study: its cells and their costs, then tables, figures, claims, and a page."""

from collections.abc import Iterator, Sequence
from itertools import chain
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np

from markergen.files import write_atomic
from markergen.pool import processor_count
from markergen.presentation.plots import svg_bytes
from markergen.studies.cells import Cell
from markergen.studies.engines import Engine
from markergen.studies.run import CellProgress, run_cells
from markergen_paper.claims import CLAIMS
from markergen_paper.experiments import (
    CONDITIONED,
    DESCENT,
    EARLY,
    JOINT,
    LIMITS,
    METHODS,
    RANDOM,
    RELIEF_STARTS,
    RELIEFS,
    RESTARTS,
    SETTLING,
    work,
)
from markergen_paper.figures import figures_of
from markergen_paper.options import (
    AZIMUTHS,
    CAMERAS,
    COORDINATES,
    GROUPS,
    LEAST_PX,
    NOISE_PX,
    NUMBERS,
    OBJECTIVE_OF,
    QUIET_PX,
    RANDOM_ONLY,
    PaperOptions,
)
from markergen_paper.report import claim_rows, claims_page, index_page, rows_csv, tables_of
from markergen_paper.results import PaperResults, gather

TRIAL_S, SET_S, DESCENTS_S, DESCENT_S, STEPS = 1.5e-4, 0.007, 0.06, 8e-4, 70
"""Seconds on one core for a trial with all estimators, for a set of layouts under one pose however few they are, for
the descents of a cell together, and for each of them; number of steps of the displayed descent.
"""

SEARCH_S = {"metric": 0.011, "unit": 0.011, "pixel": 0.042, "hartley": 0.05, "pose": 0.003, "homography": 0.004}
"""Seconds on one core for one pose of a search over many, by what is minimized. Ratios of all these constants count: on
a slow processor cells of every kind take 1.2 to 1.8 times as long, and forecasts follow what the first ones take.
"""

CELL_S, SHORT_S = 25.0, 0.7
"""Target duration of a cell in s, short enough to lose little; and that up to which poses of several distances and
polar angles share a cell, long enough to make its overhead negligible.
"""

FURTHER_S = 1.7e-4
"""Seconds on one core for a trial with all estimators of `methods`."""

STEPS_S, STEP_S = 3e-4, 1e-5
"""Seconds on one core for a step of all descents of a cell together, and for each of them."""
SETTLING_STEPS = 1000
"""Number of steps of all routines together."""

EARLY_NUMBERS, EARLY_STARTS, METHODS_STARTS, SETTLING_STARTS = (4, 6, 8), 10, 5, 10
JOINT_NUMBERS, JOINT_RUNS, JOINT_RANDOM_RUNS = (4, 5, 6, 8), 50, 10
"""Numbers of points of layouts for all poses, and numbers of noisy runs per pose of a layout, and of a random one."""


def run_paper(
    folder: Path,
    options: PaperOptions,
    engine: Engine,
    resume: bool = False,
    progress: CellProgress | None = None,
) -> list[Path]:
    """Compute the study in a folder, and write its tables (CSV), figures (SVG), claims, and a page.

    The files depend only on the options, not on the engine, its workers, or interruptions.

    Parameters
    ----------
    folder : Path
        New, empty, or with `resume` that of the same study.
    progress : callable or None
        Called first with an estimate of the total time.

    Returns
    -------
    list of Path
        Written files, the page first.

    Raises
    ------
    InputError
        If the folder is not for this study.
    OutputError
        If a file cannot be written; finished cells are kept.
    """
    cells = cells_of(options)
    estimated = _with_estimate(progress, estimated_seconds(options, engine.workers)) if progress else None
    results = run_cells(
        work, cells, folder, {"study": "paper", **options.as_dict()}, engine, resume, estimated, seconds_of
    )
    written = []
    for name, data in _files(gather(options, results)):
        write_atomic(folder / name, data)
        written.append(folder / name)
    return written[::-1]


def estimated_seconds(options: PaperOptions, workers: int | None = None) -> float:
    """Estimated duration of the study on a typical current processor, s; linear in poses x starts x n x runs.

    Parameters
    ----------
    workers : int or None
        Number of processes; one per processor for None.
    """
    return sum(map(seconds_of, cells_of(options))) / (workers or processor_count())


def _with_estimate(progress: CellProgress, seconds: float) -> CellProgress:
    """Progress that reports an estimate of the time left until it can be measured."""

    def report(done: int, total: int, left: float) -> None:
        progress(done, total, seconds if isnan(left) else left)

    return report


def _files(study: PaperResults) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the files, the page last."""
    tables = tables_of(study)
    for name, rows in tables.items():
        yield f"{name}.csv", rows_csv(rows)
    figures = [(name, svg_bytes(draw, size), caption) for name, (draw, size, caption) in figures_of(study).items()]
    for name, svg, _ in figures:
        yield f"{name}.svg", svg
    findings = [(claim, list(claim.find(study))) for claim in CLAIMS]
    yield "claims.csv", rows_csv(claim_rows(findings))
    yield "claims.md", claims_page(findings, study).encode()
    yield "index.html", index_page(findings, figures, tables, study)


def cells_of(options: PaperOptions) -> list[Cell]:
    """All cells of the study, in a fixed order."""
    return [
        *(
            _cell(DESCENT, options, camera=camera, noise_px=NOISE_PX, runs=options.step_runs)
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
        *_methods(options),
        *(
            _cell(SETTLING, options, n=n, poses=list(chain(*blocks)), starts=_further(SETTLING_STARTS, options))
            for n in NUMBERS
            for blocks in (_half(options)[::2], _half(options)[1::2])
            if blocks
        ),
        *(
            _cell(LIMITS, options, n=n, poses=options.fewer_poses, starts=options.fewer) for n in EARLY_NUMBERS
        ),
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
    return [cell for n in NUMBERS for cell in _in_blocks(CONDITIONED, options, poses, {**settings, "n": n})]


def _methods(options: PaperOptions) -> list[Cell]:
    settings = {"runs": options.runs, "starts": min(METHODS_STARTS, options.fewer)}
    poses = list(chain(*_half(options)))
    return [
        cell
        for noise_px in (NOISE_PX, QUIET_PX, LEAST_PX)
        for n in NUMBERS
        for cell in _in_blocks(METHODS, options, poses, {**settings, "n": n, "noise_px": noise_px})
    ]


def _half(options: PaperOptions) -> list[list[int]]:
    """Poses at every second azimuth by distance and polar angle, or, of one azimuth, at every second of these."""
    blocks = np.reshape(options.poses, (GROUPS, -1))
    return (blocks[:, ::2] if options.azimuths > 1 else blocks[::2]).tolist()


def _further(starts: int, options: PaperOptions) -> int:
    """Number of starts of an experiment beside the paper's own: usually `starts`, fewer with small scales."""
    return min(starts, max(2, options.starts // 5))


def _random_only(options: PaperOptions) -> list[Cell]:
    settings = {"runs": options.runs, "noise_px": NOISE_PX, "starts": options.fewer, "optimized": {}}
    return _in_blocks(CONDITIONED, options, options.poses, {**settings, "n": RANDOM_ONLY})


def _in_blocks(kind: str, options: PaperOptions, poses: Sequence[int], settings: dict[str, Any]) -> list[Cell]:
    """Cells of neighboring poses: those of one distance and polar angle, or more or fewer for their duration's sake."""
    seconds, both = (seconds_of(_cell(kind, options, poses=[0] * count, **settings)) for count in (1, 2))
    block = -(-len(poses) // len({pose // AZIMUTHS for pose in poses}))
    size = min(max(1, int(CELL_S / seconds)), max(block, int(SHORT_S / (both - seconds))))
    return [
        _cell(kind, options, poses=list(poses[start : start + size]), **settings)
        for start in range(0, len(poses), size)
    ]


def seconds_of(cell: Cell) -> float:
    """Estimated time of a cell on one core, s."""
    settings = cell.settings
    if cell.kind == CONDITIONED:
        optimized = settings["optimized"]
        descents = sum(optimized.values())
        trials = (settings["starts"] * 1.2 + descents) * settings["runs"]
        for_a_pose = trials * TRIAL_S + (len(optimized) + 2) * SET_S + descents * DESCENT_S
        return len(optimized) * DESCENTS_S + len(settings["poses"]) * for_a_pose
    if cell.kind == DESCENT:
        return STEPS * settings["runs"] * TRIAL_S
    if cell.kind == EARLY:
        return DESCENTS_S + len(settings["poses"]) * settings["starts"] * DESCENT_S
    if cell.kind == METHODS:
        trials = 3 * settings["starts"] * settings["runs"]
        for_a_pose = trials * FURTHER_S + 2 * SET_S + settings["starts"] * DESCENT_S
        return DESCENTS_S + len(settings["poses"]) * for_a_pose
    if cell.kind == SETTLING:
        return SETTLING_STEPS * (STEPS_S + len(settings["poses"]) * settings["starts"] * STEP_S)
    if cell.kind == LIMITS:
        return 2 * (DESCENTS_S + len(settings["poses"]) * settings["starts"] * DESCENT_S)
    layouts = RANDOM if settings["layout"] == "random" else 1
    for_a_pose = SET_S / 2 + layouts * settings["runs"] * TRIAL_S + SEARCH_S.get(settings["layout"], 0.0)
    return len(settings["poses"]) * for_a_pose


def _early(options: PaperOptions) -> list[Cell]:
    starts = _further(EARLY_STARTS, options)
    return [
        _cell(EARLY, options, coordinates=name, n=n, poses=options.fewer_poses, starts=starts)
        for name in COORDINATES
        for n in EARLY_NUMBERS
    ]


def _joint(options: PaperOptions) -> list[Cell]:
    cells = []
    for name in ("ngon", "random", *OBJECTIVE_OF, *RELIEFS):
        runs = options.reduced(JOINT_RANDOM_RUNS if name == "random" else JOINT_RUNS, 2)
        settings = {"layout": name, "poses": options.poses, "runs": runs, "noise_px": QUIET_PX}
        if options.scale < 0.25:
            settings["restarts"] = options.reduced(RELIEF_STARTS if name in RELIEFS else RESTARTS, 1)
        cells += [_cell(JOINT, options, n=n, **settings) for n in JOINT_NUMBERS]
    return cells


def _cell(kind: str, options: PaperOptions, **settings: Any) -> Cell:
    return Cell(kind, {**settings, "seed": options.seed})
