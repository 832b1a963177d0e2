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
    def of_tiles(tiles: Sequence[tuple["PagePicture | None", Array, Sequence[float]]]) -> "PagePicture":
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
    import cv2

    seen = np.full(len(places), np.nan)
    size = np.array(grey.shape[::-1])
    inside = ((places > -0.5) & (places < size - 0.5)).all(axis=1)
    if not inside.any():
        return seen
    places = places[inside]
    low = np.maximum(np.floor(places.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(places.max(axis=0)).astype(int) + 2, size)
    # cv2.remap takes images and rows of points of up to 32767 pixels.
    if (high - low).max() > 32000:
        nearest = np.clip(np.rint(places).astype(int), 0, size - 1)
        seen[inside] = grey[nearest[:, 1], nearest[:, 0]]
        return seen
    window = grey[low[1] : high[1], low[0] : high[0]]
    x, y = (places - low).astype(np.float32).T
    # In rows, so that any number of points fits.
    count = -(-len(x) // 1024) * 1024
    x, y = (np.resize(coordinates, count).reshape(-1, 1024) for coordinates in (x, y))
    levels = [
        cv2.remap(window, x[k : k + 16000], y[k : k + 16000], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for k in range(0, len(x), 16000)
    ]
    seen[inside] = np.concatenate(levels).ravel()[: inside.sum()]
    return seen
