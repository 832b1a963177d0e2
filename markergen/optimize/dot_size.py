"""Choice of the dot diameter: large enough for detection, as far as the dots fit, or of least predicted error.

For `--dot auto` the predicted error is minimized. Larger dots are measured better, with an error that falls with the
square root of the diameter; but they must stay farther inside the boundary and farther apart, which shortens the lever
arm of the pose measurement. The print error does not depend on the dot size, so only the lever arm matters for its
effect: the larger the print error, the smaller the best dots.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, enumerated
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.goal import parse_goal
from markergen.model.poses import SEEN, PoseDistribution, silhouette, visibility
from markergen.model.spec import USUAL_IMAGE, ImageNoise, Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.observation import DotNoise
from markergen.optimize.ending import Ended, limited
from markergen.optimize.layouts import count_that_fit, fitting, largest_diameter, pack
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, objective_of, room_of, rough_of
from markergen.optimize.search import search
from markergen.options import Progress
from markergen.units import format_length

PIXELS = 8.0
"""Desired minimum extent of the dots' images, in px."""

PERCENTILE = 94.0
"""Percentage of the poses in which the dots should have that extent."""

ROOM = 0.9
"""Maximum fraction of the diameter that just fits; the optimizer needs room to move the dots."""

FEWEST_PIXELS, FEWEST_PIXELS_LONG = 4.0, 6.0
"""Extents in px along the short and long axis of a dot's image for reliable detection, also of the key ring."""

CLEARANCE = 0.1
"""Default clearance as a fraction of the diameter."""

WIDE = 4.0
"""Ratio of the farthest to the nearest pose from which on dots may have several sizes."""

ALL_BUT = 0.005
"""Share of the poses that need not be served, or see the marker whole."""

MEASURABLE = 1e-4
"""Diameters in m are whole multiples of it: tenths of a millimeter can be measured on the sheet."""

SCANNED = 8
"""Number of diameters tried before the best is refined: the error can have a local minimum where dots begin to
crowd."""

RESTARTS, STEPS = 4, 15
"""Number of random starts for the first diameter, and of polish steps from one diameter's layout to the next."""

EXPECTED = SCANNED + 10
"""Approximate total number of diameters tried, for the progress display."""


@dataclass(frozen=True)
class DotSize:
    """Diameter and clearance in m, a line that explains the choice, and a warning about it, if any."""

    diameter: float
    clearance: float
    reason: str
    warning: str = ""

    def region(self, spec: Spec) -> FeasibleRegion:
        """Where a spec allows these dots."""
        return FeasibleRegion(room_of(spec), self.diameter, self.clearance, spec.gap)

    def setting(self, spec: Spec, poses: PoseDistribution) -> Setting:
        """Setting of a spec with these dots: the noise of their images, if the spec asks for it."""
        is_noisy = spec.noise_model == "image"
        noise = DotNoise(self.diameter, spec.image_noise, spec.print_sigma) if is_noisy else None
        return Setting(spec.boundary, spec.camera, poses, noise)


def clearance_of(spec: Spec, diameter: float) -> float:
    """Clearance in m according to the spec for dots of the given diameter."""
    return CLEARANCE * diameter if spec.clearance is None else spec.clearance


def needs_scales(spec: Spec, poses: PoseDistribution) -> bool:
    """Whether the poses differ widely in distance and do not all see the marker whole, and dots may have any size."""
    special = spec.relief or spec.target or spec.tag or spec.asymmetric or spec.survive or isinstance(spec.dot, float)
    if special or poses.distance.max() <= WIDE * poses.distance.min():
        return False
    seen = visibility(silhouette(spec.boundary), poses.rotation, poses.translation, spec.camera)
    return bool(np.mean(seen != SEEN) > ALL_BUT)


def choose_dots(spec: Spec, poses: PoseDistribution, progress: Progress | None = None) -> DotSize:
    """Size the dots of a spec for the poses that see the marker.

    Raises
    ------
    InputError
        If fewer than n dots fit with the spec's diameter or clearance; the message gives the number that fit.
    """
    if spec.dot == "auto":
        size = best_dots(spec, poses, progress)
    elif spec.dot is None:
        size = _default(spec, poses)
    else:
        clearance = clearance_of(spec, spec.dot)
        size = DotSize(
            spec.dot, clearance, f"{format_length(spec.dot)}, as asked, {pixels_in_words(spec.dot, spec, poses)}"
        )
    if spec.gap:
        size = replace(size, reason=f"{size.reason}, {format_length(spec.gap)} or more apart")
    if size.diameter > 0 or size.clearance > 0:
        _refuse_what_does_not_fit(spec, size)
    return size


