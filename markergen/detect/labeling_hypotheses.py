"""Candidate labelings of blobs: guessed poses, the blobs near the dots that they predict, and the fit to those."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect import kernel
from markergen.detect.blobs import Ellipses
from markergen.detect.conic_projection import SCHEDULE, Outlines
from markergen.detect.pose_hypotheses import STRONG_VOTES, DotLayout, guess_poses
from markergen.detect.seen_models import FIT_TOLERANCE, Model, Planes, Poses

LEAST_DOTS = 4
"""Minimum number of dots: fewer do not determine pose and labels."""

MAX_LABELINGS = 600
"""Maximum number of fitted labelings of a batch times the marker's dots; those with the most dots first."""

_BATCHES, MAX_TRIED = (8, 32, 256), 1000
"""Numbers of likely guesses of a round that are tried at a time, and of all others in the end; maximum number of likely
ones."""

ROUNDS, TRIM_PX, MAX_TRIMMED = 3, 1.0, 60
"""Maximum number of refinement rounds; misfit above which the last ones leave dots out; maximum number of labelings
that leaving out may add."""

SPREAD = 0.2
"""Maximum logarithm of a common factor of all outlines that is ignored."""


FOCAL_FACTORS = (1.0, 0.4, 3.0)
"""Focal lengths to try without a camera, in units of the made-up one."""

NEAR_REACH, NEAR_PX = 0.5, 1.0
"""Maximum distance of a dot from its place in a fitted labeling: share of its radius, plus px."""
GUESS_PX = 2.0
"""Margin in px added to a layout's reach for guesses."""
_CHUNK = 2_000_000


@dataclass(frozen=True, eq=False)
class Labelings:
    """A labelings, those with the most dots first.

    Attributes
    ----------
    blobs : array (A, n) of int
        Index of the ellipse of each control point; -1 for none.
    misfit : array (A,), px
        See `misfits`; inf for labelings of fewer than four dots.
    model : Poses or Planes
        Fitted model.
    cut : bool
        True if the search ended before all guesses were tried.
    """

    blobs: Indices
    misfit: Array
    model: "Model"
    layout: DotLayout
    cut: bool = False

    def __len__(self) -> int:
        return len(self.blobs)

    @cached_property
    def predicted(self) -> Outlines:
        """Predicted outlines of all dots."""
        return self.model.outlines(self.layout)

    @cached_property
    def count(self) -> Indices:
        """Number (A,) of dots that have a blob."""
        return np.asarray((self.blobs >= 0).sum(axis=-1))

    def take(self, chosen: Indices) -> "Labelings":
        """Return a subset."""
        return Labelings(self.blobs[chosen], self.misfit[chosen], self.model.take(chosen), self.layout)


Judge = Callable[[Labelings], tuple[NDArray[np.bool_], NDArray[np.bool_]]]


