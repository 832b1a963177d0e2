import numpy as np
import pytest
from scipy.stats import norm

from markergen.errors import InputError
from markergen.render.optics import AIRY_SIGMA, FINENESS, Optics, expose, optics_from_text, quantize

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


def test_a_window_is_the_part_of_the_whole_it_stands_for():
    window = np.zeros((FINENESS * 30, FINENESS * 20))
    window[20:40, 16:24] = 1
    whole = np.zeros((FINENESS * 60, FINENESS * 80))
    whole[FINENESS * 7 : FINENESS * 37, FINENESS * 50 : FINENESS * 70] = window
    optics = Optics(0.7, 0, vignetting=0.4, gradient=0.3)
    part, all_of_it = expose(window, optics, None, (50, 7), (60, 80)), expose(whole, optics, None)
    # Single precision.
    np.testing.assert_allclose(part, all_of_it, rtol=0, atol=1e-4)


def lit(optics):
    """A blank sheet in this light, noise-free."""
    return expose(np.zeros((FINENESS * 61, FINENESS * 81)), optics, None)


def test_exposure_multiplies_and_saturates():
    np.testing.assert_allclose(lit(Optics(noise_grey=0, exposure=0.5)), 112.5)
    assert (quantize(lit(Optics(noise_grey=0, exposure=1.5))) == 255).all()


def test_vignetting_is_cos4_and_takes_its_share_at_the_corners():
    grey = lit(Optics(noise_grey=0, light=200, vignetting=0.4)) / 200
    assert grey[30, 40] == pytest.approx(1)
    # The outermost pixel's middle is half a pixel short of the corner.
    np.testing.assert_allclose(grey[[0, 0, -1, -1], [0, -1, 0, -1]], 0.6, rtol=0, atol=0.01)
    tangent_square = (81**2 + 61**2) / 4 / (0.6**-0.5 - 1)
    expected = np.cos(np.arctan(np.sqrt(20**2 / tangent_square))) ** 4
    np.testing.assert_allclose([grey[10, 40], grey[30, 60]], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("direction", "dark", "bright"),
    [
        (0, (30, 0), (30, 80)),
        (90, (0, 40), (60, 40)),
        (180, (30, 80), (30, 0)),
        (45, (0, 0), (60, 80)),
    ],
)
def test_gradient_is_linear_from_end_to_end(direction, dark, bright):
    grey = lit(Optics(noise_grey=0, light=100, gradient=0.5, gradient_deg=direction)) / 100
    assert grey[30, 40] == pytest.approx(1)
    # From 1 - 0.25 to 1 + 0.25 at the image's edges, which are half a pixel outside of the last middles.
    assert grey[dark] == pytest.approx(0.75, abs=0.006)
    assert grey[bright] == pytest.approx(1.25, abs=0.006)
    assert grey[dark] + grey[bright] == pytest.approx(2, abs=1e-6)


@pytest.mark.parametrize("psf", [{"defocus_px": 3.0}, {"motion_px": 9.0, "motion_deg": 30.0}, {"blur_px": 1.5}])
def test_edge_blur_is_what_edges_show(psf):
    optics = Optics(**{"blur_px": 0.0, "noise_grey": 0, "dark": 0, "light": 1, **psf})
    variances = []
    for offset in np.arange(8) / 8:
        ink = np.clip(np.arange(FINENESS * 61) + 1 - FINENESS * (30 + offset), 0, 1)
        for axis in (0, 1):
            image = np.broadcast_to(np.expand_dims(ink, 1 - axis), (len(ink), len(ink)))
            slope = -np.diff(np.take(expose(image, optics, None).astype(float), 30, axis=1 - axis))
            place = np.arange(len(slope)) + 0.5
            assert slope.sum() == pytest.approx(1, abs=1e-6)
            # Nothing moves: ink begins 30 px and the offset from the first pixel's edge, which is at -0.5.
            assert slope @ place == pytest.approx(29.5 + offset, abs=1e-4)
            variances.append(slope @ (place - slope @ place) ** 2)
    # Differences of neighboring pixels spread by a twelfth more. A Gaussian ends at 4 sigma and lacks 0.1 % of its
    # variance; the subpixels in which disk and line are counted add at most a sixth of their square.
    assert np.mean(variances) == pytest.approx(optics.edge_blur**2 + 1 / 12, abs=1 / (6 * FINENESS**2))


def test_a_point_spreads_no_farther_than_the_reach():
    for optics in (
        Optics(1.3, 0),
        Optics(0.5, 0, defocus_px=4),
        Optics(0.5, 0, diffraction_px=2.5),
        Optics(0.5, 0, motion_px=9, motion_deg=60),
    ):
        ink = np.zeros((FINENESS * 61, FINENESS * 61))
        ink[FINENESS * 30, FINENESS * 30] = 1
        rows, columns = np.nonzero(expose(ink, optics, None) != 225)
        assert np.abs([rows - 30, columns - 30]).max() <= optics.reach_px


