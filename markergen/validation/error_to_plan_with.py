"""The error that a user should plan with, RMS over all poses to first order, checked by samples and rendered views."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.estimators.budget import PoseBudget
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.validation.expectation import Expectation, expect
from markergen.validation.metrics import rms, rms_interval, share_interval
from markergen.validation.views import SyntheticViews

FOCAL_PX, CENTER_PX = 2.0, 1.5
"""Standard deviations of a calibration that is not exact."""
CONFIDENCE = 0.99
"""Probability with which views agree in all comparisons together, if the expected errors are right."""
MODEL = 0.03
"""Relative error of the expected errors, by which the intervals are widened; see `expectation`."""
LOST = 0.01
"""Share of views without a pose that is not worth a word of disagreement."""
SERIES, LOOKUPS = 4000, 20_000_000
"""Number of series of views that are drawn for an interval, and the most views in all of them."""
_KEYS = ("rotation_deg", "translation_mm")


def plan_for(expected: Expectation, series: SyntheticViews[Marker], bare_px: float, seed: int) -> dict[str, Any]:
    """`plan_of` a series, with ``calibration``: if it is taken as exact, what one that is a little off would cost.

    ``calibration`` has ``focal_px`` and ``center_px``, the standard deviations of fx and fy and of cx and cy, and the
    RMS over all poses of ``rotation_deg`` and ``translation_pct`` with this calibration.
    """
    plan = plan_of(expected, series) | {"calibration": None}
    if series.errors.camera_covariance is None:
        sigma = [FOCAL_PX] * 2 + [CENTER_PX] * 2 + [0.0] * len(series.camera.distortion.coefficients)
        off = replace(series, errors=replace(series.errors, camera_covariance=np.diag(np.square(sigma))))
        over_all = _cell(expect(off, bare_px, seed), series.poses, np.ones(len(series.poses), dtype=bool))
        plan["calibration"] = {"focal_px": FOCAL_PX, "center_px": CENTER_PX} | {
            key: over_all[key] for key in ("rotation_deg", "translation_pct")
        }
    return plan


def plan_for_rig(series: SyntheticViews[Rig], joint: PoseBudget, alone: PoseBudget) -> dict[str, Any]:
    """Errors to expect of a rig, to first order: over all poses, which is to plan with, and by the plates in view.

    Parameters
    ----------
    joint, alone : PoseBudget
        Of all plates in view, and of the best of them by itself; see `budget_of`.
    """
    by_plates, errors = series.coverage.by_plates(), series.errors
    expected = {name: _first_order(joint, mask) for name, mask in by_plates.items()}
    rows = {
        name: {"poses": int(mask.sum()), **expected[name], "alone": _first_order(alone, mask)}
        for name, mask in by_plates.items()
    }
    served = series.coverage.served
    measured = any(plate.marker.places_measured for plate in series.marker.plates)
    return {
        **_first_order(joint, served),
        "distance": float(series.poses.distance[served].max()),
        "by_plates": rows,
        "all": {"poses": int(served.sum()), **_first_order(joint, served)},
        "alone": _first_order(alone, served),
        "source": source_of(1e3 * errors.print_sigma, errors.camera_covariance is not None, measured),
        "exact": _exact(series),
    }


def _first_order(budget: PoseBudget, poses: Mask) -> dict[str, float]:
    return {
        "rotation_deg": rms(budget.rotation_deg["total"][poses]),
        "translation_mm": rms(1e3 * budget.translation["total"][poses]),
    }


def plan_of(expected: Expectation, series: SyntheticViews[Marker]) -> dict[str, Any]:
    """Expected errors over all poses of a series, and in the hardest cell, the distance and tilt with the largest.

    Returns
    -------
    dict
        ``rotation_deg`` and ``translation_mm``, to plan with: the RMS over all poses to first order, as `PlannedError`
        has it, up to the farthest ``distance`` in m. ``hardest`` with the hardest cells
        as ``rotation_deg`` and ``translation_mm``, and ``all``, with ``poses``, the RMS ``rotation_deg``,
        ``translation_mm``, ``translation_pct`` and ``first_order_deg``, ``flip_rate``, ``failure_rate``, and the number
        of ``sampled`` poses; the cells also with ``distance`` and ``tilt``. ``draws``: estimates at each sampled pose.
        ``source``: the errors that were counted, in words; ``exact``: what was taken as exact.
    """
    poses, errors = series.poses, series.errors
    is_calibrated, cells, hardest = errors.camera_covariance is not None, cells_of(poses), {}
    for key in _KEYS:
        values = getattr(expected, key)
        name = max(cells, key=lambda cell: rms(values[cells[cell]]))
        hardest[key] = _cell(expected, poses, cells[name]) | {"distance": name[0], "tilt": name[1]}
    return {
        "rotation_deg": rms(expected.first_order_deg),
        "translation_mm": rms(expected.first_order_mm),
        "distance": float(poses.distance.max()),
        "hardest": hardest,
        "all": _cell(expected, poses, np.ones(len(poses), dtype=bool)),
        "draws": expected.drawn_deg.shape[1],
        "source": source_of(1e3 * errors.print_sigma, is_calibrated, series.marker.places_measured),
        "exact": _exact(series),
        "views": None,
    }


def cells_of(poses: PoseDistribution) -> dict[tuple[str, str], Mask]:
    """Masks (P,) of the poses at each distance and tilt, by their names; nearest first, without empty ones."""
    return {
        (distance, tilt): both
        for distance, is_at_distance in poses.by_distance().items()
        for tilt, is_tilted in poses.by_polar_angle().items()
        if (both := is_at_distance & is_tilted).any()
    }


def middle(group: str) -> float:
    """Center of a group from its name, such as ``35`` or ``30..40``."""
    return float(np.mean([float(end) for end in group.split("..")]))


def compare_views(
    expected: Expectation, poses: PoseDistribution, views: Mapping[str, Any], plan: Mapping[str, Any], seed: int
) -> dict[str, Any]:
    """Compare the errors of rendered views with those expected at their poses, unless dots are hidden in the views.

    The interval of an RMS over N views comes from drawing such series of N errors again and again at the same poses,
    flips included. All intervals together hold with probability `CONFIDENCE`, if the expected errors are right to 3 %.

    Parameters
    ----------
    expected : Expectation
        Expected errors with an exact calibration, as that of the views.
    views : mapping
        Summary of the views, see `view_records.summarize`.
    plan : mapping
        Return value of `plan_of`.

    Returns
    -------
    dict
        ``hardest`` and ``all``, each with ``rotation_deg`` and ``translation_mm``: ``count``, ``rms``, its 95 %
        ``interval``, a bootstrap over these views (None of fewer than two), and of the error to expect of them
        ``expected``, ``low`` and ``high``; ``agrees`` (1 or 0). ``lost``: views without a pose;
        ``lost_interval`` of their share. ``disagreements``: comparisons that failed.
    """
    cells, every = cells_of(poses), np.ones(len(poses), dtype=bool)
    samples = [sample for sample in views["samples"] if np.isfinite(sample["rotation_deg"])]
    lost = views["count"] - len(samples)
    if views["hidden"]:
        # What is expected is expected of all dots.
        samples = []
    hardest = {key: cells[cell["distance"], cell["tilt"]] for key, cell in plan["hardest"].items()}
    compared: dict[str, Any] = {
        name: {
            key: _compared(expected, key, [sample for sample in samples if masks[key][sample["pose"]]], seed)
            for key in _KEYS
        }
        for name, masks in (("hardest", hardest), ("all", dict.fromkeys(_KEYS, every)))
    }
    interval = share_interval(lost, views["count"])
    failed = sum(comparison["agrees"] == 0 for part in compared.values() for comparison in part.values())
    return {
        **compared,
        "lost": lost,
        "lost_interval": interval,
        "disagreements": failed + int(interval[0] > LOST),
    }


def source_of(print_sigma_mm: float, calibrated: bool, measured: bool = False) -> str:
    """Name the sources of the expected errors: image noise, the print, and the calibration if its errors are given."""
    printed = "a print as it was measured" if measured else f"a print good to {print_sigma_mm:g} mm"
    return f"image noise, {printed} and the camera's calibration" if calibrated else f"image noise and {printed}"


def _exact(series: SyntheticViews[Any]) -> str:
    return series.errors.of(series.marker.plates[0].marker).exact


def _cell(expected: Expectation, poses: PoseDistribution, chosen: Mask) -> dict[str, Any]:
    return {
        "poses": int(chosen.sum()),
        "rotation_deg": rms(expected.rotation_deg[chosen]),
        "translation_mm": rms(expected.translation_mm[chosen]),
        "translation_pct": rms(expected.translation_mm[chosen] / (10 * poses.distance[chosen])),
        "first_order_deg": rms(expected.first_order_deg[chosen]),
        "flip_rate": np.mean(expected.flip_rate[chosen]),
        "failure_rate": np.mean(expected.failure_rate[chosen]),
        "sampled": int(expected.sampled[chosen].sum()),
    }


def _compared(expected: Expectation, key: str, samples: Sequence[Mapping[str, Any]], seed: int) -> dict[str, Any]:
    if not samples:
        return {"count": 0, **dict.fromkeys(("rms", "interval", "expected", "low", "high", "agrees"))}
    at = np.array([sample["pose"] for sample in samples])
    if key == "rotation_deg":
        measured, drawn = np.array([sample["rotation_deg"] for sample in samples]), expected.drawn_deg
    else:
        measured, drawn = (
            np.linalg.norm([sample["translation_error_mm"] for sample in samples], axis=-1),
            expected.drawn_mm,
        )
    low, high = _interval(drawn, at, np.random.default_rng([seed, len(samples)]))
    seen = rms(measured)
    return {
        "count": len(samples),
        "rms": seen,
        "interval": rms_interval(measured, seed),
        "expected": rms(getattr(expected, key)[at]),
        "low": low,
        "high": high,
        "agrees": int(low <= seen <= high),
    }


def _interval(drawn: Array, at: NDArray[np.intp], rng: np.random.Generator) -> tuple[float, float]:
    """Interval of the RMS of one draw at each pose `at`, by drawing such series."""
    squares = np.square(drawn)
    if not np.isfinite(squares[at]).any(axis=1).all():
        return 0.0, np.inf
    count = int(np.clip(LOOKUPS // len(at), 1000, SERIES))
    means = np.empty(count)
    at_once = max(1, 1_000_000 // len(at))
    for start in range(0, count, at_once):
        chosen = rng.integers(squares.shape[1], size=(min(at_once, count - start), len(at)))
        means[start : start + at_once] = np.nanmean(squares[at, chosen], axis=1)
    # Two errors in two sets of views.
    tail = (1 - CONFIDENCE) / 8
    low, high = np.sqrt(np.quantile(means, [tail, 1 - tail]))
    return float(low * (1 - MODEL)), float(high * (1 + MODEL))
