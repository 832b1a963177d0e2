"""Results of a validation as tables: trials, other layouts, labels, budget, views."""
# tests: tests/validation/test_validation.py tests/validation/test_pads.py tests/validation/test_rig_validation.py

from collections.abc import Mapping
from typing import Any

import numpy as np

from markergen.bounds.confusion.evidence import DECIDED, LARGE
from markergen.model.sight import distance_table
from markergen.optimize.comparisons import LAYOUTS
from markergen.presentation.tables import Table, number, percent
from markergen.validation.metrics import STATISTICS
from markergen.validation.relative_error import relative_error_sentence
from markergen.validation.sentences import SOURCES
from markergen.validation.view_records import DETECTOR

TITLES = {
    "detect": "detection's own",
    "epnp": "EPnP",
    "ippe": "IPPE",
    "lm": "LM",
    "sqpnp": "SQPnP",
    "dlt": "DLT",
}
RIG_TITLES = {"lm": "all plates in view", "lm_alone": "the best plate alone"}
EPNP = (
    "EPnP: the better of two calls to OpenCV's, on the image upright and turned, with a new translation; a single call "
    "mirrors the pose in two of five views of a flat marker, which makes it wrong by about 80 deg RMS."
)
MOST_DOTS = 40
"""Maximum number of dots in a table of labels, which then shows the least safe ones."""
BOUND = "bound (CRLB)"


_VIEW_HEADER = ["", "views", "found", "wrong", "dots px", "bound", "RE deg", "TE %", "H px", "NEES", "in 95 %"]


def result_tables(results: Mapping[str, Any]) -> list[Table]:
    """Return the tables of the results in the order in which the command prints them."""
    views = results["views"]
    if "rig" in results:
        return [
            rig_table(results),
            *([rig_trial_table(results)] if results["estimators"] else []),
            budget_table(results),
            *([rig_view_table(views)] if views else []),
            *([rig_stress_table(views)] if views and "stress" in views else []),
        ]
    tables = trial_tables(results) if results["estimators"] else []
    if "coverage" in results:
        tables.append(dots_in_view_table(results))
    if results["comparisons"] or "coverage" not in results:
        tables.append(comparison_table(results))
    tables.append(budget_table(results))
    return tables + (view_tables(views) if views else [])


