import numpy as np
import pytest

from markergen.detect.ellipse import fit_dot
from markergen.render.coverage import ellipse_coverage
from markergen.render.optics import FINENESS, Optics, expose

WIDTH, HEIGHT = 80, 70


def scene(center, semi, angle, optics, seed=0, hole=None):
    """Grey image of one ellipse, minus another one, and the moments of its area."""
    fine = np.zeros((FINENESS * HEIGHT, FINENESS * WIDTH))
    shapes = [(1, center, semi)] + ([(-1, *hole)] if hole else [])
    for sign, middle, axes in shapes:
        place = (np.array(middle) + 0.5) * FINENESS - 0.5
        tile, top, left = ellipse_coverage(place, FINENESS * np.array(axes), angle, *fine.shape[::-1])
        fine[top : top + tile.shape[0], left : left + tile.shape[1]] += sign * tile
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moments = turn @ np.diag(np.array(semi) ** 2 / 4) @ turn.T
    return expose(fine, optics, np.random.default_rng(seed)).astype(float), moments


@pytest.mark.parametrize(
    ("semi", "angle"), [((24, 24), 0.0), ((22, 9), 0.5), ((9.6, 3.3), -1.2), ((5, 5), 0.0), ((6, 3), 1.5)]
)
def test_recovers_center_and_axes_without_noise(semi, angle):
    image, moments = scene((40.3, 33.8), semi, angle, Optics(noise_grey=0))
    # The start is wrong by as much as the region's moments are.
    fit = fit_dot(image, np.array([40.6, 33.5]), moments * 0.9)
    # The center is symmetric in all that the model leaves out; the axes lose up to 0.2 px where the tips are sharp.
    np.testing.assert_allclose(fit.center, [40.3, 33.8], rtol=0, atol=3e-3)
    np.testing.assert_allclose(fit.semi, semi, rtol=0, atol=0.25)
    assert not fit.ring
    if semi[0] != semi[1]:
        assert abs(np.sin(fit.angle - angle)) < 0.01


def test_noise_moves_the_center_no_more_than_it_must():
    radius, noise = 10.0, 2.0
    errors = []
    for seed in range(60):
        center = 35 + np.random.default_rng([1, seed]).random(2)
        image, moments = scene(center, (radius, radius), 0.0, Optics(noise_grey=noise), seed)
        errors.append(fit_dot(image, center, moments).center - center)
    rms = np.sqrt(np.mean(np.square(errors)))
    # The bound of the center: information per unit of outline is the integral of the edge's squared slope,
    # contrast^2/(2 sqrt(pi) blur), over the noise's variance, and half of it counts along each axis.
    blur = np.sqrt(0.7**2 + 1 / 12)
    bound = noise / np.sqrt(np.pi * radius * 195**2 / (2 * np.sqrt(np.pi) * blur))
    # An RMS of 120 values scatters by 6.5 %: three times that above and below.
    assert 0.8 * bound < rms < 1.2 * bound


def test_ring_is_told_from_disk_and_its_shifted_hole_does_no_harm():
    hole = ((40.5, 33.7), (9, 5))
    image, moments = scene((40.3, 33.8), (18, 10), 0.4, Optics(noise_grey=0), hole=hole)
    fit = fit_dot(image, np.array([40.4, 33.7]), moments)
    assert fit.ring
    np.testing.assert_allclose(fit.center, [40.3, 33.8], rtol=0, atol=3e-3)


def test_contrast_and_blur_need_not_be_known():
    image, moments = scene((40.3, 33.8), (12, 8), 0.3, Optics(1.8, 0, dark=101, light=133))
    fit = fit_dot(image, np.array([40.6, 33.6]), moments)
    np.testing.assert_allclose(fit.center, [40.3, 33.8], rtol=0, atol=3e-3)


@pytest.mark.parametrize("shape", ["square", "triangle", "flat", "bright"])
def test_what_is_no_dot_is_refused(shape):
    y, x = np.indices((HEIGHT, WIDTH)) - 35
    inside = {
        "square": (abs(x) < 12) & (abs(y) < 12),
        "triangle": (y < 10) & (y > 1.7 * abs(x) - 18),
        "flat": np.zeros((HEIGHT, WIDTH), bool),
        "bright": np.hypot(x, y) > 12,
    }[shape]
    assert fit_dot(np.where(inside, 30.0, 225.0), np.array([35.0, 35.0]), 36 * np.eye(2)) is None


def test_a_speck_beside_the_dot_is_left_out():
    image, moments = scene((40.3, 33.8), (12, 12), 0.0, Optics(noise_grey=0))
    image[33:36, 54:56] = 30
    fit = fit_dot(image, np.array([40.3, 33.8]), moments)
    # Six dark pixels of a hundred would pull a centroid by 0.2 px.
    np.testing.assert_allclose(fit.center, [40.3, 33.8], rtol=0, atol=0.02)
