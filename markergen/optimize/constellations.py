"""Constellations that are designed together: block coordinate descent, and dots of several sizes for a pad.

The dots of a body are in *blocks*: scales of a pad, which have one diameter each, or plates of a rig. Each block is
first searched by itself. All are then improved together, in turns: the dots of one block move, while those of the
others that a pose sees add their information. What a pose sees is taken as fixed in a turn, and looked up again after
it.

Dots that are large enough to be seen from afar do not fit in the image from nearby. A *scale* is a constellation of
dots of one diameter in a room of its own: a disk about the origin, without the disk of the next smaller scale. The
largest is the whole marker, and the smallest what every pose sees whole; the radii between are in equal ratio. Each
scale serves the poses that see it whole, up to a little beyond the farthest that do not see the next larger one whole.
"""
# tests: tests/optimize/test_constellations.py tests/api/test_design.py

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise, permutations
from math import ceil, inf, log
from time import perf_counter

import numpy as np

from markergen.arrays import Array, Mask
from markergen.bounds.confusion.affine import likeness
from markergen.bounds.confusion.perspective import LabelSafety, layout_safety
from markergen.bounds.dot_covariances import body_bounds, dot_information
from markergen.defaults import MEASURED_SIGMA
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.information import covariance, moved_information, rotation_bound, translation_bound
from markergen.model.boundary import Boundary, Circle
from markergen.model.camera import Camera
from markergen.model.feature import Feature, key_ring
from markergen.model.goal import parse_goal
from markergen.model.marker import ControlPoint, Marker
from markergen.model.planned_error import KEY, PlannedError
from markergen.model.pose_sources.cone import poses_in_words
from markergen.model.poses import SEEN, PoseDistribution, silhouette, visibility
from markergen.model.rig_shapes import Face
from markergen.model.sight import Coverage, coverage, disks_in_view, distance_table
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.aggregates import aggregate_of
from markergen.objectives.base import Carrier, Sight, TraceObjective
from markergen.objectives.criteria import columns
from markergen.objectives.observation import DotNoise
from markergen.objectives.pose import PoseCovarianceObjective
from markergen.optimize.certificate import Certificate, Room, candidates_of, certify_rooms
from markergen.optimize.design import Account, Design
from markergen.optimize.dot_count import STEP, Forecast, Forecaster, least_sizes, sources_of, usual_sources
from markergen.optimize.dot_size import ALL_BUT, DotSize, clearance_of, error_words
from markergen.optimize.ending import Ended, current_limit
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, breach, check, objective_of, room_of, rough_of
from markergen.optimize.search import search
from markergen.optimize.to_marker import numbered, provenance_of
from markergen.options import Progress
from markergen.presentation.tables import Table
from markergen.presentation.tables import number as written
from markergen.read.poses import poses_from
from markergen.units import format_length

MOST_SCALES = 4
"""Largest number of sizes that is tried."""

DOTS, FEWEST_DOTS = 8, 5
"""Numbers of dots of the largest scale and at least; each further scale has one less or fewer, so that no two are
similar."""

APART = 2.0
"""Least ratio of the diameters of successive scales, by which detection tells them apart."""

OVERLAP = 1.15
"""Distance up to which a scale serves, in that of the farthest pose that does not see the next larger scale whole."""

SAMPLED = 0.9
"""Radius of the smallest scale, in the largest one that all poses see whole: others of the range may be nearer."""

LARGER = 1.2
"""Diameter of dots, in the one that is large enough in all poses that the scale serves."""

NEAR_BEST = 1.5
"""Error at any distance, relative to the least that any number of scales reaches there, for which fewer will do."""

ROUNDS = 2
"""Number of rounds in which all scales are polished together.

Without any, the error of a pad for 0.2 to 5 m is 0.9 % larger, of one for 0.15 to 3 m 0.1 %; one, two and three give
the same there and for 0.3 to 10 m."""

SPARSE = 10
"""One in so many candidate places of a certificate shows whether a pose sees any dot of a room."""

LEAST_SHRINK = 1e-3
"""Smallest radius of a scale, as a fraction of the marker's."""

ALIKE = 0.05
"""Deviation of one scale's layout from an affine image of another's, as a fraction of its size, below which the two
could be taken for each other."""


