"""Design of a rig: dots and tags of all its plates, for the joint pose from poses of the whole body.

In each pose T_camera_rig some plates are seen, and the information of their dots on the joint pose adds up: the dots
of a plate are a block of `constellations.JointProblem`. Plates without tags are kept a smallest affine distance apart,
each from all others, so that no view confuses them (`bounds.confusion`).
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations
from time import perf_counter
from typing import Any

import numpy as np

from markergen import __version__
from markergen.arrays import Array, Indices
from markergen.bounds.confusion.affine import ForeignSafety, foreign_safety
from markergen.bounds.confusion.evidence import ENOUGH, RARELY, odds
from markergen.bounds.confusion.perspective import layout_safety
from markergen.bounds.dot_covariances import body_bounds
from markergen.defaults import NOISE_PX
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.boundary import Boundary, Circle
from markergen.model.goal import parse_goal
from markergen.model.marker import Marker, build_marker
from markergen.model.planned_error import PlannedError
from markergen.model.pose_sources.cone import poses_in_words
from markergen.model.poses import SEEN, PoseDistribution, silhouette, visibility
from markergen.model.recorded_poses import RecordedPoses
from markergen.model.rig import Rig
from markergen.model.rig_shapes import Face, RigShape
from markergen.model.sight import Coverage, coverage, disks_in_view
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.base import Sight
from markergen.objectives.criteria import Criteria, criteria
from markergen.optimize.certificate import Certificate
from markergen.optimize.comparisons import reference
from markergen.optimize.constellations import Block, JointProblem, views_of
from markergen.optimize.design import Account, Design
from markergen.optimize.dot_size import (
    PERCENTILE,
    PIXELS,
    ROOM,
    DotSize,
    choose_dots,
    largest_that_leaves_room,
    wanted_diameter,
    wanted_pixels,
)
from markergen.optimize.ending import current_limit
from markergen.optimize.keyless import LARGEST, distinct_layout
from markergen.optimize.polish import polish
from markergen.optimize.problem import FEW_POSES, breach, check, check_objective, check_parts, objective_of
from markergen.optimize.search import search
from markergen.optimize.to_marker import dress, numbered
from markergen.options import Progress
from markergen.presentation.tables import Table
from markergen.read.poses import poses_from
from markergen.units import format_length, two_digits

log = logging.getLogger(__name__)

CLEARANCE = 0.3
"""Default clearance as a fraction of the dot diameter: beyond an edge of the body, the background begins."""

CROWDED = 0.5
"""Maximum fraction of the diameter that just fits: the dots of several plates must also differ in place."""

ALIKE_PX = 1e-6
"""Displacement of images below which layouts count as the same."""

MOST_STORED = 400
"""Maximum number of poses stored in each marker."""

EDGE = 8
"""Number of places at the edge of a plate that show whether a pose shows dots anywhere on it.

With 4, one pose in 14 of a cube's faces counts that 8, 16 and 64 leave out. On a wall of six squares, 64 leave out up
to three more of 90, and take eight times as long."""

STEEPEST = 0.5
"""Cosine of the tilt of the face of a cube that is seen best, from nearby; from far away it is 0.58."""

SWEEPS = 2
"""Rounds over all plates.