def size_given(spec: Spec, poses: PoseDistribution) -> DotSize:
    """Size the dots of a spec with points: as asked, or large enough for the camera as far as they fit."""
    asked = spec.dot if isinstance(spec.dot, float) else None
    wanted = wanted_diameter(spec.camera, poses, spec.image_noise) if asked is None else asked
    diameter = wanted if asked is not None else max(MEASURABLE, min(wanted, _largest_at_points(spec)))
    reason = "as asked" if asked is not None else "for the camera" if diameter == wanted else "the largest that fits"
    description = f"{format_length(diameter)}, {reason}, {pixels_in_words(diameter, spec, poses)}"
    return DotSize(diameter, clearance_of(spec, diameter), description)


def _largest_at_points(spec: Spec) -> float:
    """Largest diameter in m, a whole tenth of a mm, that the spec's points leave room for; 0 or less if none."""
    points = np.array(spec.points)[:, :2]
    closest = np.linalg.norm(points[:, None] - points, axis=-1)[np.triu_indices(len(points), 1)].min()
    depth = room_of(spec).depth(points[None]).min()
    if spec.clearance is None:
        most = min(closest / (1 + CLEARANCE), depth / (0.5 + CLEARANCE))
    else:
        most = min(closest - spec.clearance, 2 * (depth - spec.clearance))
    return float(np.floor(min(most, closest - spec.gap) / MEASURABLE + 1e-6) * MEASURABLE)


def wanted_pixels(image: ImageNoise) -> float:
    """Extent in px that dots should have along their short axis: 8 px at the usual blur.

    >>> wanted_pixels(ImageNoise()), wanted_pixels(ImageNoise(blur_px=2.0))
    (8.0, 12.7)
    """
    return round(PIXELS * image.size_factor, 1)


def wanted_diameter(camera: Camera, poses: PoseDistribution, image: ImageNoise = USUAL_IMAGE) -> float:
    """Diameter in m, a whole mm, whose image is `wanted_pixels` along its short axis in 94 % of the poses.

    d = 8 px z / (f cos tilt) at the marker's origin, f the geometric mean of the focal lengths.
    """
    focal = np.sqrt(camera.fx * camera.fy)
    diameters = wanted_pixels(image) * poses.translation[:, 2] / (focal * poses.cos_tilt)
    return float(np.ceil(np.percentile(diameters, PERCENTILE) * 1e3 - 1e-6) / 1e3)


def largest_that_leaves_room(spec: Spec, enough: float = np.inf) -> float:
    """Largest diameter in m, a whole tenth of a mm, that leaves the optimizer room for n dots, or one that is enough.

    Raises
    ------
    InputError
        If it is below 0.1 mm.
    """
    fits = ROOM * largest_diameter(room_of(spec), spec.n, spec.clearance, spec.gap, (enough + MEASURABLE) / ROOM)
    # Whole tenths of a millimeter can be measured on the sheet.
    diameter = float(np.floor(fits * 1e4) / 1e4)
    if not diameter:
        distances = {name: length for name in ("clearance", "gap") if (length := getattr(spec, name))}
        raise InputError(
            "room for dots of 0.1 mm and more",
            f"{spec.n} dots in a {room_of(spec)}"
            + "".join(f" with a {name} of {format_length(length)}" for name, length in distances.items()),
            enumerated(["use a larger marker", "a smaller --n", *(f"a smaller --{name}" for name in distances)], "or"),
        )
    return diameter


def smallest_detectable(camera: Camera, poses: PoseDistribution, image: ImageNoise = USUAL_IMAGE) -> float:
    """Diameter in m, a whole tenth of a mm, whose image is 4 px wide and 6 px long or more in 94 % of the poses.

    That is at the usual blur; in a blurred image it is larger by `ImageNoise.size_factor`.
    """
    focal = np.sqrt(camera.fx * camera.fy)
    depth = poses.translation[:, 2]
    needed = np.maximum(FEWEST_PIXELS * depth / poses.cos_tilt, FEWEST_PIXELS_LONG * depth) / focal * image.size_factor
    return float(np.ceil(np.percentile(needed, PERCENTILE) * 1e4 - 1e-6) / 1e4)


