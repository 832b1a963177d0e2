"""The error that a user should plan with: that of the hardest distance and tilt, checked against the rendered views."""

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
from markergen.presentation.tables import number, percent
from markergen.validation.expectation import Expectation, expect
from markergen.validation.metrics import rms, share_interval
from markergen.validation.views import SyntheticViews

FOCAL_PX, CENTER_PX = 2.0, 1.5
"""Standard deviations of a calibration that is not exact."""
CONFIDENCE = 0.99
"""Probability with which views agree in all comparisons together, if the expected errors are right."""
MODEL = 0.03
"""Relative error of the expected errors, by which the intervals are widened; see `expectation`."""
LOST = 0.01
"""Share of views without a pose that is not worth a word of disagreement."""
LEAST_SAID = 1e-3
"""Share of flips from which it is stated."""
SERIES, LOOKUPS = 4000, 20_000_000
"""Number of series of views that are drawn for an interval, and the most views in all of them."""
_KEYS = ("rotation_deg", "translation_mm")
_UNITS = {"rotation_deg": "deg", "translation_mm": "mm"}


def of(expected: Expectation, series: SyntheticViews[Marker], bare_px: float, seed: int) -> dict[str, Any]:
    """`headline` for a series, with ``calibration``: if it is taken as exact, what one that is a little off would cost.

    ``calibration`` has ``focal_px`` and ``center_px``, the standard deviations of fx and fy and of cx and cy, and the
    RMS over all poses of ``rotation_deg`` and ``translation_pct`` with this calibration.
    """
    errors, camera = series.errors, series.camera
    calibrated = errors.camera_covariance is not None
    plan = headline(
        expected, series.poses, source_of(1e3 * errors.print_sigma, calibrated, series.marker.places_measured)
    )
    plan["calibration"] = None
    if not calibrated:
        sigma = [FOCAL_PX] * 2 + [CENTER_PX] * 2 + [0.0] * len(camera.distortion.coefficients)
        off = replace(series, errors=replace(errors, camera_covariance=np.diag(np.square(sigma))))
        with_it = expect(off, bare_px, seed)
        over_all = _cell(with_it, series.poses, np.ones(len(series.poses), dtype=bool))
        plan["calibration"] = {"focal_px": FOCAL_PX, "center_px": CENTER_PX} | {
            key: over_all[key] for key in ("rotation_deg", "translation_pct")
        }
    return plan


