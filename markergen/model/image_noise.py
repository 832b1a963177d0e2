"""What image a design reckons with: blur, noise and contrast of the dots."""

from dataclasses import asdict, dataclass
from math import hypot, isfinite, sqrt

from markergen.errors import InputError

PIXEL_VARIANCE = 1 / 12
"""Variance of a uniform unit interval: what the area of a pixel adds to the blur (px^2), rounding to the noise."""


@dataclass(frozen=True)
class ImageNoise:
    """The image that an image noise model is about.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the lens' Gaussian point spread, px, on top of the pixel's own area.
    noise_grey : float
        Standard deviation of the noise before rounding, grey levels.
    contrast : float
        Grey levels between dot and ground.

    Raises
    ------
    InputError
        If blur or noise is negative or not finite, or the contrast is not above 0 and at most 255.
    """

    blur_px: float = 0.7
    noise_grey: float = 2.0
    contrast: float = 195.0

    def __post_init__(self) -> None:
        for name in ("blur_px", "noise_grey"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise InputError(f"a {name} of 0 or more", f"{name}={value}", "give a finite number such as 0.7")
        if not 0 < self.contrast <= 255:
            raise InputError(
                "a contrast above 0 and at most 255 grey levels", f"contrast={self.contrast}", "give such a number"
            )

    @property
    def edge_px(self) -> float:
        """Sigma of an edge in the image, px: lens and pixel together."""
        return hypot(self.blur_px, sqrt(PIXEL_VARIANCE))

    @property
    def contrast_to_noise(self) -> float:
        """Contrast over the noise, rounding included."""
        return self.contrast / hypot(self.noise_grey, sqrt(PIXEL_VARIANCE))

    def as_dict(self) -> dict[str, float]:
        """Plain JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        return f"blur {self.blur_px:g} px, noise {self.noise_grey:g} and contrast {self.contrast:g} grey levels"