def _default(spec: Spec, poses: PoseDistribution) -> DotSize:
    wanted = wanted_diameter(spec.camera, poses, spec.image_noise)
    diameter = largest_that_leaves_room(spec, wanted)
    pixels = f"{wanted_pixels(spec.image_noise):g} px"
    if wanted <= diameter:
        reason = f"{format_length(wanted)}: its image is at least {pixels} across in {PERCENTILE:g} % of the poses"
        return DotSize(wanted, clearance_of(spec, wanted), reason)
    reason = (
        f"{format_length(diameter)}, {100 * ROOM:g} % of the largest at which {spec.n} dots fit; "
        f"{pixels} would need {format_length(wanted)}, this leaves {pixels_in_words(diameter, spec, poses)}"
    )
    return DotSize(diameter, clearance_of(spec, diameter), reason)


def pixels_across(diameter: float, camera: Camera, poses: PoseDistribution, mean: bool = False) -> float:
    """Extent in px of a dot's image along its short axis, reached in 94 % of the poses (see `wanted_diameter`).

    If `mean`, the root of long times short axis instead.
    """
    focal = np.sqrt(camera.fx * camera.fy)
    shortening = np.sqrt(poses.cos_tilt) if mean else poses.cos_tilt
    return float(diameter * focal / np.percentile(poses.translation[:, 2] / shortening, PERCENTILE))


def pixels_in_words(diameter: float, spec: Spec, poses: PoseDistribution) -> str:
    """Extent in px of a dot's image, as `pixels_across`, in words."""
    return f"{pixels_across(diameter, spec.camera, poses):.1f} px"


def _refuse_what_does_not_fit(spec: Spec, size: DotSize) -> None:
    room = room_of(spec)
    if pack(room, spec.n, size.clearance, spec.gap, size.diameter)[1] >= size.diameter:
        return
    # The search relies on the same packing: where it is stuck, it starts from it.
    if fitting(FeasibleRegion(room, size.diameter, size.clearance, spec.gap), spec.n) is not None:
        return
    fit = count_that_fit(room, size.diameter, size.clearance, spec.n - 1, spec.gap)
    apart = f" and a gap of {format_length(spec.gap)}" if spec.gap > size.clearance else ""
    largest = np.floor(ROOM * largest_diameter(room, spec.n, spec.clearance, spec.gap) * 1e4) / 10
    raise InputError(
        f"{spec.n} dots that fit in a {room}",
        f"dots of {format_length(size.diameter)} with {format_length(size.clearance)} clearance{apart}, of which {fit} "
        "fit",
        f"use {f'--dot {largest:g}mm or less, ' if largest else ''}a larger marker, or a smaller --n",
    )


def best_dots(spec: Spec, poses: PoseDistribution, progress: Progress | None = None) -> DotSize:
    """Diameter, a whole tenth of a mm, at which the spec's objective is least for image noise and print error.

    The layout is optimized for every diameter, by a polish from the layout of the nearest diameter tried before.

    Raises
    ------
    InputError
        If there is no room for n dots.
    """
    # Of several criteria, the first one decides: a regular polygon to refer to need not fit at every diameter.
    spec = replace(spec, objective=parse_goal(spec.objective).lead)
    room = largest_that_leaves_room(spec)
    detectable = smallest_detectable(spec.camera, poses, spec.image_noise)
    least = min(detectable, room)
    predicted = _Prediction(spec, Setting(spec.boundary, spec.camera, poses), progress)
    candidates = [least, room]
    if least < room:
        scan = np.geomspace(least, room, SCANNED)
        try:
            best = int(np.argmin([predicted(float(diameter)) for diameter in scan]))
            minimum = _minimum(predicted, scan[max(best - 1, 0)], scan[min(best + 1, SCANNED - 1)])
            candidates.append(float(np.clip(round(minimum, 4), least, room)))
        except Ended:
            candidates = predicted.tried
    # The search never reaches the ends of its interval, so they are evaluated separately.
    with limited(None):
        diameter = min(candidates, key=predicted)
    value = predicted(diameter)
    predicted.done()
    reason, warning = _reason(spec, diameter, value, detectable, room), _warning(spec, predicted, diameter)
    return DotSize(diameter, clearance_of(spec, diameter), reason, warning)


