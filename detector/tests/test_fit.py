"""Fits of rendered dots of known places: their errors, and how often the region of 95 % has the place."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from stages import drawn, find_blobs, fit_blobs, grid, matched
from structures import FITTED, REFUSED

SHAPE = (300, 400)


def fitted(dots, rng, shape=SHAPE, change=None, inverted=False, **optics):
    """The truth and the fitted blobs of the dots that were found."""
    image = drawn(shape, dots, rng, **optics)
    image = image if change is None else change(image)
    blobs = find_blobs(image, inverted=inverted)
    at = matched(blobs, dots[:, :2])
    return dots[at >= 0], fit_blobs(image, blobs, at[at >= 0], inverted)[at[at >= 0]]


def mahalanobis(blobs, dots):
    x, y = (blobs["center"] - dots[:, :2]).T
    xx, xy, yy = blobs["covariance"].T
    return (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


@pytest.mark.parametrize(
    ("semi", "hole", "optics", "most"),
    [
        (8.0, 0.0, {}, 0.02),
        (8.0, 0.5, {}, 0.02),
        (4.0, 0.0, {}, 0.03),
        (8.0, 0.0, {"blur": 1.8, "noise": 3.0}, 0.05),
        (5.0, 0.0, {"blur": 0.1, "noise": 1.0, "fine": 15}, 0.02),
        (30.0, 0.5, {"noise": 4.0}, 0.03),
        (8.0, 0.0, {"light": 120.0, "dark": 80.0, "noise": 2.0}, 0.08),
    ],
)
def test_centers_are_within_their_covariance(rng, semi, hole, optics, most):
    error, square = [], []
    # To draw a sharp image takes long.
    for _ in range(1 if "fine" in optics else 3):
        dots, blobs = fitted(grid(rng, semi, SHAPE, hole), rng, **optics)
        assert (blobs["state"] == FITTED).mean() > 0.95
        good = blobs["state"] == FITTED
        square.append(mahalanobis(blobs[good], dots[good]))
        error.append(np.linalg.norm(blobs["center"] - dots[:, :2], axis=1)[good])
        assert ((blobs["hole"] > 0.5) == (dots[:, 5] > 0)).all()
    assert np.median(np.concatenate(error)) < most
    square = np.concatenate(square)
    # Of chi2 with 2 degrees of freedom, 95 % are below 5.99.
    slack = 3 * np.sqrt(0.05 * 0.95 / len(square))
    assert (square < 5.99).mean() > 0.93 - slack
    assert 1.4 - 4 / np.sqrt(len(square)) < square.mean() < 2.6 + 8 / np.sqrt(len(square))


@pytest.mark.parametrize(("side", "state"), [(1.0, REFUSED), (4.0, FITTED)])
def test_a_dot_may_be_as_far_from_its_rough_place_as_pixels_were_wide(rng, side, state):
    image = drawn(SHAPE, grid(rng, 30.0, SHAPE), rng)
    blobs = find_blobs(image)
    best = fit_blobs(image, blobs)
    blobs["center"] += [1.5, -1.0]
    blobs["side"] = side
    again = fit_blobs(image, blobs)
    assert (again["state"] == state).all()
    if state == FITTED:
        assert_allclose(again["center"], best["center"], atol=0.002)


def test_sizes_levels_and_blur_are_those_drawn(rng):
    dots, blobs = fitted(grid(rng, 10.0, SHAPE), rng, noise=0.5)
    assert_allclose(blobs["semi"], dots[:, 2:4], atol=0.03)
    apart = (blobs["angle"] - dots[:, 4] + np.pi / 2) % np.pi - np.pi / 2
    assert np.abs(apart[dots[:, 2] > 11]).max() < 0.05
    assert_allclose(blobs["light"], 200, atol=1)
    assert_allclose(blobs["dark"], 40, atol=1)
    assert_allclose(blobs["blur"], np.hypot(0.7, 12**-0.5), atol=0.03)


@pytest.mark.parametrize("bits", [10, 16])
def test_wide_and_light_images_give_the_same_centers(rng, bits):
    dots = grid(rng, 8.0, SHAPE)
    high = 2**bits - 1
    image = drawn(SHAPE, dots, rng, light=0.8 * high, dark=0.2 * high, noise=0.004 * high, dtype=np.uint16)
    blobs = find_blobs(image)
    blobs = fit_blobs(image, blobs)[matched(blobs, dots[:, :2])]
    light = find_blobs(~image, inverted=True)
    light = fit_blobs(~image, light, inverted=True)[matched(light, dots[:, :2])]
    assert (blobs["state"] == FITTED).all()
    assert np.linalg.norm(blobs["center"] - dots[:, :2], axis=1).max() < 0.06
    assert_allclose(light["center"], blobs["center"], atol=0.01)


def test_saturated_paper_does_not_move_the_centers(rng):
    dots, blobs = fitted(grid(rng, 8.0, SHAPE), rng, light=330.0, dark=60.0, noise=1.5)
    good = blobs["state"] == FITTED
    assert good.mean() > 0.9
    assert np.linalg.norm(blobs["center"] - dots[:, :2], axis=1)[good].max() < 0.08
    assert np.median(blobs["light"][good]) == pytest.approx(330, abs=40)


def test_a_highlight_that_saturates_beside_dots_hardly_moves_their_centers(rng):
    off = []
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    for _ in range(3):
        at = rng.uniform((70, 70), (330, 230), (3, 2))
        shine = 180 * np.exp(-np.min([(x - u) ** 2 + (y - v) ** 2 for u, v in at], axis=0) / (2 * 25**2))
        dots, blobs = fitted(grid(rng, 8.0, SHAPE), rng, light=200 + shine, dark=40 + shine, noise=2.0)
        good = blobs["state"] == FITTED
        assert good.mean() > 0.9
        beside = np.abs(shine[tuple(np.rint(dots[:, 1::-1]).astype(int).T)] - 55) < 25
        off.append(np.linalg.norm(blobs["center"] - dots[:, :2], axis=1)[good & beside])
    # With straight light, 0.046 px.
    assert np.median(np.concatenate(off)) < 0.025


def test_a_part_that_is_covered_is_left_out_and_more_is_refused(rng):
    dots = grid(rng, 14.0, SHAPE, tilt=1.05)

    def cover(share):
        def change(image):
            for x, y, a, *_ in dots:
                image[int(y - a - 4) : int(y - a + 2 * a * share), int(x - a - 4) : int(x + a + 5)] = 200
            return image

        return change

    truth, blobs = fitted(dots, rng, change=cover(0.03))
    good = blobs["state"] == FITTED
    assert good.mean() > 0.8
    assert np.linalg.norm(blobs["center"] - truth[:, :2], axis=1)[good].max() < 0.15
    truth, blobs = fitted(dots, rng, change=cover(0.5))
    assert (blobs["state"] == REFUSED).all()


def test_a_slope_of_the_light_does_not_move_the_centers(rng):
    dots = grid(rng, 10.0, SHAPE)
    shade = np.linspace(0.4, 1, SHAPE[1])
    _, blobs = fitted(dots, rng, change=lambda image: np.rint(image * shade).astype(np.uint8))
    off = (blobs["center"] - dots[:, :2])[blobs["state"] == FITTED]
    assert np.abs(off.mean(axis=0)).max() < 0.01


def test_a_refused_blob_stays_as_rough_as_it_was(rng):
    image = rng.integers(0, 255, SHAPE).astype(np.uint8)
    blobs = find_blobs(drawn(SHAPE, grid(rng, 8.0, SHAPE), rng))
    refused = fit_blobs(image, blobs)
    assert (refused["state"] == REFUSED).all()
    for name in ("center", "semi", "angle", "light", "dark", "blur", "hole"):
        assert_allclose(refused[name], blobs[name])
    assert (refused["covariance"][:, [0, 2]] >= 0.2**2 - 1e-12).all()


def test_only_those_asked_for_are_fitted(rng):
    image = drawn(SHAPE, grid(rng, 8.0, SHAPE), rng)
    blobs = find_blobs(image)
    subset = fit_blobs(image, blobs, [3, 5])
    assert np.flatnonzero(subset["state"] != blobs["state"]).tolist() == [3, 5]
    np.testing.assert_array_equal(fit_blobs(image, blobs, []), blobs)


def test_no_number_of_a_blob_leads_out_of_the_image(rng):
    image = rng.integers(0, 255, (40, 50)).astype(np.uint8)
    blobs = np.repeat(find_blobs(drawn(SHAPE, grid(rng, 8.0, SHAPE), rng))[:1], 200)
    for name in ("center", "semi", "angle", "light", "dark", "blur", "hole"):
        odd = rng.choice([np.nan, np.inf, -np.inf, 0, -1, 1e-300, 1e300, 1e6, 25, 3], blobs[name].shape)
        blobs[name] = np.where(rng.random(blobs[name].shape) < 0.3, odd, blobs[name])
    fit_blobs(image, blobs)
