"""Labels of layouts that look the same when turned or shifted: told apart by all photographs together.

One photograph of a symmetric grid does not tell which dot is which. But no print is symmetric: its dots are off by
tens of micrometers and its paper is bent, so two photographs agree on one print only if their labels correspond. The
photographs are joined one by one, each with the labels for which the network fits best, dots being free.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from markergen.calibration.adjustment import UndeterminedError, adjust
from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.detect.conic_projection import outlines, refine_poses
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import rigid_motion
from markergen.model.camera import NO_DISTORTION, Camera, Distortion

Array = NDArray[np.float64]
Index = NDArray[np.intp]
T = TypeVar("T")

MATCH = 0.2
"""Distance, as a share of the smallest between two dots, within which a dot that was moved is another one."""

OVERLAP = 0.6
"""Minimum share of the dots that a turn or shift takes to dots, for it to be an alternative labeling."""

MOST_DOTS = 60
"""Number of dots that decide about labels; more decide no better, and take longer."""

WIDTH, HOPELESS = 6, 100.0
"""Number of sets of labels that are kept while photographs join, and difference of chi2 to the best one's, in units of
its variance factor, beyond which none is kept."""

ROUGHLY = 1e-3
"""Relative decrease of the cost at which an adjustment ends that only compares labels."""

CLEARLY = 15.0
"""Difference of chi2, in units of the variance factor, beyond which labels are sure."""

CAMERA_SIGMA = {"fx": 0.1, "cx": 0.03, "cy": 0.03, "k1": 0.1, "k2": 0.1}
"""Standard deviations within which the camera may move while labels are compared: of f as a share of it, of the
principal point as a share of the image's width."""

LEAST_DOTS = 4

UNKNOWN_LENS = Distortion("radtan", (0.0,) * 5)

SIZE_SIGMA, SIZE_LIMIT = 0.04, 16.0
"""Least standard deviation of the logarithm of a dot's area, and the most, in squares of it, that one dot counts."""

SURELY = 20.0
"""Difference of the sums of squares that settles labels by the dots' sizes alone: it takes two dots."""


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
    area : array (m,), optional
        Logarithms of the squared radii that the dots have in the image, up to a common constant.
    """

    index: Index
    centers: Array
    covariance: Array
    rotation: Array
    translation: Array
    area: Array | None = None

    def misfit_of_sizes(self, radii: Array) -> float:
        """Sum of squares, in sigma, of the logarithms of the dots' areas relative to those designed; 0 if unknown.

        Ink spreads and markers are scaled, so only differences among the dots count. sigma is estimated from
        the median.
        """
        if self.area is None:
            return 0.0
        off = self.area - 2 * np.log(radii[self.index])
        off -= np.median(off)
        sigma = max(SIZE_SIGMA, 1.4826 * float(np.median(np.abs(off))))
        return float(np.minimum((off / sigma) ** 2, SIZE_LIMIT).sum())


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
    points, radii : arrays (n, 3) and (n,), m
    dots : (centers (b, 2), covariance (b, 2, 2), areas (b,))
        All dots of the photograph, labeled or not, px.
    """
    tree, found = cKDTree(dots[0]), list[Guess]()
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
        area = np.log(dots[2][own]) - np.log(np.linalg.det(drawn.shape[0])) / 2 + 2 * np.log(radii[labeled])
        found.append(Guess(labeled, dots[0][own], dots[1][own], rotation, translation, area))
    most = max(len(each.index) for each in found)
    found = [each for each in found if len(each.index) == most]
    return _of_right_sizes(found, [each.misfit_of_sizes(radii) for each in found])


def _of_right_sizes(found: Sequence[T], misfit: Sequence[float]) -> list[T]:
    """Return what the dots' sizes do not rule out."""
    return [each for each, own in zip(found, misfit, strict=True) if own <= min(misfit) + SURELY]


@dataclass(frozen=True, eq=False)
class Settled:
    """Labels of all photographs.

    Attributes
    ----------
    guesses : tuple of Guess
        One for each photograph.
    chi2, runner_up : float
        Variance factors of the network with these labels, and with the best others; inf if there are none.
    """

    guesses: tuple[Guess, ...]
    chi2: float
    runner_up: float
    degrees_of_freedom: int

    @property
    def sure(self) -> bool:
        """Whether the other labels fit worse by more than chance, in units of the variance factor."""
        return (self.runner_up - self.chi2) * max(1, self.degrees_of_freedom) > CLEARLY * max(1.0, self.chi2)


@dataclass(frozen=True, eq=False)
class _Joined:
    """Photographs joined with certain labels: option chosen for each, and the network adjusted to them.

    `factor` is its variance factor.
    """

    chosen: dict[int, int]
    factor: float = np.inf
    degrees_of_freedom: int = 0
    places: Array | None = None
    poses: dict[int, tuple[Array, Array]] = field(default_factory=dict)


