"""The contents of a file in any format: pages of circles, in mm, y up, and what shows of them."""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.scene import Shape
from markergen.errors import InputError
from markergen.model.body import Body
from markergen.model.fabrication import Fabrication
from markergen.registry import Registry
from markergen.verification.result import MOST_LISTED, Check, Finding

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


PRINTABLE = 20e-6
"""Default tolerance in m: less than printers and cutters show, more than programs round when they save a file."""

MOST_CIRCLES = 20_000
"""Maximum number of circles in one file; the largest marker has a thousand dots."""

FARTHEST = 1e7
"""Coordinates in mm beyond which a circle or line is left out, as are those that overflow."""

ROUND = 0.02
"""Maximum deviation of a round outline from its ellipse, as a share of the radius."""

SMALLEST, SAME = 0.5, 0.02
"""Minimum size in mm of a shape that may be there twice, and maximum distance of its sides from those of the other."""

OCTAGON = 0.11
"""Maximum deviation of the area of a round outline from that of its circle: a regular octagon lacks 0.0997."""

Findings = tuple[Finding, ...]

ALIKE = 1.3
"""Maximum ratio between the radii of a circle and of a dot that it may be."""

Circle = tuple[float, float, float, float]
"""Center and radius of a circle, and the largest distance of its outline from it."""

FLATTEST = 0.8
"""Minimum ratio of the semi-axes of an ellipse that counts as a stretched circle."""


@dataclass(frozen=True, eq=False)
class Page:
    """One page, or the entire file if it has no pages.

    Attributes
    ----------
    circles : array (m, 4)
        Center and radius of every complete circle, and the largest distance of its outline from it: mm, y up, in the
        order of the file.
    size : (width, height) or None
        Paper size, mm.
    corners : array (k, 2)
        Corners of the other outlines, mm, for tags.
    of_any_size : callable or None
        Returns such circles of any size, where only those that may be dots are listed.
    upright : callable or None
        Returns whether the page apart from the dots is unmirrored, None if that is unknown.
    picture : PagePicture or None
        What shows of the page.
    lines : array (k, 2, 2) or None
        Thin lines as straight pieces, mm, without those beyond `FARTHEST`; None if the format has none of its own.
    are_cut : bool
        True if the file says which lines are to be cut, and these are all of them.
    layers : tuple of str
        Layer of each circle, in formats whose layers say how things are made.
    hidden : tuple of str
        Layers that are switched off.
    unread : tuple of (name, corners (4, 2))
        What shows but is not read, such as text and images, and boxes that hold it, mm; nan if these are unknown.
    engraved : array (k, 2, 2) or None
        Lines to engrave as straight pieces, mm, in formats that have them.
    labels : tuple of Shape
        Words that our sheet has beside the outline, mm, marker frame: those of a plate of several.
    """

    circles: Array
    size: tuple[float, float] | None = None
    corners: Array = field(default_factory=lambda: np.zeros((0, 2)))
    of_any_size: Callable[[], Array] | None = None
    upright: Callable[[], bool | None] | None = None
    picture: PagePicture | None = None
    lines: Array | None = None
    are_cut: bool = False
    layers: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    unread: tuple[tuple[str, Array], ...] = ()
    engraved: Array | None = None
    labels: tuple[Shape, ...] = ()

    @property
    def measured(self) -> bool:
        """True if dots were measured in pixels: in no order, and diameters less accurately than centers."""
        return self.picture is not None and self.picture.measured

    def __post_init__(self) -> None:
        if self.lines is not None:
            within = (np.abs(self.lines) < FARTHEST).all(axis=(1, 2))
            object.__setattr__(self, "lines", self.lines[within])


@dataclass(frozen=True, eq=False)
class Reading:
    """Contents of a file.

    Attributes
    ----------
    kind : str
        Name of the format.
    pages : tuple of Page
    tolerance : float
        Default tolerance of the format, m.
    papers : tuple of (width, height)
        Sizes of the pages that were assembled into one, mm.
    findings : tuple of Finding
        What is wrong by itself: errors in the fit between these pages, and what would be made twice.
    alone : bool
        True if it can hold one marker, once.
    notes : tuple of str
        Remarks about how it was read.
    """

    kind: str
    pages: tuple[Page, ...]
    tolerance: float = PRINTABLE
    papers: tuple[tuple[float, float] | None, ...] = ()
    findings: Findings = ()
    alone: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Settings:
    """What a user says about a file that does not say it itself.

    Attributes
    ----------
    tolerance : float or None
        Allowed distance in m; None takes the format's own.
    fabrication : Fabrication
        Options with which a model that records none was made.
    unit : float or None
        Unit in mm of a drawing without one.
    """

    tolerance: float | None = None
    fabrication: Fabrication = field(default_factory=Fabrication)
    unit: float | None = None


