"""Validate a marker by trials, bounds, criteria, other layouts and synthetic views.

`validate` computes plain JSON values; `Validation` prints, plots, saves, checks and processes them.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.bounds.confusion.perspective import label_safety
from markergen.defaults import NOISE_PX, RUNS
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker, build_marker, check_supported
from markergen.model.poses import PoseDistribution
from markergen.model.sight import coverage, partly_seen, poses_that_serve
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.base import Sight
from markergen.objectives.criteria import Criteria, criteria, without_height
from markergen.optimize.comparisons import compare, comparison_layouts
from markergen.optimize.problem import FeasibleRegion
from markergen.options import Progress
from markergen.presentation.plots import axes_of
from markergen.presentation.tables import Table, data_frame, number
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_of
from markergen.validation import headline, tables
from markergen.validation.bounds import budget_of, error_budget
from markergen.validation.expectation import expect, without_calibration
from markergen.validation.metrics import STATISTICS
from markergen.validation.report import html_report
from markergen.validation.report.plots import errors_over
from markergen.validation.report.subject import mean_diameters
from markergen.validation.result import ValidationResult
from markergen.validation.trials import TrialResults, run_experiment
from markergen.validation.view_records import DETECTOR, Record, stress, summarize, take_records
from markergen.validation.views import Picture, SyntheticViews

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Array = NDArray[np.float64]

_ANGLE = "polar_angle_deg"


def setting_of(marker: Marker, poses: str | PoseDistribution | None = None, camera: Camera | None = None) -> Setting:
    """Return the camera and poses that a marker was designed for, or others: poses in any form for `poses_from`.

    A marker whose file does not state its setting is judged in the paper's.

    Raises
    ------
    InputError
        If the poses are unknown, or none sees the entire marker.
    """
    spec = spec_of(marker) or Spec()
    distribution = poses_from(spec.poses if poses is None else poses)
    camera = camera or spec.camera
    return setting_for(marker, camera, poses_that_serve(marker, camera, distribution))


def setting_for(marker: Marker, camera: Camera, poses: PoseDistribution) -> Setting:
    """Return the setting in which poses see all of a marker, or of one with dots of several sizes, a part."""
    seen = partly_seen(marker, camera, poses)
    sight = None if seen is None else Sight(seen, np.zeros((len(poses), 6, 6)))
    return Setting(marker.boundary, camera, poses, sight=sight)


def validate(
    marker: Marker,
    setting: Setting,
    noise_px: float = NOISE_PX,
    runs: int = RUNS,
    series: SyntheticViews | None = None,
    seed: int = 0,
    workers: int | None = None,
    trials_for_all: bool = False,
    stressed: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Validate a marker and return the results as plain JSON values.

    Parameters
    ----------
    noise_px : float
        Standard deviation of the noise on every image coordinate.
    runs : int
        Noisy trials for each pose; 0 gives the bounds alone.
    series : SyntheticViews or None
        Synthetic images to render and detect; the error budget uses their optics and error sources. None means no
        images, the default optics, and a print error of 0.1 mm.
    trials_for_all : bool
        Run the trials for the other layouts as well; otherwise only their criteria and bounds are computed.
    stressed : bool
        Repeat the views under worse conditions.
    progress : callable or None
        Called with the stage, the amount done, and the total.

    Returns
    -------
    dict
        In the form described in docs/validate.md.

    Raises
    ------
    InputError
        If the control points determine no homography (no pose for a relief), a number is out of range, or
        `check_supported` refuses the marker.
    """
    check_supported(marker, "to validate")

    def told(stage: str) -> Callable[[int, int], None] | None:
        return (lambda done, total: progress(stage, done, total)) if progress else None

    def trials(judged: Marker, stage: str) -> TrialResults:
        layout = without_height(judged.xyz)[None]
        # A relief has no homography, nor have dots of which a pose sees a part one for all poses.
        plane = layout.shape[-1] == 2 and not setting.sight
        condition = OBJECTIVES["condition"](setting).per_pose(layout)[0] if plane else None
        return run_experiment(
            judged, setting.camera, setting.poses, noise_px, runs, seed,
            workers=workers, progress=told(stage), condition=condition,
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
    own = trials(marker, "trials")
    table = compare(points, region, setting, seed)
    beside: dict[str, Any] = {name: _beside(row, noise_px) for name, row in table.items() if name != "design"}
    if trials_for_all:
        for name, layouts in comparison_layouts(region, len(points), seed).items():
            middle = median_layout(layouts, setting)
            found = trials(build_marker(middle, marker.boundary, marker.dot_diameter, marker.clearance), name).as_dict()
            beside[name] = {key: found[key] for key in ("bound", "estimators", "homography")}
            beside[name]["criteria"] = criteria(middle[None], setting)[0]
    series = series or SyntheticViews(marker, setting.camera, setting.poses, 0, errors=ErrorSources())
    records = take_records(series, workers, told("views")) if series.count else []
    views = summarize(series, records) if series.count else None
    if views is not None and stressed:
        views["stress"] = stress(series, workers, told("stress"))
    budget = error_budget(series, noise_px)
    expected = expect(series, noise_px, seed, progress=told("expected errors"))
    claim = headline.of(expected, series, noise_px, seed)
    if views is not None:
        exact = series.errors.camera_covariance is None
        of_views = expected if exact else expect(without_calibration(series), noise_px, seed)
        claim["views"] = headline.compare_views(of_views, series.poses, views, claim, seed)
    labels = label_safety(marker, setting).as_dict(noise_px) if marker.dot_diameter else None
    dots = _extent(marker, setting) if marker.dot_diameter else None
    covered = _coverage(marker, setting, expected.rotation_deg, records) if setting.sight else None
    return own.as_dict(
        criteria=table["design"], comparisons=beside, views=views, budget=budget, labels=labels, dots=dots,
        headline=claim, expected=expected.as_dict(), coverage=covered,
    )  # fmt: skip


def _coverage(marker: Marker, setting: Setting, expected_deg: Array, records: Sequence[Record]) -> dict[str, Any]:
    """Return what serves which distance, with RMS rotation errors to expect (P,) and of the views' records."""
    found = coverage(marker, setting.camera, setting.poses)
    rows = found.rows()
    for row, (_, _, mask) in zip(rows, found.bands(), strict=True):
        seen = [each.poses[DETECTOR][0] for each in records if mask[each.pose] and DETECTOR in each.poses]
        row["expected_deg"] = float(np.sqrt(np.mean(expected_deg[mask] ** 2)))
        row["views_deg"] = float(np.sqrt(np.mean(np.square(seen)))) if seen else None
    return {"diameters": [float(found.diameters[scale[0]]) for scale in found.scales], "by_distance": rows}


def _extent(marker: Marker, setting: Setting) -> dict[str, float]:
    """Return the least mean diameter of a dot's image, what it takes to be found, and the share of poses without."""
    seen = mean_diameters(marker, setting.camera, setting.poses)
    if setting.sight:
        seen = np.where(setting.sight.seen, seen, np.inf)
    needed = np.array([point.feature.least_pixels for point in marker.control_points])
    dot = np.unravel_index(np.argmin(seen / needed), seen.shape)
    too_small = float(np.mean((seen < needed).any(axis=1)))
    return {"least_px": float(seen[dot]), "needed_px": float(needed[dot[1]]), "too_small": too_small}


def median_layout(layouts: Array, setting: Setting) -> Array:
    """Return the layout (n, d) whose pose criterion is the median of those of layouts (k, n, d), k odd."""
    return np.asarray(layouts[np.argsort(OBJECTIVES["pose"](setting)(layouts))[len(layouts) // 2]])


class Validation(ValidationResult[SyntheticViews]):
    """The result of `markergen.validate`.

    ``print(validation)`` shows what the command prints. It can be pickled, and keeps no images: those for a report or a
    folder of pictures are rendered again, identically.

    Parameters
    ----------
    results : mapping
        Return value of `validate`, in the form described in docs/validate.md.
    series : SyntheticViews
        Marker, camera, poses, optics and error sources of the results.
    written : sequence of Written
        Files that were written together with the results.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, dot="30mm", restarts=2).marker
    >>> validation = mg.validate(marker, poses="cone:count=20", runs=0, views=0)
    >>> 0 < validation.bound["rotation_deg"] < 1
    True
    >>> print(validation.views)
    None
    """

    @property
    def marker(self) -> Marker:
        """The marker that was validated."""
        return self.series.marker

    @property
    def setting(self) -> Setting:
        """Camera, and the poses that see the entire marker."""
        return setting_for(self.marker, self.series.camera, self.series.poses)

    @property
    def nees(self) -> Mapping[str, Any] | None:
        """Normalized estimation error squared of LM, 6 on average if the covariances are right; None for 0 runs."""
        nees = self._results["nees"]
        return None if nees is None else MappingProxyType(nees)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with one row per estimator and polar angle, and one over all poses.

        Its columns are ``source`` (``trials`` or ``views``), ``estimator``, ``polar_angle_deg`` (a text: an angle, a
        bin such as ``30..40``, or ``all``), mean, std, rms, median, p95 and max of ``rotation_deg`` and
        ``translation_pct`` (as in ``rotation_deg_rms``), each with its ``bound``, ``efficiency``, ``flip_rate`` and
        ``failure_rate``. Undefined values are missing.

        Raises
        ------
        MissingLibraryError
            If pandas is not installed.
        """
        rows = []
        trials = {name: {"all": row, **row["by_polar_angle"]} for name, row in self.estimators.items()}
        views = self.views or {"estimators": {}, "by_polar_angle": {}}
        groups = {"all": views, **views["by_polar_angle"]}
        seen = {name: {at: group["estimators"][name] for at, group in groups.items()} for name in views["estimators"]}
        for source, measured in (("trials", trials), ("views", seen)):
            for name, by_angle in measured.items():
                for angle, row in by_angle.items():
                    bound = self._bound_at(angle) if source == "trials" else {}
                    rows.append({"source": source, "estimator": name, _ANGLE: angle, **_columns(row, bound)})
        return data_frame(rows)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the RMS rotation error of each estimator over the polar angle, with the bound beneath.

        The errors are those of the trials, or, if there were none, of the synthetic views.

        Parameters
        ----------
        ax : matplotlib axes or None
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        ax = axes_of(ax)
        measured = {name: _rotation(row["by_polar_angle"]) for name, row in self.estimators.items()}
        if self.views and not measured:
            groups = self.views["by_polar_angle"]
            for name in self.views["estimators"]:
                measured[name] = _rotation({at: group["estimators"][name] for at, group in groups.items()})
        bound = {angle: row["rotation_deg"] for angle, row in self.bound["by_polar_angle"].items()}
        errors_over(measured, bound, ax)
        ax.set_xlabel("tilt, deg")
        ax.set_ylabel("rotation error, deg")
        return ax

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results = self._results
        shown: list[str | Table] = [tables.heading(results)]
        if results["estimators"]:
            shown += [tables.rotation_table(results), tables.translation_table(results)]
            shown += [tables.polar_angle_table(results, key) for key in ("rotation_deg", "translation_pct")]
            if results["homography"]:
                shown.append(tables.homography_table(results))
        if "coverage" in results:
            shown.append(tables.coverage_table(results))
        if results["comparisons"] or "coverage" not in results:
            shown.append(tables.comparison_table(results))
        shown.append(tables.budget_table(results))
        views = results["views"]
        if views:
            shown.append(tables.group_table(views))
            if views["detected"]:
                shown.append(tables.estimator_table(views))
            if "stress" in views:
                shown.append(tables.stress_table(views))
        shown += [*tables.trial_sentences(results), *tables.view_sentences(results)]
        # The verdict last, where a terminal still shows it.
        plan, *more = headline.sentences(results["headline"])
        return [*shown, *more, plan]

    def __repr__(self) -> str:
        results, views = self._results, self._results["views"]
        plan = results["headline"]
        said = [f"{len(self.marker)} dots", f"{results['poses']['count']} poses x {results['runs']} runs"]
        if views:
            said.append(f"{views['detected']} of {views['count']} views found")
        said.append(f"plan with {number(plan['rotation_deg'])} deg {number(plan['translation_mm'])} mm")
        if views and plan["views"]["disagreements"]:
            said.append("the views disagree")
        measured = {"bound": self.bound, **{name: _rms(row) for name, row in self.estimators.items()}}
        said += [
            f"{name} {number(row['rotation_deg'])} deg {number(row['translation_pct'])} %"
            for name, row in measured.items()
        ]
        return f"<Validation: {', '.join(said)}>"

    def _report(self, shown: Sequence[Picture]) -> bytes:
        budget = budget_of(self.series, self._results["noise_px"])
        return html_report(self._results, self.marker, self.setting, shown, budget)

    def _bound_at(self, angle: str) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self.bound if angle == "all" else self.bound["by_polar_angle"][angle]
        return found


def _rotation(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {angle: row["rotation_deg"] for angle, row in rows.items()}


def _rms(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: row[key]["rms"] for key in ("rotation_deg", "translation_pct")}


def _columns(row: Mapping[str, Any], bound: Mapping[str, Any]) -> dict[str, Any]:
    columns: dict[str, Any] = {}
    for key in ("rotation_deg", "translation_pct"):
        columns |= {f"{key}_{name}": row[key][name] for name in ("count", *STATISTICS)}
        columns[f"{key}_bound"] = bound.get(key)
    return columns | {key: row.get(key) for key in ("efficiency", "flip_rate", "failure_rate")}


def _beside(row: Criteria, noise_px: float) -> dict[str, Any]:
    # Criteria are for 1 px; bounds are proportional to the noise.
    return {"criteria": dict(row), "bound": {key: noise_px * row[key] for key in ("rotation_deg", "translation_pct")}}