def trial_tables(results: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a marker's trials."""
    tables = [rotation_table(results), translation_table(results)]
    tables += [polar_angle_table(results, key) for key in ("rotation_deg", "translation_pct")]
    return [*tables, homography_table(results)] if results["homography"] else tables


def view_tables(views: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a marker's views."""
    tables = [group_table(views)]
    if views["detected"]:
        tables.append(estimator_table(views))
    if views.get("stress"):
        tables.append(stress_table(views))
    return tables


def rotation_table(results: Mapping[str, Any]) -> Table:
    """Rotation errors of each estimator over all poses with its efficiency, and the bound below."""
    rows = []
    for name, row in results["estimators"].items():
        numbers = [number(row["rotation_deg"][key]) for key in STATISTICS]
        rows.append([TITLES.get(name, name), *numbers, number(row["efficiency"])])
        if name == "ippe":
            rows.append(["  nearer of both", *(number(row["nearest_rotation_deg"][key]) for key in STATISTICS), ""])
    rows.append([BOUND, "", "", number(results["bound"]["rotation_deg"]), "", "", "", ""])
    caption = "Without failures, with flips."
    if "ippe" in results["estimators"]:
        caption += " IPPE: the solution that fits better, and the truer one."
    if "epnp" in results["estimators"]:
        caption += f" {EPNP}"
    return Table("Rotation error RE, deg", ["", *STATISTICS, "effic."], rows, caption)


def translation_table(results: Mapping[str, Any]) -> Table:
    """Translation errors of each estimator over all poses, with flips and failures, and the bound below."""
    rows = [
        [
            TITLES.get(name, name),
            *(number(row["translation_pct"][key]) for key in STATISTICS),
            *(percent(row[key]) for key in ("flip_rate", "failure_rate")),
        ]
        for name, row in results["estimators"].items()
    ]
    rows.append([BOUND, "", "", number(results["bound"]["translation_pct"]), "", "", "", "", ""])
    return Table("Translation error TE, %", ["", *STATISTICS, "flips", "failed"], rows, "")


def polar_angle_table(results: Mapping[str, Any], key: str) -> Table:
    """RMS of ``rotation_deg`` or ``translation_pct`` of each estimator at each polar angle, with the bound below."""
    angles = list(results["bound"]["by_polar_angle"])
    rows = [
        [TITLES.get(name, name), *(number(row["by_polar_angle"][angle][key]["rms"]) for angle in angles)]
        for name, row in results["estimators"].items()
    ]
    bounds = results["bound"]["by_polar_angle"]
    rows.append([BOUND, *(number(bounds[angle][key]) for angle in angles)])
    title = {"rotation_deg": "RE, deg", "translation_pct": "TE, %"}[key]
    return Table(f"{title}: rms by tilt", ["", *(f"{angle} deg" for angle in angles)], rows, "")


def homography_table(results: Mapping[str, Any]) -> Table:
    """Errors of each homography estimator over the validation grid."""
    header = ["", "mean px^2", "median", "p95", "mean px", "median", "p95"]
    rows = [
        [
            TITLES.get(name, name),
            *(number(row["he_px2"][key]) for key in ("mean", "median", "p95")),
            *(number(row["rms_px"][key]) for key in ("mean", "median", "p95")),
        ]
        for name, row in results["homography"].items()
    ]
    caption = "HE is over a grid half as wide again as the marker; its root in px beside it."
    if results["relative_error"]:
        caption += f" {relative_error_sentence(results['relative_error'])}"
    return Table("Homography error HE, px^2, and its root, px", header, rows, caption)


def comparison_table(results: Mapping[str, Any]) -> Table:
    """Bounds and criteria of the marker and of other layouts for the same region, and LM's errors where available."""
    header = ["", "RE bound", "TE bound", "LM: RE", "LM: TE", "c(A)"]
    layouts = {
        "this marker": {key: results[key] for key in ("criteria", "bound", "estimators")},
        **{LAYOUTS.get(name, name): row for name, row in results["comparisons"].items()},
    }
    rows = []
    for name, row in layouts.items():
        measured = row.get("estimators", {}).get("lm", {})
        rows.append(
            [
                name,
                *(number(row["bound"][key]) for key in ("rotation_deg", "translation_pct")),
                *(number(measured.get(key, {}).get("rms")) for key in ("rotation_deg", "translation_pct")),
                number(row["criteria"].get("condition")),
            ]
        )
    title = "Beside other layouts of the same room: deg and %, rms"
    caption = "--trials-for-all measures them all." if results["runs"] else ""
    return Table(title, header, rows, caption)


def labels_table(labels: Mapping[str, Any]) -> Table:
    """Label safety of each dot, or of the least safe: its worst pose, and the dots that it is confused with."""
    dots = labels["dots"]
    title = "How safely each dot is distinguished"
    if len(dots) > MOST_DOTS:
        dots = sorted(dots, key=lambda dot: np.inf if dot["px"] is None else dot["px"])[:MOST_DOTS]
        title += f": the {MOST_DOTS} least safe of {len(labels['dots'])}"
    rows = [
        [str(dot["id"]), "-", "-", "-", "-", "-", "never: no other dot is like it"]
        if dot["px"] is None
        else [
            str(dot["id"]),
            number(dot["px"]),
            number(dot["margin"]) if dot["margin"] < LARGE else f"over {LARGE:g}",
            "<1e-6" if dot["undecided"] < 1e-6 else f"{dot['undecided']:.2g}",
            f"{dot['tilt_deg']:.3g}",
            f"{dot['distance_m']:.3g}",
            dot["in_words"],
        ]
        for dot in dots
    ]
    header = [
        "dot",
        "safe to, px",
        "margin",
        "undecided",
        "tilt, deg",
        "distance, m",
        "then fits as well",
    ]
    caption = (
        "Safe to: RMS displacement of all dots in the image up to which the true labels fit best, from every pose; "
        f"tilt and distance of the worst one. Margin: expected logarithm of how many times as likely they are, with "
        f"errors of {labels['noise_px']:g} px in every coordinate; the detector asks for {DECIDED:g}. Undecided: "
        "probability that it is less."
    )
    return Table(title, header, rows, caption)


def budget_table(results: Mapping[str, Any]) -> Table:
    """Pose errors by source, RMS over the poses."""
    budget = results["budget"]
    rows = [
        [name, *(number(budget[key][source]) for source in SOURCES)]
        for name, key in (("rotation, deg", "rotation_deg"), ("translation, %", "translation_pct"))
    ]
    camera = (
        "taken as exact, unless --camera-covariance"
        if budget["camera_exact"]
        else "as --camera-covariance, or the camera's file,"
    )
    printed = f"dots printed to {budget['print_sigma_mm']:g} mm per axis (--print-sigma)"
    if budget.get("print_measured"):
        printed = "dots placed as they were measured on the print, with that covariance"
    caption = f"Dot centers measured to {number(budget['image_px'])} px; {printed}; the camera {camera} says."
    return Table(
        "Error budget: what limits the pose, rms", ["", "image", "print", "calibration", "total"], rows, caption
    )


def group_table(views: Mapping[str, Any]) -> Table:
    """Results of all views, and by polar angle and distance."""
    rows = [_view_row("all", views)]
    rows += [_view_row(f"{angle}°", group) for angle, group in views["by_polar_angle"].items()]
    rows += [_view_row(f"{distance} m", group) for distance, group in views["by_distance"].items()]
    caption = (
        "RMS, of the detection's own pose, by tilt and distance; bound: what the image's noise allows a dot's center."
    )
    return Table(f"Synthetic views{_conditions(views)}", _VIEW_HEADER, rows, caption)


def estimator_table(views: Mapping[str, Any]) -> Table:
    """Pose errors of each estimator for the detected dots."""
    rows = [
        [
            TITLES.get(name, name),
            *(number(row["rotation_deg"][key]) for key in STATISTICS),
            *(number(row["translation_pct"][key]) for key in ("rms", "p95")),
        ]
        for name, row in views["estimators"].items()
    ]
    header = ["", *(f"RE {key}" for key in STATISTICS), "TE rms", "TE p95"]
    return Table("Pose from the views: RE in deg, TE in %", header, rows, "")


def stress_table(views: Mapping[str, Any]) -> Table:
    """Results of the same views under worse conditions."""
    rows = [_view_row("as above", views), *(_view_row(name, group) for name, group in views["stress"].items())]
    return Table("The same views under worse conditions", _VIEW_HEADER, rows, "")


def conditions(results: Mapping[str, Any]) -> str:
    """Describe the poses, trials, noise and camera."""
    camera, poses = results["camera"], results["poses"]
    dropped = f", {poses['dropped']} more do not see the whole marker" if poses["dropped"] else ""
    lens = f", {camera['distortion']['model']} lens" if "distortion" in camera else ""
    return (
        f"{poses['count']} poses ({poses['name']}{dropped}) x {results['runs']} runs, "
        f"noise {results['noise_px']:g} px\n"
        f"camera {camera['width']}x{camera['height']}, focal lengths {camera['fx']:g} and {camera['fy']:g} px, "
        f"principal point ({camera['cx']:g}, {camera['cy']:g}){lens}"
    )


def rig_table(results: Mapping[str, Any]) -> Table:
    """Errors to expect by the number of plates in view, of all together and of the best alone."""
    rows = [
        [
            name,
            str(row["poses"]),
            *(number(row[key]) for key in ("rotation_deg", "translation_mm")),
            *(number(row["alone"][key]) for key in ("rotation_deg", "translation_mm")),
        ]
        for name, row in results["headline"]["by_plates"].items()
    ]
    header = ["plates in view", "poses", "RE deg", "mm", "best alone RE deg", "mm"]
    return Table("Errors to expect, rms to first order", header, rows, "Without flips of plates alone.")


def rig_trial_table(results: Mapping[str, Any]) -> Table:
    """Errors in the trials by the number of plates in view."""
    rows = []
    for name, estimator in results["estimators"].items():
        for plates, row in estimator["by_plates"].items():
            errors = [number(row["rotation_deg"]["rms"]), number(row["bound"]["rotation_deg"])]
            errors += [number(row["translation_pct"]["rms"]), number(row["bound"]["translation_pct"])]
            shares = [number(row["efficiency"]), percent(row["flip_rate"]), percent(row["failure_rate"])]
            rows.append([f"{RIG_TITLES[name]}: {plates}", *errors, *shares])
    header = ["", "RE deg", "bound", "TE %", "bound", "effic.", "flips", "failed"]
    return Table("Trials by the number of plates in view, rms", header, rows, "LM from noisy image points, with flips.")


def rig_view_table(views: Mapping[str, Any]) -> Table:
    """Results of the synthetic views, by the number of plates in view."""
    rows = [
        [
            *_rig_view_row(name, row)[:7],
            number(row["both"]["alone_deg"]["rms"]),
            *_rig_view_row(name, row)[7:],
            f"{row['plates']['flipped']}/{row['plates']['found']}",
        ]
        for name, row in {"all": views, **views["by_plates"]}.items()
    ]
    header = ["plates", "views", "found", "wrong", "dots px", "RE deg", "expected", "alone", "mm", "NEES", "flips"]
    caption = (
        "RMS. Expected: to first order. Alone: the plate's own pose that claims the least error. "
        "Flips: of the own poses of all plates."
    )
    hidden = f", {views['hidden']} of the dots in view hidden" if views["hidden"] else ""
    return Table(f"Synthetic views ({views['background']} background{hidden})", header, rows, caption)


def rig_stress_table(views: Mapping[str, Any]) -> Table:
    """Results of the same views of a rig under worse conditions."""
    rows = [_rig_view_row(name, row) for name, row in {"as above": views, **views["stress"]}.items()]
    header = ["", "views", "found", "wrong", "dots px", "RE deg", "expected", "mm", "NEES"]
    return Table("The same views under worse conditions", header, rows, "")


def _rig_view_row(name: str, views: Mapping[str, Any]) -> list[str]:
    return [
        name,
        *(str(views[key]) for key in ("count", "detected", "wrong")),
        number(views["point_px"]["rms"]),
        number(views["rotation_deg"]["rms"]),
        number(views["expected_deg"]),
        number(views["translation_mm"]["rms"]),
        number(views["nees"]),
    ]


def dots_in_view_table(results: Mapping[str, Any]) -> Table:
    """Dots in view by distance, with the rotation errors to expect and those of the views."""
    rows, keys = results["coverage"]["by_distance"], ("expected_deg", "views_deg")
    cells = [[number(row[key], 3) for key in keys] for row in rows]
    return distance_table(rows, results["coverage"]["diameters"], ("expected deg", "views deg"), cells)


def _view_row(name: str, group: Mapping[str, Any]) -> list[str]:
    errors = group["estimators"].get(DETECTOR, {})
    return [
        name,
        str(group["count"]),
        percent(group["rate"]),
        str(group["wrong"]),
        *(number(value, 2) for value in (group["point_px"]["rms"], group["image_bound_px"])),
        *(number(errors.get(key, {}).get("rms"), 2) for key in ("rotation_deg", "translation_pct")),
        number(group["homography_px"]["rms"], 2),
        number(group["nees"]["mean"]),
        percent(group["nees"]["coverage"]),
    ]


def _conditions(views: Mapping[str, Any]) -> str:
    optics = views["optics"]
    conditions = [f"blur {optics['blur_px']:g} px", f"noise {optics['noise_grey']:g} grey levels"]
    if views["background"] != "plain":
        conditions.append(f"{views['background']} behind")
    if views["hidden"]:
        conditions.append(f"{views['hidden']} of the dots hidden")
    misprint = f"dots misprinted by {views['print_sigma_mm']:g} mm" if views["print_sigma_mm"] else "printed exactly"
    conditions.append("misprinted as the measurement allows" if views.get("print_measured") else misprint)
    return ": " + ", ".join(conditions)
