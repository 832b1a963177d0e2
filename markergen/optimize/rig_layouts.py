"""Layouts of the plates of a rig, for the joint pose: block coordinate descent over the plates.

In each pose T_camera_rig some plates are seen; the information of their dots on the joint pose adds up. While one
plate's layout is optimized, that of all others in view is constant (`Sight.known`). Plates without tags are kept a
smallest affine distance apart, each from all others, so that no view confuses them (`bounds.confusion`).
"""
# tests: tests/optimize/test_rig_design.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array, Indices
from markergen.bounds.confusion.affine import affine_distance, foreign_safety, partial_distance, self_distance
from markergen.errors import InputError
from markergen.maths.information import moved_information
from markergen.model.goal import parse_goal
from markergen.model.poses import SEEN, PoseDistribution, silhouette, visibility
from markergen.model.rig_shapes import Face
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.base import Carrier, Sight
from markergen.objectives.observation import DotNoise
from markergen.objectives.pose import PoseObjective
from markergen.optimize.comparisons import reference
from markergen.optimize.dot_size import PIXELS, DotSize
from markergen.optimize.polish import polish
from markergen.optimize.problem import FEW_POSES, FeasibleRegion, objective_of, room_of
from markergen.optimize.search import search
from markergen.options import Progress

FLATTEST = 0.2
"""Minimum cosine of the tilt at which a plate counts."""

STEEPEST = 0.5
"""Cosine of the tilt of the face of a cube that is seen best, from nearby; from far away it is 0.58."""

SWEEPS = 2
"""Rounds over all plates."""

APART_PX = 1.0
"""Demanded safety in px against taking a plate for another, RMS over its dots, from every pose that sees it."""

ATTEMPTS, FARTHER = 4, 1.5
"""Number of layouts tried for a plate that is not safe enough, and factor of the affine distance from one to the next:
from close up, perspective makes up for differences that no affine map does."""

FIRST, CHILDREN, PARENTS, GENERATIONS = 256, 96, 8, 16
"""Numbers of layouts tried at first and in each generation, of those that are varied, and of generations."""

LARGEST, SMALLEST = 0.4, 0.003
"""Steps of the first and the last generation, in radii of the boundary."""

PARTLY = 2.0
"""How much a distance counts that leaves out a dot."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A plate as the poses of a rig see it.

    Attributes
    ----------
    index : array (p,) of int
        Poses that see the whole plate from its front.
    poses : PoseDistribution
        T_camera_marker of these.
    offset : array (p, 3)
        Vector in m from the rig's origin to the plate's, camera frame.
    """

    face: Face
    index: Indices
    poses: PoseDistribution
    offset: Array

    @staticmethod
    def of(face: Face, boundary_points: Array, poses: PoseDistribution, spec: Spec) -> "Seen":
        """See the class."""
        face_rotation, face_translation = np.array(face.rotation), np.array(face.translation)
        rotation, offset = poses.rotation @ face_rotation, poses.rotation @ face_translation
        views = PoseDistribution(poses.name, rotation, offset + poses.translation)
        seen = visibility(boundary_points, views.rotation, views.translation, spec.camera) == SEEN
        index = np.flatnonzero(seen & (views.cos_tilt >= FLATTEST))
        return Seen(face, index, views.taken(index, len(poses) - len(index)), offset[index])


def seen_plates(faces: Sequence[Face], poses: PoseDistribution, spec: Spec) -> list[Seen]:
    """Return each plate as the poses see it.

    Raises
    ------
    InputError
        If there is a plate that no pose sees.
    """
    plates = [Seen.of(face, silhouette(face.boundary), poses, spec) for face in faces]
    for plate in plates:
        if not len(plate.index):
            raise InputError(
                "a pose that sees each plate, whole and from its front",
                f"none of {len(poses)} ({poses.name}) for {plate.face.name}",
                "use other --poses, farther away or from all around, or leave the plate out",
            )
    return plates


def best_views(plates: Sequence[Seen], count: int) -> list[Indices]:
    """Indices of each plate's poses in which it is seen at the least tilt of all plates; all if there are none.

    Of those, only the ones at a tilt that the nearest face of a cube has, if there are any: below a body without a
    bottom, all plates are seen badly.
    """
    tilt = np.full((len(plates), count), -1.0)
    for row, plate in zip(tilt, plates, strict=True):
        row[plate.index] = plate.poses.cos_tilt
    best = tilt >= tilt.max(axis=0) - 1e-9
    best &= (tilt >= STEEPEST) | ~(best & (tilt >= STEEPEST)).any(axis=1, keepdims=True)
    chosen = [np.flatnonzero(row[plate.index]) for row, plate in zip(best, plates, strict=True)]
    return [views if len(views) else np.arange(len(plate.index)) for views, plate in zip(chosen, plates, strict=True)]


