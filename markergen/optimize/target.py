"""The smallest marker and the fewest dots that reach a target, such as 0.1 deg RMS at 1.5 m.

The error is that of all sources over the poses moved to the target's distance, flips included. First order predicts no
flips: where the pose is hardly determined, as from the front and far away, noisy dots are drawn and it is estimated.
"""

from dataclasses import replace

import numpy as np

from markergen.arrays import Array
from markergen.bounds.dot_covariances import dot_covariances, image_jacobian, image_slopes, marker_budget
from markergen.errors import InputError
from markergen.estimators import Correspondences
from markergen.estimators.budget import ErrorSources
from markergen.estimators.lm import LM
from markergen.maths.information import flip_separation, rotation_bound
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import angle_between
from markergen.model.boundary import Circle
from markergen.model.goal import Target, parse_target
from markergen.model.poses import PoseDistribution
from markergen.model.spec import AUTO, ImageNoise, Spec
from markergen.objectives import Setting
from markergen.optimize.dot_count import (
    Choice,
    Forecast,
    Forecaster,
    choose_count,
    common,
    sources_of,
)
from markergen.options import Progress
from markergen.read.poses import poses_from
from markergen.units import format_length

FLIP_SIGMAS, LARGEST_DEG = 6.0, 1.0
"""First order ends where the mirrored pose is nearer than this many sigma, or the error in degrees is larger."""

TRIALS, AT_MOST = 64, 3000
"""Number of noisy estimates for each such pose, and in all."""

RADII, TIGHTER = 8, 4
"""Numbers of radii tried, and of times that the target is tightened where first order promised too much."""

SMALL_PRINT = 2e-5
"""Print error in m below which larger dots than necessary can be better."""

REMEDIES = {
    "image": "use a camera with more pixels or a longer focal length, or come nearer",
    "print": "print better (--print-sigma, --scale-sigma), allow a larger marker, or come nearer",
    "camera": "calibrate again (--camera-covariance), or come nearer",
}
"""What to do against each source of error."""


def settled(spec: Spec, progress: Progress | None = None) -> Choice | None:
    """Settle what a spec leaves open: `reach` its target, or `choose_count`; None if it leaves nothing open.

    Raises
    ------
    InputError
        As these do.
    """
    if spec.target:
        return reach(spec, progress)
    return choose_count(spec, progress) if spec.n == AUTO else None


def reach(spec: Spec, progress: Progress | None = None) -> Choice:
    """Settle radius, number and size of dots so that the spec's target is reached.

    A disk without keep-outs, tag and holes shrinks to the smallest radius in whole mm; other rooms stay as they are.
    Within it, the fewest dots are chosen.

    Raises
    ------
    InputError
        If up to 200 dots in the whole room do not reach it; the message says which source of error prevents it.
    """
    target = parse_target(spec.target)
    bound, whole = target.error, spec
    shrinks = isinstance(spec.boundary, Circle) and not spec.blocked
    for _ in range(TIGHTER + 1):
        chosen, spec = _smallest(whole, target, bound, progress) if shrinks else (_fewest(whole, target, bound), whole)
        if chosen is None:
            break
        chosen = _refined(chosen, spec, target)
        error = sampled_error(chosen, spec, target)
        if error <= target.error:
            return _choice(chosen, spec, target, error, shrinks)
        bound *= target.error / error
    # The least of all forecasts may be above the target, and what refining makes of it below.
    best = _refined(min(_forecasts(whole, target).values(), key=lambda forecast: forecast.value), whole, target)
    error = sampled_error(best, whole, target)
    if error > target.error:
        raise _unreachable(best, error, whole, target)
    return _choice(best, whole, target, error, shrinks)


def _choice(chosen: Forecast, spec: Spec, target: Target, error: float, shrinks: bool) -> Choice:
    chosen_spec = replace(
        _asked(spec, target), n=chosen.n, dot=chosen.diameter, gap=chosen.gap, target="", aggregate=spec.aggregate
    )
    reached = f"{target.words(error)} at {format_length(target.distance)}"
    rest = "the smallest disk and " if shrinks else ""
    reason = f"{format_length(chosen.diameter)}, {rest}the fewest that reach {target}: predicted {reached}"
    return Choice(chosen_spec, f"{reason}, with a print good to {format_length(spec.print_sigma)}{common(spec)}")


def at_distance(poses: PoseDistribution, distance: float) -> PoseDistribution:
    """Poses moved along their lines of sight to a distance in m from the marker's origin."""
    if poses.placing is not None:
        return poses.placing.at_distance(distance)
    moved = poses.translation * (distance / poses.distance)[:, None]
    every = np.round(np.concatenate([poses.rotation.reshape(-1, 9), moved], axis=1), 9)
    kept = np.sort(np.unique(every, axis=0, return_index=True)[1])
    return PoseDistribution(poses.name, poses.rotation[kept], moved[kept])


