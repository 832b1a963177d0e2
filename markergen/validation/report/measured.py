"""Report sections on measurements: noisy trials, rendered views, and errors in two dimensions."""
# tests: tests/validation/report/test_plots.py

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.presentation.pages import Section
from markergen.presentation.plots import Plot, inline, plot, svg_bytes
from markergen.presentation.tables import Table
from markergen.render import Optics
from markergen.validation import tables
from markergen.validation.bounds import image_covariance
from markergen.validation.degrees import (
    BINS,
    DegreeErrors,
    correlation_sentence,
    draw_degrees,
    in_units,
    pose_degrees,
)
from markergen.validation.error_to_plan_with import middle
from markergen.validation.metrics import rms
from markergen.validation.report.plots import (
    Ellipse,
    distribution,
    draw_ellipses,
    errors_over,
    share_inside,
)
from markergen.validation.report.subject import (
    ERRORS,
    GROUPINGS,
    Expected,
    PoseBin,
    Results,
    Subject,
    bound,
    noise_px,
    pose_bins,
)
from markergen.validation.sentences import image_sentences, trial_sentences
from markergen.validation.view_records import DETECTOR

DRAWS = 40_000
"""Number of pose errors sampled from the covariances for the distribution that the bound predicts."""
MOST_FAILURES = 20
"""Maximum number of failed views in the table."""


def trials(subject: Subject) -> Section:
    """Errors of the estimators for noisy image points."""
    results = subject.results
    estimators = results["estimators"]
    if not estimators:
        return Section(missing="No trials were run; markergen validate runs them with --runs 1000.")
    limit = bound(subject.marker, subject.setting, noise_px(results))
    noise = f"{noise_px(results):g} px"
    section = Section(
        [
            f"{results['runs']} trials at each pose, Gaussian noise of {noise} on every image coordinate.",
            *trial_sentences({**results, "labels": None}),
        ]
    )
    for group, groups, axis in GROUPINGS:
        for key, name, unit in ERRORS:
            measured = {
                estimator: {group_name: row[key] for group_name, row in rows[groups].items()}
                for estimator, rows in estimators.items()
            }
            section.plots.append(
                plot(
                    partial(errors_over, measured, _by_group(limit, groups, key)),
                    f"trials-{group}-{key}",
                    f"RMS {name} error of each estimator over the {group}, with the bound below.",
                    f"{name.capitalize()} error over the {group}, for noise of {noise}.",
                    xlabel=axis,
                    ylabel=f"{name} error, {unit}",
                )
            )
    drawn = sample_pose_errors(limit.covariance)
    for key, name, unit in ERRORS:
        marks = {estimator: row[key] for estimator, row in estimators.items()}
        section.plots.append(
            plot(
                partial(distribution, _sizes(drawn, limit, key), {}, marks=marks),
                f"trials-cdf-{key}",
                f"Cumulative distribution of the {name} error of each estimator and of the bound.",
                f"Distribution of the {name} error over all trials and poses. The bound is what errors at the limit "
                "would show.",
                xlabel=f"{name} error, {unit}",
            )
        )
    section.tables += tables.trial_tables(results)
    return section


def views(subject: Subject) -> Section:
    """Detections in rendered images, and their errors."""
    seen = subject.views
    predicted = subject.predicted
    if predicted is None:
        return Section(missing="No views were rendered; markergen validate renders them with --views 100.")
    samples = seen["samples"]
    section = Section(image_sentences(seen), tables=_views_tables(seen))
    for group, groups, axis in GROUPINGS:
        where = _column(samples, "polar_angle_deg" if group == "tilt" else "distance")
        for key, name, unit in ERRORS:
            measured: dict[str, dict[str, Any]] = {}
            for group_name, row in seen[groups].items():
                for estimator, parts in row["estimators"].items():
                    measured.setdefault(estimator, {})[group_name] = parts[key]
            if not measured and not len(where):
                continue
            limits = _by_group(predicted, groups, key)
            single = where, _column(samples, key)
            section.plots.append(
                plot(
                    partial(errors_over, measured, limits, samples=single, bound_name="predicted"),
                    f"views-{group}-{key}",
                    f"RMS {name} error in rendered images over the {group}, with single views as dots.",
                    f"{name.capitalize()} error in rendered images over the {group}.",
                    xlabel=axis,
                    ylabel=f"{name} error, {unit}",
                )
            )
    drawn = sample_pose_errors(predicted.covariance)
    for key, name, unit in (*ERRORS, ("point_px_rms", "dot center", "px, RMS of a view")):
        values = _column(samples, key)
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        of_pose = key != "point_px_rms"
        prediction = _sizes(drawn, predicted, key) if of_pose else None
        curves = {DETECTOR if of_pose else "dots": ranked(values)}
        section.plots.append(
            plot(
                partial(distribution, prediction, curves, predicted_name="predicted"),
                f"views-cdf-{key}",
                f"Cumulative distribution of the {name} error in rendered images.",
                f"Distribution of the {name} error over {len(values)} rendered views.",
                xlabel=f"{name} error, {unit}",
            )
        )
    by_degree = _by_degree(predicted, samples)
    if by_degree:
        section.folded.append(("Errors against poses, by degree of freedom", by_degree))
    return section


