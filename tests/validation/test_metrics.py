import numpy as np
import pytest
from scipy.stats import chi2

from markergen.maths.information import mirrored_rotation
from markergen.maths.rotation import angle_between, exponential, rotation_z
from markergen.model.poses import paper
from markergen.objectives.homography import validation_grid
from markergen.validation.metrics import (
    efficiency,
    flipped,
    homography_error_px2,
    homography_failed,
    mean_nees_interval,
    pose_failed,
    pose_nees,
    rms_interval,
    rotation_error_deg,
    statistics,
    translation_error_pct,
)

SQUARE = np.array([[0.1, 0.1, 0], [-0.1, 0.1, 0], [-0.1, -0.1, 0], [0.1, -0.1, 0]])


def test_rotation_error_is_the_angle_between():
    assert rotation_error_deg(rotation_z(np.deg2rad([0.0, 30.0, -90.0])), np.eye(3)) == pytest.approx([0, 30, 90])


def test_translation_error_is_relative_to_the_distance():
    estimates = np.array([[0, 0, 2.0], [0, 0.3, 2.4], [0, 0, -2.0]])
    assert translation_error_pct(estimates, np.array([0, 0, 2.0])) == pytest.approx([0, 25, 200])


def test_homography_error_is_the_mean_of_squares():
    """Shifted by (3, 4) px everywhere: 25 px^2, not 5 px."""
    shifted = np.array([[1.0, 0, 3], [0, 1, 4], [0, 0, 1]])
    grid = validation_grid(0.15)
    assert homography_error_px2(np.stack([np.eye(3), shifted]), grid, grid) == pytest.approx([0, 25])


def test_validation_grid_is_even_and_wider_than_the_marker():
    grid = validation_grid(0.2)
    assert grid.shape == (49, 2)
    assert np.allclose(np.unique(grid[:, 0].round(12)), np.linspace(-0.3, 0.3, 7))
    assert len(np.unique(grid.round(12), axis=0)) == 49


def test_failures_of_poses():
    good = np.diag([1.0, -1.0, -1.0])
    rotation = np.stack([good, good, good, good * np.nan, exponential(np.array([1.6, 0, 0])) @ good])
    translation = np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 2.1], [0, 0, 1.0], [0, 0, 0.05]])
    te_pct = translation_error_pct(translation, np.array([0, 0, 1.0]))
    # Fine, behind the camera, too far away, not finite, partly behind the camera.
    assert pose_failed(SQUARE, rotation, translation, te_pct).tolist() == [False, True, True, True, True]


def test_failures_of_homographies():
    beyond = np.array([[1.0, 0, 0], [0, 1, 0], [11, 0, 1]])
    homography = np.stack([np.eye(3), np.full((3, 3), np.nan), beyond])
    he_px2 = homography_error_px2(homography, validation_grid(0.1), validation_grid(0.1))
    assert homography_failed(SQUARE[:, :2], homography, he_px2).tolist() == [False, True, True]


def test_a_flip_is_nearer_to_the_mirrored_pose():
    poses = paper()
    rotation, translation = poses.rotation[60], poses.translation[60]
    mirrored = mirrored_rotation(rotation, translation)
    # Polar angle 52.5 degrees: the two lie 105 degrees apart.
    assert np.rad2deg(angle_between(rotation, mirrored)) == pytest.approx(105)
    disturbance = exponential(np.random.default_rng(0).normal(scale=0.1, size=(50, 3)))
    assert not flipped(disturbance @ rotation, rotation, translation).any()
    assert flipped(disturbance @ mirrored, rotation, translation).all()
    assert not flipped(np.full((1, 3, 3), np.nan), rotation, translation).any()


def test_nees_weighs_each_error_by_its_variance():
    rotation, translation = np.eye(3), np.array([0, 0, 1.0])
    information = np.diag([1e4, 1e4, 1e4, 1e6, 1e6, 1e6])
    # Two sigma (0.01 rad each) about one axis, and three sigma (1 mm each) along another.
    estimate = exponential(np.array([[0, 0.02, 0]])), translation + np.array([[0.003, 0, 0]])
    assert pose_nees(*estimate, rotation, translation, information) == pytest.approx([4 + 9])


def test_statistics_by_hand():
    result = statistics(np.array([3.0, 1.0, 2.0, 6.0]))
    assert result == {
        "count": 4,
        "mean": 3.0,
        "std": pytest.approx(np.sqrt(3.5)),
        "rms": pytest.approx(np.sqrt(12.5)),
        "median": 2.5,
        "p95": pytest.approx(3 + 0.85 * 3),
        "max": 6.0,
    }


def test_statistics_of_nothing_have_no_values():
    assert statistics(np.array([])) == {"count": 0} | dict.fromkeys(["mean", "std", "rms", "median", "p95", "max"])


def test_efficiency_by_hand():
    measured = np.array([[1.0, 1.0], [2.0, 100.0]])
    kept = np.array([[True, True], [True, False]])
    # Bound's mean square (1 + 1 + 4)/3 by trials, measured (1 + 1 + 4)/3.
    assert efficiency(measured, kept, np.array([1.0, 2.0])) == pytest.approx(1)
    assert efficiency(2 * measured, kept, np.array([1.0, 2.0])) == pytest.approx(0.25)


def test_efficiency_is_left_out_where_it_means_nothing():
    measured, kept = np.ones((2, 2)), np.ones((2, 2), dtype=bool)
    assert efficiency(measured, kept, np.array([2.5, 2.5])) is not None
    assert efficiency(measured, kept, np.array([2.5, 2.6])) is None
    assert efficiency(measured, kept, np.array([np.inf, 1])) is None
    assert efficiency(measured, ~kept, np.ones(2)) is None
    assert efficiency(0 * measured, kept, np.ones(2)) is None
    assert efficiency(measured, kept, np.zeros(2)) is None


@pytest.mark.parametrize("count", [1, 100, 80_000])
def test_interval_of_the_mean_nees_is_that_of_chi_square(count):
    low, high = mean_nees_interval(count)
    # Two implementations of one quantile agree to rounding.
    assert chi2.cdf([low * count, high * count], 6 * count) == pytest.approx([0.005, 0.995], rel=1e-8)
    assert low < 6 < high


def test_the_interval_of_an_rms_holds_it_in_19_of_20_samples():
    rng = np.random.default_rng(3)
    ends = np.array([rms_interval(np.abs(rng.standard_normal(100)), 0) for _ in range(100)])
    # A bootstrap of 100 numbers is a little short: 93 % or so; a standard deviation of the share is 2.5 %.
    assert 0.86 <= np.mean((ends[:, 0] < 1) & (ends[:, 1] > 1)) <= 0.99
    assert rms_interval(np.array([1.0]), 0) is None