class RigLayouts:
    """Layouts of all plates, improved one by one.

    Parameters
    ----------
    specs : sequence of Spec
        Of each plate; equal in everything but boundary, poses, dots and tag.
    fixed : mapping of int to array (n, 2)
        Layouts of plates whose markers are given.
    count : int
        Number of the rig's poses.
    """

    def __init__(
        self,
        plates: Sequence[Seen],
        specs: Sequence[Spec],
        dots: Sequence[DotSize],
        fixed: dict[int, Array],
        count: int,
    ) -> None:
        self.plates, self.specs, self.dots, self.fixed, self.count = plates, specs, dots, fixed, count
        self.joint = not any(OBJECTIVES[name].planar_only for name in parse_goal(specs[0].objective).names)
        self.tagged = bool(specs[0].tag)
        self.layouts: list[Array] = []
        faces = [plate.face for plate in plates]
        self._body = np.concatenate([_in_rig(face, silhouette(face.boundary)) for face in faces])

    def find(self, rng: np.random.Generator, progress: Progress | None = None) -> None:
        """Find the layouts, first of each plate alone, then together."""
        by_shape: dict[object, Array] = {}
        for k, (plate, spec, dots) in enumerate(zip(self.plates, self.specs, self.dots, strict=True)):
            key = (plate.face.boundary, dots.diameter)
            if k not in self.fixed and key not in by_shape:
                setting, region = self.setting(k), self.region(k)
                ngon = reference(spec, region, setting)
                few = replace(setting, poses=setting.poses.taken(_few(len(plate.index)), 0))
                objective, rough = objective_of(spec, setting, ngon), objective_of(spec, few, ngon)
                by_shape[key] = search(objective, region, spec.n, rng, spec.restarts, progress, rough).points
            self.layouts.append(self.fixed[k] if k in self.fixed else by_shape[key])
        for sweep in range(SWEEPS):
            for k in range(len(self.plates)):
                if k not in self.fixed:
                    others = [j for j in range(len(self.plates)) if j < k or (j > k and (sweep or j in self.fixed))]
                    self._improve(k, others, rng, progress, sweep)

    def _improve(
        self, k: int, others: list[int], rng: np.random.Generator, progress: Progress | None, sweep: int
    ) -> None:
        spec, region = self.specs[k], self.region(k)
        setting = self.joint_setting(k) if self.joint else self.setting(k)
        ngon = reference(spec, region, self.setting(k))
        few = _few(len(self.plates[k].index))
        sight = setting.sight and Sight(setting.sight.seen[few], setting.sight.known[few])
        rough = replace(setting, poses=setting.poses.taken(few, 0), sight=sight)
        if progress:
            progress("plates", sweep * len(self.plates) + k, SWEEPS * len(self.plates))
        if self.tagged:
            self.layouts[k] = polish(objective_of(spec, setting, ngon), region, self.layouts[k])[0]
            return
        apart = [self.layouts[j] for j in others]
        # Half a displacement makes the other plate fit as well; at this scale a dot has `PIXELS`.
        distance = 2 * APART_PX / PIXELS * self.dots[k].diameter
        objectives = objective_of(spec, setting, ngon), objective_of(spec, rough, ngon)
        best, most = self.layouts[k], -1.0
        for attempt in range(ATTEMPTS):
            layout = distinct_layout(*objectives, region, self.layouts[k], apart, distance * FARTHER**attempt, rng)
            self.layouts[k], before = layout, self.layouts[k]
            safety = min((min(self.safety(k, j), self.safety(j, k)) for j in others), default=np.inf)
            self.layouts[k] = before
            if safety > most:
                best, most = layout, safety
            if safety >= APART_PX:
                break
        self.layouts[k] = best

    def safety(self, k: int, j: int) -> float:
        """Safety in px against taking a plate for another one, see `foreign_safety`."""
        return foreign_safety(self.layouts[k], self.layouts[j], self.setting(k))

    def region(self, k: int) -> FeasibleRegion:
        """Region of a plate's dots."""
        spec, dots = self.specs[k], self.dots[k]
        return FeasibleRegion(room_of(spec), dots.diameter, dots.clearance, spec.gap)

    def setting(self, k: int) -> Setting:
        """Setting of a plate alone, with image noise and print error."""
        spec = self.specs[k]
        noise = DotNoise(self.dots[k].diameter, spec.image_noise, spec.print_sigma)
        return Setting(spec.boundary, spec.camera, self.plates[k].poses, noise)

    def joint_setting(self, k: int) -> Setting:
        """Setting of a plate for the pose of the rig, to which all other plates in view contribute."""
        plate = self.plates[k]
        rest = np.zeros((self.count, 6, 6))
        for j in range(len(self.plates)):
            if j != k:
                rest += self.information(j)
        information = moved_information(rest[plate.index], plate.offset)
        rotation, translation = np.array(plate.face.rotation), np.array(plate.face.translation)
        carrier = Carrier((self._body - translation) @ rotation, -translation @ rotation)
        seen = np.ones((len(plate.index), len(self.layouts[k])), dtype=bool)
        return replace(self.setting(k), sight=Sight(seen, information), carrier=carrier)

    def information(self, k: int) -> Array:
        """Information (P, 6, 6) of a plate's dots on the rig's pose; 0 where it is not seen."""
        information = np.zeros((self.count, 6, 6))
        plate, objective = self.plates[k], PoseObjective(self.setting(k))
        plate_information = objective.information(self.layouts[k][None])[0][0]
        information[plate.index] = moved_information(plate_information, -plate.offset)
        return information


