"""Contours of lines and arcs, against polygons that are fine enough, and against what is known in closed form."""

from math import atan, atan2, cos, hypot, pi, sin, tan

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.geometry.contour import (
    Contour,
    area,
    backward,
    box,
    center_of,
    circle,
    fitted_sphere,
    flattened,
    inner_polygon,
    merged,
    mirrored,
    offset,
    placed,
    radius_of,
    reversed_contour,
    rings_and_circles,
    tangent,
    turns_of,
)

SLOT = Contour(((0.0, 0.0), (40.0, 0.0), (40.0, 10.0), (0.0, 10.0)), (0.0, 1.0, 0.0, 1.0))


FINE = 1e-4
"""How far the polygon that stands for a contour is off its arcs."""


def polygon(contour):
    return shapely.Polygon(flattened(contour, FINE))


@st.composite
def contours(draw):
    """Star-shaped corners, and arcs that leave the contour free of crossings more often than not."""
    count = draw(st.integers(2, 9))
    rotation = draw(st.floats(0, 2 * pi))
    radii = draw(st.lists(st.floats(0.5, 2.0), min_size=count, max_size=count))
    angles = rotation + 2 * pi * np.arange(count) / count
    bulges = draw(st.lists(st.sampled_from([0.0, 0.1, -0.1, 0.3, -0.3, 0.75, 1.0]), min_size=count, max_size=count))
    x, y = draw(st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
    points = [(float(x + r * cos(a)), float(y + r * sin(a))) for r, a in zip(radii, angles, strict=True)]
    contour = Contour(tuple(points), tuple(bulges))
    assume(count > 2 or any(bulges))
    fine = polygon(contour)
    assume(fine.is_valid and area(contour) > 0.1)
    return contour


@settings(max_examples=50)
@given(contours())
def test_area_and_box_are_those_of_a_polygon_that_is_fine_enough(contour):
    fine = polygon(contour)
    # Chords leave less than their distance from the arc off along all of it.
    assert area(contour) == pytest.approx(fine.area, abs=FINE * fine.length)
    assert box(contour) == pytest.approx(fine.bounds, abs=2 * FINE)


@settings(max_examples=50)
@given(contours(), st.sampled_from([1e-2, 1e-3]))
def test_the_inner_polygon_is_within_the_contour_and_near_it(contour, off):
    fine = polygon(contour)
    for side, flat in ((1, inner_polygon(contour, off)), (-1, inner_polygon(reversed_contour(contour), off))):
        inner, ring = shapely.Polygon(flat), shapely.LinearRing(flat)
        there = shapely.distance(ring, shapely.points(shapely.get_coordinates(fine)))
        back = shapely.distance(fine.exterior, shapely.points(shapely.get_coordinates(shapely.segmentize(ring, 0.01))))
        assert max(there.max(), back.max()) <= off * (1 + 1e-6) + FINE
        if inner.is_valid:
            lost = shapely.difference(inner, fine) if side > 0 else shapely.difference(fine, inner)
            assert lost.area <= FINE * fine.length


def test_a_circle_keeps_its_extent_and_its_symmetry():
    flat = inner_polygon(circle(125.0), 4.5e-3)
    assert (flat.min(axis=0), flat.max(axis=0)) == (pytest.approx([-125, -125]), pytest.approx([125, 125]))
    assert len(flat) % 4 == 0
    hole = inner_polygon(circle(40.0, 3.0, 4.0, hole=True), 4.5e-3)
    away = np.hypot(*(hole - [3, 4]).T)
    assert away.min() == pytest.approx(40)
    assert 40 < away.max() <= 40.0045


@given(contours())
def test_ways_around_and_mirror_images(contour):
    for other, sign in ((backward(contour), -1), (reversed_contour(contour), -1), (mirrored(contour), -1)):
        assert area(other) == pytest.approx(sign * area(contour), rel=1e-12)
    assert backward(backward(contour)) == contour
    assert reversed_contour(reversed_contour(contour)) == contour
    assert reversed_contour(contour).points[0] == contour.points[0]
    assert mirrored(mirrored(contour)) == contour
    for other in (backward(contour), reversed_contour(contour)):
        assert shapely.symmetric_difference(polygon(other), polygon(contour)).area < 1e-6


@given(contours(), st.floats(0.1, 1000), st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
def test_placed_is_a_similarity(contour, scale, shift):
    other = placed(contour, scale, shift)
    assert area(other) == pytest.approx(scale**2 * area(contour), rel=1e-9)
    left, bottom, *_ = box(contour)
    assert box(other)[:2] == pytest.approx((scale * (left - shift[0]), scale * (bottom - shift[1])), abs=1e-9 * scale)


def test_a_circle_that_is_placed_keeps_its_diameter():
    x, y = 0.1 * cos(pi / 7), 0.1 * sin(pi / 7)
    for displacement in np.random.default_rng(0).uniform(-0.1, 0.1, (50, 2)):
        hole = placed(circle(0.0045, x, y, hole=True), 1.0, displacement, 12)
        assert hole.is_circle
        assert placed(hole, 1e3, digits=9).as_circle[2] == pytest.approx(4.5, abs=1e-13)
        assert placed(hole, 1.0, digits=12) == hole


def test_sides_that_are_arcs():
    # A quarter of a circle of radius 5 about (1, 2), to the left and to the right.
    start, end = (6.0, 2.0), (1.0, 7.0)
    left, right = (start, end, tan(pi / 8)), (end, start, -tan(pi / 8))
    for side in (left, right):
        assert center_of(side) == pytest.approx((1, 2))
        assert radius_of(side) == pytest.approx(5)
    assert tangent(left, end=False) == pytest.approx((0, 1))
    assert tangent(left, end=True) == pytest.approx((-1, 0))
    assert tangent(right, end=True) == pytest.approx((0, -1))


def test_a_slot():
    assert area(SLOT) == pytest.approx(400 + pi * 25)
    assert box(SLOT) == pytest.approx((-5, 0, 45, 10))
    assert turns_of(SLOT) == pytest.approx([0, 0, 0, 0], abs=1e-12)
    assert area(offset(SLOT, 2.0)) == pytest.approx(40 * 6 + pi * 9)
    assert SLOT.has_arcs
    assert not SLOT.is_circle
    assert SLOT.as_circle is None


@given(
    st.integers(2, 40), st.floats(0, 6), st.sampled_from([-1, 1]), st.lists(st.floats(0.5, 1), min_size=40, max_size=40)
)
def test_arcs_that_make_up_a_circle_are_one(count, first, sign, shares):
    ends = np.concatenate([[0], np.cumsum(shares[:count])])
    angles = first + sign * 2 * pi * ends / ends[-1]
    corners = tuple((3 + 4.5 * cos(a), 7 + 4.5 * sin(a)) for a in angles[:-1].tolist())
    result = merged(Contour(corners, tuple(np.tan(np.diff(angles) / 4).tolist())), 1e-3)
    assert result.is_circle
    assert result.as_circle == pytest.approx((3, 7, 4.5), abs=1e-9)
    assert area(result) == pytest.approx(sign * pi * 4.5**2)


@pytest.mark.parametrize(
    "contour",
    [
        SLOT,
        Contour(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))),
        # Two arcs of different circles, and a full turn in three corners of a wheel that is not round.
        Contour(((1.0, 0.0), (-1.0, 0.0)), (1.0, 0.9)),
        Contour(((1.0, 0.0), (-0.5, 0.9), (-0.5, -0.9)), (tan(pi / 6), tan(pi / 6), tan(pi / 6))),
    ],
)
def test_others_stay_as_they_are(contour):
    assert merged(contour, 1e-3) == contour


