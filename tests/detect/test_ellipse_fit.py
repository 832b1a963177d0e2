from dataclasses import replace

import cv2
import numpy as np
import pytest

from markergen.detect import kernel
from markergen.detect.blobs import Blobs
from markergen.detect.candidates import find_blobs
from markergen.detect.ellipse_descent import BLUR, CENTER, COUNT, SCALE, SHAPE, SLOPES, EllipseDescent
from markergen.detect.ellipse_fit import fit_blobs, fit_unknowns
from markergen.detect.outline_pixels import OutlinePixels

WIDTH, HEIGHT, FINE = 96, 80, 6
MIDDLE = (48.3, 40.8)


def inside(center, semi, angle):
    """Share of each subpixel (FINE h, FINE w) in an ellipse: its edge is straight in so small a pixel."""
    y, x = (np.indices((FINE * HEIGHT, FINE * WIDTH)) + 0.5) / FINE - 0.5
    dx, dy = x - center[0], y - center[1]
    u, v = (np.cos(angle) * dx + np.sin(angle) * dy) / semi[0], (np.cos(angle) * dy - np.sin(angle) * dx) / semi[1]
    rho = np.maximum(np.hypot(u, v), 1e-9)
    return np.clip(0.5 - FINE * (rho - 1) * rho / np.hypot(u / semi[0], v / semi[1]), 0, 1)


def expose(ink, blur=0.7, noise=0.0, seed=0, dark=30, light=225, psf=None, shade=None):
    """Image of 8 bits; the scene is blurred in subpixels, by another way than the fit's model does it."""
    if psf is not None:
        ink = cv2.filter2D(ink, -1, psf / psf.sum(), borderType=cv2.BORDER_REPLICATE)
    elif blur:
        ink = cv2.GaussianBlur(ink, (0, 0), blur * FINE, borderType=cv2.BORDER_REPLICATE)
    grey = light - (light - dark) * cv2.resize(ink, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    grey = grey * (1 if shade is None else shade)
    grey = grey + noise * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def outline(center, semi, angle=0.0, middle=0.0, blur=0.8, light=225, dark=30):
    levels = (np.array([float(each)]) for each in (light, dark, blur, middle))
    if semi[0] < semi[1]:
        semi, angle = semi[::-1], angle + np.pi / 2
    center, semi, angle = (np.array([each], dtype=float) for each in (center, semi, angle))
    return Blobs(center, semi, angle, np.array([middle > 0.5]), np.eye(2)[None], *levels, np.array([False]))


def fit(image, center=MIDDLE, semi=(10, 10), angle=0.0, off=(0.3, -0.3), grown=0.3, **start):
    """Fit from a start that is more wrong than rough blobs are; only what the fit accepts."""
    dots = fit_blobs(image, outline(np.add(center, off), np.add(grown, semi), angle, **start))
    return dots.take(dots.fitted)


@pytest.mark.parametrize(
    ("semi", "angle"),
    [
        ((24, 24), 0.0),
        ((22, 9), 0.5),
        ((9.6, 3.3), -1.2),
        ((5, 5), 0.0),
        ((6, 3), 1.5),
        ((3, 1.5), 0.3),
        ((1.8, 1.7), 0.3),
        ((16, 2), 1.0),
    ],
)
def test_recovers_center_and_axes_without_noise(semi, angle):
    dots = fit(expose(inside(MIDDLE, semi, angle)), semi=semi, angle=angle)
    assert len(dots) == 1
    assert not dots.ring[0]
    # Rounding to whole levels, 0.29 grey levels RMS, and a model off by 0.01 of the contrast at the thin ones.
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=3e-3 if semi[1] > 2 else 0.012)
    # The model knows how a blur rounds off the tips: without that the axes lose up to 0.2 px.
    np.testing.assert_allclose(dots.semi[0], semi, rtol=0, atol=0.06)
    assert abs(dots.blur[0] - np.sqrt(0.7**2 + 1 / 12)) < 0.05
    if semi[0] != semi[1]:
        assert abs(np.sin(dots.angle[0] - angle)) < 0.01


