"""Conversion of covered area to grey levels: contrast, point spread, illumination, noise, quantization.

Point spread functions are kernels of unit sum, symmetric about their center, so they shift nothing.
"""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from markergen.arrays import Array
from markergen.defaults import BLUR_PX, DARK, LIGHT, NOISE_GREY
from markergen.errors import InputError
from markergen.geometry.coverage import polygon_coverage
from markergen.units import parse_settings

Grey = NDArray[np.float32]

FULL_SCALE = 255.0
"""Grey level at which the sensor saturates, for any bit depth."""

LARGEST_PSF_PX = 100.0
"""Maximum width of a blur in px, far beyond what any dot survives; the kernel's memory grows with its square."""

AIRY_RINGS = 6
"""Radius at which the Airy pattern ends, in those of its first dark ring; 2.8 % of its light is beyond and left out."""
AIRY_SIGMA = 0.42
"""Standard deviation, in radii of the first dark ring, of the Gaussian whose edges have slopes of the same energy."""
_AIRY_FINENESS = 9
"""Points per side of a subpixel at which the Airy pattern is summed; with 5, kernels differ by 1e-3 of their sum."""

_DISK_VERTICES = 720
"""Number of vertices of a disk of defocus, whose polygon lacks 1.3e-5 of its area."""


@dataclass(frozen=True)
class Optics:
    """Effects of lens, light and sensor on a view. Grey levels run from 0 to 255 for any bit depth.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the Gaussian point spread function (PSF), px, in addition to the pixel's own area.
    noise_grey : float
        Standard deviation of the signal-independent noise (read noise), grey levels.
    dark, light : float
        Grey levels of ink and substrate, 0 to 255, at exposure 1 and in full light.
    defocus_px : float
        Radius of the disk over which a defocused lens spreads a point, px.
    diffraction_px : float
        Radius of the first dark ring of the Airy pattern, px.
    aperture_mm, focus, wavelength_nm : float
        Diameter of a thin lens's aperture, the depth at which it is focused in m, and the wavelength of the light,
        which determine both by the depth of what is seen (see `at`). 0 for those that are given above.
    motion_px, motion_deg : float
        Length of the line over which motion spreads a point, px, and its direction from x toward y.
    exposure : float
        Factor on all grey levels; levels above 255 saturate.
    vignetting : float
        Share of light lost at the image corners, 0 to below 1: cos^4 of an angle whose tangent is proportional to the
        distance from the image center.
    gradient, gradient_deg : float
        Change of illumination from one end of the image to the other, relative to the center, 0 to below 2, and the
        direction from x toward y in which it gets brighter.
    full_well : float or None
        Electrons at grey level 255, which determine the shot noise; None for no shot noise.
    bits : int
        Bit depth of the sensor, 8 to 16; above 8, images are uint16 with levels up to 2^bits - 1.

    Raises
    ------
    InputError
        If a number is not finite or out of its range, or the levels are not 0 <= dark < light <= 255.
    """

    blur_px: float = BLUR_PX
    noise_grey: float = NOISE_GREY
    dark: float = DARK
    light: float = LIGHT
    defocus_px: float = 0.0
    motion_px: float = 0.0
    motion_deg: float = 0.0
    exposure: float = 1.0
    vignetting: float = 0.0
    gradient: float = 0.0
    gradient_deg: float = 0.0
    full_well: float | None = None
    bits: int = 8
    diffraction_px: float = 0.0
    aperture_mm: float = 0.0
    focus: float = 1.0
    wavelength_nm: float = 550.0

    def __post_init__(self) -> None:
        for name in ("blur_px", "defocus_px", "motion_px", "diffraction_px"):
            self._require(name, 0 <= getattr(self, name) <= LARGEST_PSF_PX, f"of 0 to {LARGEST_PSF_PX:g}", "0.7")
        self._require("noise_grey", 0 <= self.noise_grey <= FULL_SCALE, f"of 0 to {FULL_SCALE:g}", "2")
        self._require("exposure", 0 < self.exposure <= 1000, "above 0, to 1000", "1")
        self._require("vignetting", 0 <= self.vignetting < 1, "of 0 to below 1", "0.3")
        self._require("gradient", 0 <= self.gradient < 2, "of 0 to below 2", "0.5")
        for name in ("motion_deg", "gradient_deg"):
            self._require(name, isfinite(getattr(self, name)), "in degrees", "45")
        if self.full_well is not None:
            self._require("full_well", 1 <= self.full_well <= 1e9, "of 1 to 1e9 electrons", "10000")
        self._require("bits", self.bits in range(8, 17), "of 8 to 16", "8")
        self._require("aperture_mm", 0 <= self.aperture_mm <= 1000, "of 0 to 1000", "2")
        self._require("focus", 0.001 <= self.focus <= 1e6, "of 1 mm to 1000 km, in m", "0.8")
        self._require("wavelength_nm", 100 <= self.wavelength_nm <= 20000, "of 100 to 20000", "550")
        self._require(
            "aperture_mm", not (self.aperture_mm and (self.defocus_px or self.diffraction_px)),
            "without defocus_px and diffraction_px, which follow from it", "0",
        )  # fmt: skip
        if not 0 <= self.dark < self.light <= FULL_SCALE:
            raise InputError(
                "grey levels 0 <= dark < light <= 255", f"dark={self.dark}, light={self.light}", "give such levels"
            )

    def _require(self, name: str, fits: bool, what: str, example: str) -> None:
        if not fits:
            raise InputError(f"{name} {what}", f"{name}={getattr(self, name)}", f"give a number such as {example}")

    @property
    def edge_blur(self) -> float:
        """Standard deviation in px of an edge's blur by PSF and pixel area, averaged over edge directions.

        Variances add: blur^2 + defocus^2/4 (disk) + motion^2/24 (line, half of it across the mean edge) + 1/12 (pixel)
        + `AIRY_SIGMA`^2 diffraction^2. In a bound, a Gaussian of this width stands for all of them: the energy of the
        slope agrees within 5 %.
        """
        lens = self.blur_px**2 + self.defocus_px**2 / 4 + (AIRY_SIGMA * self.diffraction_px) ** 2
        return float(np.sqrt(lens + self.motion_px**2 / 24 + 1 / 12))

    @property
    def reach_px(self) -> int:
        """Distance in px, rounded up, beyond which a point has no effect on the image; the Gaussian ends at 4 sigma."""
        lens = 4 * self.blur_px + self.defocus_px + AIRY_RINGS * self.diffraction_px
        return int(np.ceil(lens + self.motion_px / 2)) + 2

    def at(self, focal: float, depth: float) -> "Optics":
        """Optics for what is seen at a depth in m, with a focal length in px; the same without an aperture.

        A thin lens of aperture A, focused at depth z0, spreads a point at depth z over a disk of radius
        f A/2 |1/z - 1/z0|, f being the focal length in px of the focused camera, and light of wavelength l over an Airy
        pattern whose first dark ring has the radius 1.22 f l/A.
        """
        if not self.aperture_mm or depth <= 0:
            return self
        aperture = 1e-3 * self.aperture_mm
        return replace(
            self,
            aperture_mm=0.0,
            defocus_px=min(focal * aperture / 2 * abs(1 / depth - 1 / self.focus), LARGEST_PSF_PX),
            diffraction_px=min(1.22 * focal * 1e-9 * self.wavelength_nm / aperture, LARGEST_PSF_PX),
        )

    def grey_noise(self, level: ArrayLike) -> Array:
        """Standard deviation (...) of read, shot and quantization noise at given grey levels (...), in grey levels.

        Variances add: noise_grey^2 + 255 level/full_well (Poisson) + q^2/12 with q = 255/(2^bits - 1).
        """
        shot = 0.0 if self.full_well is None else FULL_SCALE / self.full_well
        step = FULL_SCALE / (2**self.bits - 1)
        return np.sqrt(self.noise_grey**2 + shot * np.maximum(level, 0.0) + step**2 / 12)


