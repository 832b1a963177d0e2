"""Round rims of a solid: circles on which its surface has an edge, whatever it is divided into."""

# tests: tests/verification/test_solid_readers.py

from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.geometry.contour import fitted_sphere
from markergen.verification.matching import CONCENTRIC, DotSet
from markergen.verification.reading import ALIKE

SHARP = (1 + np.cos(np.radians(20.0)) ** 2) / 2
"""Mean squared cosine between normals at an edge; the sides of a circle are up to 5.6 degrees apart."""

LEAST = 8
"""Minimum number of corners of a circle."""

ROUND = 0.02
"""Maximum distance of corners from a circle, as a share of its radius."""

FLUSH = 1e-3
"""Maximum difference of height in mm of the rims of one dot."""

FACING = 0.1
"""Minimum share of the normals at a rim that point to one side: half of them at an edge, none where faces touch."""

WIDEST_GAP = 1.2
"""Maximum angle in rad without a corner on a circle."""


@dataclass(frozen=True, eq=False)
class Rims:
    """Circles in mm.

    Attributes
    ----------
    centers, normals : arrays (k, 3)
        The normal points out of the level face at the rim.
    radii : array (k,)
    rough : array (k,)
        Maximum distance of the sides of the polygon from the circle.
    shell : array (k,) of int
        Body that has the rim, as triangles with common corners are one.
    reach : array (k,)
        Largest side of that body.
    """

    centers: Array
    normals: Array
    radii: Array
    rough: Array
    shell: Indices
    reach: Array

    def mapped(self, matrix: Array, translation: Array | float = 0.0) -> "Rims":
        """Map by a rotation (3, 3) and a translation in mm."""
        return replace(self, centers=self.centers @ matrix.T + translation, normals=self.normals @ matrix.T)

    def take(self, chosen: Mask) -> "Rims":
        """Select some."""
        return Rims(*(values[chosen] for values in vars(self).values()))


