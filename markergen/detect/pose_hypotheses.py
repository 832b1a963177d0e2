"""Poses guessed from pairs of blobs: the first blob's outline gives the plane, the second the rotation in it.

The outline of a disk of known size is consistent with two poses, up to the rotation about its normal (the ambiguity of
a circle). The ray through another blob's center meets either plane where that blob lies if it belongs to the marker:
its distance from the first must occur in the layout, and its size and shape must be those of a disk there. Few wrong
pairs pass. Triples or quadruples of blobs are never enumerated: the cost is only quadratic in the number of blobs.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect import kernel
from markergen.detect.blobs import Ellipses
from markergen.errors import InputError
from markergen.maths.batched import Batched
from markergen.model.marker import Marker

MANY_DOTS, NEAR_DOTS, PAIRED_DOTS = 16, 8, 5
"""Number of dots above which only neighbors form pairs; number of a dot's neighbors that confirm a guess, and of those
with which it forms pairs."""

_CHUNK = 1_000_000


@dataclass(frozen=True, eq=False)
class DotLayout:
    """Control points, their dots, and the pairs of them for guessing poses.

    Attributes
    ----------
    points : array (n, 3), m
        Of a flat marker in one plane, even if the places measured on a print are not.
    places : array (n, 3), m
        Places on the print, for the pose.
    radii : array (n,), m
    rings : array (n,) of bool
    flat : bool
        True if all are at the same height.
    pairs : array (q, 2) of int
        Ordered pairs of control points.
    near : array (n, k) of int
        The other dots nearest to each.
    reach : float
        Distance, in radii of a dot, within which another point can be assigned to it and to no other.
    """

    points: Array
    places: Array
    radii: Array
    rings: NDArray[np.bool_]
    flat: bool
    pairs: Indices
    near: Indices
    reach: float

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def corners(self) -> tuple[Indices, Array]:
        """First dots (t,) of all ordered triples that span the plane, and their matrices (t, 2, 2).

        A matrix takes offsets from the first dot to coordinates along the steps to the other two.
        """
        triples = np.array(list(permutations(range(len(self)), 3)), dtype=np.intp)
        sides = (self.points[triples[:, 1:], :2] - self.points[triples[:, :1], :2]).swapaxes(-1, -2)
        spread = np.abs(np.linalg.det(sides))
        wide = spread > 0.02 * spread.max()
        return triples[wide, 0], np.linalg.inv(sides[wide])


def layout_of(marker: Marker) -> DotLayout:
    """Prepare a marker for the search.

    Raises
    ------
    InputError
        If its control points are fewer than four or on one line, or a dot has no size.
    """
    points = marker.search_xyz
    features = [point.feature for point in marker.control_points]
    radii = np.array([feature.diameter / 2 for feature in features])
    if len(points) < 4:
        raise InputError("4 or more control points", f"n={len(points)}", "a pose needs four")
    if radii.min() == 0:
        raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
    centered = points - points.mean(axis=0)
    scatter = np.linalg.eigvalsh(centered.T @ centered)
    if scatter[1] <= 1e-6 * scatter[2]:
        raise InputError(
            "control points that span a plane", "all of them on one line", "use a layout that spans the plane"
        )
    rings = np.array([feature.kind == "ring" for feature in features])
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    reach = min(2.0, 0.5 * float((distance.min(axis=-1) / radii).min()))
    flat = not np.ptp(points[:, 2])
    near = np.argsort(distance, axis=-1, kind="stable")[:, : min(len(points) - 1, NEAR_DOTS)]
    return DotLayout(points, marker.xyz, radii, rings, flat, _pairs(points, rings, near), near, reach)


def _pairs(points: Array, rings: NDArray[np.bool_], near: Indices) -> Indices:
    """Return ordered pairs of points apart from each other, those with one ring first.

    Of many dots, only pairs of neighbors and those with a ring: blobs between others are clutter.
    """
    count = len(points)
    paired = np.ones((count, count), dtype=bool)
    if count > MANY_DOTS:
        paired[:] = rings[:, None] | rings
        np.put_along_axis(paired, near[:, :PAIRED_DOTS], True, axis=1)
    np.fill_diagonal(paired, False)
    pairs = np.argwhere(paired)
    lateral = np.linalg.norm(points[pairs[:, 1], :2] - points[pairs[:, 0], :2], axis=-1)
    # Short pairs determine the rotation badly, but neighbors among many are only the first of more.
    pairs = pairs[lateral > (0.25 * lateral.max() if count <= MANY_DOTS else 0)]
    one_ring = rings[pairs].sum(axis=-1) == 1
    return pairs[np.argsort(~one_ring, kind="stable")]


MAX_TRIALS = 12_000
"""Maximum number of pairs of blobs times pairs of control points in a round."""

MAX_ROUNDS = 600
"""Maximum number of rounds. With as many, 30 dots are found among a thousand."""

NEAR_BLOBS, NEAREST_BLOBS = 16, 10
"""Number of nearest blobs with which a blob forms pairs, of few dots and of many; with all if it is a
ring, or if blobs are few."""

VOTERS = 40
"""Number of nearest blobs among which near dots are looked for if a marker has many."""

LEAST_VOTES, STRONG_VOTES = 3, 0.75
"""Minimum number of near dots that must have a blob, beside the first of the pair; half of them if they are more. Share
of the near dots that makes a guess likely."""

_SLACK, _SLACK_PX = 0.2, 0.4
"""Tolerated error of a semi-axis: a share of it, which covers the change of perspective within a dot, plus px over the
smaller semi-axis, where the outline of small dots is blurred most."""

_GROWTH = 0.75
"""Tolerated error of two sizes' ratio, in units of that of their distance in radii, which changes with the ink."""