def test_noise_moves_the_center_no_more_than_it_must():
    radius, noise = 10.0, 2.0
    errors, squared = [], []
    for seed in range(60):
        center = np.array([48.0, 40.0]) + np.random.default_rng([1, seed]).random(2)
        dots = fit(expose(inside(center, (radius, radius), 0), noise=noise, seed=seed), center)
        errors.append(dots.center[0] - center)
        squared.append(errors[-1] @ np.linalg.solve(dots.covariance[0], errors[-1]))
    # The bound of the center: information per unit of outline is the integral of the edge's squared slope,
    # contrast^2/(2 sqrt(pi) blur), over the noise's variance, and half of it counts along each axis.
    blur = np.sqrt(0.7**2 + 1 / 12)
    bound = np.sqrt(noise**2 + 1 / 12) / np.sqrt(np.pi * radius * 195**2 / (2 * np.sqrt(np.pi) * blur))
    # An RMS of 120 values scatters by 6.5 %, three times which is allowed, and the light's slope costs up to 15 %.
    assert 0.8 * bound < np.sqrt(np.mean(np.square(errors))) < 1.35 * bound
    # The mean of 60 values of chi^2 with 2 degrees of freedom: 2, and 2.6 times its standard deviation of 0.26.
    assert abs(np.mean(squared) - 2) < 0.67


@pytest.mark.long
@pytest.mark.parametrize(("semi", "noise"), [((12, 12), 2), ((9, 3), 2), ((4, 2), 2), ((12, 6), 20), ((3, 1.5), 4)])
def test_the_covariance_is_that_of_many_fits(semi, noise):
    # Eight at a time, as many as a marker's dots: they tell together whether the light has slopes.
    errors, squared = [], []
    for group in range(25):
        rng = np.random.default_rng([2, group])
        center, angle = np.array([48.0, 40.0]) + rng.random((8, 2)), rng.uniform(0, np.pi, 8)
        parts = [expose(inside(center[i], semi, angle[i]), noise=noise, seed=8 * group + i) for i in range(8)]
        center += WIDTH * np.arange(8)[:, None] * [1, 0]
        starts = [outline(center[i] + [0.3, -0.3], np.add(0.3, semi), angle[i]) for i in range(8)]
        rough = Blobs(*(np.concatenate([getattr(each, name) for each in starts]) for name in vars(starts[0])))
        dots = fit_blobs(np.hstack(parts), rough)
        error = (dots.center - center)[dots.fitted]
        errors.extend(error)
        squared.extend(np.einsum("bi,bij,bj->b", error, np.linalg.inv(dots.covariance[dots.fitted]), error))
    assert len(errors) > 195
    # 2.6 standard deviations of a mean of 200 values of chi^2 with 2 degrees of freedom.
    assert abs(np.mean(squared) - 2) < 2.6 * 2 / np.sqrt(len(errors))
    assert np.abs(np.mean(errors, axis=0)).max() < 4 * np.std(errors) / np.sqrt(len(errors))


def test_the_covariance_is_long_across_a_thin_dot():
    dots = fit(expose(inside(MIDDLE, (15, 4), 0), noise=2), semi=(15, 4))
    # Nearly all of its outline runs along x, and tells of y.
    assert dots.covariance[0, 0, 0] > 3 * dots.covariance[0, 1, 1]
    np.testing.assert_array_equal(dots.covariance[0], dots.covariance[0].T)


def test_ring_is_told_from_disk_and_its_shifted_hole_does_no_harm():
    ink = inside(MIDDLE, (18, 10), 0.4) - inside(np.add(MIDDLE, (0.2, -0.1)), (9, 5), 0.4)
    for middle in (1.0, 0.5):
        dots = fit(expose(ink), semi=(18, 10), angle=0.4, middle=middle)
        assert dots.ring.tolist() == [True]
        np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=3e-3)
        np.testing.assert_allclose(dots.semi[0], (18, 10), rtol=0, atol=0.05)