def _by_degree(predicted: Expected, samples: Sequence[Results]) -> Section | None:
    """The 36 plots of pose against error, and correlations that stand out; None of too few views."""
    kept = [sample for sample in samples if np.isfinite(np.array(sample["translation_error_mm"], dtype=float)).all()]
    if len(kept) < BINS:
        return None
    at = np.array([sample["pose"] for sample in kept])
    errors = DegreeErrors(
        pose_degrees(predicted.poses.rotation[at], predicted.poses.translation[at]),
        np.array([[*sample["translation_error_mm"], *sample["rotation_vector_deg"]] for sample in kept]),
        in_units(np.sqrt(np.diagonal(predicted.covariance[at], axis1=1, axis2=2))),
    )
    drawing = inline(
        svg_bytes(partial(draw_degrees, entry=errors, as_pixels=False), (9.0, 9.0)),
        "by-degree",
        "Each error of the pose over each of its degrees of freedom, in 36 plots.",
        "Errors in the camera frame over position, tilt and roll. Of each eighth: mean, black; mean and spread, "
        "blue; the spread that is predicted, dashed.",
        "wide",
    )
    return Section([correlation_sentence(errors.summary()["standing_out"], len(kept))], [drawing])


def ellipses(subject: Subject) -> Section:
    """Predicted 95 % ellipses of dots and poses, and the measured errors."""
    samples = subject.views.get("samples", [])
    expected = subject.predicted or subject.expected
    source = (
        "the noise and the print error that the views were made with"
        if subject.predicted is not None
        else subject.results["headline"]["source"]
    )
    section = Section([f"95 % of the errors lie inside their ellipse, if there is nothing but {source}."])
    section.plots += _dots(subject, samples)
    corners = _corners(pose_bins(expected))
    for name, key, rows, scale, across, up in (
        ("position", "translation_error_mm", [3, 5], 1e3, "to the right, mm", "away from the camera, mm"),
        ("attitude", "rotation_vector_deg", [0, 1], np.rad2deg(1.0), "about the camera's x, deg", "about its y, deg"),
    ):
        covariances = scale**2 * expected.covariance[:, rows][:, :, rows]
        drawn = [_of_corner(corner, covariances, samples, key, [row % 3 for row in rows]) for corner in corners]
        if not all(np.isfinite(drawing.covariance).all() for drawing in drawn):
            continue
        measured = any(len(drawing.errors) for drawing in drawn)
        section.plots.append(
            plot(
                partial(draw_ellipses, drawn),
                f"ellipse-{name}",
                f"Predicted 95 % ellipses of the marker's {name} at {'; '.join(corner.name for corner in drawn)}.",
                f"Error of the marker's {name} in the camera frame, at the nearest and the farthest, least and most "
                f"tilted poses{', with the errors of the views from there' if measured else ''}.",
                xlabel=across,
                ylabel=up,
            )
        )
    return section


def _dots(subject: Subject, samples: Sequence[Results]) -> list[Plot]:
    """Errors of the dots' centers, each transformed from its own covariance to the mean of all."""
    if not subject.marker.dot_diameter:
        return []
    kept = [sample for sample in samples if sample.get("error_px")]
    errors = np.array([error for sample in kept for error in sample["error_px"]], dtype=float).reshape(-1, 2)
    if len(errors) < 2:
        return []
    optics = Optics(**(subject.views.get("optics") or {}))
    every = image_covariance(subject.marker, subject.setting.camera, subject.setting.poses, optics)
    ids = range(len(subject.marker))
    own_covariances = np.concatenate([every[sample["pose"]][list(sample.get("dots") or ids)] for sample in kept])
    if not np.isfinite(own_covariances).all():
        return []
    mean = own_covariances.mean(axis=0)
    carried = carried_over(errors, own_covariances, mean)
    pair = [
        Ellipse("predicted", mean, carried),
        Ellipse("measured", carried.T @ carried / len(carried), carried[:0]),
    ]
    return [
        plot(
            partial(draw_ellipses, pair),
            "ellipse-dots",
            "Errors of the dots' centers in the image, with the predicted and the measured 95 % ellipse.",
            f"Errors of {len(errors)} dot centers in the image, each as many standard deviations off as it was under "
            f"its own covariance. {100 * share_inside(carried, mean):.1f} % lie inside the predicted ellipse.",
            xlabel="right, px",
            ylabel="down, px",
        )
    ]


