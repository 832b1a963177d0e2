"""The camera: image size and intrinsics."""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.maths.projection import from_pixels, perspective, to_camera, to_pixels

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

    @property
    def ideal(self) -> "Camera":
        """The same camera without lens distortion."""
        return self

    def to_pixels(self, normalized: Array) -> Array:
        """Image points (..., 2) in px of normalized coordinates (..., 2) = (X/z, Y/z), through the lens."""
        return to_pixels(normalized, self.matrix)

    def from_pixels(self, pixels: Array) -> Array:
        """Undo `to_pixels`; nan where no ray comes to that pixel."""
        return from_pixels(pixels, self.matrix)

    def pixel_jacobian(self, normalized: Array) -> Array:
        """Derivative (..., 2, 2) of `to_pixels`, px."""
        return np.broadcast_to(np.diag(self.focal), (*normalized.shape[:-1], 2, 2))

    def parameter_jacobian(self, normalized: Array) -> Array:
        """Derivative (..., 2, k) of `to_pixels` by the k parameters (fx, fy, cx, cy, then the distortion's)."""
        jacobian = np.zeros((*normalized.shape[:-1], 2, 4))
        jacobian[..., 0, 0], jacobian[..., 1, 1] = normalized[..., 0], normalized[..., 1]
        jacobian[..., 0, 2] = jacobian[..., 1, 3] = 1
        return jacobian

    def project(self, points: Array, rotation: Array, translation: Array) -> Array:
        """Image points (..., P, n, 2) in px of marker points (..., n, 2 or 3) under P poses, through the lens.

        Points behind the camera come out mirrored, as the formula has it; `to_camera` tells the depth.
        """
        return self.to_pixels(perspective(to_camera(points, rotation, translation)))

    def sees(self, pixels: Array) -> NDArray[np.bool_]:
        """Tell which points (..., 2) lie on the sensor, from the first pixel's outer edge to the last one's."""
        size = np.array([self.width, self.height])
        return np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=-1)


PAPER_CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0)
"""The simulated camera of Acuna & Willert (2018), section IV."""
