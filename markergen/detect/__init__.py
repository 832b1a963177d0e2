"""From an image to labeled dot centers and poses: candidates, ellipses, labels, corrected centers, pose."""

from markergen.detect.detection import detect, detect_all
from markergen.detect.detector import Detector, Found
from markergen.detect.pose import PoseEstimate, estimate_pose
from markergen.detect.results import Detection

__all__ = ["Detection", "Detector", "Found", "PoseEstimate", "detect", "detect_all", "estimate_pose"]
