"""Compare two solids along rays: where these enter and leave each of their bodies, on a grid in three directions.

Meshes are compared as they are, however their surfaces are divided into triangles and these into bodies: inner walls,
voids and what is there twice are crossings as any others. Triangles that no ray claims, since they are small, thin or
far away, are looked for one by one on the surface of the other solid.
"""

# tests: tests/verification/test_rays.py

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices, Mask
from markergen.geometry.region import pairs_in_boxes
from markergen.verification.rims import Rims, rims_of_parts

RAYS = 320
"""Number of rays across the largest side, 0.35 mm apart on a plate of 110 mm: 450 take twice the time."""

FINEST, LAYERS = 0.2, 60
"""Least distance of rays in mm, and their number across the smallest side, of which pockets are a few."""

OFFSETS = ((0.37, 0.41, 0.43), (0.64, 0.71, 0.78), (0.71, 0.05, 0.33))
"""Places of the first rays, as shares of their distance: what a ray grazes on two grids it does not on the third."""

STEEPEST = 1.0
"""Maximum distance in mm along a ray of two crossings of one surface, which it may meet at a small angle."""

CHORDS = 0.01
"""Distance in mm of the surface from the triangles of a file and of what it is compared with, beside the tolerance."""

LEAST_SLOPE = 0.3
"""Cosine between a ray and the normal of a surface below which it shows no color."""

MOST_ROWS = 2_000_000
"""Number of rows of rays, or of pairs of a point and a triangle, that are looked at together."""


@dataclass(frozen=True, eq=False)
class Shell:
    """Triangles of a solid in mm.

    Attributes
    ----------
    corners : array (m, 3, 3)
    owner : array (m,) of int
        Index of the part to which each triangle belongs.
    dark : array (m,) of bool or None
        Whether each is dark; None without colors.
    """

    corners: Array
    owner: Indices
    dark: Mask | None = None

    @cached_property
    def rims(self) -> Rims:
        """Round rims, of each part by itself."""
        return rims_of_parts(self.corners, self.owner)

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest z."""
        return float(self.corners[:, :, 2].min()), float(self.corners[:, :, 2].max())


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of rays with a solid: ray and side, coordinate, point (k, 3), triangle, and slope of this."""

    key: Indices
    along: Array
    points: Array
    triangle: Indices
    slope: Array


@dataclass(frozen=True, eq=False)
class Difference:
    """What two solids do not have in common.

    Attributes
    ----------
    extra, missing : arrays (k, 3) and (l, 3)
        Points of the surface that only the first or only the second has.
    missing_owner : array (l,) of int
        Parts to which the missing ones belong.
    repainted : array (k, 3)
        Points of the surface of both that are dark in one and light in the other.
    was_dark : array (k,) of bool
        Whether these should be dark.
    twice : array (k, 3)
        Points of the first that it has more often than the second.
    seen : array (parts,) of int
        Number of points of each part of the second.
    votes : array (parts, parts) of int
        Number of crossings that a part of the second has in common with one of the first.
    """

    extra: Array
    missing: Array
    missing_owner: Indices
    repainted: Array
    was_dark: Mask
    twice: Array
    seen: Indices
    votes: NDArray[np.int64]


