"""Affine distance of layouts: how much no affine map of one explains of the other.

A camera far away takes a plate to its image by an affine map that does not mirror, and any such map is
one for some pose. Two plates look alike as far as one of these maps takes the dots of one to those of the other,
whichever dot goes to whichever: at a large tilt, key rings look like disks. Their distance is the RMS of what is left,

    D(A, B) = min over labelings s and affine maps M of sqrt(mean |A_j - M(B_s(j))|^2),

in m on plate A: A minus its projection on the coordinates of B_s. Layouts that have all dots but one in common differ
by a single dot, which may be hidden: `partial_distance` is the same without any one pair of dots. `foreign_safety`
checks the first with poses and perspective, in px.
"""

from dataclasses import replace
from functools import cache
from itertools import permutations
from typing import NamedTuple

import numpy as np

from markergen.arrays import Array, Indices
from markergen.bounds.confusion.perspective import (
    ANGLES_OF_MANY,
    MANY,
    NEAR,
    REPRESENTATIVE,
    REPRESENTATIVE_OF_MANY,
    find_rivals,
    followed,
    representative,
)
from markergen.bounds.confusion.rival_fits import Rivals, SeenLayout, seen_layout
from markergen.defaults import NOISE_PX
from markergen.objectives import Setting

ENUMERATED, RINGS_TOLD = 8, 7
"""Number of dots up to which all labelings are tried, beyond it those of `ANGLES_OF_MANY` rotations, to the nearest
dots; and from which on labelings keep the key ring, as there would be too many others."""

FITTED = 8
"""Number of labelings per pose that are fitted with perspective: those that an affine map fits best."""

FOLLOWED, FOLLOWED_POSES = 4, 60
"""Numbers of nearest labelings, and of poses to which they are followed from those where they were found."""

AT_ONCE = 4_000_000
"""Numbers in one batch of labelings."""


def affine_distance(layouts: Array, other: Array) -> Array:
    """D (B,) in m from layouts (B, n, 2) to another one (n, 2).

    inf for another number of dots.
    """
    n = layouts.shape[1]
    if n != len(other):
        return np.full(len(layouts), np.inf)
    if n > ENUMERATED:
        return _nearest_distance(layouts, other)
    return _least(layouts, _orthonormal(other), _labelings(n, n >= RINGS_TOLD))


def partial_distance(layouts: Array, other: Array) -> Array:
    """Distance (B,) as of `affine_distance`, without the dot of each layout and the one of the other that differ most.

    With e the residual of a dot and h its leverage, leaving it out takes |e|^2/(1 - h) from the sum of squares. inf for
    more than `ENUMERATED` dots, or another number of them.
    """
    n = layouts.shape[1]
    if n != len(other) or n > ENUMERATED:
        return np.full(len(layouts), np.inf)
    return _least(layouts, _orthonormal(other), _labelings(n, n >= RINGS_TOLD), True)


def self_distance(layouts: Array) -> Array:
    """D (B,) in m of layouts (B, n, 2) to themselves with disks exchanged; inf for more than `ENUMERATED` dots."""
    if layouts.shape[1] > ENUMERATED:
        return np.full(len(layouts), np.inf)
    return _least(layouts, _orthonormal(layouts), _labelings(layouts.shape[1], True)[1:])


def _least(layouts: Array, basis: Array, labelings: Indices, partly: bool = False) -> Array:
    """Smallest D (B,) over labelings (S, n), given orthonormal coordinates (n, 2) or (B, n, 2) of the others' dots."""
    n = layouts.shape[1]
    size = max(1, AT_ONCE // (2 * labelings.size))
    squares = []
    for start in range(0, len(layouts), size):
        part = slice(start, start + size)
        part_basis = basis if basis.ndim == 2 else basis[part]
        squares.append(_left(layouts[part], part_basis[..., labelings, :], partly).min(axis=-1))
    return np.sqrt(np.maximum(np.concatenate([np.zeros(0), *squares]), 0) / (n - partly))


def _left(layouts: Array, coordinates: Array, partly: bool = False) -> Array:
    """Sum of squares (B, S) that no affine map explains, of all dots or without one; inf for a map that mirrors.

    Parameters
    ----------
    layouts : array (B, n, 2)
    coordinates : array (S, n, 2) or (B, S, n, 2)
        Orthonormal ones of the others' dots, by labeling.
    """
    n = layouts.shape[1]
    centered = layouts - layouts.mean(axis=1, keepdims=True)
    # Sums over two coordinates or a few dots are written out: reductions along short axes take most of the time.
    if coordinates.ndim == 3:
        # One product of large matrices.
        rows, columns = coordinates.swapaxes(1, 2).reshape(-1, n), centered.transpose(1, 2, 0).reshape(n, -1)
        share = (rows @ columns).reshape(-1, 2, 2, len(layouts)).transpose(1, 2, 3, 0)
    else:
        share = np.einsum("bsnk,bnd->kdbs", coordinates, centered)
    (a, b), (c, d) = share = np.ascontiguousarray(share)
    left = np.sum(centered**2, axis=(1, 2))[:, None] - (a * a + b * b + c * c + d * d)
    left[a * d <= b * c] = np.inf
    if partly:
        most = np.zeros_like(left)
        for place in range(n):
            x, y = coordinates[..., place, 0], coordinates[..., place, 1]
            across = centered[:, None, place, 0] - x * a - y * c
            up = centered[:, None, place, 1] - x * b - y * d
            free = np.maximum(1 - 1 / n - (x * x + y * y), 1e-9)
            np.maximum(most, (across * across + up * up) / free, out=most)
        left -= most
    return left


def _nearest_distance(layouts: Array, other: Array) -> Array:
    """Lower estimate of D (B,) for many dots: whitened sets at every rotation, each dot to the nearest of the other."""
    angle = 2 * np.pi * np.arange(ANGLES_OF_MANY) / ANGLES_OF_MANY
    turns = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], axis=-1).reshape(-1, 2, 2)
    rotated = _orthonormal(other) @ turns
    distances = []
    for layout in layouts:
        gaps = np.sum((_orthonormal(layout)[None, :, None] - rotated[:, None]) ** 2, axis=-1).min(axis=-1)
        spread = np.sqrt(np.mean((layout - layout.mean(axis=0)) ** 2))
        distances.append(spread * np.sqrt(gaps.sum(axis=-1).min() / 2))
    return np.array(distances)