def optics_from_text(text: str) -> Optics:
    """Parse optics from ``name=value,...``; omitted parameters keep their defaults, as all do for empty text.

    Raises
    ------
    InputError
        If a name is unknown or repeated, a value is not a number, or the optics are impossible.
    """
    return Optics(**parse_settings(text, [field.name for field in fields(Optics)], "optics"))  # type: ignore[arg-type]


FINENESS = 2
"""Subpixels per side of a pixel at which the scene is drawn and blurred.

A lens blurs before the sensor samples. Blurring whole pixels instead keeps the aliasing of a sharp image, which shifts
a dot's center by 0.002 px, as much as all the noise may; with half pixels 0.0005 px remain, and finer ones bring no
further gain.
"""

DEFAULT_OPTICS = Optics()
"""A sharp lens and a sensor in good light."""


def expose(
    coverage: NDArray[np.floating],
    optics: Optics,
    rng: np.random.Generator,
    corner: ArrayLike = (0, 0),
    size: tuple[int, int] | None = None,
) -> Grey:
    """Grey image of an ink coverage: blurred, integrated over pixels, illuminated, noisy; neither clipped nor rounded.

    Parameters
    ----------
    coverage : array (FINENESS h, FINENESS w)
        Fraction of each subpixel's area that is ink.
    corner, size : (left, top) and (height, width), px
        Position of the coverage in the image, with only substrate around it, and the image size; by default they agree.

    Returns
    -------
    array (height, width), grey levels
    """
    import cv2

    rows, columns = coverage.shape[0] // FINENESS, coverage.shape[1] // FINENESS
    ink = _spread(coverage.astype(np.float32, copy=False), optics)
    # For an integer factor this is the mean over each pixel's subpixels.
    pixels = cv2.resize(ink, (columns, rows), interpolation=cv2.INTER_AREA)
    left, top = np.asarray(corner).tolist()
    grey = np.full(size or (rows, columns), optics.light, dtype=np.float32)
    grey[top : top + rows, left : left + columns] -= np.float32(optics.light - optics.dark) * pixels
    light = illumination(optics, grey.shape[1], grey.shape[0])
    if light is not None:
        grey *= light
    if optics.full_well is not None:
        per_electron = FULL_SCALE / optics.full_well
        grey = (per_electron * rng.poisson(np.maximum(grey, 0) / per_electron)).astype(np.float32)
    if optics.noise_grey > 0:
        grey += np.float32(optics.noise_grey) * rng.standard_normal(grey.shape, dtype=np.float32)
    return grey


