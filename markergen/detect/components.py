"""Connected components of dark pixels, at all sizes: what could be a dot, by area and second moments alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect import kernel

Integers = NDArray[np.int64]
Eight = NDArray[np.uint8]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_WINDOW = 15
"""Side of the window whose mean a pixel is compared with, px: wider than a blurred edge, narrow compared to a dot's
surroundings. The inside of a larger dot does not differ from its mean, but a closed band along its edge does."""

_MIN_SIDE = 48
"""Lower limit for the shorter side of the smallest image of the pyramid, px."""

_MAX_PIXELS = 40_000_000
"""Maximum size of the largest image of the pyramid, which bounds memory."""

_MIN_STEP, _STEP_SIGMA = 6.0, 3.5
"""Minimum depth below the local mean of dark pixels: in grey levels, and as a multiple of the noise."""

_SMOOTH_ABOVE = 3.0
"""Noise above which the image is smoothed first, grey levels; smoothing closes gaps of a pixel or two."""

_LEAST = 7
"""Minimum number of pixels."""

_LARGEST = 1 << 15
"""Limit for the sides of a component's box, px, within which sums are exact."""

_MAX_ELONGATION = 12.0
_MAX_HOLLOW = 1.0
_HOLLOW_LEAST, _HOLLOW_GROWTH = 0.25, 0.04
"""Maximum of k^2, where k is the size of the hole relative to the outline: at all, and for small ones, with its growth
per pixel of the mean semi-axis. Thin lines that are not closed have more; the blurred holes of small rings fill up."""

_BOX_PX, _BOX_SHARE = 0.5, 0.12
"""Maximum distance of the box's sides from the outline's, px and as a share of its half width. Disks and bands with a
fifth of their outline hidden have less, squares up to 0.22."""

_LIMITS = np.array(
    [(_MAX_ELONGATION + 1 / _MAX_ELONGATION) ** 2, _HOLLOW_LEAST, _HOLLOW_GROWTH, _MAX_HOLLOW, _BOX_PX, _BOX_SHARE]
)

_PIECE = 32
_PIECE_ROWS = 64
_PLAIN = 0.2
"""Noise is that of the pieces at this quantile; pieces of this many pixels in a row, in this many rows at least."""


@dataclass(frozen=True, eq=False)
class Components:
    """K dark regions that may be disks, rings, or the closed band of dark pixels along the edge of a large dot.

    Attributes
    ----------
    center : array (K, 2), px of the full image
    spread : array (K, 2, 2), px^2
        Q of the outer outline x'Q^-1 x = 1 about the center.
    level : array (K,) of int
        Level of the pyramid; 2^level is the side of its pixels in px of the image.
    low, unit : float
        Grey level of the image that is 0 in `levels`, and the step that is 1 there.
    levels : tuple of arrays (h, w)
        The pyramid, finest first, with 8 bits.
    coarsest : int
        Side of the squares of pixels that the finest level averages: 1, or more for images of over 40 megapixels, where
        dots smaller than 3.5 times that are not looked for.
    """

    center: Array
    spread: Array
    level: Integers
    low: float
    unit: float
    levels: tuple[Eight, ...]
    coarsest: int

    def __len__(self) -> int:
        return len(self.center)


def find_components(image: Image) -> Components:
    """Find dark regions that could be dots of any size.

    Pixels below the mean of a small window are dark; the levels of an image pyramid provide windows of all sizes and
    average the noise away. So the result does not depend on the light's level or slope. Of each connected component of
    dark pixels, area n and covariance C give size and hole: with the semi-axes a and b of the outline and k times that
    of the hole, n = pi a b (1 - k^2) and C = S (1 + k^2) / 4, where S is the outline's spread. So with
    D = sqrt(det 4 C), 1 + k^2 = 2 pi D / (n + pi D), which is from 1 for disks to 2 for thin bands.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    """
    low, range_ = _range(image)
    coarsest = 1
    while image.size > _MAX_PIXELS * coarsest**2:
        coarsest *= 2
    level = _eight_bits(_shrunk(image, coarsest), low, range_)
    found, levels = [], []
    while True:
        found.append(_of_level(level))
        levels.append(level)
        if min(level.shape) < 2 * _MIN_SIDE:
            break
        level = np.asarray(_shrunk(level, 2), dtype=np.uint8)
    every = np.concatenate(found)
    center, spread, index = (_elliptic if kernel.library() is None else kernel.elliptic)(every, _LIMITS)
    finest = coarsest.bit_length() - 1
    of_level = np.repeat(np.arange(finest, finest + len(levels)), list(map(len, found)))[index]
    # In the order of their first pixels, which both ways of finding them share.
    order = np.lexsort((every[index, 10], of_level))
    of_level = of_level[order]
    side = np.ldexp(1.0, of_level)[:, None]
    center, spread = side * center[order] + (side - 1) / 2, side[..., None] ** 2 * spread[order]
    return Components(center, spread, of_level, low, range_ / 255, tuple(levels), coarsest)


