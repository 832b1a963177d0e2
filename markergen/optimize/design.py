"""Design of a marker from a spec, and the result of designing a marker, a pad or a rig."""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.arrays import Array, Indices
from markergen.bounds.confusion.perspective import LabelSafety, layout_safety
from markergen.bounds.crowding import crowded, crowding, separating_gap
from markergen.bounds.dot_covariances import DotReliability, reliability, reliability_json, reliability_table
from markergen.errors import InputError
from markergen.files import Written
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import DOT_PIXELS
from markergen.model.goal import NGON, parse_goal
from markergen.model.marker import Marker
from markergen.model.occlusion import eyes_of
from markergen.model.openings import check_holes, near_holes
from markergen.model.planned_error import KEY, PlannedError, planned_error_of
from markergen.model.pose_sources.cone import poses_in_words
from markergen.model.poses import PoseDistribution, left_out
from markergen.model.rig import Rig
from markergen.model.sight import Coverage, coverage
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.criteria import Criteria, columns
from markergen.objectives.observation import DotNoise
from markergen.objectives.survive import hidden_dot_errors
from markergen.optimize.certificate import Certificate, certify
from markergen.optimize.comparisons import LAYOUTS, UNDETERMINED, cell, compare, criteria_table, hidden_table, reference
from markergen.optimize.dot_count import RIM, outlook, planned_error, usual_sources
from markergen.optimize.dot_size import (
    MEASURABLE,
    DotSize,
    choose_dots,
    needs_scales,
    pixels_across,
    size_given,
)
from markergen.optimize.ending import Ended, current_limit, limited
from markergen.optimize.keyless import AsymmetricOptimum, asymmetric_search
from markergen.optimize.polish import ALL_PAIRS_UP_TO, polish
from markergen.optimize.problem import (
    TOLERANCE,
    FeasibleRegion,
    breach,
    check,
    check_bounds,
    check_objective,
    check_parts,
    check_values,
    faults,
    objective_of,
    rough_of,
)
from markergen.optimize.relief import ReliefRoom, relief_breach, search_relief
from markergen.optimize.search import Optimum, search
from markergen.optimize.target import settled
from markergen.optimize.to_marker import dress, numbered
from markergen.optimize.trace import Recorder, Step, Watcher, trace_of
from markergen.options import Progress, Watch
from markergen.presentation.results import Result, files_as_json, json_bytes, plain
from markergen.presentation.tables import Table, data_frame
from markergen.read.poses import poses_from
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

log = logging.getLogger(__name__)


UPRIGHT = 1e-5
"""Relative loss of the objective allowed for turning the layout upright, far below anything measurable."""

WORSE = 0.1
"""Relative excess of another criterion over that of a comparison layout that is worth a warning."""


CLEARANCE, ASKED, IMAGES = "clearance", "asked", "images"
"""Why dots keep their gap: it is their clearance, it was asked for, or images of dots run together in a smaller one."""


@dataclass(frozen=True)
class Gap:
    """Smallest gap between dots with which a layout was sought.

    Attributes
    ----------
    length : float
        In m.
    reason : str
        `CLEARANCE`, `ASKED` or `IMAGES`.
    without : float
        Value of a layout that keeps only the clearance; inf if none was sought.
    """

    length: float = 0.0
    reason: str = CLEARANCE
    without: float = np.inf


