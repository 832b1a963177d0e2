"""Which rival labelings come nearest to fitting: a search among permutations of the dots.

A rival's images are the same set of points as the true ones. To first order its pose therefore keeps mean and
covariance of the set, which leaves one number free: the angle of a turn of the set made round, S^(-1/2) (X - mean).
Every angle gives one labeling. Those that fit best, and the true one, are then varied by exchanging two dots, again
and again, which is priced without a new fit: the images that are exchanged differ by d, which adds +d and -d to two
residuals, and the fit takes away what lies in the span of its Jacobian.
"""

import numpy as np
from numpy.typing import NDArray

from markergen.model.poses import PoseDistribution
from markergen.optimize.rival_fits import RivalFit, Rivals, Scene

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ANGLES, ANGLES_OF_MANY, MANY = 180, 360, 24
"""Turns that are tried, and how many for more than so many dots, which are closer together."""

KEPT = 16
"""Labelings of a pose that are fitted in each round, besides the best for each dot."""

VARIED = 6
"""Labelings of a pose whose exchanges are tried in each round, besides the true one in the first."""

ROUNDS = 3
"""Rounds of exchanges: three make every permutation of four dots, and every cycle of as many."""

FINISHED, FINISHED_PER_DOT = 8, 2
"""Labelings of a pose that are fitted to the end: the nearest of all, and those of each dot."""


def find_rivals(scene: Scene, at: Indices) -> Rivals:
    """Near rivals at the poses with indices `at`: for every dot those that move it, and the nearest of all.

    Not all permutations are tried; see the module for which. A search: a test compares it with all of them.
    """
    pool = scene.fit(*_turned(scene, at), rough=True)
    pool = _unique(pool.joined(_reassigned(scene, pool)))
    truth = Rivals(
        np.tile(scene.truth, (len(at), 1)), at, scene.poses.rotation[at], scene.poses.translation[at], np.zeros(len(at))
    )
    for turn in range(ROUNDS):
        nearest = pool.take(_nearest(pool, at, VARIED))
        bases = truth.joined(nearest) if turn == 0 else nearest
        fresh = _not_in(*_exchanged(scene, bases, at), pool)
        if not len(fresh[0]):
            break
        pool = pool.joined(scene.fit(*fresh, rough=True))
    best = pool.take(_nearest(pool, at, FINISHED, FINISHED_PER_DOT))
    # From all starts again: a rough fit may have gone on from the one that ends in the worse minimum.
    return scene.fit(best.labeling, best.pose)


def representative(poses: PoseDistribution, count: int) -> Indices:
    """Indices of up to `count` poses that differ much in distance and direction, the farthest tilted one first.

    Each next one is that which is farthest from all before, in the direction of the camera and the logarithm of its
    distance. A turn about the line of sight changes nothing and does not count.
    """
    center = -np.einsum("pij,pi->pj", poses.rotation, poses.translation)
    distance = np.linalg.norm(center, axis=-1)
    where = np.concatenate([center / distance[:, None], np.log(distance)[:, None]], axis=-1)
    chosen = [int(np.argmin(poses.cos_tilt / distance))]
    gap = np.linalg.norm(where - where[chosen[0]], axis=-1)
    while len(chosen) < count and gap.max() > 1e-9:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(where - where[chosen[-1]], axis=-1))
    return np.array(chosen, dtype=np.intp)


def _turned(scene: Scene, at: Indices) -> tuple[Indices, Indices]:
    """Labelings (K, n) by turns of the set made round, the best `KEPT` at each of the poses; and the poses (K,)."""
    from scipy.optimize import linear_sum_assignment

    n = len(scene.points)
    strange = np.where(scene.kinds[:, None] != scene.kinds, 1e6, 0.0)
    angles = np.arange(ANGLES_OF_MANY if n > MANY else ANGLES) * (2 * np.pi / (ANGLES_OF_MANY if n > MANY else ANGLES))
    layout = _round(scene.points[:, :2])
    labelings, poses = [], []
    for pose in at:
        seen = _round(scene.rays[pose] * [1, -1])
        found: dict[bytes, tuple[float, Indices]] = {}
        for angle in angles:
            turned = layout @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            cost = np.sum((turned[:, None] - seen) ** 2, axis=-1) + strange
            labeling = linear_sum_assignment(cost)[1]
            total = float(cost[scene.truth, labeling].sum())
            if total < 1e6 and (labeling != scene.truth).any():
                key = labeling.tobytes()
                found[key] = min(found.get(key, (np.inf, labeling)), (total, labeling), key=lambda each: each[0])
        best = sorted(found.values(), key=lambda each: each[0])[:KEPT]
        labelings += [labeling for _, labeling in best]
        poses += [pose] * len(best)
    return np.array(labelings, dtype=np.intp).reshape(-1, n), np.array(poses, dtype=np.intp)


def _round(points: Array) -> Array:
    """Points (n, 2) with their mean taken off and their covariance made the identity, not mirrored."""
    centered = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centered.T @ centered / len(points))
    return centered @ (vectors / np.sqrt(np.maximum(values, 1e-12 * values[1]))) @ vectors.T


