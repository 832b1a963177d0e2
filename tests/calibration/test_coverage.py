"""Directions of photographs as a photographer sees them, and what a set of them covers."""

import numpy as np
import pytest

from benchmarks.calibration_sets import CAMERA, hand_held, layout, photographed
from markergen.calibration.adjustment import adjust
from markergen.calibration.coverage import SIDES, coverage_of, posed, view_angles


@pytest.mark.parametrize("side", range(8))
@pytest.mark.parametrize("angle", [0.0, 90.0, 250.0])
def test_the_side_of_the_picture_that_is_named_is_farther_away(side, angle):
    rotation = posed(np.array([40.0]), np.array([45.0 * side]), np.array([angle]))
    place = layout(36) @ rotation[0].T + [0, 0, 0.6]
    picture = place[:, :2] / place[:, 2:]
    phrase = {"right": (1, 0), "left": (-1, 0), "upper": (0, -1), "lower": (0, 1)}
    toward = np.sum([phrase[word] for word in SIDES[side].split() if word in phrase], axis=0)
    assert np.corrcoef(picture @ toward, place[:, 2])[0, 1] > 0.9
    # Across that direction, depth does not change.
    across = place[:, :2] @ [-toward[1], toward[0]]
    assert abs(np.corrcoef(across, place[:, 2])[0, 1]) < np.sin(np.deg2rad(40)) * 0.9


def test_a_camera_turned_to_the_right_has_its_x_axis_where_its_y_axis_was():
    upright = np.diag([1.0, -1.0, -1.0])
    rotated = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ upright
    tilt, toward, rotation = view_angles(np.stack([upright, rotated]))
    assert np.allclose(tilt, 0)
    assert np.allclose(toward, 0)
    assert np.allclose(rotation, [0, 90])


def test_angles_and_poses_invert_each_other():
    rng = np.random.default_rng(0)
    angles = rng.uniform(1, 89, 50), rng.uniform(0, 360, 50), rng.uniform(0, 360, 50)
    rotation = posed(*angles)
    assert np.allclose(rotation @ rotation.swapaxes(-1, -2), np.eye(3))
    assert np.allclose(view_angles(rotation), angles)


def test_every_dot_and_view_is_counted():
    design, rng = layout(24), np.random.default_rng(1)
    rotation = posed(np.array([0.0, 30, 30, 5]), np.array([0.0, 180, 270, 90]), np.array([0.0, 90, 0, 2]))
    made = photographed(design, design, rotation, np.array([[0, 0, 0.6]] * 4), rng)
    result = coverage_of(adjust(made.network(), made.views))
    assert result.cells.sum() == 4 * 24
    assert result.cells.shape == (6, 8)
    x, y = np.floor((made.views.pixels + 0.5) / 80).astype(int).reshape(-1, 2).T
    assert all(result.cells[row, column] == np.sum((x == column) & (y == row)) for row, column in np.ndindex(6, 8))
    assert result.image == np.mean(result.cells > 0)
    assert result.sides == ("left edge", "upper edge")
    assert result.quarters == (0, 1)
    assert result.fill[0] == pytest.approx(np.ptp(design, axis=0)[1] / 0.6 * CAMERA.fy / 480, rel=0.03)
    assert "0 to 30 deg to 2 of 8 sides" in result.sentence


def test_dots_left_out_are_not_counted():
    design, rng = layout(6), np.random.default_rng(1)
    made = photographed(design, design, *hand_held(8, rng, design), rng)
    weights = np.ones((8, 6))
    weights[0, 0] = 0
    assert coverage_of(adjust(made.network(), made.views, weights)).cells.sum() == 47
