"""Photographs that a video gives for a calibration: still views that add something, until more hardly help."""
# tests: tests/calibration/test_live.py

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.calibration import Calibration
from markergen.calibration.coverage import coverage_of
from markergen.detect.detector import Detector
from markergen.errors import InputError
from markergen.read.videos import open_video, silent_opencv

STILL = 5e-4
"""RMS motion of the dots since the frame before, over the picture's diagonal, below which a view is still: 0.4 px
of 640 x 480, which smears a dot by 0.2 px at 30 frames a second and an exposure of 15 ms."""

APART = 0.03
"""RMS distance of the dots from those of every photograph taken, over the diagonal, that makes a view another one:
24 px in 640 x 480, as far as a tilt by 25 deg moves dots that are 250 px from the middle."""

FEWEST, MOST = 8, 40
"""Number of photographs from which on it is asked whether more help, and at which it ends in any case."""

Judge = Callable[[Sequence[NDArray[np.uint8]]], Calibration]


def photographs_of(
    source: str, detector: Detector, judge: Judge, tell: Callable[[str], None]
) -> list[NDArray[np.uint8]]:
    """Take photographs from a video, a camera or a stream, until more hardly help or it ends.

    Parameters
    ----------
    detector : Detector
        Of the markers to measure.
    judge : callable
        Calibrates with the photographs so far; what it raises as `InputError` asks for more.
    tell : callable
        Takes a line for each photograph: what all of them cover, and which is wanted next.

    Raises
    ------
    InputError
        If the source cannot be opened, or shows no still view.
    """
    taken: list[NDArray[np.uint8]] = []
    views: list[dict[tuple[int, int], Array]] = []
    before: dict[tuple[int, int], Array] = {}
    with open_video(source) as video, silent_opencv():
        for frame in video:
            diagonal = float(np.hypot(*frame.image.shape[:2]))
            dots = _dots(detector(frame.image))
            is_still = _motion(dots, before) < STILL * diagonal
            before = dots
            if not is_still or any(_motion(dots, view) < APART * diagonal for view in views):
                continue
            taken.append(frame.image.copy())
            views.append(dots)
            wanted = _wanted(taken, judge)
            tell(f"photograph {len(taken)}: {wanted or 'enough, more hardly help'}")
            if not wanted or len(taken) == MOST:
                break
    if not taken:
        raise InputError("a still view of the marker", f"none in {video.name}", "hold the camera or the marker still")
    return taken


def _dots(results: Sequence[Any]) -> dict[tuple[int, int], Array]:
    """Pixels of dots by the numbers of the marker and the dot."""
    return {
        (number, int(identity)): pixel
        for number, finding in enumerate(results)
        if finding.ok
        for identity, pixel in zip(finding.ids, finding.pixels, strict=True)
    }


def _motion(dots: dict[tuple[int, int], Array], others: dict[tuple[int, int], Array]) -> float:
    """RMS distance in px of the dots that are in both; inf for fewer than four."""
    both = dots.keys() & others.keys()
    if len(both) < 4:
        return float("inf")
    return float(np.sqrt(np.mean([np.sum((dots[key] - others[key]) ** 2) for key in both])))


def _wanted(taken: Sequence[NDArray[np.uint8]], judge: Judge) -> str:
    """What all photographs cover, and the next one to take; empty if more hardly help."""
    if len(taken) < FEWEST:
        return "tilt it by 20 to 60 deg, to another side, in another part of the picture"
    try:
        calibration = judge(taken)
    except InputError as error:
        return str(error)
    wanted = calibration.next_photos
    if wanted is None or not wanted.helps:
        return ""
    return f"{coverage_of(calibration.adjustment).sentence} {wanted.sentence}"