@dataclass(frozen=True, repr=False)
class Account:
    """What there is to say of a body of several constellations, of which few figures of a single one hold.

    Attributes
    ----------
    title : str
        What it is, in a line.
    unserved : str
        How many poses see too little of it, in words; empty if none.
    plan : PlannedError
    assumed : str
        What else the plan takes as exact, in a line; may be empty.
    summary : str
    table : Table
        Expected errors.
    warnings : tuple of str
    certify : callable
        Computes the lower bound for the value of the objective.
    results : mapping
        Values of the JSON text in place of those of a marker; empty for a marker.
    """

    title: str
    unserved: str
    plan: PlannedError
    assumed: str
    summary: str
    table: Table
    warnings: tuple[str, ...]
    certify: Callable[[float, Progress | None], Certificate]
    results: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Design(Result):
    """A designed marker or rig with expected errors and warnings; printing it gives the command's output.

    Attributes
    ----------
    body : Marker or Rig
        Also as ``marker`` or ``rig``.
    setting : Setting
        Camera, and the poses that count: those that see the marker, or for dots of several sizes four of one; of a rig
        all.
    dots : DotSize
    criteria : dict
        Criteria of the design (``design``) and of the layouts it is compared with (``ngon``, ``square``, ``random``,
        and for a relief the best flat layout, ``flat``), for the noise given by ``setting.noise_words``; empty for a
        rig.
    spec : Spec
    labels : LabelSafety or None
        Label safety of the dots; None for bare points, unless the layout alone has to identify them.
    value : float
        Value of the spec's objective, in its unit.
    gap : Gap
        Smallest gap between dots that the search had to keep.
    seconds : float
        Duration of the design.
    trace : tuple of Step
        Steps from the best start to the layout, if requested.
    family : tuple of Marker
        Markers of the same layout that differ by their tags, if ids were given.
    written : tuple of Written
        Files written, if any.
    covered : Coverage or None
        What each pose sees of a rig, or of dots of several sizes.
    joint, single : array (2, P) or None
        Expected error of a rig's joint pose, and of that of the best single plate, in each pose: rotation in degrees,
        and translation of the rig's origin in m; inf where no plate shows four dots.
    told_apart : str
        How the plates of a rig are distinguished, in words.
    safety : float
        Smallest RMS displacement in px of a plate's dots with which another plate fits as well; inf with tags.
    interrupted : float
        Seconds after which the search was interrupted; 0 if it was not. Such designs are not reproducible.
    account : Account or None
        What there is to say of a rig, or of dots of several sizes.

    Examples
    --------
    >>> import markergen as mg
    >>> design = mg.design(n=4, radius="100mm", dot="20mm", restarts=2)
    >>> print(design.summary.splitlines()[0])
    4 control points in a disk of radius 100 mm, seen from 400 poses (paper)
    >>> design.criteria["design"]["pose_m"] <= design.criteria["ngon"]["pose_m"] * 1.001
    True

    >>> poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"
    >>> design = mg.rig("pair", plate="100mm", n=4, tag="aruco:DICT_4X4_50", poses=poses, restarts=1)
    >>> design.rig
    Rig(2 markers, 8 control points within 116 mm of its origin)
    >>> design.told_apart
    'the plates are distinguished by their tags, aruco:DICT_4X4_50:0 to 1'
    """

    body: Marker | Rig
    setting: Setting
    dots: DotSize
    criteria: dict[str, Criteria]
    spec: Spec = field(compare=False)
    labels: LabelSafety | None = field(default=None, compare=False)
    value: float = field(default=0.0, compare=False)
    gap: Gap = field(default=Gap(), compare=False)
    seconds: float = field(default=0.0, compare=False)
    trace: tuple[Step, ...] = ()
    family: tuple[Marker, ...] = ()
    written: tuple[Written, ...] = field(default=(), compare=False)
    covered: Coverage | None = field(default=None, compare=False)
    joint: Array | None = field(default=None, compare=False)
    single: Array | None = field(default=None, compare=False)
    told_apart: str = ""
    safety: float = np.inf
    interrupted: float = field(default=0.0, compare=False)
    account: Account | None = field(default=None, compare=False)
    _certificates: list[Certificate] = field(default_factory=list, compare=False)
    """The certificate, and that without the gap, once they are known; shared by copies."""

    @property
    def marker(self) -> Marker:
        """The marker; raises AttributeError for a rig, whose plates have one each."""
        if isinstance(self.body, Marker):
            return self.body
        raise AttributeError("this design is a rig: see its attribute rig, and the markers of rig.plates")

    @property
    def rig(self) -> Rig:
        """The rig; raises AttributeError for a marker."""
        if isinstance(self.body, Rig):
            return self.body
        raise AttributeError("this design is no rig: see its attribute marker")

    @property
    def poses(self) -> PoseDistribution:
        """Poses that count, T_camera_marker or T_camera_rig."""
        return self.setting.poses

    @property
    def in_view(self) -> Indices:
        """Numbers (2, P) of plates of which dots are seen, and of dots, of a rig or of dots of several sizes."""
        assert self.covered is not None
        return np.stack([self.covered.plates, self.covered.count])

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The family, or the single marker."""
        return self.family or (self.marker,)

    def parts(self) -> list[str | Table]:
        """See `Result.parts`: summary, tables of criteria or expected errors, time and memory."""
        if self.account:
            duration = f"found in {self.seconds:.1f} s"
            first = filter(None, (self.account.summary, self.account.plan.sentence, self.account.assumed))
            return [*first, self._bound, *self._interruption, self.account.table, duration]
        noise, lost = self.setting.noise_words, self.marker.provenance["spec"].get("survive", 0)
        tables = [criteria_table(self.criteria, len(self.marker), noise)]
        if lost:
            tables.append(hidden_table(hidden_dot_errors(self.marker.xyz, self.setting, lost), noise))
        if self.reliability:
            tables.append(reliability_table(self.reliability, str(self._dot_noise)))
        plan = [self.plan.sentence] if self.plan else []
        more = [*filter(None, [self.outlook]), self._bound, *self._interruption]
        return [self.summary, *plan, *more, *tables, _effort(self.seconds)]

    def brief(self) -> Sequence[str | Table]:
        """See `Result.brief`: the marker, what it is for, the error to plan with, and what more dots would bring."""
        camera, poses, dots = self.spec.camera, self.setting.poses, self.dots
        usual = camera == PAPER_CAMERA, self.spec.poses == "paper"
        flags = [flag for flag, is_usual in zip(("--camera", "--poses"), usual, strict=True) if is_usual]
        yours = f"; {' and '.join(flags)} describe{'s' * (len(flags) == 1)} yours" if flags else ""
        if self.account:
            title, unseen = self.account.title, self.account.unserved
        else:
            keyed = "" if self.spec.asymmetric else ", dot 0 is the key ring"
            size = f"dots of {format_length(dots.diameter)}{keyed}" if dots.diameter else "bare points"
            title = f"{len(self.marker)} control points in a {self.marker.boundary}: {size}"
            see = "pose does" if poses.dropped == 1 else "poses do"
            unseen = f"{poses.dropped} {see} not see the whole marker" if poses.dropped else ""
        view_deg = np.rad2deg(camera.fields_of_view["horizontal"])
        near, far = poses.distance.min(), poses.distance.max()
        lines = [
            title,
            f"for a camera of {camera.width} x {camera.height} px, {view_deg:.0f} degrees wide, at "
            + " to ".join(dict.fromkeys(f"{distance:.2g}" for distance in (near, far)))
            + f" m{f'; {unseen}' if unseen else ''}{yours}",
        ]
        assumed = self.account.assumed if self.account else ""
        return [
            *lines,
            *([self.plan.sentence] if self.plan else []),
            *filter(None, [assumed, self._kept_apart.strip(), self._gaps.strip(), self.outlook]),
            *self._interruption,
        ]

    @property
    def plan(self) -> PlannedError | None:
        """The error to plan with; None for bare points."""
        return self.account.plan if self.account else planned_error_of(self.body.provenance)

    @property
    def _interruption(self) -> list[str]:
        """That the search was interrupted, and how far it had come, in words."""
        if not self.interrupted:
            return []
        bound = self.certificate.lower_bound
        above = f", {100 * (self.value / bound - 1):.1f} % above its lower bound" if bound else ""
        return [f"search interrupted after {self.interrupted:.0f} s{above}"]

    @property
    def certificate(self) -> Certificate:
        """Lower bound on the value of any layout in the same room; computed when first needed, see `certify`."""
        return self.certify()

    def certify(self, progress: Progress | None = None) -> Certificate:
        """Compute `certificate`, which may take as long as the search."""
        if self.account and not self._certificates:
            self._certificates.append(self.account.certify(self.value, progress))
        if not self._certificates:
            region = self.dots.region(self.spec)
            ngon, points = reference(self.spec, region, self.setting), self.marker.xyz
            objective = objective_of(self.spec, self.setting, ngon)
            for room in dict.fromkeys((region, region.without_gap)):
                self._certificates.append(
                    certify(objective, room, points if self.spec.relief else points[:, :2], progress)
                )
        return self._certificates[0]

    def certified(self, progress: Progress | None = None) -> "Design":
        """Return the same design with lower bounds in the provenance of its marker, see `certify`."""
        self.certify(progress)
        return replace(self, body=replace(self.body, provenance={**self.body.provenance, "search": self.found_under()}))

    def found_under(self) -> dict[str, Any]:
        """Constraints under which the layout was sought, what a gap costs, and lower bounds once they are known.

        ``gap_m`` is the least gap between two dots, ``clearance_m`` that between a dot and everything else. A gap
        chosen for the ``images`` costs a fraction of the value of at least ``gap_costs[0]``, since a better layout is
        known without it, and at most ``gap_costs[1]``, by the lower bound without it. Bounds are proven or tested, see
        `markergen.optimize.certificate`.
        """
        bounds = [bound.lower_bound for bound in self._certificates] or [0.0]
        proven = all(bound.proven for bound in self._certificates) if bounds[0] else None
        if not isinstance(self.body, Marker):
            return plain({"value": self.value or None, "lower_bound": bounds[0] or None, "lower_bound_proven": proven})
        stored = self.marker.provenance["spec"]
        least = max(0.0, 1 - self.gap.without / self.value)
        costs = [least, max(least, 1 - bounds[-1] / self.value)]
        demands = {name: stored[name] for name in ("asymmetric", "relief", "survive") if stored.get(name)}
        return plain(
            {
                "value": self.value,
                "clearance_m": self.dots.clearance,
                "gap_m": self.gap.length,
                "gap_reason": self.gap.reason,
                "gap_costs": costs if self.gap.reason == IMAGES else None,
                "lower_bound": bounds[0] or None,
                "lower_bound_without_gap": bounds[-1] or None,
                "lower_bound_proven": proven,
                "interrupted_s": self.interrupted or None,
                "limits": [str(limit) for limit in parse_goal(self.spec.objective).limits],
                "points": bool(stored.get("points")),
                **demands,
            }
        )

    def to_json(self) -> bytes:
        """Return value, lower bound (null if none is known), dots, criteria, warnings and files as JSON text."""
        self.certify()
        is_rig = isinstance(self.body, Rig)
        results = {**self.account.results, **self.found_under()} if self.account and is_rig else self._results()
        files: dict[str, Any] = {"warnings": self.warnings, "files": files_as_json(self.written)}
        files |= {"interrupted_s": self.interrupted} if self.interrupted else {}
        return json_bytes(plain({**results, **files}))

    def _results(self) -> dict[str, Any]:
        stored, bound = self.marker.provenance, self.certificate
        return {
            "objective": stored["spec"]["objective"],
            "value": self.value,
            "unit": OBJECTIVES[parse_goal(self.spec.objective).lead].unit,
            "lower_bound": None if bound.reason else bound.lower_bound,
            "dots": {"n": len(self.marker), "diameter_m": self.dots.diameter, "clearance_m": self.dots.clearance},
            "constraints": self._constraints(),
            "label_safety_px": self.labels.least if self.labels else None,
            "poses": stored["poses"],
            "noise": self.setting.noise_words,
            "criteria": self.criteria,
            "reliability": reliability_json(self.reliability, str(self._dot_noise)) if self.reliability else None,
        }

    def _constraints(self) -> dict[str, Any]:
        """The room, and what else the layout was sought under."""
        blocked = [region.as_dict() for region in self.spec.blocked]
        constraints = {
            name: value for name, value in self.found_under().items() if name not in ("value", "lower_bound")
        }
        return {"boundary": self.spec.boundary.as_dict(), "keep_outs": blocked, **constraints}

    def __str__(self) -> str:
        return "\n".join([*(f"warning: {warning}" for warning in self.warnings), super().__str__()])

    def __repr__(self) -> str:
        return f"Design({self.body!r}, {self.summary.splitlines()[1]})"

    def to_frame(self) -> "DataFrame":
        """Criteria as a pandas data frame with one row per layout."""
        return data_frame([{"layout": name, **row} for name, row in self.criteria.items()])

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw a marker to scale; see `Marker.plot`."""
        return self.marker.plot(ax)

    @property
    def summary(self) -> str:
        """Summary of the design and its setting, in a few lines."""
        if self.account:
            return self.account.summary
        spec, poses = self.marker.provenance["spec"], self.setting.poses
        against = f" for {self.setting.noise_words}" if self.setting.noise else ""
        dropped = f", {poses.dropped} more do not see the whole marker" if poses.dropped else ""
        return (
            f"{len(self.marker)} control points in a {self.marker.boundary}, "
            f"seen from {len(poses)} poses ({poses_in_words(poses.name)}{dropped})\n"
            f"objective {spec['objective']}{self._aggregate}{against}, "
            f"seed {spec['seed']}, spec {self.marker.spec_hash}\n"
            + (f"dots of {self.dots.reason}" if self.dots.diameter else "bare points")
            + self._labels
            + self._kept_apart
            + self._gaps
        )

    @property
    def _kept_apart(self) -> str:
        """A gap that was not asked for, and what it costs, in words."""
        if self.account or self.gap.reason != IMAGES:
            return ""
        least, most = (f"{100 * cost:.1f}" for cost in self.found_under()["gap_costs"])
        if most == "0.0":
            return ""
        is_bounded = any(bound.lower_bound for bound in self._certificates)
        costs = f"{least} %" if least == most else f"{least} to {most} %" if is_bounded else f"{least} % or more"
        clearance = format_length(self.dots.clearance).replace(" ", "")
        return (
            f"\na gap of {format_length(self.gap.length)}, chosen so that images of dots do not run together, costs "
            f"{costs} of the error; --gap {clearance} leaves it out"
        )

    @property
    def _gaps(self) -> str:
        """Distances of the spec's poses at which no four dots are in view, in words."""
        if self.account or not self.setting.poses.dropped or self.spec.relief or not self.dots.diameter:
            return ""
        poses = poses_from(self.spec.poses)
        gaps = coverage(self.marker, self.setting.camera, poses).gaps
        several = needs_scales(self.spec, poses)
        remedy = "; --n auto makes dots of several sizes for them" if several else ""
        return f"\nnot served: {'; '.join(gaps)}{remedy}" if gaps else ""

    @cached_property
    def outlook(self) -> str:
        """What more dots of a flat marker with dots of one size would bring; may be empty."""
        if self.account or self.spec.relief or not self.dots.diameter:
            return ""
        # A gap for the images of these dots is none that others need.
        spec = replace(self.spec, gap=0.0) if self.gap.reason == IMAGES else self.spec
        return outlook(self.marker.xyz[:, :2], self.dots.diameter, spec, self.setting, usual_sources(spec))

    @property
    def _dot_noise(self) -> DotNoise:
        """Noise of image and print, that of the objective if it has one, otherwise with the usual print."""
        spec = self.spec
        usual = DotNoise(self.dots.diameter, spec.image_noise, usual_sources(spec).print_sigma)
        return self.setting.noise or usual

    @cached_property
    def reliability(self) -> list[DotReliability]:
        """How well dots control each other; empty for a rig, a relief, bare points and dots of several sizes."""
        if self.account or self.spec.relief or not self.dots.diameter:
            return []
        ids = [point.id for point in self.marker.control_points]
        return reliability(self.marker.xyz[:, :2], replace(self.setting, noise=self._dot_noise), ids)

    @property
    def _aggregate(self) -> str:
        """Value of the objective, where the table of criteria does not contain it."""
        spec = self.marker.provenance["spec"]
        lost = spec.get("survive", 0)
        goal = parse_goal(spec["objective"])
        if not (spec["aggregate"] or lost or len(goal.terms) > 1):
            return ""
        unit = OBJECTIVES[goal.lead].unit if len(goal.terms) == 1 else ""
        phrase = f" {spec['aggregate']}" if spec["aggregate"] else ""
        phrase += f" after the worst loss of {lost} dot{'s' * (lost > 1)}" if lost else ""
        return f"{phrase}, {self.value:.4g}{f' {unit}' if unit else ''}"

    @property
    def _bound(self) -> str:
        """Lower bound in the unit of the table, and the certificate in words."""
        column, certificate = OBJECTIVES[parse_goal(self.spec.objective).lead].criterion, self.certificate
        if column is None or certificate.reason:
            return certificate.sentence
        name, _, unit = column.title.rpartition(" ")
        bound, *without = (column.factor * bound.lower_bound for bound in self._certificates)
        more = "".join(f"; without that gap, the bound is {lower:.4g} {unit}" for lower in without)
        kind = "lower" if certificate.proven else "tested"
        return f"{kind} bound of the {name} error {bound:.4g} {unit}: {certificate.sentence}{more}"

    @property
    def _labels(self) -> str:
        """Labeling method and label safety, in words."""
        if self.labels is None:
            return ""
        demanded = self.marker.provenance["spec"].get("asymmetric")
        if not demanded:
            return f"; dot 0 is the key ring\n{self.labels.sentence}"
        return f"; labels from the layout, safety >= {demanded:g} px\n{self.labels.sentence}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that the user should read before using the marker or rig."""
        if self.account:
            return self.account.warnings
        warnings = []
        if self.marker.provenance["spec"]["coordinates"] == "hartley":
            warnings.append(
                "c(A) in Hartley's coordinates does not depend on size: the layout is degenerate, for study only"
            )
        across = pixels_across(self.dots.diameter, self.setting.camera, self.setting.poses, mean=True)
        image = self.spec.image_noise
        least = max(point.feature.least_pixels for point in self.marker.control_points) * image.size_factor
        if not self.dots.diameter:
            warnings.append("bare points (--dot 0) are for studies and cannot be printed or made")
        elif across < least:
            ring = " for the key ring" if least > DOT_PIXELS * image.size_factor else ""
            warnings.append(
                f"dots of {across:.1f} px are hardly detected, which takes {least:.2g} px{ring}: use fewer, more room, "
                "or a better camera"
            )
        if self.setting.poses.doubt:
            warnings.append(self.setting.poses.doubt)
        elif missed := left_out(len(self.setting.poses), self.setting.poses.dropped):
            warnings.append(missed)
        if self.dots.warning:
            warnings.append(self.dots.warning)
        if self.labels and not self.labels.is_decided and not self.marker.tag:
            warnings.append(f"{self.labels.sentence}; use --tag, fewer dots, more room, or a better camera")
        warnings += [*self._beaten(), *self._weak_criteria(), *self._idle_keep_outs(), *near_holes(self.marker)]
        return (
            *warnings,
            *crowded(self.marker.xyz, self.dots.diameter, self.setting.camera, self.setting.poses, image),
        )

    def _idle_keep_outs(self) -> list[str]:
        """Warnings about keep-outs outside the boundary."""
        if not self.marker.keep_outs:
            return []
        boundary = self.marker.boundary.region
        return [
            f"keep-out {place}, a {keep_out} around ({', '.join(map(format_length, keep_out.center))}), lies wholly "
            "outside the boundary and keeps nothing out: look up its place in the marker frame"
            for place, keep_out in enumerate(self.marker.keep_outs, 1)
            if not keep_out.region.meets(boundary)
        ]

    def _beaten(self) -> list[str]:
        """Warning about given points that a regular polygon in the same room beats in the objective."""
        column = columns().get(parse_goal(self.spec.objective).lead)
        if not self.spec.points or column is None:
            return []
        error, ngon = (self.criteria.get(name, {}).get(column.key, np.nan) for name in ("design", NGON))
        if not error > ngon * (1 + WORSE):
            return []
        less = 100 - 100 * ngon / error
        return [f"a regular polygon has {less:.0f} % less {column.title}; leave out --points to search"]

    def _weak_criteria(self) -> list[str]:
        """Warnings about errors, other than the objective, that a layout printed beside the design has less of."""
        errors, warnings = self.criteria["design"], []
        for name, criterion in columns().items():
            if name in parse_goal(self.spec.objective).names or criterion.noiseless or criterion.key not in errors:
                continue
            others = {layout: row[criterion.key] for layout, row in self.criteria.items() if criterion.key in row}
            best = min(others, key=lambda layout: others[layout])
            if best == "design" or errors[criterion.key] <= others[best] * (1 + WORSE):
                continue
            error, least = (cell(criterion, value) for value in (errors[criterion.key], others[best]))
            off = f"off by {error} {criterion.title.rpartition(' ')[2]}" if error != UNDETERMINED else error
            # Nearly collinear dots determine a pose, but hardly the homography that estimators begin with.
            flat = OBJECTIVES[name].planar_only
            better = errors[criterion.key] > others.get(NGON, np.inf)
            bounded = f" or --objective '{self.spec.objective}, {name} <= {NGON}'" if better else ""
            warnings.append(
                f"the layout is weak for {'a ' * flat}{name}, {off} ({LAYOUTS[best]}: "
                f"{least}) for {self.setting.noise_words}{', and estimators that begin with one may flip' * flat}; "
                f"use --objective {name}{bounded}, or more dots"
            )
        return warnings


