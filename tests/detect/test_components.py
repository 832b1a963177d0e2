from collections import deque

import cv2
import numpy as np
import pytest
from dot_scenes import scene
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.detect import components, kernel
from markergen.detect.components import find_components, grey_noise


def nearest(found, center, semi):
    """Distance and relative error of the semi-axes, beyond what blur may add, of the component most like an ellipse.

    A threshold little below the mean of the surroundings lets dots grow by the width of their blurred edge, which is
    less than a pixel of the component's level.
    """
    outline = np.sqrt(np.linalg.eigvalsh(found.spread))[:, ::-1]
    beyond = np.maximum(np.abs(outline - semi) - 0.9 * 2.0 ** found.level[:, None], 0)
    distance, error = np.linalg.norm(found.center - center, axis=-1), (beyond / semi).max(axis=-1)
    best = (distance / np.mean(semi) + error).argmin()
    return distance[best], error[best]


def directly(image, step, least):
    """Components of dark pixels by their definition, pixel by pixel."""
    height, width = image.shape
    padded = np.pad(image.astype(int), 7, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (15, 15)).sum(axis=(2, 3))
    dark = np.rint(windows / 225) - image > step
    rows = []
    while dark.any():
        first = int(np.flatnonzero(dark)[0])
        queue, own = deque([divmod(first, width)]), []
        dark[queue[0]] = False
        while queue:
            y, x = queue.popleft()
            own.append((x, y))
            for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if 0 <= v < height and 0 <= u < width and dark[v, u]:
                    dark[v, u] = False
                    queue.append((v, u))
        if len(own) >= least:
            corner, opposite = np.min(own, axis=0), np.max(own, axis=0)
            x, y = (np.array(own) - corner).T
            sums = [x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum()]
            rows.append([len(own), *sums, *corner, *opposite, first])
    return np.array(rows, dtype=np.int64).reshape(-1, 11)


def of_library(image, step, least):
    found = kernel.dark_components(image, step, least)
    return found[np.argsort(found[:, 10])]


def of_twin(image, step, least):
    found = components._dark_components(image, step, least)
    return found[np.argsort(found[:, 10])]


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32), st.integers(1, 40), st.integers(1, 40), st.integers(0, 60), st.integers(1, 6),
    st.sampled_from([0.0, 0.6, 1.5]),
)  # fmt: skip
def test_both_ways_give_what_counting_pixel_by_pixel_gives(seed, height, width, step, least, blur):
    image = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.uint8)
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur).reshape(height, width)
    expected = directly(image, step, least)
    np.testing.assert_array_equal(of_twin(image, step, least), expected)
    if kernel.library() is not None:
        np.testing.assert_array_equal(of_library(image, step, least), expected)


def test_both_ways_agree_on_images_of_any_form(monkeypatch):
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    rng = np.random.default_rng(4)
    whole = cv2.resize(rng.integers(0, 256, (60, 80)).astype(np.uint8), None, fx=6, fy=6)
    images = [whole, whole[::2, ::3], whole[::-1], whole.T, whole[:, 5:6], whole[5:6], whole[:0], whole[:3, :3]]
    images += [whole[:, ::-1].astype(np.uint16) * 11, np.zeros((0, 0), np.uint8), np.full((50, 50), 255, np.uint8)]
    for image in images:
        compiled, noise = find_components(image), grey_noise(image)
        with monkeypatch.context() as without:
            without.setattr(kernel, "library", lambda: None)
            plain = find_components(image)
            assert grey_noise(image) == noise
        for name in ("center", "spread", "level"):
            np.testing.assert_array_equal(getattr(compiled, name), getattr(plain, name))
    assert len(find_components(whole)) > 100


@pytest.mark.parametrize("semi", [(2.5, 2.5), (4, 1.75), (3, 2), (6, 6), (12, 12), (24, 3), (60, 40), (100, 100)])
@pytest.mark.parametrize("hole", [0, 0.5])
@pytest.mark.usefixtures("path")
def test_disks_and_rings_of_any_size_are_found(semi, hole):
    center = (160.3, 119.8)
    if min(semi) * hole >= 2 or not hole:
        distance, error = nearest(find_components(scene([(center, semi, 30, hole)])), center, semi)
        assert distance < 0.1 + 0.01 * max(semi)
        assert error < 0.05


@pytest.mark.usefixtures("path")
def test_dots_of_three_and_a_half_pixels_are_found():
    centers = [(20.13 * i + 15, 20.29 * j + 15) for i in range(15) for j in range(10)]
    found = find_components(scene([(center, (1.75, 1.75), 0, 0) for center in centers]))
    away = [nearest(found, center, 1.75)[0] for center in centers]
    # The threshold decides for whole pixels.
    assert np.max(away) < 0.5


@pytest.mark.parametrize("semi", [(3, 3), (10, 7), (40, 30)])
def test_a_fifth_of_the_outline_may_be_hidden(semi):
    image = scene([((160, 120), semi, 0, 0)])
    # A light strip hides what is beyond cos 36 degrees of the semi-axis.
    image[:, 160 + round(0.81 * semi[0]) :] = 190
    distance, error = nearest(find_components(image), (160, 120), semi)
    assert distance < 0.6 + 0.2 * semi[0]
    assert error < 0.2


def test_dots_two_pixels_apart_and_dots_beside_dark_things_stay_apart():
    centers = [(60 + 18.2 * i, 60 + 18.2 * j) for i in range(6) for j in range(6)]
    image = scene([(center, (8, 8), 0, 0) for center in centers])
    image[:, 206:212] = 50
    image[30:45, 20:200] = 50
    found = find_components(image)
    for center in centers:
        distance, error = nearest(found, center, 8)
        assert distance < 0.3
        assert error == 0


def test_a_disk_in_the_hole_of_a_ring_is_found_with_the_ring():
    found = find_components(scene([((160, 120), (60, 50), 20, 0.7), ((160, 120), (12, 9), 0, 0)]))
    for semi in ((60, 50), (12, 9)):
        distance, error = nearest(found, (160, 120), semi)
        assert distance < 0.5
        assert error < 0.05


def test_lines_and_triangles_are_not_ellipses():
    image = np.full((240, 320), 190, np.uint8)
    cv2.fillPoly(image, [np.array([(60, 120), (100, 120), (60, 160)])], 40)
    cv2.polylines(image, [np.array([(150, 130), (200, 140), (190, 200), (240, 210)])], False, 40, 3)
    image[20:24, 50:300] = 40
    assert len(find_components(image)) == 0


@pytest.mark.usefixtures("path")
def test_of_16_bits_the_unit_is_told():
    image = scene([((160, 120), (12, 8), 20, 0)])
    found = find_components(image.astype(np.uint16) * np.uint16(200))
    assert nearest(found, (160, 120), (12, 8))[0] < 0.1
    low, high = (200 * np.percentile(image, share) for share in (0.1, 99.9))
    assert (found.low, found.unit) == pytest.approx((low, (high - low) / 255))
    assert find_components(image).unit == 1


def test_large_images_are_searched_at_less_resolution_and_say_so(monkeypatch):
    image = scene([((160, 120), (12, 8), 20, 0), ((60, 60), (3, 3), 0, 0)])
    assert find_components(image).coarsest == 1
    monkeypatch.setattr(components, "_MAX_PIXELS", image.size - 1)
    found = find_components(image)
    assert found.coarsest == 2
    assert found.level.min() == 1
    assert found.levels[0].shape == (120, 160)
    assert nearest(found, (160, 120), (12, 8))[0] < 0.3
