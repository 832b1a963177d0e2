"""The pixels around the outlines of many ellipses, as one flat list."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_ENOUGH = 20_000
"""Pixels per ellipse. Of larger ones every second, third ... row is taken, but no fewer than 64 rows."""


@dataclass(frozen=True, eq=False)
class OutlinePixels:
    """N pixels of B ellipses, sorted by ellipse.

    Attributes
    ----------
    x, y : arrays (N,), px
    grey : array (N,)
    owner : array (N,) of int
        The ellipse that a pixel belongs to; near neighbors may share pixels.
    start : array (B + 1,) of int
        Pixels start[b] to start[b + 1] are those of ellipse b.
    """

    x: Array
    y: Array
    grey: Array
    owner: Indices
    start: Indices

    def of(self, chosen: NDArray[np.bool_]) -> "OutlinePixels":
        """Only the pixels of the chosen (B,) ellipses, which are numbered anew."""
        kept = chosen[self.owner]
        count = np.diff(self.start)[chosen]
        return OutlinePixels(
            self.x[kept],
            self.y[kept],
            self.grey[kept],
            np.repeat(np.arange(len(count)), count),
            np.concatenate([[0], np.cumsum(count)]),
        )


def outline_pixels(
    image: NDArray[np.uint8] | NDArray[np.uint16], center: Array, spread: Array, band: Array, filled: NDArray[np.bool_]
) -> OutlinePixels:
    """Collect the pixels within a distance of B outlines, row by row.

    Parameters
    ----------
    image : array (h, w)
    center : array (B, 2), px
    spread : array (B, 2, 2), px^2
        Q of the ellipse x'Q^-1 x = 1.
    band : array (B,), px
        The bands are bounded by the ellipses whose semi-axes are longer and shorter by this.
    filled : array (B,) of bool
        Take the inside as well.
    """
    height, width = image.shape
    values, vectors = np.linalg.eigh(spread)
    semi = np.sqrt(values)
    outer = np.einsum("bik,bk,bjk->bij", vectors, (semi + band[:, None]) ** 2, vectors)
    hollow = (semi[:, 0] > band + 1) & ~filled
    inner = np.einsum("bik,bk,bjk->bij", vectors, np.maximum(semi - band[:, None], 1e-3) ** 2, vectors)

    reach = np.sqrt(outer[:, 1, 1])
    top = np.clip(np.ceil(center[:, 1] - reach), 0, height).astype(int)
    bottom = np.clip(np.floor(center[:, 1] + reach), -1, height - 1).astype(int)
    area = np.pi * (semi + band[:, None]).prod(axis=-1)
    area -= np.where(hollow, np.pi * (semi - band[:, None]).prod(axis=-1), 0)
    stride = np.clip(np.minimum(area / _ENOUGH, (bottom - top) / 64).astype(int), 1, None)
    rows = np.maximum((bottom - top) // stride + 1, 0)
    owner = np.repeat(np.arange(len(center)), rows)
    y = top[owner] + stride[owner] * _count_up(rows)

    middle, half = _crossing(outer, center, owner, y)
    hole_middle, hole_half = _crossing(inner, center, owner, y)
    # Rows without a hole are split at the middle, so that each has two spans.
    no_hole = ~(hollow[owner] & (hole_half > 0))
    leave = np.where(no_hole, np.floor(middle), np.floor(hole_middle - hole_half))
    enter = np.where(no_hole, np.floor(middle) + 1, np.maximum(np.ceil(hole_middle + hole_half), leave + 1))
    first = np.stack([np.ceil(middle - half), enter], axis=-1).ravel()
    last = np.stack([leave, np.floor(middle + half)], axis=-1).ravel()
    first, last = np.maximum(first, 0).astype(int), np.minimum(last, width - 1).astype(int)
    length = np.maximum(last - first + 1, 0)

    columns = np.repeat(first, length) + _count_up(length)
    of_span = np.repeat(np.repeat(y, 2), length)
    owners = np.repeat(np.repeat(owner, 2), length)
    count = np.bincount(owners, minlength=len(center))
    return OutlinePixels(
        columns.astype(float),
        of_span.astype(float),
        image[of_span, columns].astype(float),
        owners,
        np.concatenate([[0], np.cumsum(count)]),
    )


def _count_up(lengths: Indices) -> Indices:
    """0, 1, ... length - 1 for each of the lengths, one after another."""
    starts = np.cumsum(lengths) - lengths
    return np.arange(int(lengths.sum())) - np.repeat(starts, lengths)


def _crossing(spread: Array, center: Array, owner: Indices, y: Indices) -> tuple[Array, Array]:
    """Middle and half length, px, of the part of row y inside each row's ellipse; length 0 where there is none."""
    q = spread[owner]
    up = y - center[owner, 1]
    determinant = np.maximum(q[:, 0, 0] * q[:, 1, 1] - q[:, 0, 1] ** 2, 0)
    half = np.sqrt(np.maximum(determinant / q[:, 1, 1] * (1 - up**2 / q[:, 1, 1]), 0))
    return center[owner, 0] + q[:, 0, 1] / q[:, 1, 1] * up, half
