"""What a layout is worth, fast enough to follow a dot that is dragged; and what takes longer to say."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.bounds.dot_covariances import dot_covariances, image_jacobian, image_slopes, marker_budget
from markergen.comparison.baselines import line_up
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources, PoseBudget, pose_budget
from markergen.model.boundary import Boundary
from markergen.model.goal import parse_goal
from markergen.model.marker import Marker
from markergen.model.occlusion import eyes_of
from markergen.model.planned_error import LINEAR_DEG, degrees, millimeters, planned_error_of
from markergen.model.poses import PoseDistribution, left_out
from markergen.model.spec import AUTO, Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.comparisons import comparison_layouts, criteria_table, reference
from markergen.optimize.design import Design
from markergen.optimize.dot_count import at_a_glance, usual_sources
from markergen.optimize.dot_size import choose_dots, size_given
from markergen.optimize.problem import Fault, FeasibleRegion, faults, objective_of
from markergen.optimize.to_marker import dress
from markergen.read.poses import poses_from
from markergen.render import DEFAULT_OPTICS
from markergen.studio.state import KEPT, Options, design_of, plain_options, points_as_text, spec_of_options
from markergen.validation.error_to_plan_with import cells_of, plan_of
from markergen.validation.expectation import expect
from markergen.validation.metrics import rms
from markergen.validation.sentences import limit_sentences, marker_plan
from markergen.validation.views import SyntheticViews

USUAL_COUNT = 8
"""Number of dots that a page begins with where a search is to choose it."""

STARTS = {"ngon": "a regular polygon", "random": "a random layout"}
"""What a page begins with, the best first, by their names in `comparison_layouts`."""

COUNTS = (5, 6, 8, 10, 12, 16, 20, 24, 30, 40, 60, 80, 100)
"""Numbers of dots that are told beside a layout."""

RIVALS = ("aruco:DICT_4X4_50", "apriltag:36h11", "circles:5x5", "charuco:5x5")
"""Contestants of `compare` told beside a layout, by the photometric bound of their patterns."""

BOUND_POSES = 10
"""Number of poses, spread over the distribution, of photometric bounds."""

ROOMS = 64
"""Number of rooms, with their dots, of which the best value is remembered."""

DIGITS = 6
"""Significant digits of the numbers that a page gets."""

_RIVALS: dict[str, list[dict[str, Any]]] = {}
"""Bounds of the rivals by room."""

_SEEN: dict[tuple[Spec, float], dict[tuple[float, ...], Array]] = {}
"""Covariances (P, 2, 2) of the images of the latest layout's dots, by room and place."""

_KNOWN: dict[tuple[Spec, float], tuple[float, float]] = {}
"""Values of the regular polygon and of the best layout looked at, by room."""


@dataclass(frozen=True, eq=False)
class Sketch:
    """A layout, right or wrong, as a marker in its setting.

    Attributes
    ----------
    spec : Spec
    marker : Marker
        Without the provenance that a design gives it.
    setting : Setting
    region : FeasibleRegion
    faults : list of Fault
    start : str
        What it begins with, in words, where the options have no points.
    """

    spec: Spec
    marker: Marker
    setting: Setting
    region: FeasibleRegion
    faults: list[Fault]
    start: str = ""

    @property
    def points(self) -> Array:
        """Control points (n, 2 or 3) in m."""
        return np.array(self.spec.points)

    @property
    def sources(self) -> ErrorSources:
        """Print and calibration of the spec; the usual print where it has none."""
        return usual_sources(self.spec)

    @property
    def series(self) -> SyntheticViews[Marker]:
        """The marker in its setting with these errors, as `validate` takes it."""
        return SyntheticViews(self.marker, self.setting.camera, self.setting.poses, 0, errors=self.sources)

    @property
    def budget(self) -> PoseBudget:
        """Error budget of every pose, to first order."""
        poses, image = self.setting.poses, _image_covariance(self)
        return pose_budget(self.points, poses.rotation, poses.translation, self.setting.camera, image, self.sources)


