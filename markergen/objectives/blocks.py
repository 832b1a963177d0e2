"""The rows of a Jacobian in pairs, two to an image point, and 2x2 blocks that act on them."""

import numpy as np
from numpy.typing import NDArray

from markergen.maths.dot_noise import product

Array = NDArray[np.float64]


def in_pairs(rows: Array) -> Array:
    """Rows (..., 2n, k) as (..., n, 2, k)."""
    return rows.reshape(*rows.shape[:-2], -1, 2, rows.shape[-1])


def times_rows(blocks: Array, rows: Array) -> Array:
    """Rows (..., 2n, k) multiplied by blocks (..., n, 2, 2)."""
    return product(blocks, rows.reshape(*blocks.shape[:-1], rows.shape[-1])).reshape(rows.shape)


def row_products(left: Array, right: Array) -> Array:
    """Blocks (..., n, 2, 2) on the diagonal of left right', for rows (..., 2n, k)."""
    return np.einsum("...ik,...jk->...ij", in_pairs(left), in_pairs(right))
