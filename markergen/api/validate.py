"""``markergen.validate``: pose errors against their bounds, and detection in synthetic views."""

import logging
import time
from typing import Any, Unpack

from markergen.api.arguments import as_camera, files_among
from markergen.defaults import VIEWS
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.body_json import load_marker_or_rig
from markergen.model.rescale import poor_fit_sentence
from markergen.model.rig import planned_print
from markergen.options import Progress, check_progress, settle, takes
from markergen.options.declarations import ValidateKeywords
from markergen.options.kinds import CameraLike, File, Files, TargetLike
from markergen.pool import OneBlasThread
from markergen.read.cameras import sized
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.poses import poses_as_stated
from markergen.render import optics_from_text
from markergen.validation.result import Validation, check_pictures
from markergen.validation.setting import setting_of
from markergen.validation.validation import run_validation as run
from markergen.validation.views import SyntheticViews

_log = logging.getLogger(__name__)


@takes(ValidateKeywords)
@OneBlasThread()
def validate(
    marker: TargetLike,
    camera: CameraLike | None = None,
    *,
    save: Files = (),
    json: File | None = None,
    report: File | None = None,
    pictures: File | None = None,
    progress: Progress | None = None,
    **options: Unpack[ValidateKeywords],
) -> Validation:
    """Prove a marker: pose errors of every estimator with their bounds, synthetic views, and what limits the accuracy.

    Noisy trials at every pose that sees the whole marker are compared with the Cramer-Rao bound; then synthetic images
    are rendered and the marker is detected in them as in photos. docs/validate.md describes the measurements.

    Of a rig, each pose counts with the plates that it shows, and all of them together are compared with the best alone.

    Parameters
    ----------
    marker : Marker, Rig, path or dict
    camera : Camera, path, dict or None
        None: the camera that the marker or rig was designed for.
    save : path or list of paths
        Files to write at the end, by suffix: .html for the report, .json for the results, .svg or .png for the plot.
        All targets are checked before the work begins.
    json, report : path or None
        File for the results, under any suffix, and file for the report.
    pictures : path or None
        Folder for pictures of failed, worst and typical views.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    **options
        As on the command line, ``markergen validate --help``, with underscores. Lengths are in m, or text with a unit.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        If an argument is unknown, of the wrong type or out of range, an option is not for rigs, or no pose sees the
        whole marker, or four dots of a plate of the rig.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> from markergen.objectives.criteria import regular_polygon
    >>> marker = build_marker(regular_polygon(5, 0.125), Circle(0.15), diameter=0.036, clearance=0.0036)
    >>> found = validate(marker, poses="cone:count=20", runs=20, views=0, workers=1)
    >>> found  # doctest: +ELLIPSIS
    <Validation: 5 dots, 20 poses x 20 runs, plan with ... deg ... mm, bound ... deg ... %, ...>
    >>> found.bound["rotation_deg"] < 0.5
    True
    >>> found.check("estimators.lm.failure_rate > 0")
    (True, 'estimators.lm.failure_rate = 0 <= 0')
    """
    check_progress(progress)
    settled = settle(options, ValidateKeywords)
    targets = Validation.targets(save, pictures, json=json, report=report)
    optics = optics_from_text(settled["optics"] or "")
    judged = load_marker_or_rig(marker)
    if judged.frame == "rig" and settled["trials_for_all"]:
        raise InputError("a marker for --trials-for-all", "a rig, whose plates have no common layouts", "leave it out")
    views = (VIEWS if judged.radii.all() else 0) if settled["views"] is None else settled["views"]
    if not views and settled["stress"]:
        raise InputError("views to take", "--views 0", "leave out --stress, or ask for views")
    poses: Any = poses_as_stated(settled["poses"], settled)
    camera = sized(camera, settled["image_size"])
    setting = setting_of(judged, poses, as_camera(camera))
    covariance = camera_covariance(settled["camera_covariance"], camera, setting.camera)
    printed = planned_print(judged) if settled["print_sigma"] is None else settled["print_sigma"]
    series: SyntheticViews[Any] = SyntheticViews(
        judged, setting.camera, setting.poses, views, settled["seed"], optics, settled["background"],
        ErrorSources(printed, covariance, scale_sigma=settled["scale_sigma"]),
        settled["hide"],
    )  # fmt: skip
    check_pictures(targets, views)
    targets.check(
        files_among(marker, camera, *(settled[key] for key in ("camera_covariance", "poses", "camera_in_body")))
    )
    if doubt := poor_fit_sentence(judged):
        _log.warning("%s", doubt)
    began = time.perf_counter()
    _log.info("validating: %d poses x %d runs, %d views", len(setting.poses), settled["runs"], views)
    results: dict[str, Any] = run(
        series, settled["noise"], settled["runs"], settled["workers"], settled["trials_for_all"], settled["stress"],
        progress,
    )  # fmt: skip
    _log.info("validated in %.1f s", time.perf_counter() - began)
    written = Validation(results, series).write(targets, progress)
    return Validation(results, series, written)
