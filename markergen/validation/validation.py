"""Validate a marker or rig by trials, bounds, criteria, other layouts and synthetic views."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.bounds.confusion.perspective import label_safety
from markergen.defaults import NOISE_PX, RUNS
from markergen.errors import InputError
from markergen.model.marker import Marker, build_marker, check_supported
from markergen.model.rig import Rig
from markergen.model.sight import coverage
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import Criteria, criteria, without_height
from markergen.optimize.comparisons import compare, comparison_layouts
from markergen.optimize.problem import FeasibleRegion
from markergen.options import Progress
from markergen.presentation.results import plain
from markergen.validation import error_to_plan_with
from markergen.validation.bounds import budget_of, error_budget
from markergen.validation.expectation import expect, without_calibration
from markergen.validation.relative_error import relative_error_of
from markergen.validation.report.subject import mean_diameters
from markergen.validation.setting import setting_for
from markergen.validation.trials import TrialResults, rig_trials, run_experiment
from markergen.validation.view_records import DETECTOR, Record, stress, summarize, summarize_rig, take_records
from markergen.validation.views import SyntheticViews


def run_validation(
    series: SyntheticViews[Any],
    noise_px: float = NOISE_PX,
    runs: int = RUNS,
    workers: int | None = None,
    trials_for_all: bool = False,
    stressed: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Validate a marker or rig and return the results as plain JSON values.

    Parameters
    ----------
    series : SyntheticViews
        The marker or rig, camera, poses, seed and, if its count is above 0, synthetic images to render and detect. The
        error budget uses its optics and error sources.
    noise_px : float
        Standard deviation of the noise on every image coordinate.
    runs : int
        Noisy trials for each pose; 0 gives the bounds alone.
    trials_for_all : bool
        Run the trials for the other layouts as well; otherwise only their criteria and bounds are computed.
    stressed : bool
        Repeat the views under worse conditions.
    progress : callable or None
        Called with the stage, the amount done, and the total.

    Returns
    -------
    dict
        In the form described in docs/validate.md, of a rig in docs/rigs.md.

    Raises
    ------
    InputError
        If the control points determine no homography (no pose for a relief), no pose shows four dots of a plate of a
        rig, a number is out of range, or `check_supported` refuses a marker.
    """
    for plate in series.marker.plates:
        check_supported(plate.marker, "to validate")
    stage = _stages(progress)
    if series.marker.frame == "rig":
        return _of_rig(series, noise_px, runs, workers, stressed, stage)
    return _of_marker(series, noise_px, runs, workers, trials_for_all, stressed, stage)


Stage = Callable[[str], Callable[[int, int], None] | None]
"""Called with a stage, returns what is called with the amount done and the total."""


def _stages(progress: Progress | None) -> Stage:
    return lambda stage: partial(progress, stage) if progress else None


def _of_marker(
    series: SyntheticViews[Marker],
    noise_px: float,
    runs: int,
    workers: int | None,
    trials_for_all: bool,
    stressed: bool,
    stage: Stage,
) -> dict[str, Any]:
    marker, seed = series.marker, series.seed
    setting = setting_for(marker, series.camera, series.poses)

    def trials(judged: Marker, name: str) -> TrialResults:
        layout = without_height(judged.xyz)[None]
        # A relief has no homography, nor have dots of which a pose sees a part one for all poses.
        plane = layout.shape[-1] == 2 and not setting.sight
        condition = OBJECTIVES["condition"](setting).per_pose(layout)[0] if plane else None
        return run_experiment(
            judged, setting.camera, setting.poses, noise_px, runs, seed,
            workers=workers, progress=stage(name), condition=condition,
        )  # fmt: skip

    points = without_height(marker.xyz)
    region = FeasibleRegion(marker.boundary, marker.dot_diameter, marker.clearance)
    flat = points.shape[-1] == 2 and not setting.sight
    judge, what = ("condition", "homography") if flat else ("pose", "pose")
    if not np.isfinite(OBJECTIVES[judge](setting)(points[None])[0]):
        raise InputError(
            f"control points that determine a {what}",
            "too many of them collinear or coincident",
            "design the marker again, with four points in general position",
        )
    measurements = trials(marker, "trials")
    table = compare(points, region, setting, seed)
    beside: dict[str, Any] = {name: _beside(row, noise_px) for name, row in table.items() if name != "design"}
    if trials_for_all:
        for name, layouts in comparison_layouts(region, len(points), seed).items():
            middle = median_layout(layouts, setting)
            layout = build_marker(middle, marker.boundary, marker.dot_diameter, marker.clearance)
            measured = trials(layout, name).as_dict()
            beside[name] = {key: measured[key] for key in ("bound", "estimators", "homography")}
            beside[name]["criteria"] = criteria(middle[None], setting)[0]
    records = take_records(series, workers, stage("views")) if series.count else []
    views = summarize(series, records) if series.count else None
    if views is not None and stressed:
        views["stress"] = stress(series, workers, stage("stress"))
    budget = error_budget(series, noise_px)
    expected = expect(series, noise_px, seed, progress=stage("expected errors"))
    claim = error_to_plan_with.plan_for(expected, series, noise_px, seed)
    if views is not None:
        exact = series.errors.camera_covariance is None
        of_views = expected if exact else expect(without_calibration(series), noise_px, seed)
        claim["views"] = error_to_plan_with.compare_views(of_views, series.poses, views, claim, seed)
    labels = label_safety(marker, setting, noise_px).as_dict() if marker.dot_diameter else None
    dots = _extent(marker, setting) if marker.dot_diameter else None
    covered = _coverage(marker, setting, expected.rotation_deg, records) if setting.sight else None
    return measurements.as_dict(
        criteria=table["design"], comparisons=beside, views=views, budget=budget, labels=labels, dots=dots,
        headline=claim, expected=expected.as_dict(), coverage=covered, relative_error=relative_error_of(measurements),
    )  # fmt: skip