def _elliptic(found: Integers, limits: Array) -> tuple[Array, Array, Integers]:
    """Return centers (j, 2), spreads (j, 2, 2) and indices of components that are elliptic disks, rings or bands.

    Their moments are those of one, and its outline touches the sides of their box. This is the twin of the function in
    kernel.c.
    """
    max_trace, least, growth, most, box, share = limits
    n, x, y, xx, xy, yy, left, top, right, bottom = np.array(found.T[:10], dtype=float, order="C")
    x, y = x / n, y / n
    # Pixels are squares.
    xx, xy, yy = xx / n - x * x + 1 / 12, xy / n - x * y, yy / n - y * y + 1 / 12
    determinant = xx * yy - xy * xy
    mean = 4 * np.pi * np.sqrt(determinant)
    # A product of semi-axes times pi, and 1 + k^2.
    outline = (n + mean) / 2
    hollow = mean / outline
    good = hollow < 1 + np.minimum(least + growth * np.sqrt(outline / np.pi), most)
    good &= (xx + yy) ** 2 < max_trace * determinant
    for place, variance, side in ((x, xx, right - left), (y, yy, bottom - top)):
        half = 2 * np.sqrt(variance / hollow)
        slack = box + share * half
        # The outermost pixels end half a pixel beyond their centers.
        good &= (np.abs(place + 0.5 - half) < slack) & (np.abs(side + 0.5 - place - half) < slack)
    index = np.flatnonzero(good)
    center = np.stack([x + left, y + top], axis=-1)[index]
    spread = (np.stack([xx, xy, xy, yy], axis=-1)[index] * (4 / hollow[index])[:, None]).reshape(-1, 2, 2)
    return center, spread, index


def _of_level(image: Eight) -> Integers:
    """Return the components of one level of the pyramid (k, 11), in no particular order."""
    import cv2

    if min(image.shape) < 3:
        return np.zeros((0, 11), dtype=np.int64)
    noise = grey_noise(image)
    if noise > _SMOOTH_ABOVE:
        image = np.asarray(cv2.GaussianBlur(image, (3, 3), 0), dtype=np.uint8)
        # The weights 1/4, 1/2, 1/4 in both directions reduce the noise to 3/8.
        noise *= 3 / 8
    step = min(int(max(_MIN_STEP, _STEP_SIGMA * noise)), 255)
    return (_dark_components if kernel.library() is None else kernel.dark_components)(image, step, _LEAST)