def rims_of(corners: Array) -> Rims:
    """Circles on the surface of triangles (m, 3, 3)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    places, triangles = welded(corners)
    first, second, third = (places[triangles[:, k]] for k in range(3))
    normals = np.cross(second - first, third - first)
    length = np.linalg.norm(normals, axis=1)
    proper = length > 1e-12
    triangles, normals = triangles[proper], normals[proper] / length[proper, None]
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    count = len(places)
    _, edge, size = np.unique(
        np.minimum(start, end) * count + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    sums = np.stack([np.bincount(edge, np.repeat(axis, 3)) for axis in normals.T], axis=1)
    # The squared norm of the sum of n n', so that two walls that touch are one.
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    squares = [np.bincount(edge, np.repeat(normals[:, i] * normals[:, j], 3)) ** 2 * (1 + (i != j)) for i, j in pairs]
    is_sharp = (np.sum(squares, axis=0) < SHARP * size**2) | (size == 1)
    sides = np.flatnonzero(is_sharp[edge])

    def pieces(first: Indices, second: Indices) -> Indices:
        links = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(count, count))
        return np.asarray(connected_components(links, directed=False)[1])

    shells, loops = pieces(start, end), pieces(start[sides], end[sides])
    order = np.argsort(loops[start[sides]], kind="stable")
    cuts = np.flatnonzero(np.diff(loops[start[sides]][order])) + 1
    rows = []
    by_shell = np.argsort(shells, kind="stable")
    starts = np.searchsorted(shells[by_shell], np.arange(shells.max() + 1))
    low, high = (ends.reduceat(places[by_shell], starts) for ends in (np.minimum, np.maximum))
    reach = (high - low).max(axis=1)
    for group in np.split(order, cuts):
        if len(group) < LEAST:
            continue
        loop = sides[group]
        circle = _circle(places[np.unique(start[loop])])
        if circle is not None:
            center, normal, radius = circle
            # Normals of the wall cancel around the rim; where two bodies touch, those of both faces may.
            outward = float(normal @ sums[edge[loop]].sum(axis=0)) / float(size[edge[loop]].sum())
            ways = [np.sign(outward)] if abs(outward) > FACING else [1.0, -1.0]
            middles = (places[start[loop]] + places[end[loop]]) / 2
            rough = np.abs(np.linalg.norm(middles - center, axis=1) - radius).max()
            shell = shells[start[loop[0]]]
            rows += [(*center, *(way * normal), radius, rough, shell, reach[shell]) for way in ways]
    table = np.array(rows, dtype=float).reshape(-1, 10)
    return Rims(table[:, :3], table[:, 3:6], table[:, 6], table[:, 7], table[:, 8].astype(int), table[:, 9])


def rims_of_parts(corners: Array, owner: Indices) -> Rims:
    """Circles on the surface of each part by itself, of triangles (m, 3, 3) in the order of the parts that own them."""
    several = [rims_of(part) for part in np.split(corners, np.flatnonzero(np.diff(owner)) + 1)]
    columns = {name: np.concatenate([getattr(rims, name) for rims in several]) for name in vars(several[0])}
    before = np.cumsum([0, *(rims.shell.max(initial=0) + 1 for rims in several[:-1])])
    columns["shell"] += np.repeat(before, [len(rims.radii) for rims in several])
    return Rims(**columns)


def welded(corners: Array) -> tuple[Array, Indices]:
    """Different points (n, 3) of triangles (m, 3, 3), and these as indices (m, 3).

    Points are distinguished by a hash of 64 bits, in a fifth of the time that sorting them takes.
    """
    # Adding 0.0 makes -0.0 and 0.0 the same coordinate.
    points = np.ascontiguousarray(corners.reshape(-1, 3) + 0.0)
    bits = points.view(np.uint64) >> np.uint64(20) ^ points.view(np.uint64) << np.uint64(44)
    key = bits @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    return points[first], index.reshape(-1, 3)


def _circle(points: Array) -> tuple[Array, Array, float] | None:
    """Center, unit normal and radius of the circle through points (k, 3); None if they are on none."""
    middle = points.mean(axis=0)
    offset = points - middle
    _, sizes, axes = np.linalg.svd(offset, full_matrices=False)
    if len(points) < LEAST or not sizes[1] > 0.5 * sizes[0] or sizes[2] > 1e-3 * sizes[1]:
        return None
    flat = offset @ axes[:2].T
    center, radius = fitted_sphere(flat)
    if not radius > 0 or np.abs(np.linalg.norm(flat - center, axis=1) - radius).max() > ROUND * radius:
        return None
    angles = np.sort(np.arctan2(*(flat - center).T[::-1]))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > WIDEST_GAP:
        return None
    return middle + center @ axes[:2], axes[2], radius


def dots_of(rims: Rims, sizes: Array) -> DotSet:
    """Dots of rims of about the radii (k,) in mm: those of bodies of their size, or the highest ones."""
    # Balls have theirs below.
    level_rims = rims.take(np.abs(rims.normals[:, 2]) > 1 - 1e-5)
    sized = np.abs(np.log(np.maximum(level_rims.radii[:, None], 1e-12) / sizes)).min(axis=1, initial=np.inf) < np.log(
        ALIKE
    )
    free, rows = sized.copy(), []
    # From above, since a dot on the far face of a body may lie almost behind this one.
    for index in np.argsort(-level_rims.centers[:, 2], kind="stable"):
        if not free[index]:
            continue
        apart = np.linalg.norm(level_rims.centers[:, :2] - level_rims.centers[index, :2], axis=1)
        around = apart <= np.maximum(CONCENTRIC * np.minimum(level_rims.radii, level_rims.radii[index]), FLUSH)
        free &= ~(around & sized)
        of_disk = around & sized & (level_rims.reach < 2 * ALIKE * level_rims.radii)
        chosen = of_disk if of_disk.any() else around & sized
        top = level_rims.centers[chosen, 2].max()
        candidates = np.flatnonzero(chosen & (level_rims.centers[:, 2] > top - FLUSH))
        misfit = np.abs(np.log(level_rims.radii[candidates][:, None] / sizes)).min(axis=1)
        best = candidates[np.argmin(misfit)]
        # The hole of a half-ball, whose rim faces down, is above it; at its height are its stem and the pocket for it.
        lowest = top - FLUSH if level_rims.normals[best, 2] > 0 else top + FLUSH
        inside = around & (level_rims.centers[:, 2] > lowest) & (level_rims.normals[:, 2] > 0)
        inside &= level_rims.radii < level_rims.radii[best] / ALIKE
        inside &= (level_rims.shell == level_rims.shell[best]) if of_disk.any() else inside
        rough = level_rims.rough[around & (level_rims.radii < ALIKE * level_rims.radii[best])].max()
        hole = level_rims.radii[inside].max(initial=0.0)
        x, y, height = level_rims.centers[best]
        rows.append((x, y, level_rims.radii[best], hole, 0.0, rough, height))
    table = np.array(rows, dtype=float).reshape(-1, 7)
    return DotSet(table[:, :2], *table[:, 2:].T, ordered=False)
