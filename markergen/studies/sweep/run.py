"""Running a sweep: cells for layouts with their criteria, and for their trials at each noise."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import MarkergenError
from markergen.files import write_all
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.objectives.criteria import criteria
from markergen.objectives.observation import DotNoise
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.design import design
from markergen.optimize.dot_size import DotSize, choose_dots
from markergen.optimize.problem import FeasibleRegion, room_of
from markergen.optimize.target import settled
from markergen.presentation.tables import csv_bytes
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping
from markergen.studies.cells import Cell, Result
from markergen.studies.engines import Engine
from markergen.studies.run import CellProgress, Store, compute, open_store
from markergen.studies.sweep.grid import GridPoint, Sweep
from markergen.studies.sweep.report import page, plots
from markergen.studies.sweep.table import ERROR, Row, columns, rows
from markergen.validation.bounds import pose_bounds
from markergen.validation.trials import Experiment, HomographyErrors, PoseErrors, join, run_trials

Array = NDArray[np.float64]

DESIGN_SECONDS, LAYOUT_SECONDS, TRIAL_SECONDS = 2.0, 0.4, 5e-5
"""Rough costs in s on one core of a design, another layout, and a trial of one estimator at one pose."""

TYPICAL_POSES = 400

DIGITS = 6
"""Significant digits of the table."""


def run_sweep(
    sweep: Sweep, folder: Path, engine: Engine, resume: bool = False, progress: CellProgress | None = None
) -> list[Path]:
    """Compute a sweep and write its table, plots and page; returns their paths, the page last.

    Raises
    ------
    InputError
        If the folder is not for this sweep (see `open_store`).
    OutputError
        If something cannot be written; finished cells are kept.
    """
    with open_store(folder, sweep.identity, resume) as store:
        table = _table(sweep, store, engine, progress)
        files = {folder / "table.csv": csv_bytes(table, columns(sweep), DIGITS)}
        drawn = plots(sweep, table)
        files |= {folder / f"{plot.name}.svg": plot.svg for plot in drawn}
        files[folder / "index.html"] = page(sweep, table, drawn)
        write_all(files)
    return list(files)


def _table(sweep: Sweep, store: Store, engine: Engine, progress: CellProgress | None) -> list[Row]:
    """Rows in the order of the grid."""
    first = [layout_cell(point) for point in sweep.points]
    # The trials of a layout are known before the layout itself.
    tried = {
        (cell, point.noise_px): _trials_cost(point, sweep.runs) for cell, point in zip(first, sweep.points, strict=True)
    }
    layouts = compute(
        work, first, store, engine, progress, _layout_cost, later=(len(tried), sum(tried.values()))
    )  # fmt: skip
    second: list[Cell | None] = []
    for point, cell in zip(sweep.points, first, strict=True):
        layout = layouts[cell]
        second.append(None if ERROR in layout else trials_cell(point, layout["points"], sweep.runs))
    cells = [cell for cell in second if cell is not None]
    trials = compute(work, cells, store, engine, progress, before=len(layouts))
    return [
        row
        for point, layout, cell in zip(sweep.points, first, second, strict=True)
        for row in rows(sweep, point, layouts[layout], trials[cell] if cell else None)
    ]


def _layout_cost(cell: Cell) -> float:
    return DESIGN_SECONDS if cell.settings["layout"] == "designed" else LAYOUT_SECONDS


def _trials_cost(point: GridPoint, runs: int) -> float:
    return TRIAL_SECONDS * TYPICAL_POSES * runs * len(point.estimators)


def layout_cell(point: GridPoint) -> Cell:
    """Cell of the layout at a point of the grid."""
    return Cell("layout", {"spec": point.spec.as_dict(), "layout": point.layout})


def trials_cell(point: GridPoint, points: Array, runs: int) -> Cell:
    """Cell of the trials at a point of the grid, for its layout (n, 3) in m."""
    settings = {"spec": point.spec.as_dict(), "points": points.tolist(), "noise_px": point.noise_px, "runs": runs}
    return Cell("trials", {**settings, "estimators": list(point.estimators)})


def work(cell: Cell) -> Result:
    """Compute a cell of either kind; a failure is also a result, with its reason as `ERROR`."""
    try:
        spec = spec_from_mapping(cell.settings["spec"], "the cell", stored=True)
        return _layout(spec, cell) if cell.kind == "layout" else _trials(spec, cell.settings, cell.seed)
    except MarkergenError as error:
        return {ERROR: np.array(str(error))}


def _layout(spec: Spec, cell: Cell) -> Result:
    """Points (n, 3) and dots in m, and each criterion for the noise of the setting, by name."""
    kind = cell.settings["layout"]
    if kind == "designed":
        found = design(spec)
        points, dots, values = found.marker.xyz, found.dots, found.criteria["design"]
    else:
        points, dots, values = _given_layout(spec, kind, cell.seed)
    return {
        "points": points,
        "dot": np.array(dots.diameter),
        "clearance": np.array(dots.clearance),
        **{f"criteria.{name}": np.array(value) for name, value in values.items()},
    }


def _given_layout(spec: Spec, kind: str, seed: int) -> tuple[Array, DotSize, Mapping[str, float]]:
    choice = settled(spec)
    spec = choice.spec if choice else spec
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera)
    setting = Setting(spec.boundary, spec.camera, poses)
    dots = choose_dots(spec, poses)
    if spec.noise_model == "image":
        setting = replace(setting, noise=DotNoise(dots.diameter, spec.image_noise, spec.print_sigma))
    region = FeasibleRegion(room_of(spec), dots.diameter, dots.clearance, spec.gap)
    layouts = comparison_layouts(region, spec.n, seed, setting).get(kind)
    if layouts is None:
        raise MarkergenError(f"expected room for the layout {kind}, found that its dots would touch")
    flat = layouts[0]
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points, dots, criteria(flat[None], setting)[0]


def _trials(spec: Spec, settings: Mapping[str, Any], seed: int) -> Result:
    """Sums over the trials of each pose, and the bounds, arrays (P,)."""
    points = np.array(settings["points"])
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    bounds = pose_bounds(points, spec.camera, poses, settings["noise_px"])
    groups = np.zeros(len(poses), dtype="U16")
    for name, mask in poses.by_polar_angle().items():
        groups[mask] = name
    result = {
        "polar_angle": groups,
        "bound.rotation_deg": bounds.rotation_deg,
        "bound.translation_pct": bounds.translation_pct,
    }
    if not settings["runs"]:
        return result
    experiment = Experiment(
        points=points,
        radius=spec.boundary.radius,
        camera=spec.camera,
        poses=poses,
        bounds=bounds,
        noise_px=settings["noise_px"],
        runs=settings["runs"],
        seed=seed,
        estimators=tuple(settings["estimators"]),
    )
    for name, errors in join(run_trials(experiment, range(len(poses))), stack=True).items():
        result |= {f"{name}.{key}": array for key, array in _sums(errors).items()}
    return result


def _sums(errors: PoseErrors | HomographyErrors) -> Result:
    """Sums for statistics over any subset of the poses: counts, squares and fourth powers."""
    kept = ~errors.failed
    found: Result = {"kept": kept.sum(axis=1), "failed": errors.failed.sum(axis=1)}
    if isinstance(errors, HomographyErrors):
        squares = {"homography_px": errors.he_px2}
    else:
        found["flipped"] = errors.flipped.sum(axis=1)
        squares = {"rotation_deg": errors.rotation_deg**2, "translation_pct": errors.translation_pct**2}
    for name, square in squares.items():
        square = np.where(kept, square, 0.0)
        found[f"{name}.squares"] = square.sum(axis=1)
        found[f"{name}.fourth_powers"] = (square**2).sum(axis=1)
    return found