def _orthonormal(points: Array) -> Array:
    """Coordinates (..., n, 2) of points in their own axes, orthonormal as columns, not mirrored."""
    centered = points - points.mean(axis=-2, keepdims=True)
    values, vectors = np.linalg.eigh(centered.swapaxes(-1, -2) @ centered)
    scale = 1 / np.sqrt(np.maximum(values, 1e-12 * values[..., 1:] + 1e-300))
    return np.asarray(centered @ (vectors * scale[..., None, :]) @ vectors.swapaxes(-1, -2))


@cache
def _labelings(n: int, keyed: bool) -> Indices:
    """All labelings (S, n), or those that keep dot 0, the key ring; the identity is the first."""
    every = ((0, *order) for order in permutations(range(1, n))) if keyed else permutations(range(n))
    return np.array(list(every), dtype=np.intp)


def likeness(points: Array, among: Array) -> float:
    """Least deviation of a layout (n, 2) from an affine image of dots among others (m, 2), the first on the first.

    The largest distance in m over the radius of the layout, for the best of all choices of three more dots that
    determine the map; each further dot is compared with the nearest of the others. inf if there are more dots than
    others.
    """
    if len(points) > len(among):
        return np.inf
    size = float(np.linalg.norm(points - points.mean(axis=0), axis=-1).max())
    rest = np.arange(1, len(among))
    best = np.inf
    basis = np.column_stack([points[:3], np.ones(3)])
    if abs(np.linalg.det(basis)) < 1e-9 * size**2:
        return best
    for pair in permutations(rest.tolist(), 2):
        # Maps the other layout's dots into this one's plane.
        corners = np.column_stack([among[np.array([0, *pair])], np.ones(3)])
        if abs(np.linalg.det(corners)) < 1e-12:
            continue
        moved = np.column_stack([among, np.ones(len(among))]) @ np.linalg.solve(corners, points[:3])
        away = np.linalg.norm(points[:, None] - moved, axis=-1).min(axis=1).max() / size
        best = min(best, float(away))
    return best


class ForeignSafety(NamedTuple):
    """Safety against taking a plate for another one.

    Attributes
    ----------
    px : float
        RMS displacement of the images of the dots below which the plate itself fits best.
    margin, undecided : float
        As of `LabelSafety`, with noise of `NOISE_PX`.
    """

    px: float = np.inf
    margin: float = np.inf
    undecided: float = 0.0


def foreign_safety(points: Array, other: Array, setting: Setting) -> ForeignSafety:
    """Least safety against taking a plate with dots `points` (n, 2) for one with `other` (n, 2), over all poses.

    Another number of dots is safe.
    """
    n = len(points)
    if n != len(other):
        return ForeignSafety()
    kinds = np.zeros(n, dtype=np.intp)
    kinds[0] = n >= RINGS_TOLD
    seen = seen_layout(points, kinds, setting.camera, setting.poses)
    scene = replace(seen, points=np.column_stack([other, np.zeros(n)]))
    at = representative(setting.poses, REPRESENTATIVE if n <= MANY else REPRESENTATIVE_OF_MANY)
    if n > ENUMERATED:
        return _of_nearest(find_rivals(scene, at), scene)
    labelings, basis = _labelings(n, n >= RINGS_TOLD), _orthonormal(other)
    images = scene.images[at] * [1, -1]
    left = _left(images, basis[labelings])
    best = np.argsort(left, axis=-1, kind="stable")[:, :FITTED]
    # The image of dot j is that of the other plate's dot s(j).
    taken = np.argsort(labelings, axis=-1)[best].reshape(-1, n)
    rivals = scene.fit(taken, np.repeat(at, best.shape[1]), rough=True)
    nearest = rivals.take(np.flatnonzero(rivals.px <= NEAR * rivals.px.min(initial=np.inf)))
    return _of_nearest(scene.refit(nearest), scene)


def _of_nearest(rivals: Rivals, scene: SeenLayout) -> ForeignSafety:
    if not len(rivals):
        return ForeignSafety()
    poses = representative(scene.poses, FOLLOWED_POSES)
    rivals = followed(scene, rivals, rivals.nearest_labelings(FOLLOWED, 0), poses)
    nearest = rivals.take(np.array([rivals.distance.argmin()]))
    (difference,), (share,) = scene.judged(nearest.distance, nearest.pose, NOISE_PX)
    return ForeignSafety(float(nearest.px[0]), float(difference), float(share))
