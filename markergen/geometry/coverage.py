"""Exact pixel coverage of polygons, for sheets in pixels and for rendered camera images.

Our own, because OpenCV, Pillow and the like sample a pixel at a few points, and any error here adds to every later
error of a dot's center. The method is Green's theorem, pixel by pixel: a piece of an edge that stays within one pixel
and falls by dy (y points down) subtracts dy from every pixel to its right in its row, and from its own pixel dy times
the part of the pixel to the right of the piece. The cumulative sum along a row is the winding number times the covered
share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from markergen.arrays import Array, Indices

Grey = NDArray[np.float32]

FAINT = 1e-3
"""Minimum share of a pixel in a run; half a grey level is 2e-3."""

_BLOCK = 64
"""Number of rows painted at a time, so that the shares of a block fit in the processor's cache."""


@dataclass(frozen=True)
class Runs:
    """Runs of uniformly covered pixels, in raster order.

    Attributes
    ----------
    row, column, length : array (s,)
        Start of each run, and its number of pixels.
    share : array (s,)
        Covered share of each of its pixels, 0 to 1.
    """

    row: Indices
    column: Indices
    length: Indices
    share: Array


def polygon_coverage(outlines: Sequence[Array], width: int, height: int) -> tuple[Array, int, int]:
    """Fraction of each pixel's area inside closed polygons, exact to rounding.

    Parameters
    ----------
    outlines : arrays (m, 2), px; pixel centers at integer coordinates
        An outline that turns from x toward y adds its interior, one that turns the other way subtracts it.
    width, height : int, px

    Returns
    -------
    tile : array (h, w)
        Part of the image around the outlines; empty if they lie outside the image.
    top, left : int
        Pixel of the image at tile[0, 0].
    """
    steps, top, left = _tile_steps(outlines, width, height)
    return np.cumsum(steps, axis=1), top, left


def paint(image: Grey, outlines: Sequence[Array], value: ArrayLike, fineness: int) -> None:
    """Paint the inside of polygons in an image (fineness h, fineness w) in place with a value or an image of its size.

    Parameters
    ----------
    outlines : arrays (m, 2), in px of the image, not of its subpixels
        As for `polygon_coverage`, but with either overall orientation.
    """
    height, width = image.shape
    value = np.broadcast_to(np.asarray(value, dtype=np.float32), image.shape)
    steps, top, left = _tile_steps([(outline + 0.5) * fineness - 0.5 for outline in outlines], width, height)
    columns = slice(left, left + steps.shape[1])
    for first in range(0, len(steps), _BLOCK):
        share = np.cumsum(steps[first : first + _BLOCK], axis=1)
        rows = slice(top + first, top + first + len(share))
        part = image[rows, columns]
        change = value[rows, columns] - part
        change *= np.abs(share, dtype=np.float32, casting="same_kind")
        part += change


def covered_runs(edges: Array, width: int, height: int) -> Runs:
    """Runs of pixels of a large raster covered by closed polygons, without storing a value for each pixel.

    Overlaps of polygons, such as strokes of a glyph, count once.

    Parameters
    ----------
    edges : array (m, 4), px from the raster's top left corner, y down
        Start and end of each edge, x0, y0, x1, y1, in any order.
    width, height : int, px

    Returns
    -------
    Runs
        All runs with a share of at least `FAINT`.
    """
    cells, changes = _changes(edges[:, :2], edges[:, 2:], np.array([width, height]))
    if not len(cells):
        return Runs(cells, cells, cells, changes)
    order = np.argsort(cells, kind="stable")
    cells, changes = cells[order], changes[order]
    first = np.flatnonzero(np.concatenate([[True], cells[1:] != cells[:-1]]))
    starts = cells[first]
    # Each row sums to zero, so one cumulative sum serves all rows.
    share = np.minimum(np.abs(np.cumsum(np.add.reduceat(changes, first))), 1.0)
    ends = np.append(starts[1:], starts[-1])
    row, column = np.divmod(starts, width + 2)
    length = np.minimum(ends - starts, width - column)
    kept = (share > FAINT) & (length > 0)
    return Runs(row[kept], column[kept], length[kept], share[kept])


