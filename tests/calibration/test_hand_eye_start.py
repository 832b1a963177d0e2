import numpy as np
import pytest

from markergen.calibration.handeye import hand_eye_start
from markergen.maths.rotation import angle_between, exponential, inverse_pose, pose_product

SCALE = 1.03


def moved_by(turns, rng):
    """Exact F, C, M up to the scale, and the robot's poses G = F M C^-1."""
    count = len(turns)
    moving = exponential(turns), rng.uniform(-0.4, 0.4, (count, 3))
    fixed, carried = ((exponential(rng.normal(0, 1, 3)), rng.normal(0, 0.3, 3)) for _ in range(2))
    robot = pose_product(pose_product(fixed, (moving[0], SCALE * moving[1])), inverse_pose(carried))
    return fixed, carried, moving, robot


@pytest.mark.parametrize("count", [3, 4, 9])
def test_recovers_both_poses_and_the_scale_exactly(count):
    rng = np.random.default_rng(count)
    fixed, carried, moving, robot = moved_by(rng.normal(0, 0.7, (count, 3)), rng)
    *poses, scale = hand_eye_start(robot, moving)
    for pose, true in zip(poses, (fixed, carried), strict=True):
        assert angle_between(pose[0], true[0]) < 1e-9
        np.testing.assert_allclose(pose[1], true[1], atol=1e-9)
    assert scale == pytest.approx(SCALE, abs=1e-9)


def test_rotations_about_one_axis_leave_the_offset_along_it_open_and_nothing_else():
    rng = np.random.default_rng(5)
    axis = np.array([0.6, 0.0, 0.8])
    _, carried, moving, robot = moved_by(np.outer([0.0, 0.3, -0.5, 0.9, 0.4], axis), rng)
    (_, _), place, scale = hand_eye_start(robot, moving)
    assert scale == pytest.approx(SCALE, abs=1e-9)
    assert angle_between(place[0], carried[0]) < 1e-8
    along = carried[0] @ axis
    off = place[1] - carried[1]
    np.testing.assert_allclose(off - along * (along @ off), 0.0, atol=1e-8)
    # The least of all offsets.
    assert along @ place[1] == pytest.approx(0.0, abs=1e-8)
