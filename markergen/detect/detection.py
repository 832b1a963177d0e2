"""Detection in single images, by detectors that are kept for the next ones."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.detect.detector import MAX_COPIES, Detector
from markergen.detect.results import Found
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import DEFAULT_ERRORS, PoseEstimate, estimate_pose
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.model.rig import Target

Image = NDArray[np.uint8] | NDArray[np.uint16]


@lru_cache(maxsize=16)
def _prepared(markers: tuple[Target, ...], camera: Camera | None, errors: ErrorSources, copies: int) -> Detector:
    return Detector(
        markers,
        camera,
        print_sigma=errors.print_sigma,
        scale_sigma=errors.scale_sigma,
        camera_covariance=None if camera is None else errors.camera_covariance,
        copies=copies,
    )


def detect(image: Image, marker: Target, camera: Camera | None = None, errors: ErrorSources = DEFAULT_ERRORS) -> Found:
    """Find one marker or rig in an image; if there are several copies, the one with the most dots.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    camera : Camera or None
        Without one, labels follow from the homography alone, and there is no pose.
    errors : ErrorSources
        Errors of print and calibration, for the weights of the dots and the pose's covariance.

    Raises
    ------
    InputError
        As `Detector` does. An image without the marker is not an error.
    """
    return detect_all(image, [marker], camera, errors, copies=1)[0]


def detect_all(
    image: Image,
    markers: Sequence[Target],
    camera: Camera | None = None,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
) -> list[Found]:
    """Find all copies of all markers and rigs in an image, best first; raises as `Detector` does.

    A blob that two markers claim with labelings about as likely is assigned to neither. A tag that is read decides
    between markers that differ by their tags, and between labelings; otherwise, dots and key ring do.
    """
    return _prepared(tuple(markers), camera, errors, copies)(image)


def body_poses(result: Found, body: Body, camera: Camera, errors: ErrorSources) -> "list[tuple[int, PoseEstimate]]":
    """Return the number of each constellation of a body and its pose from its own dots alone, where these suffice."""
    poses = []
    rows = {int(number): k for k, number in enumerate(result.ids)}
    for k, part in enumerate(body.constellations):
        pairs = [(i, rows[number]) for i, number in enumerate(body.ids[part.dots].tolist()) if number in rows]
        if len(pairs) < 4:
            continue
        dots, seen = (np.array(column) for column in zip(*pairs, strict=True))
        places = part.marker.xyz[dots]
        pixels, covariance = result.pixels[seen], result.pixel_covariance[seen]
        pose = estimate_pose(places, pixels, covariance, camera, errors.of(part.marker, dots))
        if pose is not None:
            poses.append((k, pose))
    return poses