def of_rig(series: SyntheticViews[Rig], joint: PoseBudget, alone: PoseBudget) -> dict[str, Any]:
    """Errors to expect of a rig, to first order: by the number of plates in view, and in the hardest case to plan with.

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
        **{key: max(row[key] for row in expected.values()) for key in _KEYS},
        "by_plates": rows,
        "all": {"poses": int(served.sum()), **_first_order(joint, served)},
        "alone": _first_order(alone, served),
        "source": source_of(1e3 * errors.print_sigma, errors.camera_covariance is not None, measured),
    }


def _first_order(budget: PoseBudget, poses: Mask) -> dict[str, float]:
    return {
        "rotation_deg": rms(budget.rotation_deg["total"][poses]),
        "translation_mm": rms(1e3 * budget.translation["total"][poses]),
    }


def headline(expected: Expectation, poses: PoseDistribution, source: str) -> dict[str, Any]:
    """Expected errors in the hardest cell, the distance and tilt with the largest error, and over all poses.

    Returns
    -------
    dict
        ``rotation_deg`` and ``translation_mm``, to plan with: the RMS in its hardest cell. ``hardest`` with these cells
        as ``rotation_deg`` and ``translation_mm``, and ``all``, with ``poses``, the RMS ``rotation_deg``,
        ``translation_mm``, ``translation_pct`` and ``first_order_deg``, ``flip_rate``, ``failure_rate``, and the number
        of ``sampled`` poses; the cells also with ``distance`` and ``tilt``. ``draws``: estimates at each sampled pose.
        ``source``: the errors that were counted, in words.
    """
    cells = cells_of(poses)
    hardest = {}
    for key in _KEYS:
        values = getattr(expected, key)
        name = max(cells, key=lambda cell: rms(values[cells[cell]]))
        hardest[key] = _cell(expected, poses, cells[name]) | {"distance": name[0], "tilt": name[1]}
    return {
        **{key: hardest[key][key] for key in _KEYS},
        "hardest": hardest,
        "all": _cell(expected, poses, np.ones(len(poses), dtype=bool)),
        "draws": expected.drawn_deg.shape[1],
        "source": source,
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
    """Compare the errors of rendered views with those expected at their poses.

    The interval of an RMS over N views comes from drawing such series of N errors again and again at the same poses,
    flips included. All intervals together hold with probability `CONFIDENCE`, if the expected errors are right to 3 %.

    Parameters
    ----------
    expected : Expectation
        Expected errors with an exact calibration, as that of the views.
    views : mapping
        Summary of the views, see `view_records.summarize`.
    plan : mapping
        Return value of `headline`.

    Returns
    -------
    dict
        ``hardest`` and ``all``, each with ``rotation_deg`` and ``translation_mm``: ``count``, ``rms``, ``expected``,
        ``low``, ``high``, ``agrees`` (1 or 0). ``lost``: views without a pose; ``lost_interval`` of their share.
        ``disagreements``: comparisons that failed.
    """
    cells, every = cells_of(poses), np.ones(len(poses), dtype=bool)
    samples = [sample for sample in views["samples"] if np.isfinite(sample["rotation_deg"])]
    hardest = {key: cells[cell["distance"], cell["tilt"]] for key, cell in plan["hardest"].items()}
    compared: dict[str, Any] = {
        name: {
            key: _compared(expected, key, [sample for sample in samples if masks[key][sample["pose"]]], seed)
            for key in _KEYS
        }
        for name, masks in (("hardest", hardest), ("all", dict.fromkeys(_KEYS, every)))
    }
    lost = views["count"] - len(samples)
    interval = share_interval(lost, views["count"])
    failed = sum(comparison["agrees"] == 0 for part in compared.values() for comparison in part.values())
    return {
        **compared,
        "lost": lost,
        "lost_interval": interval,
        "disagreements": failed + int(interval[0] > LOST),
    }


def source_of(print_sigma_mm: float | None, calibrated: bool, measured: bool = False) -> str:
    """Name the sources of the expected errors: image noise, the print, and the calibration if its errors are given."""
    printed = "print errors" if print_sigma_mm is None else f"a print good to {print_sigma_mm:g} mm"
    printed = "a print as it was measured" if measured else printed
    return f"image noise, {printed} and the camera's calibration" if calibrated else f"image noise and {printed}"


def verdict(results: Mapping[str, Any]) -> list[str]:
    """State what to plan with, first, then how it was computed, and what the views of the same run show."""
    return _rig_sentences(results) if "rig" in results else sentences(results["headline"])


def sentences(claim: Mapping[str, Any]) -> list[str]:
    """Sentences about a marker's `headline`, with that of `compare_views` under ``views``."""
    rotated, moved = (claim["hardest"][key] for key in _KEYS)
    over_all, deg, mm = claim["all"], amount(claim["rotation_deg"]), amount(claim["translation_mm"])
    frontal = " Seen frontally, a small tilt hardly changes the image." if middle(rotated["tilt"]) < 10 else ""
    rate = f" ({percent(rotated['flip_rate'])} there)" if rotated["flip_rate"] > LEAST_SAID else ""
    with_flips = f"RMS, including flips{rate}"
    views = claim.get("views") or {}
    # What is claimed is no plan where the views of the same run contradict it.
    begin, end = (
        ("Expect", " The views of this run say otherwise.") if views.get("disagreements") else ("Plan with", "")
    )
    if _place(rotated) == _place(moved):
        plan = f"{begin} {deg} deg and {mm} mm {with_flips}: the hardest case, at {_place(rotated)}.{frontal}{end}"
    else:
        places = f"{deg} deg (at {_place(rotated)}) and {mm} mm (at {_place(moved)})"
        plan = f"{begin} {places} {with_flips}: the hardest cases.{frontal}{end}"
    if rotated["failure_rate"]:
        plan += f" {percent(rotated['failure_rate'])} of the estimates fail there, and are not included."
    sentences = [
        plan,
        f"Over all {over_all['poses']} poses: {amount(over_all['rotation_deg'])} deg and "
        f"{amount(over_all['translation_mm'])} mm ({amount(over_all['translation_pct'])} % of the distance), with "
        f"{claim['source']}.",
    ]
    if over_all["sampled"]:
        says = f" (in the hardest it claims {amount(rotated['first_order_deg'])} deg)" if rotated["sampled"] else ""
        sentences.append(
            f"The first-order covariance does not hold in {over_all['sampled']} of the {over_all['poses']} poses{says}:"
            f" {claim['draws']} estimates were sampled in each, and are what counts here."
        )
    return sentences + (_of_views(claim["views"]) if claim.get("views") else [])


