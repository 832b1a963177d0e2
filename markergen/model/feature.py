"""Features: the printed shapes that mark control points."""
# tests: tests/model/test_model.py tests/model/test_marker.py

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from markergen.errors import InputError, brief

Polarity = Literal["dark", "light"]

DOT_PIXELS, RING_PIXELS = 2.5, 6.0
"""Mean diameter of an image, in px, below which a dot is hardly found, and a ring hardly distinguished from a disk.

It is the root of long times short axis. Of markers with eight such dots, or with a ring, three quarters and more are
found, from the front and tilted by 70 deg, at a blur of 1 px and a noise of 3 % of the contrast."""

RELIABLE_PIXELS = 6.0
"""Mean diameter of the images of dots, in px, from which on nearly all markers of them are found."""


@dataclass(frozen=True)
class Feature:
    """A disk, or a ring if it has an inner diameter; centered on the control point, in m.

    A diameter of 0 is a bare point: allowed in studies, refused by every exporter.

    Attributes
    ----------
    diameter, inner_diameter : float
        Outer and inner diameter, m.
    polarity : {"dark", "light"}
        Dark on a light ground, or light on a dark one.

    Raises
    ------
    InputError
        If a diameter is negative or not finite, the inner one is not below the outer, or the polarity is unknown.
    """

    diameter: float
    inner_diameter: float = 0.0
    polarity: Polarity = "dark"

    def __post_init__(self) -> None:
        sizes_fit = 0 <= self.inner_diameter < self.diameter or self.inner_diameter == self.diameter == 0
        if not (isfinite(self.diameter) and sizes_fit):
            raise InputError(
                "a dot diameter of 0 or more, above its inner diameter",
                f"diameter={self.diameter}, inner_diameter={self.inner_diameter}",
                "give a length such as 36mm",
            )
        if self.polarity not in ("dark", "light"):
            raise InputError("a polarity of dark or light", brief(self.polarity), "leave it out for dark dots")

    @property
    def kind(self) -> str:
        """``dot`` or ``ring``."""
        return "ring" if self.inner_diameter else "dot"

    @property
    def least_pixels(self) -> float:
        """Mean diameter of its image, in px, below which it is hardly found for what it is."""
        return RING_PIXELS if self.inner_diameter else DOT_PIXELS


def key_ring(diameter: float) -> Feature:
    """Return the key dot of a marker: a ring with an inner diameter of half the outer one, which fixes the labels."""
    return Feature(diameter, diameter / 2)
