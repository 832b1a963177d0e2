"""What a state looks like: camera views, files to download, and bodies in 3-D."""

import io
import json
import re
from collections.abc import Mapping
from typing import Any, NamedTuple
from zipfile import ZipFile, ZipInfo

import numpy as np

from markergen.api.design import design
from markergen.api.export import choices_of, export
from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.estimators.budget import ErrorSources
from markergen.exporters import EXPORTERS, RECORD
from markergen.model.body_json import load_marker, load_rig
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.occlusion import eyes_of
from markergen.model.planned_error import degrees, millimeters
from markergen.model.pose_sources.cone import Cone
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig, planned_print
from markergen.options import given
from markergen.options.declarations import DesignKeywords
from markergen.render import DEFAULT_OPTICS, render_view
from markergen.studio.look import clean, sketch
from markergen.studio.opening import nameless_folder
from markergen.studio.state import SPEC, plain_options, refuse_named_plates, table_in, words
from markergen.validation.bounds import budget_of
from markergen.validation.error_to_plan_with import source_of
from markergen.validation.metrics import rms
from markergen.validation.setting import setting_of
from markergen.validation.views import SyntheticViews

_ZIP_TIME = (1980, 1, 1, 0, 0, 0)
"""Same files, same bytes."""


class File(NamedTuple):
    """A file to download."""

    name: str
    data: bytes


class Exhibit(NamedTuple):
    """Marker or rig that a request is about, with the camera and poses that it is shown in."""

    what: Marker | Rig
    camera: Camera
    poses: PoseDistribution


def subject(request: Mapping[str, Any]) -> Exhibit:
    """Return what a request is about: its ``rig``, ``marker`` or ``options``, whose layout is not judged.

    Raises
    ------
    InputError
        If it has none of these, or they cannot be used.
    """
    if "rig" in request:
        content = table_in(request, "rig")
        refuse_named_plates(content)
        rig = load_rig(content)
        setting = setting_of(rig)
        return Exhibit(rig, setting.camera, setting.poses)
    if "marker" in request:
        marker = load_marker(table_in(request, "marker"))
        setting = setting_of(marker)
        return Exhibit(marker, setting.camera, setting.poses)
    layout = sketch(table_in(request, "options"))
    return Exhibit(layout.marker, layout.setting.camera, layout.setting.poses)


def view(request: Mapping[str, Any]) -> tuple[bytes, Array]:
    """Render the camera's view, without noise, from a pose by its index or by ``tilt``, ``azimuth`` and ``distance``.

    Returns
    -------
    bytes, array (n, 2)
        PNG, and the images of the dots' centers in px.
    """
    import cv2

    what, camera, poses = subject(request)
    rotation, translation = _pose(request.get("pose", 0), poses)
    image = render_view(what, camera, rotation, translation, DEFAULT_OPTICS, np.random.default_rng(0))
    dots = camera.project(what.xyz, rotation[None], translation[None])[0]
    return bytes(cv2.imencode(".png", image)[1]), dots


def _pose(wish: object, poses: PoseDistribution) -> tuple[Array, Array]:
    if isinstance(wish, int) and not isinstance(wish, bool) and 0 <= wish < len(poses):
        return poses.rotation[wish], poses.translation[wish]
    try:
        assert isinstance(wish, Mapping)
        tilt, azimuth, distance = (float(wish[name]) for name in ("tilt", "azimuth", "distance"))
    except (AssertionError, KeyError, TypeError, ValueError):
        remedy = "give an index, or tilt and azimuth in deg and a distance in m"
        raise InputError(f"a pose of 0 to {len(poses) - 1}", brief(wish), remedy) from None
    cone = Cone((distance, distance), (tilt, tilt), (azimuth, azimuth), (0.0, 0.0), count=1)
    rotation, translation = cone.sample()
    return rotation[0], translation[0]