Of a wall of six plates with tags, none leaves 9 % more rotation error, one 0.9 %, and three take away 0.02 %."""

REFINING = 0.05
"""Largest step of the first attempt after the first round, in radii of a plate: a layout is distinct by then."""

APART_PX = 2.4
"""Distance D in px between plates of 4 to 8 dots at which the detector decides (see `markergen.bounds.confusion`)."""

HUGE = 5.0
"""Width of a plate in m from which on its unit is doubted: poses by default follow the size, and show nothing odd."""

RELATION = "the relation of the plates is taken as exact, too; markergen calibrate measures it"

ATTEMPTS, FARTHER = 4, 1.5
"""Number of layouts tried for a plate that is not safe enough, and factor of the affine distance from one to the next:
from close up, perspective makes up for differences that no affine map does."""


@dataclass(frozen=True, eq=False)
class PlateViews:
    """A plate as poses of a rig see it.

    Attributes
    ----------
    index : array (p,) of int
        Poses that see it whole.
    poses : PoseDistribution
        T_camera_marker of these.
    """

    face: Face
    index: Indices
    poses: PoseDistribution


def plate_views(
    faces: Sequence[Face], diameters: Sequence[float], poses: PoseDistribution, spec: Spec
) -> list[PlateViews]:
    """Return each plate as the poses see it that show dots of a diameter in m anywhere on it, or else the whole plate.

    Raises
    ------
    InputError
        If there is a plate that no pose sees.
    """
    plates = []
    for face, diameter in zip(faces, diameters, strict=True):
        views, _ = views_of(face, poses)
        outline = silhouette(face.boundary)
        index = np.flatnonzero(visibility(outline, views.rotation, views.translation, spec.camera) == SEEN)
        dots = face.boundary.project(face.boundary.rim(EDGE), diameter / 2)
        shown = disks_in_view(dots, np.full(len(dots), diameter), spec.camera, views.taken(index, 0)).all(axis=1)
        index = index[shown] if shown.any() else index
        if not len(index):
            raise InputError(
                "a pose that sees each plate, whole and from its front",
                f"none of {len(poses)} ({poses.name}) for {face.name}",
                "use other --poses, farther away or from all around, or leave the plate out",
            )
        plates.append(PlateViews(face, index, views.taken(index, len(poses) - len(index))))
    return plates


def best_views(plates: Sequence["PlateViews"], count: int) -> list[Indices]:
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


class RigSearch:
    """Search for the layouts of all plates, improved one by one.

    Parameters
    ----------
    blocks : sequence of Block
        Dots of each plate; their specs are equal in everything but boundary, poses, dots and tag.
    spec : Spec
    poses : PoseDistribution
        T_camera_rig.
    given : mapping of int to Marker
        Markers of plates that are not designed.
    """

    def __init__(
        self, blocks: Sequence[Block], spec: Spec, poses: PoseDistribution, given: Mapping[int, Marker]
    ) -> None:
        self.blocks, self.given = tuple(blocks), given
        self.is_joint = not any(OBJECTIVES[name].planar_only for name in parse_goal(spec.objective).names)
        self.is_tagged = bool(blocks[0].spec.tag)
        self._safeties: dict[tuple[Face | None, bytes, bytes], ForeignSafety] = {}
        faces = [face for block in blocks if (face := block.face)]
        outline = [
            silhouette(face.boundary) @ np.array(face.rotation).T[:2] + np.array(face.translation) for face in faces
        ]
        self.problem = JointProblem(spec, poses, lru_cache(maxsize=2)(self.see), np.concatenate(outline))

    def see(self, blocks: Sequence[Block]) -> Coverage:
        """What the poses see of the rig with these dots."""
        return coverage(self.rig(blocks), self.problem.spec.camera, self.problem.poses)

    def rig(self, blocks: Sequence[Block]) -> Rig:
        """Rig with these dots, without tags."""
        plates = []
        for k, block in enumerate(blocks):
            assert block.face
            region = block.region
            plain = build_marker(block.points, block.face.boundary, region.diameter, region.clearance)
            plates.append(block.face.mounted(self.given.get(k, plain)))
        return Rig(tuple(plates))

    def find(self, rng: np.random.Generator, progress: Progress | None = None) -> None:
        """Find the layouts, first of each plate alone, then together."""
        by_shape: dict[object, Array] = {}
        for k, block in enumerate(self.blocks):
            key = (block.spec.boundary, block.diameter)
            if k not in self.given and key not in by_shape:
                spec, region, setting = block.spec, block.region, block.setting
                ngon = reference(spec, region, setting)
                objective, rough = objective_of(spec, setting, ngon), objective_of(spec, _few(setting), ngon)
                by_shape[key] = search(objective, region, spec.n, rng, spec.restarts, progress, rough).points
        self.blocks = tuple(
            block if k in self.given else replace(block, points=by_shape[block.spec.boundary, block.diameter])
            for k, block in enumerate(self.blocks)
        )

        def move(blocks: Sequence[Block], k: int, sweep: int) -> Array:
            block = blocks[k]
            setting = self.problem.setting(blocks, k) if self.is_joint else block.setting
            if not len(setting.poses):
                return block.points
            ngon = reference(block.spec, block.region, block.setting)
            objective = objective_of(block.spec, setting, ngon)
            if self.is_tagged:
                return polish(objective, block.region, block.points)[0]
            # Before their first turn, plates still have the layout of their shape.
            others = [j for j in range(len(blocks)) if j < k or (j > k and (sweep or j in self.given))]
            rough = objective_of(block.spec, _few(setting), ngon)
            distance = APART_PX / np.sqrt(len(block.points)) / PIXELS * block.diameter
            best, most = block.points, -1.0
            for attempt in range(ATTEMPTS):
                apart = [blocks[j].points for j in others]
                farther = distance * FARTHER**attempt
                largest = REFINING if sweep and not attempt else LARGEST
                layout = distinct_layout(objective, rough, block.region, block.points, apart, farther, rng, largest)
                moved = replace(block, points=layout)
                pairs = [pair for j in others for pair in ((moved, blocks[j]), (blocks[j], moved))]
                least = min((self._safety(*pair) for pair in pairs), default=ForeignSafety())
                if least.px > most:
                    best, most = layout, least.px
                if least.undecided <= RARELY:
                    break
            return best

        # A layout that differs from the others may well be worse.
        only_better = self.is_joint and self.is_tagged
        self.blocks = self.problem.descend(self.blocks, move, SWEEPS, "plates", progress, [*self.given], only_better)

    @property
    def value(self) -> float:
        """Value of the objective of the joint pose."""
        covered = self.see(self.blocks)
        return self.problem.value(
            covered, self.problem.errors(covered, self.problem.information(self.blocks, covered))
        )[1]

    def certify(self, value: float, progress: Progress | None = None) -> Certificate:
        """Lower bound on the joint pose's error, here `value`, whether or not layouts have to tell plates apart."""
        dots = sum(len(block.points) for block in self.blocks)
        if self.given or not self.is_joint:
            reason = "some markers were given" if self.given else "the objective is that of each plate alone"
            return Certificate(dots, np.nan, reason=reason)
        return self.problem.certify(self.blocks, self.see(self.blocks), value, progress)

    def safety(self, k: int, j: int) -> ForeignSafety:
        """Safety against taking plate k for plate j."""
        return self._safety(self.blocks[k], self.blocks[j])

    def _safety(self, block: Block, other: Block) -> ForeignSafety:
        key = block.face, block.points.tobytes(), other.points.tobytes()
        if key not in self._safeties:
            self._safeties[key] = foreign_safety(block.points, other.points, block.setting)
        return self._safeties[key]