def design(spec: Spec, progress: Progress | None = None, traced: bool = False, watch: Watch | None = None) -> Design:
    """Find the layout that minimizes the spec's objective, and make it a marker.

    If nothing is said about dots and gaps, and images of the dots would run together, the layout is sought with a gap
    that keeps them apart, which is then in the spec, and what it costs in the design. Equal specs give equal markers,
    traced and watched or not. For `progress` and `watch` see `markergen.options`.

    Raises
    ------
    InputError
        If no pose sees the marker, the dots do not fit, a name in the spec is unknown, the best layout has no
        homography, or no layout was found with the demanded label safety.
    """
    begin = perf_counter()
    try:
        choice = settled(spec, progress)
    except Ended:
        raise InputError(
            "time to settle what is open", f"{perf_counter() - begin:.0f} s", "allow more --time"
        ) from None
    reason = ASKED if spec.gap else IMAGES if choice else CLEARANCE
    task = _task_of(choice.spec if choice else spec, choice.reason if choice else "", progress)
    layout, crowded = None, None

    def refuse_crowds(points: Array) -> None:
        if task.crowds(points):
            raise _Crowded(points)

    try:
        layout = _place(task, progress, traced, watch, refuse_crowds)
        crowded = layout.points if task.crowds(layout.points) else None
    except _Crowded as error:
        (crowded,) = error.args
    gap = Gap(max(task.spec.gap, task.dots.clearance), reason)
    if crowded is not None:
        try:
            apart = _task_of(replace(task.spec, gap=task.images_gap), "", progress)
            layout = _place(apart, progress, traced, watch)
            without = _value_without_gap(apart, crowded, layout.points)
            # A gap may also cost size: smaller dots are the design's even where none of them needs the gap any more.
            if without or apart.dots.diameter != task.dots.diameter:
                gap, task = Gap(apart.spec.gap, IMAGES, without or np.inf), apart
        except InputError as error:
            log.info("no gap of %s: %s", format_length(task.images_gap), error)
    layout = layout or _place(task, progress, traced, watch)
    result = _made(task, layout, gap, perf_counter() - begin)
    log.info("designed %r in %.1f s", result.marker, result.seconds)
    return result