class _Prediction:
    """The objective as a function of the diameter, at the best layout found, which is kept as a start for the next."""

    def __init__(self, spec: Spec, setting: Setting, progress: Progress | None) -> None:
        self._spec, self._setting, self._progress = spec, setting, progress
        self._found: dict[float, tuple[Array, float]] = {}

    def __call__(self, diameter: float) -> float:
        if diameter in self._found:
            return self._found[diameter][1]
        if self._progress:
            self._progress("dot size", min(len(self._found), EXPECTED - 1), EXPECTED)
        spec = self._spec
        setting = self._with(diameter, spec.print_sigma)
        objective = objective_of(spec, setting)
        region = FeasibleRegion(room_of(spec), diameter, clearance_of(spec, diameter), spec.gap)
        if self._found:
            points, value = polish(objective, region, self._start(region), STEPS)
        else:
            rng, rough = np.random.default_rng(spec.seed), rough_of(spec, setting)
            optimum = search(objective, region, spec.n, rng, RESTARTS, rough=rough)
            points, value = optimum.points, optimum.value
        self._found[diameter] = points, value
        return value

    @property
    def tried(self) -> list[float]:
        """Diameters tried so far; that of the scan's first layout is one of them."""
        return list(self._found)

    def by_diameter(self, print_sigma: float) -> dict[float, float]:
        """Values of the layouts found, by diameter, for a print error of print_sigma in m."""
        return {
            diameter: float(objective_of(self._spec, self._with(diameter, print_sigma))(points[None])[0])
            for diameter, (points, _) in self._found.items()
        }

    def _with(self, diameter: float, print_sigma: float) -> Setting:
        return replace(self._setting, noise=DotNoise(diameter, self._spec.image_noise, print_sigma))

    def _start(self, region: FeasibleRegion) -> Array:
        """Layout (n, 2) of the nearest diameter tried before, scaled with the available room."""
        nearest = min(self._found, key=lambda diameter: abs(diameter - region.diameter))
        before = FeasibleRegion(region.boundary, nearest, clearance_of(self._spec, nearest))
        scale = (region.boundary.radius - region.inset) / (region.boundary.radius - before.inset)
        start = region.project((self._found[nearest][0] * scale)[None])
        if region.holds(start)[0]:
            return start[0]
        # Jammed: the layout of the densest packing is feasible for any diameter that fits.
        packed = fitting(region, self._spec.n) if self._spec.gap else None
        return pack(region.boundary, self._spec.n, self._spec.clearance)[0] if packed is None else packed

    def done(self) -> None:
        if self._progress:
            self._progress("dot size", EXPECTED, EXPECTED)


def _minimum(predicted: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import minimize_scalar

    # The minimum is flat: an error of 1 % costs nothing, so 0.1 % is fine enough.
    minimum = minimize_scalar(
        lambda log_diameter: np.log(predicted(float(np.exp(log_diameter)))),
        bounds=(np.log(low), np.log(high)),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return float(np.exp(minimum.x))


def _reason(spec: Spec, diameter: float, value: float, detectable: float, room: float) -> str:
    error, size = error_words(spec, value), format_length(diameter)
    sources = f"image noise and a print error of {format_length(spec.print_sigma)}"
    error += f" for {sources if spec.print_sigma else 'image noise alone'}"
    if diameter >= room:
        short = f"; {format_length(detectable)} would be detected well" if detectable > room else ""
        most = f"{100 * ROOM:g} % of the largest at which {spec.n} dots fit"
        return f"{size}, {most}, with a predicted error of {error}{short}"
    if diameter <= detectable:
        wide, long = (pixels * spec.image_noise.size_factor for pixels in (FEWEST_PIXELS, FEWEST_PIXELS_LONG))
        return (
            f"{size}, the smallest whose image is {wide:.3g} px wide and {long:.3g} px long in "
            f"{PERCENTILE:g} % of the poses; the predicted error of {error} would be less with smaller ones"
        )
    return (
        f"{size}, with the least predicted error of {error}: larger ones are measured better, but sit closer together"
    )


def _warning(spec: Spec, predicted: _Prediction, diameter: float) -> str:
    """Warning about a size whose gain in the image is outweighed by the usual print error, which the spec omits."""
    if spec.print_sigma:
        return ""
    usual = ErrorSources.print_sigma
    image, total = predicted.by_diameter(0.0), predicted.by_diameter(usual)
    better = min(total, key=lambda candidate: total[candidate])
    if total[diameter] - total[better] <= image[better] - image[diameter]:
        return ""
    return (
        f"a print error of {format_length(usual)} would outweigh what dots of this size gain "
        f"({error_words(spec, total[diameter])} instead of {error_words(spec, total[better])} for "
        f"{format_length(better)}): "
        f"use --print-sigma {format_length(usual).replace(' ', '')}"
    )


def error_words(spec: Spec, value: float) -> str:
    """Value of the objective, or of the first of several, with its unit."""
    unit = OBJECTIVES[parse_goal(spec.objective).lead].unit
    return format_length(float(f"{value:.3g}")) if unit == "m" else f"{value:.3g} {unit}"
