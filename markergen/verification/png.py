"""Measure dots in a PNG as blobs of ink by their grey-weighted moments, at the resolution that the file states."""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.paper import PAPERS, Paper
from markergen.errors import InputError, reason_of
from markergen.model.body import Body
from markergen.model.marker import Marker
from markergen.read.images import decoded_levels, opened_image
from markergen.read.videos import silent_opencv
from markergen.verification.printed import reads_upright
from markergen.verification.reading import (
    ALIKE,
    FLATTEST,
    PRINTABLE,
    READERS,
    ROUND,
    Circle,
    Page,
    PagePicture,
    Reading,
    Settings,
    circle_diameters,
    circles_of,
)

Grey = NDArray[np.uint8]
Blob = tuple[tuple[int, int, int, int], bool]

WITH_ALPHA = (4, 6)
"""Color types of a PNG with transparency."""

ORIENTATION = 0x0112
"""EXIF's tag of the orientation, which some programs follow."""

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MOST_PIXELS = 600_000_000
"""Maximum number of pixels: A0 at 600 dpi has 558 million."""

COARSE = 14
"""Pixels across the smallest dot in the reduced image that is searched for dots."""

GAP = 1.5
"""Minimum gap between dots in pixels of that image, so that they do not merge."""

SOFT = 2
"""Width of a blob's soft rim in pixels; ink farther out belongs to another blob."""

TOLERANCE_PX = 0.25
"""Default tolerance in pixels, where that is more than `PRINTABLE`."""

CORE, RIM = 0.93, 1.3
"""Shares of a dot's radius: inside the first is ink or a ring's hole, outside the second is not part of the dot."""

MOST_BLOBS = 2000
"""Maximum number of blobs, each of which is measured in the full image."""

SEARCHED, LEAST_BLOB = 4_000_000, 8
"""Pixels of the reduced image that is searched for blobs of any size, and their minimum size in its pixels."""


