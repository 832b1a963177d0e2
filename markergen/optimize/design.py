"""From a spec to a marker: the main job."""

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from markergen import __version__
from markergen.model.marker import Marker, dressed
from markergen.model.poses import PoseDistribution
from markergen.model.recorded_poses import MOST_KEPT, RecordedPoses
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.criteria import Criteria, criteria, median_criteria
from markergen.objectives.weights import DotNoise
from markergen.optimize.check import check
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.dots import FEWEST_PIXELS, DotSize, choose_dots, pixels_across
from markergen.optimize.goal import objective_of, room_of, rough_of
from markergen.optimize.multistart import Progress, search
from markergen.optimize.region import Region
from markergen.optimize.trace import Recorder, Step, trace_of
from markergen.read.poses import poses_from

Array = NDArray[np.float64]

UPRIGHT = 1e-5
"""Relative worsening that is allowed for turning the layout upright: far below what any sheet or camera can show."""


@dataclass(frozen=True)
class Design:
    """A designed marker with what a user wants to know about it.

    Attributes
    ----------
    marker : Marker
    setting : Setting
    dots : DotSize
    criteria : dict
        Criteria of the design (``design``) and of the layouts beside it (``ngon``, ``square``, ``random``), for the
        noise that ``setting.noise_words`` tells.
    seconds : float
        How long it took.
    trace : tuple of Step
        The way from the best start to the layout, if it was asked for.
    """

    marker: Marker
    setting: Setting
    dots: DotSize
    criteria: dict[str, Criteria]
    seconds: float = field(default=0.0, compare=False)
    trace: tuple[Step, ...] = ()

    @property
    def summary(self) -> str:
        """What was designed for what, in a few lines."""
        spec, poses = self.marker.provenance["spec"], self.setting.poses
        against = f" for {self.setting.noise_words}" if self.setting.noise else ""
        dropped = f", {poses.dropped} more do not see the whole marker" if poses.dropped else ""
        return (
            f"{len(self.marker)} control points in a {self.marker.boundary}, "
            f"seen from {len(poses)} poses ({poses.name}{dropped})\n"
            f"objective {spec['objective']}{against}, seed {spec['seed']}, spec {self.marker.spec_hash}\n"
            + (f"dots of {self.dots.reason}; dot 0 is the key ring" if self.dots.diameter else "bare points")
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know before using the marker."""
        found = []
        if self.marker.provenance["spec"]["coordinates"] == "hartley":
            found.append(
                "c(A) in Hartley's coordinates does not depend on size: the layout is degenerate, for study only"
            )
        across = pixels_across(self.dots.diameter, self.setting.camera, self.setting.poses)
        if not self.dots.diameter:
            found.append("bare points (--dot 0) are for studies and cannot be printed or made")
        elif across < FEWEST_PIXELS:
            found.append(f"dots of {across:.1f} px are hardly detected: use fewer, more room, or a better camera")
        if self.setting.poses.doubt:
            found.append(f"most poses do not see the whole marker; {self.setting.poses.doubt}")
        if self.dots.warning:
            found.append(self.dots.warning)
        return tuple(found)


def design(spec: Spec, progress: Progress | None = None, traced: bool = False) -> Design:
    """Find the layout that minimizes the spec's objective, and dress it as a marker.

    Equal specs give equal markers, traced or not. `progress(stage, done, total)` is called along the way.

    Raises
    ------
    InputError
        If no pose sees the marker, the dots do not fit, or a name in the spec is unknown.
    """
    begin, kind = perf_counter(), OBJECTIVES[spec.objective]
    setting = Setting(spec.boundary, spec.camera, poses_from(spec.poses).seen_whole(spec.boundary, spec.camera))
    kind(setting, spec.aggregate, spec.coordinates)  # a wrong name is told before any search
    dots = choose_dots(spec, setting.poses, progress)
    if spec.noise_model == "image":
        setting = replace(setting, noise=DotNoise(dots.diameter, spec.image_noise, spec.print_sigma))
    objective = objective_of(spec, setting)
    region = Region(room_of(spec), dots.diameter, dots.clearance)
    rng = np.random.default_rng(spec.seed)
    recorder = Recorder() if traced else None
    optimum = search(objective, region, spec.n, rng, spec.restarts, progress, rough_of(spec, setting), recorder)
    points = number(upright(optimum.points, objective, region))
    table = compare(points, region, setting, spec.seed)
    marker = dress(points, dots, spec, setting, table)
    check(marker.xyz, spec.boundary, spec.blocked, dots.diameter, dots.clearance)
    way = [*recorder.way(optimum.points), ("upright", points)] if recorder else []
    trace = tuple(trace_of(way, objective)) if way else ()
    return Design(marker, setting, dots, table, perf_counter() - begin, trace)


def compare(points: Array, region: Region, setting: Setting, seed: int = 0) -> dict[str, Criteria]:
    """Criteria of a layout (n, 2) and of the n-gon, the square and the median random layout of the same region."""
    table: dict[str, Criteria] = {"design": criteria(points[None], setting)[0]}
    for name, layouts in comparison_layouts(region, len(points), seed, setting).items():
        table[name] = median_criteria(criteria(layouts, setting))
    return table


def upright(points: Array, objective: Objective, region: Region) -> Array:
    """Turn a layout (n, 2) so that one control point stands straight up, where that costs nothing.

    Of the n turns the best is taken, if it is feasible and worse by no more than `UPRIGHT`.
    """
    angles = np.pi / 2 - np.arctan2(points[:, 1], points[:, 0])
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
    candidates = region.boundary.project(points @ turns.swapaxes(-1, -2), region.inset)
    values = np.where(region.holds(candidates), objective(candidates), np.inf)
    best = int(np.argmin(values))
    return candidates[best] if values[best] <= objective(points[None])[0] * (1 + UPRIGHT) else points


def number(points: Array) -> Array:
    """Order control points (n, 2) for labels: counterclockwise from straight up, those at the center last."""
    radius = np.hypot(points[:, 0], points[:, 1])
    central = radius < 1e-3 * radius.max()
    angle = np.mod(np.arctan2(points[:, 1], points[:, 0]) - np.pi / 2 + 1e-6, 2 * np.pi)
    return points[np.lexsort((radius, np.where(central, 7.0, angle)))]


def dress(points: Array, dots: DotSize, spec: Spec, setting: Setting, table: dict[str, Criteria]) -> Marker:
    """Make a marker of a layout (n, 2): dot 0 is the key ring, the others are disks; provenance says from what."""
    import scipy

    stored = _stored(spec, setting.poses).as_dict()
    # A tenth of a nanometer: nothing that anybody could make, and the file stays readable.
    rounded = np.round(points, 10) + 0.0
    return replace(
        dressed(rounded, spec.boundary, dots.diameter, dots.clearance),
        keep_outs=spec.keep_outs,
        tag=spec.placed_tag,
        provenance={
            "spec": stored,
            "spec_hash": spec.hash,
            "seed": spec.seed,
            "versions": {"markergen": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
            "camera": stored["camera"],
            "poses": {"name": setting.poses.name, "count": len(setting.poses), "dropped": setting.poses.dropped},
            "dots": dots.reason,
            "criteria": {
                name: {key: float(f"{value:.8g}") for key, value in row.items()} for name, row in table.items()
            },
            # Without this word criteria are for noise of 1 px.
            **({"noise": setting.noise_words} if setting.noise else {}),
        },
    )


def _stored(spec: Spec, seen: PoseDistribution) -> Spec:
    """Spec as a marker.json has it: of a file with too many poses only those that the marker was designed for."""
    too_many = isinstance(spec.poses, RecordedPoses) and len(spec.poses) > MOST_KEPT
    return replace(spec, poses=seen) if too_many and isinstance(seen, RecordedPoses) else spec
