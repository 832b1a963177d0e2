"""The report: one self-contained HTML file, with the same bytes for the same results."""
# tests: tests/validation/report/test_marker_report.py

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from markergen.estimators.budget import PoseBudget
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.picture import draw_marker, draw_rig, shows_origin, sides
from markergen.model.pose_sources.cone import poses_in_words
from markergen.model.rig import Rig
from markergen.model.sight import coverage
from markergen.objectives import Setting
from markergen.optimize.comparisons import LAYOUTS
from markergen.optimize.design import IMAGES
from markergen.optimize.dot_size import PERCENTILE, PIXELS
from markergen.presentation.pages import Section, page, picture
from markergen.presentation.plots import Plot, plot
from markergen.presentation.tables import Table, percent
from markergen.render import DEFAULT_OPTICS
from markergen.units import format_length
from markergen.validation import tables
from markergen.validation.bounds import budget_of
from markergen.validation.error_to_plan_with import middle
from markergen.validation.report import measured
from markergen.validation.report.plots import budget_over_tilt, compared, dome_plots, variance_shares
from markergen.validation.report.subject import (
    ERRORS,
    SOURCES,
    Results,
    Subject,
    advise,
    noise_px,
    pose_bins,
    value_text,
)
from markergen.validation.sentences import (
    advice_sentences,
    label_sentences,
    limit_sentences,
    marker_plan,
    plan_sentences,
    shares,
)
from markergen.validation.views import Picture, SyntheticViews


def html_report(
    results: Results, marker: Marker, setting: Setting, pictures: Sequence[Picture], budget: PoseBudget
) -> bytes:
    """Make a self-contained HTML page from the results of a validation.

    Parameters
    ----------
    results : mapping
        In the form described in docs/validate.md. A part that is null or empty omits its section, with a sentence on
        how to obtain it.
    marker : Marker
    setting : Setting
        Camera and poses of the results; their order defines the ``pose`` indices of the samples.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    budget : PoseBudget
        Covariances (P, 6, 6) of the setting's poses by source.

    Returns
    -------
    bytes
        UTF-8 without dates or external resources; its only script is the dome of poses. Text from files is escaped.
    """
    subject = Subject(results, marker, setting, budget)
    poses = setting.poses
    left_out = f", {poses.dropped} more do not see the whole marker" if poses.dropped else ""
    errors = Section(
        parts=[
            ("With noisy image points", measured.trials(subject)),
            ("In rendered images", measured.views(subject)),
        ]
    )
    return page(
        "Marker report",
        title(marker),
        [
            ("answer", "What to expect", answer(subject)),
            ("limits", "What limits it", limits(subject)),
            ("marker", "The marker", the_marker(subject)),
            ("pictures", "Sample views", sample_views(pictures)),
            ("labels", "Telling the dots apart", labels(subject)),
            ("errors", "Errors", errors),
            ("ellipses", "Error ellipses", measured.ellipses(subject)),
            ("beside", "Beside other layouts", comparison(subject)),
            ("size", "Size of the dots", size_advice(subject)),
            (
                "method",
                "How it was measured",
                Section(
                    terms=MARKER_TERMS,
                    parts=[("To repeat it, with your files for names in capitals", Section(text=command(subject)))],
                    book=("what is measured, and how", "validate.md"),
                ),
            ),
        ],
        f"{title(marker)}. {camera_words(setting.camera)}. "
        f"{len(poses)} poses ({poses_in_words(poses.name)}{left_out}).",
        "The same marker, options, and seed give the same page.",
        drawing_of(marker),
        4,
    )


