"""The adjustment: the minimum that others find, in the frame of the design, with a covariance that is true."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated_photos import CAMERA, in_gauge, nees, scene

from benchmarks.calibration import by_opencv, compared, grid
from markergen.calibration.adjustment import UndeterminedError, adjust
from markergen.calibration.network import CameraFreedom, Length, moved_camera
from markergen.maths.rotation import exponential


@pytest.fixture
def photographs():
    return scene(6, 8, np.random.default_rng(3))


def by_scipy(network, views, start):
    """Minimize the same squares with scipy's solver and differences, in its own parameters, from an adjustment."""
    v, n = views.seen.shape
    roots = np.linalg.cholesky(np.linalg.inv(views.covariance)).swapaxes(-1, -2)

    def residuals(unknowns):
        turns, moves = unknowns[: 3 * v].reshape(v, 3), unknowns[3 * v : 6 * v].reshape(v, 3)
        places = start.places + unknowns[6 * v : 6 * v + 3 * n].reshape(n, 3)
        camera = moved_camera(start.camera, network.freedom.directions @ unknowns[6 * v + 3 * n :])
        poses = exponential(turns) @ start.views.rotation, start.views.translation + moves
        left = (roots @ (views.pixels - camera.project(places, *poses))[..., None])[..., 0]
        return (left * views.seen[..., None]).ravel()

    size = 6 * v + 3 * n + len(network.freedom)
    rough = 1e-3 * np.random.default_rng(0).standard_normal(size)
    return least_squares(residuals, rough, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15).cost * 2


