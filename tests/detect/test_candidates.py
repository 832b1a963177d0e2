import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from dot_scenes import scene

from markergen.detect import candidates, kernel
from markergen.detect.candidates import find_blobs
from markergen.detect.components import find_components

PHOTOS = Path(__file__).parents[3] / "shared" / "photos"
BLUR = 0.7
EDGE = np.sqrt(BLUR**2 + 1 / 12)


def nearest(blobs, centers):
    """Offsets (n, 2) of the blobs that are nearest to centers, and their indices."""
    apart = blobs.center[None] - np.reshape(centers, (-1, 1, 2))
    index = np.linalg.norm(apart, axis=-1).argmin(axis=1)
    return apart[np.arange(len(apart)), index], index


def grid(step, shape=(480, 640), seed=0):
    """Centers in rows and columns, each a part of a pixel off."""
    x, y = (np.arange(step, side - step, step) for side in shape[::-1])
    centers = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return centers + np.random.default_rng(seed).uniform(-0.5, 0.5, centers.shape)


@pytest.mark.parametrize("semi", [(3, 3), (4, 3), (7, 3.5), (12, 12), (60, 20), (90, 90)])
@pytest.mark.parametrize("hole", [0, 0.5])
def test_ellipses_are_good_to_a_tenth_of_a_pixel(semi, hole):
    center = (160.3, 119.8)
    blobs = find_blobs(scene([(center, semi, 30, hole)], blur=BLUR))
    offset, (i,) = nearest(blobs, center)
    # In a ring of less than 12 times the blur, the ink is not fully dark.
    narrow = hole and semi[1] < 12 * EDGE
    assert np.abs(offset).max() < 0.1
    np.testing.assert_allclose(blobs.semi[i], semi, rtol=0, atol=0.3 if narrow else 0.12)
    if semi[0] > semi[1]:
        assert abs(np.rad2deg(blobs.angle[i]) - 30) < 2
    assert blobs.ring[i] == bool(hole)
    assert abs(blobs.middle[i] - bool(hole)) < (0.4 if narrow else 0.1)
    # The lightest of four pixels with a noise of 2, and nearly the darkest.
    assert abs(blobs.light[i] - 190) < 4
    assert abs(blobs.dark[i] - 50) < (30 if narrow else 6)
    assert abs(blobs.blur[i] - EDGE) < (0.25 if narrow else 0.15)
    assert not blobs.fitted.any()


@pytest.mark.parametrize("blur", [0.4, 1.5, 3.0])
def test_sizes_do_not_depend_on_the_blur(blur):
    centers = grid(50)
    blobs = find_blobs(scene([(center, (14, 10), 20, 0) for center in centers], (480, 640), blur=blur))
    offset, index = nearest(blobs, centers)
    assert np.linalg.norm(offset, axis=-1).max() < 0.1 + 0.05 * blur
    assert np.abs(blobs.semi[index] - (14, 10)).max() < 0.1 + 0.05 * blur
    assert np.abs(blobs.blur[index] - np.hypot(blur, EDGE - BLUR)).max() < 0.1 + 0.1 * blur


@pytest.mark.parametrize(("radius", "least"), [(1.75, 0.5), (2.25, 0.9), (3.0, 1.0)])
def test_small_dots_are_found(radius, least):
    centers = grid(24)
    blobs = find_blobs(scene([(center, (radius, radius), 0, 0) for center in centers], (480, 640), blur=BLUR))
    offset, index = nearest(blobs, centers)
    found = np.linalg.norm(offset, axis=-1) < 0.3
    assert np.mean(found) >= least
    assert np.abs(blobs.semi[index[found]] - radius).max() < 0.6


def test_the_covariance_is_that_of_the_centers():
    """It is meant for what is not noise, too, so it is generous where there is little."""
    centers = grid(32)
    for noise in (2, 12):
        blobs = find_blobs(scene([(center, (8, 6), 30, 0) for center in centers], (480, 640), noise=noise))
        offset, index = nearest(blobs, centers)
        relative = np.einsum("bi,bi->b", offset, np.linalg.solve(blobs.covariance[index], offset[..., None])[..., 0])
        # Of 2 degrees of freedom; the mean of 266 scatters by 0.12.
        assert (0.2 if noise == 2 else 1) < np.mean(relative) < 3


def test_each_dot_once_and_no_limit_to_their_number():
    centers = grid(14, (700, 900))
    blobs = find_blobs(scene([(center, (5, 4), 40, 0) for center in centers], (700, 900)))
    # Four dots and the paper between them may make another at half the resolution.
    assert len(centers) <= len(blobs) <= 1.002 * len(centers)
    assert len(centers) > 2500
    assert np.linalg.norm(nearest(blobs, centers)[0], axis=-1).max() < 0.3


def test_a_plate_in_the_dark_and_dots_beside_dark_things():
    # A light plate on black, with a dot 3 px from its edge, and one 3 px from a line.
    image = np.full((300, 400), 20, np.uint8)
    image[60:240, 80:320] = 210
    image[60:240, 196:204] = 30
    for center in ((100, 150), (220, 150)):
        cv2.circle(image, center, 16 if center[0] == 100 else 12, 30, -1, cv2.LINE_AA)
    blobs = find_blobs(cv2.GaussianBlur(image, (0, 0), 0.7))
    assert np.linalg.norm(nearest(blobs, [(100, 150), (220, 150)])[0], axis=-1).max() < 0.2