@lru_cache(maxsize=16)
def unit_disk(count: int) -> Array:
    """Regular polygon (count, 2) about the origin with the area of the unit disk."""
    angle = 2 * np.pi * np.arange(count) / count
    # Regular polygon of circumradius R: area count R^2 sin(2 pi/count)/2.
    circumradius = np.sqrt(2 * np.pi / (count * np.sin(2 * np.pi / count)))
    return circumradius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def closing(outlines: Sequence[Array]) -> tuple[Indices, Indices]:
    """Start index of each outline in their concatenation, and the index of the vertex that follows each vertex."""
    lengths = np.array([len(outline) for outline in outlines])
    first = np.cumsum(lengths) - lengths
    following = np.arange(1, lengths.sum() + 1)
    filled = lengths > 0
    following[(first + lengths - 1)[filled]] = first[filled]
    return first, following


def _tile_steps(outlines: Sequence[Array], width: int, height: int) -> tuple[Array, int, int]:
    """Change (h, w) of the coverage from pixel to pixel along each row of a tile, and the tile's top and left."""
    # From here on in px from the image corner: pixel k spans k to k + 1.
    corners = [np.asarray(outline, dtype=float) + 0.5 for outline in outlines if len(outline) > 2]
    if not corners:
        return np.zeros((0, 0)), 0, 0
    start = np.concatenate(corners)
    low = np.maximum(np.floor(start.min(axis=0)), 0)
    high = np.minimum(np.ceil(start.max(axis=0)), [width, height])
    if np.any(high <= low):
        return np.zeros((0, 0)), 0, 0
    end = start[closing(corners)[1]]
    size = (high - low).astype(int)
    sums = np.bincount(*_changes(start - low, end - low, size), size[1] * (size[0] + 2))
    steps = np.asarray(sums, dtype=float).reshape(size[1], -1)[:, : size[0]]
    return steps, int(low[1]), int(low[0])


def _changes(start: Array, end: Array, size: Indices) -> tuple[Indices, Array]:
    """Cells of a tile (width, height), counted row by row, and the changes of coverage by edges (e, 2) there.

    Each row has two more cells than pixels, for changes beyond the right border of the tile.
    """
    start, end = _pieces(start, end, size)
    # y points down, so an ascending piece has the interior on its right.
    climb = start[:, 1] - end[:, 1]
    x, y = ((start + end) / 2).T
    # To the left of the tile a piece counts as at its left border, for the entire row; to the right it has no effect.
    x = np.clip(x, 0, size[0])
    column, row = x.astype(int), np.floor(y).astype(int)
    inside = (row >= 0) & (row < size[1])
    cell = (row * (size[0] + 2) + column)[inside]
    # A piece covers its own pixel from its mean x to the right border, and all pixels beyond; the next cell adds the
    # rest.
    inner = (climb * (column + 1 - x))[inside]
    return np.concatenate([cell, cell + 1]), np.concatenate([inner, climb[inside] - inner])


def _pieces(start: Array, end: Array, size: Indices) -> tuple[Array, Array]:
    """Split edges (e, 2) where they cross the lines between the pixels of a tile (width, height)."""
    step = end - start
    edges, shares = [np.arange(len(start))], [np.zeros(len(start))]
    for axis in (0, 1):
        low = np.clip(np.minimum(start[:, axis], end[:, axis]), -1, size[axis] + 1)
        high = np.clip(np.maximum(start[:, axis], end[:, axis]), -1, size[axis] + 1)
        first = np.floor(low).astype(int) + 1
        count = np.maximum(np.ceil(high).astype(int) - first, 0)
        edge = np.repeat(np.arange(len(start)), count)
        line = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
        edges.append(edge)
        shares.append((line - start[edge, axis]) / step[edge, axis])
    edge, share = np.concatenate(edges), np.concatenate(shares)
    # Sorted along each edge, edge by edge.
    # Stable, since a corner of pixels gives two cuts with the same share.
    order = np.argsort(edge + np.clip(share, 0, 1 - 1e-9), kind="stable")
    edge, share = edge[order], share[order]
    cuts = start[edge] + share[:, None] * step[edge]
    following = np.concatenate([cuts[1:], cuts[:1]])
    last = np.concatenate([edge[1:] != edge[:-1], [True]])
    following[last] = end[edge[last]]
    return cuts, following
