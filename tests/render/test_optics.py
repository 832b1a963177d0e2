import numpy as np
import pytest
from scipy.stats import norm

from markergen.errors import InputError
from markergen.render.optics import FINENESS, Optics, expose, quantize

BLANK = np.zeros((FINENESS * 480, FINENESS * 640))


def test_noise_has_the_asked_statistics():
    grey = expose(BLANK, Optics(noise_grey=2.0), np.random.default_rng(1))
    # Five standard errors of mean and standard deviation of 307200 normal numbers.
    assert grey.mean() == pytest.approx(225, abs=5 * 2 / np.sqrt(grey.size))
    assert grey.std() == pytest.approx(2.0, abs=5 * 2 / np.sqrt(2 * grey.size))
    # The noise is white: neighbors are uncorrelated, again to five standard errors.
    centered = grey - grey.mean()
    for shifted in (centered[1:] * centered[:-1], centered[:, 1:] * centered[:, :-1]):
        assert abs(shifted.mean()) < 5 * 4 / np.sqrt(grey.size)


def test_rounding_adds_a_twelfth_to_the_variance():
    grey = quantize(expose(BLANK, Optics(noise_grey=2.0), np.random.default_rng(2)))
    # Five standard errors of the variance.
    assert grey.var() == pytest.approx(4 + 1 / 12, abs=5 * 4 * np.sqrt(2 / grey.size))


@pytest.mark.parametrize("blur", [0.5, 0.7, 1.5])
def test_edge_is_spread_by_lens_and_pixel(blur):
    coverage = np.zeros((FINENESS * 21, FINENESS * 40))
    coverage[:, : FINENESS * 20] = 1
    grey = expose(coverage, Optics(blur, noise_grey=0), np.random.default_rng(0))
    # The edge, at 19.5 px, seen through the Gaussian and averaged over each pixel, in closed form.
    from_edge = np.arange(40) - 19.5

    def integral(x):
        return x * norm.cdf(x / blur) + blur * norm.pdf(x / blur)

    expected = 30 + 195 * (integral(from_edge + 0.5) - integral(from_edge - 0.5))
    # An edge that runs between subpixels of width w lacks w^2/12 of the variance twice: as nothing is covered in
    # part, and as the Gaussian is summed at the subpixels' middles. 0.242 is the largest slope of the step by it.
    tolerance = 195 * 0.242 / blur**2 / (12 * FINENESS**2)
    np.testing.assert_allclose(grey, np.broadcast_to(expected, grey.shape), rtol=0, atol=tolerance)


def test_levels_without_blur_and_noise_are_exact():
    coverage = np.repeat([[0.0, 0.0, 0.25, 0.75, 1.0, 1.0]], FINENESS, axis=0)
    image = expose(coverage, Optics(0, 0, dark=20, light=220), np.random.default_rng(0))
    np.testing.assert_array_equal(image, [[220, 120, 20]])


def test_sensor_saturates():
    np.testing.assert_array_equal(quantize(np.array([-3, 0.4, 0.6, 254.6, 300], np.float32)), [0, 0, 1, 255, 255])


@pytest.mark.parametrize(
    "values",
    [
        {"blur_px": -0.1},
        {"noise_grey": float("nan")},
        {"blur_px": float("inf")},
        {"dark": 225},
        {"light": 256},
        {"dark": -1},
    ],
)
def test_impossible_optics_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values))):
        Optics(**values)
