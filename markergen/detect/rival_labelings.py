"""Rivals of a labeling: others of its own blobs that may fit nearly as well, found from the layout alone.

The blobs of a labeling are where its dots are, so a rival amounts to a mapping of the marker's plane onto itself that
takes dots to other dots: for few dots any affine mapping near a rotation, since their outlines tell the tilt only
roughly; for many a rotation, by pairs of dots or about the middle of all. Rivals that label nearly all of the blobs are
found from a few of them.
"""
# tests: tests/detect/test_identification.py

import math
from dataclasses import replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect.blobs import Ellipses
from markergen.detect.labeling_hypotheses import GUESS_PX, LEAST_DOTS, Labelings, assign, fit_labelings, joined
from markergen.detect.pose_hypotheses import MANY_DOTS, DotLayout

FEW_DOTS = 12
"""Maximum number of dots for which affine mappings are tried."""

STRETCH, STRETCH_PX = 0.2, 1.0
"""Maximum logarithm of a mapping's stretch: a part for perspective, and px over the shorter semi-axis for outlines."""

MAX_FOREIGN = 16
"""Maximum number of mappings with which rivals are looked for that label other blobs, too."""

PROBED = 10
"""Number of dots of many, roughly, whose places tell at once that a mapping leaves out too many."""

_CHUNK = 1_000_000


