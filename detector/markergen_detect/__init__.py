"""Finds the markers of markergen in an image: labeled dots, pose and covariance by one compiled call."""

from markergen_detect.camera import LENSES, Camera
from markergen_detect.description import Body, DescriptionError, Tag, read_bodies
from markergen_detect.detector import Detector, Dots, Finding, Second, find_dots
from markergen_detect.verdict import Cause, Verdict

__all__ = [
    "LENSES",
    "Body",
    "Camera",
    "Cause",
    "DescriptionError",
    "Detector",
    "Dots",
    "Finding",
    "Second",
    "Tag",
    "Verdict",
    "find_dots",
    "read_bodies",
]
