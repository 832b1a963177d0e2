"""Candidate regions for dots: dark, elliptic, with an edge all around that stands out from the image's noise."""

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Blobs, Image

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Eight = NDArray[np.uint8]

MAX_REGIONS = 128
"""Maximum number of regions, those with the most even edges first: the rest are clutter, and each costs time."""

_WINDOW = 15
"""Side of the window whose mean a pixel is compared with, px: wider than a blurred edge, narrow compared to a dot's
surroundings. The inside of a larger dot does not differ from its mean, but a closed band along its edge does."""

_MIN_SIDE = 48
"""Lower limit for the shorter side of the smallest image of the pyramid, px."""

_MAX_PIXELS = 40_000_000
"""Maximum size of the largest image of the pyramid: texture all over it has a million contours."""

_MIN_STEP, _STEP_SIGMA = 6.0, 3.5
"""Minimum depth below the local mean of dark pixels: in grey levels, and as a multiple of the noise."""

_SMOOTH_ABOVE = 3.0
"""Noise above which the image is smoothed first, grey levels; smoothing closes gaps of a pixel or two."""

_MIN_POINTS = 8
_MIN_SEMI_PX = 0.4
_MAX_ELONGATION = 12.0
_MAX_RMS_PX, _MAX_RMS_SHARE = 0.45, 0.05
"""Maximum RMS distance of a contour from its ellipse: px, for the steps between pixels, plus a share of the smaller
semi-axis, for edges displaced by light and neighbors. Squares have 0.12."""

_ANGLES = 24
_OFFSETS = np.array([-6.0, -4, -3, -2, -1, 0, 1, 2, 3, 4, 6])
_MIN_SUPPORT = 0.75
"""Share of the outline that must have an edge: the fit tolerates a fifth missing."""
_MIN_EDGE = 0.35
_MAX_UNEVEN = 0.6
"""Maximum standard deviation of the step over the outline, without its most deviant quarter, as a share of its median.
Dots have less than 0.25, with a noise of a tenth of the contrast."""
_MIN_CONTRAST = 12.0
_RING_ABOVE = 0.4
_ROUGH_PX = 0.2
"""Standard deviation of a rough center along each axis, px."""


def find_blobs(image: Image) -> Blobs:
    """Find dark regions that could be dots, with rough ellipses, those with the most even edges first.

    Pixels below the mean of a small window are dark; the levels of an image pyramid provide windows of all sizes and
    average the noise away. So the result does not depend on the light's level or slope, or on dark objects beside a
    dot. A region's outer border must be an ellipse, judging by the second moments of its area, and the image must be
    lighter outside than inside, by the same step, all around.

    Parameters
    ----------
    image : array (h, w)
    """
    dark, range_ = _range(image)
    # In larger images, only larger dots are looked for, which bounds time and memory.
    scale = 1
    while image.size > _MAX_PIXELS * scale**2:
        scale *= 2
    level = _eight_bits(_shrunk(image, scale), dark, range_)
    centers, spreads = [np.zeros((0, 2))], [np.zeros((0, 2, 2))]
    while True:
        center, spread = _ellipses(_borders(level))
        centers.append(center * scale + (scale - 1) / 2)
        spreads.append(spread * scale**2)
        if min(level.shape) < 2 * _MIN_SIDE:
            break
        scale, level = scale * 2, _eight_bits(_shrunk(level, 2), dark, range_)
    outlines, uneven = _with_edges(image, range_ / 255, np.concatenate(centers), np.concatenate(spreads))
    outlines = outlines.take(np.argsort(uneven, kind="stable"))
    return outlines.take(_distinct(outlines))


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


def _borders(image: Eight) -> list[NDArray[np.int32]]:
    """Find the borders (m, 1, 2) of regions darker than their surroundings, including the borders of their holes."""
    import cv2

    if min(image.shape) < 3:
        return []
    noise = grey_noise(image)
    if noise > _SMOOTH_ABOVE:
        image = np.asarray(cv2.GaussianBlur(image, (3, 3), 0), dtype=np.uint8)
        # The weights 1/4, 1/2, 1/4 in both directions reduce the noise to 3/8.
        noise *= 3 / 8
    mean = cv2.blur(image, (_WINDOW, _WINDOW), borderType=cv2.BORDER_REPLICATE)
    step = max(_MIN_STEP, _STEP_SIGMA * noise)
    dark = cv2.threshold(cv2.subtract(mean, image), step, 255, cv2.THRESH_BINARY)[1]
    contours = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
    return [contour for contour in contours if len(contour) >= _MIN_POINTS]