def rig_report(
    series: SyntheticViews[Rig],
    results: Results,
    errors: Callable[..., Any],
    pictures: Sequence[Picture],
) -> bytes:
    """Make a self-contained HTML page from the results of a rig's validation.

    Parameters
    ----------
    series : SyntheticViews
        Rig, camera, poses and error sources of the results.
    results : mapping
        In the form described in docs/rigs.md.
    errors : callable
        Draws the errors on axes.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    """
    rig, in_view, (expected, *measured) = series.marker, series.coverage, tables.result_tables(results)
    dots = [[plate.name, str(len(plate.marker)), format_length(plate.marker.dot_diameter)] for plate in rig.plates]
    body = Section(
        [f"{rig!r}"[4:-1].capitalize() + "."],
        [
            plot(
                partial(draw_rig, rig, direction=direction),
                f"rig-{side}",
                f"The rig from its {side}: {', '.join(plate.name for plate in rig.plates)}.",
                f"The rig as seen from its {side}, from far away. Axes are those of the rig frame.",
                (4.4, 4.4),
                "paper",
            )
            for side, direction in sides(rig).items()
        ],
        [Table("Markers", ["marker", "dots", "diameter"], dots)],
        book=("rigs and their file", "rigs.md#rigjson"),
    )
    section = Section(tables=measured)
    if results["runs"]:
        caption = "RMS rotation error in the trials by distance, with the bound of all plates in view."
        section.plots.append(plot(errors, "errors", caption, caption))
    poses, budget = series.poses, budget_of(series)
    whole = {"rotation": budget.rotation_deg["total"], "translation": 1e3 * budget.translation["total"]}
    around = dome_plots(
        rig.plates,
        poses,
        {name: np.where(in_view.served, values, np.inf) for name, values in whole.items()},
        results["headline"]["source"],
        [f"{count} plate{'s' * (count != 1)} in view" for count in in_view.plates.tolist()],
    )
    title = f"{len(rig.plates)} markers with {len(rig)} dots"
    return page(
        "Rig report",
        title,
        [
            ("answer", "What to expect", Section(plan_sentences(results), around, [expected])),
            ("limits", "What limits it", Section(limit_sentences(results))),
            ("rig", "The rig", body),
            ("pictures", "Sample views", sample_views(pictures)),
            ("errors", "Errors", section),
            (
                "method",
                "How it was measured",
                Section(
                    terms=RIG_TERMS,
                    book=("what is measured, and how", "rigs.md#what-markergen-validate-rigjson-measures"),
                ),
            ),
        ],
        f"{title}. {camera_words(series.camera)}. {len(poses)} poses ({poses_in_words(poses.name)}), of which "
        f"{int(in_view.served.sum())} show a plate well enough to find it.",
        "The same rig, options, and seed give the same page.",
    )


def camera_words(camera: Camera) -> str:
    """Describe the camera of a report."""
    lens = f", {camera.distortion.model} lens" if camera.distortion.coefficients else ""
    size = f"{camera.width} x {camera.height} px"
    return f"Camera {size}, focal lengths {camera.fx:g} and {camera.fy:g} px{lens}"


def sample_views(pictures: Sequence[Picture]) -> Section:
    """Rendered views in their order."""
    plots = [picture(image.title, image.caption, image.png, image.box) for image in pictures]
    missing = "" if plots else "No pictures were made; markergen validate makes them with --views 100."
    return Section(plots=plots, missing=missing, book=("how views are made", "validate.md#views"))


LONGEST_TEXT, LONGEST_PROVENANCE = 200, 4000
"""Maximum number of characters shown from a marker's file, which is untrusted."""
_LOW, _SQUARE = (4.9, 2.3), (4.9, 5.1)
"""Widths and heights of plots in inches."""


def title(marker: Marker) -> str:
    """One line that identifies the marker."""
    return f"{len(marker)} dots of {marker.dot_words} in a {marker.boundary}"


def answer(subject: Subject) -> Section:
    """Expected errors in words, at each pose, and by tilt and distance, the hardest in bold."""
    from markupsafe import Markup

    bins = pose_bins(subject.expected)
    distances = sorted({pose_bin.distance for pose_bin in bins}, key=middle)
    tilts = sorted({pose_bin.tilt for pose_bin in bins}, key=middle)
    hardest = [max(getattr(pose_bin, key) for pose_bin in bins) for key in ("rotation_deg", "translation_mm")]
    bold = Markup("<strong>{}</strong>")
    by_place = {
        (pose_bin.distance, pose_bin.tilt): Markup(" / ").join(
            bold.format(text) if value == worst else text
            for value, worst, text in (
                (pose_bin.rotation_deg, hardest[0], value_text(pose_bin.rotation_deg, 2)),
                (pose_bin.translation_mm, hardest[1], value_text(pose_bin.translation_mm, 2)),
            )
        )
        for pose_bin in bins
    }
    rows = [[f"{tilt} deg", *(by_place.get((distance, tilt), "-") for distance in distances)] for tilt in tilts]
    table = Table(
        "RMS error to expect by tilt and distance, deg / mm",
        ["tilt", *(f"{distance} m" for distance in distances)],
        rows,
        "The hardest cases are in bold.",
    )
    book = ("what to plan with", "validate.md#what-to-plan-with")
    headline, expected = subject.results["headline"], subject.expected
    section = Section(marker_plan(headline), tables=[table], book=book)
    errors = {"rotation": expected.rotation_deg, "translation": expected.translation_mm}
    section.plots += dome_plots(subject.marker.plates, subject.setting.poses, errors, headline["source"])
    if "coverage" in subject.results:
        covered = coverage(subject.marker, subject.setting.camera, subject.setting.poses)
        section.tables.append(tables.dots_in_view_table(subject.results))
        section.plots.append(
            plot(
                covered.plot,
                "coverage",
                f"Dots in view over distance and tilt: {covered.count.min()} to {covered.count.max()}.",
                "Dots that each pose sees whole and large enough.",
            )
        )
    return section


