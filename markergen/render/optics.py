"""From covered area to grey levels: contrast, point spread, noise, quantization."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Optics:
    """What lens, light and sensor do to a view.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the Gaussian point spread function (PSF), px, on top of the pixel's own area.
    noise_grey : float
        Standard deviation of the noise, grey levels.
    dark, light : float
        Grey levels of ink and substrate, 0 to 255.

    Raises
    ------
    InputError
        If blur or noise is negative or not finite, or the levels are not 0 <= dark < light <= 255.
    """

    blur_px: float = 0.7
    noise_grey: float = 2.0
    dark: float = 30
    light: float = 225

    def __post_init__(self) -> None:
        for name in ("blur_px", "noise_grey"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise InputError(f"a {name} of 0 or more", f"{name}={value}", "give a finite number such as 0.7")
        if not 0 <= self.dark < self.light <= 255:
            raise InputError(
                "grey levels 0 <= dark < light <= 255", f"dark={self.dark}, light={self.light}", "give such levels"
            )


FINENESS = 2
"""Subpixels along each side of a pixel in which the scene is drawn and blurred.

A lens blurs before the sensor samples. Blurring whole pixels instead leaves the aliasing of a sharp image in, which
moves a dot's center by 0.002 px, as much as all the noise may; with half pixels 0.0005 px are left, and finer ones
change nothing any more.
"""

DEFAULT_OPTICS = Optics()
"""A sharp lens and a sensor in good light."""


def expose(coverage: Array, optics: Optics, rng: np.random.Generator) -> NDArray[np.float32]:
    """Grey image of what is ink: blurred, collected by the pixels, noisy; neither clipped nor rounded.

    Parameters
    ----------
    coverage : array (FINENESS h, FINENESS w)
        Fraction of each subpixel's area that is ink.

    Returns
    -------
    array (h, w), grey levels
    """
    import cv2

    ink = coverage.astype(np.float32)
    if optics.blur_px > 0:
        # Past the image's edge the scene goes on as it was there.
        ink = cv2.GaussianBlur(ink, (0, 0), optics.blur_px * FINENESS, borderType=cv2.BORDER_REPLICATE)
    height, width = coverage.shape
    # With a whole factor this is the mean over each pixel's subpixels.
    pixels = cv2.resize(ink, (width // FINENESS, height // FINENESS), interpolation=cv2.INTER_AREA)
    grey = np.float32(optics.light) - np.float32(optics.light - optics.dark) * pixels
    if optics.noise_grey > 0:
        grey += np.float32(optics.noise_grey) * rng.standard_normal(grey.shape, dtype=np.float32)
    return grey


def quantize(grey: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Round to the nearest of the 256 levels; what lies beyond them saturates, as on a sensor."""
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