@dataclass(frozen=True, eq=False)
class Block:
    """Dots of one diameter on one plate, which move together.

    Attributes
    ----------
    spec : Spec
        Their room, number and size.
    poses : PoseDistribution
        T_camera_plate, for which they are searched by themselves.
    points : array (n, 2), m
    face : Face or None
        Place of the plate in the body; None if the body is the plate.
    """

    spec: Spec
    poses: PoseDistribution
    points: Array
    face: Face | None = None

    @property
    def diameter(self) -> float:
        """Diameter of its dots in m."""
        assert isinstance(self.spec.dot, float)
        return self.spec.dot

    @property
    def region(self) -> FeasibleRegion:
        """Where its dots may go."""
        return FeasibleRegion(room_of(self.spec), self.diameter, clearance_of(self.spec, self.diameter), self.spec.gap)

    @property
    def setting(self) -> Setting:
        """Camera, poses and noise of its search by itself."""
        noise = DotNoise(self.diameter, self.spec.image_noise, self.spec.print_sigma)
        return Setting(self.spec.boundary, self.spec.camera, self.poses, noise)


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Layouts of several blocks, for the pose of their body from all dots in view.

    Attributes
    ----------
    spec : Spec
        Objective, camera, noise and print; its boundary is that of blocks without a face.
    poses : PoseDistribution
        T_camera_body.
    see : callable
        What the poses see of blocks, their dots in the order of the blocks.
    outline : array (m, 3) or None
        Points of the body in m whose displacement the objective ``pose`` is; None for the rim of the spec's boundary.
    """

    spec: Spec
    poses: PoseDistribution
    see: Callable[[Sequence[Block]], Coverage]
    outline: Array | None = None

    def setting(self, blocks: Sequence[Block], k: int) -> Setting:
        """Setting of the dots of block k, for poses that see some of them, to which all others in view contribute."""
        covered, block = self.see(blocks), blocks[k]
        moving = np.repeat(np.arange(len(blocks)), [len(other.points) for other in blocks]) == k
        used = np.flatnonzero(covered.served & covered.seen[:, moving].any(axis=1))
        if not len(used):
            of_plate = f" for {block.face.name}" if block.face else ""
            remedy = "give lengths with their unit, such as 80mm, or use other --poses"
            raise InputError("a pose that sees the dots of each plate", f"none of {len(self.poses)}{of_plate}", remedy)
        kept = replace(covered, poses=self.poses.taken(used, 0), seen=covered.seen[used])
        others = self.information(blocks, kept, ~moving)
        views, offset = views_of(block.face, kept.poses)
        sight = Sight(kept.seen[:, moving], moved_information(others, offset))
        boundary = block.face.boundary if block.face else self.spec.boundary
        noise = DotNoise(block.diameter, self.spec.image_noise, self.spec.print_sigma)
        return Setting(boundary, self.spec.camera, views, noise, sight, self._carrier(block.face))

    def _carrier(self, face: Face | None) -> Carrier | None:
        if self.outline is None:
            return None
        rotation, translation = _placement(face)
        return Carrier((self.outline - translation) @ rotation, -translation @ rotation)

    def information(self, blocks: Sequence[Block], covered: Coverage, counted: Mask | None = None) -> Array:
        """Fisher information (P, 6, 6) of the body's pose from all dots in view, or those of a mask (n,)."""
        total, start = np.zeros((len(covered.poses), 6, 6)), 0
        counted = np.ones(len(covered.points), dtype=bool) if counted is None else counted
        for face, plate in groupby(blocks, key=lambda block: block.face):
            points = np.concatenate([block.points for block in plate])
            dots = slice(start, start := start + len(points))
            if not counted[dots].any():
                continue
            views, offset = views_of(face, covered.poses)
            seen = Coverage(points, covered.diameters[dots], views, covered.seen[:, dots])
            information = dot_information(seen, self.spec.camera, self.spec.image_noise, self.spec.print_sigma)
            total += moved_information(information[:, counted[dots]].sum(axis=1), -offset)
        return total

    def errors(self, covered: Coverage, information: Array) -> Array:
        """Objective (P,) of each pose for the information (P, 6, 6) on it; inf for poses not served."""
        setting = Setting(self.spec.boundary, self.spec.camera, covered.poses, carrier=self._carrier(None))
        lead = OBJECTIVES[parse_goal(self.spec.objective).lead](setting)
        assert isinstance(lead, PoseCovarianceObjective)
        errors, served = np.full(len(information), np.inf), covered.served
        pose = covariance(information[served])
        errors[served] = np.sqrt(np.trace(lead.weight[served] @ pose, axis1=-2, axis2=-1))
        return errors

    def value(self, covered: Coverage, errors: Array) -> tuple[int, float]:
        """Number of poses that are not served, and the aggregate of the objective over the others."""
        served = np.flatnonzero(covered.served)
        setting = Setting(self.spec.boundary, self.spec.camera, self.poses.taken(served, 0))
        lead = OBJECTIVES[parse_goal(self.spec.objective).lead](setting, self.spec.aggregate)
        return len(self.poses) - len(served), float(lead.aggregated(errors[served], 0.0)[0])

    def certify(
        self, blocks: Sequence[Block], covered: Coverage, value: float, progress: Progress | None = None
    ) -> Certificate:
        """Lower bound on the `value` of any dots in the rooms of the blocks that serve the same poses, for theirs."""
        goal = parse_goal(self.spec.objective)
        n, served = len(covered.points), np.flatnonzero(covered.served)
        if len(goal.terms) > 1 or self.spec.survive:
            words = "is a weighted sum" if len(goal.terms) > 1 else "counts lost dots"
            return Certificate(n, value, reason=f"the objective {words}")
        poses, start, rooms = self.poses.taken(served, 0), 0, []
        for block in blocks:
            dots = slice(start, start := start + len(block.points))
            views, offset = views_of(block.face, poses)
            places = candidates_of(block.region, SPARSE)
            diameters = np.full(len(places), block.diameter)
            anywhere = disks_in_view(places, diameters, self.spec.camera, views, 0.0)
            seen = np.asarray(np.concatenate([anywhere, covered.seen[served, dots]], axis=1).any(axis=1))
            seeing = views.taken(np.flatnonzero(seen), 0)
            noise = DotNoise(block.diameter, self.spec.image_noise, self.spec.print_sigma)
            objective = OBJECTIVES[goal.lead](Setting(block.spec.boundary, self.spec.camera, seeing, noise))
            assert isinstance(objective, TraceObjective)
            rooms.append(Room(objective, block.region, block.points, seen, offset[seen]))
        setting = Setting(self.spec.boundary, self.spec.camera, poses, carrier=self._carrier(None))
        lead = OBJECTIVES[goal.lead](setting, self.spec.aggregate)
        assert isinstance(lead, TraceObjective)
        return certify_rooms(lead, rooms, value, progress)

    def descend(
        self,
        blocks: Sequence[Block],
        move: Callable[[Sequence[Block], int, int], Array],
        rounds: int,
        stage: str,
        progress: Progress | None = None,
        fixed: Sequence[int] = (),
        only_better: bool = True,
    ) -> tuple[Block, ...]:
        """Improve blocks in turns, and return them.

        Parameters
        ----------
        move : callable
            Gives the layout (n, 2) of a block: from all blocks, its place among them, and the number of the round.
        fixed : sequence of int
            Blocks that stay as they are.
        only_better : bool
            Take back what does not improve the `value` of the whole.
        """

        def whole(blocks: Sequence[Block]) -> tuple[int, float]:
            covered = self.see(blocks)
            return self.value(covered, self.errors(covered, self.information(blocks, covered)))

        blocks, total = tuple(blocks), rounds * len(blocks)
        value = whole(blocks) if only_better else (0, inf)
        for step in range(total):
            if progress:
                progress(stage, step, total)
            around, k = divmod(step, len(blocks))
            if k in fixed:
                continue
            try:
                points = move(blocks, k, around)
            except Ended:
                break
            moved = (*blocks[:k], replace(blocks[k], points=points), *blocks[k + 1 :])
            better = whole(moved) if only_better else value
            if not only_better or better < value:
                blocks, value = moved, better
        if progress:
            progress(stage, 1, 1)
        return blocks


