"""``markergen.calibrate``: a print, and the camera if asked, measured by photographs."""

# tests: tests/cli/test_calibrate.py

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from markergen.api.arguments import files_among, known_camera, marker_of
from markergen.calibration.calibration import Calibration, Known, calibrate_bodies
from markergen.calibration.network import Length
from markergen.calibration.next_photo import photographs_of
from markergen.calibration.scale import ScaleErrors
from markergen.detect.detector import Detector
from markergen.errors import InputError
from markergen.model.body_json import load_marker_or_rig
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.rig import planned_print
from markergen.model.spec import check_scale
from markergen.options import Progress, as_list, check_progress, settle, takes
from markergen.options.calibration import CalibrateKeywords
from markergen.options.kinds import CameraLike, File, Files, TargetLike
from markergen.pool import OneBlasThread
from markergen.read.images import find_images
from markergen.read.videos import is_video
from markergen.units import format_length, parse_length

_log = logging.getLogger(__name__)

_NAMED = re.compile(r"([A-Za-z0-9][A-Za-z0-9_.-]*)=(.*)")
_LENGTH = re.compile(r"(?:(\d+):)?(\d+)-(\d+)=([^+±]+?)(?:(?:\+-|±)(.+))?")


@takes(CalibrateKeywords)
@OneBlasThread()
def calibrate(
    marker: TargetLike,
    photos: Any,
    camera: CameraLike | Mapping[str, CameraLike | None] | Sequence[str] | None = None,
    *,
    save: Files = (),
    json: File | None = None,
    report: File | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
    **options: Unpack[CalibrateKeywords],
) -> Calibration:
    """Measure a printed marker, and the camera if it is unknown, by photographs of it.

    Every dot's x, y and z are adjusted together with the poses of all photographs, in the frame of the design; see
    docs/calibrate.md.

    Parameters
    ----------
    marker : Marker or Rig, path or dict
        The marker as designed, rescaled, or with dots measured by hand, which then count as prior knowledge; or a rig,
        whose markers' relation is then measured, too.
    photos : path, folder, pattern, image, or several of these
        Photographs of one size. An image is an array (h, w) or (h, w, 3) in BGR, as `cv2.imread` returns it. Or one
        video, number of a camera or stream, of which still views are taken until more hardly help.
    camera : Camera, path, dict or None
        None: it is estimated from the photographs, too. Several cameras that are held together: a mapping of names to
        cameras, or texts NAME=FILE, with None or an empty FILE for one that is estimated. Photographs are then those in
        folders of these names, or a mapping; those of one name are of one moment.
    save : path or list of paths
        Files to write, by suffix: .json for the measured marker, .yaml, .xml or .txt for the camera, one for each of
        several, .html for the report.
    json, report : path or None
        Files for the results as JSON, and for the report.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    tell : callable or None
        Takes a line for each photograph taken from a video.
    **options
        As on the command line, ``markergen calibrate --help``, with underscores.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If an argument is wrong, no photograph shows the marker, or the photographs do not determine what is asked for.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> import numpy as np
    >>> from markergen.maths.rotation import exponential
    >>> from markergen.render import Optics, render_view
    >>> marker = mg.design(n=5, radius="60mm", dot="16mm", restarts=2).marker
    >>> camera = mg.Camera(320, 240, 400, 400, 159.5, 119.5)
    >>> tilts = [[0.5, 0, 0], [-0.5, 0, 0], [0, 0.5, 0], [0, -0.5, 0], [0.4, 0.4, 0.5], [-0.4, 0.4, 1]]
    >>> rotations = exponential(np.array(tilts)) @ np.diag([1.0, -1.0, -1.0])
    >>> rng, place = np.random.default_rng(0), np.array([0.0, 0.0, 0.3])
    >>> photos = [render_view(marker, camera, rotation, place, Optics(), rng) for rotation in rotations]
    >>> found = mg.calibrate(marker, photos, camera)
    >>> found  # doctest: +ELLIPSIS
    <Calibration: 5 dots in 6 views, RMS 0.00... px>
    >>> found.after.rotation_deg < found.before.rotation_deg / 4
    True
    >>> found.markers[0].control_points[1].designed == (marker.control_points[1].x, marker.control_points[1].y)
    True
    """
    check_progress(progress)
    settled = settle(options, CalibrateKeywords)
    if settled["geometry"] not in ("free", "nominal"):
        raise InputError("the geometry free or nominal", repr(settled["geometry"]), "see markergen calibrate --help")
    check_scale(settled["scale_sigma"])
    others = as_list(settled["also"] or ())
    body = load_marker_or_rig(marker)
    has_relation = len(body.plates) > 1
    if has_relation and others:
        raise InputError("a rig alone", "--also beside a rig", "make the markers part of the rig, or leave them out")
    bodies = [body, *map(marker_of, others)]
    designs = [plate.marker for body in bodies for plate in body.plates]
    if isinstance(camera, list | tuple) and len(camera) == 1:
        (camera,) = camera
    named = _named(camera)
    sources = {"": photos} if named is None else _by_folder(photos, [*named])
    cameras = {
        name: known_camera(source, sources[name], settled, named is not None)
        for name, source in ({"": camera} if named is None else named).items()
    }
    known = Known(
        None,
        None,
        settled["geometry"] == "free",
        tuple(_length(text, designs, settled["ruler_sigma"]) for text in settled["measured"] or ()),
        planned_print(*designs) if settled["print_sigma"] is None else settled["print_sigma"],
        ScaleErrors(settled["scale_sigma"], settled["ruler_sigma"]),
        settled["poses"],
    )
    targets = Calibration.targets(save, json=json, report=report)
    knowledge = {name: replace(known, camera=taken, covariance=spread) for name, (_, taken, spread) in cameras.items()}
    moved = sum(prior.camera is None or prior.covariance is not None for prior in knowledge.values())
    if not moved and not known.free and not has_relation and named is None:
        raise InputError("something to estimate", "dots and camera held", "leave out --camera or --geometry nominal")
    Calibration.check_targets(targets, len(bodies), known.free or has_relation, moved)
    targets.check(
        files_among(marker, *others, *(file for file, _, _ in cameras.values()), settled["camera_covariance"])
    )
    if named is not None:
        calibration = calibrate_bodies(bodies, sources, knowledge, settled["workers"], progress)
        return calibration.saved(targets)
    known = knowledge[""]
    if isinstance(source := (as_list(photos) or [""])[0], str | Path) and is_video(source):
        detector = Detector(bodies if has_relation else designs, known.camera)
        judge = partial(calibrate_bodies, bodies, knowledge=known, workers=1)
        photos = photographs_of(str(source), detector, judge, tell or (lambda _: None))
    calibration = calibrate_bodies(bodies, photos, known, settled["workers"], progress)
    _log.info("calibrated by %d views", len(calibration.adjustment.views))
    return calibration.saved(targets)