def _few(setting: Setting) -> Setting:
    """The setting for about `FEW_POSES` of its poses."""
    count = len(setting.poses)
    few = np.unique(np.linspace(0, count - 1, min(count, FEW_POSES)).round().astype(int))
    sight = setting.sight and Sight(setting.sight.seen[few], setting.sight.known[few])
    return replace(setting, poses=setting.poses.taken(few, 0), sight=sight)


def design_rig(
    shape: RigShape,
    spec: Spec,
    tags: Sequence[str] = (),
    given: Mapping[int, Marker] | None = None,
    progress: Progress | None = None,
) -> Design:
    """Find the layouts of a rig's plates, for the joint pose from the poses of a spec, and make it a rig.

    Equal arguments give equal rigs.

    Parameters
    ----------
    spec : Spec
        Of all plates: number of dots, camera, poses T_camera_rig and so on; its boundary and tag are ignored.
    tags : sequence of str
        Tags of the plates; without them, their layouts tell them apart.
    given : mapping of int to Marker
        Markers of plates that are not designed.
    progress : callable, optional

    Raises
    ------
    InputError
        If no pose sees a plate, the dots do not fit, or a name in the spec is unknown.
    """
    begin = perf_counter()
    given = given or {}
    check_objective(spec, True)
    poses = poses_from(spec.poses).placed(spec.camera)
    blocks, sizes = _sized(shape, spec, tags, poses, given, progress)
    for block in blocks:
        check_parts(block.spec, block.setting)
    layouts = RigSearch(blocks, spec, poses, given)
    layouts.find(np.random.default_rng(spec.seed), progress)
    sentence, safety = _distinguished(layouts, tags)
    stored: dict[str, Any] = {
        "shape": shape.text,
        "measures": shape.measures,
        "n": spec.n,
        "objective": spec.objective,
        "joint": layouts.is_joint,
        "seed": spec.seed,
        "camera": spec.camera.as_dict(),
        "poses": spec.poses if isinstance(spec.poses, str) else spec.poses.as_dict(),
        "versions": {"markergen": __version__, "numpy": np.__version__},
        "noise": layouts.blocks[0].setting.noise_words,
        "told_apart": sentence,
    }
    markers = [given.get(k) or _dressed(block, sizes[k]) for k, block in enumerate(layouts.blocks)]
    plates = [face.mounted(marker) for face, marker in zip(shape.faces, markers, strict=True)]
    rig = Rig(tuple(plates), provenance=stored)
    covered = coverage(rig, spec.camera, poses)
    joint, single = body_bounds(rig, covered.seen, spec.camera, poses, spec.image_noise, spec.print_sigma)
    reason = "; ".join(dict.fromkeys(size.reason for k, size in enumerate(sizes) if k not in given))
    result = Design(
        rig,
        Setting(Circle(rig.radius), spec.camera, poses),
        replace(sizes[0], reason=reason),
        {},
        spec,
        seconds=(seconds := perf_counter() - begin),
        interrupted=seconds * current_limit().ended,
        covered=covered,
        joint=joint,
        single=single,
        told_apart=sentence,
        safety=safety.px,
        value=layouts.value if layouts.is_joint else 0.0,
        account=_account(rig, covered, joint, single, reason, safety, layouts.certify),
    )
    log.info("designed %r in %.1f s", rig, result.seconds)
    return result