def _image_covariance(layout: Sketch) -> Array:
    """Least covariances (P, n, 2, 2) in px^2 of the dots' centers; those of dots that have not moved are kept."""
    diameter, image = layout.marker.dot_diameter, layout.spec.image_noise
    room = replace(layout.spec, points=()), diameter
    covariances = _SEEN.get(room, {})
    moved = [point for point in dict.fromkeys(layout.spec.points) if point not in covariances]
    if moved:
        camera, poses = layout.setting.camera, layout.setting.poses
        slopes = image_slopes(image_jacobian(np.array(moved), camera, poses), poses)
        fresh = dot_covariances(slopes, diameter, image)
        covariances = covariances | {point: fresh[:, k] for k, point in enumerate(moved)}
    _SEEN.clear()
    _SEEN[room] = {point: covariances[point] for point in layout.spec.points}
    return np.stack([covariances[point] for point in layout.spec.points], axis=1)


def sketch(options: Options) -> Sketch:
    """Dress a layout without judging it; one without points begins with a regular polygon, or what fits.

    Raises
    ------
    InputError
        If the options make no spec, or no pose sees the room.
    """
    spec, start = _begun(spec_of_options(options))
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    dots = size_given(spec, poses)
    setting, region = dots.setting(spec, poses), dots.region(spec)
    points = np.array(spec.points)
    return Sketch(spec, dress(points, dots, spec, setting, {}), setting, region, faults(points, region), start)


@lru_cache(maxsize=KEPT)
def _begun(spec: Spec) -> tuple[Spec, str]:
    """Return a spec with points, and what they are in words.

    They are its own, or those of a regular polygon, or of a random layout if that does not fit.
    """
    if spec.points:
        return spec, ""
    spec = replace(spec, n=USUAL_COUNT, dot=None, target="") if spec.n == AUTO else spec
    spec = replace(spec, dot=None) if spec.dot == "auto" else spec
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    dots = choose_dots(spec, poses)
    region = dots.region(spec)
    layouts = comparison_layouts(region, spec.n, spec.seed)
    name = next((name for name in STARTS if len(layouts.get(name, ()))), None)
    if name is None:
        raise InputError(f"{spec.n} dots that fit", "no room found at once", "optimize, or use fewer or smaller dots")
    # Whole hundredths of a mm, as long as all dots still fit.
    exact = layouts[name][0]
    rounded = np.round(exact, 5)
    points = exact if faults(rounded, region) else rounded
    rows = np.column_stack([points, np.zeros(spec.n)]) if spec.relief else points
    return replace(spec, points=tuple(map(tuple, rows.tolist()))), STARTS[name]


def look(options: Any) -> dict[str, Any]:
    """Say all that changes while a dot is moved: layout, room, faults, and errors of every pose to first order.

    Lengths are in m, angles in degrees, translation errors in mm; values that are not finite are None.
    """
    state = plain_options(options)
    layout = sketch(state)
    spec, poses, budget = layout.spec, layout.setting.poses, layout.budget
    rotation, translation = budget.rotation_deg, budget.translation
    centers = eyes_of(poses)
    variance = np.maximum(rotation["total"] ** 2, np.finfo(float).tiny)
    shares = {"image": "image", "print": "print", "calibration": "camera"}
    return {"options": _with_points(state, spec), "dots": _dots(layout.marker)} | clean(
        {
            "start": layout.start,
            "print_sigma": layout.sources.print_sigma,
            "noise_model": spec.noise_model,
            "room": _room(spec),
            "clearance": layout.region.clearance,
            "problems": [{"dots": list(fault.dots), "line": fault.words} for fault in layout.faults],
            "camera": spec.camera.as_dict(),
            "poses": {
                **dict(zip("xyz", centers.T, strict=True)),
                "tilt": poses.polar_angle_deg,
                "azimuth": np.rad2deg(np.arctan2(centers[:, 1], centers[:, 0])),
                "distance": poses.distance,
                "rotation": rotation["total"],
                "translation": 1e3 * translation["total"],
                **{name: rotation[source] ** 2 / variance for name, source in shares.items()},
            },
            "expected": _expected(layout, budget),
            "limits": _limits(layout, budget),
            "objective": _objective(layout),
        }
    )


def _with_points(state: Options, spec: Spec) -> dict[str, Any]:
    """Return a state with its points, which say how many dots there are."""
    rest = {name: value for name, value in state.items() if name not in ("n", "target")}
    rest = {name: value for name, value in rest.items() if (name, value) != ("dot", "auto")}
    return {**rest, "points": state.get("points") or points_as_text(spec.points)}