Reader = Callable[[bytes, str, Body, Settings], Reading | Check]
"""Function that reads a file's bytes, or checks them; the name is for messages, and the body has the sizes of the dots.
"""

READERS: Registry[Reader] = Registry("suffix to verify", "markergen.verification")
"""Readers by suffix, dot included."""


def reader_of(path: Path) -> Reader:
    """Find the reader for a path by its longest known suffix; raises InputError with the known ones if none fits."""
    parts = path.name.lower().split(".")[1:]
    suffixes = ("." + ".".join(parts[start:]) for start in range(len(parts)))
    readable = (suffix for suffix in suffixes if suffix in READERS.names())
    return READERS[next(readable, "." + parts[-1] if parts else path.name)]


def circle_diameters(body: Body) -> list[float]:
    """Diameters in mm of all circles of a body's dots, those of the holes of rings among them."""
    features = [point.feature for plate in body.plates for point in plate.marker.control_points]
    return [1e3 * size for feature in features for size in (feature.diameter, feature.inner_diameter) if size]


def round_shape(points: Array) -> Circle | None:
    """Circle of a closed outline (m, 2), stretched a little at most; None if it is another shape.

    Fits a conic by least squares: its center is that of the ellipse however the points are distributed, and the radius
    is the geometric mean of its semi-axes.
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
    # The corners of a square lie on a circle too.
    if np.abs(off).max() > ROUND or abs(area / (np.pi * radius**2) - 1) > OCTAGON:
        return None
    sides = offset + (np.roll(offset, -1, axis=0) - offset) * np.linspace(0, 1, 3)[:2, None, None]
    away = size * float(np.abs(np.linalg.norm(sides, axis=-1) - radius).max())
    return float(middle[0] + size * center[0]), float(middle[1] + size * center[1]), size * radius, away


class Painted(NamedTuple):
    """A filled outline (m, 2) in mm, the number of its path, its color, and its circle if it is one."""

    points: Array
    path: int
    paint: str | int
    circle: Circle | None


def painted_again(shapes: Sequence[Painted]) -> list[tuple[float, float, float]]:
    """What is painted where its color is already: its middle, mm, and the radius of the circle that it lies in.

    The radius is 0 for outlines with the box of another one. Those of one path, as of a ring, belong together.
    """
    from scipy.spatial import cKDTree

    boxes = np.array([[*shape.points.min(axis=0), *shape.points.max(axis=0)] for shape in shapes]).reshape(-1, 4)
    large = np.flatnonzero(np.isfinite(boxes).all(axis=1) & ((boxes[:, 2:] - boxes[:, :2]).max(axis=1) > SMALLEST))
    shapes, boxes = [shapes[k] for k in large.tolist()], boxes[large]
    if len(shapes) < 2:
        return []
    middles = (boxes[:, :2] + boxes[:, 2:]) / 2
    pairs = [(k, j, 0.0) for k, j in sorted(cKDTree(boxes).query_pairs(SAME))]
    tree = cKDTree(middles)
    for k, (x, y, radius, _) in ((k, shape.circle) for k, shape in enumerate(shapes) if shape.circle):
        inside = sorted(set(tree.query_ball_point((x, y), radius)) - {k})
        pairs += [(k, j, radius) for j in inside
                  if np.linalg.norm(shapes[j].points - (x, y), axis=1).max() <= radius + SAME]  # fmt: skip
    again = {j: radius for k, j, radius in reversed(pairs)
             if shapes[k].paint == shapes[j].paint and shapes[k].path != shapes[j].path}  # fmt: skip
    return [(*middles[j].tolist(), radius) for j, radius in sorted(again.items())]


def findings_of(
    sentences: Iterable[str], kind: str = "twice", remedy: str = "remove one of both", most: int | None = MOST_LISTED
) -> Findings:
    """Findings about what would be made twice, or of another kind; `most` of them."""
    return tuple(Finding(kind, sentence, remedy) for sentence in islice(sentences, most))


def of_painted_again(again: Sequence[Sequence[float]], body: Body) -> Findings:
    """Findings about what is painted again, in circles of the size of dots: a ground is larger."""
    largest = max(circle_diameters(body))
    return findings_of(
        f"the shape around x {x:.4g}, y {y:.4g} mm of the page "
        + ("is there twice" if not radius else "is in a dot of its color")
        for x, y, radius in again
        if radius < largest
    )


def circles_of(rows: list[Circle], name: str) -> Array:
    """Circles as an array (m, 4), without those out of range; raises InputError for more than `MOST_CIRCLES`."""
    if len(rows) > MOST_CIRCLES:
        raise InputError(f"at most {MOST_CIRCLES} circles in {name}", str(len(rows)), "verify one marker at a time")
    circles = np.array(rows, dtype=float).reshape(-1, 4)
    return circles[(np.abs(circles[:, :2]) < FARTHEST).all(axis=-1)]