def test_a_disk_in_doubt_is_a_disk():
    dots = fit(expose(inside(MIDDLE, (8, 5), 0.4), noise=4), semi=(8, 5), angle=0.4, middle=0.4)
    assert dots.ring.tolist() == [False]


def test_contrast_and_blur_need_not_be_known():
    image = expose(inside(MIDDLE, (12, 8), 0.3), blur=1.8, dark=101, light=133)
    dots = fit(image, semi=(12, 8), angle=0.3, light=130, dark=105, blur=1.0)
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=0.01)


@pytest.mark.parametrize("kind", ["defocus", "motion"])
def test_other_blurs_than_a_normal_one_leave_the_center_where_it_is(kind):
    y, x = np.indices((49, 49)) - 24
    psf = (np.hypot(x, y) < 20 if kind == "defocus" else (abs(y - x / 2) < 4) & (abs(x) < 18)).astype(float)
    # The band of pixels is about the rough ellipse, and cuts off where such a blur does not fit.
    image = expose(inside(MIDDLE, (11, 7), 0.3), psf=psf, noise=2)
    dots = fit(image, semi=(11, 7), angle=0.3, blur=1.5, off=(0.1, -0.1))
    # Both are symmetric. The noise alone moves it by 0.006.
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=0.02)


def test_a_slope_of_the_light_is_seen():
    shade = np.linspace(0.75, 1.1, WIDTH)
    dots = fit(expose(inside(MIDDLE, (12, 12), 0), shade=shade), semi=(12, 12))
    # Without it in the model the center is 0.03 px off.
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=4e-3)


def test_a_reflection_adds_to_light_and_dark_alike():
    y, x = np.indices((HEIGHT, WIDTH))
    grey = expose(inside(MIDDLE, (12, 12), 0), light=150).astype(float)
    grey += 60 * np.exp(-((x - 62) ** 2 + (y - 30) ** 2) / (2 * 40**2))
    dots = fit(np.rint(grey).astype(np.uint8), semi=(12, 12), light=180)
    # With slopes in proportion to the levels it would be 0.06 px off; what the reflection has beyond a slope is left.
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=0.015)


@pytest.mark.parametrize("softness", [1.0, 4.0])
def test_a_shadow_across_one_of_many_dots_is_told(softness):
    centers = [(20.2, 20.7), (75.4, 22.1), (20.5, 58.3), (75.8, 58.6)]
    x = np.arange(WIDTH)
    shade = 1 - 0.25 * (1 + np.tanh((x - 82) / softness))
    image = expose(sum(inside(center, (11, 9), 0.3) for center in centers), noise=2, shade=shade)
    rough = [
        outline(np.add(center, 0.03), (11.05, 9.05), 0.3, light=222.0 - 60 * k) for k, center in enumerate(centers[:2])
    ]
    dots = fit_blobs(image, rough[0].joined(rough[1]))
    assert dots.fitted[0]
    # Half of the second is in the shadow: its center is off by no more than its covariance tells.
    error = dots.center[1] - centers[1]
    assert error @ np.linalg.solve(dots.covariance[1], error) < 5**2
    assert np.trace(dots.covariance[1]) > 2 * np.trace(dots.covariance[0])


def test_saturated_light_does_no_harm():
    # From the middle on the light is beyond 255.
    dots = fit(expose(inside(MIDDLE, (12, 12), 0), shade=np.linspace(0.8, 1.5, WIDTH)), semi=(12, 12))
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=0.01)