def _value_without_gap(task: "_Task", crowded: Array, points: Array) -> float:
    """Value of a layout that keeps only the clearance: a crowded one, or one of it and points (n, 2), polished.

    0 if no dots of the points are as close as the gap allows, and none of the others is better: they need no gap.
    """
    room = task.region.without_gap
    own, value = task.objective(np.stack([points, crowded])).tolist()
    if len(points) <= ALL_PAIRS_UP_TO:
        with limited(None):
            value = min(value, *(polish(task.objective, room, start)[1] for start in (crowded, points)))
    wider = replace(task.region, gap=task.region.gap + MEASURABLE)
    return 0.0 if value >= own * (1 - UPRIGHT) and wider.holds(points[None])[0] else value


class _Crowded(Exception):
    """Images of the dots of a layout, the argument, run together."""


@dataclass(frozen=True, eq=False)
class _Task:
    """What is to be placed, and where."""

    spec: Spec
    dots: DotSize
    setting: Setting
    region: FeasibleRegion
    ngon: Array | None
    objective: Objective

    @cached_property
    def images_gap(self) -> float:
        """Gap in m that keeps images of dots apart anywhere in the room; 0 if dots or gaps are asked for."""
        spec, room = self.spec, self.region.boundary
        if spec.dot is not None or spec.gap or spec.points or spec.relief or not self.dots.diameter:
            return 0.0
        places = room.project(room.rim(RIM), self.region.inset)
        gap = separating_gap(places, self.setting.camera, self.setting.poses, spec.image_noise)
        return 0.0 if gap >= self.dots.diameter else gap

    def crowds(self, points: Array) -> bool:
        """Whether images of dots at points (n, 2) run together, and a gap prevents it."""
        setting, image = self.setting, self.spec.image_noise
        return bool(self.images_gap and crowding(points, self.dots.diameter, setting.camera, setting.poses, image))