def _coverage(marker: Marker, setting: Setting, expected_deg: Array, records: Sequence[Record]) -> dict[str, Any]:
    """Return what serves which distance, with RMS rotation errors to expect (P,) and of the views' records."""
    in_view = coverage(marker, setting.camera, setting.poses)
    rows = in_view.rows()
    for row, (_, _, mask) in zip(rows, in_view.bands(), strict=True):
        seen = [record.poses[DETECTOR][0] for record in records if mask[record.pose] and DETECTOR in record.poses]
        row["expected_deg"] = float(np.sqrt(np.mean(expected_deg[mask] ** 2)))
        row["views_deg"] = float(np.sqrt(np.mean(np.square(seen)))) if seen else None
    return {"diameters": [float(in_view.diameters[scale[0]]) for scale in in_view.scales], "by_distance": rows}


def _extent(marker: Marker, setting: Setting) -> dict[str, float]:
    """Return the least mean diameter of a dot's image, what it takes to be found, and the share of poses without."""
    seen = mean_diameters(marker, setting.camera, setting.poses)
    if setting.sight:
        seen = np.where(setting.sight.seen, seen, np.inf)
    needed = marker.least_px
    dot = np.unravel_index(np.argmin(seen / needed), seen.shape)
    too_small = float(np.mean((seen < needed).any(axis=1)))
    return {"least_px": float(seen[dot]), "needed_px": float(needed[dot[1]]), "too_small": too_small}


def median_layout(layouts: Array, setting: Setting) -> Array:
    """Return the layout (n, d) whose pose criterion is the median of those of layouts (k, n, d), k odd."""
    return np.asarray(layouts[np.argsort(OBJECTIVES["pose"](setting)(layouts))[len(layouts) // 2]])


def _of_rig(
    series: SyntheticViews[Rig], noise_px: float, runs: int, workers: int | None, stressed: bool, stage: Stage
) -> dict[str, Any]:
    rig, poses, in_view = series.marker, series.poses, series.coverage
    served = in_view.served
    if not served.any():
        raise InputError(
            "a pose that shows four dots of a plate, whole and large enough to be found",
            f"none of {len(poses)} ({poses.name})",
            "use nearer poses, larger dots, or a camera with a narrower view",
        )
    trials = rig_trials(series, noise_px, runs, workers, stage("trials"))
    joint, alone = budget_of(series), budget_of(series, alone=True)
    records = take_records(series, workers, stage("views")) if series.count else []
    summary = partial(summarize_rig, budget=joint)
    views = summary(series, records) if records else None
    if views is not None and stressed:
        views["stress"] = stress(series, workers, stage("stress"), summarize_rig)
    results = {
        "rig": {
            "markers": [plate.name for plate in rig.plates],
            "control_points": len(rig),
            "radius": rig.radius,
            "relation_exact": rig.relation is None,
        },
        "headline": error_to_plan_with.plan_for_rig(series, joint, alone),
        "camera": series.camera.as_dict(),
        "poses": {"name": poses.name, "count": len(poses), "dropped": 0, "served": int(served.sum())},
        "noise_px": noise_px,
        "runs": runs,
        "seed": series.seed,
        "bound": trials["bound"],
        "estimators": trials["estimators"],
        "budget": error_budget(series, noise_px, joint, alone),
        "views": views,
        "nees": trials["nees"],
    }
    values: dict[str, Any] = plain(results)
    return values


def _beside(row: Criteria, noise_px: float) -> dict[str, Any]:
    # Criteria are for 1 px; bounds are proportional to the noise.
    return {"criteria": dict(row), "bound": {key: noise_px * row[key] for key in ("rotation_deg", "translation_pct")}}