def _account(
    rig: Rig,
    covered: Coverage,
    joint: Array,
    single: Array,
    dots: str,
    safety: ForeignSafety,
    certify: Callable[[float, Progress | None], Certificate],
) -> Account:
    """Plates, dots, what the poses see of them, and expected errors over the poses that see a plate."""
    stored, poses = rig.provenance, covered.poses
    both = np.stack([joint, single])[:, :, np.isfinite(joint[0])]
    # Median and RMS of the rotation in degrees, then of the translation in m.
    expected = np.stack([np.median(both, axis=-1), np.sqrt(np.mean(both**2, axis=-1))], axis=-1).reshape(2, 4)
    blind = int(np.isinf(joint[0]).sum())
    unserved = (
        f"{blind} {'pose shows' if blind == 1 else 'poses show'} no plate well enough to find it" if blind else ""
    )
    rotation, translation = float(expected[0, 1]), 1e3 * float(expected[0, 3])
    farthest = float(poses.distance[np.isfinite(joint[0])].max(initial=0.0))
    # Of the image noise and the print alone, as in the table.
    plan = PlannedError(rotation, translation, farthest, exact=ErrorSources().exact)
    in_view, dots_in_view = covered.plates.mean(), covered.count.mean()
    kind = "of the joint pose" if stored["joint"] else "of each plate alone"
    names = ", ".join(plate.name for plate in rig.plates)
    title = f"{stored['shape']}: {len(rig.plates)} plates ({names}) with {len(rig)} dots"
    sizes = sorted({plate.marker.dot_diameter for plate in rig.plates}, reverse=True)
    summary = (
        f"{title}\n"
        f"objective {stored['objective']} {kind}, seed {stored['seed']}, "
        f"{len(poses)} poses ({poses_in_words(poses.name)})\n"
        f"dots of {dots or 'the given markers'}\n"
        f"a pose sees dots of {in_view:.3g} plates, {dots_in_view:.3g} in all, on average"
        f"{f'; {unserved}' if unserved else ''}\n"
        f"{stored['told_apart']}"
    )
    rows = [
        [name, *(f"{value:.3g}" for value in values * [1, 1, 1e3, 1e3])]
        for name, values in zip(("joint pose", "best single plate"), expected, strict=True)
    ]
    header = ["", "rotation deg, median", "RMS", "translation mm, median", "RMS"]
    apart = f"{stored['told_apart']}; use --tag, fewer dots, more room or smaller --dot"
    widest = 2 * max(plate.marker.boundary.radius for plate in rig.plates)
    huge = f"a plate is {two_digits(widest)} m across: is the unit another? Write lengths as 80mm"
    results = {
        "shape": stored["shape"],
        "objective": stored["objective"],
        "plates": [{"name": plate.name, "dots": len(plate.marker)} for plate in rig.plates],
        "poses": {"name": poses.name, "count": len(poses), "blind": blind},
        "in_view": {"plates": in_view, "dots": dots_in_view},
        "noise": stored["noise"],
        "expected": {
            key: {"rotation_deg": dict(zip(("median", "rms"), values[:2], strict=True)),
                  "translation_m": dict(zip(("median", "rms"), values[2:], strict=True))}
            for key, values in zip(("joint", "single"), expected, strict=True)
        },
        "label_safety_px": safety.px,
    }  # fmt: skip
    table = Table(f"Expected error for {stored['noise']}", header, rows)
    warnings = (*((huge,) if widest > HUGE else ()), *((apart,) if safety.undecided > RARELY else ()))
    title += f" of {' and '.join(map(format_length, sizes))}"
    return Account(title, unserved, plan, RELATION, summary, table, warnings, certify, results)