def settle(options: Sequence[Sequence[Guess]], points: Array, radii: Array, camera: Camera) -> Settled:
    """Choose one labeling for each photograph so that all agree on one print.

    Photographs join one after another, the most different views first, each with every labeling; the best few sets of
    labels are kept, and the best one in the end changes as long as one change improves the whole. Dots are free, and
    so is the camera within `CAMERA_SIGMA`: an error of it would cost more than wrong labels.

    Parameters
    ----------
    options : sequence of sequences of Guess
        Labelings of each photograph.
    points, radii : arrays (n, 3) and (n,), m
    camera : Camera
        Approximate camera.
    """
    network = _network(points, radii, camera)
    order = _order(options)
    # All may be turned together: the first keeps its labels.
    beam = [_Joined({order[0]: 0}, 0.0)]
    for k in order[1:]:
        longer = [_joined(each, k, c, options, network) for each in beam for c in range(len(options[k]))]
        longer.sort(key=lambda each: each.factor)
        best = longer[0]
        limit = best.factor + HOPELESS * max(1.0, best.factor) / max(1, best.degrees_of_freedom)
        beam = [best, *(each for each in longer[1:WIDTH] if each.factor <= limit)]
    best, *others = beam
    changed: list[_Joined] = []
    while len(order) > 1:
        pairs = [(k, c) for k in order[1:] for c in range(len(options[k])) if c != best.chosen[k]]
        changed = [_joined(best, k, c, options, network) for k, c in pairs]
        better = min(changed, key=lambda each: each.factor, default=best)
        if better.factor >= best.factor:
            break
        others.append(best)
        best = better
    runner_up = min((each.factor for each in (*others, *changed) if each.chosen != best.chosen), default=np.inf)
    guesses = tuple(options[k][best.chosen[k]] for k in range(len(options)))
    return Settled(guesses, best.factor, float(runner_up), best.degrees_of_freedom)


def _order(options: Sequence[Sequence[Guess]]) -> list[int]:
    """Photographs in the order to join: first one of few labelings and many dots, then the one tilted most unlike."""
    first = min(range(len(options)), key=lambda k: (len(options[k]), -len(options[k][0].index)))
    normals = np.array([each[0].rotation[:, 2] for each in options])
    order, near = [first], normals @ normals[first]
    while len(order) < len(options):
        near[order] = np.inf
        order.append(int(np.argmin(near)))
        near = np.maximum(near, normals @ normals[order[-1]])
    return order


def _network(points: Array, radii: Array, camera: Camera) -> Network:
    """Network of all dots and a camera that may move a little."""
    if camera.distortion == NO_DISTORTION:
        camera = replace(camera, distortion=UNKNOWN_LENS)
    names = [name for name in CAMERA_SIGMA if name in camera.parameter_names]
    freedom = CameraFreedom.of_names(camera, names)
    unit = {"fx": camera.fx, "cx": camera.width, "cy": camera.width}
    sigma = np.array([CAMERA_SIGMA[name] * unit.get(name, 1.0) for name in names])
    freedom = replace(freedom, precision=np.diag(sigma**-2))
    return Network(points, radii, camera, freedom, np.zeros(len(points), dtype=np.intp))


def _joined(before: _Joined, k: int, c: int, options: Sequence[Sequence[Guess]], network: Network) -> _Joined:
    """Return the photographs joined before with photograph k added, or changed, to its labeling c."""
    chosen = {**before.chosen, k: c}
    photos = sorted(chosen)
    guesses = [options[each][chosen[each]] for each in photos]
    v, n = len(photos), len(network.design)
    pixels, spread = np.zeros((v, n, 2)), np.broadcast_to(np.eye(2), (v, n, 2, 2)).copy()
    seen = np.zeros((v, n), dtype=bool)
    for row, each in enumerate(guesses):
        pixels[row, each.index], spread[row, each.index], seen[row, each.index] = each.centers, each.covariance, True
    shared = np.flatnonzero(seen.sum(axis=0) > 1)
    kept = np.zeros(n, dtype=bool)
    kept[shared[np.unique(np.linspace(0, len(shared) - 1, min(len(shared), MOST_DOTS)).astype(int))]] = True
    if kept.sum() < LEAST_DOTS or (seen[:, kept].sum(axis=1) < LEAST_DOTS).any():
        return _Joined(chosen)
    old = {each: pose for each, pose in before.poses.items() if each != k}
    poses = [old.get(each, (guess.rotation, guess.translation)) for each, guess in zip(photos, guesses, strict=True)]
    views = Views(pixels, spread, seen, np.array([pose[0] for pose in poses]), np.array([pose[1] for pose in poses]))
    start = network.design if before.places is None else before.places
    try:
        found = adjust(network.of_dots(kept), views.of_dots(kept), places=start[kept], tolerance=ROUGHLY)
    except (UndeterminedError, np.linalg.LinAlgError):
        return _Joined(chosen)
    places = start.copy()
    places[kept] = found.places
    moved = zip(found.views.rotation, found.views.translation, strict=True)
    factor = found.chi2 / max(1, found.degrees_of_freedom)
    return _Joined(chosen, factor, found.degrees_of_freedom, places, dict(zip(photos, moved, strict=True)))


def turned_to_design(
    settled: Settled, group: Sequence[Relabeling], points: Array, radii: Array, camera: Camera
) -> tuple[Settled, bool]:
    """Turn all labels together, so that the design fits best, and tell whether the dots' sizes settle it.

    Otherwise what is left is the print's own symmetry.
    """
    turned = [
        tuple(
            replace(
                guess,
                index=each.image[guess.index],
                **dict(zip(("rotation", "translation"), each.pose(guess.rotation, guess.translation), strict=True)),
            )
            for guess in settled.guesses
        )
        for each in group
        if (each.image >= 0).all()
    ]
    likely = _of_right_sizes(turned, [sum(guess.misfit_of_sizes(radii) for guess in each) for each in turned])
    best = min(likely, key=lambda each: _misfit(each, points, radii, camera))
    return replace(settled, guesses=best), len(likely) == 1


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
