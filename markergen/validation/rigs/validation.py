"""Validate a rig by bounds, noisy trials and synthetic views: all plates in view against the best of them alone."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.defaults import NOISE_PX, RUNS
from markergen.errors import InputError
from markergen.estimators.budget import PoseBudget
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.marker import check_supported
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.options import Progress
from markergen.presentation.plots import axes_of
from markergen.presentation.results import plain
from markergen.presentation.tables import Table, number, percent
from markergen.read.poses import poses_from
from markergen.read.spec_file import stated_poses
from markergen.validation import tables
from markergen.validation.headline import amount, source_of
from markergen.validation.metrics import rms, share_interval, statistics
from markergen.validation.report.plots import errors_over
from markergen.validation.result import ValidationResult
from markergen.validation.rigs.bounds import Visibility, budget_of, dot_noise, visibility
from markergen.validation.rigs.report import rig_report
from markergen.validation.rigs.trials import run_trials
from markergen.validation.rigs.views import RigRecord, RigViews, take_records
from markergen.validation.views import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ALL_AROUND = "sphere:distance=0.3..0.9"
"""Poses of a rig whose file states none."""

ESTIMATORS = {"joint": "lm", "alone": "lm_alone"}
TITLES = {"lm": "all plates in view", "lm_alone": "the best plate alone"}


def rig_setting(
    rig: Rig, poses: str | PoseDistribution | None = None, camera: Camera | None = None
) -> tuple[Camera, PoseDistribution]:
    """Return the camera and the poses T_camera_rig that a rig was made for, or others.

    A rig whose file does not state them is judged by the paper's camera, and from all around.

    Raises
    ------
    InputError
        If the poses or the camera are unknown.
    """
    if poses is None:
        try:
            poses = stated_poses(rig.provenance.get("poses", ALL_AROUND))
        except ValueError as error:
            raise InputError("poses that a rig can have been made for", str(error), "correct its provenance") from None
    stated = rig.provenance.get("camera")
    return camera or (Camera.load(stated) if stated else PAPER_CAMERA), poses_from(poses)


def validate_rig(
    series: RigViews,
    noise_px: float = NOISE_PX,
    runs: int = RUNS,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Validate a rig and return the results as plain JSON values, in the form described in docs/rigs.md.

    Parameters are those of `validation.validate`; the poses and error sources are those of the series.

    Raises
    ------
    InputError
        If no pose shows four dots of a plate, or `check_supported` refuses a marker.
    """
    for each in series.rig.markers:
        check_supported(each.marker, "to validate")
    shown = visibility(series)
    if not shown.served.any():
        raise InputError(
            "a pose that shows four dots of a plate, whole and large enough to be found",
            f"none of {len(series.poses)} ({series.poses.name})",
            "use nearer poses, larger dots, or a camera with a narrower view",
        )

    def told(stage: str) -> Any:
        return partial(progress, stage) if progress else None

    trials = run_trials(shown, noise_px, runs, seed, workers, told("trials"))
    joint, alone = budget_of(shown), budget_of(shown, alone=True)
    records = take_records(series, workers, told("views")) if series.count else []
    rig, poses = series.rig, series.poses
    groups = {"by_plates": shown.groups(), "by_distance": _served(poses.by_distance(), shown.served)}
    bounds = trials["joint"].summary(shown.served)["bound"]
    result = {
        "rig": {
            "markers": [each.name for each in rig.markers],
            "control_points": len(rig),
            "radius": rig.radius,
            "relation_exact": rig.relation is None,
        },
        "headline": _headline(shown, joint, alone, series),
        "camera": series.camera.as_dict(),
        "poses": {"name": poses.name, "count": len(poses), "dropped": 0, "served": int(shown.served.sum())},
        "noise_px": noise_px,
        "runs": runs,
        "seed": seed,
        "bound": bounds
        | {
            key: {name: trials["joint"].summary(mask)["bound"] for name, mask in masks.items()}
            for key, masks in groups.items()
        },
        "estimators": {
            ESTIMATORS[name]: errors.summary(shown.served)
            | {key: {each: errors.summary(mask) for each, mask in masks.items()} for key, masks in groups.items()}
            for name, errors in trials.items()
        }
        if runs
        else {},
        "budget": _budget(shown, joint, alone),
        "views": _views(shown, records, joint) if records else None,
    }
    values: dict[str, Any] = plain(result)
    return values