def _rig_sentences(results: Mapping[str, Any]) -> list[str]:
    """State what to plan with of a rig, first, what several plates gain, and what the views found."""
    plan, poses, views = results["headline"], results["poses"], results["views"]
    hardest = max(plan["by_plates"], key=lambda name: plan["by_plates"][name]["rotation_deg"] or np.inf)

    def errors(row: Mapping[str, Any]) -> str:
        return f"{amount(row['rotation_deg'])} deg and {amount(row['translation_mm'])} mm"

    sentences = [
        f"Plan with {errors(plan)} RMS: the hardest case, with {hardest} plate{'s' * (hardest != '1')} in view.",
        f"Over all {plan['all']['poses']} poses: {errors(plan['all'])}, with {plan['source']}; the best plate of each "
        f"alone: {errors(plan['alone'])}.",
    ]
    if results["rig"]["relation_exact"]:
        sentences.append("The relation of the plates is taken as exact: the rig has no relation_covariance.")
    if poses["served"] < poses["count"]:
        missed = poses["count"] - poses["served"]
        sentences.append(f"{missed} of {poses['count']} poses show no plate well enough to find it.")
    if views:
        wrong = f", {views['wrong']} with wrong labels" if views["wrong"] else ", none with a wrong label"
        sentences.append(f"Found in {views['detected']} of {views['count']} views{wrong}.")
        flipped, seen = views["plates"]["flipped"], views["plates"]["found"]
        if flipped:
            sentences.append(f"Of {seen} plates that were found there, {flipped} by themselves have a flipped pose.")
    return sentences


def amount(value: float | None, digits: int = 2) -> str:
    """Format an error with that many significant digits; a missing or infinite one as a word."""
    return "unbounded" if value is None or not np.isfinite(value) else number(float(value), digits)


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
        return {"count": 0, "rms": None, "expected": None, "low": None, "high": None, "agrees": None}
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


def _of_views(views: Mapping[str, Any]) -> list[str]:
    sentences, agreed = [], []
    for name, where in (("hardest", "in the hardest case"), ("all", "over all poses")):
        for key, unit in _UNITS.items():
            comparison = views[name][key]
            if not comparison["count"]:
                continue
            line, between = (
                f"{amount(comparison['rms'])} {unit}",
                f"{amount(comparison['low'])} to {amount(comparison['high'])}",
            )
            if not comparison["agrees"]:
                sentences.append(
                    f"The views of this run gave {line} {where} where {amount(comparison['expected'])} was expected: "
                    f"{_views(comparison['count'])} would give {between}. Rely on the views."
                )
            elif key == "rotation_deg":
                agreed.append(f"{line} {where} in {_views(comparison['count'])}, where {between} was to be expected")
    if agreed and not sentences:
        sentences.append(f"The views of this run agree: {'; '.join(agreed)}.")
    if views["lost"]:
        sentences.append(f"In {_views(views['lost'])} of this run the marker was not found. No error includes that.")
    return sentences


def _views(count: int) -> str:
    return "1 view" if count == 1 else f"{count} views"


def _place(cell: Mapping[str, Any]) -> str:
    return f"{cell['distance'].replace('..', ' to ')} m and {cell['tilt'].replace('..', ' to ')} deg"