def limits(subject: Subject) -> Section:
    """Sources of the error, and what to improve first."""
    budget = subject.results["budget"]
    share_texts = {name: in_words(shares(budget, key)) for key, name, _ in ERRORS}
    return Section(
        limit_sentences(subject.results),
        [
            plot(
                partial(variance_shares, budget),
                "shares",
                "Shares of the variance. " + "; ".join(f"{name}: {parts}" for name, parts in share_texts.items()) + ".",
                "What the variance of the error is made of, over all poses. Variances add up, errors do not: halving a "
                "source that makes 10 % of the variance gains 4 % of the error.",
                _LOW,
            ),
            *(
                plot(
                    partial(budget_over_tilt, subject.budget, subject.setting.poses, key),
                    f"budget-{name}",
                    f"RMS {name} error by source over the tilt.",
                    f"Sources of the {name} error over the tilt, RMS.",
                    xlabel="tilt, deg",
                    ylabel=f"{name} error, {unit}",
                )
                for key, name, unit in ERRORS
            ),
        ],
        [tables.budget_table(subject.results)],
        book=("the error budget", "validate.md#error-budget"),
    )


def drawing_of(marker: Marker) -> Plot:
    """Scale drawing of the marker."""
    return plot(
        partial(draw_marker, marker),
        "drawing",
        f"The marker: {title(marker)}.",
        "The marker to scale, seen from the front, with the ids of the dots"
        + (
            " and the axes of the marker frame at its origin (z comes toward the reader)."
            if shows_origin(marker)
            else "; the origin of the marker frame is outside of the picture."
        ),
        _SQUARE,
        "paper aside",
    )


def the_marker(subject: Subject) -> Section:
    """Table of the marker's dots, and where it came from."""
    marker = subject.marker
    rows = [
        [
            str(point.id),
            *(f"{round(1e3 * value, 2) + 0.0:.2f}" for value in (point.x, point.y, point.z)),
            point.feature.kind,
            f"{1e3 * point.feature.diameter:.6g}",
        ]
        for point in marker.control_points
    ]
    table = Table("Control points, mm", ["id", "x", "y", "z", "shape", "diameter"], rows)
    return Section(
        tables=[table],
        parts=[("Where it came from", Section(terms=origin(marker)))],
        folded=[("Provenance, as its file has it", Section(text=provenance(marker)))],
        book=("every key of the marker's file", "marker-json.md"),
    )


def labels(subject: Subject) -> Section:
    """Robustness of the dots' labels."""
    labeling = subject.results["labels"]
    if not labeling:
        return Section(missing="Bare points cannot be seen, and so not be distinguished.")
    rings = [str(point.id) for point in subject.marker.control_points if point.feature.kind == "ring"]
    if rings:
        looks = (
            f"Rings are distinguished from disks by their looks (here dot{'s' * (len(rings) > 1)} {', '.join(rings)})"
        )
    else:
        looks = "All dots look the same"
    return Section(
        [f"{looks}; dots that look the same are distinguished by their places alone.", *label_sentences(labeling)],
        tables=[tables.labels_table(labeling)],
        book=("labels, and how to make them safe", "design.md#labels"),
    )


def origin(marker: Marker) -> list[tuple[str, str]]:
    """Provenance of the marker as terms and values from its file."""
    spec = marker.provenance.get("spec")
    terms = [
        ("Spec hash", marker.spec_hash),
        ("Designed for", spec.get("objective") if isinstance(spec, dict) else None),
        ("Seed", marker.provenance.get("seed")),
        ("Versions", marker.provenance.get("versions")),
        ("Dots", marker.provenance.get("dots")),
    ]
    return [(term, _short(value)) for term, value in terms if value is not None] + searched(marker)