def _served(groups: Mapping[str, Mask], served: Mask) -> dict[str, Mask]:
    return {name: mask & served for name, mask in groups.items() if (mask & served).any()}


def _errors_of(budget: PoseBudget, chosen: Mask) -> dict[str, float]:
    return {
        "rotation_deg": rms(budget.rotation_deg["total"][chosen]),
        "translation_mm": rms(1e3 * budget.translation["total"][chosen]),
    }


def _headline(shown: Visibility, joint: PoseBudget, alone: PoseBudget, series: RigViews) -> dict[str, Any]:
    groups = shown.groups()
    hardest = [_errors_of(joint, mask) for mask in groups.values()]
    by_plates = {
        name: {"poses": int(mask.sum()), **row, "alone": _errors_of(alone, mask)}
        for (name, mask), row in zip(groups.items(), hardest, strict=True)
    }
    errors = series.errors
    measured = any(each.marker.places_measured for each in series.rig.markers)
    return {
        **{key: max(each[key] for each in hardest) for key in ("rotation_deg", "translation_mm")},
        "by_plates": by_plates,
        "all": {"poses": int(shown.served.sum()), **_errors_of(joint, shown.served)},
        "alone": _errors_of(alone, shown.served),
        "source": source_of(1e3 * errors.print_sigma, errors.camera_covariance is not None, measured),
    }


def _budget(shown: Visibility, joint: PoseBudget, alone: PoseBudget) -> dict[str, Any]:
    served, errors = shown.served, shown.series.errors
    noise = np.trace(dot_noise(shown.series), axis1=-2, axis2=-1)[shown.seen & served[:, None]]
    translation = shown.series.poses.translation

    def parts(budget: PoseBudget) -> dict[str, Any]:
        with np.errstate(invalid="ignore"):
            pct = budget.translation_pct(translation)
        return {
            "rotation_deg": {name: rms(part[served]) for name, part in budget.rotation_deg.items()},
            "translation_pct": {name: rms(part[served]) for name, part in pct.items()},
        }

    return {
        "print_sigma_mm": 1e3 * errors.print_sigma,
        "print_measured": any(each.marker.places_measured for each in shown.series.rig.markers),
        "camera_exact": errors.camera_covariance is None,
        "image_px": float(np.sqrt(noise.mean())),
        **parts(joint),
        "alone": parts(alone),
    }


def _views(shown: Visibility, records: list[RigRecord], joint: PoseBudget) -> dict[str, Any]:
    """Summarize the views, also by the number of plates that their poses show."""
    series = shown.series
    at = np.array([each.pose for each in records])
    groups = {"none": ~shown.served} | shown.groups()
    by_plates = {
        name: _group([each for each, inside in zip(records, mask[at], strict=True) if inside], joint)
        for name, mask in groups.items()
        if mask[at].any()
    }
    return {
        **_group(records, joint),
        "served": int(shown.served[at].sum()),
        "optics": {**vars(series.optics)},
        "background": series.background,
        "print_sigma_mm": 1e3 * series.errors.print_sigma,
        "by_plates": by_plates,
        "samples": [
            {
                **_where(each, shown),
                "rotation_deg": each.rotation_deg,
                "translation_mm": each.translation_mm,
                "nees": each.nees,
                "alone": {series.rig.markers[k].name: deg for k, deg in zip(each.plates, each.plate_deg, strict=True)},
                "dots": each.dots.tolist(),
            }
            for each in records
            if each.detected
        ],
        "failures": [{**_where(each, shown), "reason": each.failure} for each in records if not each.detected],
    }


def _where(each: RigRecord, shown: Visibility) -> dict[str, Any]:
    return {
        "view": each.index,
        "pose": each.pose,
        "distance": float(shown.series.poses.distance[each.pose]),
        "plates": int(shown.plates[each.pose]),
    }