def find_labelings(
    ellipses: Ellipses,
    layout: DotLayout,
    px: float,
    calibrated: bool = True,
    judge: Judge | None = None,
    thorough: bool = True,
) -> Labelings:
    """Find and fit labelings of `LEAST_DOTS` or more dots; if there are none, the best of fewer, for messages.

    Guesses that start from a ring come first; if these give a good labeling, no others are tried.

    Parameters
    ----------
    px : float
        Pixels per unit of the normalized coordinates.
    calibrated : bool
        True to fit poses, False to fit homographies.
    judge : callable
        Tells which labelings (A,) are good, and which are so good that the search ends; by default, none.
    thorough : bool
        False to try only likely guesses, and only those with a ring if there is one in the layout.
    """
    judge = judge or _never
    pool, cut = none(layout, calibrated), False
    ringed = bool(layout.rings.any() and ellipses.ring.any())
    phases = [True] * ringed + [False] * (thorough or not layout.rings.any())
    for phase in phases:
        rounds = _guesses(ellipses, layout, px, calibrated, phase, not thorough)
        for model, start, left_out in _likely_first(rounds, layout, thorough):
            cut |= left_out
            fresh = _followed(model, start, ellipses, layout, px)
            pool = joined(pool, fresh)
            if judge(fresh)[1].any():
                pool = pool.take(np.flatnonzero(pool.count >= LEAST_DOTS))
                return pool.take(distinct(pool.blobs, pool.misfit))
        if not len(pool):
            continue
        pool = pool.take(distinct(pool.blobs, pool.misfit))
        enough = np.flatnonzero(pool.count >= LEAST_DOTS)
        best = pool.take(enough[np.argsort(pool.misfit[enough] - pool.count[enough], kind="stable")][:MAX_TRIMMED])
        for _ in range(ROUNDS if thorough and len(best) else 0):
            labelings, origin = _next(best, ellipses, layout, px, rings_tell=True, trim=True)
            if not len(labelings):
                break
            fresh = _fitted(labelings, best.model.take(origin), ellipses, layout, px)
            pool, best = joined(pool, fresh), joined(best, fresh)
        pool = pool.take(distinct(pool.blobs, pool.misfit))
        if judge(pool)[0].any():
            break
    count = pool.count
    return replace(pool.take(np.flatnonzero((count >= LEAST_DOTS) | (count == count.max(initial=0)))), cut=cut)


def _likely_first(
    rounds: Iterator[tuple[Model, Indices, Indices] | None], layout: DotLayout, thorough: bool
) -> Iterator[tuple[Model, Indices, bool]]:
    """Return batches of guesses: of each round those with most of the near dots, in the end the best of the others.

    With each batch comes whether guesses were left out: the rounds end with `MAX_TRIED` likely guesses that lead
    nowhere, as in a regular pattern of spots, where nearly all guesses are likely.
    """
    strong, tried, waiting = STRONG_VOTES * layout.near.shape[1], 0, list[tuple[Model, Indices, Indices]]()
    cut = False
    for each in rounds:
        cut = each is None or tried >= MAX_TRIED
        if cut or each is None:
            break
        model, start, votes = each
        count, done = int(np.count_nonzero(votes >= strong)), 0
        for size in _BATCHES[:2]:
            batch = np.arange(done, min(done + size, count, done + MAX_TRIED - tried))
            if len(batch):
                yield model.take(batch), start[batch], False
            done += len(batch)
            tried += len(batch)
        rest = np.arange(done, min(len(start), done + _BATCHES[2]))
        waiting.append((model.take(rest), start[rest], votes[rest]))
    if not waiting or not thorough:
        return
    model, *parts = waiting[0]
    for other, *more in waiting[1:]:
        model, parts = model.joined(other), [np.concatenate(pair) for pair in zip(parts, more, strict=True)]
    best = np.argsort(-parts[1], kind="stable")[: _BATCHES[2]]
    for part in (best[: _BATCHES[1]], best[_BATCHES[1] :]):
        if len(part):
            yield model.take(part), parts[0][part], cut


def _never(candidates: Labelings) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    none = np.zeros(len(candidates), dtype=bool)
    return none, none


def none(layout: DotLayout, calibrated: bool) -> Labelings:
    """Return no labelings."""
    model: Model = Poses(np.zeros((0, 3, 3)), np.zeros((0, 3))) if calibrated else Planes(np.zeros((0, 3, 3)))
    return Labelings(np.zeros((0, len(layout)), dtype=np.intp), np.zeros(0), model, layout)


