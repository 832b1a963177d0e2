import numpy as np
import pytest
from ellipse_coverage import ellipse_coverage
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.geometry.coverage import paint, polygon_coverage

WIDTH, HEIGHT = 12, 9
EXACT = 1e-12  # rounding of some dozen products of numbers around 10


def full_image(outlines, width=WIDTH, height=HEIGHT):
    tile, top, left = polygon_coverage([np.array(outline, dtype=float) for outline in outlines], width, height)
    image = np.zeros((height, width))
    image[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return image


def area(outline):
    x, y = np.array(outline, dtype=float).T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def clipped(outline, axis, border, sign):
    """Part of a polygon on one side of a line along an axis."""
    result = []
    for p, q in zip(outline, [*outline[1:], outline[0]], strict=True):
        a, b = sign * (p[axis] - border), sign * (q[axis] - border)
        if a <= 0:
            result.append(p)
        if (a <= 0) != (b <= 0):
            result.append(p + a / (a - b) * (q - p))
    return result


def pixel_by_pixel(outline):
    """Signed area of what is left of the polygon when it is cut down to each pixel in turn."""
    image = np.zeros((HEIGHT, WIDTH))
    for row, column in np.ndindex(image.shape):
        part = list(np.array(outline, dtype=float))
        for axis, middle in ((0, column), (1, row)):
            for sign in (-1, 1):
                part = clipped(part, axis, middle + sign * 0.5, sign) if part else part
        image[row, column] = area(part) if part else 0
    return image


places = st.tuples(st.floats(-4, 16), st.floats(-4, 13))


@settings(max_examples=40)
@given(outline=st.lists(places, min_size=3, max_size=7))
def test_every_pixel_has_the_area_that_cutting_leaves(outline):
    # Any polygon, one that crosses itself too: both sides count how often it winds around.
    np.testing.assert_allclose(full_image([outline]), pixel_by_pixel(outline), rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    "outline",
    [
        [(2, 2), (6, 2), (6, 5), (2, 5)],  # corners at the middle of pixels
        [(1.5, 1.5), (6.5, 1.5), (6.5, 4.5), (1.5, 4.5)],  # along the lines between pixels
        [(3.2, 2.1), (3.3, 2.1), (3.3, 2.4)],  # within one pixel
        [(-100, -80), (300, -70), (250, 400), (-90, 300)],  # all of the image
        [(2, 2), (6, 5)],  # no area
        [(-5, 1), (-2, 1), (-3, 6)],  # left of it
        [(14, 1), (18, 1), (15, 6)],  # right of it
        [(4, 3.5), (9.5, -0.5), (9.5, 8.5)],  # through corners of pixels
    ],
)
def test_special_places(outline):
    np.testing.assert_allclose(full_image([outline]), pixel_by_pixel(outline), rtol=0, atol=EXACT)


def test_agrees_with_the_ellipse_in_closed_form():
    center, semi, angle = np.array([19.3, 14.7]), np.array([9.6, 3.3]), 0.4
    rotation = 2 * np.pi * np.arange(4096) / 4096
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    outline = center + (semi * np.stack([np.cos(rotation), np.sin(rotation)], axis=-1)) @ axes
    tile, top, left = ellipse_coverage(center, semi, angle, 40, 30)
    expected = np.zeros((30, 40))
    expected[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    # The polygon lies within 9.6 pi^2/(2 4096^2) = 3e-6 px of the ellipse, and 1.4 px of it within a pixel.
    np.testing.assert_allclose(full_image([outline], 40, 30), expected, rtol=0, atol=5e-6)


def test_holes_are_taken_off_wherever_they_are():
    outer, hole = [(1, 1), (9, 2), (8, 7), (2, 6)], [(3, 3), (3, 5), (6, 5), (6, 3)]
    np.testing.assert_allclose(
        full_image([outer, hole]), full_image([outer]) - full_image([hole[::-1]]), rtol=0, atol=EXACT
    )
    assert full_image([outer, hole]).sum() == pytest.approx(area(outer) - 6, abs=EXACT)


def test_nothing_is_drawn_of_nothing():
    assert full_image([]).sum() == 0
    assert full_image([[(1, 1), (2, 2)]]).sum() == 0


@pytest.mark.parametrize("rotated", [False, True])
def test_painting_mixes_by_covered_share(rotated):
    outline = np.array([(0.0, -0.5), (2.5, -0.5), (2.5, 1.0), (0.0, 1.0)])
    texture = np.arange(12, dtype=np.float32).reshape(3, 4)
    for value in (5.0, texture):
        image = np.full((3, 4), 1.0, dtype=np.float32)
        paint(image, [outline[::-1] if rotated else outline], value, 1)
        share = np.outer([1, 0.5, 0], [0.5, 1, 1, 0])
        np.testing.assert_allclose(image, 1 + share * (value - np.ones((3, 4))), rtol=0, atol=1e-6)


def test_subpixels_of_a_pixel_add_up_to_it():
    outline = np.array([(1.3, 0.7), (9.1, 2.2), (4.0, 7.9)])
    fine, coarse = np.zeros((27, 36), dtype=np.float32), np.zeros((9, 12), dtype=np.float32)
    paint(fine, [outline], 1, 3)
    paint(coarse, [outline], 1, 1)
    # Single precision.
    np.testing.assert_allclose(fine.reshape(9, 3, 12, 3).mean(axis=(1, 3)), coarse, rtol=0, atol=1e-6)


def test_tall_images_are_painted_to_the_last_row():
    image = np.zeros((200, 5), dtype=np.float32)
    paint(image, [np.array([(0.5, -9), (3.5, -9), (3.5, 300), (0.5, 300)])], 1, 1)
    np.testing.assert_allclose(image, np.broadcast_to([0, 1, 1, 1, 0], image.shape), rtol=0, atol=1e-6)