def _room(spec: Spec) -> dict[str, Any]:
    tag = spec.placed_tag
    return {
        "outlines": _outlines(spec.boundary),
        "keep_outs": [{"outlines": _outlines(region), "words": _placed(region)} for region in spec.keep_outs],
        "holes": [_outlines(region) for region in spec.substrate.rims],
        "tag": {"name": str(tag), "side": tag.side, "center": tag.center} if tag else None,
        "radius": spec.boundary.radius,
    }


def _outlines(shape: Boundary) -> list[Any]:
    return [np.round(outline, 6) for outline in shape.outlines()]


def _placed(region: Boundary) -> str:
    x, y = (f"{round(1e3 * value, 2) + 0.0:.2f}" for value in region.center)
    return f"{region} at {x}, {y} mm"


def _dots(marker: Marker) -> list[dict[str, Any]]:
    return [
        {
            "id": point.id,
            **dict(zip("xyz", xyz, strict=True)),
            "diameter": point.feature.diameter,
            "inner": point.feature.inner_diameter,
            "kind": "ring" if point.feature.inner_diameter else "dot",
        }
        for point, xyz in zip(marker.control_points, marker.xyz.tolist(), strict=True)
    ]


def _expected(layout: Sketch, budget: PoseBudget) -> dict[str, Any]:
    """RMS errors over all poses, also in words, and where they are largest, to first order."""
    poses, rotation = layout.setting.poses, budget.rotation_deg["total"]
    translation = 1e3 * budget.translation["total"]
    cells = cells_of(poses)
    (distance, tilt), mask = max(cells.items(), key=lambda cell: rms(rotation[cell[1]]))
    hardest: dict[str, Any] = {"distance": distance, "tilt": tilt}
    hardest |= {"rotation": degrees(rms(rotation[mask])), "translation_mm": rms(translation[mask])}
    rotation_deg, translation_mm = rms(rotation), rms(translation)
    amounts = {
        "rotation": degrees(rotation_deg),
        "translation": millimeters(translation_mm, float(poses.distance.max())),
    }
    seen = {"poses": len(poses), "dropped": poses.dropped, "missed": left_out(len(poses), poses.dropped)}
    return {"rotation_deg": rotation_deg, "translation_mm": translation_mm, **amounts, **seen, "hardest": hardest}


def _limits(layout: Sketch, budget: PoseBudget) -> list[str]:
    parts = {
        "rotation_deg": {name: rms(part) for name, part in budget.rotation_deg.items()},
        "translation_pct": {
            name: rms(part) for name, part in budget.translation_pct(layout.setting.poses.translation).items()
        },
        "camera_exact": layout.sources.camera_covariance is None,
    }
    return limit_sentences({"budget": parts})


def _objective(layout: Sketch) -> dict[str, Any]:
    """Value of the objective, of the regular polygon beside it, and the best of both and all looked at in this room."""
    spec, region = layout.spec, layout.region
    goal = parse_goal(spec.objective)
    unit, factor = "", 1.0
    if len(goal.terms) == 1 and (criterion := OBJECTIVES[goal.lead].criterion):
        unit, factor = criterion.title.rpartition(" ")[2], criterion.factor
    room = replace(spec, points=())
    objective = objective_of(spec, layout.setting, reference(room, region, layout.setting))
    value = float(objective(layout.points[None])[0])
    key = room, region.diameter
    if key not in _KNOWN:
        layouts = comparison_layouts(region, room.n, room.seed, layout.setting).get("ngon", np.zeros((0, room.n, 2)))
        # At height 0, if the spec has a relief.
        layouts = np.pad(layouts, ((0, 0), (0, 0), (0, 1))) if spec.relief else layouts
        polygon = float(objective(layouts)[0]) if len(layouts) else np.inf
        _KNOWN[key] = polygon, polygon
        for old in list(_KNOWN)[:-ROOMS]:
            del _KNOWN[old]
    ngon, best = _KNOWN[key]
    _KNOWN[key] = ngon, min(best, np.inf if layout.faults else value)
    every = {"value": value, "ngon": ngon, "best_known": _KNOWN[key][1]}
    return {"name": spec.objective, "unit": unit, **{name: factor * number for name, number in every.items()}}


