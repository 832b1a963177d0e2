"""Dots of several sizes for a wide range of distances: nested constellations, each of which serves a part of it.

Dots that are large enough to be seen from afar do not fit in the image from nearby. A *scale* is a constellation of
dots of one diameter in a room of its own: a disk about the origin, without the disk of the next smaller scale. The
largest is the whole marker, and the smallest what every pose sees whole; the radii between are in equal ratio. Each
scale serves the poses that see it whole, up to a little beyond the farthest that do not see the next larger one whole.

Every scale is first searched for the poses that it serves. All are then polished together, in turns: the dots of one
scale move, while those of the others that a pose sees add their information. What a pose sees is taken as fixed in a
turn, and looked up again after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf, log

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.bounds.dot_covariances import dot_information
from markergen.errors import InputError
from markergen.maths.information import covariance
from markergen.model.boundary import Boundary, Circle
from markergen.model.camera import Camera
from markergen.model.goal import parse_goal
from markergen.model.poses import SEEN, PoseDistribution, silhouette, visibility
from markergen.model.sight import Coverage, disks_in_view
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.base import Sight
from markergen.objectives.observation import DotNoise
from markergen.objectives.pose import PoseCovarianceObjective
from markergen.optimize.dot_count import STEP, Forecast, Forecaster, least_sizes, sources_of
from markergen.optimize.dot_size import clearance_of
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, objective_of, room_of, rough_of
from markergen.optimize.search import search
from markergen.options import Progress
from markergen.units import format_length

WIDE = 4.0
"""Ratio of the farthest to the nearest pose from which on dots may have several sizes."""

MOST_SCALES = 4

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

ALL_BUT = 0.005
"""Share of the poses that need not be served, or see the marker whole."""

NEAR_BEST = 1.5
"""Error at any distance, relative to the least that any number of scales reaches there, for which fewer will do."""

TURNS = 2
"""Number of rounds in which all scales are polished together."""

LEAST_SHRINK = 1e-3
"""Smallest radius of a scale, as a fraction of the marker's."""


@dataclass(frozen=True, eq=False)
class Scale:
    """A constellation of dots of one diameter.

    Attributes
    ----------
    spec : Spec
        Its room, number and size of dots.
    poses : PoseDistribution
        Poses that it serves.
    points : array (n, 2), m
    """

    spec: Spec
    poses: PoseDistribution
    points: Array

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
        """Camera, poses and noise of its search."""
        noise = DotNoise(self.diameter, self.spec.image_noise, self.spec.print_sigma)
        return Setting(self.spec.boundary, self.spec.camera, self.poses, noise)


def needs_scales(spec: Spec, poses: PoseDistribution) -> bool:
    """Whether the poses differ widely in distance and do not all see the marker whole, and dots may have any size."""
    special = spec.relief or spec.target or spec.tag or spec.asymmetric or spec.survive or isinstance(spec.dot, float)
    if special or poses.distance.max() <= WIDE * poses.distance.min():
        return False
    return bool(np.mean(~_sees(spec.boundary, spec.camera, poses)) > ALL_BUT)


def nested(spec: Spec, poses: PoseDistribution, progress: Progress | None = None) -> tuple[Scale, ...]:
    """Find the scales of a spec for all of its poses, the largest first.

    The fewest scales are taken whose predicted error, RMS over the poses of each range of distance, is at most
    `NEAR_BEST` times the least that any number of them reaches there, and which leave no more poses without four dots
    of one size in view.

    Raises
    ------
    InputError
        If the objective is not the error of a pose, or no dots fit that all poses see.
    """
    candidates: list[tuple[tuple[Scale, ...], Array, float]] = []
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
            seen = seen_by(scales, spec.camera, poses)
            candidates.append((scales, _by_distance(spec, seen), float(np.mean(seen.served))))
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
    scales = tuple(_searched(scale, rng, progress) for scale in candidates[chosen][0])
    return _together(scales, spec, poses, progress)


def seen_by(scales: tuple[Scale, ...], camera: Camera, poses: PoseDistribution) -> Coverage:
    """What each pose sees of several scales."""
    points = np.concatenate([scale.points for scale in scales])
    diameters = np.concatenate([np.full(len(scale.points), scale.diameter) for scale in scales])
    return Coverage(points, diameters, poses, disks_in_view(points, diameters, camera, poses))