def views_of(face: Face | None, poses: PoseDistribution) -> tuple[PoseDistribution, Array]:
    """Poses T_camera_plate of a plate, and the vectors (P, 3) in m from the body's origin to its own, camera frame."""
    if face is None:
        return poses, np.zeros_like(poses.translation)
    rotation, translation = _placement(face)
    offset = poses.rotation @ translation
    return PoseDistribution(poses.name, poses.rotation @ rotation, offset + poses.translation), offset


def _placement(face: Face | None) -> tuple[Array, Array]:
    """Pose of a plate in its body: rotation (3, 3), and translation (3,) in m."""
    return (np.array(face.rotation), np.array(face.translation)) if face else (np.eye(3), np.zeros(3))


def nested_scales(spec: Spec, poses: PoseDistribution, progress: Progress | None = None) -> tuple[Block, ...]:
    """Find the scales of a spec for all of its poses, the largest first.

    The fewest scales are taken whose predicted error, RMS over the poses of each range of distance, is at most
    `NEAR_BEST` times the least that any number of them reaches there, and which leave no more poses without four dots
    of one size in view.

    Raises
    ------
    InputError
        If the objective is not the error of a pose, or no dots fit that all poses see.
    """
    problem = pad_problem(spec, poses)
    candidates: list[tuple[tuple[Block, ...], Array, float]] = []
    reasons = []
    for count in range(1, MOST_SCALES + 1):
        if progress:
            progress("scales", count - 1, MOST_SCALES)
        try:
            scales = _forecasts(spec, poses, count)
        except InputError as error:
            reasons.append(error)
            continue
        if all(a.diameter >= APART * b.diameter for a, b in pairwise(scales)):
            covered = problem.see(scales)
            candidates.append((scales, _by_distance(problem, scales, covered), float(np.mean(covered.served))))
    if not candidates:
        raise reasons[0]
    if progress:
        progress("scales", MOST_SCALES, MOST_SCALES)
    least, most = np.min([values for _, values, _ in candidates], axis=0), max(share for *_, share in candidates)
    worth = [(np.max(values / least), share) for _, values, share in candidates]
    chosen = next(
        (i for i, (worst, share) in enumerate(worth) if worst <= NEAR_BEST and share >= most - ALL_BUT),
        max(range(len(candidates)), key=lambda i: (worth[i][1], -worth[i][0])),
    )
    rng = np.random.default_rng(spec.seed)
    begun = [_searched(scale, rng, progress) for scale in candidates[chosen][0]]

    def move(blocks: Sequence[Block], k: int, _: int) -> Array:
        objective = objective_of(problem.spec, problem.setting(blocks, k))
        return polish(objective, blocks[k].region, blocks[k].points)[0]

    return problem.descend(begun, move, ROUNDS, "together", progress)


