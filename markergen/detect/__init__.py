"""From an image to labeled dot centers: candidates, ellipses, labels, corrected centers."""

from markergen.detect.detection import Detection, detect

__all__ = ["Detection", "detect"]
