"""Label safety: the displacement of the dots' images at which another labeling fits as well as the true one.

For each dot the search covers all poses for the nearest rival labeling that confuses it with another dot (see
`rival_fits`, also for D). Its safety is d = D/(2 sqrt(n)), in px: as long as the images of the n dots are displaced by
less than d, RMS over the dots, the true labeling fits better than that rival. This holds in particular if no single dot
is displaced by more than d. The bound is proved and tight: the displacement halfway to the rival's images, of exactly
that RMS, makes the rival fit as well as the true pose. Labels whose safety is below `SAME_PX` are ambiguous.

The detector asks for more: labels are decided where their evidence exceeds the rival's by enough (see `evidence`).

**Search.** A rival's images are the same set of points as the true ones. To first order its pose therefore preserves
mean and covariance of the set, which leaves one degree of freedom: the rotation angle of the whitened set,
S^(-1/2) (X - mean). Every angle gives one labeling. The best of these, and the true one, are then varied by repeatedly
exchanging two dots. The cost of an exchange needs no new fit: if the exchanged images differ by d, two residuals change
by +d and -d, and the fit removes the part in the span of its Jacobian.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from markergen.arrays import Array, Indices
from markergen.bounds.confusion.evidence import ENOUGH, RARELY, odds
from markergen.bounds.confusion.rival_fits import RivalFit, Rivals, SeenLayout, seen_layout
from markergen.defaults import NOISE_PX
from markergen.model.marker import Marker
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.units import two_digits

MANY = 24
"""Number of dots beyond which all rivals are alike, two neighbors exchanged, and the constants ..._OF_MANY apply."""

REPRESENTATIVE, REPRESENTATIVE_OF_MANY = 12, 4
"""Number of poses at which rivals are searched."""

BROUGHT, BROUGHT_PER_DOT, FOLLOWED, FOLLOWED_PER_DOT = 24, 3, 8, 1
"""Numbers of labelings, the nearest overall and per dot, that are followed from the pose where they were found to the
other representative poses, and then to all poses: if safety was demanded, several are equally near at first."""

NEAR = 1.5
"""Factor of a labeling's smallest distance in the rough fit beyond which a pose is not fitted to convergence."""

FITS = 400_000
"""Limit of dots times poses times rivals in the final fit; above it, fewer poses are used."""

SAME_PX = 1e-3
"""Safety in px below which no camera can distinguish two labelings."""

LISTED = 8
"""Maximum length of a cycle whose dots are listed in sentences; for longer ones only the length is given."""

ANGLES, ANGLES_OF_MANY = 180, 360
"""Number of rotation angles tried; more for many dots, which are closer together."""

ASSIGNED_AT_ONCE = 100_000
"""Number of distances between dots that are computed at a time."""

KEPT = 16
"""Number of labelings per pose fitted in each round, in addition to the best for each dot."""

VARIED = 6
"""Number of labelings per pose whose exchanges are tried in each round, in addition to the true one in the first."""

ROUNDS = 3
"""Rounds of exchanges; three produce every permutation of four dots, and every cycle of four among more."""

FINISHED, FINISHED_PER_DOT = 8, 2
"""Numbers of labelings per pose fitted to convergence: the nearest overall, and per dot."""