@pytest.mark.parametrize("shape", ["square", "triangle", "flat", "bright", "half", "letter"])
def test_what_is_no_dot_is_refused(shape):
    y, x = np.indices((HEIGHT, WIDTH)) - 40
    inside = {
        "square": (abs(x) < 12) & (abs(y) < 12),
        "triangle": (y < 10) & (y > 1.7 * abs(x) - 18),
        "flat": np.zeros((HEIGHT, WIDTH), bool),
        "bright": np.hypot(x, y) > 12,
        "half": (np.hypot(x, y) < 12) & (x > 0),
        "letter": (np.hypot(x, y) < 12) & ~((np.hypot(x, y) < 7) | ((abs(y) < 9) & (x > 0))),
    }[shape]
    image = cv2.GaussianBlur(np.where(inside, 30.0, 225.0), (0, 0), 0.7).astype(np.uint8)
    middles = (1.0,) if shape in ("letter", "bright") else (0.0, 0.4, 1.0)
    for middle in middles:
        rough = outline((40.0, 40.0), (12, 12), middle=middle)
        dots = fit_blobs(image, rough)
        # The rough ellipse stays, and is known to be one.
        assert not dots.fitted[0]
        for name in ("center", "semi", "angle", "ring"):
            np.testing.assert_array_equal(getattr(dots, name), getattr(rough, name))
        assert np.linalg.eigvalsh(dots.covariance[0])[0] >= 0.2**2


@pytest.mark.parametrize("grey", [30, 120, 225, 250])
@pytest.mark.parametrize("ring", [False, True])
def test_what_lies_over_a_dot_never_moves_its_center(grey, ring):
    rng = np.random.default_rng([grey, ring])
    found = 0
    for seed in range(25):
        semi, angle = (rng.uniform(8, 16), rng.uniform(5, 8)), rng.uniform(0, np.pi)
        ink = inside(MIDDLE, semi, angle) - (inside(MIDDLE, np.divide(semi, 2), angle) if ring else 0)
        # An edge across, from none of the dot hidden to half of it.
        towards, height = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1.3)
        y, x = (np.indices(ink.shape) + 0.5) / FINE - 0.5
        along = np.cos(towards) * (x - MIDDLE[0]) + np.sin(towards) * (y - MIDDLE[1])
        reach = np.hypot(semi[0] * np.cos(towards - angle), semi[1] * np.sin(towards - angle))
        ink = np.where(along > height * reach, (225 - grey) / 195, ink)
        dots = fit(expose(ink, noise=2, seed=seed), semi=semi, angle=angle, middle=float(ring))
        found += len(dots)
        if len(dots):
            error = dots.center[0] - MIDDLE
            # 6 standard deviations, and 0.02 px for what is hidden by less than a pixel.
            assert np.linalg.norm(error) < 0.02 + 6 * np.sqrt(np.trace(dots.covariance[0]))
    # A quarter of the edges miss the dot, of which some are too near to tell.
    assert found >= 2


def test_a_speck_beside_the_dot_is_left_out():
    image = expose(inside(MIDDLE, (12, 12), 0))
    image[40:43, 62:64] = 30
    # Six dark pixels of a hundred would pull a centroid by 0.2 px.
    np.testing.assert_allclose(fit(image, semi=(12, 12)).center[0], MIDDLE, rtol=0, atol=0.02)


@pytest.mark.parametrize("gap", [1.5, 2, 3])
def test_a_dark_thing_beside_the_dot_does_no_harm(gap):
    ink = inside(MIDDLE, (12, 9), 0)
    ink[:, int(FINE * (MIDDLE[0] + 12 + gap + 0.5)) :] = 1
    dots = fit(expose(ink, noise=2), semi=(12, 9))
    # Its blurred edge darkens the dot's. The noise alone moves the center by 0.005.
    np.testing.assert_allclose(dots.center[0], MIDDLE, rtol=0, atol=0.03)