def _sized(
    shape: RigShape,
    spec: Spec,
    tags: Sequence[str],
    poses: PoseDistribution,
    given: Mapping[int, Marker],
    progress: Progress | None,
) -> tuple[list[Block], list[DotSize]]:
    """Dots of each plate, not yet placed; those of plates of the same boundary have the same size."""
    specs = [
        replace(spec, boundary=face.boundary, tag=tags[k] if tags else spec.tag) for k, face in enumerate(shape.faces)
    ]
    rooms: dict[Boundary, float] = {}
    for k, plate_spec in enumerate(specs):
        if k not in given and plate_spec.boundary not in rooms:
            # A whole tenth of a mm.
            room = np.floor(largest_that_leaves_room(plate_spec) * CROWDED / ROOM * 1e4) / 1e4
            rooms[plate_spec.boundary] = spec.dot if isinstance(spec.dot, float) else float(room)
    diameters = [given[k].dot_diameter if k in given else rooms[face.boundary] for k, face in enumerate(shape.faces)]
    plates = plate_views(shape.faces, diameters, poses, spec)
    needs: dict[Boundary, float] = {}
    for plate, views in zip(plates, best_views(plates, len(poses)), strict=True):
        need = wanted_diameter(spec.camera, plate.poses.taken(views, 0), spec.image_noise)
        needs[plate.face.boundary] = max(needs.get(plate.face.boundary, 0.0), need)
    by_shape: dict[Boundary, DotSize] = {}
    for plate_spec, plate in zip(specs, plates, strict=True):
        boundary = plate_spec.boundary
        if boundary in rooms and boundary not in by_shape:
            by_shape[boundary] = _dots(plate_spec, needs[boundary], rooms[boundary], plate.poses, progress)
    sizes = [
        DotSize(given[k].dot_diameter, given[k].clearance, "") if k in given else by_shape[face.boundary]
        for k, face in enumerate(shape.faces)
    ]
    blocks = []
    plates = plate_views(shape.faces, [size.diameter for size in sizes], poses, spec)
    for k, (plate, size) in enumerate(zip(plates, sizes, strict=True)):
        stored = np.unique(np.linspace(0, len(plate.index) - 1, min(len(plate.index), MOST_STORED)).round().astype(int))
        recorded = RecordedPoses.from_distribution(plate.poses.taken(stored, 0), f"poses of {plate.face.name}")
        plate_spec = replace(specs[k], poses=recorded, dot=size.diameter, clearance=size.clearance)
        points = given[k].xyz[:, :2] if k in given else np.zeros((0, 2))
        blocks.append(Block(plate_spec, plate.poses, points, plate.face))
    return blocks, sizes