def _few(count: int) -> Indices:
    """Indices of about `FEW_POSES` of that many poses."""
    return np.unique(np.linspace(0, count - 1, min(count, FEW_POSES)).round().astype(int))


def _in_rig(face: Face, points: Array) -> Array:
    return points @ np.array(face.rotation).T[:2] + face.translation


def distinct_layout(
    objective: Objective,
    rough: Objective,
    region: FeasibleRegion,
    start: Array,
    others: list[Array],
    distance: float,
    rng: np.random.Generator,
) -> Array:
    """Find a layout (n, 2) that minimizes an objective, at least a distance from others and from itself relabeled.

    Random variations of the start and of the best ones found, with steps that become smaller; then a polish, if that
    keeps the distances.

    Parameters
    ----------
    rough : Objective
        The same criterion for fewer poses.
    others : list of array (m, 2)
    distance : float
        Smallest `affine_distance` in m, and `PARTLY` times the smallest `partial_distance`.

        If no layout has it, the one that lacks least is returned.
    """
    scale, n = region.boundary.radius, len(start)

    def apart(layouts: Array) -> Array:
        every = [affine_distance(layouts, rival) for rival in others] + [self_distance(layouts)]
        every += [PARTLY * partial_distance(layouts, rival) for rival in others]
        return np.min(every, axis=0)

    steps = rng.choice(np.geomspace(0.02, LARGEST, 12), size=FIRST)[:, None, None] * scale
    mirrored = np.where(rng.random(FIRST)[:, None, None] < 0.5, np.array([-1.0, 1.0]), 1.0)
    pool = np.concatenate([start[None], start * mirrored + steps * rng.normal(size=(FIRST, n, 2))])
    pool = np.concatenate([pool, region.sample(FIRST // 4, n, rng)])
    # The ring at each of the dots.
    pool = np.concatenate([pool, [np.roll(start, places, axis=0) for places in range(1, n)]])
    best, rank = _ranked(pool, region, rough, apart, distance)
    sizes = np.geomspace(LARGEST / 2, SMALLEST, GENERATIONS) * scale
    for size in sizes:
        parents = best[np.arange(CHILDREN) % len(best)]
        # Half of the children move one dot only.
        moved = np.where(rng.random((CHILDREN, 1)) < 0.5, np.eye(n)[rng.integers(n, size=CHILDREN)], 1.0)
        children = parents + size * moved[..., None] * rng.normal(size=parents.shape)
        fresh, fresh_rank = _ranked(children, region, rough, apart, distance)
        both, ranks = np.concatenate([best, fresh]), np.concatenate([rank, fresh_rank])
        order = np.lexsort(ranks.T[::-1])[:PARENTS]
        best, rank = both[order], ranks[order]
    layout = best[0]
    polished, _ = polish(objective, region, layout)
    kept = region.holds(polished[None])[0] and apart(polished[None])[0] >= min(distance, apart(layout[None])[0])
    return polished if kept else layout


def _ranked(
    layouts: Array, region: FeasibleRegion, rough: Objective, apart: Callable[[Array], Array], distance: float
) -> tuple[Array, Array]:
    """Feasible layouts among some, the best `PARENTS`, with their ranks (k, 2): lack of distance, then the value."""
    layouts = region.project(layouts)
    layouts = layouts[region.holds(layouts)]
    lack = np.maximum(distance - apart(layouts), 0.0)
    nearest = np.argsort(lack, kind="stable")[: max(4 * PARENTS, int((lack == 0).sum()))]
    rank = np.stack([lack[nearest], rough(layouts[nearest])], axis=-1)
    order = np.lexsort(rank.T[::-1])[:PARENTS]
    return layouts[nearest[order]], rank[order]