def exported(request: Mapping[str, Any]) -> File:
    """Make the file with a suffix, or a ZIP of it and of what comes with it: the same bytes as the command's.

    Options without points are refused: a search has its own request.
    """
    suffix = request.get("suffix")
    if not isinstance(suffix, str) or not re.fullmatch(r"(\.[a-z0-9]+){1,3}", suffix):
        raise InputError("a suffix such as .pdf", brief(suffix), "choose a format of the list")
    if suffix == SPEC and "options" in request:
        options = table_in(request, "options")
        return File(f"{'rig' if 'shape' in options else 'marker'}{SPEC}", words(options)["spec"].encode())
    with nameless_folder() as folder:
        if "rig" in request or "marker" in request:
            what = subject(request).what
            target = folder / f"{what.frame}{suffix}"
            written = export(what, target)
        else:
            state = plain_options(request.get("options"))
            if "points" not in state:
                raise InputError("dots to export", "none", "optimize first, or place them")
            target = folder / f"marker{suffix}"
            written = list(design(**state, output=target).written)
        # A design comes with its record, which is a download of its own.
        named = [file for file in written if suffix == RECORD or file.path.suffix != RECORD]
        files = [File(file.path.relative_to(folder).as_posix(), file.path.read_bytes()) for file in named]
    return files[0] if len(files) == 1 else _zipped(f"{target.name}.zip", files)


def _zipped(name: str, files: list[File]) -> File:
    data = io.BytesIO()
    with ZipFile(data, "w") as archive:
        for file in files:
            archive.writestr(ZipInfo(file.name, _ZIP_TIME), file.data)
    return File(name, data.getvalue())


def scene(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return a body as GLB in base64, its poses with the errors to expect there, and these in words."""
    import base64

    what, camera, poses = subject(request)
    errors, sentence = _errors(what, camera, poses)
    choices = choices_of(given(plain_options(request.get("options") or {}), DesignKeywords))
    glb = EXPORTERS[".glb"](what, choices)
    x, y, z = eyes_of(poses).T
    return {
        "glb": base64.b64encode(glb.data).decode(),
        "poses": {
            "x": x.tolist(),
            "y": y.tolist(),
            "z": z.tolist(),
            "tilt": poses.polar_angle_deg.tolist(),
            "azimuth": np.rad2deg(np.arctan2(y, x)).tolist(),
            "distance": poses.distance.tolist(),
            **errors,
        },
        "expected": sentence,
    }


def _errors(what: Marker | Rig, camera: Camera, poses: PoseDistribution) -> tuple[dict[str, Any], str]:
    """Errors to expect at every pose, of the print that was planned and to first order, and a sentence on them."""
    usual = ErrorSources(planned_print(what))
    series: SyntheticViews[Any] = SyntheticViews(what, camera, poses, 0, errors=usual)
    served, budget = series.coverage.served, budget_of(series)
    total = {"rotation": budget.rotation_deg["total"], "translation": 1e3 * budget.translation["total"]}
    rotation_deg, translation = (rms(error[served]) for error in total.values())
    amounts = f"{degrees(rotation_deg)} and {millimeters(translation, float(poses.distance.max()))}"
    at_poses = {name: np.where(served, error, np.inf) for name, error in total.items()}
    source = source_of(1e3 * usual.print_sigma, False)
    where = (
        f"the {np.count_nonzero(served)} of {len(poses)} poses that show enough dots"
        if not served.all()
        else f"all {len(poses)} poses"
    )
    return clean(at_poses), f"Expect {amounts} RMS over {where}, to first order, with {source}."


def parsed_request(data: bytes) -> dict[str, Any]:
    """Return the JSON object of a request; raises InputError if it is none."""
    try:
        request = json.loads(data)
    except (ValueError, RecursionError):
        request = None
    if not isinstance(request, dict):
        raise InputError("a JSON object", brief(data[:100].decode(errors="replace")), "reload the page")
    return request