def _spread(ink: Grey, optics: Optics) -> Grey:
    """Blur subpixels by all point spread functions, replicating the scene beyond the image border."""
    import cv2

    if optics.blur_px > 0:
        ink = cv2.GaussianBlur(ink, (0, 0), optics.blur_px * FINENESS, borderType=cv2.BORDER_REPLICATE)
    if optics.defocus_px > 0:
        ink = cv2.filter2D(ink, -1, disk_kernel(optics.defocus_px * FINENESS), borderType=cv2.BORDER_REPLICATE)
    if optics.diffraction_px > 0:
        ink = cv2.filter2D(ink, -1, airy_kernel(optics.diffraction_px * FINENESS), borderType=cv2.BORDER_REPLICATE)
    if optics.motion_px > 0:
        kernel = line_kernel(optics.motion_px * FINENESS, optics.motion_deg)
        ink = cv2.filter2D(ink, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return ink


@lru_cache(maxsize=16)
def disk_kernel(radius: float) -> Array:
    """Exact coverage (2k + 1, 2k + 1) of a centered disk; its radius is in px of the kernel."""
    angle = 2 * np.pi * np.arange(_DISK_VERTICES) / _DISK_VERTICES
    return _kernel(radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


@lru_cache(maxsize=16)
def airy_kernel(radius: float) -> Array:
    """Airy pattern (2k + 1, 2k + 1), (2 J1(x)/x)^2 with its first zero at `radius` in px of the kernel."""
    from scipy.special import j1, jn_zeros

    half = int(np.ceil(AIRY_RINGS * radius))
    fine = (np.arange((2 * half + 1) * _AIRY_FINENESS) + 0.5) / _AIRY_FINENESS - half - 0.5
    distance = np.hypot(*np.meshgrid(fine, fine))
    x = np.maximum(jn_zeros(1, 1)[0] * distance / radius, 1e-9)
    light = np.where(distance <= AIRY_RINGS * radius, (2 * j1(x) / x) ** 2, 0.0)
    kernel = light.reshape(2 * half + 1, _AIRY_FINENESS, 2 * half + 1, _AIRY_FINENESS).sum(axis=(1, 3))
    return _of_unit_sum(kernel)


@lru_cache(maxsize=16)
def line_kernel(length: float, direction_deg: float) -> Array:
    """Exact coverage (2k + 1, 2k + 1) of a centered line; its length is in px of the kernel.

    The line is 0.01 px wide, which adds practically nothing to the kernel's spread.
    """
    angle = np.deg2rad(direction_deg)
    along = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    across = np.array([-np.sin(angle), np.cos(angle)]) * 0.005
    return _kernel(np.array([along + across, -along + across, -along - across, along - across]))


def _kernel(outline: Array) -> Array:
    half = int(np.ceil(np.abs(outline).max() + 0.5))
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    tile, top, left = polygon_coverage([outline + half], 2 * half + 1, 2 * half + 1)
    kernel[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return _of_unit_sum(kernel)


def _of_unit_sum(kernel: Array) -> Array:
    # Already symmetric and nonnegative except for rounding.
    kernel = np.abs(kernel + kernel[::-1, ::-1])
    return np.asarray(kernel / kernel.sum())


def illumination(optics: Optics, width: int, height: int) -> Grey | None:
    """Factor (h, w) on the grey levels from exposure, vignetting and gradient; None if it is 1 everywhere."""
    if optics.exposure == 1 and optics.vignetting == 0 and optics.gradient == 0:
        return None
    pixels = np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), axis=-1)
    return light_at(optics, pixels, width, height).astype(np.float32)


def light_at(optics: Optics, pixels: Array, width: int, height: int) -> Array:
    """Factor (...) on the grey levels at pixels (..., 2) of an image from exposure, vignetting and gradient."""
    # Relative to the image center.
    x = pixels[..., 0] - (width - 1) / 2
    y = pixels[..., 1] - (height - 1) / 2
    corner_tangent_square = 1 / np.sqrt(1 - optics.vignetting) - 1
    square = (x**2 + y**2) / ((width**2 + height**2) / 4)
    angle = np.deg2rad(optics.gradient_deg)
    extent = width * abs(np.cos(angle)) + height * abs(np.sin(angle))
    slope = 1 + optics.gradient * (x * np.cos(angle) + y * np.sin(angle)) / extent
    return np.asarray(optics.exposure * slope / (1 + corner_tangent_square * square) ** 2)


def quantize(grey: Grey, bits: int = 8) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Round to the nearest of 2^bits levels, uint8 or uint16; levels out of range saturate, as on a sensor."""
    top = 2**bits - 1
    if bits == 8:
        return np.clip(np.rint(grey), 0, top).astype(np.uint8)
    return np.clip(np.rint(grey * np.float32(top / FULL_SCALE)), 0, top).astype(np.uint16)
