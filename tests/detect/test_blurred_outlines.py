import numpy as np
import pytest
from dot_scenes import scene
from scipy.ndimage import gaussian_filter
from scipy.special import chndtr

from markergen.detect import blurred_outlines
from markergen.detect.blurred_outlines import unblurred
from markergen.detect.candidates import find_blobs

FINE = 24
"""Pixels per blur."""


@pytest.fixture(scope="module")
def rings():
    """Size, and the radial profile of ink, of some blurred rings drawn finely."""
    profiles = {}
    for size in (2, 3, 5, 8):
        x = np.arange(-(size + 4) * FINE, (size + 4) * FINE + 1) / FINE
        radius = np.hypot(x, x[:, None])
        ink = gaussian_filter(((radius < size) & (radius > size / 2)).astype(float), FINE)
        profiles[size] = ink[len(x) // 2, len(x) // 2 :]
    return profiles


def test_the_table_of_rings_is_that_of_rings_drawn_and_blurred(rings):
    for size, ink in rings.items():
        k = int(np.flatnonzero(size == blurred_outlines._RING_SIZE)[0])
        depth = ink.max()
        seen = np.flatnonzero(ink >= depth / 2)[-1] / FINE
        assert blurred_outlines._RING_DEPTH[k] == pytest.approx(depth, abs=0.01)
        assert blurred_outlines._RING_SEEN[k] == pytest.approx(seen, abs=1.5 / FINE)
        assert blurred_outlines._RING_MIDDLE[k] == pytest.approx(1 - ink[0] / depth, abs=0.02)


def test_the_table_of_rings_follows_from_the_noncentral_chi_squared_distribution():
    x = np.linspace(0, 20, 8001)
    for size, seen, depth, middle in zip(
        blurred_outlines._RING_SIZE,
        blurred_outlines._RING_SEEN,
        blurred_outlines._RING_DEPTH,
        blurred_outlines._RING_MIDDLE,
        strict=True,
    ):
        ink = chndtr(size**2, 2, x**2) - chndtr(size**2 / 4, 2, x**2)
        assert depth == pytest.approx(ink.max(), abs=6e-4)
        assert seen == pytest.approx(x[np.flatnonzero(ink >= ink.max() / 2)[-1]], abs=6e-3)
        assert middle == pytest.approx(1 - ink[0] / ink.max(), abs=6e-4)


def profile(semi, blur):
    """Half-level semi-axes, slope and level in the middle of an ellipse drawn 16 times as fine and blurred."""
    side = 16
    reach = [int(each + 5 * blur + 3) for each in semi]
    y, x = (np.arange(-side * each, side * each + 1) / side for each in reach[::-1])
    ink = gaussian_filter(((x / semi[0]) ** 2 + (y[:, None] / semi[1]) ** 2 < 1).astype(float), side * blur)
    across = ink[len(y) // 2, len(x) // 2 :], ink[len(y) // 2 :, len(x) // 2]
    level = [np.flatnonzero(each >= each[0] / 2)[-1] / side for each in across]
    slope = [
        (each[round(side * (at - 1))] - each[round(side * (at + 1))]) / each[0]
        for each, at in zip(across, level, strict=True)
    ]
    return level, np.mean(slope), across[0][0]


@pytest.mark.parametrize(("semi", "blur"), [((9, 9), 0.8), ((9, 9), 2.5), ((5, 5), 1.5), ((12, 6), 1.5), ((5, 4), 0.7)])
def test_disks_are_as_large_as_they_were_drawn(semi, blur):
    (longer, shorter), slope, depth = profile(semi, blur)
    one = np.ones(1)
    found = unblurred(longer * one, shorter * one, slope * one, 0 * one, one, one > 0)
    # In the image, sampling adds to the blur, which is not in this drawing.
    assert found.blur[0] == pytest.approx(np.sqrt(blur**2 - 1 / 6), rel=0.05)
    assert found.depth[0] == pytest.approx(depth, abs=0.03)
    # Near the tips no ellipse is the half-level.
    np.testing.assert_allclose(found.semi[:, 0], semi, rtol=0, atol=0.1 + 0.1 * (semi[0] - semi[1]) / semi[1])


@pytest.mark.parametrize("radius", [2.8, 3.5, 5.0])
def test_small_rings_are_told_from_disks_by_the_blur_of_the_others(radius):
    rng = np.random.default_rng(0)
    places = [(x, y) for y in range(30, 220, 40) for x in range(30, 300, 40)]
    dots = [(np.add(p, rng.uniform(-0.5, 0.5, 2)), (radius, 0.9 * radius), 20 * i, 0) for i, p in enumerate(places)]
    key = [0, 9, 20]
    dots = [
        (*dot[:3], 0.5 if i in key else 0) if i % 2 == 0 or i in key else (dot[0], (8, 7), 0, 0)
        for i, dot in enumerate(dots)
    ]
    blobs = find_blobs(scene(dots, blur=0.7))
    assert len(blobs) == len(dots)
    for i, (center, semi, _, hole) in enumerate(dots):
        found = int(np.linalg.norm(blobs.center - center, axis=-1).argmin())
        assert blobs.ring[found] == (i in key)
        assert abs(blobs.hole[found] - (hole > 0)) < 0.5
        np.testing.assert_allclose(blobs.semi[found], semi, rtol=0, atol=0.25)


def test_what_cannot_be_told_is_left_open():
    """Disks and rings of less than three blurs across look the same."""
    one = np.ones(1)
    found = unblurred(1.5 * one, 1.5 * one, 0.6 * one, 0 * one, one, one > 0)
    assert abs(found.hole[0] - 0.5) < 0.1
