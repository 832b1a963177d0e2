"""The whole way from an image to labeled centers, with a reason when it ends early."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Image, detect_dots
from markergen.detect.labels import label_dots
from markergen.model.camera import Camera
from markergen.model.marker import Marker

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Detection:
    """What was found of a marker in one image.

    Attributes
    ----------
    found : bool
        All control points, with labels that are the only ones possible.
    ids : array (n,) of int
        Of the control points; empty when not found, as are the others.
    pixels : array (n, 2), px
        Images of the control points.
    ellipse_centers : array (n, 2), px
        Centers of the dots' image ellipses, from which `pixels` were corrected.
    reason : str
        Why nothing was found; empty otherwise.
    """

    found: bool
    ids: NDArray[np.intp]
    pixels: Array
    ellipse_centers: Array
    reason: str = ""


def detect(image: Image, marker: Marker, camera: Camera) -> Detection:
    """Find all control points of a flat marker in an undistorted grey image.

    Parameters
    ----------
    image : array (camera.height, camera.width) of uint8 or uint16

    Raises
    ------
    InputError
        If the image is not grey of uint8 or uint16, or the marker has relief. An image without the marker is no error.
    """
    blobs = detect_dots(image)
    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        return _nothing(f"the image is {width}x{height} px, the camera {camera.width}x{camera.height} px")
    labeling = label_dots(blobs, marker, camera)
    if labeling.blobs is None or labeling.pixels is None:
        return _nothing(labeling.reason)
    ids = np.array([point.id for point in marker.control_points], dtype=np.intp)
    return Detection(True, ids, labeling.pixels, blobs.center[labeling.blobs])


def _nothing(reason: str) -> Detection:
    empty = np.zeros((0, 2))
    return Detection(False, np.zeros(0, dtype=np.intp), empty, empty, reason)
