"""Tidy table of a sweep: one row for each point of the grid, polar angle, and estimator."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.objectives import Criterion
from markergen.objectives.criteria import columns as criteria_columns
from markergen.studies.cells import Result
from markergen.studies.sweep.grid import GridPoint, Sweep, axis_text
from markergen.validation.metrics import share_interval

Array = NDArray[np.float64]
Row = dict[str, Any]

ERROR = "error"
"""Name of the only array of a cell that cannot be computed: the reason."""

ALL = "all"
"""Polar angle of the rows over all poses."""

CONFIDENCE, NORMAL_95 = 0.95, 1.959963984540054
"""Confidence level of the intervals, and the corresponding number of standard errors on each side."""

COLUMNS = (
    "layout", "control_points", "radius_mm", "dot_mm", "noise_px", "pose_count", "runs",
    "polar_angle_deg", "estimator", "trials",
    "rotation_rms_deg", "rotation_low_deg", "rotation_high_deg", "rotation_bound_deg",
    "translation_rms_pct", "translation_low_pct", "translation_high_pct", "translation_bound_pct",
    "homography_rms_px", "homography_low_px", "homography_high_px",
    "flips", "flip_rate", "flip_rate_low", "flip_rate_high",
    "failures", "failure_rate", "failure_rate_low", "failure_rate_high",
)  # fmt: skip
"""Columns after those of the axes, and before those of the criteria."""


def columns(sweep: Sweep) -> list[str]:
    """Names of the columns: the axes as written in the file, `COLUMNS`, criteria, and errors."""
    axes = (name for name in sweep.axes if name not in COLUMNS)
    return [*axes, *COLUMNS, *(f"criterion_{each.column}" for each in _criteria()), "error"]


def _criteria() -> list[Criterion]:
    """Criteria that are not among the bounds."""
    return [each for each in criteria_columns().values() if not each.bound]


def rows(sweep: Sweep, point: GridPoint, layout: Result, trials: Result | None) -> Iterator[Row]:
    """Rows of one point of the grid; missing values are omitted."""
    base: Row = {name: axis_text(value) for name, value in point.axes.items()}
    base |= {
        "layout": point.layout,
        "radius_mm": 1e3 * point.spec.boundary.radius,
        "noise_px": point.noise_px,
        "runs": sweep.runs,
    }
    error = next((str(part[ERROR]) for part in (layout, trials or {}) if ERROR in part), "")
    if error or trials is None:
        yield base | {"error": error}
        return
    base |= {"control_points": len(layout["points"]), "dot_mm": 1e3 * float(layout["dot"])}
    # Criteria are for noise of 1 px and proportional to it, except those of images, which have their own noise.
    noise = point.noise_px if point.spec.noise_model == "point" else 1.0
    for each in _criteria():
        if f"criteria.{each.key}" in layout:
            value = each.factor * float(layout[f"criteria.{each.key}"])
            base[f"criterion_{each.column}"] = value if each.noiseless else value * noise
    angles = trials["polar_angle"]
    groups = {ALL: np.ones(len(angles), dtype=bool)} | {name: angles == name for name in dict.fromkeys(angles.tolist())}
    for name, mask in groups.items():
        bounds: Row = {
            "pose_count": int(mask.sum()),
            "polar_angle_deg": name,
            "rotation_bound_deg": _root_mean_square(trials["bound.rotation_deg"][mask]),
            "translation_bound_pct": _root_mean_square(trials["bound.translation_pct"][mask]),
        }
        for estimator in point.estimators if sweep.runs else ("",):
            yield base | bounds | (_measured(trials, estimator, mask) if estimator else {})


def mean_square_interval(kept: Array, squares: Array, fourth_powers: Array) -> tuple[float, float, float]:
    """Mean square of the errors at some poses with the limits of its 95 % interval; nan if there is none.

    The poses are given and the noise is random: the variance of the mean follows from the sum of the variances at each
    pose, computed from sums (P,) of squares and fourth powers over the trials that were `kept`.
    """
    count = kept.sum()
    if not count:
        return (float("nan"),) * 3
    mean = squares.sum() / count
    if np.any(kept == 1):
        return float(mean), float("nan"), float("nan")
    held = kept > 1
    # The variance of a sum over m trials is m times that of one, estimated with m - 1 degrees of freedom.
    spread = fourth_powers[held] - squares[held] ** 2 / kept[held]
    error = np.sqrt(np.sum(np.maximum(spread, 0.0) * kept[held] / (kept[held] - 1))) / count
    return float(mean), float(max(mean - NORMAL_95 * error, 0.0)), float(mean + NORMAL_95 * error)


def _measured(trials: Result, estimator: str, mask: NDArray[np.bool_]) -> Row:
    part: Mapping[str, Any] = {
        key.removeprefix(f"{estimator}."): array[mask]
        for key, array in trials.items()
        if key.startswith(f"{estimator}.")
    }
    count = int(part["kept"].sum() + part["failed"].sum())
    row: Row = {"estimator": estimator, "trials": count}
    for name, unit in (("rotation", "deg"), ("translation", "pct"), ("homography", "px")):
        key = f"{name}_{unit}"
        if f"{key}.squares" in part:
            ends = mean_square_interval(part["kept"], part[f"{key}.squares"], part[f"{key}.fourth_powers"])
            row |= {
                f"{name}_{word}_{unit}": float(np.sqrt(end))
                for word, end in zip(("rms", "low", "high"), ends, strict=True)
            }
    for name, key in (("flip", "flipped"), ("failure", "failed")):
        if key in part:
            successes = int(part[key].sum())
            low, high = share_interval(successes, count, CONFIDENCE)
            row |= {f"{name}s": successes, f"{name}_rate": successes / count}
            row |= {f"{name}_rate_low": low, f"{name}_rate_high": high}
    return row


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