@dataclass(frozen=True, eq=False)
class _Layout:
    """A layout that was found, others to compare it with, and the way to it."""

    points: Array
    others: dict[str, Array]
    way: list[tuple[str, Array]]


def _task_of(spec: Spec, reason: str, progress: Progress | None) -> _Task:
    """Task of a spec whose number of dots is settled, for a reason that explains their size."""
    check_objective(spec, spec.noise_model == "image")
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    check_parts(spec, Setting(spec.boundary, spec.camera, poses))  # reject wrong names before any search
    dots = size_given(spec, poses) if spec.points else choose_dots(spec, poses, progress)
    dots = replace(dots, reason=reason or dots.reason)
    setting, region = dots.setting(spec, poses), dots.region(spec)
    ngon = reference(spec, region, setting)
    objective = objective_of(spec, setting, ngon)
    check_values(objective, region, spec)
    return _Task(spec, dots, setting, region, ngon, objective)


def _place(
    task: _Task,
    progress: Progress | None,
    traced: bool,
    watch: Watch | None,
    first: Callable[[Array], None] | None = None,
) -> _Layout:
    """Search for the layout; `first` as in `search`."""
    spec, setting, region, objective = task.spec, task.setting, task.region, task.objective
    rng = np.random.default_rng(spec.seed)
    recorder = Recorder() if traced else None
    record = Watcher(objective, region, watch, recorder) if watch else recorder
    more = spec.restarts, progress, rough_of(spec, setting, task.ngon), record
    optimum: Optimum | AsymmetricOptimum
    allowed: Callable[[Array], bool] | None = None
    others: dict[str, Array] = {}
    if spec.points:
        points = np.array(spec.points)
        _refuse_faults(points, region, spec, setting)
        optimum = Optimum(points, np.nan)
    elif spec.asymmetric:
        optimum = asymmetric_search(objective, region, spec.n, rng, spec.asymmetric, *more).or_refuse()
        points = optimum.points
        if not optimum.binding:
            points = upright(
                points,
                objective,
                region,
                lambda rotated: layout_safety(rotated, setting, False).least >= spec.asymmetric,
            )
        points = numbered(points)
    else:
        optimum = search(objective, region, spec.n, rng, *more, first)
        if spec.relief:
            flat, room = optimum.points, ReliefRoom(region, spec.relief, eyes_of(setting.poses))
            optimum, others = search_relief(objective, room, flat, rng, *more), {"flat": flat}
            allowed = room.holds
        points = numbered(upright(optimum.points, objective, region, allowed))
    check_bounds(objective, points, spec)
    return _Layout(points, others, [*recorder.way(optimum.points), ("upright", points)] if recorder else [])


