"""Finds the markers of markergen in an image: labeled dots, pose and covariance by one compiled call."""

from markergen_detect.camera import Camera
from markergen_detect.description import Body, DescriptionError, Tag, read_bodies
from markergen_detect.detector import Detector, Finding, Second
from markergen_detect.verdict import Cause, Verdict

__all__ = [
    "Body",
    "Camera",
    "Cause",
    "DescriptionError",
    "Detector",
    "Finding",
    "Second",
    "Tag",
    "Verdict",
    "read_bodies",
]