def _group(records: list[RigRecord], joint: PoseBudget) -> dict[str, Any]:
    """Statistics of some views: all plates together, and in the same views the plate alone that claims the least error.

    Flips of plates are of all that were found by themselves.
    """
    found = [each for each in records if each.detected]
    both = [(each, each.best_alone) for each in found if each.best_alone is not None]
    at = np.array([each.pose for each in found], dtype=np.intp)
    points = np.concatenate([np.zeros((0, 2)), *(each.error for each in found)])
    flips = np.concatenate([np.zeros(0, dtype=bool), *(each.plate_flipped for each in found)])
    nees = np.array([each.nees for each in found])
    return {
        "count": len(records),
        "detected": len(found),
        "wrong": sum(each.wrong for each in records),
        "rate": len(found) / len(records),
        "rate_interval": share_interval(len(found), len(records)),
        "point_px": statistics(np.linalg.norm(points, axis=-1)),
        "rotation_deg": statistics(np.array([each.rotation_deg for each in found])),
        "translation_mm": statistics(np.array([each.translation_mm for each in found])),
        "expected_deg": rms(joint.rotation_deg["total"][at]) if len(at) else None,
        "expected_mm": rms(1e3 * joint.translation["total"][at]) if len(at) else None,
        "nees": nees.mean() if len(nees) else None,
        "both": {
            "count": len(both),
            "rotation_deg": statistics(np.array([each.rotation_deg for each, _ in both])),
            "alone_deg": statistics(np.array([each.plate_deg[k] for each, k in both])),
        },
        "plates": {"found": len(flips), "flipped": int(flips.sum())},
    }


