"""How safely each dot can be told apart from its place alone: how far images must move until another labeling fits.

For each dot the nearest rival labeling that takes it for another one is looked for over all poses (see
`markergen.optimize.rival_fits`, also for D). Its safety is d = D/(2 sqrt(n)), in px: while the images of the n dots are
displaced by less than d, root of the mean square over the dots, the true labeling fits better than that rival. So it
does while no single dot is displaced by more. That is proved; the displacement half way to the rival's images, of
exactly that RMS, makes the rival fit as well as the true pose.

With noise of sigma px in every coordinate the rival is taken with a probability of about Q(sqrt(n) d/sigma), Q the
tail of the normal distribution: all dots together tell.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.objectives import Setting
from markergen.optimize.rival_fits import Rivals, Scene, scene_of
from markergen.optimize.rivals import find_rivals, representative

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

REPRESENTATIVE, REPRESENTATIVE_OF_MANY, MANY = 12, 4, 24
"""Poses at which rivals are looked for, and how many for more than so many dots, whose rivals are all alike: two
neighbors exchanged."""

BROUGHT, BROUGHT_PER_DOT, FOLLOWED, FOLLOWED_PER_DOT = 24, 3, 8, 1
"""Labelings, the nearest of all and of each dot, that are followed from where they were found to the other
representative poses, and then to all: where safety was demanded, several are equally near where they were found."""

NEAR = 1.5
"""Poses where the rough fit of a labeling is farther than so many times its nearest are not fitted to the end."""

FITS = 400_000
"""Dots times poses times rivals that are fitted in the end; with more of them, fewer poses."""

SAME_PX = 1e-3
"""Below this safety two labelings are the same to any camera."""


LISTED = 8
"""Dots of a cycle that words list; of longer ones they say how long."""


@dataclass(frozen=True, eq=False)
class LabelSafety:
    """How safely each of n dots can be told apart.

    Attributes
    ----------
    px : array (n,)
        Safety of each dot over the poses; inf for one that no labeling can take for another.
    labels : array (n, n) of int
        Row i: what each dot is taken for by the nearest rival labeling that moves dot i, by their order.
    pose : array (n,) of int
        Index of the pose where that is.
    poses : PoseDistribution
    ids : tuple of int
        What the dots are called.
    """

    px: Array
    labels: Indices
    pose: Indices
    poses: PoseDistribution
    ids: tuple[int, ...]

    @property
    def least(self) -> float:
        """Safety in px of the least safe dot, and so of the labels as a whole."""
        return float(self.px.min())

    @property
    def worst(self) -> int:
        """The least safe dot, by its order."""
        return int(self.px.argmin())

    def confusion(self, sigma: float) -> Array:
        """Probability (n,) that noise of sigma px in every coordinate makes each dot's nearest rival fit better.

        At the rival's pose, the worst one; a half for a dot that another labeling fits exactly.
        """
        from scipy.special import erfc

        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.sqrt(len(self.px) / 2) * self.px / sigma
        return np.asarray(0.5 * erfc(np.where(self.px < SAME_PX, 0.0, far)))

    @property
    def sentence(self) -> str:
        """The least safety, the labeling that is likeliest taken for the true one, and where."""
        if np.isinf(self.least):
            return "labels are safe: no two dots are alike"
        pose, rival = self.pose[self.worst], self.in_words(self.worst)
        seen = f"tilt {self.poses.polar_angle_deg[pose]:.0f} deg, distance {self.poses.distance[pose]:.3g} m"
        if self.least < SAME_PX:
            return f"labels are ambiguous: with {rival} the marker looks the same ({seen})"
        return (
            f"labels are safe while dots move by less than {self.least:.2g} px RMS; "
            f"then they fit as well with {rival} ({seen})"
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """The report in words: `sentence`, and how much safer other dots are."""
        if np.isinf(self.least) or self.px.max() <= self.least + SAME_PX:
            return (self.sentence,)
        safest = int(self.px.argmax())
        never = "never taken for another" if np.isinf(self.px[safest]) else f"safe to {self.px[safest]:.2g} px"
        return self.sentence, f"the least safe dot is {self.ids[self.worst]}, the safest is {self.ids[safest]}, {never}"

    def in_words(self, dot: int) -> str:
        """The nearest rival labeling that moves a dot, such as "2 and 3 exchanged"; empty for a dot it never moves."""
        found = []
        for cycle in self.cycles(dot):
            if len(cycle) == 2:
                found.append(f"{cycle[0]} and {cycle[1]} exchanged")
            elif len(cycle) <= LISTED:
                found.append(f"each of {', '.join(map(str, (*cycle, cycle[0])))} taken for the next")
            else:
                found.append(f"{len(cycle)} dots taken for each other, {cycle[0]} for {cycle[1]} among them")
        return " and ".join(found)

    def cycles(self, dot: int) -> tuple[tuple[int, ...], ...]:
        """The nearest rival labeling that moves a dot: (0, 1, 2) takes dot 0 for 1, 1 for 2, and 2 for 0."""
        labels, cycles, left = self.labels[dot], [], set(range(len(self.px)))
        while left:
            cycle = [min(left)]
            while int(labels[cycle[-1]]) != cycle[0]:
                cycle.append(int(labels[cycle[-1]]))
            left -= set(cycle)
            if len(cycle) > 1:
                cycles.append(tuple(self.ids[i] for i in cycle))
        return tuple(cycles)

    def as_dict(self, sigma: float) -> dict[str, object]:
        """Return the report as plain JSON values, with the confusion by noise of sigma px.

        Of a dot that is never taken for another px is null, and there is nothing else to tell.
        """
        confusion = self.confusion(sigma)
        return {
            "least_px": self.least if np.isfinite(self.least) else None,
            "noise_px": sigma,
            "confusion": float(confusion.max()),
            "sentences": list(self.sentences),
            "dots": [
                {
                    "id": self.ids[i],
                    "px": float(self.px[i]),
                    "confusion": float(confusion[i]),
                    "rival": {str(self.ids[a]): self.ids[int(b)] for a, b in enumerate(self.labels[i]) if a != b},
                    "in_words": self.in_words(i),
                    "tilt_deg": float(self.poses.polar_angle_deg[self.pose[i]]),
                    "distance_m": float(self.poses.distance[self.pose[i]]),
                }
                if np.isfinite(self.px[i])
                else {"id": self.ids[i], "px": None}
                for i in range(len(self.px))
            ],
        }


def label_safety(marker: Marker, setting: Setting) -> LabelSafety:
    """How safely the dots of a marker can be told apart from the poses of a setting.

    Rings are told from disks by their looks, and what has the same look by its place. All dots are seen. Sizes of dots
    and shapes of their images, which tell more, are left out. Heights of control points count.
    """
    kinds = np.array([point.feature.kind == "ring" for point in marker.control_points], dtype=np.intp)
    scene = scene_of(marker.xyz, kinds, setting.camera, setting.poses)
    return safety_of(scene, tuple(point.id for point in marker.control_points))


def layout_safety(points: Array, setting: Setting, keyed: bool) -> LabelSafety:
    """How safely the dots of a layout (n, 2 or 3) in m can be told apart, the first one a ring if `keyed`."""
    kinds = np.zeros(len(points), dtype=np.intp)
    kinds[0] = keyed
    return safety_of(scene_of(points, kinds, setting.camera, setting.poses))


def safety_of(scene: Scene, ids: tuple[int, ...] = (), rivals: Rivals | None = None) -> LabelSafety:
    """Safety of the dots of a scene; without ids they are called by their order, without rivals these are sought."""
    n = len(scene.points)
    rivals = worst_rivals(scene) if rivals is None else rivals
    # What a rival takes for dot j is dot s(j): the labels are its inverse. Of equals the first in order is told.
    order = np.lexsort(np.argsort(rivals.labeling, axis=-1).T[::-1])
    rivals = rivals.take(order)
    away = np.where(rivals.moved, rivals.px[:, None], np.inf)
    px = np.min(away, axis=0, initial=np.inf)
    told = np.isfinite(px)
    labels, pose = np.tile(scene.truth, (n, 1)), np.zeros(n, dtype=np.intp)
    row = np.argmax(away[:, told] <= px[told] + SAME_PX, axis=0) if told.any() else []
    labels[told], pose[told] = np.argsort(rivals.labeling[row], axis=-1), rivals.pose[row]
    return LabelSafety(px, labels, pose, scene.poses, ids or tuple(range(n)))


def worst_rivals(scene: Scene) -> Rivals:
    """The nearest rivals that were found, with those that move each dot, followed over all poses."""
    n = len(scene.points)
    at = representative(scene.poses, REPRESENTATIVE_OF_MANY if n > MANY else REPRESENTATIVE)
    found = find_rivals(scene, at)
    found = _followed(scene, found, found.nearest_labelings(BROUGHT, BROUGHT_PER_DOT), at)
    nearest = found.nearest_labelings(FOLLOWED, FOLLOWED_PER_DOT)
    many = max(1, FITS // (n * max(1, len(nearest))))
    return _followed(scene, found, nearest, representative(scene.poses, many))


def _followed(scene: Scene, rivals: Rivals, labeling: Indices, at: Indices) -> Rivals:
    """Rivals with the labelings (K, n) fitted at the poses `at` that come into question for the nearest."""
    found = scene.fit(np.repeat(labeling, len(at), axis=0), np.tile(at, len(labeling)), rough=True)
    px = found.px.reshape(len(labeling), len(at))
    near = px <= NEAR * px.min(axis=1, initial=np.inf, keepdims=True)
    return rivals.joined(scene.refit(found.take(np.flatnonzero(near))))
