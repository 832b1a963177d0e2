"""Detection of markers and rigs in images, files, videos and live cameras."""

from markergen.detect.detection import detect, detect_all
from markergen.detect.detector import Detector, Found, SecondPose
from markergen.detect.results import Detection

__all__ = ["Detection", "Detector", "Found", "SecondPose", "detect", "detect_all"]