@READERS.register(".png")
def read_png(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the round blobs of a PNG, dark or light, as circles in mm."""
    width, height, scale = _header(data, name)
    grey = _decode(data, (height, width), name)
    pixels, notes = np.array([width, height]), list[str]()
    size = pixels / scale
    if (paper := _stretched_paper(pixels, scale)) is not None:
        sides = np.array([paper.width, paper.height])
        share = 100 * float((size / sides).max() - 1)
        notes.append(f"stretched by {share:.2g} % to whole pixels: print it to fill the whole {paper.name} page")
        size = sides
    page = pixel_page(grey, (0.0, -size[1], size[0], 0.0), body, name)
    tolerance = tolerance_of(scale.mean())
    return Reading("PNG", (page,), tolerance, notes=tuple(notes))


def _stretched_paper(pixels: Array, scale: Array) -> Paper | None:
    """Paper of a page that a program such as PDFium stretched to whole pixels, by more than half of one."""
    for paper in PAPERS.values():
        more = pixels - scale * [paper.width, paper.height]
        if (more > -0.5).all() and 0.5 < more.max() < 1.1:
            return paper
    return None


def tolerance_of(scale: float, pixels: float = TOLERANCE_PX) -> float:
    """Tolerance in m of what is measured at a number of pixels per mm."""
    return max(PRINTABLE, 1e-3 * pixels / float(scale))


def pixel_page(grey: Grey, box: Sequence[float], body: Body, name: str) -> Page:
    """Page of an image that fills a box (left, bottom, right, top) in mm."""
    sizes = np.array(circle_diameters(body))
    gap = min(_least_gap(plate.marker) for plate in body.plates)
    corner, size = np.array([box[0], box[3], 0.0, 0.0]), (box[2] - box[0], box[3] - box[1])
    scale = np.array(grey.shape[::-1]) / size
    picture = PagePicture.of_pixels(grey, box, measured=True)

    def circles(wanted: Array | None) -> Array:
        measured = [_measure(grey, blob, dark, scale) for blob, dark in _blobs(grey, scale, wanted, gap)]
        return circles_of([circle for circle in measured if circle is not None], name) + corner

    return Page(
        circles(sizes),
        size,
        of_any_size=partial(circles, None),
        upright=partial(reads_upright, body.plates[0].marker, box, picture) if len(body.plates) == 1 else None,
        picture=picture,
    )


def _header(data: bytes, name: str) -> tuple[int, int, Array]:
    """Width and height in px, and pixels per mm (x, y), of an image whose chunks are all intact."""
    from PIL import Image

    if not data.startswith(SIGNATURE):
        raise InputError(f"a PNG in {name}", "another kind of file", "check the path")
    try:
        with opened_image(data, ("PNG",)) as image:
            (width, height), inches = image.size, image.info.get("dpi")
            exif, clear = Image.Exif(), image.info.get("transparency", b"")
            exif.load(image.info.get("exif", b""))
            image.verify()
    # Decoders raise all kinds of exceptions for broken files.
    except Exception as error:
        raise InputError(f"a complete PNG in {name}", reason_of(error), "export it again") from None
    if not 0 < width * height <= MOST_PIXELS:
        raise InputError(
            f"1 to {MOST_PIXELS // 10**6} million pixels in {name}", f"{width} x {height}", "use a lower dpi"
        )
    # Deflate compresses by a factor of 1032 at most: a larger image is a lie, and would exhaust the memory.
    if width * height / 8 > 1032 * len(data) + 1000:
        raise InputError(f"{width} x {height} pixels in {name}", "data for fewer", "export it again")
    is_turned = exif.get(ORIENTATION, 1) != 1
    if is_turned or not isinstance(clear, bytes) or clear.strip(b"\xff"):
        feature = "an orientation (EXIF)" if is_turned else "a transparent color (tRNS)"
        raise InputError(f"pixels that all programs show alike in {name}", feature, "save it upright and without alpha")
    if inches is None:
        raise InputError(f"a resolution in {name}", "none: no pHYs in meters", "export it again, with its dpi")
    # Pillow gives dots per inch, but the file has integer pixels per meter.
    x, y = (round(dots / 0.0254) for dots in inches)
    if not 100 <= min(x, y) <= max(x, y) <= 10_000_000:
        raise InputError(f"a resolution of 100 to 10 million pixels a meter in {name}", f"{x} x {y}", "export it again")
    return width, height, np.array([x, y]) / 1e3


def _decode(data: bytes, shape: tuple[int, int], name: str) -> Grey:
    import cv2

    try:
        with silent_opencv():
            kind = cv2.IMREAD_UNCHANGED if data[25] in WITH_ALPHA else cv2.IMREAD_GRAYSCALE
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), kind)
            grey = None if pixels is None else decoded_levels(pixels)
    except (cv2.error, MemoryError) as error:
        raise InputError(f"a PNG that can be decoded in {name}", reason_of(error), "export it again") from None
    if grey is None or grey.shape != shape:
        raise InputError(f"a PNG that can be decoded in {name}", "damaged pixels", "export it again")
    return np.asarray(grey if grey.dtype == np.uint8 else np.rint(grey / 257), dtype=np.uint8)


def _least_gap(marker: Marker) -> float:
    """Smallest gap between two dots, mm."""
    xy, radii = marker.xyz[:, :2], marker.radii
    first, second = np.triu_indices(len(marker), 1)
    gaps = np.linalg.norm(xy[first] - xy[second], axis=-1) - radii[first] - radii[second]
    return 1e3 * float(gaps.min(initial=np.inf))


def _blobs(grey: Grey, scale: Array, sizes: Array | None, gap: float) -> Iterator[Blob]:
    """Boxes (left, top, right, bottom), px, of blobs that may be dots or holes of rings, and whether they are dark.

    Blobs may have any size if `sizes` is None.
    """
    import cv2

    if sizes is None:
        step = max(int(np.sqrt(grey.size / SEARCHED)), 1)
    else:
        step = int(np.clip(min(sizes.min() / COARSE, gap / GAP) * scale.min(), 1, 32))
    height, width = (side // step for side in grey.shape)
    if min(height, width) < 4:
        return
    coarse = cv2.resize(grey[: height * step, : width * step], (width, height), interpolation=cv2.INTER_AREA)
    low, high = int(coarse.min()), int(coarse.max())
    if high - low < 16:
        return
    count = 0
    for dark in (True, False):
        mask = (coarse < (low + high) / 2) == dark
        _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        sides = stats[1:, 2:4] * step / scale
        size = np.sqrt(sides.prod(axis=1))
        if sizes is None:
            is_sized = stats[1:, 2:4].min(axis=1) >= LEAST_BLOB
        else:
            is_sized = np.abs(np.log(size[:, None] / sizes)).min(axis=1) < np.log(1.2 * ALIKE)
        even = sides.min(axis=1) > 0.7 * sides.max(axis=1)
        share = stats[1:, 4] / (np.pi / 4 * stats[1:, 2:4].prod(axis=1))
        for left, top, across, down, _ in stats[1:][is_sized & even & (share > 0.15) & (share < 1.2)].tolist():
            count += 1
            if count > MOST_BLOBS:
                return
            yield (left * step, top * step, (left + across) * step, (top + down) * step), dark


def _measure(grey: Grey, box: tuple[int, int, int, int], dark: bool, scale: Array) -> Circle | None:
    """Circle of a round blob in mm, y up from the image's top edge; None if it is not round."""
    left, top, right, bottom = box
    center = np.array([(left + right - 1) / 2, (top + bottom - 1) / 2])
    half = np.array([right - left, bottom - top]) / 2
    area, spread = 0.0, np.eye(2)
    # The box has the resolution of the reduced image; the first pass refines it.
    for core in (0.75, CORE):
        moments = _moments(grey, center, half, dark, core)
        if moments is None:
            return None
        area, center, spread = moments
        half = 2 * np.sqrt(np.maximum(np.diag(spread), 1e-6))
    ellipse = 4 * np.pi * float(np.sqrt(max(np.linalg.det(spread), 1e-12)))
    stretched = np.sqrt(np.linalg.eigvalsh(spread / np.outer(scale, scale)))
    # The rim makes a small area uncertain; a square is 0.045 off.
    if abs(area / ellipse - 1) > ROUND + 0.3 / half.min() or stretched[0] < FLATTEST * stretched[1]:
        return None
    x, y = (center + 0.5) / scale
    radius = float(np.sqrt(area / np.pi / scale.prod()))
    return float(x), float(-y), radius, float(np.abs(2 * stretched - radius).max())


def _moments(grey: Grey, center: Array, half: Array, dark: bool, core: float) -> tuple[float, Array, Array] | None:
    """Area, centroid and second moments of a blob in pixels, with a ring's hole filled and neighbors excluded."""
    import cv2

    reach = 1.1 * RIM * half + 2
    low = np.maximum(np.floor(center - reach), 0).astype(int)
    high = np.minimum(np.ceil(center + reach) + 1, grey.shape[::-1]).astype(int)
    if (high - low < 3).any():
        return None
    window = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    x, y = (np.arange(low[k], high[k], dtype=np.float32) - np.float32(center[k]) for k in (0, 1))
    distance = np.hypot((x / np.float32(half[0]))[None, :], (y / np.float32(half[1]))[:, None])
    around, inside = (distance > (1 + RIM) / 2) & (distance < 1.05 * RIM), distance < core
    if not around.any() or not inside.any():
        return None
    # Neighbors may fill most of the surroundings.
    ground = float(np.percentile(window[around], 90 if dark else 10))
    ink = float(np.percentile(window[inside], 5 if dark else 95))
    if (ground - ink if dark else ink - ground) < 16:
        return None
    covered = np.clip((ground - window) / (ground - ink), 0, 1)
    covered[inside] = 1
    _, parts = cv2.connectedComponents((covered > 0.5).astype(np.uint8), connectivity=4)
    blob = (parts == parts[inside][0]).astype(np.uint8)
    covered[cv2.dilate(blob, np.ones((2 * SOFT + 1, 2 * SOFT + 1), np.uint8)) == 0] = 0
    sums = cv2.moments(covered)
    area = sums["m00"]
    spread = np.array([[sums["mu20"], sums["mu11"]], [sums["mu11"], sums["mu02"]]]) / area
    # A pixel is a square, not a point.
    return area, low + np.array([sums["m10"], sums["m01"]]) / area, spread + np.eye(2) / 12
