"""What readers make of a file, whatever its format: pages with circles on them, in mm, y up."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.registry import Registry
from markergen.verification.surface import Surface

Array = NDArray[np.float64]

MOST_CIRCLES = 20_000
"""In one file; the largest marker has a thousand dots."""

ROUND = 0.02
"""Share of the radius up to which an outline may leave its ellipse and still be round."""

FLATTEST = 0.8
"""Least ratio of the half axes of what counts as a circle that was stretched."""


def _empty(*shape: int) -> Array:
    return np.zeros((0, *shape))


@dataclass(frozen=True, eq=False)
class Page:
    """One page, or the whole of a file that has none.

    Attributes
    ----------
    circles : array (m, 3)
        Center and radius of every circle that is seen whole, mm, y up, in the order of the file. The radius is nan in
        formats that hold points alone.
    size : (width, height) or None
        Of the paper, mm.
    corners : array (k, 2)
        Corners of the other outlines, mm, for tags.
    heights : array (m,) or None
        z of each circle, mm, where the format tells.
    upright : callable or None
        Tells whether what is on it besides the dots reads the right way round, None if that cannot be told.
    sample : callable or None
        Grey levels at points (k, 2) in mm, of a page of pixels.
    surface : Surface or None
        What a solid shows from above; the circles are those of its dots and not listed here.
    """

    circles: Array
    size: tuple[float, float] | None = None
    corners: Array = field(default_factory=lambda: _empty(2))
    heights: Array | None = None
    upright: Callable[[], bool | None] | None = None
    sample: Callable[[Array], Array] | None = None
    surface: Surface | None = None


@dataclass(frozen=True, eq=False)
class Reading:
    """All pages of a file.

    Attributes
    ----------
    kind : str
        What the format is called.
    pages : tuple of Page
    tolerance : float
        How exact such a file is to be, m.
    drawn : bool
        Whether it shows what is to be printed, or else lists the places that the dots have in the print.
    ordered : bool
        Whether dots stand in the file in the marker's order unless an editor changed it.
    pixels : bool
        Whether it is made of pixels, so that diameters are less exact than centers.
    tagged : bool
        Whether it shows tags.
    papers : tuple of (width, height)
        Of the pages that were put together to one, mm.
    gaps : tuple of str
        What is wrong with how they fit each other.
    tag_gaps : tuple of str
        What is wrong with the tag that a list of points tells.
    flaws : tuple of str
        What is wrong with solids themselves.
    """

    kind: str
    pages: tuple[Page, ...]
    tolerance: float = 1e-6
    drawn: bool = True
    ordered: bool = True
    pixels: bool = False
    tagged: bool = False
    papers: tuple[tuple[float, float] | None, ...] = ()
    gaps: tuple[str, ...] = ()
    tag_gaps: tuple[str, ...] = ()
    flaws: tuple[str, ...] = ()


Reader = Callable[[bytes, str, Marker], Reading]
"""Makes a reading of a file's bytes; the name is for messages, the marker tells how large its dots are."""

READERS: Registry[Reader] = Registry("suffix to verify", "markergen.verification")
"""Readers by suffix with its dot."""


def reader_of(path: Path) -> Reader:
    """Reader for a path by the longest suffix that is known; raises InputError with the known ones if none is."""
    parts = path.name.lower().split(".")[1:]
    for start in range(len(parts)):
        suffix = "." + ".".join(parts[start:])
        if suffix in READERS.names():
            return READERS[suffix]
    return READERS["." + parts[-1] if parts else path.name]


def round_shape(points: Array) -> tuple[float, float, float] | None:
    """Center and radius of a closed outline (m, 2) that is a circle or a circle stretched a little, else None.

    A conic through the points by least squares: its center is that of the ellipse however the points are spread, and
    the radius is the root of the product of its half axes.
    """
    if len(points) < 8 or not np.isfinite(points).all():
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    half = (high - low) / 2
    if half.min() <= 0 or half.min() < FLATTEST * half.max() or not half.max() < 1e9:
        return None
    middle, size = (low + high) / 2, float(half.max())
    x, y = ((points - middle) / size).T
    area = abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2
    rows = np.stack([x * x, x * y, y * y, x, y], axis=-1)
    (a, b, c, d, e), *_ = np.linalg.lstsq(rows, np.ones(len(x)), rcond=None)
    shape = np.array([[a, b / 2], [b / 2, c]])
    if not np.linalg.det(shape) > 0 or not a > 0:
        return None
    center = -np.linalg.solve(shape, [d, e]) / 2
    scale = 1 + center @ shape @ center
    radius = float((scale**2 / np.linalg.det(shape)) ** 0.25)
    offset = np.stack([x, y], axis=-1) - center
    off = np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", offset, shape, offset) / scale, 0.0)) - 1
    # A square's corners lie on a circle, too.
    if np.abs(off).max() > ROUND or abs(area / (np.pi * radius**2) - 1) > 4 * ROUND:
        return None
    return float(middle[0] + size * center[0]), float(middle[1] + size * center[1]), size * radius


def circles_of(found: list[tuple[float, float, float]], name: str) -> Array:
    """Circles as an array (m, 3); raises InputError for more than `MOST_CIRCLES`, or numbers beyond reason."""
    if len(found) > MOST_CIRCLES:
        raise InputError(f"at most {MOST_CIRCLES} circles in {name}", str(len(found)), "verify one marker at a time")
    circles = np.array(found, dtype=float).reshape(-1, 3)
    return circles[np.isfinite(circles[:, :2]).all(axis=-1) & (np.abs(circles[:, :2]) < 1e7).all(axis=-1)]
