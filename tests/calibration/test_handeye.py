"""A camera on a robot: derivatives, claims against the truth, and poses that are not those of the photographs."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import nees
from benchmarks.handeye import one_set
from markergen.calibration.handeye import UNKNOWNS, RobotPoses, agreeing, hand_eye, started
from markergen.calibration.network import Views
from markergen.errors import InputError
from markergen.maths.information import apply_pose_step
from markergen.maths.rotation import exponential, inverse_pose, pose_product

NAMES = [f"{k}.png" for k in range(10)]


def posed(rng, count=8, on_hand=True, noise=1e-4, turns=0.5, scale=1.0):
    """Views with small errors, the robot's poses, and F and C."""
    rotation = exponential(rng.normal(0, turns, (count, 3))) @ np.diag([1.0, -1.0, -1.0])
    translation = rng.uniform(-0.1, 0.1, (count, 3)) + [0, 0, 0.5]
    fixed, carried = ((exponential(rng.normal(0, 1, 3)), rng.normal(0, 0.3, 3)) for _ in range(2))
    moving = rotation, scale * translation
    robot = pose_product(pose_product(fixed, inverse_pose(moving) if on_hand else moving), inverse_pose(carried))
    step = rng.normal(0, noise, (count, 6))
    none = np.zeros((count, 0, 2))
    views = Views(none, np.zeros((count, 0, 2, 2)), none[..., 0] > 0, *apply_pose_step(rotation, translation, step))
    return views, robot, fixed, carried


def flange_of(views, fixed, carried):
    """Poses of a robot with the camera on its hand."""
    moving = inverse_pose((views.rotation, views.translation))
    return pose_product(pose_product(fixed, moving), inverse_pose(carried))


@pytest.mark.parametrize("on_hand", [True, False])
def test_derivatives_are_those_of_differences(on_hand):
    views, flange, fixed, carried = posed(np.random.default_rng(1), on_hand=on_hand, noise=1e-5)
    pair = [np.stack(parts) for parts in zip(fixed, carried, strict=True)]
    robot = RobotPoses(*pair, np.array([0.02]), flange, on_hand)
    rows, h = robot.rows(views), 1e-6
    for k in range(UNKNOWNS):
        step = h * np.eye(UNKNOWNS)[k]
        slope = -(robot.stepped(step).rows(views).residual - robot.stepped(-step).rows(views).residual) / (2 * h)
        np.testing.assert_allclose(rows.by_joints[..., k], slope, atol=2e-2 * np.abs(slope).max() + 1e-8)
    for k in range(6):
        step = h * np.eye(6)[k]
        sides = [
            replace(views, **dict(zip(("rotation", "translation"), apply_pose_step(views.rotation, views.translation,
                    np.tile(sign * step, (len(views), 1))), strict=True)))
            for sign in (1, -1)
        ]  # fmt: skip
        slope = -(robot.rows(sides[0]).residual - robot.rows(sides[1]).residual) / (2 * h)
        np.testing.assert_allclose(rows.by_pose[..., k], slope, atol=2e-2 * np.abs(slope).max() + 1e-8)


@pytest.mark.parametrize("on_hand", [True, pytest.param(False, marks=pytest.mark.long)])
def test_claims_hold_against_the_truth(on_hand):
    squares, within = [], []
    for seed in range(4):
        fit, error, *_ = one_set(np.random.default_rng(seed), 8, on_hand, "exact")
        sigma = np.sqrt(np.diag(fit.covariance))
        squares.append(nees(error / sigma, fit.covariance / sigma / sigma[:, None], UNKNOWNS))
        within.append(np.abs(error) < 2.58 * sigma)
    # Four sets of 13 unknowns: chi2 of 52 degrees of freedom is within 0.5 to 1.7 times that in 999 of 1000 cases.
    assert 0.5 < np.mean(squares) < 1.7
    assert np.mean(within) > 0.9


def test_what_a_left_out_pose_is_predicted_from_does_not_depend_on_it():
    fit, *_ = one_set(np.random.default_rng(3), 8, True, "exact")
    rotation, translation = (part.copy() for part in fit.robot.flange)
    translation[0] += [2e-6, -1e-6, 3e-6]
    again = hand_eye(fit.adjustment, replace(fit.robot, flange=(rotation, translation)))
    once = hand_eye(fit.adjustment, fit.robot)
    np.testing.assert_allclose(again.left_out[0, 3:] - once.left_out[0, 3:], [2e-6, -1e-6, 3e-6], atol=3e-7)


def test_photographs_from_one_pose_count_as_one():
    views, flange, *_ = posed(np.random.default_rng(2), 6)
    twice = np.r_[np.arange(6), 0, 0]
    robot = started(views.take(twice), (flange[0][twice], flange[1][twice]), True)
    assert robot.measured == 36
    np.testing.assert_allclose(robot.share, [1 / 3, 1, 1, 1, 1, 1, 1 / 3, 1 / 3])