@pytest.mark.parametrize(
    ("full_well", "noise", "bits"), [(500.0, 0.0, 16), (500.0, 1.0, 8), (10_000.0, 2.0, 12), (None, 0.0, 8)]
)
def test_noise_is_as_strong_as_foretold(full_well, noise, bits):
    for level in (40.3, 160.7):
        optics = Optics(0.7, noise, 0, level, full_well=full_well, bits=bits)
        image = quantize(expose(BLANK, optics, np.random.default_rng(3)), bits) * (255 / (2**bits - 1))
        if noise == 0 and full_well is None:
            # Without noise rounding is an error of its own, at most half a level.
            assert np.abs(image - level).max() <= 0.5
            continue
        # Five standard errors of mean and standard deviation of what, with 80 electrons or more, is nearly normal.
        expected = float(optics.grey_noise(level))
        assert image.mean() == pytest.approx(level, abs=5 * expected / np.sqrt(image.size))
        assert image.std() == pytest.approx(expected, abs=5 * expected / np.sqrt(2 * image.size))


def test_few_electrons_are_counted_one_by_one():
    grey = expose(BLANK, Optics(0, 0, 0, 255, exposure=0.1, full_well=20), np.random.default_rng(4))
    electrons = grey * (20 / 255)
    np.testing.assert_allclose(electrons, np.rint(electrons), rtol=0, atol=1e-5)
    # Poisson of mean 2: none at all in exp(-2) of the pixels, to five standard errors.
    share = np.exp(-2)
    assert np.mean(electrons < 0.5) == pytest.approx(share, abs=5 * np.sqrt(share / grey.size))


@pytest.mark.parametrize(("bits", "kind", "top"), [(8, np.uint8, 255), (10, np.uint16, 1023), (16, np.uint16, 65535)])
def test_levels_of_the_sensor(bits, kind, top):
    image = quantize(np.array([-1, 0, 51, 255, 256], np.float32), bits)
    assert image.dtype == kind
    np.testing.assert_array_equal(image, [0, 0, round(top / 5), top, top])


@pytest.mark.parametrize(
    "values",
    [
        {"blur_px": -0.1},
        {"noise_grey": float("nan")},
        {"blur_px": float("inf")},
        {"dark": 225},
        {"light": 256},
        {"dark": -1},
        {"defocus_px": 101},
        {"motion_px": float("nan")},
        {"motion_deg": float("inf")},
        {"exposure": 0},
        {"vignetting": 1},
        {"gradient": 2},
        {"gradient": -0.1},
        {"gradient_deg": float("nan")},
        {"full_well": 0.5},
        {"bits": 7},
        {"bits": 17},
        {"diffraction_px": 101},
        {"aperture_mm": -1},
        {"focus": 0},
        {"wavelength_nm": 0},
        {"aperture_mm": 2, "defocus_px": 1},
    ],
)
def test_impossible_optics_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values))):
        Optics(**values)


def test_optics_from_text():
    assert optics_from_text("") == Optics()
    assert optics_from_text(" blur_px=1.5, bits=12,full_well=1e4 ") == Optics(1.5, bits=12, full_well=1e4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("blr_px=1", "blur_px"),
        ("blur_px", "number"),
        ("blur_px=wide", "number"),
        ("bits=8.5", "of 8 to 16"),
        ("blur_px=1,blur_px=2", "once"),
        ("blur_px=-1", "blur_px=-1"),
    ],
)
def test_unusable_text_is_one_line(text, message):
    with pytest.raises(InputError, match=message) as raised:
        optics_from_text(text)
    assert "\n" not in str(raised.value)


def test_a_thin_lens_blurs_by_depth():
    lens = Optics(aperture_mm=2.0, focus=0.8, wavelength_nm=500)
    assert lens.at(600, 0.8).defocus_px == 0
    # Of a lens of focal length F and its image at v behind it, rays of a point at z cross the sensor in a disk of
    # diameter A v |1/z0 - 1/z|; the focal length in px is v over the size of a pixel, here 4 mm / 600.
    for depth in (0.5, 1.5):
        image = 1 / (1 / 0.004 - 1 / 0.8)
        focal = 1 / (1 / 0.8 + 1 / image)
        sharp = 1 / (1 / focal - 1 / depth)
        disk = 0.002 * abs(sharp - image) / sharp
        assert lens.at(image * 150_000, depth).defocus_px == pytest.approx(disk / 2 * 150_000, rel=1e-9)
    # Rayleigh: 1.22 l f/A.
    assert lens.at(600, 0.5).diffraction_px == pytest.approx(1.22 * 500e-9 * 600 / 0.002)
    assert Optics(0.5).at(600, 0.5) == Optics(0.5)


def test_the_sum_of_an_airy_edge_has_the_energy_of_its_gaussian():
    # The integral of MTF^2 = energy of the line's image; that of a Gaussian of s is 1/(2 sqrt(pi) s).
    share = np.linspace(0, 1, 100_001)
    mtf = 2 / np.pi * (np.arccos(share) - share * np.sqrt(1 - share**2))
    energy = 2 * np.trapezoid(mtf**2, share) * 1.21967
    assert 1 / (2 * np.sqrt(np.pi) * energy) == pytest.approx(AIRY_SIGMA, rel=0.02)
