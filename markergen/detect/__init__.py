"""Detection of markers and rigs in images, files, videos and live cameras."""

from markergen.detect.detector import Detector, detect, detect_all
from markergen.detect.results import Found, SecondPose

__all__ = ["Detector", "Found", "SecondPose", "detect", "detect_all"]
