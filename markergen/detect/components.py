"""Connected components of dark pixels, at all sizes: what could be a dot, by area and second moments alone."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect import kernel

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
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

_LEAST = 5
"""Minimum number of pixels."""

_MAX_ELONGATION = 12.0
_MAX_HOLLOW = 2.1
"""Maximum of 1 + k^2, where k is the size of the hole."""

_PIECE = 32
_PIECE_ROWS = 64


@dataclass(frozen=True, eq=False)
class Components:
    """K dark regions that may be disks, rings, or the closed band of dark pixels along the edge of a large dot.

    Attributes
    ----------
    center : array (K, 2), px of the full image
    spread : array (K, 2, 2), px^2
        Q of the outer outline x'Q^-1 x = 1 about the center.
    hollow : array (K,)
        Squared size of the hole over that of the outline: 0 for a disk, near 1 for a thin band.
    area : array (K,), px^2 of the full image
    box : array (K, 4), px of the full image
        Left, top, right and bottom edge.
    level : array (K,) of int
        Level of the pyramid; 2^level is the side of its pixels in px of the image.
    border : array (K,) of bool
        True if it touches the image's edge.
    unit : float
        Step in the image's grey levels that counts as one of 255.
    coarsest : int
        Side of the squares of pixels that the finest level averages: 1, or more for images of over 40 megapixels, where
        dots smaller than 3.5 times that are not looked for.
    """

    center: Array
    spread: Array
    hollow: Array
    area: Array
    box: Array
    level: NDArray[np.int64]
    border: NDArray[np.bool_]
    unit: float
    coarsest: int

    def __len__(self) -> int:
        return len(self.center)

    def take(self, index: NDArray[np.bool_] | Indices) -> "Components":
        """Return a subset."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        rows: dict[str, Any] = {name: each[index] for name, each in values.items() if isinstance(each, np.ndarray)}
        return replace(self, **rows)


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
    scale, level = coarsest, _eight_bits(_shrunk(image, coarsest), low, range_)
    found, scales, shapes = [], [], []
    while True:
        rows = _of_level(level)
        found.append(rows)
        scales.append(np.full(len(rows), scale))
        shapes.append(np.broadcast_to(level.shape, (len(rows), 2)))
        if min(level.shape) < 2 * _MIN_SIDE:
            break
        scale, level = 2 * scale, np.asarray(_shrunk(level, 2), dtype=np.uint8)
    return _shaped(np.concatenate(found), np.concatenate(scales), np.concatenate(shapes), range_ / 255, coarsest)


def _shaped(found: Integers, scale: Integers, shape: Integers, unit: float, coarsest: int) -> Components:
    """Select components whose moments are those of an elliptic disk or ring."""
    n, x, y, xx, xy, yy = (np.asarray(column, dtype=float) for column in found.T[:6])
    x, y = x / n, y / n
    # Pixels are squares.
    xx, xy, yy = xx / n - x * x + 1 / 12, xy / n - x * y, yy / n - y * y + 1 / 12
    determinant, trace = xx * yy - xy * xy, xx + yy
    area = 4 * np.sqrt(determinant)
    hollow = 2 * np.pi * area / (n + np.pi * area)
    good = (trace**2 < (_MAX_ELONGATION + 1 / _MAX_ELONGATION) ** 2 * determinant) & (hollow < _MAX_HOLLOW)
    factor = scale[good].astype(float)
    shift = (factor - 1) / 2
    box = found[good, 6:10]
    limit = shape[good, ::-1] - 1
    border = np.any((box[:, :2] <= 0) | (box[:, 2:] >= limit), axis=1)
    center = np.stack([x[good] + box[:, 0], y[good] + box[:, 1]], axis=-1)
    spread = np.stack([xx[good], xy[good], xy[good], yy[good]], axis=-1).reshape(-1, 2, 2)
    return Components(
        center * factor[:, None] + shift[:, None],
        spread * (4 * factor**2 / hollow[good])[:, None, None],
        np.clip(hollow[good] - 1, 0, 1),
        n[good] * factor**2,
        (box + [-0.5, -0.5, 0.5, 0.5]) * factor[:, None] + shift[:, None],
        np.rint(np.log2(factor)).astype(np.int64),
        border,
        unit,
        coarsest,
    )


