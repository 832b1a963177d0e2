"""Design of a marker with dots of several sizes, for a wide range of distances (see `markergen.optimize.ranges`)."""
# tests: tests/api/test_design.py tests/validation/test_pads.py

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from markergen.arrays import Array
from markergen.bounds.confusion.affine import likeness
from markergen.bounds.confusion.perspective import LabelSafety, layout_safety
from markergen.bounds.dot_covariances import dot_information
from markergen.maths.information import covariance, rotation_bound, translation_bound
from markergen.model.feature import Feature, key_ring
from markergen.model.goal import parse_goal
from markergen.model.marker import ControlPoint, Marker
from markergen.model.sight import Coverage, coverage, distance_table
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.aggregates import aggregate_of
from markergen.objectives.criteria import Criteria, columns
from markergen.objectives.observation import DotNoise
from markergen.optimize.certificate import Certificate
from markergen.optimize.design import Design
from markergen.optimize.dot_size import DotSize
from markergen.optimize.problem import check
from markergen.optimize.ranges import Scale, aggregated, nested, values_of
from markergen.optimize.to_marker import number, provenance_of
from markergen.options import Progress
from markergen.presentation.tables import Table
from markergen.presentation.tables import number as written
from markergen.read.poses import poses_from
from markergen.units import format_length

log = logging.getLogger(__name__)


ALIKE = 0.05
"""Deviation of one scale's layout from an affine image of another's, as a fraction of its size, below which the two
could be taken for each other."""