def _made(task: _Task, layout: _Layout, gap: Gap, seconds: float) -> Design:
    """Make the marker, and check it."""
    spec, setting, dots, points = task.spec, task.setting, task.dots, layout.points
    table = compare(points, task.region, setting, spec.seed, layout.others)
    if np.isinf(table["design"].get("homography_px", 0.0)):
        # It determines a pose, but detection and others start from a homography.
        raise InputError(
            "a layout that determines a homography",
            f"all dots but one on a line, where {spec.objective} is best",
            f"use --objective homography, or --n {spec.n + 1} or more",
        )
    labels = layout_safety(points, setting, not spec.asymmetric) if dots.diameter or spec.asymmetric else None
    marker = dress(points, dots, spec, setting, table, labels)
    if dots.diameter:
        plan = planned_error(points, dots.diameter, spec, setting)
        marker = replace(marker, provenance={**marker.provenance, KEY: plan.as_dict()})
    check(breach(marker.xyz, spec.boundary, spec.blocked, dots.diameter, dots.clearance))
    check_holes(marker)
    if spec.relief:
        worst = relief_breach(marker.xyz, spec.relief, dots.diameter, dots.clearance, eyes_of(setting.poses))
        check(worst, "relief")
    value = float(task.objective(points[None])[0])
    trace = tuple(trace_of(layout.way, task.objective)) if layout.way else ()
    interrupted = seconds * current_limit().ended
    result = Design(marker, setting, dots, table, spec, labels, value, gap, seconds, trace, interrupted=interrupted)
    stored = {**marker.provenance, "search": result.found_under()}
    return replace(result, body=replace(marker, provenance=stored))


