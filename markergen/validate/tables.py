"""Results as rows of text, for the terminal and any other page."""

from collections.abc import Mapping, Sequence
from typing import Any

from markergen.validate.metrics import mean_nees_interval

Table = tuple[str, list[str], list[list[str]], str]
"""Title, header, rows, and a caption."""

TITLES = {
    "epnp": "EPnP (better of 2)",
    "ippe": "IPPE (better of 2)",
    "lm": "LM from IPPE",
    "sqpnp": "SQPnP",
    "dlt": "DLT",
}
LAYOUTS = {"ngon": "regular n-gon", "square": "square, 4 dots", "random": "random, median"}


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with that many significant digits; a dash where there is none."""
    return "-" if value is None else f"{value:#.{digits}g}".rstrip(".")


def estimator_table(results: Mapping[str, Any]) -> Table:
    """Rotation and translation errors of each estimator, overall, with the bound below."""
    header = [
        "pose",
        "RE deg: mean",
        "rms",
        "median",
        "p95",
        "max",
        "TE %: mean",
        "rms",
        "flips",
        "failures",
        "efficiency",
    ]
    rows = [
        [
            TITLES.get(name, name),
            *(number(row["rotation_deg"][key]) for key in ("mean", "rms", "median", "p95", "max")),
            *(number(row["translation_pct"][key]) for key in ("mean", "rms")),
            *(f"{100 * row[key]:.2g} %" for key in ("flip_rate", "failure_rate")),
            number(row["efficiency"], 3),
        ]
        for name, row in results["estimators"].items()
    ]
    bound = results["bound"]
    rows.append(["bound (CRLB)", "", number(bound["rotation_deg"]), "", "", "", "", number(bound["translation_pct"])])
    poses, runs = results["poses"]["count"], results["runs"]
    caption = "Errors exclude failures and include flips; efficiency is the bound's mean square over the measured one."
    return f"{poses} poses x {runs} runs, noise {results['noise_px']:g} px", header, _even(rows, len(header)), caption


def polar_angle_table(results: Mapping[str, Any]) -> Table:
    """RMS rotation error of each estimator at each polar angle, with the bound below."""
    angles = list(results["bound"]["by_polar_angle"])
    rows = [
        [TITLES.get(name, name), *(number(row["by_polar_angle"][angle]["rotation_deg"]["rms"]) for angle in angles)]
        for name, row in results["estimators"].items()
    ]
    bounds = results["bound"]["by_polar_angle"]
    rows.append(["bound (CRLB)", *(number(bounds[angle]["rotation_deg"]) for angle in angles)])
    caption = "Frontal views bound the rotation least: always look at them apart."
    return "RE deg, rms, by polar angle", ["", *(f"{angle} deg" for angle in angles)], rows, caption


def homography_table(results: Mapping[str, Any]) -> Table:
    """Errors of each homography estimator over the validation grid."""
    header = ["homography", "HE px^2: mean", "median", "p95", "sqrt(HE) px: mean", "median", "p95"]
    rows = [
        [
            TITLES.get(name, name),
            *(number(row["he_px2"][key]) for key in ("mean", "median", "p95")),
            *(number(row["rms_px"][key]) for key in ("mean", "median", "p95")),
        ]
        for name, row in results["homography"].items()
    ]
    caption = "HE is the mean squared distance over a 7 x 7 grid, half as wide again as the marker."
    return "Homography", header, rows, caption


def comparison_table(results: Mapping[str, Any]) -> Table:
    """The marker's bounds and criteria beside those of the layouts of the same region, and LM's errors where run."""
    header = ["layout", "bound: RE deg", "TE %", "pose mm at 1 px", "c(A)", "LM: RE deg, rms", "TE %, rms"]
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
                number(row["bound"]["rotation_deg"]),
                number(row["bound"]["translation_pct"]),
                number(1e3 * row["criteria"]["pose_m"]),
                number(row["criteria"]["condition"]),
                *(number(measured.get(key, {}).get("rms")) for key in ("rotation_deg", "translation_pct")),
            ]
        )
    return "Beside other layouts of the same room", header, rows, "--trials-for-all measures the others too."


def sentences(results: Mapping[str, Any]) -> list[str]:
    """What needs no table: calibration of the covariance, and the views."""
    found = []
    tilted = {
        angle: row
        for angle, row in ((results["nees"] or {}).get("by_polar_angle") or {}).items()
        if row["mean"] is not None and float(angle.split("..")[0]) >= 17.5
    }
    if tilted:
        count = sum(row["count"] for row in tilted.values())
        mean = sum(row["mean"] * row["count"] for row in tilted.values()) / count
        low, high = mean_nees_interval(count)
        found.append(
            f"Covariance of LM: mean NEES {mean:.3f} over {count} trials tilted by 17.5 deg and more; "
            f"{low:.3f} to {high:.3f} is what 99 % of such runs give if the bound's covariance is right."
        )
    views = results["views"]
    if views:
        found.append(
            f"Views: {views['detected']} of {views['count']} detected, {views['wrong']} with wrong labels, "
            f"dot centers off by {number(views['point_px']['rms'])} px rms "
            f"({number(views['uncorrected_px']['rms'])} px before the correction for perspective)."
        )
        found += [
            f"  not detected: {view['polar_angle_deg']:g} deg at {view['distance']:.3g} m: {view['reason']}"
            for view in views["failures"][:5]
        ]
    return found


def _even(rows: Sequence[list[str]], width: int) -> list[list[str]]:
    return [row + [""] * (width - len(row)) for row in rows]
