from math import asin, cos, isclose, pi, sin, sqrt, tan

import numpy as np
import pytest
import shapely

from markergen.geometry.contour import Contour, area, center_of, circle, flattened, offset
from markergen.solid.primitives import Part, Prism, Revolved, cylinder

QUARTER = tan(pi / 8)
ROUNDED = Contour(
    ((-8, -5), (8, -5), (10, -3), (10, 3), (8, 5), (-8, 5), (-10, 3), (-10, -3)),
    (0, QUARTER, 0, QUARTER, 0, QUARTER, 0, QUARTER),
)
"""A rectangle of 20 x 10 with corners of radius 2."""

EXACT = 1e-12
"""Closed forms against closed forms: rounding of some tens of operations."""


def test_areas():
    assert area(circle(3, 1, 2)) == pytest.approx(9 * pi, rel=EXACT)
    assert area(circle(3, 1, 2, hole=True)) == pytest.approx(-9 * pi, rel=EXACT)
    assert area(ROUNDED) == pytest.approx(200 - (4 - pi) * 4, rel=EXACT)
    # A square with a bite of a quarter circle.
    assert area(Contour(((0, 0), (1, 0), (0, 1)), (0, -QUARTER, 0))) == pytest.approx(1 - pi / 4, rel=EXACT)


def test_volumes_of_prisms():
    assert Prism(ROUNDED, (circle(1, hole=True),), -3, 0).volume == pytest.approx(3 * (200 - 4 * (4 - pi) - pi))
    cone = pi / 3 * (50**2 + 50 * 49 + 49**2)
    assert Prism(circle(50), (), -3, 0, 1).volume == pytest.approx(pi * 50**2 * 2 + cone, rel=EXACT)
    square = Contour(((0, 0), (10, 0), (10, 10), (0, 10)))
    assert Prism(square, (), 0, 4, 4).volume == pytest.approx(4 / 3 * (100 + 4 + 20), rel=EXACT)


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        (Contour(((0, 0), (3, 0), (3, 2), (0, 2))), 18 * pi),
        (Contour(((0, 0), (3, 0), (0, 4))), 12 * pi),
        # A ball, as one arc from pole to pole, and a half one on a plug.
        (Contour(((0, -3), (0, 3)), (1, 0)), 36 * pi),
        (Contour(((0, -1), (3, -1), (3, 0), (0, 3)), (0, 0, QUARTER, 0)), 9 * pi + 18 * pi),
        # A torus, and what a fillet of radius 1 adds around a pillar of radius 2.
        (Contour(((7, 0), (3, 0)), (1, 1)), 2 * pi**2 * 5 * 4),
        (Contour(((2, 0), (3, 0), (2, 1)), (0, -QUARTER, 0)), 2 * pi * (3 * (1 - pi / 4) - 1 / 6)),
    ],
)
def test_volumes_of_revolution(profile, expected):
    assert Revolved(1, 2, profile).volume == pytest.approx(expected, rel=1e-11)


def test_inset_keeps_the_distance():
    inner = offset(ROUNDED, 0.5)
    assert area(inner) == pytest.approx(19 * 9 - (4 - pi) * 1.5**2, rel=EXACT)
    assert offset(circle(50, 3, 4), 2) == circle(48, 3, 4)
    star = [(cos(k * pi / 5) * (3 if k % 2 else 7), sin(k * pi / 5) * (3 if k % 2 else 7)) for k in range(10)]
    inner = offset(Contour(tuple(star)), 0.3)
    for k in range(10):
        side = np.subtract(star[(k + 1) % 10], star[k])
        for point in (inner.points[k], inner.points[(k + 1) % 10]):
            x, y = np.subtract(point, star[k])
            assert (side[0] * y - side[1] * x) / np.hypot(*side) == pytest.approx(0.3, rel=1e-9)


@pytest.mark.parametrize("off", [0.1, 1e-3])
def test_flattened_paths_stay_close_and_on_the_arcs(off):
    for path, x, y, radius in ((circle(5, 3, 4), 3, 4, 5), (circle(5, 3, 4, hole=True), 3, 4, 5)):
        corners = np.array(flattened(path, off)) - [x, y]
        assert np.hypot(*corners.T) == pytest.approx(radius, rel=EXACT)
        middles = (corners + np.roll(corners, -1, axis=0)) / 2
        assert np.hypot(*middles.T).min() >= radius - off
        assert (shapely.LinearRing(corners).is_ccw) == (area(path) > 0)
    assert shapely.Polygon(flattened(ROUNDED, off)).area == pytest.approx(area(ROUNDED), abs=4 * pi * off)
    assert flattened(Contour(((0, 0), (1, 0), (0, 1))), off) == [(0, 0), (1, 0), (0, 1)]


def test_centers_of_arcs():
    assert center_of(((1, 0), (0, 1), QUARTER)) == pytest.approx((0, 0), abs=1e-15)
    assert center_of(((1, 0), (0, 1), -QUARTER)) == pytest.approx((1, 1))
    assert center_of(((1, 0), (0, -1), tan(3 * pi / 8))) == pytest.approx((0, 0), abs=1e-15)


def test_spans():
    assert Prism(ROUNDED, (), -3, 0).span == (-3, 0)
    assert cylinder(1, 2, 3, -2, 5).span == (-2, 5)
    # A cap whose arc goes on below its ends.
    low = -(1 - cos(asin(1 / sqrt(2)))) * sqrt(2)
    cap = Revolved(0, 0, Contour(((-1e-9, low), (1, 0), (0, 0)), (tan(pi / 16), 0, 0)))
    assert isclose(cap.span[0], low, abs_tol=1e-4)


def test_volume_of_a_part():
    part = Part(
        "plate", "light", (Prism(ROUNDED, (), -3, 0),), (cylinder(0, 0, 2, -1, 0),), (cylinder(5, 0, 1, -0.5, 0),)
    )
    assert part.volume == pytest.approx(3 * area(ROUNDED) - 4 * pi - pi / 2, rel=EXACT)