def more(options: Any) -> dict[str, Any]:
    """Say of a layout without faults what takes seconds: labels, bounds, more dots, other patterns, what to plan with.

    Raises
    ------
    InputError
        As `markergen.design`, which refuses a layout with faults.
    """
    state = plain_options(options)
    state = _with_points(state, sketch(state).spec)
    design, layout = design_of(state), sketch(state)
    series = layout.series
    sentence, *checks = marker_plan(plan_of(expect(series, seed=layout.spec.seed), series))
    planned = planned_error_of(design.marker.provenance)
    return clean(
        {
            "plan": [f"{planned.prospect}.".capitalize() if planned else sentence, *checks],
            "labels": {"sentence": design.labels.sentence, "least_px": design.labels.least} if design.labels else None,
            "bound": design.certificate.sentence,
            "table": criteria_table(design.criteria, len(design.marker), design.setting.noise_words)._asdict(),
            "more_dots": _more_dots(layout),
            "beside": _beside(layout, design),
            "advice": design.outlook.splitlines(),
            "warnings": design.warnings,
        }
    )


def _more_dots(layout: Sketch) -> list[dict[str, Any]]:
    """Errors of other numbers of dots, of the best size for each, in the order of their number."""
    if layout.spec.relief:
        return []
    try:
        glances = at_a_glance(layout.spec, layout.setting.poses, layout.sources).by_count(most=1)
    except InputError:
        return []
    rows = []
    for n in sorted({*COUNTS} & glances.keys()):
        glance = glances[n]
        budget = marker_budget(glance.points, glance.diameter, layout.setting, layout.spec.image_noise, layout.sources)
        rotation_deg, translation_mm = rms(budget.rotation_deg["total"]), 1e3 * rms(budget.translation["total"])
        errors = {"rotation_deg": rotation_deg, "translation_mm": translation_mm} if rotation_deg <= LINEAR_DEG else {}
        rows.append({"n": n, "diameter": glance.diameter, **errors})
    return rows


def _beside(layout: Sketch, design: Design) -> list[dict[str, Any]]:
    """Photometric bounds of this marker and of common patterns of its size, exactly printed, RMS over some poses."""
    if layout.spec.relief:
        return []
    spec, poses = layout.spec, layout.setting.poses
    key = replace(spec, points=(), n=USUAL_COUNT).hash
    if key not in _RIVALS:
        _RIVALS[key] = _bounds(RIVALS, design.marker, poses)
        for old in list(_RIVALS)[:-ROOMS]:
            del _RIVALS[old]
    return _bounds((), design.marker, poses) + _RIVALS[key]


def _bounds(rivals: tuple[str, ...], marker: Marker, poses: PoseDistribution) -> list[dict[str, Any]]:
    """Bounds of a marker, or of rivals of its size."""
    name_here = "this marker"
    contestants, setting = line_up([name_here, *(rivals or RIVALS[:1])], poses, given={name_here: marker})
    chosen = contestants[1:] if rivals else contestants[:1]
    every = np.linspace(0, len(setting.poses) - 1, BOUND_POSES).round().astype(int)
    rows = []
    for contestant in chosen:
        bounds = [
            contestant.bound(setting.camera, setting.poses.taken(every[[k]], 0), DEFAULT_OPTICS)
            for k in range(len(every))
        ]
        rotation_deg, translation_pct = (rms(np.array(part)) for part in zip(*bounds, strict=True))
        rows.append({"name": contestant.name, "rotation_deg": rotation_deg, "translation_pct": translation_pct})
    return rows


def clean(value: Any) -> Any:
    """Return plain JSON values: six digits, and None for what is not finite."""
    if isinstance(value, dict):
        return {key: clean(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [clean(part) for part in value]
    if isinstance(value, np.ndarray | np.generic | float):
        return _rounded(np.asarray(value)) if np.asarray(value).dtype.kind == "f" else np.asarray(value).tolist()
    return value


def _rounded(values: Array) -> Any:
    finite = np.isfinite(values)
    size = np.abs(np.where(finite & (values != 0), values, 1.0))
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(size)))
    rounded = np.asarray(np.round(np.where(finite, values, 0.0) * scale) / scale, dtype=object)
    rounded[~finite] = None
    return rounded.tolist()
