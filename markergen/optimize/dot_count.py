"""Number of dots of `--n auto`, and what more dots would bring.

The error of a dot's printed place averages over the dots, and so does that of its image, which grows only slowly as
dots shrink. So more and smaller dots are better, until they cannot be detected, do not fit, or an error that moves all
of them together remains: the calibration, or the scale of the print.

Searching layouts of every number would take hours. A forecast is a layout by itself, found in milliseconds: dots are
added one by one where they help most, among the sites of a packing of dots of one diameter. Its layouts of n and n + 1
dots differ by a dot, so one pass gives all numbers, within a few percent of what the search then finds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from math import comb

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.bounds.confusion.perspective import MANY, layout_safety
from markergen.bounds.crowding import separating_gap
from markergen.bounds.dot_covariances import dot_covariances, image_jacobian, image_slopes, marker_budget
from markergen.defaults import MEASURED_SIGMA, PRINT_SIGMA
from markergen.errors import InputError, enumerated
from markergen.estimators.budget import ErrorSources
from markergen.maths.information import covariance
from markergen.maths.projection import perspective, to_camera
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.feature import RELIABLE_PIXELS
from markergen.model.goal import parse_goal
from markergen.model.planned_error import PlannedError, degrees
from markergen.model.poses import PoseDistribution
from markergen.model.spec import MOST_LOSSES, MOST_POINTS, USUAL_IMAGE, ImageNoise, Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.observation import DotNoise
from markergen.objectives.pose import PoseCovarianceObjective
from markergen.optimize.dot_size import clearance_of
from markergen.optimize.ending import Ended, limited
from markergen.optimize.exchange import TraceExchangeTable, exchange, exchange_table, places
from markergen.optimize.layouts import lattice
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, fewer, room_of
from markergen.options import Progress
from markergen.read.poses import poses_from
from markergen.units import format_length

NEAR_BEST = 1.05
"""Predicted error of the chosen number of dots, relative to the least that any number reaches."""

SHARE = 0.95
"""Share of the poses in which every dot is large enough to be detected reliably."""

WORTH = 1.1
"""Ratio of errors from which more dots are worth a word."""

POSES, POSES_AT_A_GLANCE = 48, 16
"""Approximate number of poses that represent all in a forecast."""

STEP = 1.2
"""Ratio of successive diameters tried; the error is flat about the best one."""

FEWEST_SITES = 12
"""Number of sites below which larger dots are not tried."""

ROW = 0.9
"""Distance between rows of dots that follow the edge, as a fraction of the spacing."""

HOPEFUL, QUICK = 1.2, 25
"""Ratio of a forecast to the least error up to which refining it may show it to be near, and iterations of that."""

GAP_PIXELS = 2.0
"""Gap in px between the images of dots that keeps them apart: at 1.5 px one in twenty markers of 60 was not found."""

RIM = 64
"""Number of places on the outline at which sizes of images are measured."""

FINE = 8
"""Positions per spacing along a row at which a dot is tried."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """A layout of n dots found at a glance.

    Attributes
    ----------
    points : array (n, 2), m
    diameter : float, m
    gap : float, m
        Smallest gap between dots.
    value : float
        Objective with all error sources, over the poses of the forecast.
    """

    points: Array
    diameter: float
    gap: float
    value: float

    @property
    def n(self) -> int:
        """Number of dots."""
        return len(self.points)


def least_sizes(
    boundary: Boundary,
    camera: Camera,
    poses: PoseDistribution,
    image: ImageNoise = USUAL_IMAGE,
    share: float = SHARE,
) -> tuple[float, float]:
    """Diameter and gap of dots in m, whole tenths of a mm, that are large enough anywhere in 95 % of the poses.

    With A of `image_slopes`, the mean diameter of an image is d sqrt(|det A|), the root of long times short axis; for
    gaps see `separating_gap`, which also raises the error.
    """
    rim = boundary.rim(RIM)
    gap = separating_gap(rim, camera, poses, image, GAP_PIXELS, 1 - share)
    slopes = np.nan_to_num(image_slopes(image_jacobian(rim, camera, poses), poses))
    area = np.sort(np.sqrt(np.abs(np.linalg.det(slopes))).min(axis=1))[int((1 - share) * len(poses) + 1e-9)]
    return float(np.ceil(RELIABLE_PIXELS * image.size_factor / area * 1e4 - 1e-6) / 1e4), gap


@dataclass(frozen=True)
class Choice:
    """A spec whose number and size of dots are settled, and a line that explains them."""

    spec: Spec
    reason: str


def sources_of(spec: Spec) -> ErrorSources:
    """Error sources of a spec: its print, the scale of that, and its calibration."""
    covariance = None if spec.camera_covariance is None else np.array(spec.camera_covariance)
    return ErrorSources(spec.print_sigma, covariance, scale_sigma=spec.scale_sigma)


def usual_sources(spec: Spec) -> ErrorSources:
    """`sources_of` a spec, with the usual print where it has none."""
    sources = sources_of(spec)
    return sources if sources.print_sigma else replace(sources, print_sigma=PRINT_SIGMA)


def planned_error(points: Array, diameter: float, spec: Spec, setting: Setting) -> PlannedError:
    """Error to plan with of dots of one diameter at points (n, 2 or 3), in m, with the errors of `usual_sources`."""
    sources = usual_sources(spec)
    budgets = [
        marker_budget(points, diameter, setting, spec.image_noise, errors)
        for errors in (sources, replace(sources, print_sigma=MEASURED_SIGMA, scale_sigma=0.0))
    ]
    rotation, measured = (float(np.sqrt(np.mean(budget.rotation_deg["total"] ** 2))) for budget in budgets)
    translation = float(np.sqrt(np.mean(budgets[0].translation["total"] ** 2)))
    gains = sources.print_sigma > MEASURED_SIGMA
    farthest = float(setting.poses.distance.max())
    return PlannedError(rotation, 1e3 * translation, farthest, measured if gains else None, sources.exact)


def choose_count(spec: Spec, progress: Progress | None = None) -> Choice:
    """Settle the number of dots, and unless the spec has one their diameter.

    The fewest dots are chosen whose forecast is within `NEAR_BEST` of the least of up to 200 dots. All are at least
    `RELIABLE_PIXELS` large in `SHARE` of the poses, and labels of all but the most dots tried are safe.

    Raises
    ------
    InputError
        If the objective is not the error of a pose, or no four dots fit that are large enough.
    """
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera)
    forecaster = Forecaster(spec, poses, sources_of(spec))
    forecasts = forecaster.by_count(progress)
    with limited(None):
        least = forecaster.refined(min(forecasts.values(), key=lambda forecast: forecast.value))
    # Forecasts are above what polishing finds, the more so the more freedom the dots have.
    low, high = next(n for n, forecast in forecasts.items() if forecast.value <= HOPEFUL * least.value), least.n
    chosen = least
    while low < high:
        if progress:
            progress("refinement", least.n - high + low, least.n)
        try:
            tried = forecaster.refined(forecasts[(low + high) // 2])
        except Ended:
            break
        # The nearest rival labelings of many dots exchange two neighbors: images that do not run together decide these.
        setting = Setting(spec.boundary, spec.camera, poses)
        if tried.value <= NEAR_BEST * least.value and (
            tried.n > MANY or layout_safety(tried.points, setting, not spec.asymmetric).is_decided
        ):
            high, chosen = tried.n, tried
        else:
            low = tried.n + 1
    if progress:
        progress("refinement", 1, 1)
    settled = replace(spec, n=chosen.n, dot=chosen.diameter, gap=chosen.gap)
    asked = spec.dot == chosen.diameter
    pixels = RELIABLE_PIXELS * spec.image_noise.size_factor
    large = "as asked" if asked else f"{pixels:.3g} px or more in {100 * SHARE:g} % of the poses"
    reason = f"{format_length(chosen.diameter)}, {large}; with a print good to {format_length(spec.print_sigma)}, "
    reason += f"{chosen.n} are the fewest whose predicted error is within {100 * (NEAR_BEST - 1):.0f} % of the least, "
    return Choice(settled, f"{reason}that of {least.n}{common(spec)}")


def common(spec: Spec) -> str:
    """Errors that are the same for all dots and taken as 0, in words."""
    missing = ["scale (--scale-sigma)"] if not spec.scale_sigma else []
    missing += ["calibration (--camera-covariance)"] if spec.camera_covariance is None else []
    return f"; {' and '.join(missing)} exact" if missing else ""


def outlook(points: Array, diameter: float, spec: Spec, setting: Setting, sources: ErrorSources) -> str:
    """What more dots of a flat marker would bring, in a line or two; empty if it is not worth a word.

    Parameters
    ----------
    points : array (n, 2), m
    diameter : float, m
    spec : Spec
        Room and objective; the pose's if that is no error of a pose.
    setting : Setting
        Camera and poses.
    """

    def error(points: Array, diameter: float) -> str:
        budget = marker_budget(points, diameter, setting, spec.image_noise, sources).rotation_deg["total"]
        return degrees(float(np.sqrt(np.mean(budget**2))))

    try:
        forecaster = at_a_glance(spec, setting.poses, sources)
        forecasts = forecaster.by_count(most=1)
    except InputError:
        return ""
    now = forecaster.value(points, diameter)
    more = {n: forecast for n, forecast in forecasts.items() if n > len(points) and forecast.value < now / WORTH}
    if not more:
        return ""
    least = min(forecast.value for forecast in more.values())
    best = next(forecast for forecast in more.values() if forecast.value <= NEAR_BEST * least)
    text, half = "", next((forecast for forecast in more.values() if forecast.value <= now / 2), None)
    if half and half.n < best.n:
        size = format_length(half.diameter)
        text = f"half the error: {half.n} dots of {size}, {error(half.points, half.diameter)}; "
    return f"{text}about the least: {best.n} dots (--n auto), {error(best.points, best.diameter)}"


def at_a_glance(spec: Spec, poses: PoseDistribution, sources: ErrorSources) -> "Forecaster":
    """Forecaster of other numbers of dots for a spec, from a few poses; raises InputError as `Forecaster`."""
    usual = issubclass(OBJECTIVES[parse_goal(spec.objective).lead], PoseCovarianceObjective)
    objective = spec.objective if usual else "pose"
    asked = replace(spec, points=(), dot="auto", noise_model="image", objective=objective, aggregate="")
    return Forecaster(asked, poses, sources, count=POSES_AT_A_GLANCE)


class Forecaster:
    """Forecasts for a spec, whose own number of dots does not matter.

    Parameters
    ----------
    seen : PoseDistribution
        Poses that see the whole marker, in which dots are to be detected.
    judged : PoseDistribution or None
        Poses of the objective, if other ones.
    count : int
        Approximate number of poses that represent them.

    Raises
    ------
    InputError
        If the objective is not the error of a pose.
    """

    def __init__(
        self,
        spec: Spec,
        seen: PoseDistribution,
        sources: ErrorSources,
        judged: PoseDistribution | None = None,
        count: int = POSES,
    ) -> None:
        self.spec, self.sources, self.room = spec, sources, room_of(spec)
        self.setting = Setting(spec.boundary, spec.camera, fewer(judged or seen, count))
        self.least, gap = least_sizes(spec.boundary, spec.camera, seen, spec.image_noise)
        self.gap = spec.gap or gap
        self.most = max(n for n in range(5, MOST_POINTS + 1) if comb(n, spec.survive) <= MOST_LOSSES)
        if not issubclass(OBJECTIVES[parse_goal(spec.objective).lead], PoseCovarianceObjective):
            names = (name for name in OBJECTIVES if issubclass(OBJECTIVES[name], PoseCovarianceObjective))
            raise InputError(
                "an objective that is the error of a pose, for the number of dots",
                f"objective={spec.objective!r}",
                f"use --objective {enumerated(names)}, or give --n",
            )

    def diameters(self) -> Iterator[float]:
        """Diameters in m to try: the spec's if it has one, else the least and larger ones while many dots fit."""
        if isinstance(self.spec.dot, float):
            yield self.spec.dot
            return
        diameter = self.least
        yield diameter
        while len(self._lattice(self._region(diameter))) >= FEWEST_SITES:
            diameter = round(diameter * STEP, 4)
            yield diameter

    def by_count(self, progress: Progress | None = None, most: int | None = None) -> dict[int, Forecast]:
        """Best forecast by number of dots, from 4 to as many as fit; of the `most` smallest diameters, if given.

        Raises
        ------
        InputError
            If there is no room for four.
        """
        best: dict[int, Forecast] = {}
        diameters = list(islice(self.diameters(), most))
        for done, diameter in enumerate(diameters):
            if progress:
                progress("number of dots", done, len(diameters))
            region = self._region(diameter)
            for sites in (rows(region), self._lattice(region)):
                if len(sites) < 4:
                    continue
                order = self._order(sites, diameter)
                for n, value in enumerate(self._values(sites[order], diameter), 4):
                    if n not in best or value < best[n].value:
                        best[n] = Forecast(sites[order[:n]], diameter, self.gap, float(value))
        if progress:
            progress("number of dots", 1, 1)
        if not best:
            raise InputError(
                f"room for 4 dots of {format_length(self.least)}, which {100 * SHARE:g} % of the poses see well",
                str(self.room),
                "use a larger marker, poses nearer by or a better camera, or give --n and --dot",
            )
        return dict(sorted(best.items()))

    def refined(self, forecast: Forecast) -> Forecast:
        """Forecast with dots moved one by one to better places, and polished; itself if that is no better."""
        objective, region = self._objective(forecast.diameter), self._region(forecast.diameter)
        table = exchange_table(objective, np.concatenate([forecast.points, places(region, forecast.n)]))
        layout = table.places[exchange(table, region.spacing, np.arange(forecast.n))]
        polished, _ = polish(objective, region, layout, QUICK)
        layouts = [candidate for candidate in (layout, polished) if region.holds(candidate[None])[0]]
        forecasts = [
            replace(forecast, points=points, value=self.value(points, forecast.diameter)) for points in layouts
        ]
        return min([forecast, *forecasts], key=lambda candidate: candidate.value)

    def value(self, points: Array, diameter: float) -> float:
        """Objective with all sources of dots of one diameter in m at points (n, 2) in m."""
        return float(self._values(points, diameter)[-1])

    def _region(self, diameter: float) -> FeasibleRegion:
        return FeasibleRegion(self.room, diameter, clearance_of(self.spec, diameter), self.gap)

    def _lattice(self, region: FeasibleRegion) -> Array:
        return lattice(region.boundary, region.diameter, region.clearance, region.gap)

    def _objective(self, diameter: float) -> PoseCovarianceObjective:
        noise = DotNoise(diameter, self.spec.image_noise, self.sources.print_sigma)
        objective = OBJECTIVES[parse_goal(self.spec.objective).lead](
            replace(self.setting, noise=noise), self.spec.aggregate
        )
        assert isinstance(objective, PoseCovarianceObjective)
        return objective

    def _order(self, sites: Array, diameter: float) -> NDArray[np.intp]:
        """Order (m,) in which dots are added at sites (C, 2) in m, each where it helps most."""
        table = TraceExchangeTable(self._objective(diameter), sites)
        every, free, order = np.arange(len(sites)), np.ones(len(sites), dtype=bool), list[int]()
        for _ in range(min(self.most, len(sites))):
            values = table.values(np.array(order, dtype=np.intp), every)
            order.append(int(np.argmin(np.where(free, values, np.inf))))
            free[order[-1]] = False
        return np.array(order, dtype=np.intp)

    def _values(self, points: Array, diameter: float) -> Array:
        """Objective (m - 3,) with all sources, for the first 4, 5, ..., m dots at points (m, 2) in m."""
        objective, poses, camera = self._objective(diameter), self.setting.poses, self.spec.camera
        jacobian = image_jacobian(points, camera, poses)
        slopes = image_slopes(jacobian, poses)
        spread = dot_covariances(slopes, diameter, self.spec.image_noise, self.sources.print_sigma)
        weighed = np.linalg.solve(spread, jacobian).swapaxes(-1, -2)
        together = [slopes @ self.sources.scaled(points)]
        if self.sources.camera_covariance is not None:
            # A Cholesky factor does not exist where a parameter is exact.
            size, axes = np.linalg.eigh(self.sources.camera_covariance)
            normalized = perspective(to_camera(points, poses.rotation, poses.translation))
            together.append(camera.parameter_jacobian(normalized) @ (axes * np.sqrt(np.maximum(size, 0.0))))
        moved = np.concatenate(together, axis=-1)
        pose_covariance = covariance(np.cumsum(weighed @ jacobian, axis=1)[:, 3:])
        # Four dots in one line determine no pose: their covariance is infinite.
        with np.errstate(invalid="ignore"):
            shared = pose_covariance @ np.cumsum(weighed @ moved, axis=1)[:, 3:]
            variance = np.trace(
                objective.weight[:, None] @ (pose_covariance + shared @ shared.swapaxes(-1, -2)), axis1=-2, axis2=-1
            )
            values = np.sqrt(np.where(variance > 0, variance, np.inf)).T
            return np.nan_to_num(objective.aggregated(values, 0.0)[0], nan=np.inf)


def rows(region: FeasibleRegion) -> Array:
    """Places (C, 2) in m of dots in rows that follow the edge of a region, from the outside in."""
    boundary, spacing = region.boundary, region.spacing
    chosen = np.zeros((0, 2))
    inset = region.inset
    while inset < boundary.radius:
        around = sum(float(np.linalg.norm(np.diff(ring, axis=0), axis=-1).sum()) for ring in boundary.outlines())
        edge = boundary.project(boundary.rim(int(FINE * around / spacing) + FINE), inset)
        before = len(chosen)
        for place in edge[np.abs(boundary.depth(edge) - inset) < 1e-3 * spacing]:
            if not len(chosen) or np.min(np.sum((chosen - place) ** 2, axis=-1)) >= spacing**2:
                chosen = np.append(chosen, place[None], axis=0)
        if len(chosen) == before:
            break
        inset += ROW * spacing
    return chosen[boundary.depth(chosen) >= region.inset - 1e-12]
