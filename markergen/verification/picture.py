"""What shows of a page: its grey level at any point, from pixels, several tiles, or painted shapes."""

# tests: tests/verification/test_flat.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array

WHITE = 255.0
"""Grey level of bare paper."""

CORNER = 0.015
"""Distance of the places at which the bare paper is looked at from the page's sides, as a share of them."""


@dataclass(frozen=True, eq=False)
class PagePicture:
    """Grey levels of a page.

    Attributes
    ----------
    sample : callable
        Maps points (k, 2) in mm, y up, to grey levels from 0 (black) to 255; nan where nothing is shown.
    grain : float
        Size of a pixel in mm; 0 if edges are exact.
    paper : float
        Grey level of the page near its corners, where nothing is printed.
    whole : bool
        False if it is put together from tiles, with lines along their seams.
    measured : bool
        True if the dots were measured in this picture rather than read from paths.
    bilevel : bool
        True if it has two grey levels, so that thin grey lines may be lost.
    """

    sample: Callable[[Array], Array]
    grain: float
    paper: float = WHITE
    whole: bool = True
    measured: bool = False
    bilevel: bool = False

    @staticmethod
    def of_pixels(grey: NDArray[np.uint8], box: Sequence[float], measured: bool = False) -> "PagePicture":
        """Picture of an image that fills a box (left, bottom, right, top) in mm."""
        size = np.array(grey.shape[::-1])
        inset = np.minimum(np.maximum((CORNER * size).astype(int), 1), size - 1)
        corners = [grey[y, x] for x in (inset[0], -inset[0] - 1) for y in (inset[1], -inset[1] - 1)]
        left, bottom, right, top = box
        scale = size / (right - left, bottom - top)

        def sample(points: Array) -> Array:
            # Pixel centers are at integers.
            return _interpolated(grey, (points - (left, top)) * scale - 0.5)

        levels = np.count_nonzero(np.bincount(grey[:: max(len(grey) // 2000, 1)].ravel()))
        grain, paper = float(1 / np.sqrt(abs(scale.prod()))), float(np.median(corners))
        return PagePicture(sample, grain, paper, measured=measured, bilevel=levels == 2)

    @staticmethod
    def of_tiles(tiles: Sequence[tuple["PagePicture | None", Array, Array]]) -> "PagePicture":
        """Picture of tiles, each given with its shift and the box (left, bottom, right, top) left after trimming."""

        def sample(points: Array) -> Array:
            seen = np.full(len(points), np.nan)
            for picture, offset, (left, bottom, right, top) in tiles:
                x, y = (points - offset).T
                is_inside = (x >= left) & (x <= right) & (y >= bottom) & (y <= top)
                if picture is not None and is_inside.any():
                    seen[is_inside] = picture.sample(points[is_inside] - offset)
            return seen

        pictures = [picture for picture, _, _ in tiles if picture is not None]
        grain = max((picture.grain for picture in pictures), default=0.0)
        return PagePicture(sample, grain, min((picture.paper for picture in pictures), default=WHITE), whole=False)


def _interpolated(grey: NDArray[np.uint8], places: Array) -> Array:
    """Grey levels between pixels; nan outside."""
    from scipy.ndimage import map_coordinates

    inside = ((places > -0.5) & (places < np.array(grey.shape[::-1]) - 0.5)).all(axis=1)
    seen = np.full(len(places), np.nan)
    # Rounded, so that between white pixels it is white.
    seen[inside] = map_coordinates(grey, places[inside, ::-1].T, float, order=1, mode="nearest").round(6)
    return seen
