"""Closed polygons as edges: how deep points lie in what they enclose, and which way is straight in."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.model.segments import Index, Mask, Segments

Array = NDArray[np.float64]


class Edges:
    """Edges of closed polygons (m, 2) in m with the region to their left, of some size in m."""

    def __init__(self, rings: Sequence[Array], size: float) -> None:
        self._sizes, self._size = [len(ring) for ring in rings], size
        self._edges = Segments(np.concatenate(rings), np.concatenate([np.roll(r, -1, axis=0) for r in rings]))

    def depth(self, points: Array) -> Array:
        """Signed distances (P,) in m from points (P, 2) to the nearest edge, positive inside."""
        sign, offset, _, _ = self._seen_from(points)
        return sign * np.hypot(*offset.T)

    def depth_gradient(self, points: Array) -> Array:
        """Gradients (P, 2) of `depth`; where several edges are nearest, one of them decides."""
        sign, offset, index, at_corner = self._seen_from(points)
        distance = np.hypot(*offset.T)
        apart = distance > 1e-12 * self._size
        # Beside an edge this is its normal, which has no rounding even on the outline; in a corner the mean of two.
        gradient = self._edges.normal[index]
        within = at_corner & ~apart
        gradient[within] = self._bisectors[self._corner(points[within], index[within])]
        around = at_corner & apart
        gradient[around] = offset[around] * (sign[around] / distance[around])[:, None]
        return gradient

    def _seen_from(self, points: Array) -> tuple[Array, Array, Index, Mask]:
        """Sign (P,), 1 inside and -1 outside, offset (P, 2) from the nearest point, its edge, and whether at a corner.

        The side of the nearest edge tells inside from outside; at a corner the sides of both its edges do, unless
        outlines touch there: then all edges have a say.
        """
        edges, (before, _, sharp, touching) = self._edges, self._corners
        index = edges.nearest(points)
        place = edges.place(points, index)
        left = self._left_of(points, index)
        at_corner = (place <= 0) | (place >= 1)
        if at_corner.any():
            where = np.flatnonzero(at_corner)
            corner = self._corner(points[where], index[where])
            one, other = (self._left_of(points[where], edge) for edge in (corner, before[corner]))
            left[where] = np.where(sharp[corner], one & other, one | other)
            where = where[touching[corner]]
            left[where] = edges.surround(points[where])
        return np.where(left, 1.0, -1.0), points - edges.at(index, place), index, at_corner

    def _corner(self, points: Array, index: Index) -> Index:
        """Corners (P,), those ends of edges that are nearer."""
        return np.where(self._edges.place(points, index) > 0.5, self._corners[1][index], index)

    @cached_property
    def _bisectors(self) -> Array:
        normal = self._edges.normal
        both = normal + normal[self._corners[0]]
        return both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), np.finfo(float).tiny)

    def _left_of(self, points: Array, index: Index) -> Mask:
        step, offset = self._edges.step[index], points - self._edges.start[index]
        return step[:, 0] * offset[:, 1] >= step[:, 1] * offset[:, 0]

    @cached_property
    def _corners(self) -> tuple[Index, Index, Mask, Mask]:
        """Of every corner: the one before it, the one after it, whether it turns left, and whether outlines touch."""
        import shapely

        first = np.cumsum([0, *self._sizes[:-1]])
        numbers = [start + np.arange(size) for start, size in zip(first, self._sizes, strict=True)]
        before, after = (np.concatenate([np.roll(ring, turn) for ring in numbers]) for turn in (1, -1))
        edges = self._edges
        sharp = edges.step[before, 0] * edges.step[:, 1] > edges.step[before, 1] * edges.step[:, 0]
        tree = shapely.STRtree(shapely.linestrings(np.stack([edges.start, edges.end], axis=1)))
        near, _ = tree.query(shapely.points(edges.start), predicate="dwithin", distance=1e-9 * self._size)
        return before, after, sharp, np.bincount(near, minlength=len(edges)) > 2