def test_arcs_without_end_are_refused():
    with pytest.raises(InputError, match="100000 chords"):
        inner_polygon(circle(1e300), 4.5e-6)


@given(contours())
def test_flattened_is_on_the_contour(contour):
    for side in contour.sides:
        if side[2]:
            (cx, cy), radius = center_of(side), radius_of(side)
            for x, y in side[:2]:
                assert hypot(x - cx, y - cy) == pytest.approx(radius)
            sweep = 4 * atan(side[2])
            rotation = atan2(side[1][1] - cy, side[1][0] - cx) - atan2(side[0][1] - cy, side[0][0] - cx) - sweep
            assert cos(rotation) == pytest.approx(1)


def test_a_circle_remembers_the_digits_that_it_was_made_of():
    whole = (0.0313, -0.0217, 0.013)
    made = circle(whole[2], *whole[:2])
    assert made.as_circle == backward(made).as_circle == reversed_contour(made).as_circle == whole
    assert Contour(made.points, made.bulges) == made
    assert Contour(made.points, made.bulges).as_circle == pytest.approx(whole, abs=1e-17)


def test_contours_as_arrays():
    square = Contour(((0, 0), (1, 0), (1, 1), (0, 1)))
    rings, circles = rings_and_circles([circle(0.1, 2, 3), square, circle(0.2, hole=True)])
    assert [ring.tolist() for ring in rings] == [[[0, 0], [1, 0], [1, 1], [0, 1]]]
    assert circles.tolist() == [[2, 3, 0.1, 1], [0, 0, 0.2, -1]]
    assert rings_and_circles([])[1].shape == (0, 4)


@pytest.mark.parametrize("center", [(2.0, -3.0), (1e4, 5.0, -7.0)])
def test_circles_and_balls_are_fitted_to_a_part_of_them(center):
    ways = np.random.default_rng(1).normal(size=(40, len(center)))
    ways = np.abs(ways) / np.linalg.norm(ways, axis=1)[:, None]
    middle, radius = fitted_sphere(center + 0.5 * ways)
    assert radius == pytest.approx(0.5, abs=1e-9)
    assert middle == pytest.approx(np.array(center), abs=1e-9)