@pytest.mark.parametrize("reference", [True, False])
def test_the_minimum_is_that_of_another_solver(photographs, reference):
    network = photographs.network if reference else photographs.unknown_camera(("fx", "cx", "cy", "k1"))
    adjustment = adjust(network, photographs.views)
    assert adjustment.chi2 == pytest.approx(by_scipy(network, photographs.views, adjustment), rel=1e-6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_minimum_is_that_of_opencv(seed):
    network, views = compared(2 * grid(12), 8, np.random.default_rng(seed))
    assert adjust(network, views).rms == pytest.approx(by_opencv(network, views), rel=1e-6)


def test_the_dots_stay_in_the_frame_of_the_design(photographs):
    adjustment = adjust(photographs.network, photographs.views)
    gauge = photographs.network.gauge(photographs.network.design)
    off = (adjustment.places - photographs.network.design).ravel()
    assert np.abs(gauge.T @ off).max() < 1e-12
    assert np.abs(gauge.T @ adjustment.covariance).max() < 1e-6 * np.abs(adjustment.covariance).max()


def test_the_covariance_is_that_of_the_bordered_system(photographs):
    """Inverse of [N C; C' 0], by brute force from the whole normal matrix."""
    adjustment = adjust(photographs.network, photographs.views)
    reduced = adjustment.normal.reduced()
    gauge = photographs.network.gauge(photographs.network.design)
    g = gauge.shape[1]
    scale = np.abs(reduced).max()
    bordered = np.block([[reduced / scale, gauge], [gauge.T, np.zeros((g, g))]])
    inverse = np.linalg.inv(bordered)[:-g, :-g] / scale
    # N is singular along the gauge only up to the curvature at residuals of a few hundredths of a pixel.
    np.testing.assert_allclose(adjustment.unscaled, inverse, atol=2e-3 * np.abs(inverse).max())


def test_a_measured_length_gives_the_scale(photographs):
    first, second, true = 0, 3, photographs.places * 1.004
    length = float(np.linalg.norm(true[first] - true[second]))
    network = replace(photographs.network, lengths=(Length(first, second, length, 1e-4),))
    # What the camera sees does not tell a larger print from a nearer one.
    adjustment = adjust(network, photographs.views)
    assert np.linalg.norm(adjustment.places[first] - adjustment.places[second]) == pytest.approx(length, rel=1e-9)
    apart = np.zeros(adjustment.places.shape)
    apart[first] = (adjustment.places[first] - adjustment.places[second]) / length
    apart[second] = -apart[first]
    sigma = np.sqrt(apart.ravel() @ adjustment.covariance @ apart.ravel() / adjustment.scale)
    assert sigma == pytest.approx(1e-4, rel=1e-6)


def test_two_lengths_that_differ_are_weighted():
    photographs = scene(6, 8, np.random.default_rng(3), sigma=1e-3)
    network = replace(photographs.network, lengths=(Length(0, 3, 0.2201, 1e-4), Length(1, 4, 0.2207, 2e-4)))
    adjustment = adjust(network, photographs.views)
    free = adjust(photographs.network, photographs.views)
    lengths = np.array(
        [[np.linalg.norm(item.places[i] - item.places[i + 3]) for i in (0, 1)] for item in (adjustment, free)]
    )
    ratio, weights = np.array([0.2201, 0.2207]) / lengths[1], (lengths[1] / [1e-4, 2e-4]) ** 2
    # The photographs hold the shape of the print to 2 um, so it gives way by a thousandth of that difference.
    np.testing.assert_allclose(lengths[0] / lengths[1], np.sum(weights * ratio) / weights.sum(), rtol=5e-5)


def test_dots_measured_by_hand_count_in_whatever_frame(photographs):
    true = in_gauge(photographs.places, photographs.network)
    rotated = true @ exponential(np.array([0.0, 0.0, 0.01])).T + [0.002, -0.001, 0]
    prior = np.zeros((6, 3, 3))
    prior[:, :2, :2] = np.eye(2) / 1e-5**2
    network = replace(photographs.network, design=rotated, prior=prior)
    adjustment = adjust(network, photographs.views)
    apart = np.linalg.norm(adjustment.places - adjustment.places[[1, 2, 3, 4, 5, 0]], axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(true - true[[1, 2, 3, 4, 5, 0]], axis=1), atol=3e-5)
    alone = adjust(photographs.network, photographs.views)
    assert np.trace(adjustment.covariance / adjustment.scale) < np.trace(alone.covariance / alone.scale)


def test_disks_are_fitted_by_the_centers_of_their_ellipses():
    """Without that, the dots of 36 mm at 0.4 m would be off by a pixel."""
    made = scene(6, 12, np.random.default_rng(5), sigma=1e-4, radius=0.018)
    adjustment = adjust(made.network, made.views)
    assert adjustment.rms < 3e-4
    assert np.abs(adjustment.places - in_gauge(made.places, made.network)).max() < 1e-6


@pytest.mark.parametrize("reference", [True, False])
def test_the_covariance_is_true(reference):
    """NEES per degree of freedom of 30 sets with 8 or 11 degrees each: 1 +- 0.33 at four sigma."""
    rng, result = np.random.default_rng(11), []
    for _ in range(30):
        made = scene(5, 15, rng)
        network = made.network if reference else made.unknown_camera()
        item = adjust(network, made.views)
        result.append(nees(item.places - in_gauge(made.places, network), item.covariance / item.scale))
    assert np.mean(result) == pytest.approx(1, abs=4 * np.sqrt(2 / (30 * 8)))


def test_a_camera_known_with_a_sigma_is_neither_exact_nor_free(photographs):
    sigma = np.array([2.0, 2.0, 1.5, 1.5, 1e-2, 1e-2, 0, 0, 0])
    freedom = CameraFreedom.of_covariance(np.diag(sigma**2))
    assert len(freedom) == 6
    adjustment = adjust(replace(photographs.network, freedom=freedom), photographs.views)
    spread = np.sqrt(np.diag(adjustment.camera_covariance) / adjustment.scale)
    assert (spread[:6] < sigma[:6]).all()
    assert (spread[6:] == 0).all()
    exact = adjust(photographs.network, photographs.views)
    assert np.trace(adjustment.covariance / adjustment.scale) > np.trace(exact.covariance / exact.scale)


def test_held_dots_stay(photographs):
    network = replace(photographs.network, free=False)
    adjustment = adjust(network, photographs.views)
    np.testing.assert_array_equal(adjustment.places, network.design)
    assert adjustment.rms > 4 * adjust(photographs.network, photographs.views).rms


def test_residuals_have_the_covariance_that_is_claimed():
    rng, squares = np.random.default_rng(2), []
    for _ in range(40):
        made = scene(5, 6, rng)
        adjustment = adjust(made.network, made.views)
        spread, seen = np.trace(adjustment.residual_covariance(), axis1=-2, axis2=-1), made.views.seen
        squares.append([np.sum(adjustment.residual[seen] ** 2), np.sum(spread[seen])])
    measured, claimed = np.sum(squares, axis=0)
    # 40 sets with some 20 degrees of freedom: their sum of squares is known to 5 %.
    assert measured == pytest.approx(claimed, rel=0.15)


def test_too_little_is_said():
    made = scene(5, 3, np.random.default_rng(1))
    with pytest.raises(UndeterminedError):
        _ = adjust(made.unknown_camera(), made.views).covariance
    few = replace(made.views, seen=made.views.seen & (np.arange(5) < 2))
    with pytest.raises(UndeterminedError, match="three dots"):
        adjust(made.network, few)


def test_markers_have_frames_of_their_own():
    """Two markers that share a camera, each seen in half of the views."""
    first, second = (scene(5, 10, np.random.default_rng(k)) for k in (1, 2))
    both = replace(
        first.network,
        design=np.concatenate([first.network.design, second.network.design]),
        radii=np.zeros(10),
        marker=np.repeat([0, 1], 5),
    )

    def beside(views, after):
        def pad(a):
            return np.concatenate([np.zeros_like(a), a] if after else [a, np.zeros_like(a)], axis=1)

        spread = np.concatenate([views.covariance] * 2, axis=1)
        return replace(views, pixels=pad(views.pixels), covariance=spread, seen=pad(views.seen))

    parts = beside(first.views, False), beside(second.views, True)
    names = ("pixels", "covariance", "seen", "rotation", "translation")
    joined = type(parts[0])(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    adjustment = adjust(both, joined)
    for k, part in enumerate((first, second)):
        alone = adjust(part.network, part.views)
        np.testing.assert_allclose(adjustment.places[5 * k : 5 * k + 5], alone.places, atol=1e-9)
    assert adjustment.camera == CAMERA