def rival_labelings(
    chosen: Labelings, lack: int, ellipses: Ellipses, layout: DotLayout, px: float, rings_tell: bool
) -> Labelings:
    """Return labelings, fitted, of at least as many blobs as one labeling has, but for a few.

    Parameters
    ----------
    chosen : Labelings
        One labeling.
    lack : int
        Number of dots that a rival may have fewer.
    px : float
        Pixels per unit of the normalized coordinates.
    rings_tell : bool
        True if rings match only rings, and disks only disks.
    """
    blobs = chosen.blobs[0]
    used = np.flatnonzero(blobs >= 0)
    index = blobs[used]
    own, least = ellipses.take(index), max(LEAST_DOTS, len(used) - lack)
    short = px * np.sqrt(np.linalg.eigvalsh(own.shape)[:, 0])
    limit = STRETCH + STRETCH_PX / float(np.median(short))
    # px to m at each dot.
    reach = layout.reach * layout.radii[used] + GUESS_PX * layout.radii[used] / short
    if len(layout) <= FEW_DOTS:
        linear, origin, target = _affine(layout, used, lack, limit)
    else:
        linear, origin, target = _rigid(layout, used, lack, limit, float(reach.max()))
    strange = rings_tell & own.strange(layout.rings)
    # Of a part of a regular grid, a rival may be shifted by a row.
    foreign = len(used) < len(layout) and len(ellipses) > len(used)
    wanted = min(least, len(used) / 2) if foreign else least
    if len(layout) > FEW_DOTS:
        probed = np.arange(0, len(layout), max(1, len(layout) // PROBED))
        met = (_nearest(linear, origin, target, probed, layout, used, reach, strange) >= 0).sum(axis=-1)
        possible = len(probed) - met <= len(layout) - wanted
        linear, origin, target = linear[possible], origin[possible], target[possible]
    nearest = _nearest(linear, origin, target, np.arange(len(layout)), layout, used, reach, strange)
    count = (nearest >= 0).sum(axis=-1)
    turn = np.arctan2(linear[:, 1, 0] - linear[:, 0, 1], linear[:, 0, 0] + linear[:, 1, 1])
    itself = ((nearest < 0) | (used[nearest] == np.arange(len(layout)))).all(axis=-1)

    kept = np.flatnonzero((count >= least) & ~itself)
    if len(kept):
        _, first = np.unique(nearest[kept], axis=0, return_index=True)
        kept = kept[first]
    if len(kept):
        model = chosen.model.turned(turn[kept], origin[kept], target[kept])
        rivals = fit_labelings(nearest[kept], model, own, layout, px, rings_tell)
        rivals = replace(rivals, blobs=np.where(rivals.blobs >= 0, index[rivals.blobs], -1))
    else:
        rivals = chosen.take(kept)
    if not foreign:
        return rivals
    some = np.flatnonzero((2 * count >= len(used)) & ~itself)
    some = some[np.argsort(-count[some], kind="stable")][:MAX_FOREIGN]
    model = chosen.model.turned(turn[some], origin[some], target[some])
    blobs, _ = assign(model.outlines(layout), ellipses, layout, layout.reach, GUESS_PX / px, rings_tell)
    enough = np.flatnonzero(np.count_nonzero(blobs >= 0, axis=-1) >= least)
    if not len(enough):
        return rivals
    return joined(rivals, fit_labelings(blobs[enough], model.take(enough), ellipses, layout, px, rings_tell))


def _nearest(
    linear: Array,
    origin: Array,
    target: Array,
    taken: Indices,
    layout: DotLayout,
    used: Indices,
    reach: Array,
    strange: NDArray[np.bool_],
) -> Indices:
    """Return which labeled dot (K, m) of `used` is where a mapping takes each of m dots `taken`, -1 for none."""
    n, count = len(taken), len(linear)
    nearest = np.full((count, n), -1)
    chunk = max(1, _CHUNK // (n * len(used)))
    for start in range(0, count, chunk):
        part = slice(start, start + chunk)
        offset = layout.points[taken, :2] - origin[part, None]
        place = offset @ linear[part].swapaxes(-1, -2) + target[part, None]
        dx, dy = (place[:, :, None, i] - layout.points[used, i] for i in (0, 1))
        square = (dx * dx + dy * dy) / reach**2
        square[:, strange[taken]] = np.inf
        closest = square.argmin(axis=-1)
        least = np.take_along_axis(square, closest[..., None], axis=-1)[..., 0]
        closest[least > 1] = -1
        # Of two dots with the same blob, the farther one gets none.
        same = (closest[:, :, None] == closest[:, None, :]) & (least[:, :, None] > least[:, None, :])
        closest[same.any(axis=-1)] = -1
        nearest[part] = closest
    return nearest


def _affine(layout: DotLayout, used: Indices, lack: int, limit: float) -> tuple[Array, Array, Array]:
    """Return mappings A (K, 2, 2), origin, and target (K, 2) that take any three dots to three labeled ones."""
    linear, least, most, origin, target = _affine_mappings(layout, used.tobytes(), lack)
    good = (most < math.exp(2 * limit)) & (least > math.exp(-2 * limit))
    return linear[good], origin[good], target[good]


@lru_cache(maxsize=64)
def _affine_mappings(layout: DotLayout, labeled: bytes, lack: int) -> tuple[Array, Array, Array, Array, Array]:
    """Return all such mappings that do not mirror, the squares of their singular values, origins and targets."""
    points, used = layout.points[:, :2], np.frombuffer(labeled, dtype=np.intp)
    triples = np.array(list(combinations(used, 3)), dtype=np.intp)
    area = np.abs(np.linalg.det(points[triples[:, 1:]] - points[triples[:, :1]]))
    triples = triples[np.argsort(-area, kind="stable")]
    # A rival may lack any of the dots: without as many, one of these must remain.
    bases, free = [], set(used.tolist())
    for triple in triples:
        if free.issuperset(triple.tolist()):
            bases.append(triple)
            free.difference_update(triple.tolist())
    base = np.array(bases[: lack + 1] if len(bases) > lack else triples)
    onto = (points[base[:, 1:]] - points[base[:, :1]]).swapaxes(-1, -2)
    linear = onto[:, None] @ layout.corners[1]
    gram = linear.swapaxes(-1, -2) @ linear
    half = 0.5 * (gram[..., 0, 0] + gram[..., 1, 1])
    det = linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]
    most = half + np.sqrt(np.maximum(half**2 - det**2, 0))
    k, q = np.nonzero(det > 0)
    # Squared singular values; their product is det^2.
    least, most = det[k, q] ** 2 / most[k, q], most[k, q]
    return linear[k, q], least, most, points[layout.corners[0][q]], points[base[k, 0]]


def _rigid(layout: DotLayout, used: Indices, lack: int, limit: float, reach: float) -> tuple[Array, Array, Array]:
    """Return rotations (K, 2, 2), origin, and target (K, 2) that take any pair of dots to a pair of labeled ones."""
    points, pairs = layout.points[:, :2], layout.pairs
    step = points[pairs[:, 1]] - points[pairs[:, 0]]
    length = np.linalg.norm(step, axis=-1)
    labeled = np.flatnonzero(np.isin(pairs, used).all(axis=-1))
    base, free = [], set(used.tolist())
    for q in labeled[np.argsort(-length[labeled], kind="stable")]:
        if free.issuperset(pairs[q].tolist()):
            base.append(q)
            free.difference_update(pairs[q].tolist())
    chosen = np.array(base[: lack + 1], dtype=np.intp)
    k, q = np.nonzero(np.abs(np.log(length[chosen, None] / length)) < limit)
    angle = np.arctan2(step[:, 1], step[:, 0])
    angle = angle[chosen[k]] - angle[q]
    middle = points[pairs].mean(axis=1)
    origin, target = middle[q], middle[chosen[k]]
    if len(layout) > MANY_DOTS:
        # Their pairs are those of neighbors, which tell a turn too roughly for dots on the other side.
        turn = _turns_in_place(points, used, lack, reach)
        center = np.broadcast_to(points.mean(axis=0), (len(turn), 2))
        angle, origin, target = np.append(angle, turn), np.vstack([origin, center]), np.vstack([target, center])
    linear = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1).reshape(-1, 2, 2)
    return linear, origin, target


def _turns_in_place(points: Array, used: Indices, lack: int, reach: float) -> Array:
    """Return rotations (K,) about the middle of all dots that take any dot near one of the outermost labeled ones."""
    offset = points - points.mean(axis=0)
    distance, phase = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
    # One of these must remain, whatever a rival lacks.
    base = used[np.argsort(-distance[used], kind="stable")][: lack + 1]
    k, q = np.nonzero(np.abs(distance[base, None] - distance) < reach)
    return np.asarray(phase[base[k]] - phase[q])
