"""``markergen.comparison``: markers against each other and against square tags and boards."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Unpack

from markergen.api.arguments import files_among
from markergen.comparison.compare import compare_and_time as run
from markergen.comparison.contestants import forms
from markergen.comparison.fmac import IMAGES, ProtocolComparison, fmac
from markergen.comparison.result import Comparison
from markergen.defaults import COMPARED_VIEWS
from markergen.errors import InputError, brief
from markergen.model.body_json import load_marker_or_rig
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.options import Progress, check_progress, settle, takes
from markergen.options.compare import CompareKeywords
from markergen.options.kinds import File, Files, TargetLike
from markergen.pool import OneBlasThread
from markergen.read.poses import poses_as_stated

_log = logging.getLogger(__name__)


@takes(CompareKeywords)
@OneBlasThread()
def compare(
    *contestants: TargetLike,
    save: Files = (),
    json: File | None = None,
    plot: File | None = None,
    progress: Progress | None = None,
    announce: Callable[[str], None] | None = None,
    **options: Unpack[CompareKeywords],
) -> Comparison:
    """Compare markers with each other and with square tags and boards: same poses, optics and noise.

    Parameters
    ----------
    *contestants : Marker, Rig, path, dict or str
        Markers, common layouts such as ``ngon:N``, and patterns of others such as ``aruco:DICT[:ID]`` or
        ``checkerboard:CxR``: all forms are in ``markergen compare --help``. One alone is compared with nine of them.
        One whose library is not installed keeps its row, which says what to install.
    save : path or list of paths
        Files to write at the end, by suffix: .json for the results, .svg or .png for a plot of the errors. All targets
        are checked before the work begins.
    json, plot : path or None
        Files for the results and for the plot; the file for the results may have any suffix.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    announce : callable or None
        Called with a sentence about the expected duration after the first views, and one about each contestant.
    **options
        As on the command line, ``markergen compare --help``, with underscores. Lengths are in m, or text with a unit.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a contestant is unknown, or an argument is unknown, of the wrong type or out of range.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> found = compare("ngon:5", "square", views=4, poses="cone:count=20", workers=1)
    >>> found  # doctest: +ELLIPSIS
    <Comparison: 4 views; ngon:5 ... deg, square ... deg>
    >>> found.contestants["square"]["detected"]
    4
    """
    check_progress(progress)
    settled = settle(options, CompareKeywords)
    targets = Comparison.targets(save, json=json, plot=plot)
    targets.check(files_among(*contestants, settled["poses"], settled["camera_in_body"]))
    texts, markers = _named(contestants)
    poses: Any = poses_as_stated(settled["poses"], settled)
    began = time.perf_counter()
    _log.info("comparing %s", ", ".join(texts))
    if _protocol(settled):
        judged = fmac(
            texts, IMAGES if settled["views"] is None else settled["views"], settled["seed"], settled["print_sigma"],
            settled["workers"], progress, markers, settled["parts"], announce,
        )  # fmt: skip
        return ProtocolComparison(judged, ProtocolComparison(judged).write(targets))
    results, cpu_s = run(
        texts, COMPARED_VIEWS if settled["views"] is None else settled["views"], settled["seed"], poses,
        settled["print_sigma"], workers=settled["workers"], progress=progress, given=markers,
        announce=announce,
    )  # fmt: skip
    _log.info("compared in %.1f s", time.perf_counter() - began)
    written = Comparison(results).write(targets)
    return Comparison(results, written, cpu_s)


def _protocol(settled: Mapping[str, Any]) -> bool:
    """Return whether a protocol is asked for; raises InputError for an unknown one, or options that it settles."""
    if settled["protocol"] not in ("none", "fmac"):
        raise InputError("a known protocol", brief(settled["protocol"]), "known: none, fmac")
    is_asked: bool = settled["protocol"] == "fmac"
    if is_asked and settled["poses"] is not None:
        raise InputError("no poses with a protocol, which has its own", "poses", "leave out --poses")
    if not is_asked and settled["parts"] is not None:
        raise InputError("a protocol whose parts are kept", "parts alone", "add --protocol fmac, or leave out --parts")
    return is_asked


def _named(contestants: Sequence[TargetLike]) -> tuple[list[str], dict[str, Marker | Rig]]:
    """Return the texts of all contestants, and the markers that come from no path, by their texts."""
    objects = [contestant for contestant in contestants if _is_object(contestant)]
    texts, markers = [], dict[str, Marker | Rig]()
    for contestant in contestants:
        if _is_object(contestant):
            text = "marker" if len(objects) == 1 else f"marker {len(markers) + 1}"
            markers[text] = load_marker_or_rig(contestant)
        elif isinstance(contestant, str | PathLike):
            text = str(contestant)
        else:
            raise InputError(
                "a marker, a path, or a text such as aruco:DICT_4X4_50", brief(contestant), f"known: {forms()}"
            )
        texts.append(text)
    return texts, markers


def _is_object(contestant: object) -> bool:
    """True for a marker, a rig, or anything besides paths that `Marker.load` takes."""
    return isinstance(contestant, Marker | Rig | Mapping) or hasattr(contestant, "read")
