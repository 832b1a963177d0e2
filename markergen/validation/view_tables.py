"""What the synthetic views gave, and the error budget, as rows of text."""

from collections.abc import Mapping
from typing import Any

from markergen.presentation.tables import Table, number, percent
from markergen.validation.tables import STATISTICS, TITLES
from markergen.validation.view_records import DETECTOR

SOURCES = ("image", "print", "camera", "total")

_HEADER = ["", "views", "found", "wrong", "dots px", "bound", "RE deg", "TE %", "H px", "NEES", "in 95 %"]


def budget_table(results: Mapping[str, Any]) -> Table:
    """What of the pose's error comes from where, RMS over the poses."""
    budget = results["budget"]
    rows = [
        [name, *(number(budget[key][source]) for source in SOURCES)]
        for name, key in (("RE, deg", "rotation_deg"), ("TE, %", "translation_pct"))
    ]
    camera = "taken as exact, unless --camera-covariance" if budget["camera_exact"] else "as --camera-covariance"
    caption = (
        f"Dot centers measured to {number(budget['image_px'])} px; dots printed to {budget['print_sigma_mm']:g} mm "
        f"per axis (--print-sigma); the camera {camera} says."
    )
    return Table(
        "Error budget: what limits the pose, rms", ["", "image", "print", "calibration", "total"], rows, caption
    )


def group_table(views: Mapping[str, Any]) -> Table:
    """The views in all, at each polar angle, and at each distance."""
    rows = [_row("all", views)]
    rows += [_row(f"{angle}°", group) for angle, group in views["by_polar_angle"].items()]
    rows += [_row(f"{distance} m", group) for distance, group in views["by_distance"].items()]
    caption = (
        "RMS, of the detection's own pose, by tilt and distance; bound: what the image's noise allows a dot's center."
    )
    return Table(f"Synthetic views{_conditions(views)}", _HEADER, rows, caption)


def estimator_table(views: Mapping[str, Any]) -> Table:
    """Pose errors of each estimator on the dots that were found."""
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
    """The same views under worse conditions."""
    rows = [_row("as above", views), *(_row(name, group) for name, group in views["stress"].items())]
    return Table("The same views under worse conditions", _HEADER, rows, "")


def sentences(results: Mapping[str, Any]) -> list[str]:
    """What the views come to, what failed, and what to improve first."""
    found = []
    views = results["views"]
    if views:
        line = f"Views: {views['detected']} of {views['count']} detected, {views['wrong']} with wrong labels"
        if views["detected"]:
            line += (
                f", dot centers off by {number(views['point_px']['rms'])} px rms "
                f"({number(views['uncorrected_px']['rms'])} px before the correction for perspective)"
            )
        found.append(f"{line}.")
        found += [
            f"  not detected: {view['polar_angle_deg']:g} deg at {view['distance']:.3g} m: {view['reason']}"
            for view in views["failures"][:5]
        ]
    parts = {source: results["budget"]["rotation_deg"][source] or 0.0 for source in SOURCES[:3]}
    most = max(parts, key=lambda source: parts[source])
    total = results["budget"]["rotation_deg"]["total"]
    if total:
        remedy = {
            "image": "larger dots, more light, a sharper lens, or more pixels",
            "print": "a better print, or measured dot centers",
            "camera": "a better calibration of the camera",
        }[most]
        found.append(
            f"The {most} limits the rotation: {percent((parts[most] / total) ** 2)} of its variance; {remedy}."
        )
    return found


def _row(name: str, group: Mapping[str, Any]) -> list[str]:
    own = group["estimators"].get(DETECTOR, {})
    return [
        name,
        str(group["count"]),
        percent(group["rate"]),
        str(group["wrong"]),
        *(number(value, 2) for value in (group["point_px"]["rms"], group["image_bound_px"])),
        *(number(own.get(key, {}).get("rms"), 2) for key in ("rotation_deg", "translation_pct")),
        number(group["homography_px"]["rms"], 2),
        number(group["nees"]["mean"]),
        percent(group["nees"]["coverage"]),
    ]


def _conditions(views: Mapping[str, Any]) -> str:
    optics = views["optics"]
    said = [f"blur {optics['blur_px']:g} px", f"noise {optics['noise_grey']:g} grey levels"]
    if views["background"] != "plain":
        said.append(f"{views['background']} behind")
    if views["hidden"]:
        said.append(f"{views['hidden']} of the dots hidden")
    if views["refine"] != "none":
        said.append(f"{views['refine']} refinement")
    said.append(f"dots misprinted by {views['print_sigma_mm']:g} mm" if views["print_sigma_mm"] else "printed exactly")
    return ": " + ", ".join(said)