def _corners(bins: list[PoseBin]) -> list[PoseBin]:
    """Extreme bins: nearest and farthest, each least and most tilted."""
    distances = {pose_bin.distance for pose_bin in bins}
    chosen: dict[int, PoseBin] = {}
    for distance in (min(distances, key=middle), max(distances, key=middle)):
        there = [pose_bin for pose_bin in bins if pose_bin.distance == distance]
        for extreme in (min, max):
            corner = extreme(there, key=lambda pose_bin: middle(pose_bin.tilt))
            chosen[id(corner)] = corner
    return list(chosen.values())


def _of_corner(corner: PoseBin, covariances: Array, samples: Sequence[Results], key: str, rows: list[int]) -> Ellipse:
    """Ellipse of the first pose of a bin, with the errors of all views in that bin transformed to it."""
    target = covariances[int(np.flatnonzero(corner.poses)[0])]
    there = [sample for sample in samples if sample.get(key) is not None and corner.poses[sample["pose"]]]
    errors = np.array([[sample[key][row] for row in rows] for sample in there], dtype=float).reshape(-1, 2)
    sample_covariances = covariances[[sample["pose"] for sample in there]] if there else covariances[:0]
    return Ellipse(f"{corner.distance} m, {corner.tilt} deg", target, carried_over(errors, sample_covariances, target))


def _by_group(expected: Expected, groups: str, key: str) -> dict[str, float]:
    """RMS of ``rotation_deg`` or ``translation_pct`` over each group of poses."""
    masks = getattr(expected.poses, groups)()
    return {name: rms(getattr(expected, key)[mask]) for name, mask in masks.items()}


def _sizes(errors: Array, expected: Expected, key: str) -> Array:
    """RE in degrees or TE in percent (k,) of pose errors (P, T, 6)."""
    if key == "rotation_deg":
        return np.asarray(np.rad2deg(np.linalg.norm(errors[..., :3], axis=-1))).ravel()
    distance = expected.poses.distance[np.isfinite(expected.covariance).all(axis=(1, 2))]
    return np.asarray(100 * np.linalg.norm(errors[..., 3:], axis=-1) / distance[:, None]).ravel()


def _column(samples: Sequence[Results], key: str) -> Array:
    return np.array([np.nan if sample.get(key) is None else sample[key] for sample in samples], dtype=float)


def _views_tables(seen: Results) -> list[Table]:
    listed = tables.view_tables(seen)
    failures = seen["failures"]
    if failures:
        rows = [
            [f"{failure['polar_angle_deg']:g} deg", f"{failure['distance']:.3g} m", str(failure["reason"])]
            for failure in failures[:MOST_FAILURES]
        ]
        more = f"And {len(failures) - MOST_FAILURES} more." if len(failures) > MOST_FAILURES else ""
        listed.append(Table("Views that count as not detected", ["tilt", "distance", "reason"], rows, more))
    return listed


def ranked(values: Array) -> tuple[Array, Array]:
    """Values in ascending order, and the share of them at or below each."""
    return np.sort(values), np.arange(1, len(values) + 1) / len(values)


def sample_pose_errors(covariance: Array) -> Array:
    """Sample pose errors (k, 6) from covariances (P, 6, 6), equally many each, reproducibly."""
    covariance = covariance[np.isfinite(covariance).all(axis=(1, 2))]
    if not len(covariance):
        return np.zeros((0, 6))
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    per_pose = max(1, DRAWS // len(covariance))
    noise = np.random.default_rng(0).standard_normal((len(covariance), per_pose, 6))
    return np.asarray(noise @ root.swapaxes(-1, -2))


def carried_over(errors: Array, covariances: Array, target: Array) -> Array:
    """Transform errors (k, 2), each with its own covariance (k, 2, 2), to the target covariance (2, 2).

    L_target L_k^-1 e with Cholesky factors L, which preserves the Mahalanobis distance.
    """
    if not len(errors):
        return errors
    whitened = np.linalg.solve(np.linalg.cholesky(covariances), errors[..., None])
    return np.asarray((np.linalg.cholesky(target) @ whitened)[..., 0])