def _ellipses(contours: list[NDArray[np.int32]]) -> tuple[Array, Array]:
    """Return the centers (k, 2) and spreads (k, 2, 2) of elliptic contours, by the moments of their polygons."""
    none = np.zeros((0, 2)), np.zeros((0, 2, 2))
    if not contours:
        return none
    length = np.array([len(contour) for contour in contours])
    start = np.cumsum(length) - length
    points = np.concatenate(contours)[:, 0].astype(float)
    owner = np.repeat(np.arange(len(length)), length)
    first = points[start]
    points -= first[owner]
    x, y = points.T
    following = np.arange(1, len(points) + 1)
    following[start + length - 1] = start
    x1, y1 = x[following], y[following]
    cross = x * y1 - x1 * y

    def total(values: Array) -> Array:
        return np.add.reduceat(values, start)

    area = total(cross) / 2
    # Outer borders and borders of holes have opposite orientations; a line of pixels has no area.
    outer = area < -1
    area = np.where(outer, area, -1)
    center_x, center_y = total((x + x1) * cross) / (6 * area), total((y + y1) * cross) / (6 * area)
    xx = total((x * x + x * x1 + x1 * x1) * cross) / (12 * area) - center_x**2
    yy = total((y * y + y * y1 + y1 * y1) * cross) / (12 * area) - center_y**2
    xy = total((2 * (x * y + x1 * y1) + x * y1 + x1 * y) * cross) / (24 * area) - center_x * center_y
    determinant, trace = xx * yy - xy**2, xx + yy
    shaped = np.flatnonzero(
        outer & (determinant > (_MIN_SEMI_PX / 2) ** 4) & (trace**2 < 1.1 * _MAX_ELONGATION**2 * determinant)
    )
    if not len(shaped):
        return none

    # The spread is four times the covariance of an ellipse's area.
    spread = 4 * np.stack([xx, xy, xy, yy], axis=-1)[shaped].reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(spread)
    place = np.full(len(length), -1)
    place[shaped] = np.arange(len(shaped))
    on = place[owner] >= 0
    of_shaped = place[owner[on]]
    inverse = np.linalg.inv(spread)[of_shaped]
    dx, dy = x[on] - center_x[owner[on]], y[on] - center_y[owner[on]]
    gx, gy = inverse[:, 0, 0] * dx + inverse[:, 0, 1] * dy, inverse[:, 0, 1] * dx + inverse[:, 1, 1] * dy
    distance = (dx * gx + dy * gy - 1) / (2 * np.maximum(np.hypot(gx, gy), 1e-12))
    rms = np.sqrt(np.bincount(of_shaped, distance**2) / length[shaped])
    good = rms < _MAX_RMS_PX + _MAX_RMS_SHARE * np.sqrt(values[:, 0])
    # A contour runs through the outermost pixels' centers, half a pixel inside the true outline.
    grown = (np.sqrt(values[good]) + 0.5) ** 2
    center = np.stack([center_x, center_y], axis=-1) + first
    return center[shaped[good]], np.einsum("bik,bk,bjk->bij", vectors[good], grown, vectors[good])


