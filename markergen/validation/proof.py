"""The whole proof of a marker: trials, bounds, criteria, the layouts beside it, and synthetic views."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker, check_supported, dressed
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import Criteria, criteria, without_height
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.design import compare
from markergen.optimize.label_safety import label_safety
from markergen.optimize.region import Region
from markergen.options.base import Progress
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping
from markergen.validation.bounds import error_budget
from markergen.validation.result import ValidationResult
from markergen.validation.run import validate
from markergen.validation.stress import stress
from markergen.validation.view_records import summarize, take_records
from markergen.validation.views import Shoot

Array = NDArray[np.float64]


def setting_of(marker: Marker, poses: str | PoseDistribution | None = None, camera: Camera | None = None) -> Setting:
    """Camera and poses that a marker was designed for, or others: poses as `poses_from` takes them.

    A marker whose file does not say what it was designed for is judged in the paper's setting.

    Raises
    ------
    InputError
        If the poses are unknown, or none sees the marker whole.
    """
    stored = marker.provenance.get("spec")
    spec = Spec() if stored is None else spec_from_mapping(stored, "provenance.spec", stored=True)
    distribution = poses_from(spec.poses if poses is None else poses)
    camera = camera or spec.camera
    return Setting(marker.boundary, camera, distribution.seen_whole(marker.boundary, camera, marker.height))


def prove(
    marker: Marker,
    setting: Setting,
    noise_px: float = 0.2,
    runs: int = 1000,
    shoot: Shoot | None = None,
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
    shoot : Shoot or None
        Synthetic images to render and detect; its optics and error sources are those of the error budget. None is no
        images, the default optics, and a print good to 0.1 mm.
    trials_for_all : bool
        Run the trials for the layouts beside the marker as well; otherwise they have criteria and bounds.
    stressed : bool
        Repeat the shoot under worse conditions.
    progress : callable or None
        Called with the stage, what is done of it, and its total.

    Returns
    -------
    dict
        In the form that docs/validate.md describes.

    Raises
    ------
    InputError
        If the control points determine no homography, those of a relief no pose, or a number is out of range; also as
        `check_supported` does.
    """
    check_supported(marker, "to validate")

    def told(stage: str) -> Callable[[int, int], None] | None:
        return (lambda done, total: progress(stage, done, total)) if progress else None

    def trials(judged: Marker, stage: str) -> ValidationResult:
        layout = without_height(judged.xyz)[None]
        # A relief has no homography.
        condition = OBJECTIVES["condition"](setting).per_pose(layout)[0] if layout.shape[-1] == 2 else None
        return validate(
            judged, setting.camera, setting.poses, noise_px, runs, seed,
            workers=workers, progress=told(stage), condition=condition,
        )  # fmt: skip

    points = without_height(marker.xyz)
    region = Region(marker.boundary, marker.dot_diameter, marker.clearance)
    judge, what = ("condition", "homography") if points.shape[-1] == 2 else ("pose", "pose")
    if not np.isfinite(OBJECTIVES[judge](setting)(points[None])[0]):
        raise InputError(
            f"control points that determine a {what}",
            "too many of them on one line or in one place",
            "design the marker again, with four points in general position",
        )
    own = trials(marker, "trials")
    table = compare(points, region, setting, seed)
    beside: dict[str, Any] = {name: _beside(row, noise_px) for name, row in table.items() if name != "design"}
    if trials_for_all:
        objective = OBJECTIVES["pose"](setting)
        for name, layouts in comparison_layouts(region, len(points), seed).items():
            # Of several layouts the median one runs; their number is odd.
            middle = layouts[np.argsort(objective(layouts))[len(layouts) // 2]]
            found = trials(dressed(middle, marker.boundary, marker.dot_diameter, marker.clearance), name).as_dict()
            beside[name] = {key: found[key] for key in ("bound", "estimators", "homography")}
            beside[name]["criteria"] = criteria(middle[None], setting)[0]
    shoot = shoot or Shoot(marker, setting.camera, setting.poses, 0, errors=ErrorSources())
    views = summarize(shoot, take_records(shoot, workers, told("views"))) if shoot.count else None
    if views is not None and stressed:
        views["stress"] = stress(shoot, workers, told("stress"))
    budget = error_budget(shoot, noise_px)
    labels = label_safety(marker, setting).as_dict(noise_px) if marker.dot_diameter else None
    return own.as_dict(criteria=table["design"], comparisons=beside, views=views, budget=budget, labels=labels)


def _beside(row: Criteria, noise_px: float) -> dict[str, Any]:
    # Criteria are for 1 px, and bounds are proportional to the noise.
    return {"criteria": dict(row), "bound": {key: noise_px * row[key] for key in ("rotation_deg", "translation_pct")}}
