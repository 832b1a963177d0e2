"""What the results of a validation say, in sentences, for terminal and report alike."""
# tests: tests/validation/test_sentences.py tests/validation/test_error_to_plan_with.py

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.errors import enumerated
from markergen.model.planned_error import PlannedError, amount
from markergen.model.poses import left_out
from markergen.optimize.dot_size import CLEARANCE, PERCENTILE, PIXELS
from markergen.presentation.tables import number, percent
from markergen.units import format_length
from markergen.validation.error_to_plan_with import middle
from markergen.validation.metrics import mean_nees_interval

if TYPE_CHECKING:
    from markergen.model.marker import Marker
    from markergen.model.poses import PoseDistribution
    from markergen.validation.report.subject import Advice

_POSE_UNITS = {"rotation_deg": "deg", "translation_mm": "mm"}
LEAST_SAID = 1e-3
"""Share of flips from which it is stated."""
SOURCES = ("image", "print", "camera", "total")
"""Sources of an error budget, and their total."""
NAMES = {"image": "image noise", "print": "the print", "camera": "the calibration"}
"""Sources of an error budget, in sentences."""
REMEDIES = {
    "image": (
        "let the dots cover more pixels (a larger marker, a shorter distance, a longer focal length, more pixels), or "
        "get more light and a sharper focus"
    ),
    "print": (
        "make the marker on a better printer or machine, of a stiffer, flatter material, make it larger, or measure "
        "where the dots really are"
    ),
    "camera": (
        "calibrate with images that fill the corners, at the focus that you work with, as long as markergen calibrate "
        "asks for more"
    ),
}
"""How to reduce the error of each source."""
REMEDIES_OF_MEASURED = {
    "rotation": "take photographs as long as markergen calibrate asks for more, then make the marker larger",
    "translation": "measure lengths on it (markergen calibrate --measured), since photographs do not tell its scale",
}
"""How to reduce that of a print that was measured. Whether more photographs help, the calibration says."""
DOMINANT = 0.9
"""Share of the variance above which improving any other source gains less than 5 % of the error."""
ENOUGH = 20
"""Number of views whose RMS is a measurement, good to a tenth or so; that of three may be off by a quarter."""
_UNITS = ("px", "grey", "deg", "mm", "nm")


def plan_sentences(results: Mapping[str, Any]) -> list[str]:
    """State what to plan with, first, then how it was computed, and what the views of the same run show."""
    if "rig" in results:
        return _rig_plan(results)
    missed = left_out(results["poses"]["count"], results["poses"]["dropped"])
    verdict, *more = marker_plan(results["headline"])
    return [f"{verdict} {missed}." if missed else verdict, *more]


def detail_sentences(results: Mapping[str, Any]) -> list[str]:
    """Return what the command prints between the tables and `plan_sentences`."""
    if "rig" in results:
        return limit_sentences(results)
    return [*trial_sentences(results), *view_sentences(results)]


def marker_plan(claim: Mapping[str, Any]) -> list[str]:
    """Sentences about a marker's `headline`, with that of `compare_views` under ``views``."""
    rotated, moved = (claim["hardest"][key] for key in _POSE_UNITS)
    over_all, views = claim["all"], claim.get("views") or {}
    # What is claimed is no plan where the views of the same run contradict it, or do not find the marker.
    begin, end = "Expect" if views.get("disagreements") else "Plan with", ""
    if views.get("disagreements"):
        contradicted = any(error["agrees"] == 0 for key in ("hardest", "all") for error in views[key].values())
        end = " The views of this run say otherwise." if contradicted else f" {_lost(views)}"
    sentences = [
        f"{begin} {_planned(claim).amounts} {_planned(claim).conditions}: RMS over {over_all['poses']} poses, with "
        f"{claim['source']}.{end}"
    ]
    frontal = " Seen frontally, a small tilt hardly changes the image." if middle(rotated["tilt"]) < 10 else ""
    rate = f", including flips ({percent(rotated['flip_rate'])})" if rotated["flip_rate"] > LEAST_SAID else ""
    deg, mm = f"{amount(rotated['rotation_deg'])} deg", f"{amount(moved['translation_mm'])} mm"
    if _place(rotated) == _place(moved):
        hardest = f"{deg} and {mm} at {_place(rotated)}"
    else:
        hardest = f"{deg} at {_place(rotated)}; {mm} at {_place(moved)}"
    failed = f" {percent(rotated['failure_rate'])} of the estimates fail there, and are not included."
    sentences.append(f"The hardest: {hardest}{rate}.{frontal}{failed if rotated['failure_rate'] else ''}")
    if over_all["sampled"]:
        says = f" (in the hardest it claims {amount(rotated['first_order_deg'])} deg)" if rotated["sampled"] else ""
        really = f"{amount(over_all['rotation_deg'])} deg and {amount(over_all['translation_mm'])} mm over all poses"
        sentences.append(
            f"The first-order covariance does not hold in {over_all['sampled']} of the {over_all['poses']} poses{says}:"
            f" {claim['draws']} estimates sampled in each make it {really}."
        )
    return sentences + (agreement(claim["views"]) if claim.get("views") else [])


