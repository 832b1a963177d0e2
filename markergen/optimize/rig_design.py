"""Design of a rig: dots and tags of all its plates, for poses of the whole body."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from time import perf_counter
from typing import Any

import numpy as np

from markergen import __version__
from markergen.arrays import Array
from markergen.bounds.confusion.perspective import layout_safety
from markergen.bounds.dot_covariances import body_bounds
from markergen.errors import InputError
from markergen.files import Written
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution, RecordedPoses
from markergen.model.rig import Rig
from markergen.model.rig_shapes import RigShape
from markergen.model.sight import dots_in_view
from markergen.model.spec import Spec
from markergen.objectives.criteria import Criteria, criteria
from markergen.optimize.dot_size import (
    PERCENTILE,
    ROOM,
    DotSize,
    choose_dots,
    largest_that_leaves_room,
    wanted_diameter,
    wanted_pixels,
)
from markergen.optimize.problem import check, check_objective, check_parts
from markergen.optimize.rig_layouts import APART_PX, RigLayouts, Seen, best_views, seen_plates
from markergen.optimize.to_marker import dress, number
from markergen.options import Progress
from markergen.presentation.results import Result, files_as_json, json_bytes, plain
from markergen.presentation.tables import Table
from markergen.read.poses import poses_from
from markergen.units import format_length

log = logging.getLogger(__name__)


CLEARANCE = 0.3
"""Default clearance as a fraction of the dot diameter: beyond an edge of the body, the background begins."""

CROWDED = 0.5
"""Maximum fraction of the diameter that just fits: the dots of several plates must also differ in place."""

ALIKE_PX = 1e-6
"""Displacement of images below which layouts count as the same."""

MOST_STORED = 400
"""Maximum number of poses stored in each marker."""


@dataclass(frozen=True, repr=False)
class RigDesign(Result):
    """A designed rig with its expected errors and warnings; printing it gives the command's output.

    Examples
    --------
    >>> import markergen as mg
    >>> poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"
    >>> found = mg.rig("pair", plate="100mm", n=4, tag="aruco:DICT_4X4_50", poses=poses, restarts=1)
    >>> found
    RigDesign(Rig(2 markers, 8 control points within 112 mm of its origin))
    >>> found.told_apart
    'the plates are told apart by their tags, aruco:DICT_4X4_50:0 to 1'

    Attributes
    ----------
    rig : Rig
    poses : PoseDistribution
        T_camera_rig.
    joint, single : array (2, P)
        Expected error of the joint pose, and of that of the best single plate, in each pose: rotation in degrees, and
        translation of the rig's origin in m; inf where no plate shows four dots.
    in_view : array (2, P)
        Numbers of plates of which dots are seen, and of dots; see `dots_in_view`.
    safety : float
        Smallest RMS displacement in px of a plate's dots with which another plate fits as well; inf with tags.
    seconds : float
    written : tuple of Written
        Files written, if any.
    """

    rig: Rig
    poses: PoseDistribution
    joint: Array
    single: Array
    in_view: Array
    dots: str
    told_apart: str
    safety: float
    warnings: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)
    written: tuple[Written, ...] = field(default=(), compare=False)

    def parts(self) -> list[str | Table]:
        """See `Result.parts`: summary and table of expected errors."""
        return [self.summary, self._table, f"found in {self.seconds:.1f} s"]

    def to_json(self) -> bytes:
        """Return plates, expected errors over the poses that see one, warnings and files as JSON text."""
        stored = self.rig.provenance
        results = {
            "shape": stored["shape"],
            "objective": stored["objective"],
            "plates": [{"name": mounted.name, "dots": len(mounted.marker)} for mounted in self.rig.markers],
            "poses": {"name": self.poses.name, "count": len(self.poses), "blind": self._blind},
            "in_view": {"plates": self.in_view[0].mean(), "dots": self.in_view[1].mean()},
            "noise": stored["noise"],
            "expected": {
                key: {
                    "rotation_deg": {"median": rotation, "rms": rotations},
                    "translation_m": {"median": translation, "rms": translations},
                }
                for key, (rotation, rotations, translation, translations) in zip(
                    ("joint", "single"), self._expected, strict=True
                )
            },
            "label_safety_px": self.safety,
            "warnings": self.warnings,
            "files": files_as_json(self.written),
        }
        return json_bytes(plain(results))

    @property
    def summary(self) -> str:
        """Plates, dots and what the poses see of them, in a few lines."""
        stored = self.rig.provenance
        plates, dots = self.in_view.mean(axis=1)
        blind = f"; {self._blind} see no four dots of a plate" if self._blind else ""
        names = ", ".join(mounted.name for mounted in self.rig.markers)
        joint = "of the joint pose" if stored["joint"] else "of each plate alone"
        return (
            f"{stored['shape']}: {len(self.rig.markers)} plates ({names}) with {len(self.rig)} dots\n"
            f"objective {stored['objective']} {joint}, seed {stored['seed']}, {len(self.poses)} poses "
            f"({self.poses.name})\n"
            f"dots of {self.dots or 'the given markers'}\n"
            f"a pose sees dots of {plates:.3g} plates, {dots:.3g} in all, on average{blind}\n"
            f"{self.told_apart}"
        )

    @property
    def _blind(self) -> int:
        """Number of poses that show no plate well enough to find it."""
        return int(np.isinf(self.joint[0]).sum())

    @property
    def _expected(self) -> Array:
        """Median and RMS of rotation in degrees and of translation in m, of the joint and the best single pose."""
        both = np.stack([self.joint, self.single])[:, :, np.isfinite(self.joint[0])]
        return np.stack([np.median(both, axis=-1), np.sqrt(np.mean(both**2, axis=-1))], axis=-1).reshape(2, 4)

    @property
    def _table(self) -> Table:
        rows = [
            [name, *(f"{value:.3g}" for value in values * [1, 1, 1e3, 1e3])]
            for name, values in zip(("joint pose", "best single plate"), self._expected, strict=True)
        ]
        header = ["", "rotation deg, median", "RMS", "translation mm, median", "RMS"]
        return Table(f"Expected error for {self.rig.provenance['noise']}", header, rows)

    def __str__(self) -> str:
        return "\n".join([*(f"warning: {warning}" for warning in self.warnings), super().__str__()])

    def __repr__(self) -> str:
        return f"RigDesign({self.rig!r})"


def design_rig(
    shape: RigShape,
    spec: Spec,
    tags: Sequence[str] = (),
    given: Mapping[int, Marker] | None = None,
    progress: Progress | None = None,
) -> RigDesign:
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
    poses = poses_from(spec.poses)
    plates = seen_plates(shape.faces, poses, spec)
    specs, dots = _sized(shape, spec, tags, plates, len(poses), given, progress)
    fixed = {k: marker.xyz[:, :2] for k, marker in given.items()}
    layouts = RigLayouts(plates, specs, dots, fixed, len(poses))
    for k in range(len(plates)):
        check_parts(specs[k], layouts.setting(k))
    layouts.find(np.random.default_rng(spec.seed), progress)
    markers = []
    for k, face in enumerate(shape.faces):
        marker = given.get(k) or _dressed(layouts, k)
        markers.append(face.mounted(marker))
    sentence, safety = _told_apart(layouts, tags)
    noise = layouts.setting(0).noise_words
    stored: dict[str, Any] = {
        "shape": shape.text,
        "measures": shape.measures,
        "n": spec.n,
        "objective": spec.objective,
        "joint": layouts.joint,
        "seed": spec.seed,
        "camera": spec.camera.as_dict(),
        "poses": spec.poses if isinstance(spec.poses, str) else spec.poses.as_dict(),
        "versions": {"markergen": __version__, "numpy": np.__version__},
        "noise": noise,
        "told_apart": sentence,
    }
    rig = Rig(tuple(markers), provenance=stored)
    seen = dots_in_view(rig, spec.camera, poses)
    joint, single = body_bounds(rig, seen, spec.camera, poses, spec.image_noise, spec.print_sigma)
    plates_in_view = sum(seen[:, rig.owner == k].any(axis=1).astype(int) for k in range(len(plates)))
    warnings = []
    if safety < APART_PX:
        warnings.append(f"{sentence}; use --tag, fewer dots, more room or smaller --dot")
    result = RigDesign(
        rig,
        poses,
        joint,
        single,
        np.stack([plates_in_view, seen.sum(axis=1)]),
        "; ".join(dict.fromkeys(size.reason for k, size in enumerate(dots) if k not in given)),
        sentence,
        safety,
        tuple(warnings),
        perf_counter() - begin,
    )
    log.info("designed %r in %.1f s", result.rig, result.seconds)
    return result


def _sized(
    shape: RigShape,
    spec: Spec,
    tags: Sequence[str],
    plates: Sequence[Seen],
    count: int,
    markers: Mapping[int, Marker],
    progress: Progress | None,
) -> tuple[list[Spec], list[DotSize]]:
    """Spec and dots of each plate; plates of the same boundary have dots of the same size."""
    best = best_views(plates, count)
    specs = []
    for k, plate in enumerate(plates):
        kept = np.unique(np.linspace(0, len(plate.index) - 1, min(len(plate.index), MOST_STORED)).round().astype(int))
        recorded = RecordedPoses.from_distribution(plate.poses.taken(kept, 0), f"poses of {shape.faces[k].name}")
        tag = {"tag": tags[k], "tag_side": spec.tag_side} if tags else {}
        specs.append(replace(spec, boundary=shape.faces[k].boundary, poses=recorded, **tag))  # type: ignore[arg-type]
    needs: dict[Any, float] = {}
    for plate_spec, plate, views in zip(specs, plates, best, strict=True):
        need = wanted_diameter(spec.camera, plate.poses.taken(views, 0), spec.image_noise)
        needs[plate_spec.boundary] = max(needs.get(plate_spec.boundary, 0.0), need)
    sizes: dict[Any, DotSize] = {}
    for k, plate_spec in enumerate(specs):
        if k not in markers and plate_spec.boundary not in sizes:
            sizes[plate_spec.boundary] = _dots(plate_spec, needs[plate_spec.boundary], plates[k].poses, progress)
    dots = []
    for k, plate_spec in enumerate(specs):
        if k in markers:
            dots.append(DotSize(markers[k].dot_diameter, markers[k].clearance, ""))
        else:
            dots.append(sizes[plate_spec.boundary])
            specs[k] = replace(plate_spec, dot=dots[-1].diameter, clearance=dots[-1].clearance)
    return specs, dots


def _dots(spec: Spec, wanted: float, poses: PoseDistribution, progress: Progress | None) -> DotSize:
    """Dots of a plate: as asked, or large enough where the plate is the one that is seen best."""
    if spec.dot is not None:
        return choose_dots(spec, poses, progress)
    room = float(np.floor(largest_that_leaves_room(spec) * CROWDED / ROOM * 1e4) / 1e4)
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


def _dressed(layouts: RigLayouts, k: int) -> Marker:
    spec, dots, setting = layouts.specs[k], layouts.dots[k], layouts.setting(k)
    ring, others = layouts.layouts[k][:1], layouts.layouts[k][1:]
    points = np.concatenate([ring, number(others)])
    table: dict[str, Criteria] = {"design": criteria(points[None], setting)[0]}
    marker = dress(points, dots, spec, setting, table, layout_safety(points, setting, True))
    check(marker.xyz, spec.boundary, spec.blocked, dots.diameter, dots.clearance)
    return marker


def _told_apart(layouts: RigLayouts, tags: Sequence[str]) -> tuple[str, float]:
    """How the plates are told apart, in words, and the least safety in px."""
    names = [plate.face.name for plate in layouts.plates]
    if tags:
        ids = [tag.rpartition(":")[2] for tag in tags]
        others = ", and by what they were given" if layouts.fixed else ""
        family = tags[0].rpartition(":")[0]
        return f"the plates are told apart by their tags, {family}:{ids[0]} to {ids[-1]}{others}", np.inf
    if len(names) == 1:
        return "there is one plate", np.inf
    safety = {(names[a], names[b]): layouts.safety(a, b) for a, b in permutations(range(len(names)), 2)}
    (first, second), least = min(safety.items(), key=lambda item: item[1])
    if not np.isfinite(least):
        return "the plates are told apart by their numbers of dots", least
    if least < ALIKE_PX:
        return f"nothing tells {first} from {second}: their layouts are the same", least
    return (
        f"the plates are told apart by their layouts while dots move by less than {least:.2g} px RMS; "
        f"then {first} fits as well as {second}",
        least,
    )
