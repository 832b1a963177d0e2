"""A filter of poses over time: constant velocity with random accelerations, covariance in and out.

The state is the pose T_camera_marker, its velocity v in m/s and its spin s in rad/s, both in the camera frame:

    R(t + dt) = exp([s dt]x) R(t),    t(t + dt) = t(t) + v dt

with an acceleration and an angular acceleration that are constant between two frames and independent from one interval
to the next. The covariance (12, 12) is of (w, dt, ds, dv), with R <- exp([w]x) R as everywhere. It is an extended
Kalman filter on the group: errors are turns from the left, so that its Jacobians hold at any pose.

What is independent from frame to frame is the noise of the image. An error of the print or of the calibration is the
same in all frames, and no filter reduces it: it is left out of the update, and added to the resulting covariance.

A rolling shutter takes row y at tau = r ((y + 1/2) / h - 1/2) after the middle one, of a readout time r and h rows.
With the predicted velocities, dots are moved to where the middle row's time would have them, and the pose is fitted
again. What is unknown of the velocities u = (ds, dv) then moves it by B u, with weights W and the pose Jacobians J,

    B = (sum J'W J)^-1 sum tau J'W J,

so that a frame measures (w, dt) + B u, and tells of the velocities, too. Times are those of the middle row.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log
from typing import Any, NamedTuple

import numpy as np

from markergen.arrays import Array
from markergen.bounds.dot_covariances import image_jacobian
from markergen.detect.presentation import transform_as_dict
from markergen.detect.results import Found
from markergen.errors import InputError, brief
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import fit_pose
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import exponential, left_jacobian, logarithm
from markergen.model.planned_error import amount
from markergen.model.poses import PoseDistribution
from markergen.units import parse_duration

GATE = 27.86
"""Largest squared Mahalanobis distance of a pose that is believed: one of 10,000 good ones is further off (chi2, 6)."""

PERSISTENT = 5
"""Number of poses in a row beyond the gate after which the track starts anew from the last one."""

FORGOTTEN = 1.0
"""Time in s without its marker after which a track ends."""

FASTEST = 1e6
"""Largest acceleration in m/s^2 or rad/s^2: far more than anything seen, and far less than numbers can hold."""

RAMP, SPIN, VELOCITY = 1.0, 3.0, 1.0
"""Standard deviations of the velocities that a new track may have: what the accelerations reach in this time in s, or
these in rad/s and m/s, if they are larger. A steady motion may be fast."""

LONGEST = 1.0
"""Longest readout time in s: sensors take 3 to 100 ms."""

REFITS = 2
"""Times that dots are moved and the pose is fitted: at 60 deg/s and 30 ms, 4 deg become 0.1 by the first, and the
second changes less than the noise."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A pose in motion: T_camera_marker at a time, with velocities.

    Attributes
    ----------
    time : float, s
    rotation, translation : arrays (3, 3) and (3,), m
    spin, velocity : arrays (3,), rad/s and m/s, camera frame
    covariance : array (12, 12)
        Of (w, dt, ds, dv), from the noise of the images and the accelerations.
    """

    time: float
    rotation: Array
    translation: Array
    spin: Array
    velocity: Array
    covariance: Array


@dataclass(frozen=True)
class Accelerations:
    """Standard deviations of the accelerations along each axis: linear in m/s^2, angular in rad/s^2."""

    linear: float
    angular: float


@dataclass(frozen=True, eq=False, repr=False)
class Smoothed(Motion):
    """A filtered pose: a motion with another covariance.

    Attributes
    ----------
    covariance : array (6, 6) of (w, dt), rad and m
        Including the print's and the calibration's part, which the filter does not reduce.
    outlier : bool
        The pose of this frame was not believed; this is a prediction from those before.
    """

    outlier: bool

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values (docs/detect.md)."""
        return {
            **transform_as_dict(self.rotation, self.translation),
            "covariance": self.covariance.tolist(),
            "angular_velocity": self.spin.tolist(),
            "velocity": self.velocity.tolist(),
            "outlier": self.outlier,
        }

    def __repr__(self) -> str:
        place = ", ".join(f"{number:.4f}" for number in self.translation)
        rotation, translation = np.sqrt(np.trace(self.covariance[:3, :3])), np.sqrt(np.trace(self.covariance[3:, 3:]))
        sigma = f"1 sigma: {amount(float(np.rad2deg(rotation)))} deg, {amount(float(1e3 * translation))} mm"
        return f"<Smoothed: at {place} m; {sigma}{'; predicted' * self.outlier}>"


def parse_accelerations(accelerations: str | Sequence[float]) -> Accelerations:
    """Read two accelerations, in m/s^2 and rad/s^2, from a text such as ``2,10`` or two numbers.

    Raises
    ------
    InputError
        If these are not two positive numbers up to `FASTEST`.
    """
    try:
        linear, angular = map(float, accelerations.split(",") if isinstance(accelerations, str) else accelerations)
    except (TypeError, ValueError):
        linear = angular = 0.0
    if not (0 < linear <= FASTEST and 0 < angular <= FASTEST):
        expected = f"two positive accelerations, in m/s^2 and rad/s^2, up to {FASTEST:.0f}"
        raise InputError(expected, brief(accelerations), "give --smooth 2,10")
    return Accelerations(linear, angular)