_DRIFT, _DRIFT_PX, _SIZE = 0.2, 1.5, 0.4
"""Tolerated error of a guess at a near dot: a share of its distance, plus px; and the logarithm of its size."""


@dataclass(frozen=True, eq=False)
class PoseHypotheses(Batched):
    """K guessed poses: rotation (K, 3, 3), translation (K, 3) in m.

    `start` (K,) is the control point that each starts from, `votes` (K,) the number of dots near it that have a blob.
    """

    rotation: Array
    translation: Array
    start: Indices
    votes: Indices


def guess_poses(
    ellipses: Ellipses,
    layout: DotLayout,
    px: float,
    rings_tell: bool = True,
    ringed: bool = False,
    likely: bool = False,
) -> Iterator[PoseHypotheses | None]:
    """Guess poses from pairs of blobs that a pair of dots could be, in rounds of bounded size; None if not all.

    In each round, the guesses with blobs at most of the near dots' places come first, the more consistent pairs first
    among equals.

    Parameters
    ----------
    px : float
        Pixels per unit of the normalized coordinates.
    rings_tell : bool
        True if rings match only rings, and disks only disks.
    ringed : bool
        True for pairs with a ring alone, and with blobs at any distance.
    likely : bool
        True for only those with most of the near dots.
    """
    pairs = layout.pairs
    if ringed:
        pairs = pairs[layout.rings[pairs].sum(axis=-1) == 1]
    if not len(pairs) or len(ellipses) < 2:
        return
    near = layout.near.shape[1]
    least = (math.ceil(STRONG_VOTES * near),) if likely else (max(LEAST_VOTES, near // 2), 1)
    shown = _Shown(ellipses, px)
    first, second = _neighbors(shown, layout, ringed)
    needed = 1 + 2 * len(first) * len(pairs) // MAX_TRIALS
    rounds = min(MAX_ROUNDS, needed)
    # Pairs of one blob stay in one round; blobs come in the detector's order, the best first.
    step = max(1, MAX_TRIALS // (2 * len(pairs)))
    for start in range(0, rounds * step, step):
        part = slice(start, start + step)
        seeds = (_round if kernel.library() is None else _compiled)(
            first[part], second[part], shown, layout, pairs, rings_tell, least
        )
        if len(seeds):
            yield seeds
    if rounds < needed:
        yield None


class _Shown:
    """Properties of ellipses that guesses need, computed once."""

    def __init__(self, ellipses: Ellipses, px: float) -> None:
        self.ellipses, self.px = ellipses, px
        self.position, self.normal = circle_poses(ellipses.center, ellipses.shape)
        shape = ellipses.shape
        self.area = np.sqrt(shape[:, 0, 0] * shape[:, 1, 1] - shape[:, 0, 1] ** 2)
        half = 0.5 * (shape[:, 0, 0] + shape[:, 1, 1])
        short = np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - self.area**2, 0)), 1e-300))
        self.slack = _SLACK + _SLACK_PX / (px * short)
        self.strange = ellipses.strange(np.array([False, True]))
        self.ray = np.concatenate([ellipses.center, np.ones((len(ellipses), 1))], axis=-1)


