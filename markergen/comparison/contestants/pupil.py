"""AprilTags, detected by AprilTag's own library as packaged in pupil-apriltags."""
# tests: tests/contracts/test_contestants.py

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey
from markergen.comparison.contestants.tags import SquareTag, tag_in
from markergen.errors import InputError
from markergen.model.camera import Camera

FAMILIES = ("16h5", "25h9", "36h11")
_ORDER = [1, 0, 3, 2]
"""Its corners in the order of ours. It counts from the bottom left of the official tag, counterclockwise; OpenCV's
bitmaps, which are what we print, are the official ones turned by 180 degrees."""
_OFFSET_PX = 0.5
"""It counts pixels from the corner of the top left one."""


OPTIONS: Mapping[str, Any] = {
    "quad_decimate 2": {},
    "quad_decimate 1": {"quad_decimate": 1.0},
    "quad_decimate 1, quad_sigma 0.8": {"quad_decimate": 1.0, "quad_sigma": 0.8},
    "quad_decimate 1, quad_sigma 1.2": {"quad_decimate": 1.0, "quad_sigma": 1.2},
    "quad_decimate 1, refine_edges 0": {"quad_decimate": 1.0, "refine_edges": 0},
    "quad_decimate 1, quad_sigma 0.8, refine_edges 0": {"quad_decimate": 1.0, "quad_sigma": 0.8, "refine_edges": 0},
}
"""Options of pupil_apriltags.Detector; the first are its defaults. A quad_sigma of 0.4 changes nothing: its kernel
has one pixel."""


@dataclass(frozen=True, eq=False)
class PupilTag(SquareTag):
    """An AprilTag that pupil-apriltags looks for."""

    detector = "pupil-apriltags"
    detectors = OPTIONS

    def find(self, image: Grey, camera: Camera, options: dict[str, float]) -> Sighting:
        """See `Printed.find`."""
        del camera
        detector = _detector(self.tag.family.partition(":")[2], **options)
        detections = [detection for detection in detector.detect(image) if detection.tag_id == self.tag.id]
        if not detections:
            return Sighting(reason=f"no tag with id {self.tag.id}")
        best = max(detections, key=lambda detection: float(detection.decision_margin))
        return Sighting(np.arange(4), np.asarray(best.corners, dtype=float)[_ORDER] - _OFFSET_PX)


@cache
def _detector(family: str, **options: float) -> Any:
    import pupil_apriltags

    class Kept(pupil_apriltags.Detector):  # type: ignore[misc]
        def __del__(self) -> None:
            """Do nothing: the library's destructor corrupts memory once there are two detectors of one family."""

    return Kept(families=f"tag{family}", nthreads=1, **options)


def _tag(text: str, arena: Arena) -> PupilTag:
    family = text.split(":")[1] if ":" in text else ""
    if family not in FAMILIES:
        raise InputError(f"a family that pupil-apriltags has: {', '.join(FAMILIES)}", repr(text), "write pupil:36h11")
    tag = tag_in(f"apriltag{text.removeprefix('pupil')}", arena.square)
    import pupil_apriltags  # noqa: F401  # without it the contestant is absent

    return PupilTag(text, tag, arena.square)


KINDS.register("pupil")(
    ContestantKind(_tag, "pupil:FAMILY[:ID]", "AprilTag", "AprilTag's own library", requires="pupil-apriltags")
)
