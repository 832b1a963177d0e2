"""What ``markergen`` alone asks on a terminal: paper, camera and distance, for one page to print."""
# tests: tests/cli/test_asking.py

import os
from shlex import join

from markergen.cli.console import report
from markergen.drawing.paper import paper_of_locale
from markergen.errors import InputError
from markergen.units import parse_length

FARTHEST = 1.5
"""Distance of the farthest pose by default, m."""

NEAREST = 0.4
"""Distance of the nearest pose over that of the farthest, as of the poses that are the default."""


def asked() -> list[str]:
    """Ask three questions, show the command that the answers make, and return its words."""
    paper = _answer("Paper in the printer", paper_of_locale(os.environ))
    camera = _answer("Camera: webcam, phone, or its calibration file", "webcam")
    farthest = _distance()
    command = ["design", "--paper", paper]
    command += ["--camera", camera] if camera != "webcam" else []
    if farthest != FARTHEST:
        command += ["--poses", f"cone:distance={NEAREST * farthest:.4g}..{farthest:.4g}m,tilt=0..70"]
    command += ["-o", "marker.pdf"]
    report(f"markergen {join(command)}")
    return command


def _distance() -> float:
    """Ask for a distance in m until the answer is one."""
    while True:
        try:
            return parse_length(_answer("How far away is the marker at most", f"{FARTHEST}m"), "distance")
        except InputError as error:
            report(str(error))


def _answer(question: str, default: str) -> str:
    return input(f"{question} [{default}]: ").strip() or default