def searched(marker: Marker) -> list[tuple[str, str]]:
    """Constraints that the search had to keep, and how much better another layout under them can be, as terms."""
    search = marker.provenance.get("search")
    if not isinstance(search, dict):
        return []
    figures = {key: value for key, value in search.items() if isinstance(value, int | float) and value > 0}
    terms = [(term, format_length(figures[key])) for term, key in (("Clearance", "clearance_m"),) if key in figures]
    if figures.get("gap_m", 0.0) > figures.get("clearance_m", 0.0):
        reason = (
            "chosen so that images of dots do not run together" if search.get("gap_reason") == IMAGES else "as asked"
        )
        terms.append(("Gap between dots", f"{format_length(figures['gap_m'])}, {reason}"))
    if limits := search.get("limits"):
        terms.append(("Bounds", _short(limits)))
    for term, key in (("At best", "lower_bound"), ("At best, without the gap", "lower_bound_without_gap")):
        if key in figures and "value" in figures:
            terms.append((term, f"{percent(1 - figures[key] / figures['value'])} better, by the lower bound"))
    if "interrupted_s" in figures:
        terms.append(("Search", f"interrupted after {figures['interrupted_s']:.0f} s"))
    return terms


def provenance(marker: Marker) -> str:
    """The entire provenance from the marker's file, as plain ASCII text."""
    text = json.dumps(dict(marker.provenance), indent=2, default=str)
    return text if len(text) <= LONGEST_PROVENANCE else text[:LONGEST_PROVENANCE] + " ..."


def comparison(subject: Subject) -> Section:
    """The marker compared with other layouts."""
    results = subject.results
    if not results["comparisons"]:
        return Section(missing="These results hold no other layouts to compare with; markergen validate adds them.")
    layouts = {"this marker": results, **{LAYOUTS[name]: row for name, row in results["comparisons"].items()}}
    section = Section(
        [
            "The same room, poses, dot size, and noise for each layout: the regular polygon, four dots in a square, "
            "and the median of random layouts."
        ],
        tables=[tables.comparison_table(results)],
    )
    for key, name, unit in ERRORS:
        bounds = {layout: row["bound"][key] for layout, row in layouts.items()}
        kept = {layout: float(value) for layout, value in bounds.items() if value is not None}
        measured = {layout: _lm_rms(row, key) for layout, row in layouts.items()}
        section.plots.append(
            plot(
                partial(compared, kept, measured),
                f"beside-{key}",
                f"RMS {name} bound: "
                + ", ".join(f"{layout} {value_text(value)}" for layout, value in kept.items())
                + ".",
                f"Bound of the {name} error for noise of {noise_px(results):g} px, over all poses; shorter is better.",
                _LOW,
                xlabel=f"RMS {name} error, {unit}",
            )
        )
    return section


def size_advice(subject: Subject) -> Section:
    """Advice on the size of the dots."""
    marker, poses = subject.marker, subject.setting.poses
    advice = advise(marker, subject.setting.camera, poses)
    if advice is None:
        return Section(missing="Bare points have no size to print; design the marker with --dot above 0.")
    rows = [
        [
            name,
            *(f"{value_text(value)} px" for value in (size.thinnest_px, size.center_px)),
            format_length(size.diameter),
        ]
        for name, size in (("every pose", advice.worst), (f"{PERCENTILE:g} % of the poses", advice.most))
    ]
    header = ["in", "smallest dot", "at the center", f"diameter for {PIXELS:g} px"]
    title = f"Short axis of the image of a {format_length(marker.dot_diameter)} dot"
    return Section(advice_sentences(advice, marker, poses), tables=[Table(title, header, rows)])


def command(subject: Subject) -> str:
    """Command that reproduces these results, with MARKER.json and, if it is not that of the design, CAMERA.yaml."""
    results, seen = subject.results, subject.views
    budget = results["budget"]
    designed = subject.marker.provenance.get("camera") == subject.setting.camera.as_dict()
    options = {
        "--camera": None if designed else "CAMERA.yaml",
        "--poses": subject.setting.poses.name,
        "--runs": results["runs"],
        "--noise": results["noise_px"],
        "--views": seen.get("count", 0),
        "--optics": _optics(seen.get("optics") or {}),
        "--background": seen.get("background", "plain"),
        "--hide": seen.get("hidden", 0),
        "--print-sigma": f"{budget['print_sigma_mm']:g}mm",
        "--camera-covariance": "COVARIANCE" if designed and budget["rotation_deg"]["camera"] else None,
        "--seed": results["seed"],
    }
    defaults = {"--optics": "", "--background": "plain", "--hide": 0}
    parts = ["markergen", "validate", "MARKER.json"]
    for option, value in options.items():
        if value is not None and value != defaults.get(option):
            parts += [option, f"{value:g}" if isinstance(value, float) else str(value)]
    if any(row.get("estimators") for row in results["comparisons"].values()):
        parts.append("--trials-for-all")
    if seen.get("stress"):
        parts.append("--stress")
    return shlex.join([*parts, "--report", "report.html"])