def _with_edges(image: Image, unit: float, center: Array, spread: Array) -> tuple[Blobs, Array]:
    """Select outlines with an edge from dark to light all around; also return how uneven each edge is, 0 for even.

    Pixels are sampled on the normals of the outline. A large share of the outline must have a step near the median;
    the median profile across the outline gives levels and blur. `unit` is the step that counts as one of 255 grey
    levels.
    """
    height, width = image.shape
    angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    circle = np.stack([np.cos(angle), np.sin(angle)])
    values, vectors = np.linalg.eigh(spread)
    semi = np.sqrt(values)
    along = np.einsum("bik,bk,kt->bti", vectors, semi, circle)
    normal = np.einsum("bik,bk,kt->bti", vectors, 1 / semi, circle)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    # At most as far inside as the middle of the shorter axis.
    offset = np.maximum(_OFFSETS, -semi[:, :1])[:, None, :, None]
    place = center[:, None, None] + along[:, :, None] + offset * normal[:, :, None]
    column, row = np.rint(place[..., 0]).astype(int), np.rint(place[..., 1]).astype(int)
    zero = len(_OFFSETS) // 2
    near = column[:, :, zero + 1], row[:, :, zero + 1]
    # The outline itself must be in the image, with a margin of one pixel.
    whole = ((near[0] >= 0) & (near[0] < width) & (near[1] >= 0) & (near[1] < height)).all(axis=-1)
    grey = image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)].astype(float)

    step = grey[:, :, zero + 2] - grey[:, :, zero - 2]
    contrast = np.median(step, axis=-1)
    even = step / np.maximum(contrast, unit)[:, None]
    support = np.mean((even > _MIN_EDGE) & (even < 1 / _MIN_EDGE), axis=-1)
    odd = _ANGLES // 8
    uneven = np.std(np.sort(even, axis=-1)[:, odd:-odd], axis=-1)
    good = whole & (contrast > _MIN_CONTRAST * unit) & (support >= _MIN_SUPPORT) & (uneven < _MAX_UNEVEN)

    profile = np.median(grey[good], axis=1)
    # Beyond the lightest point outside and the darkest inside, other objects begin.
    profile[:, zero:] = np.maximum.accumulate(profile[:, zero:], axis=1)
    profile[:, zero::-1] = np.minimum.accumulate(profile[:, zero::-1], axis=1)
    light, dark = profile[:, -1], profile[:, 0]
    share = (profile - dark[:, None]) / np.maximum(light - dark, unit)[:, None]
    # The integral of F (1 - F) over a normal distribution F is its standard deviation over the root of pi.
    blur = np.sqrt(np.pi) * np.trapezoid(share * (1 - share), _OFFSETS, axis=1)
    # Position of the half-level by area: thresholds below the mean make small and blurred regions too large.
    edge = _OFFSETS[-1] - np.trapezoid(share, _OFFSETS, axis=1)
    semi = np.maximum(semi[good] + edge[:, None], 0.4 * semi[good])
    # In a ring, the middle of the hole, which is half as wide as the ring, is light.
    around = center[good, None] + np.concatenate([np.zeros((len(light), 1, 2)), 0.15 * along[good, ::3]], axis=1)
    around = np.rint(around).astype(int)
    middle = image[around[..., 1], around[..., 0]].mean(axis=1)
    middle = (middle - dark) / np.maximum(light - dark, unit)
    longest = vectors[good][:, :, 1]
    rough = Blobs(
        center[good],
        semi[:, ::-1],
        np.arctan2(longest[:, 1], longest[:, 0]),
        middle > _RING_ABOVE,
        np.tile(_ROUGH_PX**2 * np.eye(2), (len(light), 1, 1)),
        light,
        dark,
        blur,
        middle,
        np.zeros(len(light), dtype=bool),
    )
    return rough, uneven[good]


def _distinct(outlines: Blobs) -> Indices:
    """Return the first of each group of nearly equal outlines."""
    size = np.sqrt(outlines.semi.prod(axis=-1))
    taken = np.zeros(0, dtype=np.intp)
    for i in range(len(outlines)):
        near = np.linalg.norm(outlines.center[taken] - outlines.center[i], axis=-1) < 1 + 0.25 * size[i]
        alike = np.abs(size[taken] - size[i]) < 1.5 + 0.3 * size[i]
        if not (near & alike).any():
            taken = np.append(taken, i)
            if len(taken) == MAX_REGIONS:
                break
    return taken


_PIECE = 32


def grey_noise(image: NDArray[np.uint8] | NDArray[np.uint16]) -> float:
    """Estimate the standard deviation of the grey noise, from differences of neighbors over sqrt(2) in plain areas.

    In every eighth row, the fifth of the 32 px pieces with the smallest differences counts: they show plain paper, if
    anything does. Zero for images without such pieces.

    Parameters
    ----------
    image : array (h, w), grey levels
    """
    rows = image[::8, : image.shape[1] // _PIECE * _PIECE].astype(np.float32)
    if not rows.size:
        return 0.0
    spread = np.mean(np.square(np.diff(rows.reshape(-1, _PIECE), axis=1)), axis=1)
    # Saturated pieces show no noise.
    spread = spread[spread > 0]
    return float(np.sqrt(np.percentile(spread, 20) / 2)) if len(spread) else 0.0