def _refuse_faults(points: Array, region: FeasibleRegion, spec: Spec, setting: Setting) -> None:
    """Refuse a layout with faults, with pillars that hide dots from a pose, or with labels less safe than asked.

    Raises
    ------
    InputError
        Naming the first fault.
    """
    if breaches := faults(points, region):
        more = f", and {len(breaches) - 1} more" * (len(breaches) > 1)
        dots = f"dots of {format_length(region.diameter)} with {format_length(region.clearance)} clearance"
        raise InputError(
            f"points with room for {dots}",
            f"{breaches[0].words}{more}",
            "move them, or give a smaller --dot; numbers without a unit are in m",
        )
    if spec.relief:
        worst = relief_breach(points, spec.relief, region.diameter, region.clearance, eyes_of(setting.poses))
        if worst > TOLERANCE:
            wrong = f"one that is {format_length(worst)} too high, too low, or in the way of another"
            raise InputError(
                f"points of a relief of {format_length(spec.relief)}", wrong, "move it, or allow more --relief"
            )
    if spec.asymmetric:
        safety = layout_safety(points, setting, keyed=False).least
        if safety < spec.asymmetric:
            raise InputError(
                f"points with labels safe to {spec.asymmetric:g} px", f"{safety:.3g} px", "move them, or ask for less"
            )


