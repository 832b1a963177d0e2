"""Rounded corners: smooth everywhere, of the radius asked for, and of the area that is left in closed form."""

from math import acos, atan2, pi, sqrt, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.geometry.contour import (
    Contour,
    area,
    center_of,
    filleted,
    largest_fillet,
    radius_of,
    reversed_contour,
    turns_of,
)

SHARP = 0.35
SQUARE = Contour(((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)))
NOTCHED = Contour(((0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (20.0, 20.0), (20.0, 60.0), (0.0, 60.0)))
"""An L, with one corner that points inward."""


def d_shape(radius, flat):
    """Circle of a radius cut off at x = flat."""
    half = sqrt(radius**2 - flat**2)
    rotation = 2 * pi - 2 * acos(flat / radius)
    return Contour(((flat, half), (-radius, 0.0), (flat, -half)), (tan(rotation / 8), tan(rotation / 8), 0.0))


BITE = Contour(((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (30.0, 30.0), (10.0, 30.0), (0.0, 30.0)), (0, 0, 0, -1.0, 0, 0))
"""A half circle taken from the upper side: an arc to the right between two corners that point outward."""

LENS = Contour(((-10.0, 0.0), (10.0, 0.0)), (0.5, 0.5))


@pytest.mark.parametrize(
    "contour", [SQUARE, NOTCHED, d_shape(10.0, 6.0), BITE, LENS, reversed_contour(d_shape(10.0, -4.0))]
)
@pytest.mark.parametrize("radius", [0.1, 1.0, 2.0])
def test_all_corners_are_smooth_and_of_the_radius(contour, radius):
    sharp = sum(abs(rotation) > SHARP for rotation in turns_of(contour))
    result = filleted(contour, radius, SHARP)
    assert max(map(abs, turns_of(result))) < 1e-7
    assert sum(abs(radius_of(side) - radius) < 1e-9 for side in result.sides) == sharp
    # Arcs that were there keep their centers and radii.
    kept = [(*center_of(side), radius_of(side)) for side in result.sides if side[2]]
    for side in contour.sides:
        if side[2]:
            assert any(item == pytest.approx((*center_of(side), radius_of(side)), abs=1e-9) for item in kept)


def test_corners_between_lines_lose_or_gain_what_they_should():
    assert area(filleted(SQUARE, 3.0, SHARP)) == pytest.approx(400 - (4 - pi) * 9)
    assert area(filleted(NOTCHED, 3.0, SHARP)) == pytest.approx(area(NOTCHED) - 4 * (4 - pi) / 4 * 9)


@given(st.floats(0.05, 1.5))
def test_a_d_s_corners_lose_what_they_should(radius):
    big, flat = 10.0, 6.0
    # The small circle's center is at flat - radius, and big - radius from the large one's.
    height = sqrt((big - radius) ** 2 - (flat - radius) ** 2)
    angle = atan2(height, flat - radius)
    # Of the upper half: from the left the large sector up to the fillet, then a triangle, the fillet's sector, and
    # what is between its center and the flat.
    upper = big**2 * (pi - angle) / 2 + (flat - radius) * height / 2 + radius**2 * angle / 2 + radius * height
    assert area(reversed_contour(filleted(d_shape(big, flat), radius, SHARP))) == pytest.approx(-2 * upper, rel=1e-9)


def test_what_has_no_room_is_told_and_the_largest_that_has():
    assert filleted(SQUARE, 10.5, SHARP) is None
    assert largest_fillet(SQUARE, SHARP, 10.5) == pytest.approx(10)
    assert filleted(SQUARE, 10.0, SHARP).is_circle is False
    d = d_shape(10.0, 6.0)
    room = largest_fillet(d, SHARP, 100.0)
    assert filleted(d, 0.999 * room, SHARP) is not None
    assert filleted(d, 1.001 * room, SHARP) is None


def test_corners_that_stand_for_a_curve_stay():
    slot = Contour(((0.0, 0.0), (40.0, 0.0), (40.0, 10.0), (0.0, 10.0)), (0.0, 1.0, 0.0, 1.0))
    assert filleted(slot, 3.0, SHARP) == slot