def refused(views, flange, on_hand=True, one_axis=False):
    with pytest.raises(InputError) as raised:
        agreeing(views, flange, NAMES[: len(views)], on_hand, one_axis)
    assert "\n" not in str(raised.value)
    return raised.value


@pytest.mark.parametrize("on_hand", [True, False])
def test_exchanged_and_shifted_poses_are_refused_by_name(on_hand):
    views, (rotation, translation), *_ = posed(np.random.default_rng(4), 8, on_hand)
    order = np.arange(8)
    order[[2, 5]] = 5, 2
    message = refused(views, (rotation[order], translation[order]), on_hand).args[1]
    assert "2.png" in message
    assert "5.png" in message
    for order in (np.roll(np.arange(8), 1), np.arange(8)[::-1]):
        error = refused(views, (rotation[order], translation[order]), on_hand)
        assert "photograph a pose belongs to" in error.args[2]


def test_poses_of_equal_rotations_are_found_exchanged_by_their_places():
    views, _, fixed, carried = posed(np.random.default_rng(5), 8)
    views.rotation[1] = views.rotation[0]
    rotation, translation = flange_of(views, fixed, carried)
    order = np.r_[1, 0, np.arange(2, 8)]
    message = refused(views, (rotation[order], translation[order])).args[1]
    assert "0.png" in message
    assert "1.png" in message


@pytest.mark.parametrize("on_hand", [True, False])
def test_inverse_poses_are_refused_with_what_to_state(on_hand):
    views, flange, *_ = posed(np.random.default_rng(6), 8, on_hand)
    remedy = refused(views, inverse_pose(flange), on_hand).args[2]
    assert "--robot-frame" in remedy
    assert "--mounting" in remedy


def test_parallel_axes_and_no_rotation_are_refused():
    rng = np.random.default_rng(7)
    views, _, fixed, carried = posed(rng, 8)
    about = np.outer(rng.uniform(-0.6, 0.6, 8), [0, 0.6, 0.8])
    for turns in (about, 0 * about):
        views.rotation[:] = exponential(turns) @ np.diag([1.0, -1.0, -1.0])
        flange = flange_of(views, fixed, carried)
        assert "axes" in refused(views, flange).args[0]
        if turns.any():
            robot, kept = agreeing(views, flange, NAMES, True, one_axis=True)
            assert len(kept) == 8
            assert np.rad2deg(np.abs(robot.rows(views).residual[:, :3])).max() < 0.1
        else:
            assert "--one-axis" not in refused(views, flange, one_axis=True).args[2]


def test_few_photographs_wrong_units_and_wrong_rotations_are_refused():
    views, flange, *_ = posed(np.random.default_rng(8), 8)
    assert "3" in refused(views.take(np.arange(2)), (flange[0][:2], flange[1][:2])).args[0]
    for factor, unit in ((1000, "mm"), (10, "mm"), (1 / 1000, "m"), (0.01, "m"), (0.0254, "m"), (12, "in")):
        assert f"give --robot-unit {unit}" in refused(views, (flange[0], factor * flange[1])).args[2]
    assert "check --robot-unit" in refused(views, (flange[0], 5 * flange[1])).args[2]
    wrong = exponential(np.random.default_rng(0).normal(0, 1, (8, 3)))
    assert "--robot-rotation" in refused(views, (wrong, flange[1])).args[2]


def test_a_wrong_pose_is_left_out():
    views, (rotation, translation), *_ = posed(np.random.default_rng(9), 10)
    translation = translation.copy()
    translation[4] += 0.05
    _, kept = agreeing(views, (rotation, translation), NAMES)
    assert kept.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]


def test_a_wrong_translation_is_left_out_also_where_rotations_err():
    rng = np.random.default_rng(10)
    views, (rotation, translation), *_ = posed(rng, 10)
    rotation = exponential(rng.normal(0, np.deg2rad(0.05), (10, 3))) @ rotation
    translation[4, 0] += 0.005
    _, kept = agreeing(views, (rotation, translation), NAMES)
    assert kept.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]


def test_a_quaternion_in_the_wrong_order_is_not_taken_for_inverse_poses():
    from scipy.spatial.transform import Rotation

    views, (rotation, translation), *_ = posed(np.random.default_rng(11), 10)
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().T
    # Read so, rotations are the inverse ones in other frames: they agree with the photographs, translations do not.
    misread = Rotation.from_quat(np.column_stack([w, x, y, z])).as_matrix()
    for poses in ((misread, translation), inverse_pose((misread, translation))):
        error = refused(views, poses)
        assert "apart" in error.args[1]
        assert "--robot-rotation" in error.args[2]


def test_the_robots_errors_are_those_it_has():
    sigma = np.array([one_set(np.random.default_rng(seed), 10, True, "exact")[0].robot.sigma for seed in range(2)])
    # Two sets with some 23 degrees of freedom for each kind: 15 % for the mean.
    np.testing.assert_allclose(sigma.mean(axis=0), [np.deg2rad(0.02), 1e-4], rtol=0.4)