def _round(
    first: Indices,
    second: Indices,
    shown: _Shown,
    layout: DotLayout,
    pairs: Indices,
    rings_tell: bool,
    least: tuple[int, ...],
) -> PoseHypotheses:
    """Return the guesses from some pairs of blobs, those with the most near dots first."""
    ellipses = shown.ellipses
    # m: pair of blobs, with either of the first one's normals. q: pair of control points.
    side = np.repeat([0, 1], len(first))
    first, second = np.concatenate([first, first]), np.concatenate([second, second])
    p, n, ray = shown.position[first, side], shown.normal[first, side], shown.ray[second]
    toward = np.einsum("mi,mi->m", n, ray)
    allowed = np.hypot(shown.slack[first], shown.slack[second])
    fits = (toward < 0) & (_elongation(ellipses.shape[second], ellipses.center[second], n) < allowed)
    if rings_tell:
        kinds = np.unique(layout.rings[pairs], axis=0).astype(int)
        fits &= np.any([~shown.strange[i, first] & ~shown.strange[j, second] for i, j in kinds], axis=0)
    first, second, p, n, ray, toward, allowed = (each[fits] for each in (first, second, p, n, ray, toward, allowed))

    a, b = pairs.T
    step = layout.points[b] - layout.points[a]
    lateral = np.sum(step[:, :2] ** 2, axis=-1)
    away = np.einsum("mi,mi->m", n, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        if layout.flat:
            # In units of the first dot's radius, the second blob is at the same place for all pairs of dots.
            depth = away / toward
            square = np.sum((depth[:, None] * ray - p) ** 2, axis=-1)
            stretch = 0.5 * (np.log(lateral / layout.radii[a] ** 2) - np.log(square)[:, None])
            growth = np.log(layout.radii[b] / layout.radii[a])
            growth = growth + 0.5 * np.log(-toward / (depth**2 * shown.area[second]))[:, None]
            depth = depth[:, None] * layout.radii[a]
        else:
            depth = (away[:, None] * layout.radii[a] + step[:, 2]) / toward[:, None]
            square = (
                depth**2 * np.sum(ray**2, axis=-1)[:, None]
                - 2 * depth * layout.radii[a] * np.einsum("mi,mi->m", ray, p)[:, None]
                + layout.radii[a] ** 2 * np.sum(p**2, axis=-1)[:, None]
                - step[:, 2] ** 2
            )
            stretch = 0.5 * np.log(lateral / square)
            growth = 0.5 * np.log(layout.radii[b] ** 2 * -toward[:, None] / (depth**2 * shown.area[second][:, None]))
        good = (depth > 0) & (np.abs(stretch) < allowed[:, None]) & (np.abs(growth) < _GROWTH * allowed[:, None])
    if rings_tell:
        ring_a, ring_b = layout.rings[a].astype(int), layout.rings[b].astype(int)
        good &= ~shown.strange[ring_a][:, first].T & ~shown.strange[ring_b][:, second].T
    m, q = np.nonzero(good)
    stretch = stretch[m, q]
    quality = np.hypot(stretch, growth[m, q]) / allowed[m]
    a = a[q]
    seeds = _turned(
        layout.points[a],
        step[q],
        layout.radii[a, None] * p[m],
        depth[m, q, None] * ray[m],
        n[m],
        np.exp(stretch[:, None]),
        a,
    )
    votes = _votes(seeds, first[m], shown, layout, _voters(shown, layout))
    order = np.lexsort((quality, -votes))
    return replace(seeds, votes=votes).take(order[: _kept(votes, least)])


def _kept(votes: Indices, least: tuple[int, ...]) -> int:
    """Return the number of guesses with enough votes; if none has, the best ones tell how far they go."""
    return max(8 * (len(least) > 1), int(np.count_nonzero(votes >= least[0])))


def _compiled(
    first: Indices,
    second: Indices,
    shown: "_Shown",
    layout: DotLayout,
    pairs: Indices,
    rings_tell: bool,
    least: tuple[int, ...],
) -> PoseHypotheses:
    """Run `_round` by one compiled call."""
    ellipses = shown.ellipses
    parts = layout.points, layout.radii, layout.rings, layout.near
    blobs = ellipses.center, ellipses.shape, shown.area, shown.slack, shown.position, shown.normal
    settings = shown.px, _DRIFT, _DRIFT_PX, _SIZE, _GROWTH
    strange = shown.strange & rings_tell
    for fewest in least:
        start, votes, quality, rotation, translation = kernel.guess_poses(
            (first, second, pairs), parts, blobs, strange, settings, fewest
        )
        if len(votes):
            break
    order = np.lexsort((quality, -votes))
    order = order[: _kept(votes, least)]
    return PoseHypotheses(rotation, translation, start, votes).take(order)


def _votes(seeds: PoseHypotheses, first: Indices, shown: _Shown, layout: DotLayout, voters: Indices) -> Indices:
    """Return the number (K,) of dots near the first one of a guess that have a blob of about their size."""
    near = layout.near[seeds.start]
    point = layout.points[near] @ seeds.rotation.swapaxes(-1, -2) + seeds.translation[:, None]
    apart = np.linalg.norm(layout.points[near] - layout.points[seeds.start, None], axis=-1)
    votes = np.zeros(len(seeds), dtype=np.intp)
    size = 0.5 * np.log(shown.area)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(point[..., 2] > 0, point[..., 2], np.nan)
        place = point[..., :2] / depth[..., None]
        gate = _DRIFT * apart / depth + _DRIFT_PX / shown.px
        facing = -np.sum(point * seeds.rotation[:, None, :, 2], axis=-1)
        # The area of a small disk's image: pi r^2 |n . P| / z^3.
        expected = np.log(layout.radii[near]) + 0.5 * np.log(facing / depth**3)
        chunk = max(1, _CHUNK // max(1, near.shape[1] * voters.shape[1]))
        for start in range(0, len(seeds), chunk):
            part = slice(start, start + chunk)
            blobs = voters[first[part], None]
            dx, dy = (place[part, :, None, i] - shown.ray[blobs, i] for i in (0, 1))
            hit = dx * dx + dy * dy < (gate[part] ** 2)[..., None]
            hit &= np.abs(expected[part, :, None] - size[blobs]) < _SIZE
            votes[part] = np.count_nonzero(hit.any(axis=-1), axis=-1)
    return votes


def circle_poses(center: Array, shape: Array) -> tuple[Array, Array]:
    """Return both poses of a disk of radius 1 that is seen as an ellipse, up to the rotation about its normal.

    The ellipse's dual conic D is proportional to I - n n' - P P' (see `conic_projection.outlines`). With eigenvalues
    m1 >= m2 > 0 > m3 of D and a = 1 - m2/m1, b = 1 - m3/m1, the normal is n = +-s v2 + sqrt(1 - s^2) v3 with
    s^2 = a (b - 1)/(b - a), and P follows from P P' = I - D/m1 - n n'.

    Parameters
    ----------
    center, shape : arrays (B, 2) and (B, 2, 2), normalized coordinates

    Returns
    -------
    position (B, 2, 3), normal (B, 2, 3)
        In the camera frame, in units of the radius; normals face the camera.
    """
    dual = np.empty((len(center), 3, 3))
    dual[:, :2, :2] = shape - center[:, :, None] * center[:, None, :]
    dual[:, :2, 2] = dual[:, 2, :2] = -center
    dual[:, 2, 2] = -1
    values, vectors = np.linalg.eigh(dual)
    a, b = (1 - values[:, i] / values[:, 2] for i in (1, 0))
    sine = np.sqrt(np.clip(a * (b - 1) / (b - a), 0, 1))[:, None]
    cosine = np.sqrt(1 - sine**2)
    normal = np.stack([sign * sine * vectors[..., 1] + cosine * vectors[..., 0] for sign in (1, -1)], axis=1)
    gram = (np.eye(3) - dual / values[:, 2, None, None])[:, None] - normal[..., :, None] * normal[..., None, :]
    depth = np.sqrt(np.maximum(gram[..., 2, 2], 1e-12))
    position = gram[..., 2] / depth[..., None]
    facing = np.sum(normal * position, axis=-1, keepdims=True)
    return position, np.where(facing > 0, -normal, normal)


def _neighbors(shown: _Shown, layout: DotLayout, ringed: bool) -> tuple[Indices, Indices]:
    """Return pairs of different blobs no farther apart, in radii of the first, than the dots can be.

    With a ring, pairs of a ring and any other; else each blob and its nearest.
    """
    ellipses = shown.ellipses
    lateral = layout.points[:, None, :2] - layout.points[:, :2]
    # The factor of 2 covers the perspective of near views, in which radii shrink toward the far side.
    most = 2 * np.linalg.norm(lateral, axis=-1).max() / layout.radii.min()
    if not layout.flat:
        most += 2 * np.ptp(layout.points[:, 2]) / layout.radii.min()
    chosen = np.flatnonzero(~shown.strange[1]) if ringed else np.arange(len(ellipses))
    dx, dy = (ellipses.center[:, i] - ellipses.center[chosen, None, i] for i in (0, 1))
    xx, xy, yy = (ellipses.shape[chosen, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    distance = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (shown.area[chosen] ** 2)[:, None]
    ratio = np.log(layout.radii.max() / layout.radii.min())
    size = 0.5 * np.log(shown.area)
    # The size of dots changes with their distance, too.
    other = np.abs(size - size[chosen, None]) > ratio + 1.0
    distance[np.arange(len(chosen)), chosen] = np.inf
    distance[other | (distance >= most**2)] = np.inf
    if not ringed and len(ellipses) > 2 * NEAR_BLOBS:
        some = NEAR_BLOBS if len(layout) <= MANY_DOTS else NEAREST_BLOBS
        nearest = np.argpartition(distance, some, axis=-1)[:, :some]
        first = np.repeat(chosen, some)
        keep = np.isfinite(np.take_along_axis(distance, nearest, axis=-1).ravel())
        return first[keep], nearest.ravel()[keep]
    first, second = np.nonzero(np.isfinite(distance))
    first = chosen[first]
    if ringed:
        # The outline of either gives the plane.
        return np.concatenate([first, second]), np.concatenate([second, first])
    return first, second


def _voters(shown: _Shown, layout: DotLayout) -> Indices:
    """Return the blobs (B, k) that may be near dots of each one as the first: all, or the nearest if dots are many."""
    count = len(shown.area)
    everything = np.broadcast_to(np.arange(count), (count, count))
    if len(layout) <= MANY_DOTS or count <= VOTERS:
        return everything
    distance = np.sum((shown.ray[:, None] - shown.ray) ** 2, axis=-1)
    return np.argpartition(distance, VOTERS, axis=-1)[:, :VOTERS]


def _elongation(shape: Array, center: Array, normal: Array) -> Array:
    """Return the logarithm (m,) of the elongation of ellipses relative to that of disks with given normals.

    The image of a small disk is proportional to G = A (I - n n') A', A = [I, -x].
    """
    x, y = center[:, 0], center[:, 1]
    along_x = normal[:, 0] - x * normal[:, 2]
    along_y = normal[:, 1] - y * normal[:, 2]
    g11, g22 = 1 + x * x - along_x**2, 1 + y * y - along_y**2
    g12 = x * y - along_x * along_y
    determinant = np.maximum(g11 * g22 - g12**2, 1e-12)
    trace = (shape[:, 0, 0] * g22 + shape[:, 1, 1] * g11 - 2 * shape[:, 0, 1] * g12) / determinant
    ratio = trace / (2 * np.sqrt(np.linalg.det(shape) / determinant))
    return np.arccosh(np.maximum(ratio, 1))


def _turned(
    point: Array, step: Array, place: Array, other: Array, normal: Array, scale: Array, start: Indices
) -> PoseHypotheses:
    """Return poses that map a point (K, 3) to `place`, and one at `step` (K, 3) from it in the direction of `other`."""
    along = other - place - step[:, 2:] * normal
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(normal, along)
    length = np.linalg.norm(step[:, :2], axis=-1, keepdims=True)
    cosine, sine = step[:, :1] / length, step[:, 1:2] / length
    rotation = np.stack([cosine * along - sine * across, sine * along + cosine * across, normal], axis=-1)
    # The distance between dots tells the scale better than the size of one.
    return PoseHypotheses(rotation, scale * place - np.einsum("kij,kj->ki", rotation, point), start, start)
