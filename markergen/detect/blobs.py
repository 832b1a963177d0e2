"""Dot candidates: dark regions with the outline of an ellipse, fitted to the grey levels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.detect.ellipse import fit_dot
from markergen.errors import InputError

Array = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]

MAX_BLOBS = 256
"""Candidates that are kept, largest first; more are clutter, and each costs a millisecond."""

_NOISE_FACTOR = 6.0
"""Ink and substrate must differ by this many times the noise; in noise alone Otsu's classes differ by under 3."""

_MIN_SEMI_PX = 1.5
_MAX_ELONGATION = 8.0
_MIN_FILL = 0.85
"""Contour area over that of the ellipse with equal second moments: 1 for ellipses, less for shapes with arms."""


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
    """

    center: Array
    semi: Array
    angle: Array
    ring: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.center)


def detect_dots(image: Image) -> Blobs:
    """Find dark elliptic dots on a lighter ground.

    The darkness below the local mean is split by Otsu's threshold, so that slow changes of light do not matter; the
    regions' second moments start a fit of ellipse, grey levels and blur to the grey levels (`fit_dot`).

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
        If the image is not a grey image of uint8 or uint16.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise InputError(
            "a grey image (h, w) of uint8 or uint16", f"{image.shape} of {image.dtype}", "convert the image to grey"
        )
    grey = image.astype(np.float64)
    fits = [fit_dot(grey, center, moments) for center, moments in _dark_regions(image)]
    found = [fit for fit in fits if fit is not None]
    return Blobs(
        center=np.array([fit.center for fit in found]).reshape(-1, 2),
        semi=np.array([fit.semi for fit in found]).reshape(-1, 2),
        angle=np.array([fit.angle for fit in found], dtype=float),
        ring=np.array([fit.ring for fit in found], dtype=bool),
    )


def _dark_regions(image: Image) -> list[tuple[Array, Array]]:
    """Center (2,) and covariance (2, 2) of the area of each dark region that could be a dot, largest first."""
    import cv2

    height, width = image.shape
    if min(height, width) < 3:
        return []
    # Half the shorter side: a dot as large as the window still leaves the mean well above its own level.
    window = min(height, width) // 2 | 1
    darkness = cv2.subtract(cv2.blur(image, (window, window), borderType=cv2.BORDER_REFLECT_101), image)
    threshold, mask = cv2.threshold(darkness, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    mask = mask.astype(np.uint8)
    if threshold < _NOISE_FACTOR / 2 * _noise(image) or not mask.any():
        return []
    # Only outermost borders count: what lies inside a ring's hole belongs to the ring.
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    regions = []
    for contour in contours:
        left, top, w, h = cv2.boundingRect(contour)
        at_edge = left < 1 or top < 1 or left + w > width - 1 or top + h > height - 1
        if at_edge or min(w, h) < 2 * _MIN_SEMI_PX:
            continue
        moments = cv2.moments(contour)
        area = moments["m00"]
        if area <= 0:
            continue
        center = np.array([moments["m10"], moments["m01"]]) / area
        covariance = np.array([[moments["mu20"], moments["mu11"]], [moments["mu11"], moments["mu02"]]]) / area
        least, most = np.linalg.eigvalsh(covariance)
        if least <= 0 or most > _MAX_ELONGATION**2 * least:
            continue
        if area < _MIN_FILL * 4 * np.pi * np.sqrt(least * most):
            continue
        regions.append((area, center, covariance))
    regions.sort(key=lambda region: -region[0])
    return [(center, covariance) for _, center, covariance in regions[:MAX_BLOBS]]


def _noise(image: Image) -> float:
    """Standard deviation of the grey noise, from the median difference of neighbors in every eighth row."""
    rows = image[::8].astype(np.int32)
    # 0.6745 is the median of |N(0, 1)|; a difference of two pixels has sqrt(2) times the noise of one.
    return float(np.median(np.abs(np.diff(rows, axis=1))) / (0.6745 * np.sqrt(2)))