def sampled_error(chosen: Forecast, spec: Spec, target: Target) -> float:
    """RMS error of all sources at the target's distance: to first order, and sampled where that ends."""
    poses = _judged(spec, target)
    setting, sources = Setting(spec.boundary, spec.camera, poses), sources_of(spec)
    total = marker_budget(chosen.points, chosen.diameter, setting, spec.image_noise, sources).total
    deg = np.rad2deg(rotation_bound(total))
    error = deg if target.angle else np.sqrt(np.trace(total[:, 3:, 3:], axis1=-2, axis2=-1))
    unsure = (deg > LARGEST_DEG) | (flip_separation(poses.rotation, poses.translation, total) < FLIP_SIGMAS)
    square, rng = error**2, np.random.default_rng(spec.seed)
    for pose in np.flatnonzero(unsure):
        trials = max(1, min(TRIALS, AT_MOST // int(unsure.sum())))
        pose_alone = poses.taken(np.array([pose]), 0)
        pixels = _noisy_images(chosen, replace(setting, poses=pose_alone), spec.image_noise, sources, trials, rng)
        rotation, translation = LM.solve(Correspondences.from_distorted(chosen.points, pixels, spec.camera)).best
        if target.angle:
            off = np.rad2deg(angle_between(rotation, pose_alone.rotation))
        else:
            off = np.linalg.norm(translation - pose_alone.translation, axis=-1)
        square[pose] = np.nanmean(off**2)
    return float(np.sqrt(square.mean()))


def _noisy_images(
    chosen: Forecast, setting: Setting, image: ImageNoise, sources: ErrorSources, trials: int, rng: np.random.Generator
) -> Array:
    """Images (trials, n, 2) in px of the dots in the only pose of a setting, with all errors."""
    points, camera, poses = chosen.points, setting.camera, setting.poses
    slopes = image_slopes(image_jacobian(points, camera, poses), poses)[0]
    root = np.linalg.cholesky(dot_covariances(slopes, chosen.diameter, image, sources.print_sigma))
    n = len(points)
    moved = (root @ rng.standard_normal((trials, n, 2, 1)))[..., 0]
    moved += (slopes @ sources.scaled(points) @ rng.standard_normal((trials, 1, 2, 1)))[..., 0]
    normalized = perspective(to_camera(points, poses.rotation, poses.translation))
    if sources.camera_covariance is not None:
        off = rng.multivariate_normal(np.zeros(len(sources.camera_covariance)), sources.camera_covariance, trials)
        moved += (camera.parameter_jacobian(normalized) @ off[:, None, :, None])[..., 0]
    return np.asarray(camera.to_pixels(normalized) + moved)


def _judged(spec: Spec, target: Target) -> PoseDistribution:
    return at_distance(poses_from(spec.poses), target.distance).seen_whole(spec.boundary, spec.camera)


def _asked(spec: Spec, target: Target) -> Spec:
    """Spec whose objective is what the target is about."""
    return replace(spec, objective="rotation" if target.angle else "translation", aggregate="rms")


def _forecaster(spec: Spec, target: Target) -> Forecaster:
    seen = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera)
    return Forecaster(_asked(spec, target), seen, sources_of(spec), _judged(spec, target))


def _refined(forecast: Forecast, spec: Spec, target: Target) -> Forecast:
    return _forecaster(spec, target).refined(forecast)


def _forecasts(spec: Spec, target: Target, most: int | None = None) -> dict[int, Forecast]:
    """Forecasts by number of dots whose value is the target's error, to first order, in its unit."""
    forecasts = _forecaster(spec, target).by_count(most=most)
    unit = 1.0 if target.angle else target.distance / 100
    return {n: replace(forecast, value=forecast.value * unit) for n, forecast in forecasts.items()}


def _fewest(spec: Spec, target: Target, bound: float, most: int | None = None) -> Forecast | None:
    """Fewest dots whose error is at most `bound` to first order; None if there are none."""
    try:
        forecasts = _forecasts(spec, target, most)
    except InputError:
        return None
    return next((forecast for forecast in forecasts.values() if forecast.value <= bound), None)


def _smallest(spec: Spec, target: Target, bound: float, progress: Progress | None) -> tuple[Forecast | None, Spec]:
    """Fewest dots in the smallest disk, in whole mm, with that error, and the spec of that disk."""
    best = _fewest(spec, target, bound), spec
    low, high = 0, int(np.ceil(1e3 * spec.boundary.radius - 1e-9))
    for done in range(RADII if best[0] else 0):
        if progress:
            progress("radius", done, RADII)
        if high - low < 2:
            break
        middle = (low + high) // 2
        smaller = replace(spec, boundary=Circle(middle / 1e3))
        # Larger dots than the least only help where the print hardly errs.
        forecast = _fewest(smaller, target, bound, None if spec.print_sigma < SMALL_PRINT else 2)
        if forecast:
            best, high = (forecast, smaller), middle
        else:
            low = middle
    return best


def _unreachable(best: Forecast, error: float, spec: Spec, target: Target) -> InputError:
    setting = Setting(spec.boundary, spec.camera, _judged(spec, target))
    budget = marker_budget(best.points, best.diameter, setting, spec.image_noise, sources_of(spec))
    parts = budget.rotation_deg if target.angle else budget.translation
    rms = {name: float(np.sqrt(np.mean(part**2))) for name, part in parts.items()}
    limit = max((name for name in rms if name != "total"), key=lambda name: rms[name])
    # The sources are known to first order, the error is sampled.
    alone = error * rms[limit] / rms["total"]
    names = {"image": "the noise of the image", "print": "the print", "camera": "the calibration"}
    size = f"at radius {format_length(spec.boundary.radius)}" if isinstance(spec.boundary, Circle) else "in this room"
    return InputError(
        f"a marker that reaches {target}",
        f"{target.words(error)} with {best.n} dots of {format_length(best.diameter)} {size}, "
        f"of which {names[limit]} alone gives {target.words(alone)}",
        REMEDIES[limit],
    )
