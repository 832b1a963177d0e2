"""What browsers draw of an SVG, by resvg; `markergen.guard` runs this script in a child process for `SVG`."""

# tests: tests/verification/test_flat.py

from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, reason_of

FINEST, MOST_PIXELS = 300, 24_000_000
"""Pixels per inch at most, and pixels at most: as of a PDF."""

DPI = 96
"""Pixels of CSS per inch, in which resvg has widths in mm."""


def prepare() -> None:
    """Import what takes time."""
    import resvg_py  # noqa: F401


def render(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the grey levels of an SVG on white paper as ``picture``."""
    import cv2
    import resvg_py

    def drawn(zoom: float) -> NDArray[np.uint8]:
        text = data.decode("utf-8")
        try:
            png = resvg_py.svg_to_bytes(svg_string=text, dpi=DPI, zoom=zoom, background="white", skip_system_fonts=True)
        # Besides errors of its own it panics.
        except BaseException as error:
            raise InputError("an SVG that browsers draw", reason_of(error), "save it again") from None
        grey = cv2.imdecode(np.frombuffer(bytes(png), dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
        return np.asarray(grey, dtype=np.uint8)

    # A thumbnail tells its size, whatever unit that is in.
    small = drawn(0.1)
    fine = min(FINEST / DPI, (MOST_PIXELS / (100 * small.size)) ** 0.5)
    return {}, {"picture": drawn(fine)}
