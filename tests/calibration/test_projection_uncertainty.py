import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.optimize import minimize
from simulated_photos import scene

from markergen.calibration.adjustment import adjust
from markergen.calibration.network import moved_camera
from markergen.calibration.projection_uncertainty import (
    camera_difference,
    draw_difference,
    draw_uncertainty,
    pixel_grid,
    projection_uncertainty,
)
from markergen.maths.rotation import exponential
from markergen.model.camera import Camera, Distortion
from markergen.presentation.plots import plot

SQUARE = Camera(641, 481, 800.0, 800.0, 320.0, 240.0)
FISHEYE = Camera(640, 480, 300.0, 301.0, 318.0, 242.0, Distortion("equidistant", (0.02, -0.01, 0.002, 0.0)))
COLUMNS = 12


@pytest.fixture(scope="module")
def calibrated():
    """Return the camera that 20 photos of five dots determine, and its covariance."""
    photographs = scene(5, 20, np.random.default_rng(3))
    adjustment = adjust(photographs.unknown_camera(), photographs.views)
    return adjustment.camera, adjustment.camera_covariance


def samples(camera, covariance, count, scale=1.0):
    values, vectors = np.linalg.eigh(covariance)
    root = scale * vectors * np.sqrt(np.maximum(values, 0))
    rng = np.random.default_rng(5)
    return [moved_camera(camera, root @ rng.normal(size=len(values))) for _ in range(count)]


def test_it_is_the_deviation_of_sampled_cameras(calibrated):
    camera, covariance = calibrated
    expected = projection_uncertainty(camera, covariance, columns=COLUMNS)
    count = 100
    off = np.array(
        [camera_difference(camera, sample, columns=COLUMNS) for sample in samples(camera, covariance, count)]
    )
    sampled = np.sqrt(np.linalg.eigvalsh(np.einsum("nhwi,nhwj->hwij", off, off) / count)[..., -1])
    # The relative error of a deviation is 1 / sqrt(2 n); over the image it has a handful of independent values.
    np.testing.assert_allclose(sampled, expected, rtol=3.5 / np.sqrt(2 * count))


@pytest.mark.parametrize("camera", [SQUARE, FISHEYE], ids=["pinhole", "fisheye"])
def test_small_steps_are_linear(camera):
    # Along one direction of the parameters the deviation is the length of the difference.
    step = np.array([5e-3, 3e-3, 0.01, -0.02, *[1e-6] * len(camera.distortion.names)])
    sigma = projection_uncertainty(camera, np.outer(step, step), columns=COLUMNS)
    difference = camera_difference(camera, moved_camera(camera, step), columns=COLUMNS)
    np.testing.assert_allclose(np.linalg.norm(difference, axis=-1), sigma, atol=1e-3 * sigma.max())


def test_no_other_motion_is_better(calibrated):
    # By definition, without the derivatives: any turn of the second camera.
    first, covariance = calibrated
    (second,) = samples(first, covariance, 1, scale=5.0)
    grid = pixel_grid(first, COLUMNS)
    rays = np.dstack([first.from_pixels(grid), np.ones(grid.shape[:2])])
    points = 7 * rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def cost(motion):
        moved = points @ exponential(1e-3 * motion[:3]).T
        return np.sum((second.to_pixels(moved[..., :2] / moved[..., 2:]) - grid) ** 2)

    least = np.sum(camera_difference(first, second, columns=COLUMNS) ** 2)
    minimum = minimize(cost, np.zeros(3), method="BFGS")
    assert least == pytest.approx(minimum.fun, rel=1e-6)


def test_a_focal_length_is_no_rotation():
    # f alone, f = fx = fy: by symmetry no rotation helps, and q moves by (q - c) df / f.
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = 4.0
    sigma = projection_uncertainty(SQUARE, covariance)
    radius = np.linalg.norm(pixel_grid(SQUARE) - [320, 240], axis=-1)
    np.testing.assert_allclose(sigma, 2 * radius / 800, atol=1e-12)
    difference = camera_difference(SQUARE, moved_camera(SQUARE, np.array([2.0, 2, 0, 0])))
    np.testing.assert_allclose(np.linalg.norm(difference, axis=-1), 2 * radius / 800, atol=1e-6)


def test_a_principal_point_is_nearly_a_rotation():
    long = Camera(641, 481, 80_000.0, 80_000.0, 320.0, 240.0)
    sigma = projection_uncertainty(long, np.diag([0.0, 0, 9, 9]))
    # A turn by dc / f moves q by dc (1 + x^2), x up to 320 / 80 000.
    assert sigma.max() < 3 * (400 / 80_000) ** 2 * 2
    assert np.abs(camera_difference(long, moved_camera(long, np.array([0.0, 0, 3, -3])))).max() < 1e-3


def test_equal_cameras_do_not_differ_and_exact_ones_are_certain():
    for camera in (SQUARE, FISHEYE):
        k = len(camera.parameter_names)
        assert np.nanmax(np.abs(camera_difference(camera, camera, columns=COLUMNS))) < 1e-6
        assert np.nanmax(projection_uncertainty(camera, np.zeros((k, k)))) == 0
    assert projection_uncertainty(SQUARE, np.eye(4)).shape == camera_difference(SQUARE, SQUARE).shape[:2] == (45, 60)


def test_pixels_that_no_ray_reaches_are_left_out():
    # The domain of this lens ends within the image.
    folded = Camera(640, 480, 300.0, 300.0, 320.0, 240.0, Distortion("radtan", (-0.3, 0.0, 0.0, 0.0)))
    sigma = projection_uncertainty(folded, 1e-4 * np.eye(8))
    assert np.isnan(sigma[0, 0])
    assert np.isfinite(sigma[20:25, 25:35]).all()
    difference = camera_difference(folded, moved_camera(folded, np.array([1.0, 1, 0, 0, 0, 0, 0, 0])))
    assert np.isnan(difference[0, 0]).all()
    assert np.isfinite(difference[20:25, 25:35]).all()
    ax = Figure().add_subplot()
    assert draw_uncertainty(sigma, folded, ax) is ax


def test_drawings(calibrated):
    camera, covariance = calibrated
    sigma = projection_uncertainty(camera, covariance)
    (other,) = samples(camera, covariance, 1)
    maps = {
        "standard deviation, px": lambda ax: draw_uncertainty(sigma, camera, ax),
        "difference, px": lambda ax: draw_difference(camera_difference(camera, other), camera, ax),
        # Without any difference there are neither contours nor arrows.
        "difference": lambda ax: draw_difference(np.zeros((45, 60, 2)), camera, ax),
    }
    for label, draw in maps.items():
        drawn = plot(draw, "map", "a map", "Over the image.")
        assert label in drawn.markup
        assert drawn.markup == plot(draw, "map", "a map", "Over the image.").markup