def _dots(spec: Spec, wanted: float, room: float, poses: PoseDistribution, progress: Progress | None) -> DotSize:
    """Dots of a plate: as asked, or large enough where the plate is the one that is seen best."""
    if spec.dot is not None:
        return choose_dots(spec, poses, progress)
    diameter = min(wanted, room)
    if not diameter:
        raise InputError("room for dots of 0.1 mm and more", f"{spec.n} dots in a {spec.boundary}", "use fewer")
    best = f"in {PERCENTILE:g} % of the poses in which a plate is the one seen best"
    pixels = f"{wanted_pixels(spec.image_noise):g} px across {best}"
    reason = f"{format_length(diameter)}: {pixels}"
    if wanted > room:
        reason = (
            f"{format_length(diameter)}, {100 * CROWDED:g} % of the largest at which {spec.n} dots fit; "
            f"{pixels} would need {format_length(wanted)}"
        )
    clearance = CLEARANCE * diameter if spec.clearance is None else spec.clearance
    return DotSize(diameter, clearance, reason)


def _dressed(block: Block, dots: DotSize) -> Marker:
    spec, setting = block.spec, block.setting
    points = np.concatenate([block.points[:1], numbered(block.points[1:])])
    table: dict[str, Criteria] = {"design": criteria(points[None], setting)[0]}
    marker = dress(points, dots, spec, setting, table, layout_safety(points, setting, True))
    check(breach(marker.xyz, spec.boundary, spec.blocked, dots.diameter, dots.clearance))
    return marker


def _distinguished(layouts: RigSearch, tags: Sequence[str]) -> tuple[str, ForeignSafety]:
    """How the plates are distinguished, in words, and the least safety."""
    names = [block.face.name for block in layouts.blocks if block.face]
    if tags:
        ids = [tag.rpartition(":")[2] for tag in tags]
        others = ", and by what they were given" if layouts.given else ""
        family = tags[0].rpartition(":")[0]
        return f"the plates are distinguished by their tags, {family}:{ids[0]} to {ids[-1]}{others}", ForeignSafety()
    if len(names) == 1:
        return "there is one plate", ForeignSafety()
    safety = {(names[a], names[b]): layouts.safety(a, b) for a, b in permutations(range(len(names)), 2)}
    (first, second), least = min(safety.items(), key=lambda item: item[1])
    if not np.isfinite(least.px):
        return "the plates are distinguished by their numbers of dots", least
    if least.px < ALIKE_PX:
        return f"nothing distinguishes {first} from {second}: their layouts are the same", least
    likely = f"with errors of {NOISE_PX:g} px {first} is {odds(least.margin)} {second}"
    if least.undecided > RARELY:
        share = two_digits(100 * least.undecided)
        return (
            f"layouts may not tell the plates apart, in {share} % of views from the worst pose: {likely}; {ENOUGH}",
            least,
        )
    return (
        f"the plates are distinguished by their layouts: {likely}, and {ENOUGH}; "
        f"{first} fits best while dots move by less than {two_digits(least.px)} px RMS",
        least,
    )
