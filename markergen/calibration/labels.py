"""Labels of layouts that look the same when turned or shifted: told apart by all photographs together.

One photograph of a symmetric grid does not tell which dot is which. But no print is symmetric: its dots are off by
tens of micrometers and its paper is bent, so two photographs agree on one print only if their labels correspond. The
photographs are joined one by one, each with the labels for which the network fits best, dots being free.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from markergen.calibration.adjustment import UndeterminedError, adjust
from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.detect.conic_projection import outlines, refine_poses
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import rigid_motion
from markergen.model.camera import Camera

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MATCH = 0.2
"""Distance, as a share of the smallest between two dots, within which a dot that was moved is another one."""

OVERLAP = 0.6
"""Minimum share of the dots that a turn or shift takes to dots, for it to be an alternative labeling."""

MOST_DOTS = 60
"""Number of dots that decide about labels; more decide no better, and take longer."""

MOST_TRIED, ORDERS = 64, 4
"""Number of combinations of labels that are all tried; number of orders in which photographs join if there are more."""

SIZE_SIGMA = 0.1
"""Standard deviation of the logarithm of a dot's area: of printed ink and of a rough ellipse."""

SURELY = 12.0
"""Difference of chi2 that settles labels by the dots' sizes alone."""


@dataclass(frozen=True, eq=False)
class Relabeling:
    """A motion of the marker plane that takes most dots of a layout to dots.

    Attributes
    ----------
    rotation, shift : arrays (2, 2) and (2,), m
        X -> R X + t.
    image : array (n,) of int
        The dot that each is taken to; -1: none.
    """

    rotation: Array
    shift: Array
    image: Index

    def pose(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """Return the pose with which the moved layout looks as the layout does with the given pose."""
        turn = np.eye(3)
        turn[:2, :2] = self.rotation
        turned = rotation @ turn.T
        return turned, translation - turned @ np.append(self.shift, 0.0)


def relabelings(points: Array, rings: NDArray[np.bool_]) -> list[Relabeling]:
    """Return the motions that take at least `OVERLAP` of flat points (n, 3) to points of the same kind, identity first.

    Every motion takes a certain pair of neighbors to a pair as far apart.
    """
    flat = points[:, :2]
    tree = cKDTree(flat)
    apart = tree.query(flat, k=2)[0][:, 1]
    within = MATCH * float(apart.min())
    middle = int(np.argmin(np.sum((flat - flat.mean(axis=0)) ** 2, axis=1)))
    near = int(tree.query(flat[middle], k=2)[1][1])
    length = float(np.linalg.norm(flat[near] - flat[middle]))
    found: dict[bytes, Relabeling] = {}
    for first, others in enumerate(tree.query_ball_point(flat, length + within)):
        for second in others:
            if second == first or abs(np.linalg.norm(flat[second] - flat[first]) - length) > within:
                continue
            rotation, shift = rigid_motion(flat[[middle, near]], flat[[first, second]])
            for _ in range(2):
                distance, image = tree.query(flat @ rotation.T + shift)
                kept = (distance < within) & (rings == rings[image])
                if kept.mean() < OVERLAP:
                    break
                rotation, shift = rigid_motion(flat[kept], flat[image[kept]])
            else:
                labels = np.where(kept, image, -1)
                found.setdefault(labels.tobytes(), Relabeling(rotation, shift, labels))
    identity = np.arange(len(points)).tobytes()
    return [found[identity], *(each for key, each in found.items() if key != identity)]


@dataclass(frozen=True, eq=False)
class Guess:
    """Dots of one photograph with labels that are one of several.

    Attributes
    ----------
    index : array (m,) of int
        Control point of each dot by one labeling.
    centers, covariance : arrays (m, 2), px, and (m, 2, 2), px^2
    rotation, translation : arrays (3, 3) and (3,), m
        Pose by that labeling.
    """

    index: Index
    centers: Array
    covariance: Array
    rotation: Array
    translation: Array


def alternatives(
    guess: Guess,
    group: Sequence[Relabeling],
    points: Array,
    radii: Array,
    camera: Camera,
    dots: tuple[Array, Array, Array],
) -> list[Guess]:
    """Return the labelings of a photograph that label the most of all its dots, and fit the sizes of the dots best.

    Parameters
    ----------
    guess : Guess
    group : sequence of Relabeling
    points, radii : arrays (n, 3) and (n,), m
    dots : (centers (b, 2), covariance (b, 2, 2), areas (b,))
        All dots of the photograph, labeled or not, px.
    """
    tree, found = cKDTree(dots[0]), list[tuple[Guess, float]]()
    apart = cKDTree(guess.centers).query(guess.centers, k=2)[0][:, 1]
    for each in group:
        rotation, translation = each.pose(guess.rotation, guess.translation)
        place = to_camera(points, rotation[None], translation[None])
        predicted = camera.to_pixels(perspective(place))[0]
        good = np.isfinite(predicted).all(axis=1) & (place[0, :, 2] > 0)
        distance, nearest = tree.query(np.where(good[:, None], predicted, -1e9))
        labeled = np.flatnonzero(good & (distance < 0.3 * np.median(apart)))
        _, once = np.unique(nearest[labeled], return_index=True)
        labeled = labeled[np.sort(once)]
        own = nearest[labeled]
        drawn = outlines(points[labeled], radii[labeled], rotation[None], translation[None])
        size = np.log(dots[2][own] ** 2 / np.linalg.det(drawn.shape[0]))
        size = (size - np.median(size)) / (2 * SIZE_SIGMA)
        guessed = Guess(labeled, dots[0][own], dots[1][own], rotation, translation)
        found.append((guessed, float(np.minimum(size**2, 25).sum())))
    most = max(len(each.index) for each, _ in found)
    found = [each for each in found if len(each[0].index) == most]
    least = min(size for _, size in found)
    return [each for each, size in found if size <= least + SURELY]


@dataclass(frozen=True, eq=False)
class Settled:
    """Labels of all photographs.

    Attributes
    ----------
    guesses : tuple of Guess
        One for each photograph.
    chi2, runner_up : float
        Of the network with these labels, and with the best others for a single photograph; inf if there are none.
    """

    guesses: tuple[Guess, ...]
    chi2: float
    runner_up: float

    @property
    def sure(self) -> bool:
        """Whether the other labels fit clearly worse: by a third and by more than chance."""
        return self.runner_up > 1.33 * self.chi2 + 20


def settle(options: Sequence[Sequence[Guess]], points: Array, radii: Array, camera: Camera) -> Settled:
    """Choose one labeling for each photograph so that all agree on one print.

    Every combination is tried if they are few. Otherwise photographs join one after another, in several orders, each
    with the labels that suit the others best, and then change as long as one change improves the whole.

    Parameters
    ----------
    options : sequence of sequences of Guess
        Labelings of each photograph.
    points, radii : arrays (n, 3) and (n,), m
    camera : Camera
        Camera, held.
    """
    # All may be turned together: the first keeps its labels.
    first = min(range(len(options)), key=lambda k: (len(options[k]), -len(options[k][0].index)))
    known: dict[tuple[tuple[int, int], ...], float] = {}

    def cost(chosen: dict[int, int]) -> float:
        key = tuple(sorted(chosen.items()))
        if key not in known:
            known[key] = _cost([options[k][c] for k, c in key], points, radii, camera)
        return known[key]

    others = [k for k in range(len(options)) if k != first]
    choices = [range(len(options[k])) for k in others]
    if prod(map(len, choices)) <= MOST_TRIED:
        tried = [{first: 0, **dict(zip(others, each, strict=True))} for each in product(*choices)]
        ranked = sorted(tried, key=cost)
        best, runner_up = ranked[0], cost(ranked[1]) if len(ranked) > 1 else np.inf
    else:
        rng = np.random.default_rng(0)
        grown = [_grown(options, first, rng.permutation(others).tolist(), cost) for _ in range(ORDERS)]
        best = min(grown, key=cost)
        changed = [{**best, k: c} for k in others for c in range(len(options[k])) if c != best[k]]
        runner_up = min(map(cost, changed), default=np.inf)
    return Settled(tuple(options[k][best[k]] for k in range(len(options))), cost(best), float(runner_up))


def _grown(
    options: Sequence[Sequence[Guess]], first: int, order: Sequence[int], cost: Callable[[dict[int, int]], float]
) -> dict[int, int]:
    chosen = {first: 0}
    for k in order:
        chosen = min(({**chosen, k: c} for c in range(len(options[k]))), key=cost)
    while True:
        changed = [{**chosen, k: c} for k in order for c in range(len(options[k])) if c != chosen[k]]
        better = min(changed, key=cost, default=chosen)
        if cost(better) >= cost(chosen):
            return chosen
        chosen = better


def _cost(guesses: Sequence[Guess], points: Array, radii: Array, camera: Camera) -> float:
    """chi2 of the network of some dots, free ones; inf if it cannot be adjusted."""
    n = len(points)
    kept = np.unique(np.linspace(0, n - 1, min(n, MOST_DOTS)).astype(int))
    v = len(guesses)
    pixels, spread = np.zeros((v, n, 2)), np.broadcast_to(np.eye(2), (v, n, 2, 2)).copy()
    seen = np.zeros((v, n), dtype=bool)
    for k, each in enumerate(guesses):
        pixels[k, each.index], spread[k, each.index], seen[k, each.index] = each.centers, each.covariance, True
    kept = kept[seen[:, kept].sum(axis=0) > 1]
    if len(kept) < 4:
        return np.inf
    network = Network(points[kept], radii[kept], camera, CameraFreedom.held(camera), np.zeros(len(kept), dtype=np.intp))
    poses = np.array([each.rotation for each in guesses]), np.array([each.translation for each in guesses])
    try:
        return adjust(network, Views(pixels[:, kept], spread[:, kept], seen[:, kept], *poses)).chi2
    except (UndeterminedError, np.linalg.LinAlgError):
        return np.inf


def turned_to_design(
    settled: Settled, group: Sequence[Relabeling], points: Array, radii: Array, camera: Camera
) -> Settled:
    """Turn all labels together, if the design then fits better: what is left is the print's own symmetry."""
    whole = [each for each in group if (each.image >= 0).all()]
    best, cost = settled.guesses, np.inf
    for each in whole:
        place = np.empty(len(points), dtype=np.intp)
        place[:] = each.image
        turned = tuple(
            replace(
                guess,
                index=place[guess.index],
                **dict(zip(("rotation", "translation"), each.pose(guess.rotation, guess.translation), strict=True)),
            )
            for guess in settled.guesses
        )
        value = _misfit(turned, points, radii, camera)
        if value < cost:
            best, cost = turned, value
    return replace(settled, guesses=best)


def _misfit(guesses: Sequence[Guess], points: Array, radii: Array, camera: Camera) -> float:
    """Sum of squares in px^2 of what the design leaves in all photographs."""
    total = 0.0
    for each in guesses:
        seen = camera.from_pixels(each.centers)
        weight = np.broadcast_to(camera.fx**2 * np.eye(2), (1, len(seen), 2, 2))
        found = refine_poses(
            points[each.index], radii[each.index], seen[None], weight, each.rotation[None], each.translation[None]
        )
        total += float(found[2][0])
    return total
