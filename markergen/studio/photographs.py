"""What photographs show: dots and pose in one, and the print and the camera by all of them."""

# tests: tests/studio/test_showing.py

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from markergen.api.calibrate import calibrate
from markergen.detect.detector import Detector
from markergen.detect.presentation import overlay
from markergen.errors import InputError, brief
from markergen.options import Progress
from markergen.options.declarations import DesignKeywords
from markergen.presentation.pages import data_uri
from markergen.read.images import read_image
from markergen.studio.opening import last_name, nameless_folder, uploaded
from markergen.studio.showing import subject
from markergen.studio.state import design_of, refuse_files, table_in


def detected(request: Mapping[str, Any], name: str, photo: bytes) -> dict[str, Any]:
    """Look for a marker or rig in a photograph.

    Returns
    -------
    dict
        ``found``; ``why`` not; ``line``, the result as the command prints it; ``dots`` with ``id``, ``x`` and ``y`` in
        px; ``pose`` as in docs/detect.md, or None without a ``camera`` or with a typical one, which is not that of the
        photograph; ``notes`` on the file; ``overlay``, a data URI.
    """
    camera, covariance = _camera_of(request)
    detector = Detector(subject(request).what, camera, camera_covariance=covariance)
    with uploaded(name, photo) as path:
        image = read_image(path)
    detections = detector(image.grey)
    first = detections[0]
    picture = overlay(image.grey, detections)
    ids = first.ids.tolist() or [None] * len(first.pixels)
    return {
        "found": first.ok,
        "why": first.reason,
        "line": str(first),
        "dots": [{"id": i, "x": x, "y": y} for i, (x, y) in zip(ids, first.pixels.tolist(), strict=True)],
        "pose": first.as_dict()["pose"],
        "notes": list(image.notes),
        "overlay": data_uri(picture),
    }


def _camera_of(request: Mapping[str, Any]) -> tuple[Mapping[str, Any] | None, Any]:
    """Camera of a request and its covariance; None of a typical one, which is not that of the photographs."""
    camera, covariance = request.get("camera"), request.get("camera_covariance")
    refuse_files({"camera": camera, "camera_covariance": covariance}, DesignKeywords)
    return (None, None) if camera is None or isinstance(camera, str) else (table_in(request, "camera"), covariance)


def calibrated(request: Mapping[str, Any], photographs: bytes, progress: Progress) -> dict[str, Any]:
    """Measure the print of a marker or rig by photographs, and the camera, if the request has none of its own.

    Parameters
    ----------
    request : mapping
        What was printed, ``camera``, and ``files``: a list of ``name`` and ``size`` of each photograph.
    photographs : bytes
        Their contents, one after the other.

    Returns
    -------
    dict
        ``verdict`` with the error to expect, ``use``, whether it is to be used, other ``sentences``, and ``files``:
        texts by name, of what was measured and of the camera if it was estimated.
    """
    is_body = "rig" in request or "marker" in request
    what = subject(request).what if is_body else design_of(table_in(request, "options")).marker
    camera, covariance = _camera_of(request)
    with nameless_folder() as folder:
        paths: list[Path] = []
        for name, data in _parted(request.get("files"), photographs):
            path = folder / str(len(paths)) / last_name(name)
            path.parent.mkdir()
            path.write_bytes(data)
            paths.append(path)
        targets = [folder / "measured.json"] + [folder / "camera.yaml"] * (camera is None or covariance is not None)
        prior: dict[str, Any] = {} if covariance is None else {"camera_covariance": np.array(covariance)}
        # In this thread, which ends with whoever listens.
        result = calibrate(what, paths, camera, save=targets, progress=progress, workers=1, **prior)
        files = {path.name: path.read_text(encoding="utf-8") for path in targets}
    verdict, *sentences = map(str, result.parts())
    return {"verdict": verdict, "use": result.to_use, "sentences": sentences, "files": files}


def _parted(files: Any, data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the name and content of each file; raises InputError where the sizes do not fit the data."""
    sizes = [(str(file.get("name")), int(file["size"])) for file in files] if _are_sizes(files) else []
    if not sizes or sum(size for _, size in sizes) != len(data):
        raise InputError("photographs with their sizes", brief(files), "reload the page")
    begin = 0
    for name, size in sizes:
        yield name, data[begin : begin + size]
        begin += size


def _are_sizes(files: Any) -> bool:
    return isinstance(files, list) and all(
        isinstance(file, Mapping) and isinstance(file.get("size"), int) and file["size"] >= 0 for file in files
    )