@dataclass(frozen=True, eq=False)
class LabelSafety:
    """Label safety of each of n dots.

    Attributes
    ----------
    px : array (n,)
        Least safety of each dot over the poses; inf for a dot that no labeling confuses with another.
    labels : array (n, n) of int
        Row i: index of the dot that each dot is taken for by the nearest rival labeling that moves dot i.
    pose : array (n,) of int
        Index of the pose of that rival.
    ids : tuple of int
        Ids of the dots in sentences.
    noise_px : float
        Standard deviation of the noise in every coordinate for the following two.
    margin, undecided : arrays (n,)
        Expected difference in nats of the detector's evidence for the true labels and for that rival's, and the
        probability that the detector does not decide, both at the rival's pose (see `evidence`).
    """

    px: Array
    labels: Indices
    pose: Indices
    poses: PoseDistribution
    ids: tuple[int, ...]
    noise_px: float
    margin: Array
    undecided: Array

    @property
    def least(self) -> float:
        """Safety in px of the least safe dot, and thus of all labels."""
        return float(self.px.min())

    @property
    def worst(self) -> int:
        """Index of the least safe dot."""
        return int(self.px.argmin())

    @property
    def is_decided(self) -> bool:
        """True if the detector decides for the true labels from every pose, but for a share of views of `RARELY`."""
        return bool(self.undecided.max() <= RARELY)

    @property
    def sentence(self) -> str:
        """The least safety, and the most likely wrong labeling with its pose, in words."""
        if np.isinf(self.least):
            return "labels are safe: no two dots are alike"
        pose, rival = self.pose[self.worst], self.in_words(self.worst)
        seen = f"tilt {self.poses.polar_angle_deg[pose]:.0f} deg, distance {self.poses.distance[pose]:.3g} m"
        if self.least < SAME_PX:
            return f"labels are ambiguous: with {rival} the marker looks the same ({seen})"
        likely = f"with errors of {self.noise_px:g} px they are {odds(self.margin[self.worst])}"
        if not self.is_decided:
            share = f"{two_digits(100 * self.undecided.max())} % of views from the worst pose"
            return f"labels may be undecided, in {share}: {likely} with {rival} ({seen}); {ENOUGH}"
        return (
            f"labels are safe: {likely} with {rival} ({seen}), and {ENOUGH}; "
            f"they fit best while dots move by less than {two_digits(self.least)} px RMS"
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """The report in words: `sentence`, and the least safe and safest dots."""
        if np.isinf(self.least) or self.px.max() <= self.least + SAME_PX:
            return (self.sentence,)
        safest = int(self.px.argmax())
        never = "never taken for another" if np.isinf(self.px[safest]) else f"safe to {two_digits(self.px[safest])} px"
        return self.sentence, f"the least safe dot is {self.ids[self.worst]}, the safest is {self.ids[safest]}, {never}"

    def in_words(self, dot: int) -> str:
        """The nearest rival labeling that moves a dot, such as "2 and 3 exchanged"; empty if there is none."""
        phrases = []
        for cycle in self.cycles(dot):
            if len(cycle) == 2:
                phrases.append(f"{cycle[0]} and {cycle[1]} exchanged")
            elif len(cycle) <= LISTED:
                phrases.append(f"each of {', '.join(map(str, (*cycle, cycle[0])))} taken for the next")
            else:
                phrases.append(f"{len(cycle)} dots taken for each other, {cycle[0]} for {cycle[1]} among them")
        return " and ".join(phrases)

    def cycles(self, dot: int) -> tuple[tuple[int, ...], ...]:
        """Cycles of the nearest rival labeling that moves a dot: (0, 1, 2) takes dot 0 for 1, 1 for 2, and 2 for 0."""
        labels, cycles, left = self.labels[dot], [], set(range(len(self.px)))
        while left:
            cycle = [min(left)]
            while int(labels[cycle[-1]]) != cycle[0]:
                cycle.append(int(labels[cycle[-1]]))
            left -= set(cycle)
            if len(cycle) > 1:
                cycles.append(tuple(self.ids[i] for i in cycle))
        return tuple(cycles)

    def as_dict(self) -> dict[str, object]:
        """Return the report as plain JSON values.

        For a dot that is never taken for another, px is null and the other entries are absent.
        """
        has_rival = np.isfinite(self.px)
        return {
            "least_px": self.least if np.isfinite(self.least) else None,
            "noise_px": self.noise_px,
            "margin": float(self.margin.min()) if has_rival.any() else None,
            "undecided": float(self.undecided.max()),
            "sentences": list(self.sentences),
            "dots": [
                {
                    "id": self.ids[i],
                    "px": float(self.px[i]),
                    "margin": float(self.margin[i]),
                    "undecided": float(self.undecided[i]),
                    "rival": {str(self.ids[a]): self.ids[int(b)] for a, b in enumerate(self.labels[i]) if a != b},
                    "in_words": self.in_words(i),
                    "tilt_deg": float(self.poses.polar_angle_deg[self.pose[i]]),
                    "distance_m": float(self.poses.distance[self.pose[i]]),
                }
                if has_rival[i]
                else {"id": self.ids[i], "px": None}
                for i in range(len(self.px))
            ],
        }


def label_safety(marker: Marker, setting: Setting, noise_px: float = NOISE_PX) -> LabelSafety:
    """Label safety of a marker's dots, seen from the poses of a setting with noise of `noise_px`.

    Rings differ from disks by appearance; dots of equal appearance differ only by position. All dots are assumed
    visible. Sizes of dots and shapes of their images, which would help, are ignored. Heights of control points count.

    Dots of several sizes are known by their size: the safety of each is that among those of its own, at the poses
    that see all of these.
    """
    kinds = np.array([point.feature.kind == "ring" for point in marker.control_points], dtype=np.intp)
    ids = tuple(point.id for point in marker.control_points)
    if not setting.sight:
        return safety_of(seen_layout(marker.xyz, kinds, setting.camera, setting.poses), ids, noise_px=noise_px)
    n = len(marker)
    px, labels, at = np.full(n, np.inf), np.tile(np.arange(n), (n, 1)), np.zeros(n, dtype=np.intp)
    margins, shares = np.full(n, np.inf), np.zeros(n)
    for scale in (constellation.dots for constellation in marker.constellations):
        whole = np.flatnonzero(setting.sight.seen[:, scale].all(axis=1))
        if not whole.size:
            continue
        poses = setting.poses.taken(whole, setting.poses.dropped)
        safety = safety_of(seen_layout(marker.xyz[scale], kinds[scale], setting.camera, poses), noise_px=noise_px)
        px[scale], at[scale] = safety.px, whole[safety.pose]
        margins[scale], shares[scale] = safety.margin, safety.undecided
        labels[np.ix_(scale, scale)] = scale[safety.labels]
    return LabelSafety(px, labels, at, setting.poses, ids, noise_px, margins, shares)


def layout_safety(points: Array, setting: Setting, keyed: bool) -> LabelSafety:
    """Label safety of the dots of a layout (n, 2 or 3) in m, the first one a ring if `keyed`."""
    kinds = np.zeros(len(points), dtype=np.intp)
    kinds[0] = keyed
    return safety_of(seen_layout(points, kinds, setting.camera, setting.poses))


def safety_of(
    scene: SeenLayout, ids: tuple[int, ...] = (), rivals: Rivals | None = None, noise_px: float = NOISE_PX
) -> LabelSafety:
    """Label safety of a scene; ids default to 0, 1, ... and rivals to the result of a search."""
    n = len(scene.points)
    rivals = worst_rivals(scene) if rivals is None else rivals
    # A rival takes dot s(j) for dot j, so the labels are its inverse. Ties go to the first in lexicographic order.
    order = np.lexsort(np.argsort(rivals.labeling, axis=-1).T[::-1])
    rivals = rivals.take(order)
    away = np.where(rivals.moved, rivals.px[:, None], np.inf)
    px = np.min(away, axis=0, initial=np.inf)
    has_rival = np.isfinite(px)
    labels, pose = np.tile(scene.truth, (n, 1)), np.zeros(n, dtype=np.intp)
    row = np.argmax(away[:, has_rival] <= px[has_rival] + SAME_PX, axis=0) if has_rival.any() else []
    labels[has_rival], pose[has_rival] = np.argsort(rivals.labeling[row], axis=-1), rivals.pose[row]
    judged = scene.judged(2 * np.sqrt(n) * px, pose, noise_px)
    return LabelSafety(px, labels, pose, scene.poses, ids or tuple(range(n)), noise_px, *judged)


def worst_rivals(scene: SeenLayout) -> Rivals:
    """Find the nearest rivals, including those that move each dot, over all poses."""
    n = len(scene.points)
    at = representative(scene.poses, REPRESENTATIVE_OF_MANY if n > MANY else REPRESENTATIVE)
    rivals = find_rivals(scene, at)
    rivals = followed(scene, rivals, rivals.nearest_labelings(BROUGHT, BROUGHT_PER_DOT), at)
    nearest = rivals.nearest_labelings(FOLLOWED, FOLLOWED_PER_DOT)
    many = max(1, FITS // (n * max(1, len(nearest))))
    return followed(scene, rivals, nearest, representative(scene.poses, many))


def followed(scene: SeenLayout, rivals: Rivals, labeling: Indices, at: Indices) -> Rivals:
    """Add to the rivals the labelings (K, n) fitted at those of the poses `at` that may be nearest."""
    fitted = scene.fit(np.repeat(labeling, len(at), axis=0), np.tile(at, len(labeling)), rough=True)
    px = fitted.px.reshape(len(labeling), len(at))
    is_near = px <= NEAR * px.min(axis=1, initial=np.inf, keepdims=True)
    return rivals.joined(scene.refit(fitted.take(np.flatnonzero(is_near))))


def find_rivals(scene: SeenLayout, at: Indices) -> Rivals:
    """Near rivals at the poses with indices `at`: those that move each dot, and the nearest overall.

    A heuristic search over some of the permutations (see the module), tested against an exhaustive one.
    """
    pool = scene.fit(*_rotated(scene, at), rough=True)
    pool = _unique(pool.joined(_reassigned(scene, pool)))
    truth = Rivals(
        np.tile(scene.truth, (len(at), 1)), at, scene.poses.rotation[at], scene.poses.translation[at], np.zeros(len(at))
    )
    for sweep in range(ROUNDS):
        nearest = pool.take(_nearest(pool, at, VARIED))
        bases = truth.joined(nearest) if sweep == 0 else nearest
        fresh = _not_in(*_exchanged(scene, bases, at), pool)
        if not len(fresh[0]):
            break
        pool = pool.joined(scene.fit(*fresh, rough=True))
    best = pool.take(_nearest(pool, at, FINISHED, FINISHED_PER_DOT))
    # Restart from both starts: a rough fit may have continued from the one that leads to the worse minimum.
    return scene.fit(best.labeling, best.pose)


def representative(poses: PoseDistribution, count: int) -> Indices:
    """Indices of up to `count` poses that differ much in distance and direction, the most tilted one first.

    Each further pose is the one farthest from all previous ones, in the direction of the camera and the logarithm of
    its distance. A rotation about the line of sight changes nothing and does not count.
    """
    center = eyes_of(poses)
    distance = np.linalg.norm(center, axis=-1)
    where = np.concatenate([center / distance[:, None], np.log(distance)[:, None]], axis=-1)
    chosen = [int(np.argmin(poses.cos_tilt / distance))]
    gap = np.linalg.norm(where - where[chosen[0]], axis=-1)
    while len(chosen) < count and gap.max() > 1e-9:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(where - where[chosen[-1]], axis=-1))
    return np.array(chosen, dtype=np.intp)


def _rotated(scene: SeenLayout, at: Indices) -> tuple[Indices, Indices]:
    """Labelings (K, n) by rotations of the whitened set, the best `KEPT` at each pose; and their poses (K,)."""
    from scipy.optimize import linear_sum_assignment

    n = len(scene.points)
    strange = np.where(scene.kinds[:, None] != scene.kinds, 1e6, 0.0)
    count = ANGLES_OF_MANY if n > MANY else ANGLES
    cosine, sine = (function(np.arange(count) * (2 * np.pi / count)) for function in (np.cos, np.sin))
    rotations = np.moveaxis(np.array([[cosine, sine], [-sine, cosine]]), -1, 0)
    layout = _whitened(scene.points[:, :2])
    labelings, poses = [], []
    for pose in at:
        seen = _whitened(scene.rays[pose] * [1, -1])
        by_labeling: dict[bytes, tuple[float, Indices]] = {}
        # All at once would take 60 MB for 100 dots.
        parts = np.array_split(rotations, 1 + count * n**2 // ASSIGNED_AT_ONCE)
        costs = (np.sum(((layout @ part)[:, :, None] - seen) ** 2, axis=-1) + strange for part in parts)
        for cost in chain.from_iterable(costs):
            labeling = linear_sum_assignment(cost)[1]
            total = float(cost[scene.truth, labeling].sum())
            if total < 1e6 and (labeling != scene.truth).any():
                key = labeling.tobytes()
                by_labeling[key] = min(
                    by_labeling.get(key, (np.inf, labeling)), (total, labeling), key=lambda candidate: candidate[0]
                )
        best = sorted(by_labeling.values(), key=lambda candidate: candidate[0])[:KEPT]
        labelings += [labeling for _, labeling in best]
        poses += [pose] * len(best)
    return np.array(labelings, dtype=np.intp).reshape(-1, n), np.array(poses, dtype=np.intp)


def _whitened(points: Array) -> Array:
    """Whiten points (n, 2): subtract the mean and make the covariance the identity, without mirroring."""
    centered = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centered.T @ centered / len(points))
    return centered @ (vectors / np.sqrt(np.maximum(values, 1e-12 * values[1]))) @ vectors.T


def _reassigned(scene: SeenLayout, rivals: Rivals) -> Rivals:
    """New rivals that assign to each dot the image nearest to its fitted position."""
    from scipy.optimize import linear_sum_assignment

    finite = np.flatnonzero(np.isfinite(rivals.distance))
    rivals = rivals.take(finite)
    drawn = scene.camera.project(scene.points, rivals.rotation, rivals.translation)
    cost = np.sum((drawn[:, :, None] - scene.images[rivals.pose][:, None]) ** 2, axis=-1)
    strange = np.where(scene.kinds[:, None] != scene.kinds, 1e12, 0.0)
    labeling = np.array([linear_sum_assignment(matrix + strange)[1] for matrix in cost], dtype=np.intp)
    return scene.fit(*_not_in(labeling.reshape(rivals.labeling.shape), rivals.pose, rivals), rough=True)


def _exchanged(scene: SeenLayout, bases: Rivals, at: Indices) -> tuple[Indices, Indices]:
    """Labelings (K, n) that differ from bases by an exchange of two dots, the most promising per pose and dot."""
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
        # Beyond twice that many there are only duplicates.
        top = np.arange(min(2 * KEPT, len(base)))
        # Also the cheapest exchange of each dot.
        _, by_first = np.unique(first[pair], return_index=True)
        _, by_second = np.unique(second[pair], return_index=True)
        chosen = np.unique(np.concatenate([top, by_first, by_second]))
        labeling = bases.labeling[rows[base[chosen]]].copy()
        dot, partner = first[pair[chosen]], second[pair[chosen]]
        row = np.arange(len(chosen))
        labeling[row, dot], labeling[row, partner] = labeling[row, partner], labeling[row, dot]
        labelings.append(labeling)
        poses.append(np.full(len(chosen), pose))
    return np.concatenate(labelings), np.concatenate(poses)


def _prices(scene: SeenLayout, bases: Rivals, first: Indices, second: Indices) -> Array:
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
    """Indices of the `count` nearest rivals at each pose, and of the `per_dot` nearest that move each dot."""
    chosen = [np.zeros(0, dtype=np.intp)]
    for pose in at:
        rows = np.flatnonzero((rivals.pose == pose) & np.isfinite(rivals.distance))
        chosen.append(rows[np.argsort(rivals.distance[rows], kind="stable")[:count]])
        chosen.append(rows[rivals.take(rows).best_per_dot(per_dot)])
    return np.unique(np.concatenate(chosen))


def _keys(labeling: Indices, pose: Indices) -> list[bytes]:
    return [row.tobytes() for row in np.concatenate([labeling, pose[:, None]], axis=1)]


def _not_in(labeling: Indices, pose: Indices, rivals: Rivals) -> tuple[Indices, Indices]:
    """Labelings (K, n) with their poses (K,), without duplicates, the true one, and known ones."""
    seen = set(_keys(rivals.labeling, rivals.pose))
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
