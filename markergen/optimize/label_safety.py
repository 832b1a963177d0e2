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
from math import erfc, sqrt

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

BROUGHT = 3
"""Rivals of each dot that are followed from where they were found to the other representative poses."""

FITS = 400_000
"""Dots times poses times rivals that are fitted in the end; with more of them, fewer poses."""

SAME_PX = 1e-3
"""Below this safety two labelings are the same to any camera."""


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

    def confusion(self, sigma: float) -> float:
        """Probability that noise of sigma px in every coordinate makes the nearest rival fit better, at its pose."""
        return 0.5 * erfc(sqrt(len(self.px)) * self.least / sigma / sqrt(2))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The report in words: the least safe dot, the rival labeling, the pose, the pixels."""
        if np.isinf(self.least):
            return ("labels are safe: no two dots are alike",)
        worst = self.worst
        pose = self.pose[worst]
        seen = f"tilt {self.poses.polar_angle_deg[pose]:.0f} deg, distance {self.poses.distance[pose]:.3g} m"
        rival = self.rival(worst)
        if self.least < SAME_PX:
            return (f"labels are ambiguous: {rival} looks the same ({seen})",)
        least = f"labels are safe while dots move by less than {self.least:.2g} px RMS"
        found = [f"{least}: then {rival} fits as well ({seen})"]
        if self.px.max() > self.least + SAME_PX:
            safest = int(self.px.argmax())
            never = "never taken for another" if np.isinf(self.px[safest]) else f"safe to {self.px[safest]:.2g} px"
            found.append(f"the least safe dot is {self.ids[worst]}, the safest is {self.ids[safest]}, {never}")
        return tuple(found)

    def rival(self, dot: int) -> str:
        """The nearest rival labeling that moves a dot, as cycles: (0 1 2) takes dot 0 for 1, 1 for 2, and 2 for 0."""
        labels, cycles, left = self.labels[dot], [], set(range(len(self.px)))
        while left:
            cycle = [min(left)]
            while int(labels[cycle[-1]]) != cycle[0]:
                cycle.append(int(labels[cycle[-1]]))
            left -= set(cycle)
            if len(cycle) > 1:
                cycles.append(f"({' '.join(str(self.ids[i]) for i in cycle)})")
        return "".join(cycles)

    def as_dict(self) -> dict[str, object]:
        """Return the report as plain JSON values; null for a dot that is never taken for another."""
        return {
            "least_px": self.least if np.isfinite(self.least) else None,
            "dots": [
                {
                    "id": self.ids[i],
                    "px": float(self.px[i]),
                    "rival": {str(self.ids[a]): self.ids[int(b)] for a, b in enumerate(self.labels[i]) if a != b},
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


def safety_of(scene: Scene, ids: tuple[int, ...] = ()) -> LabelSafety:
    """Safety of the dots of a scene; without ids they are called by their order."""
    n = len(scene.points)
    rivals = worst_rivals(scene)
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
    found = _followed(scene, found, at, BROUGHT)
    many = max(1, FITS // (n * max(1, len(found.best_per_dot()))))
    return _followed(scene, found, representative(scene.poses, many), 1)


def _followed(scene: Scene, rivals: Rivals, at: Indices, count: int) -> Rivals:
    """Rivals with the nearest `count` of each dot fitted at all the poses `at`."""
    nearest = rivals.take(rivals.best_per_dot(count))
    labeling = np.unique(nearest.labeling, axis=0)
    return rivals.joined(scene.fit(np.repeat(labeling, len(at), axis=0), np.tile(at, len(labeling))))
