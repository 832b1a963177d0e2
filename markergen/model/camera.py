"""The camera: image size and intrinsics."""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError

Array = NDArray[np.float64]

LARGEST_SIDE = 20_000
"""Largest width and height of an image in px: above every camera there is."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; all in px, pixel centers at integer coordinates, (0, 0) the middle of the top-left pixel.

    Raises
    ------
    InputError
        If a side is not 1 to 20000 px, a focal length is not a positive finite number, or the principal point is
        not finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not (1 <= self.width <= LARGEST_SIDE and 1 <= self.height <= LARGEST_SIDE):
            raise InputError(
                f"an image size of 1 to {LARGEST_SIDE} pixels",
                f"{self.width}x{self.height}",
                "give the camera's width and height in pixels",
            )
        # Compared, not converted: an integer may be too large for a float. NaN fails every comparison.
        largest = sys.float_info.max
        if not (0 < self.fx <= largest and 0 < self.fy <= largest):
            raise InputError("finite positive focal lengths", f"fx={self.fx}, fy={self.fy}", "check the camera matrix")
        if not (abs(self.cx) <= largest and abs(self.cy) <= largest):
            raise InputError("a finite principal point", f"cx={self.cx}, cy={self.cy}", "check the camera matrix")

    @property
    def matrix(self) -> Array:
        """K = [fx 0 cx; 0 fy cy; 0 0 1], shape (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=float)

    @property
    def focal(self) -> Array:
        """Focal lengths (fx, fy) in px, shape (2,)."""
        return np.array([self.fx, self.fy], dtype=float)

    def sees(self, pixels: Array) -> NDArray[np.bool_]:
        """Tell which points (..., 2) lie on the sensor, from the first pixel's outer edge to the last one's."""
        size = np.array([self.width, self.height])
        return np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=-1)


PAPER_CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0)
"""The simulated camera of Acuna & Willert (2018), section IV."""
