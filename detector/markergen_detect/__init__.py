"""Finds the markers of markergen in an image: labeled dots, pose and covariance by one compiled call."""

from markergen_detect.camera import Camera
from markergen_detect.description import Body, DescriptionError, Tag, read_bodies
from markergen_detect.detector import Detector, Finding, Second

__all__ = ["Body", "Camera", "DescriptionError", "Detector", "Finding", "Second", "Tag", "read_bodies"]
