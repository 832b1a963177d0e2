"""Dot candidates: dark regions with the outline of an ellipse, fitted to the grey levels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.detect.ellipse import Dots, fit_dots
from markergen.detect.noise import grey_noise
from markergen.detect.regions import find_regions
from markergen.errors import InputError
from markergen.read.images import LARGEST_FRAME

Array = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_SAME_PLACE, _SAME_SIZE = 0.5, 1.5
"""Share of the short semi-axis, and ratio of the semi-axes, within which two fits are of one dot."""


@dataclass(frozen=True, eq=False)
class Blobs:
    """B candidate dots of one image.

    Attributes
    ----------
    center : array (B, 2), px
        Of the image ellipse, which is not yet the image of the dot's center.
    semi : array (B, 2), px, longest first
    angle : array (B,), rad, of the longest axis from x
    ring : array (B,) of bool
        Bright in the middle.
    covariance : array (B, 2, 2), px^2
        Of the center, from the grey noise that the fit leaves.
    """

    center: Array
    semi: Array
    angle: Array
    ring: NDArray[np.bool_]
    covariance: Array

    def __len__(self) -> int:
        return len(self.center)


def detect_dots(image: Image) -> Blobs:
    """Find dark elliptic dots on a lighter ground.

    Regions that are darker than what is around them (`find_regions`) start a fit of ellipse, grey levels and blur to
    the image's grey levels (`fit_dots`).

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16

    Returns
    -------
    Blobs
        Empty for images without contrast. Dots cut off by the image's edge are left out.

    Raises
    ------
    InputError
        If the image is not a grey image of uint8 or uint16, or has more than LARGEST_FRAME.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise InputError(
            "a grey image (h, w) of uint8 or uint16", f"{image.shape} of {image.dtype}", "convert the image to grey"
        )
    if image.size > LARGEST_FRAME:
        raise InputError(
            f"an image of at most {LARGEST_FRAME // 10**6} megapixels",
            f"{image.shape[1]}x{image.shape[0]} px",
            "reduce its size, or cut out the part with the marker",
        )
    dots = fit_dots(image, find_regions(image), grey_noise(image))
    dots = dots.take(_distinct(dots))
    return Blobs(dots.center, dots.semi, dots.angle, dots.ring, dots.covariance)


def _distinct(dots: Dots) -> NDArray[np.intp]:
    """Indices of the dots without repetitions: fits that began in different regions can end in the same dot.

    Of dots that lie in the middle of each other and are about as large, the one whose center is known best stays.
    """
    kept: list[int] = []
    for i in np.argsort(np.trace(dots.covariance, axis1=-2, axis2=-1), kind="stable"):
        apart = np.linalg.norm(dots.center[kept] - dots.center[i], axis=-1) > _SAME_PLACE * dots.semi[i, 1]
        other_size = np.abs(np.log(dots.semi[kept] / dots.semi[i])).max(axis=-1) > np.log(_SAME_SIZE)
        if np.all(apart | other_size):
            kept.append(int(i))
    return np.sort(np.array(kept, dtype=np.intp))
