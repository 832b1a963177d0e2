"""Records of synthetic views and their statistics: detection rate, errors, covariance consistency, stress tests."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices, Mask
from markergen.detect.detector import body_poses
from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimator
from markergen.estimators.budget import PoseBudget
from markergen.maths.rotation import logarithm
from markergen.model.body import Body
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.objectives.homography import validation_grid
from markergen.pool import chunks_of, map_counted, workers_for
from markergen.validation.bounds import budget_of, image_covariance
from markergen.validation.metrics import (
    POSE_PARAMETERS,
    flipped,
    homography_error_px2,
    nees_statistics,
    pose_failed,
    rms,
    rotation_error_deg,
    share_interval,
    statistics,
    translation_error_pct,
)
from markergen.validation.views import SyntheticViews, View

AT_ONCE = 10
"""Number of views per chunk of work."""

WORTH_A_WORKER = 60
"""Number of views below which starting another process does not pay."""

DETECTOR = "detect"
"""Name of the pose that the detection itself reports, from weighted image points, with its covariance."""

NOMINAL_COVERAGE = 0.95
"""Probability of the region around a pose whose share of true poses is measured."""

CONDITIONS: dict[str, Callable[[SyntheticViews[Any]], SyntheticViews[Any]]] = {
    "blur 2 px": lambda series: replace(series, optics=replace(series.optics, blur_px=2.0)),
    "noise 8": lambda series: replace(series, optics=replace(series.optics, noise_grey=8.0)),
    "half the light": lambda series: replace(
        series, optics=replace(series.optics, dark=series.optics.dark / 2, light=series.optics.light / 2)
    ),
    "one dot hidden": lambda series: replace(series, hidden=1),
    "clutter": lambda series: replace(series, background="clutter"),
}
"""Worse conditions by name, as functions that modify a series."""


@dataclass(frozen=True, eq=False)
class Record:
    """The errors of a view, without its image.

    Attributes
    ----------
    found : array (m,) of int
        Indices of the control points that were found; empty for a view that counts as not detected.
    error : array (m, 2), px
    uncorrected_px : array (m,)
    bound_px2 : array (m,)
        Bound on the variance of each dot's center, x and y together, for the image's noise.
    poses : mapping
        (RE in degrees, TE in percent) by estimator, without those that failed.
    pose_error : array (6,)
        Error of the detector's pose in the camera frame: log(R_hat R'), rad, and t_hat - t, m; nan if there is none.
    nees : float
        NEES: the pose error squared, weighted by the inverse of the detector's covariance.
    homography_px : float
        Root of HE, px; nan if there is no homography.
    plates : array (k,) of int
        Plates that were found by themselves, once for each such constellation.
    plate_deg, plate_sigma_deg : arrays (k,)
        Rotation errors of their own poses, degrees, and the standard deviations that the detection claims for these,
        RMS over the directions.
    plate_flipped : array (k,) of bool
        True where such a pose is nearer to the mirrored pose than to the true one.
    """

    index: int
    pose: int
    detected: bool
    wrong: bool
    failure: str
    found: NDArray[np.intp]
    error: Array
    uncorrected_px: Array
    bound_px2: Array
    poses: Mapping[str, tuple[float, float]]
    pose_error: Array
    nees: float
    homography_px: float
    plates: Indices
    plate_deg: Array
    plate_sigma_deg: Array
    plate_flipped: Mask

    @property
    def rotation_deg(self) -> float:
        """Rotation error of the detector's pose."""
        return float(np.rad2deg(np.linalg.norm(self.pose_error[:3])))

    @property
    def translation_mm(self) -> float:
        """Translation error of the detector's pose."""
        return float(1e3 * np.linalg.norm(self.pose_error[3:]))