def parse_readout(duration: str | float) -> float:
    """Read the time in s from the first row of a frame to the last, such as ``30ms``; a bare number is seconds.

    Raises
    ------
    InputError
        If it is none, not above 0, or over `LONGEST`.
    """
    try:
        seconds = parse_duration(duration)
    except InputError:
        seconds = 0.0
    if not 0 < seconds <= LONGEST:
        expected = f"a readout time above 0, up to {LONGEST:g} s"
        raise InputError(expected, brief(duration), "give the time from the first row to the last, --readout 30ms")
    return seconds


AT_ONCE = np.zeros((6, 6))
"""B of a global shutter."""


class Measured(NamedTuple):
    """A pose with the covariance (6, 6) of (w, dt), and B (6, 6), by which the velocities' errors move it."""

    rotation: Array
    translation: Array
    covariance: Array
    by_velocity: Array = AT_ONCE


def begin(time: float, pose: Measured, limits: Accelerations) -> Motion:
    """Return a motion that begins with a pose as measured, at rest as far as is known."""
    sigma = np.repeat([max(RAMP * limits.angular, SPIN), max(RAMP * limits.linear, VELOCITY)], 3)
    whole = np.zeros((12, 12))
    whole[:6, :6], whole[6:, 6:] = pose.covariance, np.diag(sigma**2)
    mixed = np.eye(12)
    mixed[:6, 6:] = -pose.by_velocity
    whole = mixed @ whole @ mixed.T
    return Motion(time, pose.rotation, pose.translation, np.zeros(3), np.zeros(3), whole)


def predict(motion: Motion, time: float, limits: Accelerations) -> Motion:
    """Return a motion at another, later time.

    Raises
    ------
    InputError
        If the time is earlier.
    """
    step = time - motion.time
    if not step >= 0:
        raise InputError("time stamps that increase", f"{time} s after {motion.time} s", "give frames in order")
    rotation = exponential(motion.spin * step)
    transition = step_jacobian(motion.spin, step)
    # What an acceleration of 1 does: half the step's square to the pose, and the step to the velocity.
    force = np.zeros((12, 6))
    half = transition[:6, 6:] * step / 2
    force[:6], force[6:] = half, step * np.eye(6)
    force = force * np.repeat([limits.angular, limits.linear], 3)
    return replace(
        motion,
        time=time,
        rotation=rotation @ motion.rotation,
        translation=motion.translation + step * motion.velocity,
        covariance=transition @ motion.covariance @ transition.T + force @ force.T,
    )


def step_jacobian(spin: Array, step: float) -> Array:
    """Return the derivative (12, 12) of (w, dt, ds, dv) after a step in s by what they were before.

    With A = exp([s dt]x) and J the left Jacobian of s dt: exp([(s + ds) dt]x) exp([w]x) exp(-[s dt]x) is
    exp([A w + J dt ds]x) to first order.
    """
    transition = np.eye(12)
    transition[:3, :3] = exponential(spin * step)
    transition[:3, 6:9] = step * left_jacobian(spin * step)
    transition[3:6, 9:] = step * np.eye(3)
    return transition


def distance(motion: Motion, pose: Measured) -> float:
    """Return the squared Mahalanobis distance of a pose from the motion at the same time."""
    residual = _residual(motion, pose)
    rows = np.concatenate([np.eye(6), pose.by_velocity], axis=1)
    return float(residual @ np.linalg.solve(rows @ motion.covariance @ rows.T + pose.covariance, residual))


def update(motion: Motion, pose: Measured) -> Motion:
    """Return the motion after a pose, measured at the same time."""
    rows = np.concatenate([np.eye(6), pose.by_velocity], axis=1)
    through = rows @ motion.covariance
    gain = np.linalg.solve(through @ rows.T + pose.covariance, through).T
    change = gain @ _residual(motion, pose)
    # Joseph's form stays symmetric and positive.
    keep = np.eye(12) - gain @ rows
    whole = keep @ motion.covariance @ keep.T + gain @ pose.covariance @ gain.T
    # The error is now relative to the corrected rotation.
    moved = np.eye(12)
    moved[:3, :3] = left_jacobian(change[:3])
    return replace(
        motion,
        rotation=exponential(change[:3]) @ motion.rotation,
        translation=motion.translation + change[3:6],
        spin=motion.spin + change[6:9],
        velocity=motion.velocity + change[9:],
        covariance=moved @ whole @ moved.T,
    )


def _residual(motion: Motion, pose: Measured) -> Array:
    return np.concatenate([logarithm(pose.rotation @ motion.rotation.T), pose.translation - motion.translation])


