"""What ``markergen`` alone asks on a terminal: paper, camera and distance, for one page to print."""
# tests: tests/cli/test_asking.py

import os
from shlex import join

from markergen.cli.console import report
from markergen.drawing.paper import paper_of_locale
from markergen.units import parse_length

NEAREST = 0.4
"""Distance of the nearest pose over that of the farthest, as of the poses that are the default."""


def asked() -> list[str]:
    """Ask three questions, show the command that the answers make, and return its words."""
    usual = paper_of_locale(os.environ)
    paper = _answer("Paper in the printer", usual)
    camera = _answer("Camera: webcam, phone, or its calibration file", "webcam")
    distance = _answer("How far away is the marker at most", "1.5m")
    words = ["design", "--paper", paper]
    words += ["--camera", camera] if camera != "webcam" else []
    if distance != "1.5m":
        far = parse_length(distance, "distance")
        words += ["--poses", f"cone:distance={NEAREST * far:.4g}..{far:.4g}m,tilt=0..70"]
    report(f"markergen {join([*words, '-o', 'marker.pdf'])}")
    return [*words, "-o", "marker.pdf"]


def _answer(question: str, default: str) -> str:
    return input(f"{question} [{default}]: ").strip() or default