def _dark_components(image: Eight, step: int, least: int) -> Integers:
    """Return the connected components of dark pixels: the twin of the function in kernel.c, which says more.

    Moments are sums over runs of pixels in a row, of which there are far fewer than pixels.

    Returns
    -------
    array (k, 11)
        Pixels; sums of x, y, x^2, xy, y^2 relative to its box; the box's left, top, right and bottom; place of the
        first pixel.
    """
    import cv2

    width = image.shape[1]
    mean = cv2.blur(image, (_WINDOW, _WINDOW), borderType=cv2.BORDER_REPLICATE)
    dark = cv2.threshold(cv2.subtract(mean, image), step, 1, cv2.THRESH_BINARY)[1]
    # Not with OpenCV's statistics, which take four times as long as everything else.
    count, labels = cv2.connectedComponents(dark, connectivity=4)
    # A zero before each row ends the last run of the one above.
    flat = cv2.copyMakeBorder(dark, 0, 0, 1, 0, cv2.BORDER_CONSTANT, value=0).reshape(-1)
    change = np.flatnonzero(flat[1:] != flat[:-1])
    if len(change) % 2:
        change = np.append(change, flat.size - 1)
    row, first = np.divmod(change[::2], width + 1)
    last = change[1::2] - row * (width + 1) - 1
    owner = labels[row, first]

    area = np.bincount(owner, last - first + 1, count)
    kept = area >= least
    on = kept[owner]
    owner, row, first, last = (np.cumsum(kept) - 1)[owner[on]], row[on], first[on], last[on]
    area = area[kept]
    # Runs are in the order of the image: the first and the last of a component are at its top and bottom.
    begin, bottom = np.zeros((2, len(area)), dtype=np.int64)
    begin[owner[::-1]] = (row * width + first)[::-1]
    bottom[owner] = row
    left, right = np.full(len(area), width), np.zeros(len(area), dtype=np.int64)
    np.minimum.at(left, owner, first)
    np.maximum.at(right, owner, last)
    top = begin // width

    y, n, s = row - top[owner], last - first + 1, first + last - 2 * left[owner]
    weights = (n * s / 2, n * y, n * (3 * s * s + n * n - 1) / 12, n * s * y / 2, n * y * y)
    sums = (np.bincount(owner, weight, len(area)) for weight in weights)
    columns = np.rint([area, *sums, left, top, right, bottom, begin])
    small = np.maximum(right - left, bottom - top) < _LARGEST
    return np.asarray(columns.T[small], dtype=np.int64)


def _range(image: Image) -> tuple[float, float]:
    """Return the least grey level and the range to map to 8 bits; of 16 bits, a thousandth is cut off at either end."""
    if image.dtype == np.uint8 or not image.size:
        return 0.0, 255.0
    step = max(1, int(np.sqrt(image.size / 1e6)))
    low, high = np.percentile(image[::step, ::step], [0.1, 99.9])
    return float(low), float(max(high - low, 255))


def _eight_bits(image: Image, low: float, range_: float) -> Eight:
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    scaled = image.astype(np.float32)
    scaled -= np.float32(low)
    scaled *= np.float32(255 / range_)
    return np.clip(scaled, 0, 255, out=scaled).astype(np.uint8)


def _shrunk(image: Image, factor: int) -> Image:
    """Shrink an image by averaging squares of `factor` pixels' side; remainders at the far edges are left out."""
    import cv2

    if factor == 1:
        return image
    height, width = (side // factor for side in image.shape)
    cut = image[: factor * height, : factor * width]
    shrunk: Image = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
    return shrunk


def grey_noise(image: Image) -> float:
    """Estimate the standard deviation of the grey noise, from differences of neighbors over sqrt(2) in plain areas.

    In some 64 rows at even distances, the fifth of the 32 px pieces with the smallest differences counts: they show
    plain paper, if anything does. Zero for images without such pieces.

    Parameters
    ----------
    image : array (h, w), grey levels
    """
    pieces = image[:: max(8, len(image) // _PIECE_ROWS), : image.shape[1] // _PIECE * _PIECE]
    if kernel.library() is not None and pieces.dtype == np.uint8:
        sums = kernel.difference_squares(np.asarray(pieces, dtype=np.uint8))
    else:
        sums = _difference_squares(pieces)
    # Saturated pieces show no noise.
    sums = sums[sums > 0]
    if not len(sums):
        return 0.0
    place = _PLAIN * (len(sums) - 1)
    low = int(place)
    high = min(low + 1, len(sums) - 1)
    sums.partition([low, high])
    square = (sums[low] + (place - low) * (sums[high] - sums[low])) / (_PIECE - 1)
    return float(np.sqrt(square / 2))


def _difference_squares(pieces: Image) -> Integers:
    """Return the sums of squared differences of neighbors in pieces of 32 px: the twin of the function in kernel.c."""
    rows = pieces.reshape(-1, _PIECE).astype(np.int32 if pieces.dtype == np.uint8 else np.int64)
    difference = np.diff(rows, axis=1)
    return np.einsum("pi,pi->p", difference, difference).astype(np.int64)