def test_uneven_light_and_low_contrast():
    centers = [(50, 120), (110, 120), (190, 120), (270, 120)]
    dots = [(center, (12, 8), 20, 0) for center in centers]
    shaded = np.clip(np.rint(scene(dots, noise=0) * np.linspace(0.25, 1.2, 320)), 0, 255).astype(np.uint8)
    faint = scene(dots, dark=140, noise=6)
    for image, limit in ((shaded, 0.1), (faint, 0.5)):
        assert np.linalg.norm(nearest(find_blobs(image), centers)[0], axis=-1).max() < limit


def test_a_part_of_the_outline_may_be_hidden_washed_out_or_cut_off():
    center, semi = np.array([160.2, 119.7]), (14, 11)
    image = scene([(center, semi, 0, 0)])
    hidden, washed, cut = image.copy(), image.copy(), image[:, 149:]
    hidden[:111, :] = 90
    cv2.circle(washed, (172, 125), 3, 190, -1)
    hidden, washed, cut = map(find_blobs, (hidden, washed, cut))
    # A fifth of the outline is missing; what is left of the edge beside it is not quite where it was.
    for blobs, place in ((hidden, center), (washed, center), (cut, center - (149, 0))):
        offset, (i,) = nearest(blobs, place)
        assert np.linalg.norm(offset) < 0.5
        assert np.abs(blobs.semi[i] - semi).max() < 0.5
    assert len(find_blobs(image[:, 158:])) == 0


def test_squares_lines_and_letters_are_not_dots_and_what_is_odd_comes_last():
    image = scene([((60, 60), (9, 7), 10, 0), ((250, 180), (4, 3), 0, 0)])
    cv2.rectangle(image, (100, 100), (140, 140), 50, -1)
    cv2.line(image, (20, 200), (220, 204), 50, 4)
    assert len(find_blobs(image)) == 2
    cv2.putText(image, "B8&ag%", (120, 60), cv2.FONT_HERSHEY_SIMPLEX, 1.2, 50, 3, cv2.LINE_AA)
    blobs = find_blobs(image)
    assert sorted(nearest(blobs, [(60, 60), (250, 180)])[1]) == [0, 1]


@pytest.mark.parametrize("side", [14, 20, 26])
def test_squares_of_a_checkerboard_are_not_dots(side):
    board = (40 + 180 * ((np.indices((480, 640)) // side).sum(axis=0) % 2)).astype(np.uint8)
    turn = cv2.getRotationMatrix2D((320, 240), 20, 1)
    turned = cv2.warpAffine(board, turn, (640, 480), borderValue=220)
    # Of hundreds of squares, a few at the edge of the image or the board are cut to something round.
    assert len(find_blobs(cv2.GaussianBlur(turned, (0, 0), 0.8))) <= 8


def test_of_16_bits_levels_are_in_the_image_s_own():
    image = scene([((160, 120), (12, 8), 20, 0)]).astype(np.uint16)
    for factor in (16, 257):
        blobs = find_blobs(image * np.uint16(factor))
        _, (i,) = nearest(blobs, (160, 120))
        assert abs(blobs.light[i] / factor - 190) < 5
        assert abs(blobs.dark[i] / factor - 50) < 5


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (2, 3), (5, 20), (300, 400)])
def test_nothing_in_nothing(shape):
    assert len(find_blobs(np.full(shape, 200, np.uint8))) == 0


def test_a_large_image_is_searched_at_less_resolution():
    image = np.full((7000, 7000), 200, np.uint8)
    cv2.ellipse(image, (3000, 4000), (60, 40), 0, 0, 360, 40, -1, cv2.LINE_AA)
    blobs = find_blobs(image)
    assert len(blobs) == 1
    np.testing.assert_allclose(blobs.center[0], (3000, 4000), rtol=0, atol=0.3)


def test_the_compiled_part_gives_the_same_numbers():
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    rng = np.random.default_rng(0)
    dots = [
        (center, np.exp(rng.uniform(0.5, 2.3, 2)), rng.uniform(0, 180), rng.choice([0, 0.5])) for center in grid(32)
    ]
    image = scene(dots, (480, 640), noise=8)
    image[:, ::70] = 20
    components = find_components(image)
    for level, grey in enumerate(components.levels):
        of_level = components.level == level
        rough = candidates._outlines(components, np.ldexp(1.0, components.level))[of_level]
        ours, compiled = candidates._even_edges(grey, rough), candidates.even_edges(grey, rough)
        # Sums in another order: the rounding of numbers up to 640, times the condition of small systems.
        np.testing.assert_allclose(compiled, ours, rtol=1e-9, atol=1e-9)
    assert len(candidates.even_edges(components.levels[0], rough)) <= len(rough)


@pytest.mark.parametrize(
    ("folder", "share", "median"), [("robot_grid", 0.99, 0.1), ("circle_grid", 1, 0.1), ("hex_grid", 1, 0.1)]
)
def test_dots_of_photographs(folder, share, median):
    if not PHOTOS.is_dir():
        pytest.skip("the folder of photographs is not there")
    errors = []
    for labels in json.loads((PHOTOS / folder / "labels.json").read_text()):
        image = cv2.imread(str(PHOTOS / folder / labels["image"]), cv2.IMREAD_GRAYSCALE)
        centers = labels.get("centres_px_row_major") or labels["centres_px"]
        errors.append(np.linalg.norm(nearest(find_blobs(image), centers)[0], axis=-1))
    errors = np.concatenate(errors)
    # Labels are good to 0.1 to 0.3 px.
    assert np.mean(errors < 0.5) >= share
    assert np.median(errors) < median