def _named(camera: Any) -> dict[str, Any] | None:
    """Return several cameras by their names; None for a single one.

    Raises
    ------
    InputError
        If one of several has no name, or two have the same.
    """
    if isinstance(camera, Mapping):
        is_several = all(source is None or isinstance(source, str | PathLike | Camera) for source in camera.values())
        return dict(camera) if is_several and camera else None
    texts = list(map(str, camera)) if isinstance(camera, list | tuple) else [camera]
    pairs = [_NAMED.fullmatch(text) if isinstance(text, str) and not Path(text).exists() else None for text in texts]
    if len(texts) == 1 and pairs[0] is None:
        return None
    named = {pair[1]: pair[2] or None for pair in pairs if pair is not None}
    if len(named) < len(texts):
        remedy = "such as --camera left=left.yaml --camera right=right.yaml"
        raise InputError("a name of its own for each of several cameras", ", ".join(map(str, texts)), remedy)
    return named


def _by_folder(photos: Any, names: list[str]) -> dict[str, Any]:
    """Return the photographs of each camera: those in a folder of its name.

    Raises
    ------
    InputError
        If photographs are in no such folder, or a camera has none.
    """
    remedy = f"put them into folders named {', '.join(names)}, or leave them out"
    if isinstance(photos, Mapping):
        taken = {name: photos.get(name, []) for name in names}
        left = [str(name) for name in photos if name not in names]
    else:
        sources: list[Any] = [photos] if isinstance(photos, np.ndarray) else list(as_list(photos))
        if any(isinstance(source, np.ndarray) for source in sources):
            raise InputError("a mapping of cameras' names to their images", "images", 'give {"left": [...], ...}')
        folders = [[f for name in names if (f := Path(source) / name).is_dir()] or [source] for source in sources]
        taken, left = {name: list[Any]() for name in names}, list[str]()
        for path in find_images([folder for inside in folders for folder in inside]):
            name = next((part for part in path.absolute().parts[-2::-1] if part in names), None)
            (left if name is None else taken[name]).append(str(path))
    if left:
        raise InputError("photographs in a folder of each camera's name", f"{left[0]} of {len(left)}", remedy)
    if missing := [name for name, sources in taken.items() if not len(sources)]:
        raise InputError("photographs of every camera", f"none of {', '.join(missing)}", remedy)
    return taken


def _length(text: str, designs: Sequence[Marker], sigma: float) -> Length:
    """Parse a measured length such as 0-2=244.1mm, 0-2=244.1mm+-0.1mm or 2:0-2=244.1mm.

    Raises
    ------
    InputError
        If it has another form, a dot is unknown, or the length is more than 5 % off the design's.
    """
    match = _LENGTH.fullmatch(text.replace(" ", ""))
    if match is None:
        raise InputError("a length between two dots", repr(text), "write their ids, such as 0-2=244.1mm")
    which, first, second, length, sigma_text = match.groups()
    number = int(which or 1)
    if not 1 <= number <= len(designs):
        raise InputError(f"marker 1 to {len(designs)}", text, "count the marker and those given with --also")
    before = sum(len(design) for design in designs[: number - 1])
    ids = [point.id for point in designs[number - 1].control_points]
    for dot in (first, second):
        if int(dot) not in ids:
            raise InputError("ids of the marker's dots", f"{dot} in {text}", "the sheet numbers the dots")
    if first == second:
        raise InputError("two dots", text, "measure from the center of one dot to that of another")
    places = [designs[number - 1].xyz[ids.index(int(dot))] for dot in (first, second)]
    nominal = float(sum((a - b) ** 2 for a, b in zip(*places, strict=True)) ** 0.5)
    measured = parse_length(length, "measured")
    spread = sigma if sigma_text is None else parse_length(sigma_text, "measured")
    if not spread > 0:
        raise InputError("a standard deviation above 0", text, "a steel ruler is read to 0.2 mm or so")
    if not abs(measured / nominal - 1) < 0.05:
        points = designs[number - 1].control_points
        edges = sum(points[ids.index(int(dot))].feature.diameter / 2 for dot in (first, second))
        outer = abs((measured - edges) / nominal - 1) < 0.05
        raise InputError(
            f"a length within 5 % of the design's {format_length(nominal)} between dots {first} and {second}",
            format_length(measured),
            f"from center to center it is {format_length(edges)} less than over the outer edges"
            if outer
            else "check the dots' numbers and the unit",
        )
    return Length(before + ids.index(int(first)), before + ids.index(int(second)), measured, spread)