def _reassigned(scene: Scene, rivals: Rivals) -> Rivals:
    """Rivals whose dots take the images nearest to where the fit has them, as far as these are new."""
    from scipy.optimize import linear_sum_assignment

    finite = np.flatnonzero(np.isfinite(rivals.distance))
    rivals = rivals.take(finite)
    drawn = scene.camera.project(scene.points, rivals.rotation, rivals.translation)
    cost = np.sum((drawn[:, :, None] - scene.images[rivals.pose][:, None]) ** 2, axis=-1)
    strange = np.where(scene.kinds[:, None] != scene.kinds, 1e12, 0.0)
    labeling = np.array([linear_sum_assignment(each + strange)[1] for each in cost], dtype=np.intp)
    return scene.fit(*_not_in(labeling.reshape(rivals.labeling.shape), rivals.pose, rivals), rough=True)


def _exchanged(scene: Scene, bases: Rivals, at: Indices) -> tuple[Indices, Indices]:
    """Labelings (K, n) that differ from bases by an exchange of two dots, the most promising of each pose and dot."""
    n = len(scene.points)
    first, second = np.triu_indices(n, 1)
    alike = scene.kinds[first] == scene.kinds[second]
    first, second = first[alike], second[alike]
    promised = np.concatenate(
        [_prices(scene, bases.take(rows), first, second) for rows in np.array_split(np.arange(len(bases)), len(at))]
    )
    labelings, poses = [], []
    for pose in at:
        rows = np.flatnonzero(bases.pose == pose)
        price = promised[rows].ravel()
        base, pair = np.unravel_index(np.argsort(price, kind="stable"), (len(rows), len(first)))
        # More than twice that many are the same labelings by other ways.
        top = np.arange(min(2 * KEPT, len(base)))
        # The cheapest exchange of each dot, too.
        _, by_first = np.unique(first[pair], return_index=True)
        _, by_second = np.unique(second[pair], return_index=True)
        chosen = np.unique(np.concatenate([top, by_first, by_second]))
        labeling = bases.labeling[rows[base[chosen]]].copy()
        one, other = first[pair[chosen]], second[pair[chosen]]
        row = np.arange(len(chosen))
        labeling[row, one], labeling[row, other] = labeling[row, other], labeling[row, one]
        labelings.append(labeling)
        poses.append(np.full(len(chosen), pose))
    return np.concatenate(labelings), np.concatenate(poses)


def _prices(scene: Scene, bases: Rivals, first: Indices, second: Indices) -> Array:
    """D^2 (K, pairs) to first order after dots `first` and `second` have exchanged their images."""
    images = np.take_along_axis(scene.images[bases.pose], bases.labeling[..., None], axis=1)
    fit = RivalFit(scene.points, images, scene.camera, scene.edge_on)
    _, residual, normalized = fit.residuals((bases.rotation, bases.translation))
    rows = fit.image_rows(bases.rotation, bases.translation, normalized)
    span = np.linalg.qr(rows.reshape(len(bases), -1, 6))[0].reshape(rows.shape)
    residual = residual[:, :-1].reshape(images.shape)
    change = images[:, second] - images[:, first]
    taken = np.einsum("kpi,kpij->kpj", change, span[:, first] - span[:, second])
    along = np.sum((residual[:, first] - residual[:, second]) * change, axis=-1)
    return bases.distance[:, None] ** 2 + 2 * along + 2 * np.sum(change**2, axis=-1) - np.sum(taken**2, axis=-1)


def _nearest(rivals: Rivals, at: Indices, count: int, per_dot: int = 0) -> Indices:
    """Indices of the nearest `count` rivals at each pose, and of the nearest `per_dot` that move each dot."""
    chosen = [np.zeros(0, dtype=np.intp)]
    for pose in at:
        rows = np.flatnonzero((rivals.pose == pose) & np.isfinite(rivals.distance))
        chosen.append(rows[np.argsort(rivals.distance[rows], kind="stable")[:count]])
        chosen.append(rows[rivals.take(rows).best_per_dot(per_dot)])
    return np.unique(np.concatenate(chosen))


def _keys(labeling: Indices, pose: Indices) -> list[bytes]:
    return [row.tobytes() for row in np.concatenate([labeling, pose[:, None]], axis=1)]


def _not_in(labeling: Indices, pose: Indices, known: Rivals) -> tuple[Indices, Indices]:
    """Labelings (K, n) with their poses (K,), each once, without the true one and those that are known."""
    seen = set(_keys(known.labeling, known.pose))
    wrong = (labeling != np.arange(labeling.shape[1])).any(axis=-1)
    chosen = []
    for index, key in enumerate(_keys(labeling, pose)):
        if wrong[index] and key not in seen:
            seen.add(key)
            chosen.append(index)
    return labeling[chosen], pose[chosen]


def _unique(rivals: Rivals) -> Rivals:
    keys = _keys(rivals.labeling, rivals.pose)
    return rivals.take(np.array(sorted({key: index for index, key in enumerate(keys)}.values()), dtype=np.intp))