def values_of(coverage: Coverage, spec: Spec) -> Array:
    """Objective (P,) of each pose from the dots that it sees; inf for poses that are not served."""
    lead = OBJECTIVES[parse_goal(spec.objective).lead](Setting(spec.boundary, spec.camera, coverage.poses))
    assert isinstance(lead, PoseCovarianceObjective)
    total = dot_information(coverage, spec.camera, spec.image_noise, spec.print_sigma).sum(axis=1)
    values = np.full(len(total), np.inf)
    served = coverage.served
    values[served] = np.sqrt(np.trace(lead.weight[served] @ covariance(total[served]), axis1=-2, axis2=-1))
    return values


def _sees(boundary: Boundary, camera: Camera, poses: PoseDistribution) -> NDArray[np.bool_]:
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


def _forecasts(spec: Spec, poses: PoseDistribution, count: int) -> tuple[Scale, ...]:
    """Scales from forecasts of their layouts."""
    rooms: list[Boundary] = [spec.boundary, *map(Circle, _radii(spec, poses, count))]
    scales: list[Scale] = []
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
        scales.append(Scale(scale_spec, band, forecast.points))
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


def _by_distance(spec: Spec, seen: Coverage) -> Array:
    """Root of the mean square of the objective in each range of distance, over the poses that are served there."""
    values, means = values_of(seen, spec), []
    for _, _, mask in seen.bands():
        served = values[mask][np.isfinite(values[mask])]
        means.append(np.sqrt(np.mean(served**2)) if len(served) else np.inf)
    return np.array(means)


def _searched(scale: Scale, rng: np.random.Generator, progress: Progress | None) -> Scale:
    """The scale with the best layout found for the poses that it serves."""
    spec, setting = scale.spec, scale.setting
    objective, rough = objective_of(spec, setting), rough_of(spec, setting)
    optimum = search(objective, scale.region, spec.n, rng, spec.restarts, progress, rough)
    return replace(scale, points=optimum.points)


def _together(
    scales: tuple[Scale, ...], spec: Spec, poses: PoseDistribution, progress: Progress | None
) -> tuple[Scale, ...]:
    """Polish all scales together, so that the geometric mean of the objective over all served poses is least."""
    value = _whole_value(scales, spec, poses)
    for step in range(TURNS * len(scales)):
        if progress:
            progress("together", step, TURNS * len(scales))
        moved = _turn(scales, step % len(scales), spec, poses)
        better = _whole_value(moved, spec, poses)
        if better < value:
            scales, value = moved, better
    if progress:
        progress("together", 1, 1)
    return scales


def _whole_value(scales: tuple[Scale, ...], spec: Spec, poses: PoseDistribution) -> tuple[int, float]:
    """Number of poses that are not served, and the aggregate of the objective over the others."""
    seen = seen_by(scales, spec.camera, poses)
    served = np.flatnonzero(seen.served)
    return len(poses) - len(served), aggregated(values_of(seen, spec)[served], spec, poses.taken(served, 0))


def aggregated(values: Array, spec: Spec, poses: PoseDistribution) -> float:
    """Aggregate of values (P,), the geometric mean unless the spec says otherwise: no distance dominates it."""
    setting = Setting(spec.boundary, spec.camera, poses)
    return float(objective_of(replace(spec, aggregate=spec.aggregate or "logmean"), setting).aggregated(values, 0.0)[0])


def _turn(scales: tuple[Scale, ...], k: int, spec: Spec, poses: PoseDistribution) -> tuple[Scale, ...]:
    """Polish the dots of scale k, while the others that each pose sees add their information."""
    seen = seen_by(scales, spec.camera, poses)
    in_scale = np.concatenate([np.full(len(scale.points), i) for i, scale in enumerate(scales)]) == k
    used = np.flatnonzero(seen.served & seen.seen[:, in_scale].any(axis=1))
    kept = Coverage(seen.points, seen.diameters, poses.taken(used, 0), seen.seen[used])
    information = dot_information(kept, spec.camera, spec.image_noise, spec.print_sigma)[:, ~in_scale].sum(axis=1)
    noise = DotNoise(scales[k].diameter, spec.image_noise, spec.print_sigma)
    setting = Setting(spec.boundary, spec.camera, kept.poses, noise, Sight(kept.seen[:, in_scale], information))
    objective = objective_of(replace(spec, aggregate=spec.aggregate or "logmean"), setting)
    points, _ = polish(objective, scales[k].region, scales[k].points)
    return (*scales[:k], replace(scales[k], points=points), *scales[k + 1 :])