def record(series: SyntheticViews[Any], view: View) -> Record:
    """Compare a view with the truth."""
    if not view.detected:
        empty, none = np.zeros(0), np.zeros(0, dtype=np.intp)
        return Record(
            view.index, view.pose, False, view.wrong, view.failure, none, np.zeros((0, 2)),
            empty, empty, {}, np.full(6, np.nan), np.nan, np.nan, none, empty, empty, np.zeros(0, dtype=bool),
        )  # fmt: skip
    body, rotation, translation = series.marker, series.poses.rotation[view.pose], series.poses.translation[view.pose]
    here = PoseDistribution("here", rotation[None], translation[None])
    covariance = image_covariance(body, series.camera, here, series.optics)[0]
    bound = np.trace(covariance, axis1=-2, axis2=-1)
    pose_error, nees = _own_error(view, rotation, translation)
    return Record(
        view.index, view.pose, True, False, "", view.found, view.error, view.uncorrected_px, bound[view.found],
        {} if body.frame == "rig" else _pose_errors(series, view, rotation, translation),
        pose_error, nees,
        _homography_px(series, view, rotation, translation),
        *_plates_alone(series, view, rotation, translation),
    )  # fmt: skip


def _plates_alone(
    series: SyntheticViews[Any], view: View, rotation: Array, translation: Array
) -> tuple[Indices, Array, Array, Mask]:
    """Plates with poses of their own, their errors and claimed standard deviations, and whether they are flipped."""
    body: Body = series.marker
    poses = [] if body.is_single else body_poses(view.detection, body, series.camera, series.errors)
    parts = [(body.constellations[k].plate, pose) for k, pose in poses]
    truths = [plate.camera_pose(rotation, translation) for plate, _ in parts]
    estimates = [pose for _, pose in parts]
    pairs = list(zip(estimates, truths, strict=True))
    return (
        np.array([body.plates.index(plate) for plate, _ in parts], dtype=np.intp),
        np.array([float(np.rad2deg(np.linalg.norm(logarithm(pose.rotation @ truth[0].T)))) for pose, truth in pairs]),
        np.array([float(pose.budget.rotation_deg["total"]) for pose in estimates]),
        np.array([flipped(pose.rotation[None], *truth)[0] for pose, truth in pairs], dtype=bool),
    )


