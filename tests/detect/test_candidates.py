import cv2
import numpy as np
import pytest

from markergen.detect.candidates import MAX_REGIONS, find_blobs, grey_noise


def scene(ellipses, shape=(300, 400), light=200, noise=2.0, blur=0.7, seed=0):
    """Image with ellipses (center, semi, angle in degrees, grey), drawn to 1/16 px."""
    image = np.full(shape, light, np.uint8)
    for center, semi, angle, grey in ellipses:
        place = np.rint(np.multiply(center, 16)).astype(int).tolist()
        axes = np.rint(np.multiply(semi, 16)).astype(int).tolist()
        cv2.ellipse(image, place, axes, angle, 0, 360, grey, -1, cv2.LINE_AA, 4)
    blurred = cv2.GaussianBlur(image.astype(float), (0, 0), blur)
    noisy = blurred + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def nearest(regions, center):
    return int(np.linalg.norm(regions.center - center, axis=-1).argmin())


@pytest.mark.parametrize("semi", [(3, 2), (4, 1.5), (12, 12), (24, 3), (60, 20), (120, 120)])
@pytest.mark.parametrize("blur", [0.5, 2.0])
def test_a_dot_of_any_size_is_found(semi, blur):
    center = (203.3, 151.8)
    regions = find_blobs(scene([(center, semi, 30, 40)], blur=blur))
    i = nearest(regions, center)
    np.testing.assert_allclose(regions.center[i], center, rtol=0, atol=0.6)
    # From contours, and the middle of the profile across them; a blur as wide as the dot makes it larger.
    found = regions.semi[i]
    np.testing.assert_allclose(found, semi, rtol=0.15, atol=0.5 + 0.6 * blur)
    assert abs(regions.light[i] - 200) < 15
    assert regions.middle[i] < 0.3


def test_rings_are_light_in_the_middle():
    regions = find_blobs(
        scene([((100, 100), (20, 14), 0, 40), ((100, 100), (10, 7), 0, 200), ((300, 200), (20, 14), 0, 40)])
    )
    ring, disk = nearest(regions, (100, 100)), nearest(regions, (300, 200))
    assert regions.middle[ring] > 0.8
    assert regions.middle[disk] < 0.1


def test_a_plate_in_the_dark_and_dots_next_to_dark_things():
    # A light plate on black, with a dot 3 px from its edge, and one 2 px from a line.
    image = np.full((300, 400), 20, np.uint8)
    image[60:240, 80:320] = 210
    image[60:240, 196:204] = 30
    for center in ((100, 150), (219, 150)):
        cv2.circle(image, center, 16 if center[0] == 100 else 12, 30, -1, cv2.LINE_AA)
    regions = find_blobs(cv2.GaussianBlur(image, (0, 0), 0.7))
    for center in ((100, 150), (219, 150)):
        assert np.linalg.norm(regions.center - center, axis=-1).min() < 0.7


def test_uneven_light_and_low_contrast():
    image = scene([((x, 150), (12, 8), 20, 40) for x in (50, 150, 250, 350)], noise=0).astype(float)
    shaded = np.clip(np.rint(image * np.linspace(0.25, 1.2, 400)), 0, 255).astype(np.uint8)
    regions = find_blobs(shaded)
    for x in (50, 150, 250, 350):
        assert np.linalg.norm(regions.center - (x, 150), axis=-1).min() < 0.6
    faint = scene([((x, 150), (12, 8), 20, 140) for x in (50, 150, 250, 350)], light=200, noise=8)
    regions = find_blobs(faint)
    for x in (50, 150, 250, 350):
        assert np.linalg.norm(regions.center - (x, 150), axis=-1).min() < 1


def test_of_16_bits_levels_are_in_the_image_s_own():
    image = scene([((200, 150), (12, 8), 20, 40)]).astype(np.uint16)
    for factor in (16, 257):
        regions = find_blobs(image * np.uint16(factor))
        i = nearest(regions, (200, 150))
        assert abs(regions.light[i] / factor - 200) < 10
        assert abs(regions.dark[i] / factor - 40) < 20


def test_each_once():
    dots = [((60 + 70 * i, 60 + 60 * j), (14, 9), 40, 40) for i in range(5) for j in range(4)]
    regions = find_blobs(scene(dots))
    assert len(regions) == 20


def test_squares_and_lines_are_no_regions():
    image = np.full((300, 400), 200, np.uint8)
    image[100:140, 100:140] = 40
    image[200:204, 50:350] = 40
    image[20:90, 200:230] = 40
    assert len(find_blobs(image)) == 0


def test_dots_cut_off_by_the_edge_are_left_out():
    assert len(find_blobs(scene([((5, 150), (12, 8), 20, 40)]))) == 0


def test_clutter_is_kept_within_bounds():
    rng = np.random.default_rng(0)
    dots = [(rng.uniform(5, 995, 2), rng.uniform(3, 6, 2), 0, 40) for _ in range(1000)]
    assert len(find_blobs(scene(dots, (1000, 1000)))) == MAX_REGIONS


def test_a_large_image_is_searched_at_less_resolution():
    image = np.full((7000, 7000), 200, np.uint8)
    cv2.ellipse(image, (3000, 4000), (60, 40), 0, 0, 360, 40, -1, cv2.LINE_AA)
    regions = find_blobs(image)
    assert len(regions) == 1
    np.testing.assert_allclose(regions.center[0], (3000, 4000), rtol=0, atol=1)


@pytest.mark.parametrize("sigma", [1, 4, 20])
def test_is_that_of_the_plain_part(sigma):
    rng = np.random.default_rng(0)
    image = 128 + sigma * rng.standard_normal((480, 640))
    image[:, :320] = rng.integers(0, 256, (480, 320))
    noise = grey_noise(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    # The quietest fifth of all pieces, two fifths of the plain ones, is below the mean by about a standard deviation
    # of pieces of 31 differences, 11 %.
    assert 0.8 * sigma < noise < 1.05 * sigma


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (5, 20), (480, 640)])
def test_none_where_nothing_changes(shape):
    assert grey_noise(np.full(shape, 255, np.uint8)) == 0.0


def test_saturated_parts_do_not_count():
    image = 100 + 3 * np.random.default_rng(0).standard_normal((480, 640))
    image[:, 64:] = 255
    assert grey_noise(np.rint(image).astype(np.uint8)) > 2