def poses_of(result: Found, readout: float = 0.0, motion: Motion | None = None) -> list[tuple[float, Measured]]:
    """Return the poses of a detection, with twice the logarithm of how much less likely each is than the best.

    With a `readout` in s they are those of the middle row's time, by the velocities of a motion, or at rest.
    """
    pose, by_velocity = result.pose, AT_ONCE
    assert pose is not None
    if readout and result.camera is not None:
        camera, points, pixels = result.camera, result.xyz, result.pixels
        after = readout * ((pixels[:, 1] + 0.5) / camera.height - 0.5)
        spin, velocity = (np.zeros(3), np.zeros(3)) if motion is None else (motion.spin, motion.velocity)
        rotations, errors, radii = (
            exponential(after[:, None] * spin),
            ErrorSources(result.print_sigma),
            np.zeros(len(after)),
        )
        for _ in range(REFITS):
            still = to_camera(points, pose.rotation[None], np.zeros((1, 3)))[0]
            moved = np.einsum("kij,kj->ki", rotations, still) + after[:, None] * velocity
            middle, taken = (camera.to_pixels(perspective(place + pose.translation)) for place in (still, moved))
            seen = camera.from_pixels(pixels + middle - taken)
            refitted = fit_pose(
                points, radii, seen, result.pixel_covariance, camera, errors, start=(pose.rotation, pose.translation)
            )
            pose = refitted or pose
        jacobian = image_jacobian(
            points, camera, PoseDistribution("found", pose.rotation[None], pose.translation[None])
        )[0]
        weighted = np.linalg.solve(result.pixel_covariance, jacobian).swapaxes(-1, -2) @ jacobian
        by_velocity = np.linalg.solve(weighted.sum(axis=0), np.einsum("k,kij->ij", after, weighted))
    poses = [(0.0, Measured(pose.rotation, pose.translation, pose.budget.image, by_velocity))]
    if pose.alternative is not None and pose.likelihood_ratio > 0:
        poses.append((-2 * log(pose.likelihood_ratio), Measured(*pose.alternative, pose.budget.image, by_velocity)))
    return poses


@dataclass(eq=False)
class _Track:
    """One copy of a marker."""

    motion: Motion
    seen: float
    refused: int = 0


@dataclass(eq=False)
class Smoother:
    """Filters the poses of all markers, each copy by itself; called with every frame's detections, in order of time.

    A pose goes to the nearest motion of its marker. Of the two poses that may fit a flat marker, the one is taken that
    is nearer to the motion, given their likelihoods, so that it does not flip. A pose beyond `GATE` is not believed,
    until `PERSISTENT` in a row are not.

    Attributes
    ----------
    limits : Accelerations
        What the motion, of marker and camera together, accelerates by.
    readout : float, s
        Time from the first row of a frame to the last; 0 for a global shutter.
    """

    limits: Accelerations
    readout: float = 0.0
    _tracks: dict[int, list[_Track]] = field(default_factory=dict)

    def __call__(self, time: float, results: Sequence[Found]) -> list[Smoothed | None]:
        """Return the filtered pose of each detection at a time in s; None for one without a pose.

        Raises
        ------
        InputError
            If the time is earlier than that of the frame before.
        """
        smoothed: list[Smoothed | None] = [None] * len(results)
        for index in {result.index for result in results} | set(self._tracks):
            tracks = [track for track in self._tracks.get(index, []) if time - track.seen <= FORGOTTEN]
            for track in tracks:
                track.motion = predict(track.motion, time, self.limits)
            poses = {k: result.pose for k, result in enumerate(results) if result.index == index and result.pose}
            options = [
                (k, t, _nearest(track.motion, poses_of(results[k], self.readout, track.motion)))
                for k in poses
                for t, track in enumerate(tracks)
            ]
            taken = dict[int, tuple[int, float, Measured]]()
            for k, t, (off, measured) in sorted(options, key=lambda option: option[2][0]):
                if k not in taken and t not in {other for other, *_ in taken.values()}:
                    taken[k] = t, off, measured
            for k, pose in poses.items():
                start = begin(time, poses_of(results[k], self.readout)[0][1], self.limits)
                if k not in taken:
                    track = _Track(start, time)
                    tracks.append(track)
                else:
                    t, off, measured = taken[k]
                    track = tracks[t]
                    track.seen, track.refused = time, track.refused + 1 if off > GATE else 0
                    if not track.refused:
                        track.motion = update(track.motion, measured)
                    elif track.refused == PERSISTENT:
                        track.motion, track.refused = start, 0
                total = track.motion.covariance[:6, :6] + pose.budget.print + pose.budget.camera
                smoothed[k] = Smoothed(**{**vars(track.motion), "covariance": total}, outlier=track.refused > 0)
            self._tracks[index] = tracks
        return smoothed


def _nearest(motion: Motion, poses: list[tuple[float, Measured]]) -> tuple[float, Measured]:
    """Return the squared distance of the pose that is nearest to the motion, given their likelihoods, and the pose."""
    return min(((less + distance(motion, pose), pose) for less, pose in poses), key=lambda pair: pair[0])
