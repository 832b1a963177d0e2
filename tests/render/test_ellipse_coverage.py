import numpy as np
import pytest
from ellipse_coverage import disk_polygon_area, ellipse_coverage
from hypothesis import given, settings
from hypothesis import strategies as st

WIDTH, HEIGHT = 40, 30


def full_image(center, semi, angle, width=WIDTH, height=HEIGHT):
    tile, top, left = ellipse_coverage(np.array(center), np.array(semi), angle, width, height)
    image = np.zeros((height, width))
    image[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return image


def by_supersampling(center, semi, angle, factor):
    """Share of factor x factor points of each pixel that lie in the ellipse."""
    step = (np.arange(factor) + 0.5) / factor - 0.5
    x = (np.arange(WIDTH)[:, None] + step).ravel() - center[0]
    y = ((np.arange(HEIGHT)[:, None] + step).ravel() - center[1])[:, None]
    cosine, sine = np.cos(angle), np.sin(angle)
    inside = ((x * cosine + y * sine) / semi[0]) ** 2 + ((y * cosine - x * sine) / semi[1]) ** 2 < 1
    return inside.reshape(HEIGHT, factor, WIDTH, factor).mean(axis=(1, 3))


@pytest.mark.parametrize("factor", [100, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("center", "semi", "angle"),
    [
        ((19.3, 14.7), (9.6, 3.3), 0.4),  # a dot of the paper at 1.5 m and 70 deg
        ((20, 15), (10, 10), 0.0),  # touches the pixel grid
        ((12.2, 9.9), (0.3, 0.2), 1.0),  # smaller than a pixel
        ((12.5, 9.5), (6, 0.3), 0.7),  # thinner than a pixel
        ((1.2, 28.8), (7, 4), 2.0),  # cut off by a corner of the image
        ((-30, 14), (50, 40), 0.3),  # wider than the image
    ],
)
def test_agrees_with_brute_force(center, semi, angle, factor):
    # A straight edge through 200 x 200 points is counted to half a row, 1/400, at worst; through 100 x 100 to 1/200.
    np.testing.assert_allclose(
        full_image(center, semi, angle), by_supersampling(center, semi, angle, factor), rtol=0, atol=0.5 / factor
    )


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(15, 24),
    y=st.floats(14, 15),
    semi=st.tuples(st.floats(0.05, 13), st.floats(0.05, 13)),
    angle=st.floats(-4, 4),
)
def test_total_is_the_ellipse_area(x, y, semi, angle):
    # Rounding of some hundred areas below 1.
    assert full_image((x, y), semi, angle).sum() == pytest.approx(np.pi * semi[0] * semi[1], rel=1e-10, abs=1e-12)


def test_edge_of_the_image_cuts_without_changing_what_is_left():
    whole = full_image((25.3, 18.2), (14, 5), 0.6, width=60, height=60)
    np.testing.assert_allclose(full_image((25.3, 18.2), (14, 5), 0.6), whole[:HEIGHT, :WIDTH], rtol=0, atol=1e-12)


@pytest.mark.parametrize("center", [(-20, 10), (70, 10), (20, -12), (20, 55)])
def test_outside_the_image_nothing_is_covered(center):
    assert ellipse_coverage(np.array(center), np.array([9.0, 5.0]), 0.3, WIDTH, HEIGHT)[0].size == 0


@pytest.mark.parametrize(
    ("polygon", "area"),
    [
        ([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)], 1.0),  # wholly inside
        ([(-3, -3), (3, -3), (3, 3), (-3, 3)], np.pi),  # wholly around
        ([(0, 0), (3, 0), (3, 3), (0, 3)], np.pi / 4),  # a corner at the center
        ([(0.5, -3), (3, -3), (3, 3), (0.5, 3)], np.pi / 3 - np.sqrt(3) / 4),  # a circular segment
        ([(2, 2), (3, 2), (3, 3), (2, 3)], 0.0),  # apart
        ([(1, -1), (2, -1), (2, 1), (1, 1)], 0.0),  # touching
    ],
)
def test_disk_and_polygon(polygon, area):
    assert disk_polygon_area(np.array(polygon, dtype=float)) == pytest.approx(area, abs=1e-14)
    assert disk_polygon_area(np.array(polygon[::-1], dtype=float)) == pytest.approx(-area, abs=1e-14)