def pad_problem(spec: Spec, poses: PoseDistribution) -> JointProblem:
    """Problem of a pad, with the geometric mean over the poses unless the spec says otherwise: no distance dominates.

    While they are sought, rings and disks alike count from `RELIABLE_PIXELS` on.
    """
    geometric = replace(spec, aggregate=spec.aggregate or "logmean")
    return JointProblem(geometric, poses, lambda scales: seen_by(scales, spec.camera, poses))


def seen_by(scales: Sequence[Block], camera: Camera, poses: PoseDistribution) -> Coverage:
    """What each pose sees of several scales."""
    points = np.concatenate([scale.points for scale in scales])
    diameters = np.concatenate([np.full(len(scale.points), scale.diameter) for scale in scales])
    return Coverage(points, diameters, poses, disks_in_view(points, diameters, camera, poses))


def _sees(boundary: Boundary, camera: Camera, poses: PoseDistribution) -> Mask:
    return visibility(silhouette(boundary), poses.rotation, poses.translation, camera) == SEEN


def _radii(spec: Spec, poses: PoseDistribution, count: int) -> list[float]:
    """Radii in m of the scales within the marker: equal ratios down to what all poses see whole."""
    whole = spec.boundary.radius
    low, high = np.log(LEAST_SHRINK * whole), np.log(min(whole, float(spec.boundary.depth(np.zeros(2)))))
    for _ in range(20):
        middle = (low + high) / 2
        if _sees(Circle(float(np.exp(middle))), spec.camera, poses).all():
            low = middle
        else:
            high = middle
    smallest = float(np.floor(SAMPLED * np.exp(low) * 1e3) / 1e3)
    ratio = (whole / smallest) ** (1 / (count - 1)) if count > 1 else 1.0
    return [float(np.round(whole / ratio**k, 3)) for k in range(1, count)]


def _forecasts(spec: Spec, poses: PoseDistribution, count: int) -> tuple[Block, ...]:
    """Blocks from forecasts of their layouts."""
    rooms: list[Boundary] = [spec.boundary, *map(Circle, _radii(spec, poses, count))]
    scales: list[Block] = []
    serving = np.ones(len(poses), dtype=bool)
    for k, room in enumerate(rooms):
        whole = _sees(room, spec.camera, poses)
        if not (whole & serving).any():
            raise InputError(f"poses that see a {room} whole", "none", "use a smaller marker, or poses farther away")
        band = poses.taken(np.flatnonzero(whole & serving), 0)
        inner = (rooms[k + 1],) if k + 1 < len(rooms) else ()
        scale_spec = replace(spec, boundary=room, keep_outs=(*spec.keep_outs, *inner))
        counts = [n for n in range(DOTS - k, FEWEST_DOTS - 1, -1) if n not in [len(scale.points) for scale in scales]]
        if not counts:
            raise InputError(f"different numbers of dots in {count} sizes", "none left", "use fewer sizes")
        forecast = _forecast(scale_spec, band, counts, scales[-1].diameter / APART if scales else inf)
        scale_spec = replace(scale_spec, n=forecast.n, dot=forecast.diameter, gap=forecast.gap)
        scales.append(Block(scale_spec, band, forecast.points))
        if (~whole).any():
            serving = poses.distance <= OVERLAP * poses.distance[~whole].max()
    return tuple(scales)