@dataclass(frozen=True, repr=False)
class PadDesign(Design):
    """A designed marker with dots of several sizes.

    Attributes
    ----------
    scales : tuple of Scale
        Its constellations, the largest first.
    safety : tuple of LabelSafety
        Label safety of each, seen alone from the poses that it serves.
    covered : Coverage
        What each pose of the spec sees.
    errors : array (P,)
        Objective of each pose, inf if it is not served.
    """

    scales: tuple[Scale, ...] = field(default=(), compare=False)
    safety: tuple[LabelSafety, ...] = field(default=(), compare=False)
    covered: Coverage | None = field(default=None, compare=False)
    errors: Array | None = field(default=None, compare=False)

    def parts(self) -> list[str | Table]:
        """See `Result.parts`: summary and a table of what serves which distances."""
        return [self.summary, coverage_table(self), f"found in {self.seconds:.1f} s"]

    def certify(self, progress: Progress | None = None) -> Certificate:
        """There is no lower bound for dots of several sizes."""
        del progress
        return Certificate(len(self.marker), self.value, reason="the dots have several sizes")

    @property
    def summary(self) -> str:
        """Summary of the design and its setting, in a few lines."""
        poses, spec = self.setting.poses, self.spec
        lines = [
            f"{len(self.marker)} control points of {len(self.scales)} sizes in a {self.marker.boundary}, "
            f"seen from {len(poses)} poses ({poses.name})",
            f"objective {spec.objective} {spec.aggregate or 'logmean'} of {self._told(self.value)} for "
            f"{self.dots.reason}, seed {spec.seed}, spec {self.marker.spec_hash}",
        ]
        start = 0
        for scale, safe in zip(self.scales, self.safety, strict=True):
            nearest, farthest = scale.poses.distance.min(), scale.poses.distance.max()
            lines.append(
                f"{len(scale.points)} dots of {format_length(scale.diameter)} in a {scale.spec.boundary}, the whole in "
                f"view from {nearest:.3g} to {farthest:.3g} m; dot {start} is their key ring; {safe.sentence}"
            )
            start += len(scale.points)
        return "\n".join(lines)

    def _told(self, value: float) -> str:
        unit = OBJECTIVES[parse_goal(self.spec.objective).lead].unit
        return format_length(float(f"{value:.3g}")) if unit == "m" else f"{value:.3g} {unit}"

    @cached_property
    def outlook(self) -> str:
        """Nothing: the table says what to expect at which distance."""
        return ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that the user should read before using the marker."""
        assert self.covered is not None
        return tuple(f"no four dots serve some poses: {gap}" for gap in self.covered.gaps)


def coverage_table(design: PadDesign) -> Table:
    """Ranges of distance with the poses that are served, the dots in view, and the expected errors."""
    covered = design.covered
    assert covered is not None
    pose = _covariance(covered, design.spec)
    errors = np.rad2deg(rotation_bound(pose)), 100 * translation_bound(pose, covered.poses.translation)
    cells = []
    for _, _, mask in covered.bands():
        served = mask & covered.served
        cells.append([written(np.sqrt(np.mean(e[served] ** 2)) if served.any() else None, 3) for e in errors])
    sizes = [float(covered.diameters[scale[0]]) for scale in covered.scales]
    return distance_table(covered.rows(), sizes, ("least deg", "least %"), cells)


def _covariance(covered: Coverage, spec: Spec) -> Array:
    """Least covariance (P, 6, 6) of the pose from the dots in view; inf where they do not serve."""
    covariances = np.full((len(covered.poses), 6, 6), np.inf)
    total = dot_information(covered, spec.camera, spec.image_noise, spec.print_sigma).sum(axis=1)
    covariances[covered.served] = covariance(total[covered.served])
    return covariances


def design_pad(spec: Spec, progress: Progress | None = None) -> PadDesign:
    """Find nested constellations for the poses of a spec, and make them a marker.

    Raises
    ------
    InputError
        If the objective is not the error of a pose, or no dots fit that are seen.
    """
    begin = perf_counter()
    poses = poses_from(spec.poses)
    scales = tuple(
        replace(scale, points=np.round(number(scale.points), 10) + 0.0) for scale in nested(spec, poses, progress)
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
    check(points, spec.boundary, spec.blocked, diameters, clearance)
    safety: list[LabelSafety] = []
    for scale in scales:
        start = sum(len(labels.ids) for labels in safety)
        label_safety = layout_safety(scale.points, scale.setting, keyed=True)
        safety.append(replace(label_safety, ids=tuple(range(start, start + len(scale.points)))))
    _check_figures(scales)
    covered = coverage(marker, spec.camera, poses)
    errors = values_of(covered, spec)
    served = np.flatnonzero(covered.served)
    value = aggregated(errors[served], spec, poses.taken(served, 0))
    setting = Setting(spec.boundary, spec.camera, poses.taken(served, len(poses) - len(served)))
    noise = DotNoise(scales[0].diameter, spec.image_noise, spec.print_sigma)
    noise_text = str(noise).replace(f" of {format_length(scales[0].diameter)} dots", "")
    sizes = ", ".join(f"{len(scale.points)} of {format_length(scale.diameter)}" for scale in scales)
    dots = DotSize(scales[0].diameter, clearance, noise_text)
    row = _criteria(covered, spec)
    settled = replace(spec, n=len(marker), dot=scales[0].diameter)
    marker = replace(marker, provenance=provenance_of(settled, setting, f"{sizes}, for {noise_text}", {"design": row}))
    return PadDesign(
        marker, setting, dots, {"design": row}, spec, None, value, perf_counter() - begin,
        scales=scales, safety=tuple(safety), covered=covered, errors=errors,
    )  # fmt: skip


def _criteria(covered: Coverage, spec: Spec) -> Criteria:
    """Bounds of rotation and translation, RMS over the poses that are served."""
    served = np.flatnonzero(covered.served)
    pose, poses = _covariance(covered, spec)[served], covered.poses.taken(served, 0)
    total = aggregate_of("rms", poses.weight)
    bounds = {criterion.key: criterion.bound for criterion in columns().values() if criterion.bound}
    return {key: float(total(bound(pose[None], poses), 0.0)[0][0]) for key, bound in bounds.items()}


def _check_figures(scales: tuple[Scale, ...]) -> None:
    """Refuse scales of which one could be taken for another.

    Raises
    ------
    RuntimeError
        If a layout is nearly an affine image of dots of another one, key ring on key ring.
    """
    for first in scales:
        for second in scales:
            if first is not second and likeness(first.points, second.points) < ALIKE:
                raise RuntimeError(f"constellations of {first.diameter} and {second.diameter} m are alike")
