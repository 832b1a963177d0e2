"""The two kinds of cells of a sweep: a layout with its criteria, and the trials of a layout at one noise."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import MarkergenError
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.objectives.criteria import criteria
from markergen.objectives.observation import DotNoise
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.design import design
from markergen.optimize.dot_size import DotSize, choose_dots
from markergen.optimize.problem import Region, room_of
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping
from markergen.studies.cells import Cell, Result
from markergen.studies.sweep.grid import GridPoint
from markergen.validation.bounds import pose_bounds
from markergen.validation.trials import Experiment, HomographyErrors, PoseErrors, join, run_trials

Array = NDArray[np.float64]

ERROR = "error"
"""Name of the array that a cell has alone if it cannot be computed: the reason."""


def layout_cell(point: GridPoint) -> Cell:
    """Cell of the layout at a point of the grid."""
    return Cell("layout", {"spec": point.spec.as_dict(), "layout": point.layout})


def trials_cell(point: GridPoint, points: Array, runs: int) -> Cell:
    """Cell of the trials at a point of the grid, for the layout (n, 3) in m that was found for it."""
    settings = {"spec": point.spec.as_dict(), "points": points.tolist(), "noise_px": point.noise_px, "runs": runs}
    return Cell("trials", {**settings, "estimators": list(point.estimators)})


def work(cell: Cell) -> Result:
    """Compute a cell of either kind; what cannot be is a result, too, with the reason as `ERROR`."""
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
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera)
    setting = Setting(spec.boundary, spec.camera, poses)
    dots = choose_dots(spec, poses)
    if spec.noise_model == "image":
        setting = replace(setting, noise=DotNoise(dots.diameter, spec.image_noise, spec.print_sigma))
    region = Region(room_of(spec), dots.diameter, dots.clearance)
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
    """What statistics over any of the poses are made from: counts, and sums of squares and of fourth powers."""
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
