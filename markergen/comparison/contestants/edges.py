"""Square tags found by cv2.aruco, whose corners are the intersections of lines that we fit to their edges."""
# tests: tests/comparison/test_edges.py tests/contracts/test_contestants.py

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Choice, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey
from markergen.comparison.contestants.tags import SquareTag, tag_in
from markergen.comparison.fiducials import TAG_SETTINGS
from markergen.maths.projection import from_pixels, to_pixels
from markergen.model.camera import Camera

DETECTORS = {name: TAG_SETTINGS[name] for name in ("SUBPIX, window 5 px", "APRILTAG")}
REFINERS: Mapping[str, Any] = {"our lines fitted to the grey levels of its edges": None}
BAND_PX = 3.0
"""Farthest pixels from an edge that are fitted, px, but no farther than `_CELL_SHARE` of a cell."""
_CELL_SHARE = 0.7
"""Share of a cell, beyond which the blur of the next edge begins. From 0.4 to 1 all give the same in the paper's views,
where cells are larger than 4 px."""
_LEAST_PX = 4.0
"""Shortest part of an edge that is fitted, px."""
_ROUNDS, _STEPS = 2, 6
"""Selections of pixels beside the line, and Gauss-Newton steps after each."""
_START_PX, _NARROWEST_PX, _WIDEST_PX = 0.8, 0.25, 5.0
"""Blur of an edge, standard deviation: at the start, and limits."""
_CORNER_BLURS = 3.5
"""Distance from a corner within which an edge is not fitted, in units of its blur, but at least the band."""


@dataclass(frozen=True, eq=False)
class EdgeTag(SquareTag):
    """A square tag, found by cv2.aruco with corners that are then fitted by us."""

    detectors = DETECTORS
    refiners = REFINERS

    def describe(self, choice: Choice) -> str:
        """See `Contestant.describe`."""
        return ", ".join([super().describe(choice), *self.refiners])

    def refine(self, image: Grey, camera: Camera, detection: Sighting, refiner: Any) -> Array | None:
        """See `Printed.refine`."""
        del refiner
        return fit_edges(image, detection.pixels, self.tag.cells, camera)


def fit_edges(image: NDArray[np.uint8], corners: Array, cells: int, camera: Camera) -> Array | None:
    """Corners of a black square on white, refined as intersections of the lines through its edges.

    Each edge is a straight step, blurred by a Gaussian, between two grey levels: its offset, slope, width and both
    levels are fitted to the pixels beside it by least squares, which is maximum likelihood for equal noise. Pixels
    near a corner, whose blur reaches them, are left out. Lines are straight in the image without distortion.

    Parameters
    ----------
    image : array (h, w) of uint8
    corners : array (4, 2), px
        Corners in the image as taken, in order around the square, within 1 px or so.
    cells : int
        Number of cells along a side: the border is one of them, and as much white surrounds it.

    Returns
    -------
    array (4, 2), px, or None
        In the image as taken; None if an edge is too short or has no step.
    """
    square = to_pixels(camera.from_pixels(corners), camera.matrix)
    lines = [_fit_line(image, square[k], square[(k + 1) % 4], cells, camera) for k in range(4)]
    kept = [line for line in lines if line is not None]
    if len(kept) < 4:
        return None
    # A corner is where its edge meets the one before.
    refined = np.array([np.cross(kept[k - 1], kept[k]) for k in range(4)])
    pixels = camera.to_pixels(from_pixels(refined[:, :2] / refined[:, 2:], camera.matrix))
    return pixels if np.isfinite(pixels).all() else None


def _fit_line(image: NDArray[np.uint8], start: Array, end: Array, cells: int, camera: Camera) -> Array | None:
    """Homogeneous line (3,) through an edge between two undistorted points."""
    from scipy.special import ndtr

    length = float(np.linalg.norm(end - start))
    band = min(BAND_PX, _CELL_SHARE * length / cells)
    if not length - 2 * band >= _LEAST_PX:
        return None
    blur = _START_PX
    middle, along = (start + end) / 2, (end - start) / length
    pixels, levels = _around(image, start, end, band + 2, camera)
    for _ in range(_ROUNDS):
        # The corners round the ends of an edge as far as they are blurred.
        half = max(length / 2 - max(band, _CORNER_BLURS * blur), _LEAST_PX / 2)
        across = np.array([-along[1], along[0]])
        s, d = (pixels - middle) @ along, (pixels - middle) @ across
        is_beside = (np.abs(s) <= half) & (np.abs(d) <= band)
        s, d, level = s[is_beside] / half, d[is_beside], levels[is_beside]
        offset = slope = 0.0
        for _ in range(_STEPS):
            z = (d - offset - slope * s) / blur
            step, density = ndtr(z), np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
            base = np.stack([np.ones_like(step), step], axis=-1)
            dark_and_rise, _, rank, _ = np.linalg.lstsq(base, level, rcond=None)
            rise = dark_and_rise[1]
            if rank < 2 or abs(rise) < 1:
                return None
            push = -rise * density / blur
            jacobian = np.column_stack([base, push, push * s, push * z])
            change = np.linalg.lstsq(jacobian, level - base @ dark_and_rise, rcond=None)[0]
            offset, slope = offset + np.clip(change[2], -1, 1), slope + np.clip(change[3], -1, 1)
            blur = float(np.clip(blur + change[4], max(blur / 2, _NARROWEST_PX), min(2 * blur, _WIDEST_PX)))
        middle = middle + offset * across
        along = along + slope / half * across
        along = along / np.linalg.norm(along)
    return np.cross([*middle, 1.0], [*(middle + along), 1.0])


def _around(image: NDArray[np.uint8], start: Array, end: Array, margin: float, camera: Camera) -> tuple[Array, Array]:
    """Undistorted pixels (m, 2) around an edge, and their grey levels (m,)."""
    ends = camera.to_pixels(from_pixels(start + np.linspace(0, 1, 9)[:, None] * (end - start), camera.matrix))
    low = np.clip(np.floor(ends.min(axis=0) - margin), 0, [image.shape[1] - 1, image.shape[0] - 1]).astype(int)
    high = np.clip(np.ceil(ends.max(axis=0) + margin), 0, [image.shape[1] - 1, image.shape[0] - 1]).astype(int)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1).astype(float)
    # Only those in reach of a straight chord are worth undistorting; the lens bends an edge by less than its margin.
    chord = ends[-1] - ends[0]
    distance = np.abs((pixels - ends[0]) @ [-chord[1], chord[0]]) / np.linalg.norm(chord)
    bend = np.abs((ends - ends[0]) @ [-chord[1], chord[0]]).max() / np.linalg.norm(chord)
    pixels = pixels[distance <= margin + bend]
    levels = image[pixels[:, 1].astype(int), pixels[:, 0].astype(int)].astype(float)
    if camera.ideal is not camera:
        pixels = to_pixels(camera.from_pixels(pixels), camera.matrix)
    return pixels, levels


KINDS.register("edges")(
    ContestantKind(
        lambda text, arena: EdgeTag(text, tag_in(text.partition(":")[2], arena.square), arena.square),
        "edges:aruco:DICT[:ID]",
        "ArUco (or apriltag) tag, our lines on its edges",
        "OpenCV",
    )
)