def test_many_at_once_are_what_they_are_alone():
    centers = [(20.2, 20.7), (60.4, 22.1), (30.5, 58.3), (70.8, 55.6)]
    ink = sum(inside(center, (9, 6), k) for k, center in enumerate(centers))
    image = expose(ink, noise=1)
    outlines = find_blobs(image)
    together = fit_blobs(image, outlines)
    assert together.fitted.all()
    assert len(together) == 4
    for k in range(4):
        alone = fit_blobs(image, outlines.take(np.array([k])))
        # But for the slope of the light, which is expected to be as in the others.
        np.testing.assert_allclose(alone.center[0], together.center[k], rtol=0, atol=5e-3)


def test_nothing_of_nothing():
    image = np.full((50, 60), 200, np.uint8)
    dots = fit_blobs(image, outline(MIDDLE, (9, 9)).take(np.zeros(0, dtype=np.intp)))
    assert len(dots) == 0
    assert dots.covariance.shape == (0, 2, 2)
    assert dots.center.shape == (0, 2)


TRUTH = np.array([[20.3, 18.6, 0.09, 0.02, 0.12, 200, 40, 0.9, 0.4, -0.2, 0.12, -0.06, 20.5, 18.5, 0.5]])


def grid(grey=None):
    y, x = np.indices((40, 42)).reshape(2, -1).astype(float)
    grey = np.zeros(x.size) if grey is None else grey
    return OutlinePixels(x, y, grey, np.zeros(x.size, dtype=np.intp), np.array([0, x.size]))


def descent(unknowns, pixels, ring=True, top=200.0):
    made = EllipseDescent(pixels, unknowns, np.array([ring]), 2.5, top)
    # The light's slope is about a place that stands still.
    made.origin = TRUTH[:, CENTER]
    return made


def levels(unknowns, ring=True):
    """Grey levels of the grid and their derivatives."""
    pixels = grid()
    return descent(unknowns, pixels, ring).model(np.array([0]), np.diff(pixels.start), pixels.x, pixels.y, None)[:2]


@pytest.mark.parametrize("column", range(COUNT))
def test_derivatives(column):
    step = 1e-5 * np.abs(TRUTH[0]).max(where=np.arange(COUNT) == column, initial=1e-2)
    high, low = TRUTH.copy(), TRUTH.copy()
    high[0, column] += step
    low[0, column] -= step
    by_hand = (levels(high)[0] - levels(low)[0]) / (2 * step)
    # What changes along the edge's normal is exact; the rest, of the width and curvature of the edge, is left out.
    scale = np.abs(by_hand).max()
    assert np.sqrt(np.mean((levels(TRUTH)[1][column] - by_hand) ** 2)) < 0.06 * scale


@pytest.mark.parametrize("ring", [False, True])
def test_finds_what_made_the_image(ring):
    start = TRUTH.copy()
    start[0, CENTER] += [0.5, -0.4]
    start[0, SHAPE] *= 0.93
    start[0, BLUR], start[0, SLOPES], start[0, SCALE] = 1.3, 0, 0.45
    fit = descent(start, grid(np.minimum(levels(TRUTH, ring)[0], 200)), ring)
    fit.run()
    used = COUNT if ring else COUNT - 3
    # The last step of a center is below 2e-3 px, and the next would be far below.
    found, made = fit.unknowns[0, :used], TRUTH[0, :used]
    dark = np.isin(np.arange(used), [10, 11])
    np.testing.assert_allclose(found[~dark], made[~dark], rtol=2e-3, atol=4e-4)
    # The dark's slope is held near its share of the light's.
    np.testing.assert_allclose(found[dark], made[dark], rtol=0, atol=2e-3)
    assert fit.complete(fit.noise()).all()
    assert not fit.left_out.any()


def test_what_runs_away_is_dropped():
    fit = descent(TRUTH, grid(np.random.default_rng(0).uniform(0, 255, 40 * 42)))
    fit.run()
    assert not fit.complete(fit.noise()).any()