def upright(
    points: Array, objective: Objective, region: FeasibleRegion, allowed: Callable[[Array], bool] | None = None
) -> Array:
    """Rotate a layout (n, 2 or 3) so that one control point is straight up, where that costs nothing.

    Of the n rotations, the best one is chosen that is feasible, allowed, and worse by no more than `UPRIGHT`.
    """
    angles = np.pi / 2 - np.arctan2(points[:, 1], points[:, 0])
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
    plane = region.boundary.project(points[:, :2] @ turns.swapaxes(-1, -2), region.inset)
    heights = np.broadcast_to(points[:, 2:], (*plane.shape[:2], points.shape[1] - 2))
    candidates = np.concatenate([plane, heights], axis=-1)
    values = np.where(region.holds(plane), objective(candidates), np.inf)
    most = float(objective(points[None])[0]) * (1 + UPRIGHT)
    best = (candidates[i] for i in np.argsort(values, kind="stable") if values[i] <= most)
    return next((candidate for candidate in best if allowed is None or allowed(candidate)), points)


def _effort(seconds: float) -> str:
    """Duration of the design and, where available, peak memory of the process, in words."""
    duration = f"found in {seconds:.1f} s"
    try:
        import resource
    except ImportError:  # Windows
        return duration
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in kB, macOS in bytes.
    return f"{duration}, {peak / (1e6 if sys.platform == 'darwin' else 1e3):.0f} MB of memory at most"
