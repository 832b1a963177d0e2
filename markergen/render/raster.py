"""How much of each pixel a polygon covers: exact areas, since every later error of a dot's center starts here."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Indices = NDArray[np.intp]

_BLOCK = 64
"""Rows painted at a time, so that what is between image and polygon stays in the processor's cache."""


def polygon_coverage(outlines: Sequence[Array], width: int, height: int) -> tuple[Array, int, int]:
    """Fraction of each pixel's area inside closed polygons, exact to rounding.

    Green's theorem, pixel by pixel: a piece of an edge that stays within one pixel and falls by dy (y points down)
    takes dy off everything right of it in its row, and off its own pixel dy times the part right of the piece. What
    is right of all pieces is their running sum along the row.

    Parameters
    ----------
    outlines : arrays (m, 2), px; pixel centers at integer coordinates
        One that turns from x toward y adds what it encloses, one that turns the other way takes it off.
    width, height : int, px

    Returns
    -------
    tile : array (h, w)
        The part of the image around the outlines; empty where they lie outside the image.
    top, left : int
        The pixel of the image that tile[0, 0] belongs to.
    """
    steps, top, left = _row_steps(outlines, width, height)
    return np.cumsum(steps, axis=1), top, left


def paint(image: Grey, outlines: Sequence[Array], value: ArrayLike, fineness: int) -> None:
    """Cover an image (fineness h, fineness w) in place with a value, or an image of the same size, inside polygons.

    Parameters
    ----------
    outlines : arrays (m, 2), in px of the image, not of its subpixels
        As `polygon_coverage` takes them, but turning as a whole either way.
    """
    height, width = image.shape
    value = np.broadcast_to(np.asarray(value, dtype=np.float32), image.shape)
    steps, top, left = _row_steps([(outline + 0.5) * fineness - 0.5 for outline in outlines], width, height)
    columns = slice(left, left + steps.shape[1])
    for first in range(0, len(steps), _BLOCK):
        share = np.cumsum(steps[first : first + _BLOCK], axis=1)
        rows = slice(top + first, top + first + len(share))
        part = image[rows, columns]
        change = value[rows, columns] - part
        change *= np.abs(share, dtype=np.float32, casting="same_kind")
        part += change


def closing(outlines: Sequence[Array]) -> tuple[Indices, Indices]:
    """Where each of several outlines begins when they are put end to end, and which vertex follows each vertex."""
    lengths = np.array([len(outline) for outline in outlines])
    first = np.cumsum(lengths) - lengths
    following = np.arange(1, lengths.sum() + 1)
    filled = lengths > 0
    following[(first + lengths - 1)[filled]] = first[filled]
    return first, following


def _row_steps(outlines: Sequence[Array], width: int, height: int) -> tuple[Array, int, int]:
    """Change (h, w) of the coverage from pixel to pixel along each row of a tile, and the tile's place: top, left."""
    # From here on in px from the image's corner: pixel k lies between k and k + 1.
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
    start, end = _pieces(start - low, end - low, size)
    # y points down, so that a piece that climbs has what it encloses on its right.
    climb = start[:, 1] - end[:, 1]
    x, y = ((start + end) / 2).T
    # Left of the tile a piece counts for the whole row, as at its left border; past its right border for nothing.
    x = np.clip(x, 0, size[0])
    column, row = x.astype(int), np.floor(y).astype(int)
    inside = (row >= 0) & (row < size[1])
    # Two more columns take what leaves the tile on the right.
    cell = (row * (size[0] + 2) + column)[inside]
    own = (climb * (column + 1 - x))[inside]
    sums = np.bincount(
        np.concatenate([cell, cell + 1]), np.concatenate([own, climb[inside] - own]), size[1] * (size[0] + 2)
    )
    steps = np.asarray(sums, dtype=float).reshape(size[1], -1)[:, : size[0]]
    return steps, int(low[1]), int(low[0])


def _pieces(start: Array, end: Array, size: Indices) -> tuple[Array, Array]:
    """Cut edges (e, 2) where they cross the lines between the pixels of a tile (width, height)."""
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
    order = np.argsort(edge + np.clip(share, 0, 1 - 1e-9), kind="stable")
    edge, share = edge[order], share[order]
    cuts = start[edge] + share[:, None] * step[edge]
    following = np.concatenate([cuts[1:], cuts[:1]])
    last = np.concatenate([edge[1:] != edge[:-1], [True]])
    following[last] = end[edge[last]]
    return cuts, following
