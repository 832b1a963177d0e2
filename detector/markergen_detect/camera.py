"""A camera in plain numbers, and as the compiled core takes it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from markergen_detect.core import constants, library, pointer, struct
from markergen_detect.description import DescriptionError, parsed

LENSES = {
    "none": ("PINHOLE", (0,)),
    "radtan": ("BROWN_CONRADY", (4, 5)),
    "rational": ("BROWN_CONRADY", (8, 12, 14)),
    "equidistant": ("EQUIDISTANT", (4,)),
}
"""Lens models: kinds in the core, and numbers of coefficients in OpenCV's order, 12 with thin prisms, 14 tilted."""
_ALIASES = {"plumb_bob": "radtan", "rational_polynomial": "rational", "fisheye": "equidistant", "equi": "equidistant"}

LARGEST_RADIUS = 1e6
"""Largest radius of normalized coordinates: 0.2 arc seconds short of a right angle to the optical axis."""
LARGEST_SIDE = 20_000
LARGEST_ERROR_PX = 0.05
"""Largest error of a sampled map, well below that of most dots."""

CameraLike = Union["Camera", Mapping[str, Any], str, "os.PathLike[str]"]


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera, in px; pixel centers have whole coordinates.

    Attributes
    ----------
    width, height : int
    fx, fy, cx, cy : float
    model : str
        A key of `LENSES`, or ``sampled``.
    coefficients : tuple of float
    map : array (rows, columns, 2) or None
        Of a sampled lens: normalized coordinates (X/z, Y/z) at even steps over the image, from its outer edge at -0.5
        px to width - 0.5; nan where no ray is.
    error_px : float
        Largest error of the map between its nodes.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: str = "none"
    coefficients: "tuple[float, ...]" = ()
    map: "NDArray[np.float64] | None" = None
    error_px: float = 0.0

    def __post_init__(self) -> None:
        if not (1 <= self.width <= LARGEST_SIDE and 1 <= self.height <= LARGEST_SIDE):
            raise DescriptionError(f"expected an image of 1 to {LARGEST_SIDE} px, found {self.width}x{self.height}")
        numbers = np.array([self.fx, self.fy, self.cx, self.cy, *self.coefficients], dtype=float)
        if not (np.isfinite(numbers).all() and self.fx > 0 and self.fy > 0):
            raise DescriptionError("expected finite numbers of a camera, and focal lengths above 0")
        if self.map is not None:
            object.__setattr__(self, "map", np.ascontiguousarray(self.map, dtype=float))
        if self.model == "sampled":
            if self.map is None or self.map.ndim != 3 or min(self.map.shape[:2]) < 4 or self.map.shape[2] != 2:
                raise DescriptionError("expected a map (rows, columns, 2) of a sampled lens, with at least 4 x 4 nodes")
            if not 0 <= self.error_px <= LARGEST_ERROR_PX:
                raise DescriptionError(
                    f"expected a map true to {LARGEST_ERROR_PX} px, found {self.error_px}: sample it finer"
                )
        elif self.model not in LENSES or len(self.coefficients) not in LENSES[self.model][1]:
            known = "; ".join(f"{name} {' or '.join(map(str, counts))}" for name, (_, counts) in LENSES.items())
            actual = f"{self.model!r} with {len(self.coefficients)}"
            raise DescriptionError(f"expected a lens with a number of coefficients of {known}, found {actual}")

    @classmethod
    def load(cls, source: CameraLike) -> "Camera":
        """Read a camera from a dict, or a JSON file with one: README.md has its keys."""
        if isinstance(source, Camera):
            return source
        values = source if isinstance(source, Mapping) else parsed(Path(source))
        lens = values.get("distortion") or {"model": "none", "coefficients": []}
        try:
            fx, fy, cx, cy = (float(values[name]) for name in ("fx", "fy", "cx", "cy"))
            grid = None if lens.get("map") is None else np.array(lens["map"], dtype=float)
            coefficients = tuple(float(value) for value in lens.get("coefficients", ()))
            model = _ALIASES.get(lens["model"], lens["model"])
            width, height, error = int(values["width"]), int(values["height"]), float(lens.get("error_px", 0))
            return cls(width, height, fx, fy, cx, cy, model, coefficients, grid, error)
        except KeyError as error:
            raise DescriptionError(f"the camera's key {error} is missing") from error
        except (TypeError, ValueError) as error:
            raise error if isinstance(error, DescriptionError) else DescriptionError(f"the camera: {error}") from error

    @property
    def reach(self) -> float:
        """Radius of normalized coordinates up to which the lens is one-to-one: its Jacobian is positive definite."""
        if self.model == "equidistant":
            k = self.coefficients
            angle = np.sqrt(_first_root([1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]]))
            return min(float(np.tan(angle)), LARGEST_RADIUS) if angle < np.pi / 2 else LARGEST_RADIUS
        if self.model not in ("radtan", "rational"):
            return LARGEST_RADIUS
        # The eigenvalues (s r)' and s are lowered by at most 6 |p| r by p1 and p2, 2 |s| r + 4 |s'| r^3 by prisms.
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*self.coefficients, *[0.0] * 12)[:12]
        terms = [0, 1], [1, 0, k1, 0, k2, 0, k3], [1, 0, k4, 0, k5, 0, k6]
        r, above, below = (np.polynomial.Polynomial(ascending) for ascending in terms)
        steep = above * below + r * (above.deriv() * below - above * below.deriv())
        loss = (6 * np.hypot(p1, p2) + 2 * np.hypot(s1, s3)) * r + 4 * np.hypot(s2, s4) * r**3
        conditions = (steep - loss * below**2, above - loss * below, below)
        return min(LARGEST_RADIUS, *(_first_root(condition.trim().coef) for condition in conditions))

    def rays(self, pixels: "NDArray[np.float64]") -> "NDArray[np.float64]":
        """Normalized coordinates (n, 2) of pixels (n, 2); nan where no ray is."""
        rays, packed = np.full((len(pixels), 2), np.nan), self.packed()
        for pixel, ray in zip(pixels, rays, strict=True):
            if not library().lens_ray(pointer(packed), *map(float, pixel), pointer(ray)):
                ray[:] = np.nan
        return rays

    def packed(self) -> "NDArray[np.void]":
        """Return the camera's structure (1,) in the core; a map must outlive it."""
        numbers = {name: getattr(self, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "reach")}
        if self.map is not None:
            numbers |= {"map": self.map, "rows": len(self.map), "columns": self.map.shape[1]}
        kind = constants()["SAMPLED" if self.model == "sampled" else LENSES[self.model][0]]
        packed = struct("Camera", [], lens=kind, count=len(self.coefficients), **numbers)
        packed["c"][0, : len(self.coefficients)] = self.coefficients
        return packed


def _first_root(ascending: Any) -> float:
    """Smallest positive root of 1 + c1 r + c2 r^2 + ..., inf if there is none.

    The roots of the reversed polynomial are 1/r; it is monic, so that tiny leading coefficients do no harm. Double
    roots, which rounding may split into two complex ones, count.
    """
    inverse = np.roots(ascending)
    real = inverse.real[(np.abs(inverse.imag) <= 1e-6 * np.abs(inverse)) & (inverse.real > 0)]
    return float(1 / real.max()) if real.size and real.max() > 1e-300 else np.inf