def _forecast(spec: Spec, poses: PoseDistribution, counts: Sequence[int], largest: float) -> Forecast:
    """Forecast of one of the numbers of dots, the first for which there is room, of diameters in m up to `largest`."""
    forecaster = Forecaster(spec, poses, sources_of(spec))
    forecaster.most = max(counts)
    least, gap = least_sizes(spec.boundary, spec.camera, poses, spec.image_noise, share=1.0)
    forecaster.gap = max(gap, spec.gap)
    for factor in (LARGER, 1.0):
        forecaster.least = ceil(factor * least * 1e4 - 1e-6) / 1e4
        if forecaster.least > largest:
            continue
        steps = int(1 + log(largest / forecaster.least) / log(STEP)) if largest < inf else None
        try:
            forecasts = forecaster.by_count(most=steps)
        except InputError:
            continue
        for count in counts:
            if count in forecasts:
                return forecasts[count]
    raise InputError(
        f"room for {min(counts)} dots of {format_length(forecaster.least)}", str(forecaster.room), "use a larger marker"
    )


def _by_distance(problem: JointProblem, scales: Sequence[Block], covered: Coverage) -> Array:
    """Root of the mean square of the objective in each range of distance, over the poses that are served there."""
    errors, means = problem.errors(covered, problem.information(scales, covered)), []
    for _, _, mask in covered.bands():
        served = errors[mask][np.isfinite(errors[mask])]
        means.append(np.sqrt(np.mean(served**2)) if len(served) else np.inf)
    return np.array(means)


def _searched(block: Block, rng: np.random.Generator, progress: Progress | None) -> Block:
    """The block with the best layout found for the poses that it serves."""
    spec, setting = block.spec, block.setting
    objective, rough = objective_of(spec, setting), rough_of(spec, setting)
    return replace(block, points=search(objective, block.region, spec.n, rng, spec.restarts, progress, rough).points)


