"""The filter of poses over time, on motions that are simulated as it assumes them, and on some it must survive."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from markergen.detect.smoothing import (
    PERSISTENT,
    Accelerations,
    Measured,
    Motion,
    Smoother,
    begin,
    parse_accelerations,
    parse_readout,
    predict,
    step_jacobian,
    update,
)
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import estimate_pose
from markergen.maths.rotation import angle_between, exponential, left_jacobian, logarithm
from markergen.model.camera import Camera

LIMITS = Accelerations(2.0, 5.0)
STEP = 1 / 30
START = np.diag([1.0, -1.0, -1.0]), np.array([0.1, -0.05, 0.8])


def error(motion, truth):
    """The error (12,) of a motion: what turns and moves it to the truth."""
    rotation = logarithm(truth.rotation @ motion.rotation.T)
    parts = (
        rotation,
        truth.translation - motion.translation,
        truth.spin - motion.spin,
        truth.velocity - motion.velocity,
    )
    return np.concatenate(parts)


def moved(motion, change):
    """A motion changed by (12,): the inverse of `error`."""
    return replace(
        motion,
        rotation=exponential(change[:3]) @ motion.rotation,
        translation=motion.translation + change[3:6],
        spin=motion.spin + change[6:9],
        velocity=motion.velocity + change[9:],
    )


def draw(covariance, rng):
    return np.linalg.cholesky(covariance) @ rng.standard_normal(len(covariance))


def noise(rng):
    """A covariance (6, 6) like that of a pose: correlated, and worst along the line of sight."""
    mixed = np.eye(6) + 0.3 * rng.standard_normal((6, 6))
    scale = np.array([4e-3, 4e-3, 1e-3, 3e-4, 3e-4, 2e-3])
    return mixed @ mixed.T * np.outer(scale, scale)


def walk(rng, frames, limits=LIMITS, step=STEP, spin=5, speed=2):
    """Yield true motions: velocities at random, and random accelerations, constant between frames."""
    state = Motion(0.0, *START, spin * rng.standard_normal(3), speed * rng.standard_normal(3), np.zeros((12, 12)))
    for _ in range(frames):
        yield state
        push = np.repeat([limits.angular, limits.linear], 3) * rng.standard_normal(6)
        rotation = exponential(step * state.spin + step**2 / 2 * push[:3])
        state = replace(
            state,
            time=state.time + step,
            rotation=rotation @ state.rotation,
            translation=state.translation + step * state.velocity + step**2 / 2 * push[3:],
            spin=state.spin + step * push[:3],
            velocity=state.velocity + step * push[3:],
        )


def measured(truth, covariance, rng):
    change = draw(covariance, rng)
    return exponential(change[:3]) @ truth.rotation, truth.translation + change[3:]


def run(rng, frames=15, limits=LIMITS, common=None):
    """Filter one simulated motion; return its end, the truth, and the last measured pose."""
    motion = None
    for truth in walk(rng, frames):
        covariance = noise(rng)
        pose = measured(truth, covariance, rng)
        if motion is None:
            motion = begin(truth.time, Measured(*pose, covariance), limits)
        else:
            motion = update(predict(motion, truth.time, limits), Measured(*pose, covariance))
    return motion, truth, pose


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(1)
    return [run(rng) for _ in range(50)]


@pytest.mark.parametrize(("part", "name"), [(slice(0, 6), "pose"), (slice(0, 12), "pose and velocities")])
def test_the_covariance_is_that_of_the_errors(runs, part, name):
    """Sum of the NEES over independent runs: chi2 with as many degrees of freedom for each."""
    errors = [(error(motion, truth)[part], motion.covariance[part, part]) for motion, truth, _ in runs]
    nees = sum(item @ np.linalg.solve(covariance, item) for item, covariance in errors)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], len(runs) * len(errors[0][0]))
    assert low < nees < high, name


def test_a_covariance_that_is_wrong_would_be_seen(runs):
    errors = [(error(motion, truth)[:6], motion.covariance[:6, :6] / 1.5) for motion, truth, _ in runs]
    nees = sum(item @ np.linalg.solve(covariance, item) for item, covariance in errors)
    assert nees > chi2.ppf(1 - 5e-4, 6 * len(runs))


def test_the_jacobian_of_a_step_is_that_of_differences():
    rng = np.random.default_rng(2)
    for spin, step in [(np.zeros(3), 0.03), (np.array([3.0, -8.0, 5.0]), 0.1), (np.array([0.0, 1e-4, 0]), 1.0)]:
        motion = Motion(0.0, *START, spin, rng.standard_normal(3), np.zeros((12, 12)))
        after = predict(motion, step, LIMITS)
        eps = 1e-6
        columns = [
            (
                error(after, predict(moved(motion, eps * item), step, LIMITS))
                - error(after, predict(moved(motion, -eps * item), step, LIMITS))
            )
            / (2 * eps)
            for item in np.eye(12)
        ]
        np.testing.assert_allclose(step_jacobian(spin, step), np.stack(columns, axis=1), atol=1e-8)


@pytest.mark.parametrize("size", [0.0, 1e-6, 9e-3, 1.1e-2, 1.0, 3.0])
def test_the_left_jacobian_is_that_of_differences(size):
    vector = size * np.array([0.6, -0.64, 0.48])
    eps = 1e-6
    columns = [
        logarithm(exponential(vector + eps * item) @ exponential(vector - eps * item).T) / (2 * eps)
        for item in np.eye(3)
    ]
    np.testing.assert_allclose(left_jacobian(vector), np.stack(columns, axis=1), atol=1e-9)


def test_steady_motion_is_followed_better_than_it_is_measured():
    rng, calm = np.random.default_rng(3), Accelerations(0.05, 0.1)
    before, after = [], []
    for _ in range(12):
        motion = None
        for truth in walk(rng, 30, Accelerations(0.0, 0.0)):
            covariance = noise(rng)
            pose = measured(truth, covariance, rng)
            motion = (
                begin(truth.time, Measured(*pose, covariance), calm)
                if motion is None
                else update(predict(motion, truth.time, calm), Measured(*pose, covariance))
            )
        before.append([angle_between(pose[0], truth.rotation), np.linalg.norm(pose[1] - truth.translation)])
        after.append(
            [angle_between(motion.rotation, truth.rotation), np.linalg.norm(motion.translation - truth.translation)]
        )
    before, after = (np.sqrt(np.mean(np.square(item), axis=0)) for item in (before, after))
    # A straight line through 30 points is known at its end to sqrt(4/30) of a point's sigma, 0.37.
    assert (after < 0.5 * before).all()


def test_a_gap_costs_what_the_accelerations_can_do_in_it():
    """After a second unseen the prediction is off by a/2 each way, beyond what the velocity is off by."""
    motion = begin(0.0, Measured(*START, 1e-12 * np.eye(6)), LIMITS)
    motion = replace(motion, covariance=1e-12 * np.eye(12))
    later = predict(motion, 1.0, LIMITS)
    np.testing.assert_allclose(np.sqrt(np.diag(later.covariance)), np.repeat([2.5, 1.0, 5.0, 2.0], 3), rtol=1e-5)
    again = predict(later, 1.0, LIMITS)
    np.testing.assert_array_equal(again.covariance, later.covariance)
    with pytest.raises(InputError, match="time stamps that increase"):
        predict(later, 0.5, LIMITS)
    with pytest.raises(InputError, match="time stamps that increase"):
        predict(later, np.nan, LIMITS)


@dataclass
class Sighting:
    """What the filter takes of a detection."""

    index: int
    pose: object


def sighting(rotation, translation, covariance, index=0, second=None, ratio=0.0, systematic=0.0):
    budget = SimpleNamespace(image=covariance, print=systematic * np.eye(6), camera=np.zeros((6, 6)))
    pose = SimpleNamespace(
        rotation=rotation, translation=translation, budget=budget, alternative=second, likelihood_ratio=ratio
    )
    return Sighting(index, pose)


SMALL = np.diag([1e-3] * 3 + [1e-3] * 3) ** 2
FLIPPED = exponential(np.array([0.8, 0.3, 0.0])) @ START[0], START[1]


def test_flips_do_not_come_through():
    """The mirrored pose is likelier in every third frame; it is told with the other, or instead of it."""
    rng, smoother = np.random.default_rng(4), Smoother(LIMITS)
    for k, truth in enumerate(walk(rng, 30)):
        pose = measured(truth, SMALL, rng)
        mirrored = FLIPPED[0] @ START[0].T @ pose[0], pose[1]
        if k % 3 == 2:
            output = sighting(*mirrored, SMALL, second=pose if k % 2 else None, ratio=0.8 if k % 2 else 0)
        else:
            output = sighting(*pose, SMALL, second=mirrored, ratio=0.5)
        (smoothed,) = smoother(truth.time, [output])
        assert smoothed.outlier == (k % 3 == 2 and not k % 2)
        assert angle_between(smoothed.rotation, truth.rotation) < 0.05


def test_a_steady_motion_may_be_fast():
    """However small the accelerations, the velocities of something new are not known."""
    smoother, limits = Smoother(Accelerations(0.01, 0.01)), Accelerations(0.0, 0.0)
    for truth in walk(np.random.default_rng(5), 20, limits):
        (smoothed,) = smoother(truth.time, [sighting(truth.rotation, truth.translation, SMALL)])
        assert not smoothed.outlier
    np.testing.assert_allclose(smoothed.velocity, truth.velocity, atol=0.01)
    np.testing.assert_allclose(smoothed.spin, truth.spin, atol=0.02)


def test_a_jump_that_lasts_is_believed_after_a_while():
    smoother = Smoother(LIMITS)
    outliers = []
    for k in range(20):
        pose = START if k < 10 else FLIPPED
        (smoothed,) = smoother(k * STEP, [sighting(*pose, SMALL)])
        outliers.append(smoothed.outlier)
    assert outliers == [False] * 10 + [True] * (PERSISTENT - 1) + [False] * (11 - PERSISTENT)
    assert angle_between(smoothed.rotation, FLIPPED[0]) < 1e-3


def test_errors_that_all_frames_share_are_not_averaged_away():
    smoother = Smoother(Accelerations(1e-3, 1e-3))
    for k in range(100):
        (smoothed,) = smoother(k * STEP, [sighting(*START, SMALL, systematic=4e-6)])
    # Of the image's variance little is left, and all of the print's.
    assert (np.diag(smoothed.covariance) > 4e-6).all()
    assert (np.diag(smoothed.covariance) < 4e-6 + 0.2e-6).all()


def test_each_copy_has_its_own_motion():
    """Two copies of one marker in changing order, another marker, and one that is missing for a while."""
    smoother = Smoother(LIMITS)
    left, right = START[1] - [0.3, 0, 0], START[1] + [0.3, 0, 0]
    for k in range(20):
        copies = [sighting(START[0], left, SMALL), sighting(START[0], right, SMALL)]
        if k in (7, 8):
            copies = copies[1:]
        result = [*copies[:: 1 - 2 * (k % 2)], sighting(*FLIPPED, SMALL, index=1), Sighting(2, None)]
        *smoothed, other, nothing = smoother(k * STEP, result)
        assert nothing is None
        np.testing.assert_allclose(other.translation, FLIPPED[1], atol=1e-9)
        for one, copy in zip(smoothed, result, strict=False):
            np.testing.assert_allclose(one.translation, copy.pose.translation, atol=1e-9)
            assert not one.outlier
    # After a second without it, a marker is a new one, wherever it is.
    (fresh,) = smoother(20 * STEP + 2, [sighting(*FLIPPED, SMALL)])
    np.testing.assert_array_equal(fresh.rotation, FLIPPED[0])
    np.testing.assert_array_equal(fresh.covariance, SMALL)
    assert set(fresh.as_dict()) >= {"rotation", "translation", "covariance", "velocity", "angular_velocity", "outlier"}


@pytest.mark.parametrize("stated", ["1e200,1", "", "2", "2,x", "0,1", "-1,1", "nan,1", "inf,1", "1,2,3", (1,), None, 5])
def test_accelerations_are_two_positive_numbers(stated):
    with pytest.raises(InputError, match="--smooth 2,10"):
        parse_accelerations(stated)
    assert parse_accelerations("2,10") == parse_accelerations((2, 10)) == Accelerations(2.0, 10.0)


def rolling(motion, camera, points, readout, rng, sigma=0.05):
    """A detection of points whose rows are taken one after the other while they move."""
    pixels = camera.project(points, motion.rotation[None], motion.translation[None])[0]
    for _ in range(20):
        after = readout * ((pixels[:, 1] + 0.5) / camera.height - 0.5)
        moved = np.einsum("kij,kj->ki", exponential(after[:, None] * motion.spin), points @ motion.rotation.T)
        moved += motion.translation + after[:, None] * motion.velocity
        pixels = camera.to_pixels(moved[:, :2] / moved[:, 2:])
    seen, spread = (
        pixels + rng.normal(0, sigma, pixels.shape),
        np.broadcast_to(sigma**2 * np.eye(2), (len(points), 2, 2)),
    )
    pose = estimate_pose(points, seen, spread, camera, ErrorSources(0.0))
    return SimpleNamespace(
        index=0, camera=camera, xyz=points, pixels=seen, pixel_covariance=spread, print_sigma=0.0, pose=pose
    )


def test_a_rolling_shutter_is_corrected_by_the_velocities():
    """Poses of random turns err by degrees as measured, and by what the filter claims with the readout time."""
    camera, limits, readout = Camera(640, 480, 700, 700, 319.5, 239.5), Accelerations(0.3, 1.0), 0.03
    angle = np.arange(8) * 2 * np.pi / 8
    points = 0.08 * np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=1)
    rng, squares, plain, raw = np.random.default_rng(3), [], [], []
    for _ in range(25):
        smoothers = Smoother(limits, readout), Smoother(limits)
        for k, state in enumerate(walk(rng, 6, limits, spin=1, speed=0.1)):
            tilted = replace(state, rotation=state.rotation @ exponential(np.array([0.6, 0, 0])))
            outcome = rolling(tilted, camera, points, readout, rng)
            results = [smoother(state.time, [outcome])[0] for smoother in smoothers]
            if k >= 2:
                for result, sums in zip(results, (squares, plain), strict=True):
                    off = error(result, tilted)[:6]
                    sums.append(float(off @ np.linalg.solve(result.covariance, off)) / 6)
                raw.append(np.rad2deg(angle_between(outcome.pose.rotation, tilted.rotation)))
    assert np.median(raw) > 0.3
    assert np.mean(plain) > 10
    # 100 frames, of 25 motions: frames of one share errors in part, so 150 to 600 squares of normal variables.
    assert np.mean(squares) == pytest.approx(1, abs=3 * np.sqrt(2 / 150))


@pytest.mark.parametrize("duration", ["fast", 0, "2s", -1])
def test_a_readout_time_is_a_short_duration(duration):
    with pytest.raises(InputError, match="a readout time"):
        parse_readout(duration)
    assert parse_readout("30ms") == pytest.approx(0.03)