class RigValidation(ValidationResult[RigViews]):
    """The result of `markergen.validate` for a rig; see `Validation`.

    Parameters
    ----------
    results : mapping
        Return value of `validate_rig`, in the form described in docs/rigs.md.
    series : RigViews
        Rig, camera, poses, optics and error sources of the results.
    written : sequence of Written
        Files that were written together with the results.

    Examples
    --------
    >>> import numpy as np
    >>> import markergen as mg
    >>> marker = mg.design(n=5, boundary="rect:80mmx80mm", restarts=2).marker
    >>> side = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    >>> faces = mg.Plate("+z", marker, np.eye(3), [0, 0, 0.04]), mg.Plate("+x", marker, side, [0.04, 0, 0])
    >>> found = mg.validate(mg.Rig(faces), poses="cone:tilt=40..50,azimuth=0,distance=0.3,count=10", runs=0, views=0)
    >>> joint, alone = (found.headline["by_plates"]["2"], found.headline["by_plates"]["2"]["alone"])
    >>> joint["rotation_deg"] < alone["rotation_deg"]
    True
    """

    @property
    def rig(self) -> Rig:
        """The rig that was validated."""
        return self.series.rig

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the RMS rotation error of all plates and of the best alone over the distance, with the bound beneath."""
        ax = axes_of(ax)
        measured = {
            TITLES[name]: {at: group["rotation_deg"] for at, group in row["by_distance"].items()}
            for name, row in self.estimators.items()
        }
        bound = {at: row["rotation_deg"] for at, row in self.bound["by_distance"].items()}
        errors_over(measured, bound, ax)
        ax.set_xlabel("distance, m")
        ax.set_ylabel("rotation error, deg")
        return ax

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results, views = self._results, self._results["views"]
        shown: list[str | Table] = [tables.heading(results), expected_table(results)]
        shown += [trial_table(results)] if results["estimators"] else []
        shown.append(tables.budget_table(results))
        shown += [view_table(views)] if views else []
        # The verdict last, where a terminal still shows it.
        plan, *more = sentences(results)
        return [*shown, *tables.limit_sentences(results), *more, plan]

    def __repr__(self) -> str:
        views, plan = self._results["views"], self._results["headline"]
        said = [f"{len(self.rig.markers)} markers", f"{self._results['poses']['count']} poses"]
        if views:
            said.append(f"{views['detected']} of {views['count']} views found")
        said.append(f"plan with {number(plan['rotation_deg'])} deg {number(plan['translation_mm'])} mm")
        return f"<RigValidation: {', '.join(said)}>"

    def _report(self, shown: Sequence[Picture]) -> bytes:
        results = self._results
        found = [
            table(results) for table in (expected_table, trial_table) if table is expected_table or results["runs"]
        ]
        found += [tables.budget_table(results), *([view_table(results["views"])] if results["views"] else [])]
        return rig_report(visibility(self.series), results, sentences(results), found, self.plot, shown)


def sentences(results: Mapping[str, Any]) -> list[str]:
    """Say what to plan with, what several plates gain, and what the views found."""
    plan, poses, views = results["headline"], results["poses"], results["views"]
    hardest = max(plan["by_plates"], key=lambda name: plan["by_plates"][name]["rotation_deg"] or np.inf)
    said = [
        f"Plan with {amount(plan['rotation_deg'])} deg and {amount(plan['translation_mm'])} mm RMS: the hardest case, "
        f"with {_plates(hardest)} in view.",
        f"Over all {plan['all']['poses']} poses: {amount(plan['all']['rotation_deg'])} deg and "
        f"{amount(plan['all']['translation_mm'])} mm, with {plan['source']}; the best plate of each alone: "
        f"{amount(plan['alone']['rotation_deg'])} deg and {amount(plan['alone']['translation_mm'])} mm.",
    ]
    if results["rig"]["relation_exact"]:
        said.append("The relation of the plates is taken as exact: the rig has no relation_covariance.")
    if poses["served"] < poses["count"]:
        said.append(
            f"{poses['count'] - poses['served']} of {poses['count']} poses show no plate well enough to find it."
        )
    if views:
        wrong = f", {views['wrong']} with wrong labels" if views["wrong"] else ", none with a wrong label"
        said.append(f"Found in {views['detected']} of {views['count']} views{wrong}.")
        flipped, seen = views["plates"]["flipped"], views["plates"]["found"]
        if flipped:
            said.append(f"Of {seen} plates that were found there, {flipped} by themselves have a flipped pose.")
    return said


def expected_table(results: Mapping[str, Any]) -> Table:
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


def trial_table(results: Mapping[str, Any]) -> Table:
    """Errors in the trials by the number of plates in view."""
    rows = []
    for name, estimator in results["estimators"].items():
        for plates, row in estimator["by_plates"].items():
            errors = [number(row["rotation_deg"]["rms"]), number(row["bound"]["rotation_deg"])]
            errors += [number(row["translation_pct"]["rms"]), number(row["bound"]["translation_pct"])]
            shares = [number(row["efficiency"]), percent(row["flip_rate"]), percent(row["failure_rate"])]
            rows.append([f"{TITLES[name]}: {plates}", *errors, *shares])
    header = ["", "RE deg", "bound", "TE %", "bound", "effic.", "flips", "failed"]
    return Table("Trials by the number of plates in view, rms", header, rows, "LM from noisy image points, with flips.")


def view_table(views: Mapping[str, Any]) -> Table:
    """Results of the synthetic views, by the number of plates in view."""
    rows = [
        [
            name,
            *(str(row[key]) for key in ("count", "detected", "wrong")),
            number(row["point_px"]["rms"]),
            number(row["rotation_deg"]["rms"]),
            number(row["expected_deg"]),
            number(row["both"]["alone_deg"]["rms"]),
            number(row["translation_mm"]["rms"]),
            number(row["nees"]),
            f"{row['plates']['flipped']}/{row['plates']['found']}",
        ]
        for name, row in {"all": views, **views["by_plates"]}.items()
    ]
    header = ["plates", "views", "found", "wrong", "dots px", "RE deg", "expected", "alone", "mm", "NEES", "flips"]
    caption = (
        "RMS. Expected: to first order. Alone: the plate's own pose that claims the least error. "
        "Flips: of the own poses of all plates."
    )
    return Table(f"Synthetic views ({views['background']} background)", header, rows, caption)


def _plates(name: str) -> str:
    return f"{name} plate{'s' * (name != '1')}"