def test_the_chosen_move_and_the_others_stay():
    one = grid(levels(TRUTH)[0])
    n = one.x.size
    two = OutlinePixels(
        np.tile(one.x, 2), np.tile(one.y, 2), np.tile(one.grey, 2), np.repeat([0, 1], n), np.array([0, n, 2 * n])
    )
    start = np.concatenate([TRUTH, TRUTH])
    start[:, CENTER] += 0.3
    fit = EllipseDescent(two, start, np.array([True, True]), 2.5, np.inf)
    fit.evaluate(np.array([False, True]), fresh=True)
    fit.move(np.array([False, True]))
    np.testing.assert_array_equal(fit.unknowns[0], start[0])
    assert np.abs(fit.unknowns[1, CENTER] - TRUTH[0, CENTER]).max() < 0.1
    assert not fit.residual[:n].any()
    assert fit.residual[n:].any()


def crowd(bits=8):
    """Image and rough blobs of disks and rings, small, thin, covered, cut off and in doubt."""
    rng = np.random.default_rng(3)
    centers = [
        (14, 14),
        (40, 13),
        (66, 15),
        (86, 13),
        (13, 40),
        (38, 42),
        (66, 42),
        (88, 42),
        (15, 66),
        (42, 66),
        (94, 70),
    ]
    semis = [(9, 6), (10, 10), (9, 4), (3, 2.5), (7, 7), (12, 9), (11, 10), (1.9, 1.8), (8, 2.5), (9, 8), (8, 8)]
    rings = np.array([0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0], dtype=bool)
    centers = np.array(centers) + rng.random((11, 2))
    ink = sum(
        inside(c, s, k) - r * inside(c, np.divide(s, 2), k)
        for k, (c, s, r) in enumerate(zip(centers, semis, rings, strict=True))
    )
    ink[int(44 * FINE) : int(54 * FINE), int(60 * FINE) : int(67 * FINE)] = 0.6
    image = expose(ink, noise=2, shade=np.linspace(0.8, 1.2, WIDTH))
    if bits > 8:
        image = np.left_shift(image.astype(np.uint16), bits - 8)
    unit = 2.0 ** (bits - 8)
    blobs = [
        outline(c + rng.normal(0, 0.1, 2), np.add(s, 0.1), k, float(r), light=220 * unit, dark=35 * unit)
        for k, (c, s, r) in enumerate(zip(centers, semis, rings, strict=True))
    ]
    together = blobs[0]
    for each in blobs[1:]:
        together = together.joined(each)
    return image, together


@pytest.mark.skipif(kernel.library() is None, reason=f"{kernel.missing()}")
@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("cut", [False, True])
def test_compiled_and_in_numpy_it_is_the_same(monkeypatch, bits, cut):
    image, blobs = crowd(bits)
    if cut:
        # Rows of a larger array.
        image, blobs = image[2:, 3:], replace(blobs, center=blobs.center - [3, 2])
    compiled, fast = fit_unknowns(image, blobs, blobs.ring), fit_blobs(image, blobs)
    monkeypatch.setattr(kernel, "library", lambda: None)
    plain, slow = fit_unknowns(image, blobs, blobs.ring), fit_blobs(image, blobs)
    assert 7 <= fast.fitted.sum() < len(blobs)
    np.testing.assert_array_equal(fast.fitted, slow.fitted)
    np.testing.assert_array_equal(compiled.complete, plain.complete)
    # Rounding to 1e-16, times the condition of the normal matrices, at most 1e9 by their ridge.
    for name in ("unknowns", "inverse", "variance", "noise"):
        mine, twin = (getattr(each, name)[plain.complete] for each in (compiled, plain))
        np.testing.assert_allclose(mine, twin, rtol=1e-6, atol=1e-9 * np.abs(twin).max())
    np.testing.assert_allclose(fast.center, slow.center, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fast.covariance, slow.covariance, rtol=1e-6)
