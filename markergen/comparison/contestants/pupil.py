"""AprilTags, detected by AprilTag's own library as packaged in pupil-apriltags."""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from markergen.comparison.contestants.base import KINDS, Arena, ContestantKind
from markergen.comparison.contestants.printed import Grey, Printed, ours
from markergen.comparison.contestants.tags import SquareTag, tag_in
from markergen.comparison.fiducials import FiducialDetection, enlarged
from markergen.errors import InputError
from markergen.model.camera import Camera

FAMILIES = ("16h5", "25h9", "36h11")
_ORDER = [1, 0, 3, 2]
"""Its corners in the order of ours. It counts from the bottom left of the official tag, counterclockwise; OpenCV's
bitmaps, which are what we print, are the official ones turned by 180 degrees."""
_OFFSET_PX = 0.5
"""It counts pixels from the corner of the top left one."""


@dataclass(frozen=True)
class PupilSettings:
    """Settings of pupil_apriltags.Detector, and a factor of enlargement before it."""

    quad_decimate: float = 1.0
    quad_sigma: float = 0.0
    refine_edges: bool = True
    enlarge: int = 1

    def describe(self) -> str:
        """Describe in a few words."""
        parts = [f"quad_decimate {self.quad_decimate:g}", f"quad_sigma {self.quad_sigma:g}"]
        parts += [] if self.refine_edges else ["refine_edges 0"]
        return ", ".join([*parts, *([f"image x{self.enlarge}"] if self.enlarge > 1 else [])])


SETTINGS = (
    *(PupilSettings(1.0, sigma, refine, k) for k in (1, 2) for sigma in (0.0, 0.8) for refine in (True, False)),
    PupilSettings(2.0),
    PupilSettings(2.0, enlarge=2),
)


@dataclass(frozen=True, eq=False)
class PupilTag(SquareTag):
    """An AprilTag that pupil-apriltags looks for."""

    settings = SETTINGS
    detector = "pupil-apriltags"
    describe = Printed.describe

    def find(self, image: Grey, camera: Camera, setting: PupilSettings) -> FiducialDetection:
        """See `Printed.find`."""
        del camera
        detector = _detector(self.tag.family.partition(":")[2], setting)
        detections = [
            detection
            for detection in detector.detect(enlarged(image, setting.enlarge))
            if detection.tag_id == self.tag.id
        ]
        if not detections:
            return FiducialDetection(reason=f"no tag with id {self.tag.id}")
        best = max(detections, key=lambda detection: float(detection.decision_margin))
        corners = np.asarray(best.corners, dtype=float)[_ORDER] - _OFFSET_PX
        return FiducialDetection(np.arange(4), ours(corners, setting.enlarge))


@cache
def _detector(family: str, setting: PupilSettings) -> Any:
    import pupil_apriltags

    class Kept(pupil_apriltags.Detector):  # type: ignore[misc]
        def __del__(self) -> None:
            """Do nothing: the library's destructor corrupts memory once there are two detectors of one family."""

    return Kept(
        families=f"tag{family}",
        nthreads=1,
        quad_decimate=setting.quad_decimate,
        quad_sigma=setting.quad_sigma,
        refine_edges=int(setting.refine_edges),
    )


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