def design_pad(spec: Spec, progress: Progress | None = None) -> Design:
    """Find nested constellations for the poses of a spec, and make them a marker.

    Raises
    ------
    InputError
        If the objective is not the error of a pose, or no dots fit that are seen.
    """
    begin = perf_counter()
    poses = poses_from(spec.poses).placed(spec.camera)
    scales = tuple(
        replace(scale, points=np.round(numbered(scale.points), 10) + 0.0)
        for scale in nested_scales(spec, poses, progress)
    )
    points = np.concatenate([scale.points for scale in scales])
    diameters = np.concatenate([np.full(len(scale.points), scale.diameter) for scale in scales])
    control_points: list[ControlPoint] = []
    for scale in scales:
        for place, (x, y) in enumerate(scale.points.tolist()):
            feature = Feature(scale.diameter) if place else key_ring(scale.diameter)
            control_points.append(ControlPoint(len(control_points), x, y, 0.0, feature))
    clearance = min(scale.region.clearance for scale in scales)
    marker = Marker(tuple(control_points), spec.boundary, clearance, keep_outs=spec.keep_outs, substrate=spec.substrate)
    check(breach(points, spec.boundary, spec.blocked, diameters, clearance))
    for first, second in permutations(scales, 2):
        # One of them could be taken for dots of the other, key ring on key ring.
        if likeness(first.points, second.points) < ALIKE:
            raise RuntimeError(f"constellations of {first.diameter} and {second.diameter} m are alike")
    problem, covered = pad_problem(spec, poses), coverage(marker, spec.camera, poses)
    information = dot_information(covered, spec.camera, spec.image_noise, spec.print_sigma).sum(axis=1)
    pose = np.full((len(poses), 6, 6), np.inf)
    pose[covered.served] = covariance(information[covered.served])
    _, value = problem.value(covered, problem.errors(covered, information))
    served = np.flatnonzero(covered.served)
    setting = Setting(spec.boundary, spec.camera, poses.taken(served, len(poses) - len(served)))
    noise = DotNoise(scales[0].diameter, spec.image_noise, spec.print_sigma)
    noise_text = str(noise).replace(f" of {format_length(scales[0].diameter)} dots", "")
    counts = [f"{len(scale.points)} of {format_length(scale.diameter)}" for scale in scales]
    sizes = ", ".join(counts)
    # Bounds of rotation and translation, RMS over the poses that are served.
    seen = poses.taken(served, 0)
    bounds = {column.key: column.bound for column in columns().values() if column.bound}
    total = aggregate_of("rms", seen.weight)
    row = {key: float(total(bound(pose[served][None], seen), 0.0)[0][0]) for key, bound in bounds.items()}
    settled = replace(spec, n=len(marker), dot=scales[0].diameter)
    marker = replace(marker, provenance=provenance_of(settled, setting, f"{sizes}, for {noise_text}", {"design": row}))
    goal = f"{spec.objective} {problem.spec.aggregate} of {error_words(spec, value)} for {noise_text}"
    labels = [layout_safety(scale.points, scale.setting, True) for scale in scales]
    plan = _planned(marker, covered, spec)
    marker = replace(marker, provenance={**marker.provenance, KEY: plan.as_dict()})
    left = len(poses) - len(served)
    account = Account(
        f"{len(marker)} control points in a {marker.boundary}: dots in {len(scales)} sizes, {sizes}",
        f"{left} {'pose sees' if left == 1 else 'poses see'} four dots of no size" if left else "",
        plan,
        "",
        f"{len(marker)} control points of {len(scales)} sizes in a {marker.boundary}, "
        f"seen from {len(served)} poses ({poses_in_words(poses.name)})\n"
        f"objective {goal}, seed {spec.seed}, spec {marker.spec_hash}\n" + "\n".join(_sentences(scales, labels)),
        _coverage_table(covered, pose),
        (
            *(f"no four dots serve some poses: {gap}" for gap in covered.gaps),
            *(safety.sentence for safety in labels if not safety.is_decided),
        ),
        partial(problem.certify, scales, covered),
    )
    return Design(
        marker,
        setting,
        DotSize(scales[0].diameter, clearance, noise_text),
        {"design": row},
        spec,
        value=value,
        seconds=(seconds := perf_counter() - begin),
        interrupted=seconds * current_limit().ended,
        covered=covered,
        account=account,
    )


def _sentences(scales: Sequence[Block], labels: Sequence[LabelSafety]) -> Iterator[str]:
    """Size, room and range of each scale, and its label safety, seen alone from the poses that it serves."""
    first = 0
    for scale, safety in zip(scales, labels, strict=True):
        distance, count = scale.poses.distance, len(scale.points)
        safety = replace(safety, ids=tuple(range(first, first + count)))
        yield (
            f"{count} dots of {format_length(scale.diameter)} in a {scale.spec.boundary}, the whole in view from "
            f"{distance.min():.3g} to {distance.max():.3g} m; dot {first} is their key ring; {safety.sentence}"
        )
        first += count


def _coverage_table(covered: Coverage, pose: Array) -> Table:
    """Ranges of distance with the poses that are served, the dots in view, and errors for covariances (P, 6, 6)."""
    errors = np.rad2deg(rotation_bound(pose)), 100 * translation_bound(pose, covered.poses.translation)
    cells = []
    for _, _, mask in covered.bands():
        served = mask & covered.served
        cells.append([written(np.sqrt(np.mean(e[served] ** 2)) if served.any() else None, 3) for e in errors])
    sizes = [float(covered.diameters[scale[0]]) for scale in covered.scales]
    return distance_table(covered.rows(), sizes, ("least deg", "least %"), cells)


def _planned(marker: Marker, covered: Coverage, spec: Spec) -> PlannedError:
    """Error to plan with over the poses that are served, of the image noise and the print alone."""
    sources, poses = usual_sources(spec), covered.poses

    def rms(print_sigma: float) -> Array:
        joint, _ = body_bounds(marker, covered.seen, spec.camera, poses, spec.image_noise, print_sigma)
        return np.sqrt(np.mean(joint[:, covered.served] ** 2, axis=1))

    rotation, translation = rms(sources.print_sigma)
    measured = float(rms(MEASURED_SIGMA)[0]) if sources.print_sigma > MEASURED_SIGMA else None
    farthest = float(poses.distance[covered.served].max())
    return PlannedError(float(rotation), 1e3 * float(translation), farthest, measured, ErrorSources().exact)