def _rig_plan(results: Mapping[str, Any]) -> list[str]:
    """State what to plan with of a rig, first, what several plates gain, and what the views found."""
    plan, poses, views = results["headline"], results["poses"], results["views"]
    planned = _planned(plan)
    hardest = max(plan["by_plates"], key=lambda name: plan["by_plates"][name]["rotation_deg"] or np.inf)

    def errors(row: Mapping[str, Any]) -> str:
        return f"{amount(row['rotation_deg'])} deg and {amount(row['translation_mm'])} mm"

    sentences = [
        f"Plan with {planned.amounts} {planned.conditions}: RMS over {plan['all']['poses']} poses, with "
        f"{plan['source']}.",
        f"The hardest: {errors(plan['by_plates'][hardest])} with {hardest} plate{'s' * (hardest != '1')} in view; over "
        f"all poses the best plate of each alone gives {errors(plan['alone'])}.",
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


def agreement(views: Mapping[str, Any]) -> list[str]:
    """Say whether rendered views, compared by `compare_views`, agree with the errors expected of them."""
    sentences, agreed = [], []
    for name, where in (("hardest", "in the hardest case"), ("all", "over all poses")):
        for key, unit in _POSE_UNITS.items():
            comparison = views[name][key]
            if not comparison["count"]:
                continue
            line, between = (
                f"{amount(comparison['rms'])} {unit}",
                f"{amount(comparison['low'])} to {amount(comparison['high'])}",
            )
            if not comparison["agrees"]:
                advice = "Rely on the views" if comparison["count"] >= ENOUGH else "Check with more views: --views 100"
                sentences.append(
                    f"The views of this run gave {line} {where} where {amount(comparison['expected'])} was expected: "
                    f"{_views(comparison['count'])} would give {between}. {advice}."
                )
            elif key == "rotation_deg":
                agreed.append(f"{line} {where} in {_views(comparison['count'])}, where {between} was to be expected")
    if agreed and not sentences:
        sentences.append(f"The views of this run agree: {'; '.join(agreed)}.")
    if views["lost"]:
        sentences.append(f"{_lost(views)} No error includes that.")
    return sentences


def _lost(views: Mapping[str, Any]) -> str:
    return f"In {_views(views['lost'])} of this run the marker was not found."


def trial_sentences(results: Mapping[str, Any]) -> list[str]:
    """Comment on skipped estimators, label margins, and the calibration of the covariance."""
    sentences = []
    if "condition" not in results["criteria"] and "coverage" not in results:
        measured = results["budget"]["print_measured"]
        why = "the heights of the dots were measured" if measured else "the dots are not in one"
        sentences.append(f"DLT and IPPE assume a plane and step aside, for {why}; LM begins from SQPnP.")
    sentences += label_sentences(results["labels"]) if results["labels"] else []
    tilted = {
        angle: row
        for angle, row in (results["nees"] or {"by_polar_angle": {}})["by_polar_angle"].items()
        if row["mean"] is not None and float(angle.split("..")[0]) >= 17.5
    }
    if tilted:
        count = sum(row["count"] for row in tilted.values())
        mean = sum(row["mean"] * row["count"] for row in tilted.values()) / count
        low, high = mean_nees_interval(count)
        sentences.append(
            f"Covariance of LM: mean NEES {mean:.3f} over {count} trials tilted by 17.5 deg and more; "
            f"{low:.3f} to {high:.3f} is what 99 % of such runs give if the bound's covariance is right."
        )
    return sentences


def label_sentences(labels: Mapping[str, Any]) -> list[str]:
    """Say which dots could be taken for others."""
    return [f"{line[0].upper()}{line[1:]}." for line in labels["sentences"]]


def view_sentences(results: Mapping[str, Any]) -> list[str]:
    """Name dots that are too small, summarize the views, the failures, and what to improve first."""
    sentences = []
    views, dots = results["views"], results.get("dots")
    if dots and dots["too_small"]:
        sentences.append(
            f"In {percent(dots['too_small'])} of the poses dots are hardly found: one is {number(dots['least_px'], 2)} "
            f"px across, of {dots['needed_px']:g} px that it takes; use larger dots, a longer lens, or nearer poses."
        )
    if views:
        sentences.append(detection_sentence(views))
        sentences += [
            f"  not detected: tilted by {view['polar_angle_deg']:.3g} deg at {view['distance']:.3g} m: {view['reason']}"
            for view in views["failures"][:5]
        ]
    sentences += limit_sentences(results)
    return sentences


def detection_sentence(views: Mapping[str, Any]) -> str:
    """State how many views were detected, and how far off the dots' centers are."""
    count, detected, wrong = (views.get(key) or 0 for key in ("count", "detected", "wrong"))
    line = f"{detected} of {count} rendered views detected, {wrong or 'none'} with wrong labels"
    centers, uncorrected = ((views.get(key) or {}).get("rms") for key in ("point_px", "uncorrected_px"))
    if centers is not None:
        line += f"; the dots' centers are off by {number(centers)} px RMS"
    if uncorrected is not None:
        line += f" ({number(uncorrected)} px without the correction for perspective)"
    return f"{line}."


def image_sentences(views: Mapping[str, Any]) -> list[str]:
    """Compare what was measured in the views' images with what their noise allows; state their optics."""
    sentences = [detection_sentence(views)]
    centers, least = (views.get("point_px") or {}).get("rms"), views.get("image_bound_px")
    if centers is not None and least:
        sentences.append(f"That is {number(centers / least)} times the least that the noise of the image allows.")
    nees = views.get("nees") or {}
    if nees.get("coverage") is not None and nees.get("coverage_interval"):
        low, high = (100 * end for end in nees["coverage_interval"])
        sentences.append(
            f"The truth lies inside the detector's own 95 % region in {100 * nees['coverage']:.3g} % of "
            f"{nees['count']} views; the 99 % interval of that share is {low:.3g} to {high:.3g} %."
        )
    used = dict(views.get("optics") or {})
    if not used.get("aperture_mm"):
        # A pinhole has neither.
        used = {key: value for key, value in used.items() if key not in ("focus", "wavelength_nm")}
    optics = [_with_unit(key, value) for key, value in used.items() if value]
    if optics:
        sentences.append(f"Optics: {', '.join(optics)}.")
    return sentences


def limit_sentences(results: Mapping[str, Any]) -> list[str]:
    """Say what limits the pose of all that was counted, what was not counted, and what that would cost."""
    budget = results["budget"]
    shares_of = {
        what: shares(budget, key) for what, key in (("rotation", "rotation_deg"), ("translation", "translation_pct"))
    }
    first = {what: max(parts, key=lambda name: parts[name]) for what, parts in shares_of.items() if parts}
    exact = budget.get("camera_exact", not any(parts.get("camera") for parts in shares_of.values()))
    counted = [NAMES[name] for name in SOURCES[:3] if not (exact and name == "camera")]
    sentences = []
    for name in dict.fromkeys(first.values()):
        limited = [what for what, largest in first.items() if largest == name]
        is_measured = name == "print" and budget.get("print_measured")
        remedy = "; ".join(REMEDIES_OF_MEASURED[what] for what in limited) if is_measured else REMEDIES[name]
        line = f"Of {enumerated(counted, 'and')}, {NAMES[name]} limits the {' and the '.join(limited)}: {remedy}."
        if all(shares_of[what][name] > DOMINANT for what in limited):
            line += " Improving the rest would gain next to nothing."
        sentences.append(line)
    if first and exact:
        sentences.append(f"The camera's calibration is taken as exact{_cost(results)}; --camera-covariance counts it.")
    if more := budget.get("outlook"):
        sentences.append(f"{more[0].upper()}{more[1:]}.")
    return sentences


def shares(budget: Mapping[str, Any], key: str) -> dict[str, float]:
    """Return each source's share of the variance of ``rotation_deg`` or ``translation_pct``; empty if all are 0."""
    parts = budget.get(key) or {}
    squares = {name: (parts.get(name) or 0.0) ** 2 for name in SOURCES if name != "total"}
    total = sum(squares.values())
    return {name: part / total for name, part in squares.items()} if total else {}


def advice_sentences(advice: "Advice", marker: "Marker", poses: "PoseDistribution") -> list[str]:
    """Advice as sentences."""
    least = max(point.feature.least_pixels for point in marker.control_points)
    now, worst, most = format_length(marker.dot_diameter), advice.worst, advice.most
    where = at(poses.distance[worst.pose], poses.polar_angle_deg[worst.pose])
    sentence = (
        f"{where} the dot that looks smallest, of {now}, is {number(worst.thinnest_px, 2)} px across its short axis "
        f"({number(worst.center_px, 2)} px at the marker's center)"
    )
    if worst.thinnest_px >= PIXELS:
        enough = f"{format_length(worst.diameter)} would do for the {PIXELS:g} px that detection wants"
        return [f"{sentence}, the least of all poses: large enough, {enough}."]
    if not np.isfinite(worst.diameter):
        return [f"{where} the image of a dot is no ellipse: no size helps, leave such poses out."]
    sentences = [f"{sentence}: use {format_length(worst.diameter)} for the {PIXELS:g} px that detection wants."]
    share = f"{PERCENTILE:g} % of the poses"
    if most.thinnest_px >= PIXELS:
        sentences.append(f"For {share} {now} is enough: {number(most.thinnest_px, 3)} px or more.")
    else:
        sentences.append(
            f"For {share} {format_length(most.diameter)} would do; now it is {number(most.thinnest_px, 2)} px there. "
            f"Smaller dots are found as well, down to {least:g} px, but with less margin."
        )
    room = format_length(np.floor(advice.largest * 1e4) / 1e4)
    if worst.diameter > advice.largest:
        factor = worst.diameter / marker.dot_diameter
        sentences.append(
            f"With a clearance of {100 * CLEARANCE:g} % of their diameter, {len(marker)} dots of up to {room} fit in "
            f"this boundary. For larger ones scale the whole marker to {100 * factor:.0f} %, come nearer, or use a "
            "longer focal length."
        )
    else:
        sentences.append(
            f"Up to {room} there is room for {len(marker)} dots in this boundary: design it again with "
            f"--dot {worst.diameter * 1e3:.6g}mm. Larger dots are measured better, but sit closer together."
        )
    return sentences


def at(distance: float, tilt_deg: float) -> str:
    """Describe a viewpoint: ``At 1.5 m and 70 deg``."""
    return f"At {distance:.3g} m and {tilt_deg:.3g} deg"


def _planned(claim: Mapping[str, Any]) -> PlannedError:
    unbounded = {key: np.inf if claim[key] is None else claim[key] for key in _POSE_UNITS}
    return PlannedError(**unbounded, distance=claim["distance"], exact=claim["exact"])


def _views(count: int) -> str:
    return "1 view" if count == 1 else f"{count} views"


def _place(cell: Mapping[str, Any]) -> str:
    return f"{cell['distance']} m, tilted by {cell['tilt']} deg".replace("..", " to ")


def _cost(results: Mapping[str, Any]) -> str:
    """What an inexact calibration would cost, where the results say it."""
    headline: Mapping[str, Any] = results.get("headline") or {}
    off = headline.get("calibration") or {}
    if off.get("rotation_deg") is None:
        return ""
    rotation, translation = (number(off[key] / headline["all"][key], 2) for key in ("rotation_deg", "translation_pct"))
    return (
        f". If fx and fy were off by {off['focal_px']:g} px and the principal point by {off['center_px']:g} px, "
        f"rotation and translation would err {rotation} and {translation} times as much"
    )


def _with_unit(key: str, value: Any) -> str:
    """Format blur_px = 0.7 as ``blur 0.7 px``."""
    *parts, last = key.split("_")
    unit = f" {last}" if parts and last in _UNITS else ""
    name = " ".join(parts if unit else [*parts, last])
    return f"{name} {value:g}{unit}" if isinstance(value, int | float) else f"{name} {value}{unit}"
