"""Many images, one after another: what cannot be read is told and does not stop the others."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from markergen.detect.detection import Detection, detect_all
from markergen.detect.overlay import overlay
from markergen.detect.photometric import check_refinement, refine
from markergen.detect.record import as_dict
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker, check_supported
from markergen.model.marker_json import read_marker
from markergen.read.cameras import read_camera, read_camera_covariance
from markergen.read.images import Image, read_image


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one image.

    Attributes
    ----------
    path : Path
    image : Image or None
    size : tuple (width, height) or None
        Of the image, px.
    notes : tuple of str
        What its reader has to say.
    detections : tuple of Detection
        Those that were found; if nothing was, one for each marker with the reason.
    error : str
        Why the image could not be used; empty otherwise.
    """

    path: Path
    image: Image | None
    size: tuple[int, int] | None
    notes: tuple[str, ...]
    detections: tuple[Detection, ...]
    error: str = ""

    @property
    def found(self) -> bool:
        """At least one marker was found."""
        return any(detection.found for detection in self.detections)

    def without_image(self) -> "Outcome":
        """Return the same outcome without the image itself."""
        return replace(self, image=None)


@dataclass(frozen=True, eq=False)
class Job:
    """What to look for, and with what.

    Attributes
    ----------
    markers, names
        The markers, and what to call each.
    camera : Camera or None
        None gives homographies and pixels alone.
    errors : ErrorSources
    photometric : bool
        Align the rendered model with the image after the detection.
    """

    markers: tuple[Marker, ...]
    names: tuple[str, ...]
    camera: Camera | None
    errors: ErrorSources
    photometric: bool = False

    def run(self, path: Path) -> Outcome:
        """Look at one image."""
        try:
            image = read_image(path)
            self._check_size(image)
            detections = detect_all(image.grey, self.markers, self.camera, self.errors)
        except InputError as error:
            return Outcome(path, None, None, (), (), str(error))
        if self.photometric:
            detections = [
                refine(image.grey, self.markers[each.marker], self.camera, each, self.errors) if each.found else each
                for each in detections
            ]
        return Outcome(path, image, image.grey.shape[::-1], image.notes, tuple(detections))

    def _check_size(self, image: Image) -> None:
        height, width = image.grey.shape
        if self.camera is not None and (width, height) != (self.camera.width, self.camera.height):
            raise InputError(
                f"an image of the camera's {self.camera.width}x{self.camera.height} px",
                f"{width}x{height} px",
                "give the calibration for this size: cropped or scaled images have another",
            )

    def as_dict(self, outcome: Outcome) -> dict[str, Any]:
        """Return an outcome as plain JSON values (docs/detect.md)."""
        return {
            "image": str(outcome.path),
            "size": outcome.size,
            "notes": outcome.notes,
            "error": outcome.error or None,
            "markers": [as_dict(each, self.markers, self.names) for each in outcome.detections],
        }

    def overlay(self, outcome: Outcome) -> bytes | None:
        """Return the image as PNG bytes with what was found drawn in; None for one that could not be used."""
        if outcome.image is None:
            return None
        return overlay(
            outcome.image.grey, self.markers, self.camera, [each for each in outcome.detections if each.found]
        )


def job_from_files(
    markers: Sequence[Path],
    camera: Path | None = None,
    camera_covariance: Path | None = None,
    print_sigma: float = 1e-4,
    refinement: str = "none",
) -> Job:
    """Read markers and calibration.

    Raises
    ------
    InputError
        If a file cannot be used, the refinement is unknown, or a covariance comes without its camera.
    """
    check_refinement(refinement)
    calibration = None if camera is None else read_camera(camera)
    covariance = None
    if camera_covariance is not None:
        if calibration is None:
            raise InputError(
                "a camera that the covariance belongs to", "--camera-covariance alone", "give its file with --camera"
            )
        covariance = read_camera_covariance(camera_covariance, calibration)
    read = tuple(read_marker(path) for path in markers)
    for marker in read:
        check_supported(marker, "to detect")  # Not once for each image.
    return Job(
        read,
        tuple(str(path) for path in markers),
        calibration,
        ErrorSources(print_sigma, covariance),
        refinement == "photometric",
    )


def overlay_names(paths: Sequence[Path]) -> list[str]:
    """File names for the overlays of images, all different, in order: the image's stem, numbered if it comes twice."""
    names, taken = [], set[str]()
    for path in paths:
        name, number = path.stem, 1
        while name in taken:
            number += 1
            name = f"{path.stem}-{number}"
        taken.add(name)
        names.append(f"{name}.png")
    return names


def to_json(job: Job, outcomes: Sequence[Outcome]) -> bytes:
    """One JSON array for all images."""
    return (json.dumps([job.as_dict(outcome) for outcome in outcomes], indent=2, allow_nan=False) + "\n").encode()