def difference(solid: Shell, wanted: Shell, tolerance: float) -> Difference:
    """Compare a solid with the one that is wanted, in the same frame, within a tolerance in mm."""
    box = wanted.corners.reshape(-1, 3)
    low, size = box.min(axis=0), np.ptp(box, axis=0)
    pitch = np.clip(size / LAYERS, FINEST / 3, max(FINEST, float(size.max()) / RAYS))
    parts = int(wanted.owner.max(initial=-1)) + 1, int(solid.owner.max(initial=-1)) + 1
    collected = defaultdict[str, list[NDArray[Any]]](list)
    seen, votes = np.zeros(parts[0], int), np.zeros(parts, int)
    claimed = [np.zeros(len(shell.corners), bool) for shell in (solid, wanted)]
    for axis in range(3):
        mine, theirs, bad, pale = _along(solid, wanted, axis, low, low + size, pitch, tolerance)
        seen += np.bincount(wanted.owner[theirs.triangle], minlength=parts[0])
        partner, is_met = _partners(theirs, mine, tolerance)
        pairs = wanted.owner[theirs.triangle[is_met]], solid.owner[mine.triangle[partner[is_met]]]
        np.add.at(votes, pairs, 1)
        other = pale[theirs.key // 2] & _repainted(solid, wanted, mine, theirs, tolerance)
        collected["repainted"].append(theirs.points[other])
        collected["was_dark"].append(wanted.dark[theirs.triangle[other]] if wanted.dark is not None else other[other])
        is_claimed = _partners(mine, theirs, tolerance)[1]
        claimed[0][mine.triangle[is_claimed]] = claimed[1][theirs.triangle[is_met]] = True
        extra = ~is_claimed & bad[mine.key // 2]
        missing = ~is_met & bad[theirs.key // 2]
        collected["extra"].append(mine.points[extra])
        collected["missing"].append(theirs.points[missing])
        collected["missing_owner"].append(wanted.owner[theirs.triangle[missing]])
        rest = bad[mine.key // 2] & ~np.isin(mine.key, np.concatenate([mine.key[extra], theirs.key[missing]]))
        rays = max(mine.key.max(initial=0), theirs.key.max(initial=0)) + 1
        counts = [np.bincount(crossings.key, minlength=rays) for crossings in (mine, theirs)]
        collected["twice"].append(mine.points[rest & (counts[0] > counts[1])[mine.key]])
    for name, shell, surface, by_ray in (("extra", solid, wanted, claimed[0]), ("missing", wanted, solid, claimed[1])):
        unmet = np.flatnonzero(~by_ray)
        strays = unmet[~_on_surface(shell.corners[unmet], surface.corners, tolerance)]
        collected[name].append(shell.corners[strays].mean(axis=1))
    # Of the wanted ones, which come last.
    collected["missing_owner"].append(wanted.owner[strays])
    seen += np.bincount(wanted.owner[unmet], minlength=parts[0])
    return Difference(seen=seen, votes=votes, **{name: np.concatenate(rows) for name, rows in collected.items()})


def _along(
    solid: Shell, wanted: Shell, axis: int, low: Array, high: Array, pitch: Array, tolerance: float
) -> tuple[Crossings, Crossings, Mask, Mask]:
    """Crossings of both along an axis, and on which rays they differ on all grids in place and in color."""
    results, differing = [], None
    counts = np.ceil((high - low) / pitch).astype(int) + 3
    bad, pale = np.ones((2, int(np.delete(counts, axis).prod())), dtype=bool)
    for offset in OFFSETS:
        origin = low - pitch * (1 - np.array(offset))
        mine, theirs = (_crossings(shell.corners, axis, origin, pitch, counts, differing) for shell in (solid, wanted))
        results.append((mine, theirs))
        differs = np.not_equal(*(np.bincount(crossings.key, minlength=2 * len(bad)) for crossings in (mine, theirs)))
        for one, other in ((mine, theirs), (theirs, mine)):
            differs[one.key[~_partners(one, other, tolerance)[1]]] = True
        bad &= differs.reshape(-1, 2).any(axis=1)
        painted = theirs.key[_repainted(solid, wanted, mine, theirs, tolerance)] // 2
        pale &= np.bincount(painted, minlength=len(pale)) > 0
        differing = bad | pale
        if not differing.any():
            break
    return *results[0], bad, pale


def _repainted(solid: Shell, wanted: Shell, mine: Crossings, theirs: Crossings, tolerance: float) -> Mask:
    """Tell which crossings with the second are of another color in the first."""
    if solid.dark is None or wanted.dark is None:
        return np.zeros(len(theirs.key), dtype=bool)
    colored = (
        replace(theirs, key=2 * theirs.key + wanted.dark[theirs.triangle]),
        replace(mine, key=2 * mine.key + solid.dark[mine.triangle]),
    )
    # A ring and its core are a few um apart: any crossing of that color will do.
    other = _partners(theirs, mine, tolerance)[1] & ~_partners(*colored, tolerance)[1]
    return np.asarray(other & (theirs.slope > LEAST_SLOPE))


def _partners(one: Crossings, other: Crossings, tolerance: float) -> tuple[Indices, Mask]:
    """Index of the nearest crossing of the other on the same ray and side, and whether it is the same surface."""
    if not len(other.key):
        return np.zeros(len(one.key), int), np.zeros(len(one.key), bool)
    span = 4 * max(np.abs(one.along).max(initial=1.0), np.abs(other.along).max(initial=1.0))
    have, want = one.key * span + one.along, other.key * span + other.along
    order = np.argsort(want, kind="stable")
    after = np.clip(np.searchsorted(want[order], have), 1, len(want) - 1) if len(want) > 1 else np.zeros(len(have), int)
    before = np.maximum(after - 1, 0)
    nearest = order[np.where(np.abs(want[order[after]] - have) < np.abs(want[order[before]] - have), after, before)]
    away = np.abs(want[nearest] - have)
    return nearest, (away < STEEPEST) & (away * np.maximum(one.slope, other.slope[nearest]) <= tolerance)


def _crossings(
    corners: Array, axis: int, origin: Array, pitch: Array, counts: Indices, chosen: Mask | None = None
) -> Crossings:
    """Crossings of the rays along an axis with triangles, each with its side: 1 where the ray leaves, else 0.

    Triangles with a common edge share the same numbers on it, so that a ray crosses one of them. Only the rays that are
    chosen are looked at, if some are.
    """
    u, v = (axis + 1) % 3, (axis + 2) % 3
    flat = (corners[:, :, [u, v]] - origin[[u, v]]) / pitch[[u, v]]
    wanted = None if chosen is None else chosen.reshape(counts[v], counts[u])
    rows = [_rays(flat, chunk, wanted, counts[[u, v]]) for chunk in _chunks(flat, counts[v])]
    triangle, column, row = (np.concatenate(arrays) for arrays in zip(*rows, strict=True)) if rows else (
        np.zeros(0, int) for _ in range(3)
    )  # fmt: skip
    first, second, third = np.moveaxis(flat[triangle], 1, 0)
    a, b = second - first, third - first
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    c = np.column_stack([column, row]) - first
    s, t = (c[:, 0] * b[:, 1] - c[:, 1] * b[:, 0]) / area, (a[:, 0] * c[:, 1] - a[:, 1] * c[:, 0]) / area
    depth = corners[triangle, :, axis]
    along = depth[:, 0] + s * (depth[:, 1] - depth[:, 0]) + t * (depth[:, 2] - depth[:, 0])
    normal = normals_of(corners)
    slope = np.abs(normal[:, axis]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    points = np.empty((len(triangle), 3))
    points[:, axis], points[:, u], points[:, v] = along, origin[u] + pitch[u] * column, origin[v] + pitch[v] * row
    key = 2 * (column + counts[u] * row) + (area > 0)
    return Crossings(key.astype(np.int64), along, points, triangle, slope[triangle])


def _chunks(flat: Array, count: int) -> Iterator[Indices]:
    """Triangles with some area, in groups that few of the rows of rays cross."""
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    wide = np.flatnonzero(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 1e-9)
    low, high = (
        np.clip(np.ceil(ends), 0, count) for ends in (flat[wide, :, 1].min(axis=1), flat[wide, :, 1].max(axis=1))
    )
    rows = high - low
    group = (np.cumsum(rows) // MOST_ROWS).astype(int)
    for number in np.unique(group[rows > 0]):
        yield wide[(group == number) & (rows > 0)]


def _rays(flat: Array, chosen: Indices, wanted: Mask | None, counts: Indices) -> tuple[Indices, Indices, Indices]:
    """Triangle, column and row of each ray of a grid through triangles (n, 3, 2) in its units."""
    triangles = flat[chosen]
    first = np.clip(np.ceil(triangles[:, :, 1].min(axis=1)), 0, counts[1]).astype(np.int64)
    number = np.clip(np.ceil(triangles[:, :, 1].max(axis=1)), 0, counts[1]).astype(np.int64) - first
    which, row = counted(number)
    row += first[which]
    if wanted is not None:
        kept = np.asarray(wanted.any(axis=1))[row]
        which, row = which[kept], row[kept]
    start, end = triangles[which], np.roll(triangles, -1, axis=1)[which]
    # From below to above, whichever triangle has the edge.
    upward = (start[:, :, 1] <= end[:, :, 1])[:, :, None]
    start, end = np.where(upward, start, end), np.where(upward, end, start)
    here = row[:, None]
    is_crossed = (start[:, :, 1] <= here) != (end[:, :, 1] <= here)
    rise = np.where(is_crossed, end[:, :, 1] - start[:, :, 1], 1.0)
    at = start[:, :, 0] + (here - start[:, :, 1]) / rise * (end[:, :, 0] - start[:, :, 0])
    left = np.ceil(np.where(is_crossed, at, np.inf).min(axis=1))
    right = np.ceil(np.where(is_crossed, at, -np.inf).max(axis=1))
    good = np.isfinite(left) & np.isfinite(right)
    left, right = np.clip(left, 0, counts[0]), np.clip(right, 0, counts[0])
    which, row, left, right = which[good], row[good], left[good], right[good]
    pair, column = counted((right - left).astype(np.int64))
    column += left[pair].astype(np.int64)
    if wanted is not None:
        met = np.flatnonzero(wanted[row[pair], column])
        pair, column = pair[met], column[met]
    return chosen[which[pair]], column, row[pair]


def counted(number: Indices) -> tuple[Indices, Indices]:
    """For numbers (n,), the index of each counted item's number, and its place from 0."""
    which = np.repeat(np.arange(len(number)), number)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)


def _on_surface(triangles: Array, surface: Array, tolerance: float) -> Mask:
    """Tell which triangles (m, 3, 3) have their middle on others (n, 3, 3) that face the same side."""
    middles, normals = triangles.mean(axis=1), normals_of(triangles)
    lies, facing = np.zeros(len(triangles), bool), normals_of(surface)
    # A needle of a triangle has no side.
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    is_thin = np.linalg.norm(normals, axis=1) < tolerance * longest
    low, high = surface.min(axis=1) - tolerance, surface.max(axis=1) + tolerance
    for index, face in pairs_in_boxes(middles[:, :2], low[:, :2], high[:, :2], MOST_ROWS):
        close = (middles[index, 2] >= low[face, 2]) & (middles[index, 2] <= high[face, 2]) & ~lies[index]
        index, face = index[close], face[close]
        same = is_thin[index] | (np.einsum("ij,ij->i", normals[index], facing[face]) > 0)
        index, face = index[same], face[same]
        lies[index[_distances(middles[index], surface[face]) <= tolerance]] = True
    return lies


def normals_of(triangles: Array) -> Array:
    """Normals (m, 3) of triangles (m, 3, 3), out of the side that shows them counterclockwise: twice their areas."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _distances(points: Array, triangles: Array) -> Array:
    """Distances (m,) of points (m, 3) from triangles (m, 3, 3)."""
    sides, offsets = np.roll(triangles, -1, axis=1) - triangles, points[:, None] - triangles
    lengths = np.maximum(np.einsum("mki,mki->mk", sides, sides), 1e-300)
    share = np.clip(np.einsum("mki,mki->mk", offsets, sides) / lengths, 0.0, 1.0)
    to_sides = np.linalg.norm(offsets - share[..., None] * sides, axis=2).min(axis=1)
    normals = normals_of(triangles)
    inward = np.cross(normals[:, None], sides)
    is_over = (np.einsum("mki,mki->mk", inward, offsets) >= 0).all(axis=1)
    sizes = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    to_plane = np.abs(np.einsum("mi,mi->m", normals, offsets[:, 0])) / sizes
    return np.asarray(np.where(is_over, to_plane, to_sides))
