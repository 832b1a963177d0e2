"""Photometric refinement: the dots as the pose predicts them, aligned with the grey levels of the image itself.

What is aligned is each dot by itself, not the pose: a dot's shape, tilt and curvature come from the pose, its place in
the marker's plane is free. A pose aligned with all pixels at once takes the dots to be exactly where the marker says;
every error of the print then becomes an error of the pose that no covariance knows of, and for a perfect print it
gains next to nothing: over the paper's poses the rotation would be 1 to 2 % better, as what the dots' shapes tell of it
is little beside what their places do. Places measured
one by one carry the image's errors alone, and the pose that follows from them weighs these against the print's.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markergen.detect.alignment import align_dots
from markergen.detect.blobs import Image
from markergen.detect.detection import Detection
from markergen.detect.plane_model import Dot
from markergen.detect.pose import DEFAULT_ERRORS, estimate_pose
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.dlt import estimate_homography
from markergen.maths.projection import apply_homography, plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker

Array = NDArray[np.float64]


REFINEMENTS = ("none", "photometric")
"""What may follow a detection."""


def check_refinement(name: str) -> None:
    """Refuse the name of a refinement that there is not."""
    if name not in REFINEMENTS:
        raise InputError(f"a refinement: {' or '.join(REFINEMENTS)}", repr(name), "choose one of these")


def refine(
    image: Image,
    marker: Marker,
    camera: Camera | None,
    detection: Detection,
    errors: ErrorSources = DEFAULT_ERRORS,
) -> Detection:
    """Measure the dots of a detection again, by the grey levels of the image around their predicted outlines.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
        The one that the detection comes from.
    camera : Camera or None
        Without one the detection's homography takes the place of the pose.

    Returns
    -------
    Detection
        With new `pixels` and `covariance`, and with homography and pose estimated from these. A dot that the image
        shows otherwise than predicted, such as one half hidden, keeps what it had, and so does a detection that found
        nothing.

    Raises
    ------
    InputError
        If there is neither pose nor homography (a marker with relief and no camera), or the image has another size
        than the camera's.
    """
    if not detection.found:
        return detection
    height, width = image.shape
    if camera is not None and (width, height) != (camera.width, camera.height):
        raise InputError(
            f"an image of {camera.width}x{camera.height} px, the camera's size",
            f"{width}x{height} px",
            "give the camera that took the image",
        )
    # A camera whose normalized coordinates are pixels stands for the one that is not known.
    lens = camera or Camera(width, height, 1, 1, 0, 0)
    position = {point.id: i for i, point in enumerate(marker.control_points)}
    chosen = np.array([position[int(i)] for i in detection.ids])
    aligned = align_dots(image, lens, _predicted(marker, chosen, lens, detection))
    good = aligned.good
    pixels = np.where(good[:, None], aligned.pixels, detection.pixels)
    covariance = np.where(good[:, None, None], aligned.covariance, detection.covariance)
    points = marker.xyz[chosen]
    homography, pose = detection.homography, detection.pose
    if homography is not None:
        ideal = lens.ideal.to_pixels(lens.from_pixels(pixels))
        mapped: Array = np.asarray(estimate_homography(points[:, :2], ideal), dtype=float)
        # Four points with three on a line have a pose, but no homography of their own.
        homography = mapped if np.isfinite(mapped).all() else homography
    if camera is not None:
        pose = estimate_pose(points, pixels, covariance, camera, errors.of(marker, chosen)) or pose
    return replace(detection, pixels=pixels, covariance=covariance, homography=homography, pose=pose)


def _predicted(marker: Marker, chosen: NDArray[np.intp], lens: Camera, detection: Detection) -> list[Dot]:
    """The chosen dots as the detection's pose, or else its homography, puts them."""
    xyz = marker.xyz
    if detection.pose is not None:
        rotation = np.broadcast_to(detection.pose.rotation, (len(xyz), 3, 3))
        shift = detection.pose.translation + xyz[:, 2:] * detection.pose.rotation[:, 2]
        homography = np.asarray(plane_homography(rotation, shift, np.eye(3)), dtype=float)
    elif detection.homography is not None:
        homography = np.linalg.inv(lens.matrix) @ np.broadcast_to(detection.homography, (len(xyz), 3, 3))
    else:
        raise InputError("a camera for a marker with relief", "none", "give the camera that took the image")
    features = [point.feature for point in marker.control_points]
    radius = np.array([feature.diameter / 2 for feature in features])
    inner = np.array([feature.inner_diameter / 2 for feature in features])
    to_plane = np.zeros((len(xyz), 3, 3))
    to_plane[:, 0, 0] = to_plane[:, 1, 1] = radius
    to_plane[:, :2, 2], to_plane[:, 2, 2] = xyz[:, :2], 1
    planes = homography @ to_plane
    seen = lens.from_pixels(detection.pixels)
    dots = []
    for i, place in zip(chosen, seen, strict=True):
        inverse = np.linalg.inv(planes[i])
        others = np.delete(planes[:, :, 2], i, axis=0) @ inverse.T
        neighbors = np.column_stack([others[:, :2] / others[:, 2:], np.delete(radius, i) / radius[i]])
        dots.append(Dot(planes[i], apply_homography(inverse, place[None])[0], inner[i] / radius[i], neighbors))
    return dots