def in_words(parts: Mapping[str, float]) -> str:
    """Shares of the variance, the largest first."""
    ordered = sorted(parts.items(), key=lambda part: -part[1])
    return ", ".join(f"{SOURCES[name]} {percent(part)}" for name, part in ordered)


def _optics(optics: Results) -> str:
    """Optics in the syntax of the option: values that differ from the default."""
    default = vars(DEFAULT_OPTICS)
    return ",".join(
        f"{key}={value:g}" for key, value in optics.items() if value is not None and value != default.get(key)
    )


def _lm_rms(row: Results, key: str) -> float | None:
    measured = row.get("estimators", {}).get("lm")
    return measured and measured[key]["rms"]


def _short(value: object) -> str:
    text = ", ".join(f"{key} {item}" for key, item in value.items()) if isinstance(value, dict) else str(value)
    return text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + " ..."


POSE_ERRORS = [
    ("Rotation error (RE)", "Angle of R_hatᵀ R, in degrees."),
    ("Translation error (TE)", "|t_hat - t| / |t|, in percent; in mm where it says so."),
]

MARKER_TERMS = [
    (
        "Marker frame",
        "Meters; x right, y up, z out of the printed face toward the viewer; the origin is the center of the "
        "boundary's smallest enclosing circle.",
    ),
    ("Camera frame", "x right, y down, z forward. Pixel centers are at integer coordinates."),
    (
        "Pose",
        "T_camera_marker: X_camera = R X_marker + t. Tilt is the angle between the marker's normal and the direction "
        "to the camera; 0 is frontal.",
    ),
    *POSE_ERRORS,
    (
        "Homography error (HE)",
        "Mean over a grid half as wide again as the marker of the squared distance, px²; its root in px stands beside "
        "it.",
    ),
    (
        "Bound (CRLB)",
        "The Cramér-Rao bound, to first order: no unbiased estimator is better. Far frontal poses are "
        "beyond first order: errors there are larger or smaller.",
    ),
    (
        "Efficiency",
        "Mean square of the bound over that of the measured error, without flips; left out where the bound on the "
        "rotation exceeds 2.5 degrees.",
    ),
    (
        "Excluded",
        "Failures: an estimate that is not finite, puts a point behind the camera, or has a TE over 100 %. Flips (the "
        "mirrored pose is nearer than the true one) stay in.",
    ),
    (
        "RMS over poses",
        "Root of the mean of squares, each pose counting the same. Frontal poses usually make the most of it, so see "
        "the errors by tilt as well.",
    ),
    (
        "Expected errors",
        "From the covariance to first order where that holds; elsewhere (few pixels, frontal poses, another pose that "
        "fits as well) the estimator's own errors, sampled, with flips.",
    ),
    (
        "Error budget",
        "To first order: what noise in the image, misplaced dots, and errors of the calibration make of the pose, "
        "weighed by their covariances. Not in it: a bent sheet, motion blur, and a wrong scale of "
        "a print that was not measured.",
    ),
]

RIG_TERMS = [
    ("Pose", "T_camera_rig: X_camera = R X_rig + t, in meters. Camera frame: x right, y down, z forward."),
    (
        "In view",
        "A dot counts if no part of it is hidden by a plate or beyond the image's edge, and its image is large enough "
        "to be found. A plate is in view if one of its dots is; a pose counts if one plate shows four.",
    ),
    (
        "Best alone",
        "The pose of the rig from the dots of one plate: to first order and in trials of the plate with the least "
        "bound, in views of the plate whose own detection claims the least error.",
    ),
    (
        "Errors to expect",
        "To first order, of the estimate that weights each dot by its own noise from image, print and the plates' "
        "relation; the errors that dots of a plate share by that relation are counted as they are.",
    ),
    *POSE_ERRORS,
    (
        "Flips",
        "The mirrored pose of a plate is nearer than its true one. Other plates settle which of the two it is.",
    ),
    ("NEES", "Squared error in units of the claimed covariance: 6 on average if that is right."),
]
