"""The camera: image size, intrinsics and lens distortion."""

import sys
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.maths import distortion as lens
from markergen.maths.lenses import LENSES
from markergen.maths.projection import from_pixels, perspective, to_camera, to_pixels
from markergen.model.findings import brief

Array = NDArray[np.float64]

LARGEST_SIDE = 20_000
"""Largest width and height of an image in px: above every camera there is."""


LARGEST_COEFFICIENT = 1e12
"""Largest distortion coefficient: k3 of a long telephoto lens may reach 1e9."""


@dataclass(frozen=True)
class Distortion:
    """Distortion of a lens, on normalized coordinates; the formulas and the domain are those of `maths.distortion`.

    Attributes
    ----------
    model : str
        ``none``, ``radtan`` (Brown-Conrady), ``rational``, ``equidistant`` (the fisheye of OpenCV and Kalibr), or
        another one of `markergen.maths.lenses.LENSES`.
    coefficients : tuple of float
        In OpenCV's order: radtan k1 k2 p1 p2 [k3]; rational k1 k2 p1 p2 k3 k4 k5 k6; equidistant k1 k2 k3 k4.

    Raises
    ------
    InputError
        If the model is unknown, or the coefficients are too many, too few, not finite or beyond 1e12.
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model not in LENSES:
            raise InputError("a known distortion model", brief(self.model), f"known: {', '.join(LENSES)}")
        counts = [len(names) for names in LENSES[self.model].coefficients]
        if len(self.coefficients) not in counts:
            raise InputError(
                f"{' or '.join(map(str, counts))} coefficients of the distortion model {self.model!r}",
                str(len(self.coefficients)),
                f"give {' or '.join(' '.join(names) or 'none' for names in LENSES[self.model].coefficients)}",
            )
        for name, value in zip(self.names, self.coefficients, strict=True):
            if not abs(value) <= LARGEST_COEFFICIENT:  # NaN fails every comparison.
                raise InputError("finite distortion coefficients", f"{name}={value}", "check the calibration")
        object.__setattr__(self, "coefficients", tuple(float(value) for value in self.coefficients))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, in their order."""
        return next(names for names in LENSES[self.model].coefficients if len(names) == len(self.coefficients))


NO_DISTORTION = Distortion()


@dataclass(frozen=True)
class Camera:
    """A camera; all in px, pixel centers at integer coordinates, (0, 0) the middle of the top-left pixel.

    Without distortion a pinhole camera, whose pixels are called ideal px.

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
    distortion: Distortion = NO_DISTORTION

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
        return self if self.distortion == NO_DISTORTION else replace(self, distortion=NO_DISTORTION)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the k parameters, in the order of `parameter_jacobian`: fx, fy, cx, cy, then the distortion's."""
        return ("fx", "fy", "cx", "cy", *self.distortion.names)

    def as_dict(self) -> dict[str, Any]:
        """Return the camera as plain JSON values in px; without distortion, the word does not appear."""
        values = asdict(self.ideal)
        del values["distortion"]
        if self.distortion != NO_DISTORTION:
            model, coefficients = self.distortion.model, list(self.distortion.coefficients)
            values["distortion"] = {"model": model, "coefficients": coefficients}
        return values

    def to_pixels(self, normalized: Array) -> Array:
        """Image points (..., 2) in px of normalized coordinates (..., 2) = (X/z, Y/z), through the lens.

        nan beyond the radius at which the distortion turns over (see `maths.distortion`): nothing is seen there.
        """
        return to_pixels(self._distorted(normalized), self.matrix)

    def from_pixels(self, pixels: Array) -> Array:
        """Undo `to_pixels`, to 1e-13 of the focal length; nan where no ray comes to that pixel."""
        normalized = from_pixels(pixels, self.matrix)
        return lens.undistort(self.distortion.model, normalized, self.distortion.coefficients)

    def pixel_jacobian(self, normalized: Array) -> Array:
        """Derivative (..., 2, 2) of `to_pixels`, px; nan where that is nan."""
        if self.distortion == NO_DISTORTION:
            return np.broadcast_to(np.diag(self.focal), (*normalized.shape[:-1], 2, 2))
        jacobian = lens.distortion_jacobian(self.distortion.model, normalized, self.distortion.coefficients)
        return self.focal[:, None] * jacobian

    def parameter_jacobian(self, normalized: Array) -> Array:
        """Derivative (..., 2, k) of `to_pixels` by the k `parameter_names`; nan where that is nan."""
        model, coefficients = self.distortion.model, self.distortion.coefficients
        distorted = self._distorted(normalized)
        jacobian = np.zeros((*normalized.shape[:-1], 2, 4 + len(coefficients)))
        jacobian[..., 0, 0], jacobian[..., 1, 1] = distorted[..., 0], distorted[..., 1]
        jacobian[..., 0, 2] = jacobian[..., 1, 3] = 1
        jacobian[..., 4:] = self.focal[:, None] * lens.coefficient_jacobian(model, normalized, coefficients)
        jacobian[np.isnan(distorted).any(axis=-1)] = np.nan
        return jacobian

    def project(self, points: Array, rotation: Array, translation: Array) -> Array:
        """Image points (..., P, n, 2) in px of marker points (..., n, 2 or 3) under P poses, through the lens.

        Points behind the camera come out mirrored, as the formula has it; `to_camera` tells the depth.
        """
        return self.to_pixels(perspective(to_camera(points, rotation, translation)))

    def sees(self, pixels: Array) -> NDArray[np.bool_]:
        """Tell which points (..., 2) lie on the sensor, from the first pixel's outer edge to the last one's; nan no."""
        size = np.array([self.width, self.height])
        return np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=-1)

    def _distorted(self, normalized: Array) -> Array:
        return lens.distort(self.distortion.model, normalized, self.distortion.coefficients)


PAPER_CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0)
"""The simulated camera of Acuna & Willert (2018), section IV."""
