"""Square tags found by cv2.aruco, whose corners are the intersections of lines that we fit to their edges."""
# tests: tests/contracts/test_contestants.py

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from markergen.comparison.contestants.base import KINDS, Arena, Kind
from markergen.comparison.contestants.printed import Grey
from markergen.comparison.contestants.tags import SquareTag, tag_in
from markergen.comparison.fiducials import FiducialDetection, FiducialSettings, detect_fiducial
from markergen.comparison.tag_edges import fit_edges
from markergen.model.camera import Camera


@dataclass(frozen=True, eq=False)
class EdgeTag(SquareTag):
    """A square tag, found by cv2.aruco with corners that are then fitted by us."""

    @property
    def settings(self) -> Sequence[Any]:
        """See `Contestant.settings`: that which misses the fewest tags."""
        return (FiducialSettings("subpix"),)

    def describe(self, setting: Any) -> str:
        """See `Contestant.describe`."""
        return f"{super().describe(setting)}, then our lines fitted to the grey levels of its edges"

    def find(self, image: Grey, camera: Camera, setting: Any) -> FiducialDetection:
        """See `Printed.find`."""
        detection = detect_fiducial(image, self.tag, setting, camera)
        if not detection.found:
            return detection
        corners = fit_edges(image, detection.pixels, self.tag.cells, camera)
        return (
            FiducialDetection(detection.ids, corners) if corners is not None else FiducialDetection(reason="no edges")
        )


def _tag(text: str, arena: Arena) -> EdgeTag:
    return EdgeTag(text, tag_in(text.partition(":")[2], arena.square), arena.square)


KINDS.register("edges")(
    Kind(_tag, "edges:aruco:DICT[:ID]", "ArUco (or apriltag) tag, our lines on its edges", "OpenCV")
)