def _followed(model: Model, start: Indices, ellipses: Ellipses, layout: DotLayout, px: float) -> Labelings:
    """Return the distinct labelings to which guesses lead, fitted; of fewer than four dots if there are no others."""
    if isinstance(model, Poses) and kernel.library() is not None:
        return _compiled(model, start, None, ellipses, layout, px, rings_tell=True)
    few, count = max(8, MAX_LABELINGS // len(layout)), len(layout)
    drawn = model.outlines(layout)
    if layout.near.shape[1] < count - 1:
        # Far from where a guess starts, it is not good enough to tell dots from their neighbors.
        close = np.zeros(drawn.seen.shape, dtype=bool)
        np.put_along_axis(close, np.column_stack([start, layout.near[start]]), True, axis=1)
        near = replace(drawn, seen=drawn.seen & close)
        blobs, distance = assign(near, ellipses, layout, layout.reach, GUESS_PX / px, rings_tell=True)
        chosen = distinct(blobs, distance)
        chosen = chosen[np.sum(blobs[chosen] >= 0, axis=-1) >= LEAST_DOTS][:few]
        model = model.take(chosen).fitted(blobs[chosen], ellipses, layout, px)
        drawn = model.outlines(layout)
    blobs, distance = assign(drawn, ellipses, layout, layout.reach, GUESS_PX / px, rings_tell=True)
    chosen = distinct(blobs, distance)
    enough = chosen[np.sum(blobs[chosen] >= 0, axis=-1) >= LEAST_DOTS][:few]
    if not len(enough):
        chosen = chosen[:few]
        return Labelings(blobs[chosen], np.full(len(chosen), np.inf), model.take(chosen), layout)
    return fit_labelings(blobs[enough], model.take(enough), ellipses, layout, px, rings_tell=True)


def fit_labelings(
    blobs: Indices, model: Model, ellipses: Ellipses, layout: DotLayout, px: float, rings_tell: bool
) -> Labelings:
    """Fit labelings (K, n) of four dots or more, and those of the blobs that are where a fit predicts the dots."""
    if isinstance(model, Poses) and kernel.library() is not None:
        return _compiled(model, None, blobs, ellipses, layout, px, rings_tell)
    pool = fresh = _fitted(blobs, model, ellipses, layout, px)
    for _ in range(ROUNDS):
        labelings, origin = _next(fresh, ellipses, layout, px, rings_tell)
        if not len(labelings):
            break
        fresh = _fitted(labelings, fresh.model.take(origin), ellipses, layout, px)
        pool = joined(pool, fresh)
    return pool


def _compiled(
    model: Poses,
    start: Indices | None,
    blobs: Indices | None,
    ellipses: Ellipses,
    layout: DotLayout,
    px: float,
    rings_tell: bool,
) -> Labelings:
    """Run `_followed`, or `fit_labelings` with given labelings, by one compiled call."""
    parts = layout.points, layout.radii, layout.rings, layout.near, layout.flat
    strange = ellipses.strange(np.array([False, True])) & rings_tell
    gates = layout.reach, GUESS_PX / px, NEAR_REACH, NEAR_PX / px, px, SPREAD, FIT_TOLERANCE
    shown = ellipses.center, ellipses.shape, strange
    labels, misfit, *pose = kernel.follow_poses(
        parts, start, blobs, shown, gates, model.rotation, model.translation, SCHEDULE
    )
    found = Labelings(labels, misfit, Poses(*pose), layout)
    enough = np.flatnonzero(found.count >= LEAST_DOTS)
    return found.take(enough) if len(enough) else found


def misfits(predicted: Outlines, ellipses: Ellipses, blobs: Indices, px: float) -> Array:
    """Return the RMS (A,) in px by which centers and outlines of labeled blobs (A, n) miss the predicted ones.

    sqrt(sum |dc|^2/(m - 3) + sum |dS|^2/m) over the m dots that have a blob, with c the centers, whose fit uses up six
    of 2m numbers, and S the symmetric square roots of the shapes. A common factor of all outlines, up to a fifth, is
    ignored: ink spreads, and bright surroundings eat into dark dots.
    """
    used = blobs >= 0
    count = used.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        offset = np.where(used[..., None], ellipses.center[blobs] - predicted.center, 0.0)
        seen, drawn = _root(ellipses.shape)[blobs], _root(predicted.shape)
        ratio = np.where(used, 0.5 * np.log(_determinant(seen) / _determinant(drawn)), 0.0)
        factor = np.exp(np.clip(ratio.sum(axis=-1) / count, -SPREAD, SPREAD))
        outline = np.where(used[..., None, None], seen - factor[:, None, None, None] * drawn, 0.0)
        by_center, by_outline = np.sum(offset**2, axis=-1), np.sum(outline**2, axis=(-2, -1))
        error = px * np.sqrt(by_center.sum(axis=-1) / np.maximum(count - 3, 1) + by_outline.sum(axis=-1) / count)
    visible = (predicted.seen | ~used).all(axis=-1)
    return np.where(visible & np.isfinite(error), error, np.inf)


def _fitted(blobs: Indices, start: Model, ellipses: Ellipses, layout: DotLayout, px: float) -> Labelings:
    """Fit labelings (K, n) from the guess and from the mirrored pose, and keep the better fit."""
    count, mirrored = len(blobs), start.mirrored(layout)
    if mirrored is not None:
        blobs, start = np.concatenate([blobs, blobs]), start.joined(mirrored)
    model = start.fitted(blobs, ellipses, layout, px)
    drawn = model.outlines(layout)
    candidates = Labelings(blobs, misfits(drawn, ellipses, blobs, px), model, layout)
    if mirrored is None:
        return candidates
    return candidates.take(np.arange(count) + count * (candidates.misfit[count:] < candidates.misfit[:count]))


def _next(
    candidates: Labelings, ellipses: Ellipses, layout: DotLayout, px: float, rings_tell: bool, trim: bool = False
) -> tuple[Indices, Indices]:
    """Return labelings (k, n) derived from fitted ones and not fitted yet, and the index of the one each comes from.

    The fitted pose is used for another assignment: dots that the guess missed are added, wrong ones removed. With
    `trim`, if nothing fits better, each dot in turn is left out, in case a foreign blob near its place was taken for
    it.
    """
    old = candidates.blobs
    near, _ = assign(candidates.predicted, ellipses, layout, NEAR_REACH, NEAR_PX / px, rings_tell)
    count = candidates.count
    good = count[candidates.misfit < TRIM_PX].max(initial=LEAST_DOTS - 1)
    poor = np.flatnonzero((candidates.misfit >= TRIM_PX) & (count - 1 > good) & trim)
    poor = poor[np.lexsort((candidates.misfit[poor], -count[poor]))][: max(1, MAX_TRIMMED // len(layout))]
    row, dot = np.nonzero(old[poor] >= 0)
    row = poor[row]
    trimmed = old[row]
    trimmed[np.arange(len(row)), dot] = -1
    labelings = np.concatenate([old, near, trimmed])
    # Labelings that are already fitted come first among equals, and are not fitted again.
    fresh = distinct(labelings, (np.arange(len(labelings)) >= len(old)).astype(float))
    fresh = fresh[(fresh >= len(old)) & (np.sum(labelings[fresh] >= 0, axis=-1) >= LEAST_DOTS)]
    start = np.concatenate([np.arange(len(old)), np.arange(len(old)), row])
    return labelings[fresh], start[fresh]


def _guesses(
    ellipses: Ellipses, layout: DotLayout, px: float, calibrated: bool, ringed: bool, likely: bool
) -> Iterator[tuple[Model, Indices, Indices] | None]:
    """Return rounds of guesses, with the control point that each starts from and its votes; None for those left out."""
    if calibrated:
        for seeds in guess_poses(ellipses, layout, px, ringed=ringed, likely=likely):
            yield None if seeds is None else (Poses(seeds.rotation, seeds.translation), seeds.start, seeds.votes)
        return
    for factor in FOCAL_FACTORS:
        scaled = replace(ellipses, center=ellipses.center / factor, shape=ellipses.shape / factor**2)
        for seeds in guess_poses(scaled, layout, px * factor, ringed=ringed, likely=likely):
            if seeds is None:
                yield None
                continue
            origin = seeds.translation + layout.points[0, 2] * seeds.rotation[:, :, 2]
            homography = np.concatenate([seeds.rotation[:, :, :2], origin[..., None]], axis=-1)
            yield Planes(np.diag([factor, factor, 1.0]) @ homography), seeds.start, seeds.votes


def assign(
    predicted: Outlines, ellipses: Ellipses, layout: DotLayout, reach: float, margin: float, rings_tell: bool
) -> tuple[Indices, Array]:
    """Assign to each predicted dot its nearest blob (K, n), -1 if none is in reach; also sum squared distances (K,).

    Distances are in units of the allowed distance: `reach` radii of the blob, plus a margin.
    """
    gate = np.linalg.inv(reach**2 * ellipses.shape + margin**2 * np.eye(2))
    # |L'd|^2 = d' G d.
    factor = np.linalg.cholesky(gate)
    strange = np.zeros((len(layout), len(ellipses)), dtype=bool)
    if rings_tell:
        strange = ellipses.strange(layout.rings)
    n = len(layout)
    center = np.where(predicted.seen[..., None], predicted.center, np.inf)
    blobs, total = np.empty((len(center), n), dtype=np.intp), np.empty(len(center))
    chunk = max(1, _CHUNK // (n * len(ellipses)))
    for start in range(0, len(center), chunk):
        part = slice(start, start + chunk)
        with np.errstate(invalid="ignore"):
            dx, dy = (center[part, :, None, i] - ellipses.center[:, i] for i in (0, 1))
            along = factor[:, 0, 0] * dx + factor[:, 1, 0] * dy
            across = factor[:, 1, 1] * dy
            square = along * along + across * across
        square[np.isnan(square)] = np.inf
        square[:, strange] = np.inf
        nearest = square.argmin(axis=-1)
        least = np.take_along_axis(square, nearest[..., None], axis=-1)[..., 0]
        nearest[least > 1] = -1
        # Of two dots with the same blob, the farther one gets none.
        same = (nearest[:, :, None] == nearest[:, None, :]) & (least[:, :, None] > least[:, None, :])
        nearest[same.any(axis=-1)] = -1
        blobs[part], total[part] = nearest, np.where(nearest >= 0, least, 0.0).sum(axis=-1)
    return blobs, total


def distinct(blobs: Indices, error: Array) -> Indices:
    """Return indices of distinct labelings (A, n), most dots first, then by error; of equal ones the best."""
    order = np.lexsort((error, -(blobs >= 0).sum(axis=-1)))
    _, first = np.unique((blobs[order] + 2) @ _weights(blobs.shape[1]), return_index=True)
    return order[np.sort(first)]


@lru_cache(maxsize=64)
def _weights(count: int) -> Indices:
    """Return a random linear form that tells rows apart: exact in integers up to overflow, which wraps the same way."""
    return np.random.default_rng(0).integers(1, 2**62, count)


def joined(first: Labelings, second: Labelings) -> Labelings:
    """Concatenate labelings."""
    return Labelings(
        np.concatenate([first.blobs, second.blobs]),
        np.concatenate([first.misfit, second.misfit]),
        first.model.joined(second.model),
        first.layout,
    )


def _determinant(matrix: Array) -> Array:
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


def _root(shape: Array) -> Array:
    """Symmetric square root (..., 2, 2) of positive matrices: (E + sqrt(det E) I)/sqrt(tr E + 2 sqrt(det E))."""
    area = np.sqrt(_determinant(shape))
    trace = shape[..., 0, 0] + shape[..., 1, 1]
    return (shape + area[..., None, None] * np.eye(2)) / np.sqrt(trace + 2 * area)[..., None, None]