def _of_level(image: Eight) -> Integers:
    """Return the components of one level of the pyramid (k, 11), in the order of their first pixels."""
    import cv2

    if min(image.shape) < 3:
        return np.zeros((0, 11), dtype=np.int64)
    noise = grey_noise(image)
    if noise > _SMOOTH_ABOVE:
        image = np.asarray(cv2.GaussianBlur(image, (3, 3), 0), dtype=np.uint8)
        # The weights 1/4, 1/2, 1/4 in both directions reduce the noise to 3/8.
        noise *= 3 / 8
    step = min(int(max(_MIN_STEP, _STEP_SIGMA * noise)), 255)
    compiled = kernel.library() is not None
    found = kernel.dark_components(image, step, _LEAST) if compiled else _dark_components(image, step, _LEAST)
    return found[np.argsort(found[:, 10])]


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
    labels, stats = cv2.connectedComponentsWithStats(dark, connectivity=8)[1:3]
    # A column of zeros behind each row ends its last run.
    flat = cv2.copyMakeBorder(dark, 0, 0, 1, 0, cv2.BORDER_CONSTANT, value=0).reshape(-1)
    change = np.flatnonzero(flat[1:] != flat[:-1])
    if len(change) % 2:
        change = np.append(change, flat.size - 1)
    row, first = np.divmod(change[::2], width + 1)
    last = change[1::2] - row * (width + 1) - 1
    owner = labels[row, first]

    area = stats[:, cv2.CC_STAT_AREA]
    stats = stats.astype(np.int64)
    side = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    kept = (area >= least) & (side <= 1 << 15)
    kept[0] = False
    place = np.where(kept, np.cumsum(kept) - 1, -1)
    of = place[owner]
    on = of >= 0
    of, row, first, last = of[on], row[on], first[on], last[on]
    stats = stats[kept]
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    begin = np.zeros(len(stats), dtype=np.int64)
    begin[of[::-1]] = (row * width + first)[::-1]

    y = row - top[of]
    n = last - first + 1
    s = first + last - 2 * left[of]

    def total(values: Integers) -> Array:
        return np.asarray(np.bincount(of, values, len(stats)), dtype=float)

    sums = [
        total(n * s) / 2, total(n * y), total(n * (3 * s * s + n * n - 1)) / 12, total(n * s * y) / 2, total(n * y * y),
    ]  # fmt: skip
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH] - 1, top + stats[:, cv2.CC_STAT_HEIGHT] - 1
    columns = [stats[:, cv2.CC_STAT_AREA], *sums, left, top, right, bottom, begin]
    return np.stack([np.asarray(np.rint(column), dtype=np.int64) for column in columns], axis=-1)


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


def grey_noise(image: NDArray[np.uint8] | NDArray[np.uint16]) -> float:
    """Estimate the standard deviation of the grey noise, from differences of neighbors over sqrt(2) in plain areas.

    In some 64 rows at even distances, the fifth of the 32 px pieces with the smallest differences counts: they show
    plain paper, if anything does. Zero for images without such pieces.

    Parameters
    ----------
    image : array (h, w), grey levels
    """
    every = max(8, len(image) // _PIECE_ROWS)
    rows = image[::every, : image.shape[1] // _PIECE * _PIECE].astype(np.float32)
    if not rows.size:
        return 0.0
    spread = np.mean(np.square(np.diff(rows.reshape(-1, _PIECE), axis=1)), axis=1)
    # Saturated pieces show no noise.
    spread = spread[spread > 0]
    return float(np.sqrt(np.percentile(spread, 20) / 2)) if len(spread) else 0.0