def take_records(
    series: SyntheticViews[Any], workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> list[Record]:
    """Take all views of a series, distributed over processes; the records do not depend on the number of processes."""
    workers = workers_for(workers, 1 + series.count // WORTH_A_WORKER)
    parts = map_counted(partial(_records, series), chunks_of(series.count, AT_ONCE), workers, progress)
    return [taken for part in parts for taken in part]


def _records(series: SyntheticViews[Any], indices: Iterable[int]) -> list[Record]:
    return [record(series, series.take(k)) for k in indices]


Summarize = Callable[[SyntheticViews[Any], list[Record]], dict[str, Any]]
"""Makes plain values of the records of a series; nan for undefined numbers."""


def summarize(series: SyntheticViews[Marker], records: list[Record]) -> dict[str, Any]:
    """Plain values of views of a marker, in the form described in docs/validate.md; see `Summarize`."""
    poses = series.poses
    summary = partial(_summary, names=[DETECTOR, *_estimators(series.marker)])
    return {
        **summary(records),
        "optics": {**vars(series.optics)},
        "background": series.background,
        "hidden": series.hidden,
        "print_sigma_mm": 1e3 * series.errors.print_sigma,
        "print_measured": series.marker.places_measured,
        "by_polar_angle": _by_group(summary, records, poses.by_polar_angle()),
        "by_distance": _by_group(summary, records, poses.by_distance()),
        "samples": [_sample(record, poses) for record in records if record.detected],
        "failures": [
            {"view": record.index, **_where(record, poses), "reason": record.failure}
            for record in records
            if not record.detected
        ],
    }


def summarize_rig(
    series: SyntheticViews[Rig], records: list[Record], budget: PoseBudget | None = None
) -> dict[str, Any]:
    """Plain values of views of a rig, in the form described in docs/rigs.md, also by the number of plates in view.

    The `budget` of the series need not be computed again if it is at hand; see `Summarize`.
    """
    in_view = series.coverage
    summary = partial(_rig_summary, budget=budget or budget_of(series))
    return {
        **summary(records),
        "served": int(in_view.served[[record.pose for record in records]].sum()),
        "optics": {**vars(series.optics)},
        "background": series.background,
        "print_sigma_mm": 1e3 * series.errors.print_sigma,
        "by_plates": _by_group(summary, records, {"none": ~in_view.served} | in_view.by_plates()),
        "samples": [
            {
                **_place_of(record, series),
                "rotation_deg": record.rotation_deg,
                "translation_mm": record.translation_mm,
                "nees": record.nees,
                "alone": {
                    series.marker.plates[k].name: deg for k, deg in zip(record.plates, record.plate_deg, strict=True)
                },
                "dots": record.found.tolist(),
            }
            for record in records
            if record.detected
        ],
        "failures": [
            {**_place_of(record, series), "reason": record.failure} for record in records if not record.detected
        ],
        "hidden": series.hidden,
    }


def _place_of(record: Record, series: SyntheticViews[Rig]) -> dict[str, Any]:
    return {
        "view": record.index,
        "pose": record.pose,
        "distance": float(series.poses.distance[record.pose]),
        "plates": int(series.coverage.plates[record.pose]),
    }


def _rig_summary(records: list[Record], budget: PoseBudget) -> dict[str, Any]:
    """Statistics of some views: all plates together, and in the same views the plate alone that claims the least error.

    Flips of plates are of all that were found by themselves.
    """
    kept = [record for record in records if record.detected]
    both = [(record, int(record.plate_sigma_deg.argmin())) for record in kept if len(record.plates)]
    at = np.array([record.pose for record in kept], dtype=np.intp)
    points = _joined((record.error for record in kept), 2)
    flips = np.concatenate([np.zeros(0, dtype=bool), *(record.plate_flipped for record in kept)])
    nees = np.array([record.nees for record in kept])
    return {
        "count": len(records),
        "detected": len(kept),
        "wrong": sum(record.wrong for record in records),
        "rate": len(kept) / len(records),
        "rate_interval": share_interval(len(kept), len(records)),
        "point_px": statistics(np.linalg.norm(points, axis=-1)),
        "rotation_deg": statistics(np.array([record.rotation_deg for record in kept])),
        "translation_mm": statistics(np.array([record.translation_mm for record in kept])),
        "expected_deg": rms(budget.rotation_deg["total"][at]) if len(at) else None,
        "expected_mm": rms(1e3 * budget.translation["total"][at]) if len(at) else None,
        "nees": nees.mean() if len(nees) else None,
        "both": {
            "count": len(both),
            "rotation_deg": statistics(np.array([record.rotation_deg for record, _ in both])),
            "alone_deg": statistics(np.array([record.plate_deg[k] for record, k in both])),
        },
        "plates": {"found": len(flips), "flipped": int(flips.sum())},
    }


def stress(
    series: SyntheticViews[Any],
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    summary: Summarize = summarize,
) -> dict[str, Any]:
    """Return the summary of the views under each condition, without single views."""
    results = {}
    total = len(CONDITIONS) * series.count
    for number, (name, worsen) in enumerate(CONDITIONS.items()):
        later = _from_start(progress, number * series.count, total) if progress else None
        worse = worsen(series)
        summarized = summary(worse, take_records(worse, workers, later))
        results[name] = {key: value for key, value in summarized.items() if key != "samples"}
    return results


def _from_start(progress: Callable[[int, int], None], start: int, total: int) -> Callable[[int, int], None]:
    return lambda done, _: progress(start + done, total)


def _estimators(marker: Marker) -> dict[str, PoseEstimator]:
    """Pose estimators that support the marker, by name."""
    relief = bool(marker.xyz[:, 2].any())
    return {
        name: estimator
        for name in ESTIMATORS
        if isinstance(estimator := ESTIMATORS[name], PoseEstimator) and not (relief and estimator.planar_only)
    }


def _by_group(
    summary: Callable[[list[Record]], dict[str, Any]], records: list[Record], groups: Mapping[str, Mask]
) -> dict[str, Any]:
    inside = {name: [record for record in records if mask[record.pose]] for name, mask in groups.items()}
    return {name: summary(part) for name, part in inside.items() if part}


def _summary(records: list[Record], names: Sequence[str]) -> dict[str, Any]:
    kept = [record for record in records if record.detected]
    bound = _joined(record.bound_px2 for record in kept)
    return {
        "count": len(records),
        "detected": len(kept),
        "wrong": sum(record.wrong for record in records),
        "rate": len(kept) / len(records),
        "point_px": statistics(np.linalg.norm(_joined((record.error for record in kept), 2), axis=-1)),
        "bias_px": np.linalg.norm(_joined((record.error for record in kept), 2).mean(axis=0)) if kept else np.nan,
        "uncorrected_px": statistics(_joined(record.uncorrected_px for record in kept)),
        "image_bound_px": np.sqrt(np.mean(bound)) if len(bound) else np.nan,
        "homography_px": statistics(_finite([record.homography_px for record in kept])),
        "estimators": {
            name: {
                "rotation_deg": statistics(
                    np.array([record.poses[name][0] for record in kept if name in record.poses])
                ),
                "translation_pct": statistics(
                    np.array([record.poses[name][1] for record in kept if name in record.poses])
                ),
            }
            for name in names
        },
        "nees": _nees(_finite([record.nees for record in kept])),
    }


def _nees(values: Array) -> dict[str, Any]:
    """Mean NEES and coverage of the 95 % region, each with its 99 % interval."""
    from scipy.special import gammaincinv

    count, inside = len(values), int(np.sum(values <= 2 * gammaincinv(POSE_PARAMETERS / 2, NOMINAL_COVERAGE)))
    return {
        **nees_statistics(values),
        "coverage": inside / count if count else None,
        "coverage_interval": share_interval(inside, count) if count else None,
    }


def _where(record: Record, poses: PoseDistribution) -> dict[str, Any]:
    camera_center = -poses.rotation[record.pose].T @ poses.translation[record.pose]
    return {
        "pose": record.pose,
        "distance": float(poses.distance[record.pose]),
        "polar_angle_deg": round(float(poses.polar_angle_deg[record.pose]), 2),
        "azimuth_deg": round(float(np.rad2deg(np.arctan2(camera_center[1], camera_center[0]))), 2),
    }


def _sample(record: Record, poses: PoseDistribution) -> dict[str, Any]:
    rotation_deg, translation_pct = record.poses.get(DETECTOR, (np.nan, np.nan))
    return {
        "view": record.index,
        **_where(record, poses),
        "rotation_deg": rotation_deg,
        "translation_pct": translation_pct,
        "nees": record.nees,
        "rotation_vector_deg": np.rad2deg(record.pose_error[:3]).tolist(),
        "translation_error_mm": (1e3 * record.pose_error[3:]).tolist(),
        "point_px_rms": np.sqrt(np.mean(np.sum(record.error**2, axis=-1))),
        "dots": record.found.tolist(),
        "error_px": np.round(record.error, 6).tolist(),
    }


def _own_error(view: View, rotation: Array, translation: Array) -> tuple[Array, float]:
    pose = view.detection.pose
    if pose is None:
        return np.full(6, np.nan), np.nan
    error = np.concatenate([logarithm(pose.rotation @ rotation.T), pose.translation - translation])
    return error, float(error @ np.linalg.solve(pose.budget.total, error))


def _pose_errors(
    series: SyntheticViews[Marker], view: View, rotation: Array, translation: Array
) -> dict[str, tuple[float, float]]:
    camera, points = series.camera, series.marker.xyz[view.found]
    batch = Correspondences.from_distorted(points, view.detection.pixels[None], camera)
    estimates: dict[str, tuple[Array, Array]] = {}
    pose = view.detection.pose
    if pose is not None:
        estimates[DETECTOR] = (pose.rotation[None], pose.translation[None])
    for name, estimator in _estimators(series.marker).items():
        estimates[name] = batch.once(estimator).best
    errors = {}
    for name, estimate in estimates.items():
        te_pct = translation_error_pct(estimate[1], translation)
        if not pose_failed(points, *estimate, te_pct)[0]:
            errors[name] = (float(rotation_error_deg(estimate[0], rotation)[0]), float(te_pct[0]))
    return errors


def _homography_px(series: SyntheticViews[Any], view: View, rotation: Array, translation: Array) -> float:
    if view.detection.homography is None or len(series.marker.constellations) > 1:
        return np.nan
    grid = validation_grid(series.marker.boundary.radius)
    pixels = series.camera.ideal.project(grid, rotation[None], translation[None])[0]
    return float(np.sqrt(homography_error_px2(view.detection.homography[None], grid, pixels)[0]))


def _joined(parts: Iterable[Array], width: int = 0) -> Array:
    return np.concatenate([np.zeros((0, width) if width else 0), *parts])


def _finite(values: list[float]) -> Array:
    array = np.array(values, dtype=float)
    return array[np.isfinite(array)]
